"""First-order covariance of a fix, in inverted landmarks (MATH §2 and §3).

Landmark ``i`` at ``d_i`` from the robot is inverted in the unit circle: ``g_i = d_i / r_i²``. The bearing's
gradient ``q_i`` is ``g_i`` turned by -90°, so the triangle of the ``g_i`` has the area of the triangle of
the ``q_i``. ``D`` is twice that area, signed. ``v_i`` is the variance of bearing ``i``, rad².

``sensor`` (7,): mode (a constant below), bearing variance on the optical axis (rad²), field of view, pan_min,
pan_max, heading (rad), cosine of the field of view.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

#: Constant bearing variance, all around.
OMNIDIRECTIONAL = 0.0
#: Pinhole, axis on the middle of the triplet, every direction in reach.
CENTRED_FREE = 1.0
#: Pinhole, axis as near the middle of the triplet as the pan limits allow.
CENTRED_LIMITED = 2.0
#: Pinhole, axis where the ellipse is smallest.
OPTIMAL = 3.0

#: Rounding allowed when a triplet just fits into the field of view, rad (and in its cosine).
FIT_TOLERANCE = 1e-12
# A chosen triplet fits; summed in another order, its angles may differ by rounding.
_CHOSEN_TOLERANCE = 1e-9
#: ``|D|`` below this share of ``ρ1² + ρ2² + ρ3²`` is the danger circle: rounding would decide the result.
DEGENERATE = 1e-9

_TURN = 2.0 * math.pi
# The variance over the pan angle is a trigonometric polynomial whose fastest wave is 0.78 rad long.
_PAN_STEP = 0.1
_GOLDEN = 0.6180339887498949
_GOLDEN_STEPS = 40


@njit(cache=True, nogil=True)
def wrapped(angle):
    """Angle in [-π, π)."""
    out = angle - _TURN * math.floor((angle + math.pi) / _TURN)
    return -math.pi if out >= math.pi else out


@njit(cache=True, nogil=True)
def bearing_variance(off_axis, on_axis, survey):
    """Variance of a pinhole camera's bearing: ``on_axis cos⁴ψ`` plus the survey's share, rad²."""
    c = math.cos(off_axis)
    c *= c
    return on_axis * c * c + survey


@njit(cache=True, nogil=True)
def _pair_sum(axis, b1, b2, b3, s1, s2, s3, on_axis):
    """``v1 v2 + v1 v3 + v2 v3`` with the optical axis at ``axis``; det Σ is this over D²."""
    v1 = bearing_variance(b1 - axis, on_axis, s1)
    v2 = bearing_variance(b2 - axis, on_axis, s2)
    v3 = bearing_variance(b3 - axis, on_axis, s3)
    return v1 * v2 + v3 * (v1 + v2)


@njit(cache=True, nogil=True)
def _best_axis(first, last, b1, b2, b3, s1, s2, s3, on_axis):
    """Axis in [first, last] with the smallest pair sum: scan with both ends, then golden section."""
    steps = max(1, math.ceil((last - first) / _PAN_STEP))
    width = (last - first) / steps
    best = first
    least = _pair_sum(first, b1, b2, b3, s1, s2, s3, on_axis)
    for i in range(1, steps + 1):
        axis = last if i == steps else first + i * width
        value = _pair_sum(axis, b1, b2, b3, s1, s2, s3, on_axis)
        if value < least:
            least = value
            best = axis
    low = max(first, best - width)
    high = min(last, best + width)
    if best in (first, last):
        # Usual: the sum falls towards the end. A dip just inside it would show here.
        near = best + 1e-3 * width if best == first else best - 1e-3 * width
        if _pair_sum(near, b1, b2, b3, s1, s2, s3, on_axis) >= least:
            return best
    c = high - _GOLDEN * (high - low)
    d = low + _GOLDEN * (high - low)
    at_c = _pair_sum(c, b1, b2, b3, s1, s2, s3, on_axis)
    at_d = _pair_sum(d, b1, b2, b3, s1, s2, s3, on_axis)
    for _ in range(_GOLDEN_STEPS):
        if at_c < at_d:
            high = d
            d = c
            at_d = at_c
            c = high - _GOLDEN * (high - low)
            at_c = _pair_sum(c, b1, b2, b3, s1, s2, s3, on_axis)
        else:
            low = c
            c = d
            at_c = at_d
            d = low + _GOLDEN * (high - low)
            at_d = _pair_sum(d, b1, b2, b3, s1, s2, s3, on_axis)
    axis = 0.5 * (low + high)
    return axis if _pair_sum(axis, b1, b2, b3, s1, s2, s3, on_axis) < least else best


@njit(cache=True, nogil=True)
def pan_axis(b1, b2, b3, s1, s2, s3, sensor, tolerance):
    """Optical axis relative to the heading for a triplet at bearings b (rad) with survey shares s (rad²).

    NaN when the triplet does not fit into the field of view or the pan limits by more than ``tolerance``
    (rad). Not wrapped.
    """
    mode = sensor[0]
    half = 0.5 * sensor[2]
    d2 = wrapped(b2 - b1)
    d3 = wrapped(b3 - b1)
    low = b1 + min(0.0, d2, d3)
    high = b1 + max(0.0, d2, d3)
    if high - low > 2.0 * half + tolerance:
        return np.nan
    middle = 0.5 * (low + high)
    if mode == CENTRED_FREE:
        return middle
    first = min(high - half, middle)
    last = max(low + half, middle)
    best = np.nan
    least = np.inf
    for turn in range(-1, 2):
        a = first + turn * _TURN
        b = last + turn * _TURN
        m = middle + turn * _TURN
        if sensor[4] - sensor[3] < _TURN - 1e-9:
            a = max(a, sensor[3])
            b = min(b, sensor[4])
        elif turn != 0:
            continue
        if a > b + tolerance:
            continue
        if a > b:
            a = b
        if mode == OPTIMAL:
            axis = _best_axis(a, b, b1, b2, b3, s1, s2, s3, sensor[1])
            value = _pair_sum(axis, b1, b2, b3, s1, s2, s3, sensor[1])
        else:
            axis = min(max(m, a), b)
            value = abs(axis - m)
        if value < least:
            least = value
            best = axis
    return best


@njit(cache=True, nogil=True)
def triplet_covariance(x1, y1, x2, y2, x3, y3, v1, v2, v3):
    """Σ (xx, xy, yy, m²), variance of the heading (rad²) and D of inverted landmarks with variances v.

    Equation (5) of MAS97, multiplied out: with ``e_i`` the side of the inverted triangle opposite to
    corner i, ``Σ = Σ_i v_i e_i e_iᵀ / D²``; the heading's variance is ``Σ_i v_i λ_i²``, λ the barycentric
    coordinates of the robot. NaN where the triplet is degenerate.
    """
    ax = x3 - x2
    ay = y3 - y2
    bx = x1 - x3
    by = y1 - y3
    cx = x2 - x1
    cy = y2 - y1
    d = cx * (y3 - y1) - cy * (x3 - x1)
    scale = x1 * x1 + y1 * y1 + x2 * x2 + y2 * y2 + x3 * x3 + y3 * y3
    if not abs(d) > DEGENERATE * scale:
        return np.nan, np.nan, np.nan, np.nan, d
    w = 1.0 / (d * d)
    xx = (v1 * ax * ax + v2 * bx * bx + v3 * cx * cx) * w
    xy = (v1 * ax * ay + v2 * bx * by + v3 * cx * cy) * w
    yy = (v1 * ay * ay + v2 * by * by + v3 * cy * cy) * w
    l1 = x2 * y3 - y2 * x3
    l2 = x3 * y1 - y3 * x1
    l3 = x1 * y2 - y1 * x2
    return xx, xy, yy, (v1 * l1 * l1 + v2 * l2 * l2 + v3 * l3 * l3) * w, d


@njit(cache=True, nogil=True)
def triplet_fix(x, y, i, j, k, landmarks, survey, sensor):
    """Fix of the landmarks i, j, k from (x, y): xx, xy, yy, variance of the heading, pan.

    ``landmarks`` (N, 2) in W, m; ``survey`` (N,) variances, m². The one place where a chosen triplet
    becomes a covariance. NaN without a fix; pan is relative to the heading, NaN without a pan head.
    """
    dx1 = landmarks[i, 0] - x
    dy1 = landmarks[i, 1] - y
    dx2 = landmarks[j, 0] - x
    dy2 = landmarks[j, 1] - y
    dx3 = landmarks[k, 0] - x
    dy3 = landmarks[k, 1] - y
    w1 = 1.0 / (dx1 * dx1 + dy1 * dy1)
    w2 = 1.0 / (dx2 * dx2 + dy2 * dy2)
    w3 = 1.0 / (dx3 * dx3 + dy3 * dy3)
    s1 = survey[i] * w1
    s2 = survey[j] * w2
    s3 = survey[k] * w3
    pan = np.nan
    if sensor[0] == OMNIDIRECTIONAL:
        v1 = sensor[1] + s1
        v2 = sensor[1] + s2
        v3 = sensor[1] + s3
    else:
        b1 = wrapped(math.atan2(dy1, dx1) - sensor[5])
        b2 = wrapped(math.atan2(dy2, dx2) - sensor[5])
        b3 = wrapped(math.atan2(dy3, dx3) - sensor[5])
        axis = pan_axis(b1, b2, b3, s1, s2, s3, sensor, _CHOSEN_TOLERANCE)
        if math.isnan(axis):
            return np.nan, np.nan, np.nan, np.nan, np.nan
        v1 = bearing_variance(b1 - axis, sensor[1], s1)
        v2 = bearing_variance(b2 - axis, sensor[1], s2)
        v3 = bearing_variance(b3 - axis, sensor[1], s3)
        pan = wrapped(axis)
    xx, xy, yy, heading, _ = triplet_covariance(
        dx1 * w1, dy1 * w1, dx2 * w2, dy2 * w2, dx3 * w3, dy3 * w3, v1, v2, v3
    )
    if math.isnan(xx):
        pan = np.nan
    return xx, xy, yy, heading, pan


@njit(cache=True, nogil=True)
def information_covariance(inverted, variances):
    """Σ (xx, xy, yy) and variance of the heading from the information of any number of bearings.

    ``inverted`` (n, 2) landmarks, ``variances`` (n,) rad². Sums ``w h hᵀ`` with ``h = [qᵀ, -1]`` about the
    weighted mean of the q; NaN where the information is singular.
    """
    n = inverted.shape[0]
    total = 0.0
    mx = 0.0
    my = 0.0
    for i in range(n):
        w = 1.0 / variances[i]
        total += w
        mx += w * inverted[i, 1]
        my -= w * inverted[i, 0]
    if n < 3:
        return np.nan, np.nan, np.nan, np.nan
    mx /= total
    my /= total
    a = 0.0
    b = 0.0
    c = 0.0
    size = 0.0
    for i in range(n):
        w = 1.0 / variances[i]
        qx = inverted[i, 1] - mx
        qy = -inverted[i, 0] - my
        a += w * qx * qx
        b += w * qx * qy
        c += w * qy * qy
        size += w * (inverted[i, 0] * inverted[i, 0] + inverted[i, 1] * inverted[i, 1])
    det = a * c - b * b
    if not det > (DEGENERATE * size) ** 2:
        return np.nan, np.nan, np.nan, np.nan
    xx = c / det
    xy = -b / det
    yy = a / det
    # θ = q̄ᵀp minus the mean innovation, and the two are independent.
    heading = 1.0 / total + mx * mx * xx + 2.0 * mx * my * xy + my * my * yy
    return xx, xy, yy, heading
