"""Motion in time along ways whose curvature is linear between stations, under limits of turning too.

``b = v²``; between stations the tangential acceleration a is constant and the curvature κ linear, so that the
angular acceleration ``κ' b + κ a`` is linear too: checked at both ends of an interval, it holds throughout.
Rows ``(way, κ at its begin, κ at its end)``: the way is signed, the heading turns by ``∫ κ d(way)``.
"""

from __future__ import annotations

import math

from numba import njit

_ROUNDS = 40
# Share of v² that an interval keeps at least where it may.
_KEPT = 0.75
# Gauss–Legendre with five points on [-1, 1].
_NODES = (-0.9061798459386640, -0.5384693101056831, 0.0, 0.5384693101056831, 0.9061798459386640)
_WEIGHTS = (
    0.23692688505618908,
    0.47862867049936647,
    0.56888888888888889,
    0.47862867049936647,
    0.23692688505618908,
)


@njit(cache=True, nogil=True)
def _cut(low, high, factor, lo, hi):
    """The part of [low, high] with lo ≤ factor · a ≤ hi."""
    if factor > 0.0:
        return max(low, lo / factor), min(high, hi / factor)
    if factor < 0.0:
        return max(low, hi / factor), min(high, lo / factor)
    if lo > 0.0 or hi < 0.0:
        return 1.0, 0.0
    return low, high


@njit(cache=True, nogil=True)
def _accelerations(b, k0, k1, step, b_end, accel, alpha):
    """Least and largest a from b at a station such that all limits hold and at most ``b_end`` is reached.

    The first is above the second where there is none. ``accel``: of the length of (a, κ b); ``alpha``: of
    the angular acceleration.
    """
    side = accel * accel - (k0 * b) ** 2
    if side < 0.0:
        return 1.0, 0.0
    high = math.sqrt(side)
    low = -high
    # Speed at the end: not so much slower, if need not be, that a fast beginning is paid for with creeping.
    low, high = _cut(low, high, 2.0 * step, _KEPT * min(b, b_end) - b, b_end - b)
    # a² + κ₁² (b + 2 a Δs)² ≤ accel²
    k = k1 * k1
    p = 1.0 + 4.0 * k * step * step
    q = 2.0 * k * step * b
    root = q * q - p * (k * b * b - accel * accel)
    if root < 0.0:
        return 1.0, 0.0
    root = math.sqrt(root)
    low = max(low, (-q - root) / p)
    high = min(high, (-q + root) / p)
    if alpha < math.inf:
        slope = (k1 - k0) / step
        low, high = _cut(low, high, k0, -alpha - slope * b, alpha - slope * b)
        low, high = _cut(low, high, k1 + 2.0 * step * slope, -alpha - slope * b, alpha - slope * b)
    return low, high


@njit(cache=True, nogil=True)
def turning_profile(kappa, step, max_speed, accel, max_turn_rate, alpha, out):
    """Largest b = v² at N stations, at rest at both ends; out (N,).

    ``kappa`` (N - 1, 2): curvature at begin and end of every interval, ``step`` (N - 1,): their lengths.

    Backward: the largest b from which the rest of the way can be driven (what can be is an interval from 0,
    by convexity); forward: the largest acceleration.
    """
    n = out.shape[0]
    out[n - 1] = 0.0
    for i in range(n - 2, -1, -1):
        top = max_speed * max_speed
        largest = max(abs(kappa[i, 0]), abs(kappa[i - 1, 1]) if i > 0 else 0.0)
        if largest > 0.0:
            top = min(top, (max_turn_rate / largest) ** 2, accel / largest)
        low, high = _accelerations(top, kappa[i, 0], kappa[i, 1], step[i], out[i + 1], accel, alpha)
        if low > high:
            lo = 0.0
            hi = top
            for _ in range(_ROUNDS):
                middle = 0.5 * (lo + hi)
                low, high = _accelerations(
                    middle, kappa[i, 0], kappa[i, 1], step[i], out[i + 1], accel, alpha
                )
                if low <= high:
                    lo = middle
                else:
                    hi = middle
            top = lo
        out[i] = top
    out[0] = 0.0
    for i in range(n - 1):
        low, high = _accelerations(out[i], kappa[i, 0], kappa[i, 1], step[i], out[i + 1], accel, alpha)
        reached = out[i] + 2.0 * step[i] * high if low <= high else out[i + 1]
        out[i + 1] = min(out[i + 1], max(reached, 0.0))


@njit(cache=True, nogil=True)
def advance_row(x, y, theta, way, k0, k1):
    """Pose after a signed way along which the curvature goes from k0 to k1; short ways only."""
    slope = 0.5 * (k1 - k0) / way if way != 0.0 else 0.0
    dx = 0.0
    dy = 0.0
    for node, weight in zip(_NODES, _WEIGHTS):  # noqa: B905
        s = 0.5 * way * (1.0 + node)
        angle = theta + s * (k0 + slope * s)
        dx += 0.5 * way * weight * math.cos(angle)
        dy += 0.5 * way * weight * math.sin(angle)
    return x + dx, y + dy, theta + 0.5 * way * (k0 + k1)


@njit(cache=True, nogil=True)
def stations(pose, rows, counts, out):
    """Places along rows (N, 3), ``counts`` (N,) steps each, into ``out`` (Σ + 1, 6).

    Columns: pose, arc length, κ at begin and end of the step that begins there (the last: κ at the end).
    """
    x = pose[0]
    y = pose[1]
    theta = pose[2]
    s = 0.0
    at = 0
    out[0, 0] = x
    out[0, 1] = y
    out[0, 2] = theta
    out[0, 3] = 0.0
    for i in range(rows.shape[0]):
        n = counts[i]
        way = rows[i, 0] / n
        for k in range(n):
            k0 = rows[i, 1] + (rows[i, 2] - rows[i, 1]) * (k / n)
            k1 = rows[i, 1] + (rows[i, 2] - rows[i, 1]) * ((k + 1) / n)
            x, y, theta = advance_row(x, y, theta, way, k0, k1)
            s += abs(way)
            out[at, 4] = k0
            out[at, 5] = k1
            at += 1
            out[at, 0] = x
            out[at, 1] = y
            out[at, 2] = theta
            out[at, 3] = s
            out[at, 4] = k1
            out[at, 5] = k1


@njit(cache=True, nogil=True)
def poses_at(s, gear, table, out):
    """Poses and κ at ascending arc lengths (K,) from ``stations`` (N, 6), in a gear, into ``out`` (K, 4)."""
    i = 0
    last = table.shape[0] - 2
    for k in range(s.shape[0]):
        while i < last and table[i + 1, 3] <= s[k]:
            i += 1
        step = table[i + 1, 3] - table[i, 3]
        ahead = min(max(s[k] - table[i, 3], 0.0), step)
        share = ahead / step if step > 0.0 else 0.0
        kappa = table[i, 4] + share * (table[i, 5] - table[i, 4])
        x, y, theta = advance_row(table[i, 0], table[i, 1], table[i, 2], gear * ahead, table[i, 4], kappa)
        out[k, 0] = x
        out[k, 1] = y
        out[k, 2] = theta
        out[k, 3] = kappa
