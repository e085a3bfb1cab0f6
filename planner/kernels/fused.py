"""The filter's covariance carried along moves on a grid, and a label search over (cell, covariance).

A covariance is six numbers: xx, xy, yy, xθ, yθ, θθ; so is the information of a fix, the sum of ``hᵀ h / v``
over its bearings. ``noise`` (4,) is that of ``localization.kernels.ekf``; ``timing`` (3,): speed (m/s), turn
rate (rad/s), seconds between fixes (0: one per move). ``play`` (rad): see ``turned``. Grids are those of
``cost_to_go``.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

from planner.kernels.labels import EXHAUSTED, FOUND, FULL, STOPPED

_SQRT2 = math.sqrt(2.0)
_CHI2_95 = -2.0 * math.log(0.05)
_TWO_PI = 2.0 * math.pi
# Rounding of bounds and of times.
_EPS = 1e-9
# At most so many pieces per move between which fixes are folded in.
_MAX_PARTS = 4

#: What a search minimises: the cost under bounds, the largest r95 under the others, the factor on all bounds.
BY_COST, BY_R95, BY_EXCESS = range(3)
#: Columns of a label: covariance (0-5), then these.
COST, R95, SCALE, METRES, CLOCK, DIRECTION, ANCHOR, WORST, MOST, N_COLUMNS = range(6, 16)


@njit(cache=True, nogil=True)
def predict_straight(P, ux, uy, d, noise):
    """Prediction in place of ``P`` (6,) over ``d`` m straight along (ux, uy): ``F P Fᵀ + G M Gᵀ``."""
    a = -d * uy
    b = d * ux
    along = noise[0] * d
    turn = noise[2] * d
    side = noise[3] * d
    P[0] += 2.0 * a * P[3] + a * a * P[5] + along * ux * ux + 0.25 * turn * a * a + side * uy * uy
    P[1] += b * P[3] + a * P[4] + a * b * P[5] + (along - side) * ux * uy + 0.25 * turn * a * b
    P[2] += 2.0 * b * P[4] + b * b * P[5] + along * uy * uy + 0.25 * turn * b * b + side * ux * ux
    P[3] += a * P[5] + 0.5 * turn * a
    P[4] += b * P[5] + 0.5 * turn * b
    P[5] += turn


@njit(cache=True, nogil=True)
def fold_in(P, J, times):
    """Update in place of ``P`` (6,) by ``times`` fixes of information ``J`` (6,): ``(I + P K)⁻¹ P``."""
    k0 = times * J[0]
    k1 = times * J[1]
    k2 = times * J[2]
    k3 = times * J[3]
    k4 = times * J[4]
    k5 = times * J[5]
    m00 = 1.0 + P[0] * k0 + P[1] * k1 + P[3] * k3
    m01 = P[0] * k1 + P[1] * k2 + P[3] * k4
    m02 = P[0] * k3 + P[1] * k4 + P[3] * k5
    m10 = P[1] * k0 + P[2] * k1 + P[4] * k3
    m11 = 1.0 + P[1] * k1 + P[2] * k2 + P[4] * k4
    m12 = P[1] * k3 + P[2] * k4 + P[4] * k5
    m20 = P[3] * k0 + P[4] * k1 + P[5] * k3
    m21 = P[3] * k1 + P[4] * k2 + P[5] * k4
    m22 = 1.0 + P[3] * k3 + P[4] * k4 + P[5] * k5
    c00 = m11 * m22 - m12 * m21
    c01 = m02 * m21 - m01 * m22
    c02 = m01 * m12 - m02 * m11
    c10 = m12 * m20 - m10 * m22
    c11 = m00 * m22 - m02 * m20
    c12 = m02 * m10 - m00 * m12
    c20 = m10 * m21 - m11 * m20
    c21 = m01 * m20 - m00 * m21
    c22 = m00 * m11 - m01 * m10
    s = 1.0 / (m00 * c00 + m01 * c10 + m02 * c20)
    xx = (c00 * P[0] + c01 * P[1] + c02 * P[3]) * s
    xy = (c00 * P[1] + c01 * P[2] + c02 * P[4]) * s
    yy = (c10 * P[1] + c11 * P[2] + c12 * P[4]) * s
    xt = (c00 * P[3] + c01 * P[4] + c02 * P[5]) * s
    yt = (c10 * P[3] + c11 * P[4] + c12 * P[5]) * s
    tt = (c20 * P[3] + c21 * P[4] + c22 * P[5]) * s
    P[0] = xx
    P[1] = xy
    P[2] = yy
    P[3] = xt
    P[4] = yt
    P[5] = tt


@njit(cache=True, nogil=True)
def largest_variance(P):
    """Largest variance of the position in any direction, m²."""
    return 0.5 * (P[0] + P[2]) + math.hypot(0.5 * (P[0] - P[2]), P[1])


@njit(cache=True, nogil=True)
def r95_of(P):
    """Radius of the circle with the area of the 95 % ellipse, m."""
    return math.sqrt(_CHI2_95 * math.sqrt(max(P[0] * P[2] - P[1] * P[1], 0.0)))


@njit(cache=True, nogil=True)
def turned(direction, last, anchor, play):
    """Turn (rad) counted for a move along ``direction`` after one along ``last``, and the new anchor.

    An any-angle line becomes an alternation of two neighbouring directions on the grid, which must not count
    as turns. The anchor follows the direction with a play; twice its way, at most the turn itself, counts:
    with a play of 22.5° all of a lone turn, nothing of an alternation; with 0 every turn. ``last`` NaN:
    nothing was driven.
    """
    if math.isnan(last):
        return 0.0, direction
    away = direction - anchor
    away -= _TWO_PI * math.floor(away / _TWO_PI + 0.5)
    beyond = abs(away) - play
    if beyond <= 0.0:
        return 0.0, anchor
    turn = direction - last
    turn -= _TWO_PI * math.floor(turn / _TWO_PI + 0.5)
    return min(2.0 * beyond, abs(turn)), anchor + (beyond if away > 0.0 else -beyond)


@njit(cache=True, nogil=True)
def advance(P, ux, uy, d, turn, clock, before, after, noise, timing):
    """Drive on in place: turn, then ``d`` m along (ux, uy), fixes of ``before`` and ``after`` (6,) on time.

    ``clock`` is the time since the last time for a fix, s. The first half is measured with ``before``, the
    second with ``after``; a single fix counts at the end. Returns the new clock, and the largest r95 (m) and
    variance (m²) on the way, those just before a fix.
    """
    r95 = 0.0
    variance = 0.0
    period = timing[2]
    if turn > 0.0:
        P[5] += noise[1] * turn
        if period > 0.0:
            clock += turn / timing[1]
            count = math.floor(clock / period + _EPS)
            clock -= count * period
            if count > 0.0 and before[5] > 0.0:
                fold_in(P, before, count)
    count = 1.0
    if period > 0.0:
        clock += d / timing[0]
        count = math.floor(clock / period + _EPS)
        clock = max(clock - count * period, 0.0)
    if count <= 1.0:
        predict_straight(P, ux, uy, d, noise)
        r95 = r95_of(P)
        variance = largest_variance(P)
        if count == 1.0 and after[5] > 0.0:
            fold_in(P, after, 1.0)
        return clock, r95, variance
    parts = int(min(count, _MAX_PARTS))
    for i in range(parts):
        predict_straight(P, ux, uy, d / parts, noise)
        r95 = max(r95, r95_of(P))
        variance = max(variance, largest_variance(P))
        J = before if 2 * (i + 1) <= parts else after
        if J[5] > 0.0:
            fold_in(P, J, count / parts)
    return clock, r95, variance


@njit(cache=True, nogil=True)
def _grown(array, size):
    """A longer copy (size, n) of an array (m, n) whose rest is not set."""
    out = np.empty((size, array.shape[1]), array.dtype)
    out[: array.shape[0]] = array
    return out


@njit(cache=True, nogil=True)
def fused_labels(
    half,
    blind,
    width,
    length,
    information,
    largest,
    to_go,
    starts,
    first,
    goals,
    noise,
    timing,
    weight,
    max_r95,
    max_blind,
    mode,
    ratio,
    arm,
    play,
    max_labels,
    stop,
):
    """Search over (cell, covariance): outcome, cost, worst value, cells (K,), labels (K, 15), labels made.

    ``half``, ``blind``, ``width``, ``length``: as in ``labels``; a move costs the sum of its halves times
    ``1 + weight · r95``, the mean of both ends. ``information`` (n, 6) of one fix per cell, zero without;
    ``largest`` (n,): variance of the position that is allowed there, m²; ``to_go`` (n,): never above what is
    left. ``starts`` (S, 5): cell, cost, length, direction to its centre (NaN: none), metres without a fix;
    ``first`` (8,): covariance, fix clock and heading (NaN: free) at the start. ``goals`` (T, 3): cell, cost
    to the goal, metres without a fix. ``mode``: BY_COST keeps ``max_r95``, ``largest`` and ``max_blind`` (m);
    BY_R95 keeps them and minimises the largest r95; BY_EXCESS the largest ratio to any bound, keeping none.
    Of two labels in a cell the later one is dropped if it is worse in what is minimised and its
    ``√(λ + arm² θθ)`` is not below ``ratio`` of the other's; inf: none is dropped.
    """
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    ups = (0.0, 0.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0)
    rights = (1.0, -1.0, 0.0, 0.0, 1.0, -1.0, 1.0, -1.0)
    size = 4096
    data = np.empty((size, N_COLUMNS))
    # Cell, parent, next label of the cell, whether it counts still.
    links = np.empty((size, 4), np.int32)
    head = np.full(half.shape[0], -1, np.int32)
    P = np.empty(6)
    heap = [(0.0, 0.0, np.int64(0))]
    heapq.heappop(heap)
    count = 0
    outcome = EXHAUSTED
    best_worst = math.inf
    best_cost = math.inf
    last = -1
    popped = 0
    label = -1
    waiting_start = 0
    n_starts = starts.shape[0]
    while True:
        if waiting_start < n_starts:
            k_first = waiting_start
            k_end = k_first + 1
            waiting_start += 1
            u = np.int64(starts[k_first, 0])
        else:
            if len(heap) == 0:
                break
            worst_u, f, label = heapq.heappop(heap)
            if worst_u > best_worst or (worst_u == best_worst and f >= best_cost):
                break
            if links[label, 3] == 0:
                continue
            popped += 1
            if popped & 255 == 1 and stop[0] != 0:
                outcome = STOPPED
                break
            if count > max_labels:
                outcome = FULL
                break
            u = np.int64(links[label, 0])
            links[label, 3] = 2
            cost_u = data[label, COST]
            for k in range(goals.shape[0]):
                if np.int64(goals[k, 0]) != u:
                    continue
                metres = data[label, METRES] + goals[k, 2]
                total = cost_u + goals[k, 1] * (1.0 + weight * data[label, R95])
                value = data[label, WORST]
                if mode == BY_EXCESS:
                    value = max(value, metres / max_blind if max_blind > 0.0 else 0.0)
                elif metres > max_blind:
                    continue
                if mode == BY_COST:
                    value = 0.0
                if value < best_worst or (value == best_worst and total < best_cost):
                    best_worst = value
                    best_cost = total
                    last = label
            k_first = 0
            k_end = 8
        for k in range(k_first, k_end):
            if label < 0:
                # From the place itself to the first cell.
                v = u
                if not to_go[v] < math.inf:
                    continue
                P[:] = first[:6]
                d = starts[k, 2]
                direction = starts[k, 3]
                heading = first[7]
                turn, anchor = 0.0, direction
                if d > 0.0 and not math.isnan(heading):
                    turn, anchor = turned(direction, heading, heading, play)
                if d == 0.0:
                    direction = heading
                    anchor = heading
                ux = math.cos(direction) if d > 0.0 else 0.0
                uy = math.sin(direction) if d > 0.0 else 0.0
                r_u = r95_of(P)
                clock = first[6]
                most = r_u
                variance = largest_variance(P)
                if d > 0.0:
                    clock, most, variance = advance(
                        P, ux, uy, d, turn, clock, information[v], information[v], noise, timing
                    )
                base = starts[k, 1]
                metres = starts[k, 4]
                leaving = metres
                worst = 0.0
                if mode == BY_R95:
                    worst = r_u
                elif mode == BY_EXCESS:
                    worst = max(r_u / max_r95, math.sqrt(largest_variance(first) / largest[v]))
                before = 0.0
            else:
                v = u + steps[k]
                if half[v] == math.inf or not to_go[v] < math.inf:
                    continue
                factor = _SQRT2 if k >= 4 else 1.0
                metres = data[label, METRES]
                if blind[u] != 0:
                    metres += length * factor
                leaving = metres
                if blind[v] == 0:
                    metres = 0.0
                else:
                    metres += length * factor
                if mode != BY_EXCESS and max(leaving, metres) > max_blind:
                    continue
                base = (half[u] + half[v]) * factor
                before = data[label, COST]
                if mode == BY_COST and not before + base + to_go[v] < best_cost:
                    continue
                P[:] = data[label, :6]
                r_u = data[label, R95]
                ux = rights[k] / factor
                uy = ups[k] / factor
                direction = math.atan2(uy, ux)
                turn, anchor = turned(direction, data[label, DIRECTION], data[label, ANCHOR], play)
                d = 2.0 * length * factor
                clock, most, variance = advance(
                    P, ux, uy, d, turn, data[label, CLOCK], information[u], information[v], noise, timing
                )
                worst = data[label, WORST]
            r = r95_of(P)
            cost = before + base * (1.0 + 0.5 * weight * (r_u + r))
            if mode == BY_EXCESS:
                worst = max(worst, most / max_r95, math.sqrt(variance / largest[v]))
                if max_blind < math.inf:
                    worst = max(worst, leaving / max_blind, metres / max_blind)
            else:
                if most > max_r95 * (1.0 + _EPS) or variance > largest[v] * (1.0 + _EPS):
                    continue
                if mode == BY_R95:
                    worst = max(worst, most)
            if worst > best_worst or (worst == best_worst and not cost + to_go[v] < best_cost):
                continue
            scale = math.sqrt(largest_variance(P) + arm * arm * P[5])
            primary = cost if mode == BY_COST else worst
            at = COST if mode == BY_COST else WORST
            dropped = False
            previous = -1
            other = head[v]
            while other >= 0:
                following = links[other, 2]
                value = data[other, at]
                if (
                    value <= primary
                    and data[other, SCALE] * ratio <= scale
                    and (max_blind == math.inf or data[other, METRES] <= metres)
                ):
                    dropped = True
                    break
                if (
                    primary <= value
                    and scale * max(ratio, 1.0) <= data[other, SCALE]
                    and links[other, 3] == 1
                    and (max_blind == math.inf or metres <= data[other, METRES])
                ):
                    links[other, 3] = 0
                    if previous >= 0:
                        links[previous, 2] = following
                    else:
                        head[v] = following
                else:
                    previous = other
                other = following
            if dropped:
                continue
            if count == size:
                size *= 2
                data = _grown(data, size)
                links = _grown(links, size)
            data[count, :6] = P
            data[count, COST] = cost
            data[count, R95] = r
            data[count, SCALE] = scale
            data[count, METRES] = metres
            data[count, CLOCK] = clock
            data[count, DIRECTION] = direction
            data[count, ANCHOR] = anchor
            data[count, WORST] = worst
            data[count, MOST] = most
            links[count, 0] = v
            links[count, 1] = label
            links[count, 2] = head[v]
            links[count, 3] = 1
            head[v] = count
            heapq.heappush(heap, (worst, cost + to_go[v], np.int64(count)))
            count += 1
    n = 0
    label = last
    while label >= 0:
        n += 1
        label = links[label, 1]
    walked = np.empty(n, np.int64)
    labels = np.empty((n, N_COLUMNS))
    label = last
    for k in range(n - 1, -1, -1):
        walked[k] = links[label, 0]
        labels[k] = data[label]
        label = links[label, 1]
    if outcome == EXHAUSTED and last >= 0:
        outcome = FOUND
    return outcome, best_cost, best_worst, walked, labels, count
