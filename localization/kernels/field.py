"""Loop over the cells of a tile: who is seen, which triplet is best, what fix it gives."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    CRITERION,
    FIXED,
    FLOOR,
    HEADING,
    LEVER,
    LEVER_X,
    LEVER_Y,
    MODE,
    N_MUTED,
    OMNIDIRECTIONAL,
    fixed_variance,
    is_muted,
    triplet_fix,
    wrapped,
)
from localization.kernels.share import triplet_share
from localization.kernels.spans import azimuth_key, ranked_by_span
from localization.kernels.triplets import (
    is_degenerate,
    largest_triangle,
    ranked_triplets,
    sorted_three,
    strong_pairs,
    triplet_value,
)

#: A landmark nearer than this has no usable bearing: the robot stands on it. m
TOUCH_M = 1e-3

# Strong pairs per landmark from which the search by outer pairs is faster: constant, and per landmark.
_MANY = 2.0
_MANY_SHARE = 0.05
# Triplets remembered from cells nearby; with few landmarks they do not pay.
_N_SEEDS = 6
_SEEDED_FROM = 12


@njit(cache=True, nogil=True)
def visible_indices(words, out):
    """Indices of the bits set in ``words`` (n_words,) uint64, ascending, into ``out``; their number."""
    n = 0
    one = np.uint64(1)
    for w in range(words.shape[0]):
        word = words[w]
        base = w * 64
        while word != 0:
            # Whole empty bytes are skipped.
            if word & np.uint64(255) == 0:
                word >>= np.uint64(8)
                base += 8
                continue
            if word & one:
                out[n] = base
                n += 1
            word >>= one
            base += 1
    return n


@njit(cache=True, nogil=True)
def strongest_first(n, seen, strength, last, n_last, mark, order):
    """Sort ``seen`` (n,) by falling strength, then index, into ``order``; ``last`` (n_last,) is a good start.

    ``strength`` and ``mark`` are indexed by landmark; ``mark`` must be 0 and is 0 again afterwards.
    """
    for a in range(n):
        mark[seen[a]] = 1
    m = 0
    for a in range(n_last):
        if mark[last[a]] == 1:
            order[m] = last[a]
            mark[last[a]] = 0
            m += 1
    for a in range(n):
        if mark[seen[a]] == 1:
            order[m] = seen[a]
            mark[seen[a]] = 0
            m += 1
    for a in range(1, n):
        i = order[a]
        s = strength[i]
        b = a
        while b > 0 and (strength[order[b - 1]] < s or (strength[order[b - 1]] == s and order[b - 1] > i)):
            order[b] = order[b - 1]
            b -= 1
        order[b] = i


@njit(cache=True, nogil=True)
def in_view(x, y, n, seen, landmarks, sensor):
    """Keep those of ``seen`` (n,) that a sensor at (x, y) can measure; their number.

    Out go landmarks that it stands on, those in a muted sector and those outside a fixed camera's view.
    """
    m = 0
    for a in range(n):
        i = seen[a]
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        r2 = dx * dx + dy * dy
        if r2 < TOUCH_M * TOUCH_M:
            continue
        if sensor[MODE] == FIXED and math.isnan(fixed_variance(dx, dy, r2, 0.0, sensor)):
            continue
        if sensor[N_MUTED] > 0.0 and is_muted(dx, dy, sensor):
            continue
        seen[m] = i
        m += 1
    return m


@njit(cache=True, nogil=True)
def inverted(x, y, n, order, landmarks, survey, sensor, needs_azimuth, gx, gy, rho, azimuth, shares):
    """Landmarks ``order`` (n,) seen from (x, y): inverted, 1/r, azimuth, what is added to the variance.

    For a fixed camera the last is the whole variance.
    """
    for a in range(n):
        i = order[a]
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        r2 = dx * dx + dy * dy
        s = 1.0 / r2
        gx[a] = dx * s
        gy[a] = dy * s
        rho[a] = math.sqrt(s)
        shares[a] = survey[i] * s + sensor[FLOOR]
        if sensor[MODE] == FIXED:
            shares[a] = fixed_variance(dx, dy, r2, shares[a], sensor)
        azimuth[a] = wrapped(math.atan2(dy, dx) - sensor[HEADING]) if needs_azimuth else 0.0


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
def _holds(order, n, at, i):
    """Whether landmark i is among ``order`` (n,); ``at`` (N,) says where it would be, and may be stale."""
    return 0 <= at[i] < n and order[at[i]] == i


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
    h, w = free.shape
    n_all = landmarks.shape[0]
    pinhole = sensor[MODE] != OMNIDIRECTIONAL
    hull_only = not (pinhole or has_survey or sensor[CRITERION] != AREA or sensor[LEVER] > 0.0)
    needs_azimuth = pinhole and sensor[MODE] != CENTRED_FREE and sensor[MODE] != FIXED
    seen = np.empty(n_all + 1, dtype=np.int64)
    order = np.empty(n_all + 1, dtype=np.int64)
    last = np.empty(n_all + 1, dtype=np.int64)
    hull = np.empty(n_all + 1, dtype=np.int64)
    mark = np.zeros(n_all, dtype=np.int8)
    strength = np.empty(n_all)
    at = np.zeros(n_all, dtype=np.int64)
    gx = np.empty(n_all)
    gy = np.empty(n_all)
    rho = np.empty(n_all)
    azimuth = np.zeros(n_all)
    shares = np.zeros(n_all)
    cx = np.empty(n_all)
    cy = np.empty(n_all)
    crho = np.empty(n_all)
    key = np.empty(n_all)
    ring = np.empty(n_all, dtype=np.int64)
    n_ring = 0
    scratch = np.empty((8, 2 * n_all))
    values = np.empty(1)
    triplets = np.empty((1, 3), dtype=np.int64)
    corners = np.empty(3, dtype=np.int64)
    n_last = 0
    seeds = np.empty((_N_SEEDS, 3), dtype=np.int64)
    n_seeds = 0
    newest = _N_SEEDS - 1
    for row in range(h):
        for col in range(w):
            if not free[row, col]:
                continue
            # The sensor stands a lever arm away: (LEVER_Y, -LEVER_X) from the robot's centre.
            x = centres[row, col, 0] + sensor[LEVER_Y]
            y = centres[row, col, 1] - sensor[LEVER_X]
            n = in_view(x, y, visible_indices(masks[row, col], seen), seen, landmarks, sensor)
            for a in range(n):
                i = seen[a]
                dx = landmarks[i, 0] - x
                dy = landmarks[i, 1] - y
                r2 = dx * dx + dy * dy
                strength[i] = 1.0 / r2
                gx[a] = dx / r2
                gy[a] = dy / r2
            out_n_visible[row, col] = n
            if n < 3:
                continue
            i0 = -1
            i1 = -1
            i2 = -1
            if hull_only:
                d = largest_triangle(n, gx, gy, order, hull, corners)
                if corners[0] >= 0:
                    i0 = seen[corners[0]]
                    i1 = seen[corners[1]]
                    i2 = seen[corners[2]]
                    if is_degenerate(d, strength[i0] + strength[i1] + strength[i2]):
                        i0 = -1
            if i0 < 0:
                strongest_first(n, seen, strength, last, n_last, mark, order)
                for a in range(n):
                    last[a] = order[a]
                    at[order[a]] = a
                n_last = n
                inverted(
                    x, y, n, order, landmarks, survey, sensor, needs_azimuth, gx, gy, rho, azimuth, shares
                )
                # Triplets that were best nearby tell how good the best is at least.
                known = 0.0
                for a in range(n_seeds if n >= _SEEDED_FROM else 0):
                    s0 = seeds[a, 0]
                    s1 = seeds[a, 1]
                    s2 = seeds[a, 2]
                    if _holds(order, n, at, s0) and _holds(order, n, at, s1) and _holds(order, n, at, s2):
                        # In the order of the search, so that both compute the same number.
                        a0, a1, a2 = sorted_three(at[s0], at[s1], at[s2])
                        known = max(known, triplet_value(a0, a1, a2, gx, gy, rho, azimuth, shares, sensor))
                by_pairs = known == 0.0 or not pinhole
                if not by_pairs:
                    strong = strong_pairs(n, rho, shares, sensor, known)
                    by_pairs = strong <= n * (_MANY + _MANY_SHARE * n)
                if by_pairs:
                    found = ranked_triplets(
                        n, order, gx, gy, rho, azimuth, shares, sensor, known, cx, cy, crho, hull,
                        values, triplets,
                    )  # fmt: skip
                else:
                    for a in range(n):
                        key[order[a]] = -azimuth_key(gx[a], gy[a])
                    strongest_first(n, seen, key, ring, n_ring, mark, hull)
                    n_ring = n
                    for a in range(n):
                        ring[a] = hull[a]
                        hull[a] = at[hull[a]]
                    found = ranked_by_span(
                        n, order, gx, gy, rho, azimuth, shares, sensor, known, hull,
                        scratch[0], scratch[1], scratch[2], scratch[3], scratch[4], scratch[5], scratch[6],
                        scratch[7], values, triplets,
                    )  # fmt: skip
                if found == 0:
                    continue
                i0 = triplets[0, 0]
                i1 = triplets[0, 1]
                i2 = triplets[0, 2]
                if n_seeds == 0 or seeds[newest, 0] != i0 or seeds[newest, 1] != i1 or seeds[newest, 2] != i2:
                    newest = (newest + 1) % _N_SEEDS
                    n_seeds = min(n_seeds + 1, _N_SEEDS)
                    seeds[newest, 0] = i0
                    seeds[newest, 1] = i1
                    seeds[newest, 2] = i2
            xx, xy, yy, heading, pan = triplet_fix(x, y, i0, i1, i2, landmarks, survey, sensor)
            if math.isnan(xx):
                continue
            out_covariance[row, col, 0] = xx
            out_covariance[row, col, 1] = xy
            out_covariance[row, col, 2] = yy
            out_sigma_theta[row, col] = math.sqrt(heading)
            out_triplet[row, col, 0] = i0
            out_triplet[row, col, 1] = i1
            out_triplet[row, col, 2] = i2
            out_pan[row, col] = pan
            out_validity[row, col] = triplet_share(x, y, i0, i1, i2, pan, landmarks, survey, sensor)
