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
# Sums this much below a limit, as a share, are below it in every order of adding.
_SURELY = 1.0 - 1e-9
# A step that tells the direction of the nearest obstacle, m.
_ASIDE = 1e-3
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
def sector_table(n_sectors):
    """Sectors (M, 4): cosine and sine of the middle ray, and how much across and along it spreads."""
    out = np.empty((n_sectors, 4))
    half = math.pi / n_sectors
    for k in range(n_sectors):
        t = 2.0 * math.pi * k / n_sectors
        out[k, 0] = math.cos(t)
        out[k, 1] = math.sin(t)
        # Points of the sector lie no further from its middle ray than this, per unit of ρ.
        out[k, 2] = min(1.0, abs(math.sin(t)) + half)
        out[k, 3] = min(1.0, abs(math.cos(t)) + half)
    return out


@njit(cache=True, nogil=True)
def _ray(large, small, ca, sa, sector, half):
    """Middle ray of a sector, how far its points lie from it and how far out they reach, m per unit of ρ."""
    u = large * sector[0]
    v = small * sector[1]
    ux = u * ca - v * sa
    uy = u * sa + v * ca
    spread = half * math.sqrt((large * sector[2]) ** 2 + (small * sector[3]) ** 2)
    return ux, uy, spread, math.sqrt(ux * ux + uy * uy) + spread


@njit(cache=True, nogil=True)
def _share(rho):
    """What a sector that is free out to ρ adds to the mean; beyond what is followed as if it ended there."""
    rho = min(rho, _FAR)
    return math.exp(-0.5 * rho * rho)


@njit(cache=True, nogil=True)
def _free_out_to(
    x, y, far, need, ux, uy, spread, reach, segments, bucket_start, bucket_items, bucket_gap, grid
):
    """ρ out to which a sector is free, or at least ``_FAR``, followed by steps that the clearance allows."""
    rho = far / reach
    while rho < _FAR:
        d = point_distance(
            x + rho * ux, y + rho * uy, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid
        )
        step = (d - need - rho * spread) / reach
        if step < _LEAST_STEP:
            break
        rho += step
    return rho


@njit(cache=True, nogil=True)
def sector_bound(
    x, y, here, xx, xy, yy, need, sectors, segments, bucket_start, bucket_items, bucket_gap, grid
):
    """Bound on the probability that clearance at (x, y) plus the error is below ``need`` (m).

    ``here`` is the clearance at (x, y), ``sectors`` (M, 4) a :func:`sector_table`.
    """
    large, small, azimuth = principal_axes(xx, xy, yy)
    if here < need:
        return 1.0
    if large == 0.0:
        return 0.0
    ca = math.cos(azimuth)
    sa = math.sin(azimuth)
    n_sectors = sectors.shape[0]
    half = math.pi / n_sectors
    far = here - need
    total = 0.0
    for m in range(n_sectors):
        k = (m * 5) % n_sectors if n_sectors % 5 != 0 else m
        ux, uy, spread, reach = _ray(large, small, ca, sa, sectors[k], half)
        rho = _free_out_to(
            x, y, far, need, ux, uy, spread, reach, segments, bucket_start, bucket_items, bucket_gap, grid
        )
        total += _share(rho)
    return total / n_sectors


@njit(cache=True, nogil=True)
def exceeds(
    x, y, here, xx, xy, yy, need, sectors, limit, shares,
    segments, bucket_start, bucket_items, bucket_gap, grid,
):  # fmt: skip
    """Whether :func:`sector_bound` is above ``limit``, with as few sectors as that needs; ``shares`` (M,).

    A sector is free at least as far as the clearance at (x, y) reaches: that alone may be enough. Otherwise
    the sector towards the nearest obstacle is followed first, then those on both sides of it.
    """
    large, small, azimuth = principal_axes(xx, xy, yy)
    if here < need:
        return limit < 1.0
    if large == 0.0:
        return False
    n_sectors = sectors.shape[0]
    half = math.pi / n_sectors
    far = here - need
    enough = limit * n_sectors
    ca = math.cos(azimuth)
    sa = math.sin(azimuth)
    most = 0.0  # of the sum, with what is known so far
    for k in range(n_sectors):
        _, _, _, reach = _ray(large, small, ca, sa, sectors[k], half)
        shares[k] = _share(far / reach)
        most += shares[k]
    if most <= enough * _SURELY:
        return False
    # Towards the nearest obstacle, by differences.
    gx = point_distance(x + _ASIDE, y, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid) - here
    gy = point_distance(x, y + _ASIDE, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid) - here
    first = 0
    nearest = -math.inf
    for k in range(n_sectors):
        ux, uy, _, _ = _ray(large, small, ca, sa, sectors[k], half)
        towards = -ux * gx - uy * gy
        if towards > nearest:
            nearest = towards
            first = k
    total = 0.0
    for m in range(n_sectors):
        k = (first + ((m + 1) // 2 if m % 2 == 1 else -(m // 2))) % n_sectors
        ux, uy, spread, reach = _ray(large, small, ca, sa, sectors[k], half)
        rho = _free_out_to(
            x, y, far, need, ux, uy, spread, reach, segments, bucket_start, bucket_items, bucket_gap, grid
        )
        share = _share(rho)
        total += share
        most += share - shares[k]
        if total > enough:
            return True
        if most <= enough * _SURELY:
            return False
    return total > enough


@njit(cache=True, nogil=True)
def bounds_at(
    points, covariances, need, n_sectors, out_isotropic, out_sector,
    segments, bucket_start, bucket_items, bucket_gap, grid,
):  # fmt: skip
    """Both bounds at points (N, 2) with covariances (N, 3) xx, xy, yy; NaN covariance gives NaN."""
    sectors = sector_table(n_sectors)
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
        here = point_distance(x, y, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid)
        out_isotropic[i] = isotropic_bound(here - need, xx, xy, yy)
        out_sector[i] = out_isotropic[i]
        if out_isotropic[i] > _SURE:
            out_sector[i] = sector_bound(
                x, y, here, xx, xy, yy, need, sectors,
                segments, bucket_start, bucket_items, bucket_gap, grid,
            )  # fmt: skip


@njit(cache=True, nogil=True)
def too_risky(
    points, clearances, covariances, need, limit, n_sectors, out,
    segments, bucket_start, bucket_items, bucket_gap, grid,
):  # fmt: skip
    """Whether both bounds exceed ``limit`` at points (N, 2) with clearances (N,), into ``out`` (N,) bool.

    Points without a covariance (NaN) are not judged: False.
    """
    sectors = sector_table(n_sectors)
    shares = np.empty(n_sectors)
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
        x = points[i, 0]
        y = points[i, 1]
        here = point_distance(x, y, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid)
        out[i] = exceeds(
            x, y, here, xx, xy, yy, need, sectors, limit, shares,
            segments, bucket_start, bucket_items, bucket_gap, grid,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def likely(
    points, clearances, covariances, need, n_sectors, out,
    segments, bucket_start, bucket_items, bucket_gap, grid,
):  # fmt: skip
    """The smaller of both bounds at points (N, 2) with clearances (N,), into ``out`` (N,); NaN without Σ."""
    sectors = sector_table(n_sectors)
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
            x = points[i, 0]
            y = points[i, 1]
            here = point_distance(x, y, np.inf, segments, bucket_start, bucket_items, bucket_gap, grid)
            aware = sector_bound(
                x, y, here, xx, xy, yy, need, sectors,
                segments, bucket_start, bucket_items, bucket_gap, grid,
            )  # fmt: skip
            p = min(p, aware)
        out[i] = p
