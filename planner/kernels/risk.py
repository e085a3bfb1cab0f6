"""Probability that a disc whose place is known up to a Gaussian error touches an obstacle.

Seen in the coordinates that make the error standard normal, the free places that are seen from the expected
one fill a star. Cut into M sectors, sector m is free out to ``ρ_m``, so that the robot is in collision with a
probability of at most the mean of ``exp(-ρ_m² / 2)``: rigorous for any shape of obstacles, and aware of the
direction of the error. Each sector is followed along its middle ray by steps that the clearance allows.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.kernels.clearance import point_distance

# A sector that is free so far adds less than 1e-9.
_FAR = 6.5
_LEAST_STEP = 1e-3
# Nobody asks for less.
_SURE = 1e-9


@njit(cache=True, nogil=True)
def principal_axes(xx, xy, yy):
    """Standard deviations (larger, smaller) and the azimuth of the larger, of a covariance."""
    half = 0.5 * (xx + yy)
    root = math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    large = math.sqrt(max(half + root, 0.0))
    small = math.sqrt(max(half - root, 0.0))
    return large, small, 0.5 * math.atan2(2.0 * xy, xx - yy)


@njit(cache=True, nogil=True)
def isotropic_bound(clearance, xx, xy, yy):
    """``exp(-c² / (2 λ_max))``: rigorous, whatever the direction of the obstacle; 1 without clearance."""
    if not clearance > 0.0:
        return 1.0
    large, _, _ = principal_axes(xx, xy, yy)
    if large == 0.0:
        return 0.0
    z = clearance / large
    return math.exp(-0.5 * z * z)


@njit(cache=True, nogil=True)
def sector_bound(
    x, y, xx, xy, yy, need, n_sectors, enough, segments, bucket_start, bucket_items, bucket_gap, grid
):
    """Bound on the probability that clearance at (x, y) plus the error is below ``need`` (m).

    Ends early, with a value above ``enough``, when that is certain to be exceeded; ``enough`` = 1: never.
    """
    large, small, azimuth = principal_axes(xx, xy, yy)
    here = point_distance(x, y, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid)
    if here < need:
        return 1.0
    if large == 0.0:
        return 0.0
    ca = math.cos(azimuth)
    sa = math.sin(azimuth)
    half = math.pi / n_sectors
    far = here - need
    total = 0.0
    for m in range(n_sectors):
        # Directions come spread out, so that an early end is likely.
        k = (m * 5) % n_sectors if n_sectors % 5 != 0 else m
        t = 2.0 * math.pi * k / n_sectors
        u = large * math.cos(t)
        v = small * math.sin(t)
        ux = u * ca - v * sa
        uy = u * sa + v * ca
        # Points of the sector lie no further from its middle ray than this, per unit of ρ.
        across = min(1.0, abs(math.sin(t)) + half)
        along = min(1.0, abs(math.cos(t)) + half)
        spread = half * math.sqrt((large * across) ** 2 + (small * along) ** 2)
        reach = math.sqrt(ux * ux + uy * uy) + spread
        rho = far / reach
        while rho < _FAR:
            d = point_distance(
                x + rho * ux,
                y + rho * uy,
                np.inf,
                segments,
                bucket_start,
                bucket_items,
                bucket_gap,
                grid,
            )
            step = (d - need - rho * spread) / reach
            if step < _LEAST_STEP:
                break
            rho += step
        if rho < _FAR:
            total += math.exp(-0.5 * rho * rho)
            if total > enough * n_sectors:
                return total / n_sectors
        else:
            total += math.exp(-0.5 * _FAR * _FAR)
    return total / n_sectors


@njit(cache=True, nogil=True)
def bounds_at(
    points, covariances, need, n_sectors, out_isotropic, out_sector,
    segments, bucket_start, bucket_items, bucket_gap, grid,
):  # fmt: skip
    """Both bounds at points (N, 2) with covariances (N, 3) xx, xy, yy; NaN covariance gives NaN."""
    for i in range(points.shape[0]):
        x = points[i, 0]
        y = points[i, 1]
        xx = covariances[i, 0]
        xy = covariances[i, 1]
        yy = covariances[i, 2]
        if math.isnan(xx):
            out_isotropic[i] = np.nan
            out_sector[i] = np.nan
            continue
        c = point_distance(x, y, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid) - need
        out_isotropic[i] = isotropic_bound(c, xx, xy, yy)
        out_sector[i] = out_isotropic[i]
        if out_isotropic[i] > _SURE:
            out_sector[i] = sector_bound(
                x, y, xx, xy, yy, need, n_sectors, 1.0, segments, bucket_start, bucket_items, bucket_gap, grid
            )


@njit(cache=True, nogil=True)
def too_risky(
    points, clearances, covariances, need, limit, n_sectors, out,
    segments, bucket_start, bucket_items, bucket_gap, grid,
):  # fmt: skip
    """Whether both bounds exceed ``limit`` at points (N, 2) with clearances (N,), into ``out`` (N,) bool.

    Points without a covariance (NaN) are not judged: False.
    """
    for i in range(points.shape[0]):
        xx = covariances[i, 0]
        xy = covariances[i, 1]
        yy = covariances[i, 2]
        out[i] = False
        if math.isnan(xx) or isotropic_bound(clearances[i] - need, xx, xy, yy) <= limit:
            continue
        if not clearances[i] > need:
            out[i] = True
            continue
        p = sector_bound(
            points[i, 0], points[i, 1], xx, xy, yy, need, n_sectors, limit,
            segments, bucket_start, bucket_items, bucket_gap, grid,
        )  # fmt: skip
        out[i] = p > limit


@njit(cache=True, nogil=True)
def likely(
    points, clearances, covariances, need, n_sectors, out,
    segments, bucket_start, bucket_items, bucket_gap, grid,
):  # fmt: skip
    """The smaller of both bounds at points (N, 2) with clearances (N,), into ``out`` (N,); NaN without Σ."""
    for i in range(points.shape[0]):
        xx = covariances[i, 0]
        xy = covariances[i, 1]
        yy = covariances[i, 2]
        if math.isnan(xx):
            out[i] = np.nan
            continue
        if not clearances[i] > need:
            out[i] = 1.0
            continue
        p = isotropic_bound(clearances[i] - need, xx, xy, yy)
        if p > _SURE:
            sectors = sector_bound(
                points[i, 0], points[i, 1], xx, xy, yy, need, n_sectors, 1.0,
                segments, bucket_start, bucket_items, bucket_gap, grid,
            )  # fmt: skip
            p = min(p, sectors)
        out[i] = p
