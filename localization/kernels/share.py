"""Predicted share of a chosen triplet's fixes inside its 95 % ellipse, under any sensor."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.coverage import predicted_share
from localization.kernels.fix import FIXED, FLOOR, HEADING, MODE, OMNIDIRECTIONAL, ON_AXIS, bearing_variance


@njit(cache=True, nogil=True)
def triplet_share(x, y, i, j, k, pan, landmarks, survey, sensor):
    """As ``triplet_fix``, whose ``pan`` is taken; judged where the sensor is, without a lever arm."""
    dx1 = landmarks[i, 0] - x
    dy1 = landmarks[i, 1] - y
    dx2 = landmarks[j, 0] - x
    dy2 = landmarks[j, 1] - y
    dx3 = landmarks[k, 0] - x
    dy3 = landmarks[k, 1] - y
    s1 = survey[i] / (dx1 * dx1 + dy1 * dy1) + sensor[FLOOR]
    s2 = survey[j] / (dx2 * dx2 + dy2 * dy2) + sensor[FLOOR]
    s3 = survey[k] / (dx3 * dx3 + dy3 * dy3) + sensor[FLOOR]
    if sensor[MODE] == OMNIDIRECTIONAL:
        v = sensor[ON_AXIS]
        return predicted_share(dx1, dy1, dx2, dy2, dx3, dy3, v + s1, v + s2, v + s3, 0.0, 0.0)
    axis = sensor[HEADING]
    if sensor[MODE] != FIXED:
        if math.isnan(pan):
            return np.nan
        axis += pan
    v1 = bearing_variance(math.atan2(dy1, dx1) - axis, sensor[ON_AXIS], s1)
    v2 = bearing_variance(math.atan2(dy2, dx2) - axis, sensor[ON_AXIS], s2)
    v3 = bearing_variance(math.atan2(dy3, dx3) - axis, sensor[ON_AXIS], s3)
    return predicted_share(dx1, dy1, dx2, dy2, dx3, dy3, v1, v2, v3, axis, sensor[ON_AXIS])
