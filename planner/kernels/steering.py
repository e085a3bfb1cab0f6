"""Shortest curves between poses: turn-drive-turn, Dubins, Reeds–Shepp; what they cost; where they lead.

A curve is a pose (x, y, θ) and ``parts`` (N, 3): signed way, m (negative: backwards), curvature, 1/m, and
turn in place, rad. A part turns the heading by ``way · curvature + turn``. Kinds of robots: ``TURNING``
(turns in place), ``DUBINS`` (forwards only), ``REEDS_SHEPP`` (both ways).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.kernels.clearance import segment_distance
from planner.kernels.line_cost import motion_rate_cost
from planner.kernels.reeds_shepp import reeds_shepp_word

TURNING = 0
DUBINS = 1
REEDS_SHEPP = 2

_TURN = 2.0 * math.pi
# Turns by less than this short of a full one are rounding.
_SNAP = 1e-9
# Chords leave their arc by at most this, m, and are at most so long, m.
_SAG_M = 5e-4
_CHORD_M = 0.25


@njit(cache=True, nogil=True)
def wrapped(angle):
    """The angle in [-π, π)."""
    a = angle - _TURN * math.floor((angle + math.pi) / _TURN)
    return a if a < math.pi else -math.pi


@njit(cache=True, nogil=True)
def _ahead(angle):
    """The angle in [0, 2π); what is missing to a full turn by rounding counts as none."""
    a = angle - _TURN * math.floor(angle / _TURN)
    return 0.0 if _TURN - a < _SNAP else a


@njit(cache=True, nogil=True)
def advance(x, y, theta, way, curvature):
    """Pose after a signed way along an arc."""
    half = 0.5 * way * curvature
    # Chord of the arc: way · sin(h) / h.
    chord = way * (1.0 - half * half / 6.0) if abs(half) < 1e-4 else way * math.sin(half) / half
    return x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + 2.0 * half


@njit(cache=True, nogil=True)
def _dubins_word(word, d, a, b):
    """Lengths of a word (LSL, RSR, LSR, RSL, RLR, LRL) for radius 1; the first is inf where it has none."""
    sa = math.sin(a)
    sb = math.sin(b)
    ca = math.cos(a)
    cb = math.cos(b)
    cab = math.cos(a - b)
    if word < 4:
        same = word < 2
        first = 1.0 if word in (0, 2) else -1.0  # left or right
        if same:
            square = 2.0 + d * d - 2.0 * cab + 2.0 * d * first * (sa - sb)
        else:
            square = d * d - 2.0 + 2.0 * cab + 2.0 * d * first * (sa + sb)
        if square < 0.0:
            if square < -1e-12:
                return math.inf, 0.0, 0.0
            square = 0.0
        p = math.sqrt(square)
        if same:
            tilt = math.atan2(first * (cb - ca), d + first * (sa - sb))
            return _ahead(first * (tilt - a)), p, _ahead(first * (b - tilt))
        tilt = math.atan2(-first * (ca + cb), d + first * (sa + sb)) - math.atan2(-2.0 * first, p)
        return _ahead(first * (tilt - a)), p, _ahead(first * (tilt - b))
    first = 1.0 if word == 5 else -1.0
    c = (6.0 - d * d + 2.0 * cab + 2.0 * d * first * (sb - sa)) / 8.0
    if abs(c) > 1.0:
        return math.inf, 0.0, 0.0
    p = _TURN - math.acos(c)
    tilt = math.atan2(first * (cb - ca), d + first * (sa - sb))
    t = _ahead(first * (tilt - a) + 0.5 * p)
    return t, p, _ahead(first * (b - a) - t + p)


@njit(cache=True, nogil=True)
def dubins(start, goal, radius, parts):
    """Shortest forward curve [Dub57, SL01] from pose to pose into ``parts`` (3, 3): number, length."""
    dx = (goal[0] - start[0]) / radius
    dy = (goal[1] - start[1]) / radius
    d = math.hypot(dx, dy)
    direction = math.atan2(dy, dx) if d > 0.0 else 0.0
    a = _ahead(start[2] - direction)
    b = _ahead(goal[2] - direction)
    best = math.inf
    chosen = 0
    lengths = (0.0, 0.0, 0.0)
    for word in range(6):
        t, p, q = _dubins_word(word, d, a, b)
        if t + p + q < best:
            best = t + p + q
            chosen = word
            lengths = (t, p, q)
    turns = ((1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (-1, 1, -1), (1, -1, 1))[chosen]
    n = 0
    for k in range(3):
        if lengths[k] > 0.0:
            parts[n, 0] = lengths[k] * radius
            parts[n, 1] = turns[k] / radius
            parts[n, 2] = 0.0
            n += 1
    return n, best * radius


@njit(cache=True, nogil=True)
def reeds_shepp(start, goal, radius, parts):
    """Shortest curve of both gears [RS90] from pose to pose into ``parts`` (5, 3): number, length."""
    c = math.cos(start[2])
    s = math.sin(start[2])
    dx = (goal[0] - start[0]) / radius
    dy = (goal[1] - start[1]) / radius
    word = np.empty((5, 2))
    count, total = reeds_shepp_word(c * dx + s * dy, c * dy - s * dx, wrapped(goal[2] - start[2]), word)
    n = 0
    for k in range(count):
        if abs(word[k, 0]) > _SNAP:
            parts[n, 0] = word[k, 0] * radius
            parts[n, 1] = word[k, 1] / radius
            parts[n, 2] = 0.0
            n += 1
    return n, total * radius


@njit(cache=True, nogil=True)
def turn_and_drive(start, goal, parts):
    """Turn in place, straight ahead, turn in place, between poses (3,): how many parts (3, 3), length, m."""
    dx = goal[0] - start[0]
    dy = goal[1] - start[1]
    d = math.hypot(dx, dy)
    heading = start[2]
    n = 0
    for k in range(3):
        turn = 0.0
        way = 0.0
        if k == 1:
            way = d
        elif k == 0 and d > _SNAP:
            turn = wrapped(math.atan2(dy, dx) - heading)
        elif k == 2:
            turn = wrapped(goal[2] - heading)
        if abs(turn) > _SNAP or way > _SNAP:
            parts[n, 0] = way
            parts[n, 1] = 0.0
            parts[n, 2] = turn
            heading += turn
            n += 1
    return n, d


@njit(cache=True, nogil=True)
def steer(kind, start, goal, radius, parts):
    """Shortest curve of a kind of robot between poses (3,) into ``parts`` (5, 3): how many, length, m."""
    if kind == DUBINS:
        return dubins(start, goal, radius, parts)
    if kind == REEDS_SHEPP:
        return reeds_shepp(start, goal, radius, parts)
    return turn_and_drive(start, goal, parts)


@njit(cache=True, nogil=True)
def heading_bin(theta, n_bins):
    """The nearest of n headings 0, 2π / n, …."""
    return math.floor(theta * n_bins / _TURN + 0.5) % n_bins


@njit(cache=True, nogil=True)
def chords_of(way, curvature):
    """Number of chords that stand for a part."""
    if curvature == 0.0 or way == 0.0:
        return 1
    longest = min(_CHORD_M, math.sqrt(8.0 * _SAG_M / abs(curvature)), 0.5 / abs(curvature))
    return max(1, math.ceil(abs(way) / longest))


@njit(cache=True, nogil=True)
def part_cost(
    x, y, theta, part, rates, transform, need, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
):
    """∫ rate ds along the way of a part (3,) from a pose; inf where it may not go.

    ``rates`` (H, ny, nx): per heading of the robot, in W; one of them holds for every heading. An arc is cut
    into chords that keep, beyond ``need``, what the arc may lie outside of them; their cost is stretched to
    the length of the arc. The rest as in ``planner.kernels.line_cost``.
    """
    way = part[0]
    kappa = part[1]
    n = chords_of(way, kappa)
    step = way / n
    half = 0.5 * step * kappa
    stretch = half / math.sin(half) if abs(half) > 1e-4 else 1.0 + half * half / 6.0
    sag = 0.125 * abs(kappa) * step * step
    total = 0.0
    for _ in range(n):
        nx, ny, ntheta = advance(x, y, theta, step, kappa)
        k = heading_bin(theta + half, rates.shape[0])
        cost = motion_rate_cost(x, y, nx, ny, rates[k], transform)
        if cost == math.inf:
            return math.inf
        room = need + sag
        kept = segment_distance(
            x, y, nx, ny, room, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
        )
        if kept < room:
            return math.inf
        total += cost * stretch
        x = nx
        y = ny
        theta = ntheta
    return total


@njit(cache=True, nogil=True)
def may_turn(x, y, theta, turn, rates, transform):
    """Whether the cell of a place is allowed at every heading of a turn."""
    dx = x - transform[0]
    dy = y - transform[1]
    col = math.floor((dx * transform[2] + dy * transform[3]) / transform[4])
    row = math.floor((dy * transform[2] - dx * transform[3]) / transform[4])
    if row < 0 or col < 0 or row >= rates.shape[1] or col >= rates.shape[2]:
        return False
    n = rates.shape[0]
    steps = math.ceil(abs(turn) * n / _TURN)
    for k in range(steps + 1):
        bin_ = heading_bin(theta + turn * k / max(steps, 1), n)
        if rates[bin_, row, col] == math.inf:
            return False
    return True


@njit(cache=True, nogil=True)
def curve_cost(
    start,
    parts,
    n,
    turn_price,
    gear_price,
    limit,
    rates,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    bucket_grid,
):
    """Cost of the first n ``parts`` from a pose (3,): ∫ rate ds, and manoeuvres at their prices.

    inf where the robot may not drive, or beyond ``limit``. ``turn_price``, m/rad, ``gear_price``, m. Turns in
    place that have a price are checked at the headings between, without one they are not: a disc needs no
    more room for them than for driving there.
    """
    x = start[0]
    y = start[1]
    theta = start[2]
    gear = 0
    total = 0.0
    for k in range(n):
        way = parts[k, 0]
        if way == 0.0:
            turn = parts[k, 2]
            total += turn_price * abs(turn)
            if turn_price > 0.0 and rates.shape[0] > 1 and not may_turn(x, y, theta, turn, rates, transform):
                return math.inf
            theta += turn
            continue
        if gear * way < 0.0:
            total += gear_price
        gear = 1 if way > 0.0 else -1
        total += part_cost(
            x,
            y,
            theta,
            parts[k],
            rates,
            transform,
            need,
            segments,
            bucket_start,
            bucket_items,
            bucket_gap,
            bucket_grid,
        )
        if total >= limit:
            return math.inf
        x, y, theta = advance(x, y, theta, way, parts[k, 1])
    return total


@njit(cache=True, nogil=True)
def steer_costs(
    kind,
    radius,
    starts,
    goals,
    turn_price,
    gear_price,
    limits,
    out,
    rates,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    bucket_grid,
):
    """Costs of the shortest curves between poses (N, 3) and (N, 3) into ``out`` (N, 3).

    ``out``: cost, inf where it is not valid or beyond ``limits`` (N,) in length; first and last gear (0: the
    robot does not drive).
    """
    parts = np.empty((5, 3))
    for i in range(starts.shape[0]):
        n, length = steer(kind, starts[i], goals[i], radius, parts)
        out[i, 0] = math.inf
        out[i, 1] = 0.0
        out[i, 2] = 0.0
        if length > limits[i]:
            continue
        out[i, 0] = curve_cost(
            starts[i],
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
            bucket_grid,
        )
        for k in range(n):
            if parts[k, 0] != 0.0:
                gear = 1.0 if parts[k, 0] > 0.0 else -1.0
                if out[i, 1] == 0.0:
                    out[i, 1] = gear
                out[i, 2] = gear


@njit(cache=True, nogil=True)
def sample_parts(start, parts, counts, out):
    """Poses along ``parts`` (N, 3), ``counts`` (N,) of them per part, into ``out`` (Σ + 1, 6).

    Columns: x, y, θ (not wrapped), arc length, part, share of the part that is done.
    """
    x = start[0]
    y = start[1]
    theta = start[2]
    s = 0.0
    at = 0
    out[0, 0] = x
    out[0, 1] = y
    out[0, 2] = theta
    out[0, 3] = 0.0
    out[0, 4] = 0.0
    out[0, 5] = 0.0
    for i in range(parts.shape[0]):
        way = parts[i, 0]
        for k in range(1, counts[i] + 1):
            share = k / counts[i]
            at += 1
            px, py, pt = advance(x, y, theta, share * way, parts[i, 1])
            out[at, 0] = px
            out[at, 1] = py
            out[at, 2] = pt + share * parts[i, 2]
            out[at, 3] = s + share * abs(way)
            out[at, 4] = i
            out[at, 5] = share
        s += abs(way)
        x = out[at, 0]
        y = out[at, 1]
        theta = out[at, 2]
