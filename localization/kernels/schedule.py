"""Bearing variances of the triplets that are looked at along a drive."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import (
    FLOOR,
    HEADING,
    LEVER_X,
    LEVER_Y,
    MODE,
    OMNIDIRECTIONAL,
    ON_AXIS,
    bearing_variance,
    triplet_fix,
)


@njit(cache=True, nogil=True)
def triplet_variances(poses, triplets, landmarks, survey, mount, sensor, out):
    """Variances (K, 3), rad², of the triplets (K, 3) seen from poses (K, 3) into ``out``; NaN for no fix.

    A triplet that begins with -1 is none. ``landmarks`` (N, 2), ``survey`` (N,): m, m²; ``mount`` (3,): x, y
    (m) and θ (rad) of the sensor on the robot; ``sensor``: as of ``localization.kernels.fix``, any heading.
    """
    args = sensor.copy()
    for k in range(poses.shape[0]):
        out[k] = np.nan
        if triplets[k, 0] < 0 or triplets[k, 1] < 0 or triplets[k, 2] < 0:
            continue
        c = math.cos(poses[k, 2])
        s = math.sin(poses[k, 2])
        ox = c * mount[0] - s * mount[1]
        oy = s * mount[0] + c * mount[1]
        x = poses[k, 0] + ox
        y = poses[k, 1] + oy
        args[HEADING] = poses[k, 2] + mount[2]
        args[LEVER_X] = -oy
        args[LEVER_Y] = ox
        xx, _, _, _, pan = triplet_fix(
            x, y, triplets[k, 0], triplets[k, 1], triplets[k, 2], landmarks, survey, args
        )
        if math.isnan(xx):
            continue
        axis = args[HEADING] + (0.0 if math.isnan(pan) else pan)
        for i in range(3):
            j = triplets[k, i]
            dx = landmarks[j, 0] - x
            dy = landmarks[j, 1] - y
            share = survey[j] / (dx * dx + dy * dy) + args[FLOOR]
            if args[MODE] == OMNIDIRECTIONAL:
                out[k, i] = args[ON_AXIS] + share
            else:
                out[k, i] = bearing_variance(math.atan2(dy, dx) - axis, args[ON_AXIS], share)
