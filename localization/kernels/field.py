"""Loop over the cells of a tile: who is seen, which triplet is best, what fix it gives."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import LEVER_X, LEVER_Y, triplet_fix
from localization.kernels.seen import TOUCH_M, in_view, inverted, strongest_first, visible_indices
from localization.kernels.share import triplet_share
from localization.kernels.tile_search import search_tile
from localization.kernels.triplets import ranked_triplets

__all__ = (
    "TOUCH_M",
    "field_tile",
    "in_view",
    "inverted",
    "ranked_at",
    "strongest_first",
    "visible_indices",
)


@njit(cache=True, nogil=True)
def ranked_at(x, y, seen, landmarks, survey, sensor, values, triplets):
    """The best triplets of the landmarks ``seen`` (n,), all in view, with the sensor at (x, y); their number.

    See ``ranked_triplets``.
    """
    n = seen.shape[0]
    n_all = landmarks.shape[0]
    strength = np.zeros(n_all)
    for a in range(n):
        dx = landmarks[seen[a], 0] - x
        dy = landmarks[seen[a], 1] - y
        strength[seen[a]] = 1.0 / (dx * dx + dy * dy)
    order = np.empty(n, dtype=np.int64)
    strongest_first(n, seen, strength, seen, 0, np.zeros(n_all, dtype=np.int8), order)
    near = np.empty((8, n))
    gx, gy, rho, azimuth, shares = near[0], near[1], near[2], near[3], near[4]
    inverted(x, y, n, order, landmarks, survey, sensor, True, gx, gy, rho, azimuth, shares)
    scratch = np.empty(n, dtype=np.int64)
    return ranked_triplets(
        n,
        order,
        gx,
        gy,
        rho,
        azimuth,
        shares,
        sensor,
        0.0,
        near[5],
        near[6],
        near[7],
        scratch,
        values,
        triplets,
    )


@njit(cache=True, nogil=True)
def field_tile(
    centres,
    free,
    masks,
    landmarks,
    survey,
    has_survey,
    sensor,
    out_covariance,
    out_sigma_theta,
    out_triplet,
    out_pan,
    out_n_visible,
    out_validity,
):
    """Best triplet and fix of every free cell of a tile.

    ``centres`` (h, w, 2) of the robot, ``free`` (h, w), ``masks`` (h, w, n_words) uint64, ``landmarks``
    (N, 2), ``survey`` (N,) variances, m²; outputs (h, w, 3), (h, w), (h, w, 3), (h, w), (h, w), (h, w) hold
    NaN, -1 and 0 before.
    """
    search_tile(centres, free, masks, landmarks, survey, has_survey, sensor, out_triplet, out_n_visible)
    h, w = free.shape
    for row in range(h):
        for col in range(w):
            i0 = out_triplet[row, col, 0]
            if i0 < 0:
                continue
            i1 = out_triplet[row, col, 1]
            i2 = out_triplet[row, col, 2]
            x = centres[row, col, 0] + sensor[LEVER_Y]
            y = centres[row, col, 1] - sensor[LEVER_X]
            xx, xy, yy, heading, pan = triplet_fix(x, y, i0, i1, i2, landmarks, survey, sensor)
            if math.isnan(xx):
                out_triplet[row, col] = -1
                continue
            out_covariance[row, col, 0] = xx
            out_covariance[row, col, 1] = xy
            out_covariance[row, col, 2] = yy
            out_sigma_theta[row, col] = math.sqrt(heading)
            out_pan[row, col] = pan
            out_validity[row, col] = triplet_share(x, y, i0, i1, i2, pan, landmarks, survey, sensor)
