"""Covariance of the belief along given poses: odometry between them, bearings at some."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.ekf import bearing_row, predict, update_scalar


@njit(cache=True, nogil=True)
def covariances_along(
    poses, distances, turns, noise, mount, places, variances, is_fix, P, out_P, out_used, out_blind
):
    """Covariances at poses (K, 3) reached by distances and turns (K-1,), from ``P`` (3, 3), which changes.

    ``mount`` (3,) of the sensor on the robot, ``places`` (K, M, 2) of landmarks with ``variances`` (K, M) of
    their bearings, rad², NaN for none; where ``is_fix`` (K,) and three or more are there, they update.
    Outputs: (K, 3, 3), bearings used (K,), metres driven since the last fix (K,).
    """
    n_poses, m = variances.shape
    mean = np.empty(3)
    offset = np.zeros(3)
    h = np.empty(3)
    blind = 0.0
    for k in range(n_poses):
        if k > 0:
            mean[:] = poses[k - 1]
            predict(mean, P, distances[k - 1], turns[k - 1], noise)
            blind += abs(distances[k - 1])
        mean[:] = poses[k]
        used = 0
        if is_fix[k]:
            for i in range(m):
                if variances[k, i] > 0.0 and not math.isnan(
                    bearing_row(mean, mount, places[k, i, 0], places[k, i, 1], h)
                ):
                    used += 1
            if used < 3:
                used = 0
        if used > 0:
            for i in range(m):
                if variances[k, i] > 0.0 and not math.isnan(
                    bearing_row(mean, mount, places[k, i, 0], places[k, i, 1], h)
                ):
                    update_scalar(offset, P, h, 0.0, variances[k, i])
            blind = 0.0
        out_P[k] = P
        out_used[k] = used
        out_blind[k] = blind
