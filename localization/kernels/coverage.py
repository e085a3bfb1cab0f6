"""Share of the exact fixes of a triplet that lie inside the predicted 95 % ellipse (MAS97 §5.2, MATH §6).

Call ``predicted_share(dx1, dy1, dx2, dy2, dx3, dy3, v1, v2, v3, axis, column_variance)`` for the triplet that
``triplet_fix`` was given: landmarks from the sensor (W, m), total variances of their bearings (rad²: noise,
survey, floor), azimuth of the optical axis in W (rad) and variance of a bearing on it (σ_u²/f², rad²; 0 for
a sensor that measures bearings, then ``axis`` does not matter). The answer is a share from 0 to 1, 0.95 where
first order holds, NaN where there is no fix. ``is_valid(share)`` compares it with the limits below.

Three bearings are seen from at most one place, so a fix lies in the ellipse E exactly when the measurement
is one that a point of E would give: the share is the probability of the image of E under the *forward* map,
without triangulation or search. With ``a_i`` the turn of bearing i when the sensor moves by e,

    ζ1 = (a1 - a2) / √(v1 + v2),   ζ2 = (a3 - (v2 a1 + v1 a2) / (v1 + v2)) / √(v3 + v1 v2 / (v1 + v2))

are independent standard normal under the noise, free of the heading, and ``ζ = K e`` to first order, so that
the edge of E is ``e = k K⁻¹ (cos τ, sin τ)``. Green's theorem turns the probability into an integral over it,

    share = 1 - 1/2π ∮ exp(-ζ²/2) (ζ × ζ') / ζ² dτ,

smooth and periodic: means over 8, 16, 32, 64 points converge geometrically; most places need 8. Where E
reaches a landmark or the danger circle, where the map folds, rays from the true measurement are followed
instead, and each point on them is triangulated.

A camera's noise is Gaussian in columns: there ``a_i = T / (1 - T tan ψ_i)``, T the tangent of the turn, is
the change of the column, as a bearing. It needs the heading, for which the most likely one is taken. Only
the columns' part of the variance bends so; survey errors and floors count as noise of bearings.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import DEGENERATE
from localization.kernels.trigonometry import arc_tangent, sine_cosine

#: Share of a Gaussian inside its 95 % ellipse, and how far a predicted share may be from it in a valid cell:
#: 2 % less 4.5 standard deviations of a share of 10 000 fixes and less the error of the prediction.
NOMINAL_SHARE = 0.95
VALID_TOLERANCE = 0.008

_K2 = -2.0 * math.log(1.0 - NOMINAL_SHARE)
_K = math.sqrt(_K2)
# Where terms of second order move ζ by less, the share moves by less than 1e-3.
_NEGLIGIBLE = 0.05
# Directions: 8, 8, 16 and 32 of them, each ring between those before it.
_RINGS = [i / 8 for i in range(8)] + [(2 * i + 1) / n for n in (16, 32, 64) for i in range(n // 2)]
_COS = np.cos(2.0 * np.pi * np.array(_RINGS))
_SIN = np.sin(2.0 * np.pi * np.array(_RINGS))
_FIRST_RING = 8
_LAST_RING = 64
# The sum ends when ζ² is nowhere further from k² than this share of it, or when the last ring changed it by
# less than this, or this share of its distance from 0.05, and the image winds round once to three times that.
_MILD = 0.25
_CONVERGED = 1e-3
_COARSE = 0.05
# Error of the winding number that no further ring will mend.
_HOPELESS = 0.1
# Rays, points on each and their distance in standard deviations.
_RAYS = 32
_NODES = 16
_NODE_STEP = 0.25
# Where the quantities of the rays begin in their scratch array: turns of a step, their sines and cosines,
# directions of the landmarks, distances at the last two points.
_A1, _A2, _A3, _S1, _S2, _S3, _C1, _C2, _C3 = (row * _RAYS for row in range(9))
_X1, _Y1, _X2, _Y2, _X3, _Y3, _BEFORE, _DISTANCE = (row * _RAYS for row in range(9, 17))
_SCRATCH = 17 * _RAYS


@njit(cache=True, nogil=True)
def is_valid(share):
    """Whether a predicted share says that the 95 % ellipse can be believed; False for NaN."""
    return abs(share - NOMINAL_SHARE) <= VALID_TOLERANCE


@njit(cache=True, nogil=True, error_model="numpy")
def predicted_share(dx1, dy1, dx2, dy2, dx3, dy3, v1, v2, v3, axis, column_variance):
    """Share, 0 to 1, of exact fixes in the first-order 95 % ellipse; see the head of this module."""
    r1 = dx1 * dx1 + dy1 * dy1
    r2 = dx2 * dx2 + dy2 * dy2
    r3 = dx3 * dx3 + dy3 * dy3
    # So written that NaN fails, too.
    if not ((r1 > 0.0) & (r2 > 0.0) & (r3 > 0.0) & (v1 > 0.0) & (v2 > 0.0) & (v3 > 0.0)):
        return np.nan
    w1 = 1.0 / r1
    w2 = 1.0 / r2
    w3 = 1.0 / r3
    qx1 = dy1 * w1
    qy1 = -dx1 * w1
    qx2 = dy2 * w2
    qy2 = -dx2 * w2
    qx3 = dy3 * w3
    qy3 = -dx3 * w3
    D = (qx2 - qx1) * (qy3 - qy1) - (qy2 - qy1) * (qx3 - qx1)
    if not abs(D) > DEGENERATE * (w1 + w2 + w3):
        return np.nan
    pinhole = column_variance > 0.0
    t1 = 0.0
    t2 = 0.0
    t3 = 0.0
    if pinhole:
        c = math.cos(axis)
        s = math.sin(axis)
        t1 = _bend(dx1, dy1, w1, c, s, v1, column_variance)
        t2 = _bend(dx2, dy2, w2, c, s, v2, column_variance)
        t3 = _bend(dx3, dy3, w3, c, s, v3, column_variance)
    both = 1.0 / (v1 + v2)
    l1 = v2 * both
    l2 = v1 * both
    n12 = math.sqrt(both)
    n3 = 1.0 / math.sqrt(v3 + v1 * l1)
    xx = (qx1 - qx2) * n12
    xy = (qy1 - qy2) * n12
    yx = (qx3 - l1 * qx1 - l2 * qx2) * n3
    yy = (qy3 - l1 * qy1 - l2 * qy2) * n3
    size2 = xx * xx + xy * xy + yx * yx + yy * yy
    det = xx * yy - xy * yx
    # Squared semi-major axis, at most.
    long2 = _K2 * size2 / (det * det)
    b1 = (0.5 + abs(t1)) * w1
    b2 = (0.5 + abs(t2)) * w2
    b3 = (0.5 + abs(t3)) * w3
    m1 = (b1 + b2) * n12
    m2 = (b3 + l1 * b1 + l2 * b2) * n3
    if long2 * long2 * (m1 * m1 + m2 * m2) < _NEGLIGIBLE * _NEGLIGIBLE:
        return NOMINAL_SHARE
    free = (
        _is_outside(dx1, dy1, xx, xy, yx, yy)
        & _is_outside(dx2, dy2, xx, xy, yx, yy)
        & _is_outside(dx3, dy3, xx, xy, yx, yy)
    )
    p3 = v1 * v2 / (v1 * v2 + v3 * (v1 + v2))
    if free:
        share = _share_by_edge(
            dx1, dy1, dx2, dy2, dx3, dy3, t1, t2, t3, l1, l2, p3, n12, n3, xx, xy, yx, yy, pinhole
        )
        if share >= 0.0:
            return share
    return _share_by_rays(
        dx1, dy1, dx2, dy2, dx3, dy3, t1, t2, t3, l1, l2, p3, n12, n3, xx, xy, yx, yy, pinhole
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _share_by_edge(dx1, dy1, dx2, dy2, dx3, dy3, t1, t2, t3, l1, l2, p3, n12, n3, xx, xy, yx, yy, pinhole):
    """Share from the image of the ellipse's edge; -1 where the map folds or the sum does not converge.

    Points of a ring come first, without branches, so that the loop becomes vector instructions.
    """
    det = xx * yy - xy * yx
    # Columns of k K⁻¹.
    ax = _K * yy / det
    ay = -_K * yx / det
    bx = -_K * xy / det
    by = _K * xx / det
    p1 = l1 * (1.0 - p3)
    p2 = l2 * (1.0 - p3)
    work = np.empty(2 * _LAST_RING)
    lost = 0.0
    wound = 0.0
    before = np.inf
    worst = 0.0
    first = 0
    last = _FIRST_RING
    while last <= _LAST_RING:
        for i in range(first, last):
            c = _COS[i]
            s = _SIN[i]
            z1, z2, jxx, jxy, jyx, jyy, seen = _image(
                ax * c + bx * s, ay * c + by * s,
                dx1, dy1, dx2, dy2, dx3, dy3, t1, t2, t3, p1, p2, p3, l1, l2, n12, n3, pinhole,
            )  # fmt: skip
            ux = bx * c - ax * s
            uy = by * c - ay * s
            zz = z1 * z1 + z2 * z2
            turn = (z1 * (jyx * ux + jyy * uy) - z2 * (jxx * ux + jxy * uy)) / zz
            work[i] = zz
            work[_LAST_RING + i] = turn if seen & ((jxx * jyy - jxy * jyx) * det > 0.0) else np.inf
        for i in range(first, last):
            zz = work[i]
            turn = work[_LAST_RING + i]
            if turn == np.inf:
                return -1.0
            worst = max(worst, abs(zz - _K2))
            wound += turn
            lost += math.exp(-0.5 * zz) * turn
        mean = lost / last
        wrong = abs(wound / last - 1.0)
        # The further from the nominal share, the less its digits matter.
        enough = max(_CONVERGED, _COARSE * abs(mean - (1.0 - NOMINAL_SHARE)))
        if ((abs(mean - before) <= enough) & (wrong <= 3.0 * enough)) | (worst <= _MILD * _K2):
            return min(1.0, max(0.0, 1.0 - mean))
        if (wrong > _HOPELESS) & (last > _FIRST_RING):
            return -1.0
        before = mean
        first = last
        last *= 2
    return -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _share_by_rays(dx1, dy1, dx2, dy2, dx3, dy3, t1, t2, t3, l1, l2, p3, n12, n3, xx, xy, yx, yy, pinhole):
    """Share from fixes along rays in the plane of ζ; a measurement without a pose is outside.

    All rays take a step together, without branches, so that the loop becomes vector instructions.
    """
    work = np.empty(_SCRATCH)
    for i in range(_RAYS):
        # Most likely noise for a step along the ray: its weighted mean is zero.
        u12 = _NODE_STEP * _COS[i] / n12
        u3 = _NODE_STEP * _SIN[i] / n3
        work[_A1 + i] = l2 * u12 - p3 * u3
        work[_A2 + i] = -l1 * u12 - p3 * u3
        work[_A3 + i] = u3 - p3 * u3
        work[_BEFORE + i] = 0.0
    if not pinhole:
        for i in range(_RAYS):
            work[_S1 + i], work[_C1 + i] = sine_cosine(work[_A1 + i])
            work[_S2 + i], work[_C2 + i] = sine_cosine(work[_A2 + i])
            work[_S3 + i], work[_C3 + i] = sine_cosine(work[_A3 + i])
            work[_X1 + i] = dx1
            work[_Y1 + i] = dy1
            work[_X2 + i] = dx2
            work[_Y2 + i] = dy2
            work[_X3 + i] = dx3
            work[_Y3 + i] = dy3
    total = 0.0
    for j in range(1, _NODES + 1):
        if pinhole:
            for i in range(_RAYS):
                work[_X1 + i], work[_Y1 + i] = _shifted(dx1, dy1, j * work[_A1 + i], t1)
                work[_X2 + i], work[_Y2 + i] = _shifted(dx2, dy2, j * work[_A2 + i], t2)
                work[_X3 + i], work[_Y3 + i] = _shifted(dx3, dy3, j * work[_A3 + i], t3)
        else:
            for i in range(_RAYS):
                _rotate(work, i, _X1, _Y1, _S1, _C1)
                _rotate(work, i, _X2, _Y2, _S2, _C2)
                _rotate(work, i, _X3, _Y3, _S3, _C3)
        for i in range(_RAYS):
            ex, ey, found = _fix(
                work[_X1 + i], work[_Y1 + i], work[_X2 + i], work[_Y2 + i], work[_X3 + i], work[_Y3 + i],
                dx1 - dx2, dy1 - dy2, dx3 - dx2, dy3 - dy2,
            )  # fmt: skip
            ex += dx2
            ey += dy2
            u = xx * ex + xy * ey
            v = yx * ex + yy * ey
            work[_DISTANCE + i] = math.sqrt(u * u + v * v) if found else np.inf
        for i in range(_RAYS):
            before = work[_BEFORE + i]
            distance = work[_DISTANCE + i]
            if distance == np.inf:
                # Where fixes end, the edge counts as half-way.
                distance = max(2.0 * _K - before, 1.001 * _K)
            if (distance > _K) != (before > _K):
                edge = _NODE_STEP * (j - (distance - _K) / (distance - before))
                total += math.copysign(1.0 - math.exp(-0.5 * edge * edge), distance - _K)
            work[_BEFORE + i] = distance
    for i in range(_RAYS):
        total += 1.0 if work[_BEFORE + i] <= _K else 0.0
    return min(1.0, max(0.0, total / _RAYS))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _rotate(work, i, at_x, at_y, at_sine, at_cosine):
    """Turn direction i by one step."""
    x = work[at_x + i]
    y = work[at_y + i]
    s = work[at_sine + i]
    c = work[at_cosine + i]
    work[at_x + i] = c * x - s * y
    work[at_y + i] = c * y + s * x


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _image(ex, ey, dx1, dy1, dx2, dy2, dx3, dy3, t1, t2, t3, p1, p2, p3, l1, l2, n12, n3, pinhole):
    """ζ (2), ∂ζ/∂e (2 × 2) for a sensor moved by e, and whether all three can be seen."""
    a1, f1, gx1, gy1, T1, seen1 = _turn(dx1, dy1, ex, ey, t1, pinhole)
    a2, f2, gx2, gy2, T2, seen2 = _turn(dx2, dy2, ex, ey, t2, pinhole)
    a3, f3, gx3, gy3, T3, seen3 = _turn(dx3, dy3, ex, ey, t3, pinhole)
    seen = seen1 & seen2 & seen3
    if pinhole:
        # The heading that makes the weighted mean of the a vanish, but for terms of higher order.
        s = -(p1 * a1 + p2 * a2 + p3 * a3)
        f = -1.0 / (1.0 + s * s)
        wx = f * (p1 * f1 * gx1 + p2 * f2 * gx2 + p3 * f3 * gx3)
        wy = f * (p1 * f1 * gy1 + p2 * f2 * gy2 + p3 * f3 * gy3)
        a1, f1, seen1 = _turned(T1, s, t1)
        a2, f2, seen2 = _turned(T2, s, t2)
        a3, f3, seen3 = _turned(T3, s, t3)
        seen = seen & seen1 & seen2 & seen3
        gx1 = f1 * (gx1 + wx)
        gy1 = f1 * (gy1 + wy)
        gx2 = f2 * (gx2 + wx)
        gy2 = f2 * (gy2 + wy)
        gx3 = f3 * (gx3 + wx)
        gy3 = f3 * (gy3 + wy)
    z1 = (a1 - a2) * n12
    z2 = (a3 - l1 * a1 - l2 * a2) * n3
    xx = (gx1 - gx2) * n12
    xy = (gy1 - gy2) * n12
    yx = (gx3 - l1 * gx1 - l2 * gx2) * n3
    yy = (gy3 - l1 * gy1 - l2 * gy2) * n3
    return z1, z2, xx, xy, yx, yy, seen


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turn(dx, dy, ex, ey, t, pinhole):
    """Turn δ of a landmark's azimuth as a, da/dδ, gradient of δ (2), tan δ, and whether it can be seen."""
    fx = dx - ex
    fy = dy - ey
    inverse = 1.0 / (fx * fx + fy * fy)
    across = dx * fy - dy * fx
    along = dx * fx + dy * fy
    T = across / (along if along != 0.0 else 1.0)
    if pinhole:
        c = 1.0 / (1.0 - t * T)
        return T * c, (1.0 + T * T) * c * c, fy * inverse, -fx * inverse, T, (along > 0.0) & (c > 0.0)
    a = arc_tangent(across, along)
    return a, 1.0, fy * inverse, -fx * inverse, T, True


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turned(T, s, t):
    """a and da/dδ after a further turn by the angle with tangent s, and whether it can be seen."""
    c = 1.0 / (1.0 - s * T)
    R = (T + s) * c
    b = 1.0 / (1.0 - t * R)
    return R * b, (1.0 + R * R) * b * b, (c > 0.0) & (b > 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _shifted(dx, dy, a, t):
    """Direction, of any length, of a landmark whose column is off by a, as a bearing."""
    # (dx, dy) + tan δ (-dy, dx), tan δ = a / (1 + t a).
    c = 1.0 + t * a
    return c * dx - a * dy, c * dy + a * dx


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fix(ux1, uy1, ux2, uy2, ux3, uy3, ax, ay, bx, by):
    """Place (2) from landmark 2 that sees the landmarks in directions u, and whether there is one.

    ``a`` and ``b`` are landmarks 1 and 3 from landmark 2; see ``kernels.triangulation``.
    """
    s1 = ux1 * uy2 - uy1 * ux2
    c1 = ux1 * ux2 + uy1 * uy2
    s3 = ux3 * uy2 - uy3 * ux2
    c3 = ux3 * ux2 + uy3 * uy2
    Ax = s1 * ax + c1 * ay
    Ay = s1 * ay - c1 * ax
    Bx = s3 * bx + c3 * by
    By = s3 * by - c3 * bx
    D = Ax * By - Ay * Bx
    Nx = s1 * By - s3 * Ay
    Ny = s3 * Ax - s1 * Bx
    G1 = Nx * Ay - Ny * Ax + c1 * D
    G3 = Nx * By - Ny * Bx + c3 * D
    NN = Nx * Nx + Ny * Ny
    f = D / (NN if NN > 0.0 else 1.0)
    return f * Nx, f * Ny, (D * G1 > 0.0) & (D * G3 > 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _is_outside(dx, dy, xx, xy, yx, yy):
    """Whether a landmark lies outside the ellipse."""
    u = xx * dx + xy * dy
    v = yx * dx + yy * dy
    return u * u + v * v > _K2


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _bend(dx, dy, w, c, s, v, column_variance):
    """tan ψ of a landmark, reduced to the columns' part of the bearing's variance."""
    x = c * dx + s * dy
    y = c * dy - s * dx
    cc = x * x * w
    part = column_variance * cc * cc / v
    return y / x * part * part
