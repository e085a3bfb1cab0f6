"""Fix from every landmark in view, by the information of all their bearings (MATH §2).

A pan head must choose where to look. ``centred``: on the middle of some pair of landmarks that fits into the
view (cut by the pan limits), of all pairs the one whose view gives the best fix; ``optimal``: anywhere.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.field import in_view, visible_indices
from localization.kernels.fix import (
    AREA,
    CRITERION,
    FIT_TOLERANCE,
    FIXED,
    FLOOR,
    HEADING,
    LEVER_X,
    LEVER_Y,
    MODE,
    OMNIDIRECTIONAL,
    ON_AXIS,
    OPTIMAL,
    PAN_MAX,
    PAN_MIN,
    TRACE,
    VIEW,
    bearing_variance,
    fixed_variance,
    information_covariance,
    pan_axis,
    wrapped,
)

_TURN = 2.0 * math.pi
# Between two axes at which a landmark enters or leaves, the information is smooth: steps of a scan, rad.
_STEP = 0.1
_GOLDEN = 0.6180339887498949
_GOLDEN_STEPS = 40


@njit(cache=True, nogil=True)
def criterion_cost(xx, xy, yy, criterion):
    """What a criterion makes small: det Σ, largest eigenvalue or trace; infinity for NaN."""
    if math.isnan(xx):
        return np.inf
    if criterion == AREA:
        return xx * yy - xy * xy
    if criterion == TRACE:
        return xx + yy
    return 0.5 * (xx + yy) + math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)


@njit(cache=True, nogil=True)
def fix_at_axis(axis, n, inverted, azimuth, shares, sensor, some, variances):
    """Σ (xx, xy, yy) and the heading's variance with the optical axis at ``axis``.

    ``inverted`` (n, 2) landmarks; ``azimuth`` (n,) and ``axis`` relative to the sensor's heading; ``some``
    (n, 2) and ``variances`` (n,) are scratch.
    """
    m = 0
    half = 0.5 * sensor[VIEW] + FIT_TOLERANCE
    for a in range(n):
        off = wrapped(azimuth[a] - axis)
        if abs(off) <= half:
            some[m, 0] = inverted[a, 0]
            some[m, 1] = inverted[a, 1]
            variances[m] = bearing_variance(off, sensor[ON_AXIS], shares[a])
            m += 1
    return information_covariance(some[:m], variances[:m], sensor[LEVER_X], sensor[LEVER_Y])


@njit(cache=True, nogil=True)
def _cost_at(axis, n, inverted, azimuth, shares, sensor, some, variances):
    xx, xy, yy, _ = fix_at_axis(axis, n, inverted, azimuth, shares, sensor, some, variances)
    return criterion_cost(xx, xy, yy, sensor[CRITERION])


@njit(cache=True, nogil=True)
def centred_axis(n, inverted, azimuth, shares, sensor, some, variances):
    """Best axis on the middle of a pair of landmarks; NaN when no view gives a fix."""
    best = np.nan
    least = np.inf
    for a in range(n):
        for b in range(a + 1, n):
            axis = pan_axis(azimuth[a], azimuth[a], azimuth[b], 0.0, 0.0, 0.0, sensor, FIT_TOLERANCE)
            if math.isnan(axis):
                continue
            cost = _cost_at(axis, n, inverted, azimuth, shares, sensor, some, variances)
            if cost < least:
                least = cost
                best = axis
    return best


@njit(cache=True, nogil=True)
def optimal_axis(n, inverted, azimuth, shares, sensor, edges, some, variances):
    """Best axis within the pan limits; ``edges`` (2 n + 2,) is scratch. NaN when no view gives a fix."""
    first = sensor[PAN_MIN]
    last = min(sensor[PAN_MAX], first + _TURN)
    m = 0
    for a in range(n):
        for side in (-0.5, 0.5):
            off = azimuth[a] + side * sensor[VIEW] - first
            off -= _TURN * math.floor(off / _TURN)
            if first + off < last:
                edges[m] = first + off
                m += 1
    edges[m] = first
    edges[m + 1] = last
    ends = np.sort(edges[: m + 2])
    best = np.nan
    least = np.inf
    low = np.nan
    high = np.nan
    for e in range(m + 1):
        width = ends[e + 1] - ends[e]
        steps = max(1, math.ceil(width / _STEP))
        for s in range(steps + 1):
            axis = ends[e + 1] if s == steps else ends[e] + s * width / steps
            cost = _cost_at(axis, n, inverted, azimuth, shares, sensor, some, variances)
            if cost < least:
                least = cost
                best = axis
                low = max(ends[e], axis - width / steps)
                high = min(ends[e + 1], axis + width / steps)
    if math.isnan(best):
        return best
    c = high - _GOLDEN * (high - low)
    d = low + _GOLDEN * (high - low)
    at_c = _cost_at(c, n, inverted, azimuth, shares, sensor, some, variances)
    at_d = _cost_at(d, n, inverted, azimuth, shares, sensor, some, variances)
    for _ in range(_GOLDEN_STEPS):
        if at_c < at_d:
            high = d
            d = c
            at_d = at_c
            c = high - _GOLDEN * (high - low)
            at_c = _cost_at(c, n, inverted, azimuth, shares, sensor, some, variances)
        else:
            low = c
            c = d
            at_c = at_d
            d = low + _GOLDEN * (high - low)
            at_d = _cost_at(d, n, inverted, azimuth, shares, sensor, some, variances)
    axis = 0.5 * (low + high)
    return axis if _cost_at(axis, n, inverted, azimuth, shares, sensor, some, variances) < least else best


@njit(cache=True, nogil=True)
def all_visible_tile(
    centres, free, masks, landmarks, survey, sensor, out_covariance, out_sigma_theta, out_pan, out_n_visible
):
    """Fix from all landmarks in view of every free cell of a tile; arguments as of ``field_tile``."""
    h, w = free.shape
    n_all = landmarks.shape[0]
    seen = np.empty(n_all + 1, dtype=np.int64)
    inverted = np.empty((n_all, 2))
    some = np.empty((n_all, 2))
    azimuth = np.empty(n_all)
    shares = np.empty(n_all)
    variances = np.empty(n_all)
    edges = np.empty(2 * n_all + 2)
    mode = sensor[MODE]
    for row in range(h):
        for col in range(w):
            if not free[row, col]:
                continue
            x = centres[row, col, 0] + sensor[LEVER_Y]
            y = centres[row, col, 1] - sensor[LEVER_X]
            n = in_view(x, y, visible_indices(masks[row, col], seen), seen, landmarks, sensor)
            out_n_visible[row, col] = n
            if n < 3:
                continue
            for a in range(n):
                i = seen[a]
                dx = landmarks[i, 0] - x
                dy = landmarks[i, 1] - y
                r2 = dx * dx + dy * dy
                inverted[a, 0] = dx / r2
                inverted[a, 1] = dy / r2
                shares[a] = survey[i] / r2 + sensor[FLOOR]
                if mode == OMNIDIRECTIONAL:
                    variances[a] = sensor[ON_AXIS] + shares[a]
                elif mode == FIXED:
                    variances[a] = fixed_variance(dx, dy, r2, shares[a], sensor)
                else:
                    azimuth[a] = wrapped(math.atan2(dy, dx) - sensor[HEADING])
            pan = np.nan
            if mode in (OMNIDIRECTIONAL, FIXED):
                xx, xy, yy, heading = information_covariance(
                    inverted[:n], variances[:n], sensor[LEVER_X], sensor[LEVER_Y]
                )
            else:
                if mode == OPTIMAL:
                    pan = optimal_axis(n, inverted, azimuth, shares, sensor, edges, some, variances)
                else:
                    pan = centred_axis(n, inverted, azimuth, shares, sensor, some, variances)
                if math.isnan(pan):
                    continue
                xx, xy, yy, heading = fix_at_axis(pan, n, inverted, azimuth, shares, sensor, some, variances)
            if math.isnan(xx):
                continue
            out_covariance[row, col, 0] = xx
            out_covariance[row, col, 1] = xy
            out_covariance[row, col, 2] = yy
            out_sigma_theta[row, col] = math.sqrt(heading)
            out_pan[row, col] = pan if math.isnan(pan) else wrapped(pan)
