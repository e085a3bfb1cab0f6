"""Pose and covariance from three bearings or image columns, in closed form and in batches.

Landmark 2 is the origin: ``a = m1 - m2``, ``b = m3 - m2``, ``q = p - m2``. Let α lead from bearing 1 to
bearing 2, γ from 3 to 2. The robot lies on a circle through landmarks 1 and 2 and on one through 3 and 2;
inversion ``w = q / |q|²`` turns them into the lines ``A·w = sin α``, ``B·w = sin γ`` with

    A = (sin α a_x + cos α a_y, sin α a_y - cos α a_x),   B alike with γ and b.

With ``D = A × B`` and ``N = (sin α B_y - sin γ A_y, sin γ A_x - sin α B_x)``: ``q = D N / |N|²``. There is no
cotangent, hence no case apart when landmarks line up with the robot, and a common factor of sine and cosine
cancels, so image columns need no trigonometry. ``N = 0`` is the danger circle; ``|N|`` over its bound
``|sin α| |b| + |sin γ| |a|`` is the reliability, 0 to 1. With ``G1 = N × A + cos α D`` and
``G3 = N × B + cos γ D`` the product of the ranges to landmarks 1 and 2 is ``D G1 / |N|²``: it is negative
when the bearings agree with the place only modulo π, and no pose exists. Differentiating the same lines,

    ∂q/∂α = G1/|N|² R (B_y, -B_x),  ∂q/∂γ = G3/|N|² R (-A_y, A_x),  R = I - 2 N Nᵀ/|N|²,

and the azimuth of landmark 2 turns by ``-G1 sin γ/|N|²`` per α and by ``G3 sin α/|N|²`` per γ.

Work is done in blocks of a scratch array, without branches, so that it becomes vector instructions. Names
like ``_AX`` say where in it a quantity begins: constants, from which the compiler sees that nothing overlaps.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.trigonometry import MAX_ANGLE, arc_tangent, sine_cosine, wrap_angle

# Floats, as everything in a block: mixed types would keep the loops from becoming vector code.
OK = 0.0
DEGENERATE = 1.0
NO_POSE = 2.0
NOT_FINITE = 3.0
OUTSIDE_IMAGE = 4.0

#: Beyond it, m or px, products could overflow; no map and no image is that large.
MAX_COORDINATE = 1e12
#: Landmarks nearer to each other, or robot nearer to a landmark, than this share of the triangle's size.
COINCIDENT = 1e-9

_BLOCK = 128
# Where the quantities of a block begin in its scratch array: bearings or columns, a, b, landmark 2, …;
# _TURNED is the bearing of landmark 2 from the robot's front, _BEFORE the status apart from the geometry.
_M1, _M2, _M3, _AX, _AY, _BX, _BY, _X2, _Y2 = (row * _BLOCK for row in range(9))
_V1, _V2, _V3, _PAN, _S1, _C1, _S3, _C3, _TURNED, _BEFORE = (row * _BLOCK for row in range(9, 19))
_X, _Y, _HEADING, _RELIABILITY, _STATUS = (row * _BLOCK for row in range(19, 24))
_XX, _XY, _XT, _YY, _YT, _TT = (row * _BLOCK for row in range(24, 30))
_SCRATCH = 30 * _BLOCK


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _solve(s1, c1, s3, c3, ax, ay, bx, by, min_reliability):
    """q, N, 1/|N|², A, B, N × A, N × B, G1, G3, reliability and status of one fix."""
    Ax = s1 * ax + c1 * ay
    Ay = s1 * ay - c1 * ax
    Bx = s3 * bx + c3 * by
    By = s3 * by - c3 * bx
    D = Ax * By - Ay * Bx
    Nx = s1 * By - s3 * Ay
    Ny = s3 * Ax - s1 * Bx
    NN = Nx * Nx + Ny * Ny
    bound = abs(s1) * math.sqrt(Bx * Bx + By * By) + abs(s3) * math.sqrt(Ax * Ax + Ay * Ay)
    reliability = math.sqrt(NN) / (bound if bound > 0.0 else 1.0)
    # Rounding, and squares that vanish in tiny triangles.
    reliability = 1.0 if reliability > 1.0 else reliability
    Ha = Nx * Ay - Ny * Ax
    Hb = Nx * By - Ny * Bx
    G1 = Ha + c1 * D
    G3 = Hb + c3 * D
    aa = ax * ax + ay * ay
    bb = bx * bx + by * by
    ex = ax - bx
    ey = ay - by
    least = COINCIDENT * COINCIDENT * (aa + bb)
    near = COINCIDENT * abs(D)
    lined = (s1 * s1 + s3 * s3) <= COINCIDENT * COINCIDENT * (c1 * c1 + c3 * c3)
    merged = (aa <= least) | (bb <= least) | (ex * ex + ey * ey <= least)
    touching = (least * NN >= D * D) | (abs(G1) <= near) | (abs(G3) <= near)
    flat = (reliability <= min_reliability) | (NN <= 0.0) | lined | merged | touching
    status = NO_POSE if (D * G1 <= 0.0) | (D * G3 <= 0.0) else OK
    status = DEGENERATE if flat else status
    # Landmarks at one place, or the robot at one, make no fix, however well the lines cross.
    reliability = 0.0 if lined | merged | touching else reliability
    inverse = 1.0 / (1.0 if flat else NN)
    f = D * inverse
    return f * Nx, f * Ny, Nx, Ny, inverse, Ax, Ay, Bx, By, Ha, Hb, G1, G3, reliability, status


@njit(cache=True, nogil=True, error_model="numpy")
def _angles_of_bearings(work, k):
    """Sines, cosines, bearing of landmark 2 and first status of k fixes, from bearings, rad."""
    for i in range(k):
        b1 = work[_M1 + i]
        b2 = work[_M2 + i]
        b3 = work[_M3 + i]
        fine = (abs(b1) <= MAX_ANGLE) & (abs(b2) <= MAX_ANGLE) & (abs(b3) <= MAX_ANGLE)
        b1 = b1 if fine else 0.0
        b2 = b2 if fine else 0.0
        b3 = b3 if fine else 0.0
        s, c = sine_cosine(b2 - b1)
        work[_S1 + i] = s
        work[_C1 + i] = c
        s, c = sine_cosine(b2 - b3)
        work[_S3 + i] = s
        work[_C3 + i] = c
        work[_TURNED + i] = b2
        work[_BEFORE + i] = OK if fine else NOT_FINITE


@njit(cache=True, nogil=True, error_model="numpy")
def _angles_of_columns(work, k, focal, principal, width):
    """The same, and variances, from image columns, px; columns grow clockwise."""
    for i in range(k):
        u1 = work[_M1 + i]
        u2 = work[_M2 + i]
        u3 = work[_M3 + i]
        pan = work[_PAN + i]
        fine = (abs(u1) <= MAX_COORDINATE) & (abs(u2) <= MAX_COORDINATE) & (abs(u3) <= MAX_COORDINATE)
        fine = fine & (abs(pan) <= MAX_ANGLE)
        inside = (u1 >= 0.0) & (u2 >= 0.0) & (u3 >= 0.0) & (u1 <= width) & (u2 <= width) & (u3 <= width)
        # An unlimited image has columns on both sides of zero.
        inside = inside | (width == np.inf)
        u1 = u1 if fine & inside else principal
        u2 = u2 if fine & inside else principal
        u3 = u3 if fine & inside else principal
        t1 = (principal - u1) / focal
        t2 = (principal - u2) / focal
        t3 = (principal - u3) / focal
        work[_S1 + i] = t2 - t1
        work[_C1 + i] = 1.0 + t1 * t2
        work[_S3 + i] = t2 - t3
        work[_C3 + i] = 1.0 + t2 * t3
        work[_TURNED + i] = arc_tangent(t2, 1.0) + (pan if fine else 0.0)
        status = OK if inside else OUTSIDE_IMAGE
        work[_BEFORE + i] = status if fine else NOT_FINITE
        # dψ = cos²ψ du / f.
        q1 = 1.0 / (1.0 + t1 * t1)
        q2 = 1.0 / (1.0 + t2 * t2)
        q3 = 1.0 / (1.0 + t3 * t3)
        work[_V1 + i] *= q1 * q1
        work[_V2 + i] *= q2 * q2
        work[_V3 + i] *= q3 * q3


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _landmarks_of(work, i):
    """a, b, m2 of fix i and whether they are finite; zeros when not."""
    ax = work[_AX + i]
    ay = work[_AY + i]
    bx = work[_BX + i]
    by = work[_BY + i]
    x = work[_X2 + i]
    y = work[_Y2 + i]
    limit = MAX_COORDINATE
    fine = (abs(ax) <= limit) & (abs(ay) <= limit) & (abs(bx) <= limit) & (abs(by) <= limit)
    fine = fine & (abs(x) <= limit) & (abs(y) <= limit)
    return (
        ax if fine else 0.0,
        ay if fine else 0.0,
        bx if fine else 0.0,
        by if fine else 0.0,
        x if fine else 0.0,
        y if fine else 0.0,
        fine,
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _combined(found, before, fine):
    """Status of a fix: what is wrong with the input comes before what is wrong with the geometry."""
    status = found if before == OK else before
    return status if fine else NOT_FINITE


@njit(cache=True, nogil=True, error_model="numpy")
def _poses(work, k, min_reliability):
    """Pose, reliability and status of k fixes."""
    for i in range(k):
        ax, ay, bx, by, x, y, fine = _landmarks_of(work, i)
        qx, qy, _, _, _, _, _, _, _, _, _, _, _, reliability, found = _solve(
            work[_S1 + i], work[_C1 + i], work[_S3 + i], work[_C3 + i], ax, ay, bx, by, min_reliability
        )
        status = _combined(found, work[_BEFORE + i], fine)
        good = status == OK
        work[_X + i] = x + qx if good else np.nan
        work[_Y + i] = y + qy if good else np.nan
        heading = wrap_angle(arc_tangent(-qy, -qx) - work[_TURNED + i])
        work[_HEADING + i] = heading if good else np.nan
        work[_RELIABILITY + i] = reliability if status < NOT_FINITE else np.nan
        work[_STATUS + i] = status


@njit(cache=True, nogil=True, error_model="numpy")
def _poses_and_covariances(work, k, min_reliability):
    """Pose, covariance, reliability and status of k fixes."""
    for i in range(k):
        ax, ay, bx, by, x, y, fine = _landmarks_of(work, i)
        s1 = work[_S1 + i]
        s3 = work[_S3 + i]
        qx, qy, Nx, Ny, inverse, Ax, Ay, Bx, By, Ha, Hb, G1, G3, reliability, found = _solve(
            s1, work[_C1 + i], s3, work[_C3 + i], ax, ay, bx, by, min_reliability
        )
        status = _combined(found, work[_BEFORE + i], fine)
        good = status == OK
        work[_X + i] = x + qx if good else np.nan
        work[_Y + i] = y + qy if good else np.nan
        heading = wrap_angle(arc_tangent(-qy, -qx) - work[_TURNED + i])
        work[_HEADING + i] = heading if good else np.nan
        work[_RELIABILITY + i] = reliability if status < NOT_FINITE else np.nan
        work[_STATUS + i] = status
        e1 = G1 * inverse
        e3 = G3 * inverse
        # A fix without a pose has no covariance; 0 keeps it out of the products.
        e1 = e1 if good else 0.0
        e3 = e3 if good else 0.0
        h = 2.0 * Hb * inverse
        x1 = e1 * (By - h * Nx)
        y1 = e1 * (-Bx - h * Ny)
        t1 = -e1 * s3
        h = 2.0 * Ha * inverse
        x3 = e3 * (h * Nx - Ay)
        y3 = e3 * (h * Ny + Ax)
        t3 = e3 * s1
        x2 = x1 + x3
        y2 = y1 + y3
        t2 = t1 + t3 - 1.0
        v1 = work[_V1 + i] if good else np.nan
        v2 = work[_V2 + i]
        v3 = work[_V3 + i]
        work[_XX + i] = v1 * x1 * x1 + v2 * x2 * x2 + v3 * x3 * x3
        work[_XY + i] = v1 * x1 * y1 + v2 * x2 * y2 + v3 * x3 * y3
        work[_XT + i] = v1 * x1 * t1 + v2 * x2 * t2 + v3 * x3 * t3
        work[_YY + i] = v1 * y1 * y1 + v2 * y2 * y2 + v3 * y3 * y3
        work[_YT + i] = v1 * y1 * t1 + v2 * y2 * t2 + v3 * y3 * t3
        work[_TT + i] = v1 * t1 * t1 + v2 * t2 * t2 + v3 * t3 * t3


@njit(cache=True, nogil=True, error_model="numpy")
def fixes(
    measured, landmarks, variances, pan, camera, min_reliability, pose, covariance, status, reliability
):
    """Fixes of ``measured`` (N, 3): bearings, rad, or columns, px, when ``camera`` (3,) is given.

    ``landmarks`` (1 or N, 3, 2) m; ``variances`` (1 or N, 3) rad² (on the optical axis for columns); ``pan``
    (1 or N,) rad; ``camera``: focal length, principal point, width, px, or empty. Writes ``pose`` (N, 3),
    ``covariance`` (N, 3, 3; skipped when empty), ``status`` (N,) and ``reliability`` (N,).
    """
    n = measured.shape[0]
    work = np.empty(_SCRATCH)
    step_landmark = 0 if landmarks.shape[0] == 1 else 1
    step_variance = 0 if variances.shape[0] == 1 else 1
    step_pan = 0 if pan.shape[0] == 1 else 1
    with_covariance = covariance.shape[0] > 0
    for first in range(0, n, _BLOCK):
        k = min(_BLOCK, n - first)
        for i in range(k):
            at = first + i
            work[_M1 + i] = measured[at, 0]
            work[_M2 + i] = measured[at, 1]
            work[_M3 + i] = measured[at, 2]
        if first == 0 or step_landmark == 1:
            for i in range(k):
                at = (first + i) * step_landmark
                x = landmarks[at, 1, 0]
                y = landmarks[at, 1, 1]
                work[_AX + i] = landmarks[at, 0, 0] - x
                work[_AY + i] = landmarks[at, 0, 1] - y
                work[_BX + i] = landmarks[at, 2, 0] - x
                work[_BY + i] = landmarks[at, 2, 1] - y
                work[_X2 + i] = x
                work[_Y2 + i] = y
        # Columns scale the variances in place.
        if first == 0 or step_variance == 1 or camera.shape[0] > 0:
            for i in range(k):
                at = (first + i) * step_variance
                work[_V1 + i] = variances[at, 0]
                work[_V2 + i] = variances[at, 1]
                work[_V3 + i] = variances[at, 2]
        if camera.shape[0] > 0:
            for i in range(k):
                work[_PAN + i] = pan[(first + i) * step_pan]
            _angles_of_columns(work, k, camera[0], camera[1], camera[2])
        else:
            _angles_of_bearings(work, k)
        if with_covariance:
            _poses_and_covariances(work, k, min_reliability)
        else:
            _poses(work, k, min_reliability)
        for i in range(k):
            at = first + i
            pose[at, 0] = work[_X + i]
            pose[at, 1] = work[_Y + i]
            pose[at, 2] = work[_HEADING + i]
            reliability[at] = work[_RELIABILITY + i]
            status[at] = int(work[_STATUS + i])
        if with_covariance:
            for i in range(k):
                at = first + i
                covariance[at, 0, 0] = work[_XX + i]
                covariance[at, 0, 1] = work[_XY + i]
                covariance[at, 1, 0] = work[_XY + i]
                covariance[at, 0, 2] = work[_XT + i]
                covariance[at, 2, 0] = work[_XT + i]
                covariance[at, 1, 1] = work[_YY + i]
                covariance[at, 1, 2] = work[_YT + i]
                covariance[at, 2, 1] = work[_YT + i]
                covariance[at, 2, 2] = work[_TT + i]
