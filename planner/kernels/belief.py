"""The filter's covariance carried along straight moves, in six numbers.

A covariance is xx, xy, yy, xθ, yθ, θθ; so is the information of a fix, the sum of ``hᵀ h / v`` over its
bearings. ``noise`` (4,) is that of ``localization.kernels.ekf``; ``period``: metres driven between fixes,
0 for one per move.
"""

from __future__ import annotations

import math

from numba import njit

_CHI2_95 = -2.0 * math.log(0.05)
_TWO_PI = 2.0 * math.pi
# Rounding of distances, in fixes.
_EPS = 1e-9
# At most so many pieces per move between which fixes are folded in.
_MAX_PARTS = 4


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
def advance(P, ux, uy, d, turn, driven, before, after, noise, period):
    """Drive on in place: turn, then ``d`` m along (ux, uy) with fixes of ``before`` and ``after`` (6,).

    ``driven`` is the way since a fix was last due, m. The first half is measured with ``before``, the second
    with ``after``; a single fix counts at the end. What is measured while turning does not count: standing
    still would make a path certain. Returns the new ``driven``, and the largest r95 (m) and variance (m²) on
    the way, those just before a fix.
    """
    P[5] += noise[1] * turn
    count = 1.0
    if period > 0.0:
        driven += d
        count = math.floor(driven / period + _EPS)
        driven = max(driven - count * period, 0.0)
    if count <= 1.0:
        predict_straight(P, ux, uy, d, noise)
        r95 = r95_of(P)
        variance = largest_variance(P)
        if count == 1.0 and after[5] > 0.0:
            fold_in(P, after, 1.0)
        return driven, r95, variance
    parts = int(min(count, _MAX_PARTS))
    r95 = 0.0
    variance = 0.0
    for i in range(parts):
        predict_straight(P, ux, uy, d / parts, noise)
        r95 = max(r95, r95_of(P))
        variance = max(variance, largest_variance(P))
        J = before if 2 * (i + 1) <= parts else after
        if J[5] > 0.0:
            fold_in(P, J, count / parts)
    return driven, r95, variance


@njit(cache=True, nogil=True)
def reckoned(fixes, steps, directions, noise, out):
    """Covariances (K, 6) along a way into ``out``: those of ``fixes`` (K, 6), between them dead reckoning.

    ``fixes`` holds NaN where there is none; what is before the first stays NaN. ``steps`` (K - 1,), m, and
    ``directions`` (K - 1,), rad, lead from each place to the next; turns are on the spot.
    """
    for k in range(fixes.shape[0]):
        out[k] = fixes[k]
        if k == 0 or not math.isnan(fixes[k, 0]):
            continue
        P = out[k]
        P[:] = out[k - 1]
        if k > 1:
            turn = directions[k - 1] - directions[k - 2]
            turn -= _TWO_PI * math.floor(turn / _TWO_PI + 0.5)
            P[5] += noise[1] * abs(turn)
        ux = math.cos(directions[k - 1])
        uy = math.sin(directions[k - 1])
        predict_straight(P, ux, uy, steps[k - 1], noise)
