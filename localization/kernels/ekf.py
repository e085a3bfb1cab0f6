"""Extended Kalman filter of a pose (x, y, θ): odometry in, bearings and fixes in, Joseph form throughout.

Every measurement is folded in as one scalar ``z = h·(pose - mean) + noise`` after the other, all of one
update linearised at one place: for independent noise that equals the joint update and needs no inverse.
``noise`` (4,): variance of the distance per m, of the turn per rad, of the turn per m, of the sideways slip
per m (m²/m, rad²/rad, rad²/m, m²/m).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import wrapped

#: A landmark nearer than this gives no usable bearing, m.
TOUCH_M = 1e-3
# Below this half turn the series of sin(h)/h is exact to rounding, rad.
_SMALL = 1e-3


@njit(cache=True, nogil=True)
def sinc_and_slope(h):
    """``sin(h)/h`` and its derivative."""
    if abs(h) < _SMALL:
        h2 = h * h
        return 1.0 - h2 / 6.0 + h2 * h2 / 120.0, -h / 3.0 + h * h2 / 30.0
    s = math.sin(h) / h
    return s, (math.cos(h) - s) / h


@njit(cache=True, nogil=True)
def moved(pose, distance, turn, F, G):
    """Move ``pose`` (3,) in place along an arc; ``F`` (3, 3) and ``G`` (3, 3) get the Jacobians.

    F is with respect to the pose, G to distance, turn and sideways slip (which is zero).
    """
    c, slope = sinc_and_slope(0.5 * turn)
    phi = pose[2] + 0.5 * turn
    ux = math.cos(phi)
    uy = math.sin(phi)
    F[:, :] = 0.0
    F[0, 0] = 1.0
    F[1, 1] = 1.0
    F[2, 2] = 1.0
    F[0, 2] = -c * distance * uy
    F[1, 2] = c * distance * ux
    G[:, :] = 0.0
    G[0, 0] = c * ux
    G[1, 0] = c * uy
    G[0, 1] = 0.5 * distance * (slope * ux - c * uy)
    G[1, 1] = 0.5 * distance * (slope * uy + c * ux)
    G[2, 1] = 1.0
    G[0, 2] = -c * uy
    G[1, 2] = c * ux
    pose[0] += c * distance * ux
    pose[1] += c * distance * uy
    pose[2] = wrapped(pose[2] + turn)


@njit(cache=True, nogil=True)
def odometry_variances(distance, turn, noise, out):
    """Variances (3,) of distance, turn and slip of a step."""
    d = abs(distance)
    out[0] = noise[0] * d
    out[1] = noise[1] * abs(turn) + noise[2] * d
    out[2] = noise[3] * d


@njit(cache=True, nogil=True)
def predict(mean, P, distance, turn, noise):
    """Prediction in place: ``mean`` (3,) moves, ``P`` (3, 3) becomes ``F P Fᵀ + G M Gᵀ``."""
    F = np.empty((3, 3))
    G = np.empty((3, 3))
    M = np.empty(3)
    moved(mean, distance, turn, F, G)
    odometry_variances(distance, turn, noise, M)
    FP = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            FP[i, j] = F[i, 0] * P[0, j] + F[i, 1] * P[1, j] + F[i, 2] * P[2, j]
    for i in range(3):
        for j in range(i, 3):
            value = FP[i, 0] * F[j, 0] + FP[i, 1] * F[j, 1] + FP[i, 2] * F[j, 2]
            value += G[i, 0] * M[0] * G[j, 0] + G[i, 1] * M[1] * G[j, 1] + G[i, 2] * M[2] * G[j, 2]
            P[i, j] = value
            P[j, i] = value


@njit(cache=True, nogil=True)
def bearing_row(pose, mount, lx, ly, h):
    """Predicted bearing of a landmark, rad, gradient into ``h`` (3,). NaN at a touch.

    ``pose`` (3,) of the robot in W, ``mount`` (3,) of the sensor on the robot.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    ox = c * mount[0] - s * mount[1]
    oy = s * mount[0] + c * mount[1]
    dx = lx - pose[0] - ox
    dy = ly - pose[1] - oy
    r2 = dx * dx + dy * dy
    if not r2 >= TOUCH_M * TOUCH_M:
        return np.nan
    h[0] = dy / r2
    h[1] = -dx / r2
    # A turn also moves a sensor off the centre.
    h[2] = h[1] * ox - h[0] * oy - 1.0
    return wrapped(math.atan2(dy, dx) - pose[2] - mount[2])


@njit(cache=True, nogil=True)
def innovation_variance(P, h, variance):
    """``h P hᵀ + variance`` for a row ``h`` (3,)."""
    s = variance
    for i in range(3):
        for j in range(3):
            s += h[i] * P[i, j] * h[j]
    return s


@njit(cache=True, nogil=True)
def factor(P, L):
    """Lower triangular ``L`` (3, 3) with ``L Lᵀ = P``; columns without variance of their own are zero."""
    L[:, :] = 0.0
    for j in range(3):
        rest = P[j, j]
        for k in range(j):
            rest -= L[j, k] * L[j, k]
        if rest <= 0.0:
            continue
        L[j, j] = math.sqrt(rest)
        for i in range(j + 1, 3):
            value = P[i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            L[i, j] = value / L[j, j]


@njit(cache=True, nogil=True)
def update_scalar(offset, P, h, innovation, variance):
    """Joseph update in place of ``offset`` (3,), the change of the mean so far, and ``P`` (3, 3).

    ``P' = A P Aᵀ + variance k kᵀ`` with ``A = I - k h``, multiplied out as ``(A L)(A L)ᵀ``, ``P = L Lᵀ``:
    sums of squares stay positive where products of large numbers that cancel do not. ``innovation`` is the
    measurement minus its prediction where ``h`` (3,) was linearised (offset 0).
    """
    L = np.empty((3, 3))
    factor(P, L)
    hL = np.empty(3)
    s = variance
    for j in range(3):
        hL[j] = h[0] * L[0, j] + h[1] * L[1, j] + h[2] * L[2, j]
        s += hL[j] * hL[j]
    if not s > 0.0:
        return
    k = np.empty(3)
    rest = innovation
    for i in range(3):
        k[i] = (L[i, 0] * hL[0] + L[i, 1] * hL[1] + L[i, 2] * hL[2]) / s
        rest -= h[i] * offset[i]
    for i in range(3):
        offset[i] += k[i] * rest
        for j in range(3):
            L[i, j] -= k[i] * hL[j]
    for i in range(3):
        for j in range(i, 3):
            value = L[i, 0] * L[j, 0] + L[i, 1] * L[j, 1] + L[i, 2] * L[j, 2] + variance * k[i] * k[j]
            P[i, j] = value
            P[j, i] = value


@njit(cache=True, nogil=True)
def update_rows(mean, P, rows, innovations, variances, accepted):
    """Update in place with rows (m, 3) linearised at ``mean`` (3,); ``accepted`` (m,) says which count."""
    offset = np.zeros(3)
    for i in range(rows.shape[0]):
        if accepted[i]:
            update_scalar(offset, P, rows[i], innovations[i], variances[i])
    for i in range(3):
        mean[i] += offset[i]
    mean[2] = wrapped(mean[2])


@njit(cache=True, nogil=True)
def update_bearings(
    mean, P, mount, bearings, landmarks, variances, survey, gate, innovations, normalised, accepted
):
    """Update in place with bearings (m,) of landmarks (m, 2), variances (m,) rad² and of the survey (m,) m².

    ``mount`` (3,) is the sensor's pose on the robot.

    A bearing counts if its innovation² over its predicted variance is at most ``gate`` (a χ² quantile with
    one degree of freedom; inf: every one) and its landmark is not touched. Outputs (m,): innovation (rad),
    that ratio, and whether it counts.
    """
    m = bearings.shape[0]
    rows = np.zeros((m, 3))
    total = np.empty(m)
    for i in range(m):
        expected = bearing_row(mean, mount, landmarks[i, 0], landmarks[i, 1], rows[i])
        accepted[i] = False
        innovations[i] = np.nan
        normalised[i] = np.nan
        if math.isnan(expected) or math.isnan(bearings[i]):
            continue
        innovations[i] = wrapped(bearings[i] - expected)
        # |q| = 1 / r, and the first two of a row are q
        total[i] = variances[i] + survey[i] * (rows[i, 0] ** 2 + rows[i, 1] ** 2)
        normalised[i] = innovations[i] ** 2 / innovation_variance(P, rows[i], total[i])
        accepted[i] = normalised[i] <= gate
    update_rows(mean, P, rows, innovations, total, accepted)


@njit(cache=True, nogil=True)
def filter_log(
    mean,
    P,
    distances,
    turns,
    noise,
    scan_step,
    scan_offsets,
    bearings,
    landmarks,
    variances,
    survey,
    gate,
    first,
    stop,
    in_a_row,
    lost_after,
    out_mean,
    out_P,
    out_normalised,
    out_accepted,
):
    """Filter a drive: steps (T,) of odometry, scans (S,) of bearings after ``scan_step`` steps (ascending).

    Scan s has the bearings ``scan_offsets[s]`` to ``scan_offsets[s + 1]``. ``mean`` and ``P`` start after
    scan ``first - 1`` and are changed; outputs (S, 3) and (S, 3, 3) are the posteriors, (B,) and (B,) per
    bearing as in ``update_bearings``. Ends before a scan marked in ``stop`` (S,), or after one that makes
    ``lost_after`` scans in a row of whose bearings more than half were rejected (0: never), ``in_a_row`` of
    them before.

    Returns the scan it ended at (S at the end) and how many in a row were rejected.
    """
    t = 0 if first == 0 else scan_step[first - 1]
    unused = np.empty(bearings.shape[0])
    centre = np.zeros(3)
    for s in range(first, scan_step.shape[0]):
        if stop[s]:
            return s, in_a_row
        while t < scan_step[s]:
            predict(mean, P, distances[t], turns[t], noise)
            t += 1
        a = scan_offsets[s]
        b = scan_offsets[s + 1]
        update_bearings(
            mean,
            P,
            centre,
            bearings[a:b],
            landmarks[a:b],
            variances[a:b],
            survey[a:b],
            gate,
            unused[a:b],
            out_normalised[a:b],
            out_accepted[a:b],
        )
        out_mean[s] = mean
        out_P[s] = P
        if is_refused(out_normalised[a:b], out_accepted[a:b]):
            in_a_row += 1
            if lost_after > 0 and in_a_row >= lost_after:
                return s, in_a_row
        else:
            in_a_row = 0
    return scan_step.shape[0], in_a_row


@njit(cache=True, nogil=True)
def is_refused(normalised, accepted):
    """Whether more than half of a scan's bearings that can be judged (m,) were rejected."""
    judged = 0
    refused = 0
    for i in range(normalised.shape[0]):
        if not math.isnan(normalised[i]):
            judged += 1
            if not accepted[i]:
                refused += 1
    return 2 * refused > judged
