"""Exact search for the best triplet in one place: branch and bound (MATH §3).

Sought is the triplet with the largest value: 1 / det Σ by area (``D² / (v1 v2 + v1 v3 + v2 v3)`` without a
lever arm), 1 / λ² by the largest eigenvalue λ of Σ, 4 / t² by its trace t. As ``det Σ ≤ λ²`` and
``4 det Σ ≤ t²``, whatever bounds the first bounds all three. Landmarks come inverted (see ``kernels.fix``).

Nothing here depends on where a search started: a triplet's value is a function of the place alone, every
triplet that could reach the best is looked at, and of equal values the smallest indices win.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    COS_VIEW,
    CRITERION,
    DEGENERATE,
    FIT_TOLERANCE,
    FIXED,
    LEVER,
    LEVER_X,
    LEVER_Y,
    MODE,
    OMNIDIRECTIONAL,
    ON_AXIS,
    TRACE,
    VIEW,
    bearing_variance,
    pan_axis,
    sides_and_weights,
)

#: Share by which bounds are loosened, far above rounding: an equal triplet is never cut off.
SLACK = 1e-11


@njit(cache=True, nogil=True)
def sorted_three(i, j, k):
    """Three numbers in ascending order."""
    if i > j:
        i, j = j, i
    if j > k:
        j, k = k, j
    if i > j:
        i, j = j, i
    return i, j, k


@njit(cache=True, nogil=True)
def comes_before(i, j, k, triplet):
    """Whether the ascending triplet (i, j, k) is lexicographically smaller than ``triplet`` (3,)."""
    if i != triplet[0]:
        return i < triplet[0]
    if j != triplet[1]:
        return j < triplet[1]
    return k < triplet[2]


@njit(cache=True, nogil=True)
def is_degenerate(d, size):
    """Whether twice the area ``d`` is lost in rounding; ``size`` = ρ1² + ρ2² + ρ3²."""
    return not abs(d) > DEGENERATE * size


@njit(cache=True, nogil=True)
def _criterion_value(x1, y1, x2, y2, x3, y3, v1, v2, v3, sensor):
    """Value of a triplet of inverted landmarks under any criterion and lever arm."""
    bx = sensor[LEVER_X]
    by = sensor[LEVER_Y]
    ax, ay, cx, cy, ex, ey, _, _, _, d = sides_and_weights(x1, y1, x2, y2, x3, y3, bx, by)
    if sensor[CRITERION] == AREA:
        # det of Σ v u uᵀ without cancellation: the u span D (1 + g × b) in pairs.
        f1 = 1.0 + x1 * by - y1 * bx
        f2 = 1.0 + x2 * by - y2 * bx
        f3 = 1.0 + x3 * by - y3 * bx
        return d * d / (v1 * v2 * f3 * f3 + v1 * v3 * f2 * f2 + v2 * v3 * f1 * f1)
    xx = v1 * ax * ax + v2 * cx * cx + v3 * ex * ex
    yy = v1 * ay * ay + v2 * cy * cy + v3 * ey * ey
    half = 0.5 * (xx + yy)
    if sensor[CRITERION] != TRACE:
        xy = v1 * ax * ay + v2 * cx * cy + v3 * ex * ey
        half += math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    root = d * d / half
    return root * root


@njit(cache=True, nogil=True)
def loosening(strongest, sensor):
    """To what share a lever arm can shrink an ellipse's squared area; ``strongest`` is the largest ρ."""
    rest = max(0.0, 1.0 - strongest * sensor[LEVER])
    return rest * rest


@njit(cache=True, nogil=True)
def three_value(x1, y1, r1, b1, s1, x2, y2, r2, b2, s2, x3, y3, r3, b3, s3, sensor):
    """Value of three landmarks; -1 when they give no fix together.

    Each comes inverted (x, y), with 1/r, azimuth relative to the heading, and what is added to the sensor's
    variance (rad²), which is the whole for a fixed camera.
    """
    d = (x2 - x1) * (y3 - y1) - (y2 - y1) * (x3 - x1)
    if is_degenerate(d, r1 * r1 + r2 * r2 + r3 * r3):
        return -1.0
    mode = sensor[MODE]
    if mode == OMNIDIRECTIONAL:
        v1 = sensor[ON_AXIS] + s1
        v2 = sensor[ON_AXIS] + s2
        v3 = sensor[ON_AXIS] + s3
    elif mode == FIXED:
        v1 = s1
        v2 = s2
        v3 = s3
    elif mode == CENTRED_FREE:
        c12 = (x1 * x2 + y1 * y2) / (r1 * r2)
        c13 = (x1 * x3 + y1 * y3) / (r1 * r3)
        c23 = (x2 * x3 + y2 * y3) / (r2 * r3)
        # The widest pair are the outer two; all three must lie in the half plane around their middle.
        s = 0.5 * (1.0 + min(c12, c13, c23))
        if c12 <= c13 and c12 <= c23:
            inner = 0.5 * (c13 + c23)
        elif c13 <= c23:
            inner = 0.5 * (c12 + c23)
        else:
            inner = 0.5 * (c12 + c13)
        if 2.0 * s - 1.0 < sensor[COS_VIEW] - FIT_TOLERANCE or inner < s * (1.0 - FIT_TOLERANCE):
            return -1.0
        # cos² off the axis: s for the outer two, inner² / s for the middle one.
        outer = sensor[ON_AXIS] * s * s
        m = inner * inner / s
        middle = sensor[ON_AXIS] * m * m
        if c12 <= c13 and c12 <= c23:
            v1 = outer + s1
            v2 = outer + s2
            v3 = middle + s3
        elif c13 <= c23:
            v1 = outer + s1
            v2 = middle + s2
            v3 = outer + s3
        else:
            v1 = middle + s1
            v2 = outer + s2
            v3 = outer + s3
    else:
        axis = pan_axis(b1, b2, b3, s1, s2, s3, sensor, FIT_TOLERANCE)
        if math.isnan(axis):
            return -1.0
        v1 = bearing_variance(b1 - axis, sensor[ON_AXIS], s1)
        v2 = bearing_variance(b2 - axis, sensor[ON_AXIS], s2)
        v3 = bearing_variance(b3 - axis, sensor[ON_AXIS], s3)
    if sensor[CRITERION] == AREA and sensor[LEVER] == 0.0:
        return d * d / (v1 * v2 + v3 * (v1 + v2))
    return _criterion_value(x1, y1, x2, y2, x3, y3, v1, v2, v3, sensor)


@njit(cache=True, nogil=True)
def triplet_value(i, j, k, gx, gy, rho, azimuth, survey, sensor):
    """Value of the landmarks i, j, k; -1 when they give no fix together.

    ``gx``, ``gy`` inverted, ``rho`` 1/r, ``azimuth`` relative to the heading, ``survey`` (rad²): (n,); the
    last is added to the sensor's variance, or is the whole for a fixed camera.
    """
    return three_value(
        gx[i], gy[i], rho[i], azimuth[i], survey[i],
        gx[j], gy[j], rho[j], azimuth[j], survey[j],
        gx[k], gy[k], rho[k], azimuth[k], survey[k],
        sensor,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _limits(sensor):
    """Of a sensor: largest |D| / (ρ ρ), least variance before shares, least cosine within a view."""
    if sensor[MODE] == OMNIDIRECTIONAL:
        return 1.5 * math.sqrt(3.0), sensor[ON_AXIS], -2.0
    reach = 2.0 * math.sin(0.5 * sensor[VIEW])
    if sensor[MODE] == FIXED:
        return reach, 0.0, -2.0
    return reach, sensor[ON_AXIS] * math.cos(0.5 * sensor[VIEW]) ** 4, sensor[COS_VIEW] - FIT_TOLERANCE


@njit(cache=True, nogil=True)
def offer(value, i, j, k, values, triplets, found):
    """Put an ascending triplet into the ranked list (values (K,), triplets (K, 3)); new length."""
    size = values.shape[0]
    at = found
    while at > 0 and (
        value > values[at - 1] or (value == values[at - 1] and comes_before(i, j, k, triplets[at - 1]))
    ):
        at -= 1
    if at == size:
        return found
    for row in range(min(found, size - 1), at, -1):
        values[row] = values[row - 1]
        triplets[row, 0] = triplets[row - 1, 0]
        triplets[row, 1] = triplets[row - 1, 1]
        triplets[row, 2] = triplets[row - 1, 2]
    values[at] = value
    triplets[at, 0] = i
    triplets[at, 1] = j
    triplets[at, 2] = k
    return min(found + 1, size)


@njit(cache=True, nogil=True)
def ranked_triplets(
    n, index, gx, gy, rho, azimuth, survey, sensor, known, cx, cy, crho, cid, values, triplets
):
    """The K best triplets, best first: ``values`` (K,), ``triplets`` (K, 3) ascending indices; their number.

    All landmark arrays (n,) are in the order of falling ``rho`` (then index); ``index`` holds the indices
    that are reported. ``known`` is a value that some triplet is known to reach (K = 1), or 0. ``cx`` to
    ``cid`` (n,) are scratch.

    Branch and bound over pairs of the two nearest landmarks. Within a field of view F, and with
    ρ_i ≥ ρ_j ≥ ρ_k, ``D ≤ 2 sin(F/2) ρ_i ρ_j`` (all around: ``3√3/2``), and for a known pair
    ``D ≤ |g_i × g_j| + ρ_k |g_j - g_i|``.
    """
    size = values.shape[0]
    found = 0
    values[:] = -1.0
    triplets[:] = -1
    reach, on_axis, cos_view = _limits(sensor)
    loose = loosening(rho[0], sensor) * (1.0 - SLACK)
    least = np.inf
    for i in range(n):
        least = min(least, on_axis + survey[i])
    bar = known * loose
    for i in range(n - 2):
        xi = gx[i]
        yi = gy[i]
        ri = rho[i]
        low = on_axis + survey[i]
        d = reach * ri * ri
        if d * d < bar * 3.0 * least * least:
            break
        weakest = least * (2.0 * low + least)
        m = 0
        for j in range(i + 1, n):
            if xi * gx[j] + yi * gy[j] >= cos_view * ri * rho[j]:
                cx[m] = gx[j]
                cy[m] = gy[j]
                crho[m] = rho[j]
                cid[m] = j
                m += 1
        for a in range(m - 1):
            d = reach * ri * crho[a]
            if d * d < bar * weakest:
                break
            j = cid[a]
            ex = cx[a] - xi
            ey = cy[a] - yi
            twice = xi * cy[a] - yi * cx[a]
            side = math.sqrt(ex * ex + ey * ey)
            per_side = 1.0 / side if side > 0.0 else 0.0
            low_j = on_axis + survey[j]
            pair = (low * low_j + least * (low + low_j)) * (1.0 - SLACK)
            limit = bar * pair
            cut = (math.sqrt(limit) - abs(twice)) * per_side
            for b in range(a + 1, m):
                if crho[b] < cut:
                    break
                d = ex * (cy[b] - yi) - ey * (cx[b] - xi)
                if d * d < limit:
                    continue
                if cx[a] * cx[b] + cy[a] * cy[b] < cos_view * crho[a] * crho[b]:
                    continue
                k = cid[b]
                value = triplet_value(i, j, k, gx, gy, rho, azimuth, survey, sensor)
                if value < bar or value < 0.0:
                    continue
                k0, k1, k2 = sorted_three(index[i], index[j], index[k])
                found = offer(value, k0, k1, k2, values, triplets, found)
                if found == size and values[size - 1] * loose > bar:
                    bar = values[size - 1] * loose
                    limit = bar * pair
                    cut = (math.sqrt(limit) - abs(twice)) * per_side
    return found


@njit(cache=True, nogil=True)
def strong_pairs(n, rho, survey, sensor, known):
    """How many pairs of landmarks ``ranked_triplets`` cannot rule out by strength alone; arguments there."""
    reach, on_axis, _ = _limits(sensor)
    least = np.inf
    for i in range(n):
        least = min(least, on_axis + survey[i])
    need = math.sqrt(3.0 * known * loosening(rho[0], sensor)) * least / reach
    count = 0
    j = n - 1
    for i in range(n - 1):
        while j > i and rho[i] * rho[j] < need:
            j -= 1
        if j <= i:
            break
        count += j - i
    return count
