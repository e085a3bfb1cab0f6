"""Chains of poses joined by shortest curves: their cost, which to leave out, where to move the others.

A chain is poses (N, 3). For robots that turn in place only the places count: they turn towards the
next one; the first and the last heading hold, NaN where any will do. Arguments from ``rates`` on as for
``planner.kernels.steering.part_cost``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planner.kernels.steering import TURNING, curve_cost, steer

# Places nearer than this are one, m.
_SAME_M = 1e-9


@njit(cache=True, nogil=True)
def link(kind, radius, a, b, heading, is_last, parts):
    """Parts from pose a (3,), reached with ``heading``, to pose b (3,) into ``parts`` (5, 3).

    Returns their number, the length, the first and the last heading.
    """
    ends = np.empty((2, 3))
    ends[0] = a
    ends[1] = b
    if kind == TURNING:
        dx = b[0] - a[0]
        dy = b[1] - a[1]
        moves = math.hypot(dx, dy) > _SAME_M
        direction = math.atan2(dy, dx) if moves else heading
        if math.isnan(direction):
            direction = 0.0 if math.isnan(b[2]) else b[2]
        ends[0, 2] = direction if math.isnan(heading) else heading
        ends[1, 2] = b[2] if is_last and not math.isnan(b[2]) else direction
    n, length = steer(kind, ends[0], ends[1], radius, parts)
    return n, length, ends[0, 2], ends[1, 2]


@njit(cache=True, nogil=True)
def _gears(parts, n):
    """First and last gear of n parts; 0 without any."""
    first = 0
    last = 0
    for k in range(n):
        if parts[k, 0] != 0.0:
            last = 1 if parts[k, 0] > 0.0 else -1
            if first == 0:
                first = last
    return first, last


@njit(cache=True, nogil=True)
def chain_cost(
    kind,
    radius,
    poses,
    begin,
    end,
    turn_price,
    gear_price,
    rates,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    grid,
):
    """Cost of the chain (N, 3) from pose ``begin`` to pose ``end``; inf where it is not valid."""
    parts = np.empty((5, 3))
    heading = poses[0, 2]
    gear = 0
    if begin > 0:
        before = poses[0, 2] if begin == 1 else math.nan
        n, _, _, heading = link(kind, radius, poses[begin - 1], poses[begin], before, False, parts)
        _, gear = _gears(parts, n)
    total = 0.0
    start = np.empty(3)
    for k in range(begin, end):
        is_last = k + 2 == poses.shape[0]
        n, _, first_heading, heading = link(kind, radius, poses[k], poses[k + 1], heading, is_last, parts)
        start[0] = poses[k, 0]
        start[1] = poses[k, 1]
        start[2] = first_heading
        total += curve_cost(
            start,
            parts,
            n,
            turn_price,
            gear_price,
            math.inf,
            rates,
            transform,
            need,
            segments,
            bucket_start,
            bucket_items,
            bucket_gap,
            grid,
        )
        if total == math.inf:
            return total
        first, last = _gears(parts, n)
        if gear * first < 0:
            total += gear_price
        if last != 0:
            gear = last
    return total


@njit(cache=True, nogil=True)
def pull_chain(
    kind,
    radius,
    poses,
    own,
    own_gears,
    window,
    least_rate,
    part_price,
    chosen,
    turn_price,
    gear_price,
    rates,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    grid,
):
    """Poses of a chain (N, 3) to go through: ``chosen`` (N,) gets the pose before each on the way found.

    Dynamic programming over curves that leave out up to ``window`` poses. ``own`` (N - 1,): costs of the way
    at hand between neighbours, with gears (N - 1,), inf where it must not stay; where that is best,
    ``chosen`` is -1 - k instead of k. Every part costs ``part_price`` more. Gear and heading with which a
    pose is reached are those of its best way. Returns the cost.
    """
    count = poses.shape[0]
    best = np.full(count, math.inf)
    heading = np.empty(count)
    gear = np.zeros(count, np.int64)
    best[0] = 0.0
    heading[0] = poses[0, 2]
    chosen[0] = 0
    parts = np.empty((5, 3))
    start = np.empty(3)
    for j in range(1, count):
        is_last = j == count - 1
        i = j - 1
        value = best[i] + own[i] + part_price
        if gear[i] * own_gears[i] < 0:
            value += gear_price
        best[j] = value
        chosen[j] = -1 - i
        heading[j] = poses[j, 2]
        gear[j] = own_gears[i] if own_gears[i] != 0 else gear[i]
        for i in range(max(0, j - window), j):
            if best[i] == math.inf:
                continue
            n, length, first_heading, arrival = link(
                kind, radius, poses[i], poses[j], heading[i], is_last, parts
            )
            if best[i] + length * least_rate >= best[j]:
                continue
            first, last = _gears(parts, n)
            base = best[i] + n * part_price
            if gear[i] * first < 0:
                base += gear_price
            start[0] = poses[i, 0]
            start[1] = poses[i, 1]
            start[2] = first_heading
            value = base + curve_cost(
                start,
                parts,
                n,
                turn_price,
                gear_price,
                best[j] - base,
                rates,
                transform,
                need,
                segments,
                bucket_start,
                bucket_items,
                bucket_gap,
                grid,
            )
            if value < best[j]:
                best[j] = value
                chosen[j] = i
                heading[j] = arrival
                gear[j] = last if last != 0 else gear[i]
    return best[count - 1]


@njit(cache=True, nogil=True)
def relax_chain(
    kind,
    radius,
    poses,
    step,
    turn,
    smallest,
    max_sweeps,
    stop,
    turn_price,
    gear_price,
    rates,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    grid,
):
    """Move and turn the inner poses (N, 3) by steps while the cost falls, then by halves of them.

    ``step``, m, and ``turn``, rad. Ends when the step is below ``smallest`` m, after so many sweeps, or when
    ``stop`` (1,) is set.
    """
    count = poses.shape[0]
    held = np.empty(3)
    for _ in range(max_sweeps):
        moved = False
        for k in range(1, count - 1):
            if stop[0] != 0:
                return
            low = max(k - 2, 0)
            high = min(k + 2, count - 1)
            now = chain_cost(
                kind,
                radius,
                poses,
                low,
                high,
                turn_price,
                gear_price,
                rates,
                transform,
                need,
                segments,
                bucket_start,
                bucket_items,
                bucket_gap,
                grid,
            )
            # Sideways and along the chord of the neighbours, then turned.
            direction = math.atan2(
                poses[k + 1, 1] - poses[k - 1, 1],
                poses[k + 1, 0] - poses[k - 1, 0],
            )
            held[:] = poses[k]
            for trial in range(6):
                if trial >= 4 and kind == TURNING:
                    break
                side = 1.0 if trial % 2 == 0 else -1.0
                poses[k] = held
                if trial < 4:
                    angle = direction + (0.5 * math.pi if trial < 2 else 0.0)
                    poses[k, 0] += side * step * math.cos(angle)
                    poses[k, 1] += side * step * math.sin(angle)
                else:
                    poses[k, 2] += side * turn
                value = chain_cost(
                    kind,
                    radius,
                    poses,
                    low,
                    high,
                    turn_price,
                    gear_price,
                    rates,
                    transform,
                    need,
                    segments,
                    bucket_start,
                    bucket_items,
                    bucket_gap,
                    grid,
                )
                if value < now * (1.0 - 1e-9):
                    now = value
                    held[:] = poses[k]
                    moved = True
            poses[k] = held
        if not moved:
            step *= 0.5
            turn *= 0.5
            if step < smallest:
                return


@njit(cache=True, nogil=True)
def pose_link_cost(
    ax,
    ay,
    atheta,
    bx,
    by,
    btheta,
    kind,
    radius,
    turn_price,
    gear_price,
    rates,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    grid,
):
    """Cost of the shortest curve between two poses; inf where it is not valid."""
    ends = np.array([[ax, ay, atheta], [bx, by, btheta]])
    parts = np.empty((5, 3))
    n, _ = steer(kind, ends[0], ends[1], radius, parts)
    return curve_cost(
        ends[0],
        parts,
        n,
        turn_price,
        gear_price,
        math.inf,
        rates,
        transform,
        need,
        segments,
        bucket_start,
        bucket_items,
        bucket_gap,
        grid,
    )
