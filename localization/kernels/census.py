"""What becomes of each triplet of landmarks at one place, counted one by one."""

from __future__ import annotations

import numpy as np
from numba import njit

from localization.kernels.triplets import is_degenerate, triplet_value

FIX, NOT_IN_ONE_VIEW, DEGENERATE_TRIPLET = 0, 1, 2


@njit(cache=True, nogil=True)
def outcome(i, j, k, gx, gy, rho, azimuth, shares, sensor):
    """Outcome of one triplet; arguments as of ``triplet_value``."""
    d = (gx[j] - gx[i]) * (gy[k] - gy[i]) - (gy[j] - gy[i]) * (gx[k] - gx[i])
    if is_degenerate(d, rho[i] * rho[i] + rho[j] * rho[j] + rho[k] * rho[k]):
        return DEGENERATE_TRIPLET
    if triplet_value(i, j, k, gx, gy, rho, azimuth, shares, sensor) < 0.0:
        return NOT_IN_ONE_VIEW
    return FIX


@njit(cache=True, nogil=True)
def count_outcomes(n, gx, gy, rho, azimuth, shares, sensor):
    """How many of all triplets of n landmarks have each outcome, (3,)."""
    counts = np.zeros(3, dtype=np.int64)
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            for k in range(j + 1, n):
                counts[outcome(i, j, k, gx, gy, rho, azimuth, shares, sensor)] += 1
    return counts
