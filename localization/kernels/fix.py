"""First-order covariance of a fix, in inverted landmarks (MATH §2 and §3).

Landmark ``i`` at ``d_i`` from the robot is inverted in the unit circle: ``g_i = d_i / r_i²``. The bearing's
gradient ``q_i`` is ``g_i`` turned by -90°, so the triangle of the ``g_i`` has the area of the triangle of
the ``q_i``. ``D`` is twice that area, signed. ``v_i`` is the variance of bearing ``i``, rad².

``sensor`` (13 + 2 S,), positions named below: mode, bearing variance on the optical axis (rad²), field of
view, pan_min, pan_max, heading of the sensor (rad), cosine of the field of view (-2 where three landmarks in
reach are always seen together), floor of the bearing variance (rad²), criterion, length of the lever arm from
the robot's centre to the sensor (m), its change per radian of heading (x, y in W, m), number S of muted
sectors and, for each, where it begins and how wide it is (rad, from the sensor's heading, counter-clockwise).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MODE, ON_AXIS, VIEW, PAN_MIN, PAN_MAX, HEADING, COS_VIEW, FLOOR, CRITERION = range(9)
LEVER, LEVER_X, LEVER_Y, N_MUTED, MUTED = range(9, 14)

#: Constant bearing variance, all around.
OMNIDIRECTIONAL = 0.0
#: Pinhole, axis on the middle of the triplet, every direction in reach.
CENTRED_FREE = 1.0
#: Pinhole, axis as near the middle of the triplet as the pan limits allow.
CENTRED_LIMITED = 2.0
#: Pinhole, axis where the ellipse is smallest.
OPTIMAL = 3.0
#: Pinhole that cannot turn: axis along the sensor's heading.
FIXED = 4.0

#: Criteria: area of the ellipse (D-optimal), its major axis (E-optimal), sum of variances (A-optimal).
AREA = 0.0
MAX_AXIS = 1.0
TRACE = 2.0

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
    mode = sensor[MODE]
    half = 0.5 * sensor[VIEW]
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
        if sensor[PAN_MAX] - sensor[PAN_MIN] < _TURN - 1e-9:
            a = max(a, sensor[PAN_MIN])
            b = min(b, sensor[PAN_MAX])
        elif turn != 0:
            continue
        if a > b + tolerance:
            continue
        if a > b:
            a = b
        if mode == OPTIMAL:
            axis = _best_axis(a, b, b1, b2, b3, s1, s2, s3, sensor[ON_AXIS])
            value = _pair_sum(axis, b1, b2, b3, s1, s2, s3, sensor[ON_AXIS])
        else:
            axis = min(max(m, a), b)
            value = abs(axis - m)
        if value < least:
            least = value
            best = axis
    return best


@njit(cache=True, nogil=True)
def sides_and_weights(x1, y1, x2, y2, x3, y3, bx, by):
    """How a fix answers to errors of its bearings: position (3 × 2 numbers) and heading (3), times D, and D.

    With ``e_i`` the side of the inverted triangle opposite to corner i and ``l_i`` twice the area that the
    origin spans with it, bearing errors n move the sensor by ``Σ n_i e_i / D`` and turn it by
    ``-Σ n_i l_i / D``; the robot, a lever arm with change ``b`` per radian behind it, moves by
    ``Σ n_i (e_i + l_i b) / D``.
    """
    d = (x2 - x1) * (y3 - y1) - (y2 - y1) * (x3 - x1)
    l1 = x2 * y3 - y2 * x3
    l2 = x3 * y1 - y3 * x1
    l3 = x1 * y2 - y1 * x2
    ax = x3 - x2 + l1 * bx
    ay = y3 - y2 + l1 * by
    cx = x1 - x3 + l2 * bx
    cy = y1 - y3 + l2 * by
    ex = x2 - x1 + l3 * bx
    ey = y2 - y1 + l3 * by
    return ax, ay, cx, cy, ex, ey, l1, l2, l3, d


@njit(cache=True, nogil=True)
def triplet_covariance(x1, y1, x2, y2, x3, y3, v1, v2, v3, bx, by):
    """Σ (xx, xy, yy, m²), variance of the heading (rad²) and D of inverted landmarks with variances v.

    Equation (5) of MAS97, multiplied out: ``Σ = Σ_i v_i e_i e_iᵀ / D²``; the heading's variance is
    ``Σ_i v_i l_i² / D²``. ``(bx, by)`` is the lever arm's change per radian. NaN where degenerate.
    """
    ax, ay, cx, cy, ex, ey, l1, l2, l3, d = sides_and_weights(x1, y1, x2, y2, x3, y3, bx, by)
    scale = x1 * x1 + y1 * y1 + x2 * x2 + y2 * y2 + x3 * x3 + y3 * y3
    if not abs(d) > DEGENERATE * scale:
        return np.nan, np.nan, np.nan, np.nan, d
    w = 1.0 / (d * d)
    xx = (v1 * ax * ax + v2 * cx * cx + v3 * ex * ex) * w
    xy = (v1 * ax * ay + v2 * cx * cy + v3 * ex * ey) * w
    yy = (v1 * ay * ay + v2 * cy * cy + v3 * ey * ey) * w
    return xx, xy, yy, (v1 * l1 * l1 + v2 * l2 * l2 + v3 * l3 * l3) * w, d


@njit(cache=True, nogil=True)
def fixed_variance(dx, dy, r2, share, sensor):
    """Variance of a fixed camera's bearing along (dx, dy), ``share`` added; NaN outside the view."""
    forward = dx * math.cos(sensor[HEADING]) + dy * math.sin(sensor[HEADING])
    if forward < 0.0 or forward < (math.cos(0.5 * sensor[VIEW]) - FIT_TOLERANCE) * math.sqrt(r2):
        return np.nan
    c = forward * forward / r2
    return sensor[ON_AXIS] * c * c + share


@njit(cache=True, nogil=True)
def is_muted(dx, dy, sensor):
    """Whether (dx, dy) lies in a muted sector, borders included."""
    for k in range(int(sensor[N_MUTED])):
        off = math.atan2(dy, dx) - sensor[HEADING] - sensor[MUTED + 2 * k]
        off -= _TURN * math.floor(off / _TURN)
        if off <= sensor[MUTED + 2 * k + 1] + FIT_TOLERANCE or off >= _TURN - FIT_TOLERANCE:
            return True
    return False


@njit(cache=True, nogil=True)
def triplet_fix(x, y, i, j, k, landmarks, survey, sensor):
    """Fix of the landmarks i, j, k with the sensor at (x, y): xx, xy, yy, variance of the heading, pan.

    ``landmarks`` (N, 2) in W, m; ``survey`` (N,) variances, m². The one place where a chosen triplet
    becomes a covariance: that of the robot's centre. NaN without a fix; pan is relative to the sensor's
    heading, NaN without a pan head. Muted sectors are not looked at.
    """
    dx1 = landmarks[i, 0] - x
    dy1 = landmarks[i, 1] - y
    dx2 = landmarks[j, 0] - x
    dy2 = landmarks[j, 1] - y
    dx3 = landmarks[k, 0] - x
    dy3 = landmarks[k, 1] - y
    r1 = dx1 * dx1 + dy1 * dy1
    r2 = dx2 * dx2 + dy2 * dy2
    r3 = dx3 * dx3 + dy3 * dy3
    w1 = 1.0 / r1
    w2 = 1.0 / r2
    w3 = 1.0 / r3
    s1 = survey[i] * w1 + sensor[FLOOR]
    s2 = survey[j] * w2 + sensor[FLOOR]
    s3 = survey[k] * w3 + sensor[FLOOR]
    pan = np.nan
    if sensor[MODE] == OMNIDIRECTIONAL:
        v1 = sensor[ON_AXIS] + s1
        v2 = sensor[ON_AXIS] + s2
        v3 = sensor[ON_AXIS] + s3
    elif sensor[MODE] == FIXED:
        v1 = fixed_variance(dx1, dy1, r1, s1, sensor)
        v2 = fixed_variance(dx2, dy2, r2, s2, sensor)
        v3 = fixed_variance(dx3, dy3, r3, s3, sensor)
        if math.isnan(v1 + v2 + v3):
            return np.nan, np.nan, np.nan, np.nan, np.nan
    else:
        b1 = wrapped(math.atan2(dy1, dx1) - sensor[HEADING])
        b2 = wrapped(math.atan2(dy2, dx2) - sensor[HEADING])
        b3 = wrapped(math.atan2(dy3, dx3) - sensor[HEADING])
        axis = pan_axis(b1, b2, b3, s1, s2, s3, sensor, _CHOSEN_TOLERANCE)
        if math.isnan(axis):
            return np.nan, np.nan, np.nan, np.nan, np.nan
        v1 = bearing_variance(b1 - axis, sensor[ON_AXIS], s1)
        v2 = bearing_variance(b2 - axis, sensor[ON_AXIS], s2)
        v3 = bearing_variance(b3 - axis, sensor[ON_AXIS], s3)
        pan = wrapped(axis)
    xx, xy, yy, heading, _ = triplet_covariance(
        dx1 * w1,
        dy1 * w1,
        dx2 * w2,
        dy2 * w2,
        dx3 * w3,
        dy3 * w3,
        v1,
        v2,
        v3,
        sensor[LEVER_X],
        sensor[LEVER_Y],
    )
    if math.isnan(xx):
        pan = np.nan
    return xx, xy, yy, heading, pan


@njit(cache=True, nogil=True)
def information_covariance(inverted, variances, bx, by):
    """Σ (xx, xy, yy) and variance of the heading from the information of any number of bearings.

    ``inverted`` (n, 2) landmarks, ``variances`` (n,) rad²; ``(bx, by)``: lever arm's change per radian. Sums
    ``w h hᵀ`` with ``h = [qᵀ, -1]`` about the weighted mean of the q; NaN where the information is singular.
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
    # a c - b² by what one column keeps beside the other: nearly collinear q would lose all digits.
    rest = 0.0
    for i in range(n):
        w = 1.0 / variances[i]
        qx = inverted[i, 1] - mx
        qy = -inverted[i, 0] - my
        off = qy - b / a * qx if a > c else (qx - b / c * qy if c > 0.0 else 0.0)
        rest += w * off * off
    det = rest * max(a, c)
    if not det > (DEGENERATE * size) ** 2:
        return np.nan, np.nan, np.nan, np.nan
    xx = c / det
    xy = -b / det
    yy = a / det
    # θ = q̄ᵀp minus the mean innovation, and the two are independent.
    px = xx * mx + xy * my
    py = xy * mx + yy * my
    heading = 1.0 / total + mx * px + my * py
    # Position of the robot: p - b θ, with cov(p, θ) = Σ q̄.
    xx += bx * (bx * heading - 2.0 * px)
    xy += bx * by * heading - bx * py - by * px
    yy += by * (by * heading - 2.0 * py)
    return xx, xy, yy, heading
