"""What some triplet is known to reach at the cells of a block: the more, the shorter the list of others.

Values are computed as by every other search, to the last bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.cell_search import CLIMBS, CX, GX, GY, N_KNOWN, RHO, remember_sorted, search_cell
from localization.kernels.fix import (
    CENTRED_FREE,
    COS_VIEW,
    FIXED,
    FLOOR,
    MODE,
    OMNIDIRECTIONAL,
    ON_AXIS,
    VIEW,
    fixed_variance,
)
from localization.kernels.seen import has_bit
from localization.kernels.triplets import three_value

# Rounds of replacing one landmark of a triplet by a better one.
_ROUNDS = 3
# Cells where this much less (log of the value) is known than the neighbours lead to expect are climbed at.
_DIP = 0.04
# Climbs before the exact search is tried again.
_CLIMBS = 64


@njit(cache=True, nogil=True)
def value_at(x, y, i, j, k, landmarks, survey, sensor):
    """Value of the landmarks i, j, k seen from (x, y), computed as by every other search."""
    x1 = landmarks[i, 0] - x
    y1 = landmarks[i, 1] - y
    x2 = landmarks[j, 0] - x
    y2 = landmarks[j, 1] - y
    x3 = landmarks[k, 0] - x
    y3 = landmarks[k, 1] - y
    r1 = x1 * x1 + y1 * y1
    r2 = x2 * x2 + y2 * y2
    r3 = x3 * x3 + y3 * y3
    w1 = 1.0 / r1
    w2 = 1.0 / r2
    w3 = 1.0 / r3
    s1 = survey[i] * w1 + sensor[FLOOR]
    s2 = survey[j] * w2 + sensor[FLOOR]
    s3 = survey[k] * w3 + sensor[FLOOR]
    if sensor[MODE] == FIXED:
        s1 = fixed_variance(x1, y1, r1, s1, sensor)
        s2 = fixed_variance(x2, y2, r2, s2, sensor)
        s3 = fixed_variance(x3, y3, r3, s3, sensor)
        if math.isnan(s1 + s2 + s3):
            return -1.0
    x1 *= w1
    y1 *= w1
    x2 *= w2
    y2 *= w2
    x3 *= w3
    y3 *= w3
    r1 = math.sqrt(w1)
    r2 = math.sqrt(w2)
    r3 = math.sqrt(w3)
    # By falling strength, then index, as searches have it: rounding depends on the order.
    if w2 > w1 or (w2 == w1 and j < i):
        x1, y1, r1, s1, w1, i, x2, y2, r2, s2, w2, j = x2, y2, r2, s2, w2, j, x1, y1, r1, s1, w1, i
    if w3 > w2 or (w3 == w2 and k < j):
        x2, y2, r2, s2, w2, j, x3, y3, r3, s3, w3, k = x3, y3, r3, s3, w3, k, x2, y2, r2, s2, w2, j
    if w2 > w1 or (w2 == w1 and j < i):
        x1, y1, r1, s1, x2, y2, r2, s2 = x2, y2, r2, s2, x1, y1, r1, s1
    return three_value(x1, y1, r1, 0.0, s1, x2, y2, r2, 0.0, s2, x3, y3, r3, 0.0, s3, sensor)


@njit(cache=True, nogil=True)
def best_seed(x, y, words, seeds, n_seeds, landmarks, survey, sensor):
    """Which of the known triplets ``seeds`` (S, 3) is best at (x, y), -1 without, and its value."""
    top = 0.0
    best = -1
    for a in range(n_seeds):
        i = seeds[a, 0]
        j = seeds[a, 1]
        k = seeds[a, 2]
        if has_bit(words, i) and has_bit(words, j) and has_bit(words, k):
            value = value_at(x, y, i, j, k, landmarks, survey, sensor)
            if value > top:
                top = value
                best = a
    return best, top


@njit(cache=True, nogil=True)
def climb(x, y, words, n, seen, landmarks, survey, sensor, gx, gy, rho, excess, triplet, value):
    """Replace landmarks of ``triplet`` (3,), whose value at (x, y) is given, by better ones of ``seen`` (n,).

    The value reached: a good start, no more. ``gx``, ``gy``, ``rho``, ``excess`` (n,) are scratch.
    """
    for a in range(n):
        dx = landmarks[seen[a], 0] - x
        dy = landmarks[seen[a], 1] - y
        s = 1.0 / (dx * dx + dy * dy) if has_bit(words, seen[a]) else np.nan
        gx[a] = dx * s
        gy[a] = dy * s
        rho[a] = math.sqrt(s)
    cos_view = sensor[COS_VIEW] if sensor[MODE] == CENTRED_FREE else -2.0
    # Least pair sum of variances.
    low = (
        sensor[ON_AXIS]
        if sensor[MODE] == OMNIDIRECTIONAL
        else sensor[ON_AXIS] * math.cos(0.5 * sensor[VIEW]) ** 4
    )
    low *= 3.0 * low
    unchanged = 0
    for step in range(3 * _ROUNDS):
        corner = step % 3
        i = triplet[(corner + 1) % 3]
        j = triplet[(corner + 2) % 3]
        d1 = landmarks[i, 0] - x
        d2 = landmarks[i, 1] - y
        s = 1.0 / (d1 * d1 + d2 * d2)
        xi = d1 * s
        yi = d2 * s
        d1 = landmarks[j, 0] - x
        d2 = landmarks[j, 1] - y
        s = 1.0 / (d1 * d1 + d2 * d2)
        xj = d1 * s
        yj = d2 * s
        ex = xj - xi
        ey = yj - yi
        ci = cos_view * math.sqrt(xi * xi + yi * yi)
        cj = cos_view * math.sqrt(s)
        unchanged += 1
        bar = value * low
        for step_a in range(n):
            a = np.uint64(step_a)
            d = ex * (gy[a] - yi) - ey * (gx[a] - xi)
            excess[a] = d * d
        for a in range(n):
            if excess[a] > bar:
                if xi * gx[a] + yi * gy[a] < ci * rho[a] or xj * gx[a] + yj * gy[a] < cj * rho[a]:
                    continue
                k = seen[a]
                if k in (i, j):
                    continue
                better = value_at(x, y, i, j, k, landmarks, survey, sensor)
                if better > value:
                    value = better
                    bar = value * low
                    triplet[corner] = k
                    unchanged = 0
        if unchanged == 3:
            break
    return value


@njit(cache=True, nogil=True)
def raise_known(first, last, rows, cols, px, py, known, by, name, masks, triplet, landmarks, survey, sensor):
    """Values of a triplet at cells (first … last - 1) into ``known`` where larger, its name into ``by``."""
    i = triplet[0]
    j = triplet[1]
    k = triplet[2]
    for a in range(first, last):
        words = masks[rows[a], cols[a]]
        if has_bit(words, i) and has_bit(words, j) and has_bit(words, k):
            value = value_at(px[a], py[a], i, j, k, landmarks, survey, sensor)
            if value > known[a]:
                known[a] = value
                by[a] = name


@njit(cache=True, nogil=True)
def level_and_slope(m, px, py, known, x0, y0):
    """A level and slope with ``log known ≥ level + slope · (p - p0)`` at the cells (m,) where it is not 0."""
    sxx = 1e-30
    syy = 1e-30
    sx = 0.0
    sy = 0.0
    for a in range(m):
        if known[a] == 0.0:
            continue
        value = math.log(known[a])
        dx = px[a] - x0
        dy = py[a] - y0
        sxx += dx * dx
        syy += dy * dy
        sx += dx * value
        sy += dy * value
    sx /= sxx
    sy /= syy
    level = np.inf
    for a in range(m):
        if known[a] > 0.0:
            level = min(level, math.log(known[a]) - sx * (px[a] - x0) - sy * (py[a] - y0))
    return level, sx, sy


@njit(cache=True, nogil=True)
def _least_known(m, px, py, known, settled):
    """Where to learn more: a cell where nothing is known, else the lowest below its neighbours; or -1."""
    mean = 0.0
    for a in range(m):
        if settled[a]:
            continue
        if known[a] == 0.0:
            return a
    x0 = px[m // 2]
    y0 = py[m // 2]
    _, sx, sy = level_and_slope(m, px, py, known, x0, y0)
    lowest = np.inf
    at = -1
    count = 0
    for a in range(m):
        if known[a] == 0.0:
            continue
        value = math.log(known[a]) - sx * (px[a] - x0) - sy * (py[a] - y0)
        mean += value
        count += 1
        if value < lowest and not settled[a]:
            lowest = value
            at = a
    return at if lowest < mean / max(1, count) - _DIP else -1


@njit(cache=True, nogil=True)
def know_block(
    m, rows, cols, px, py, known, by, settled, pool, masks, n, seen, landmarks, survey, sensor, seeds, state,
    work, orders, mark, triplet,
):  # fmt: skip
    """Values that triplets are known to reach in m cells, 0 without, into ``known``.

    The best at a few cells, or what climbing from ``seeds`` finds there, goes to ``pool`` (P, 3).
    """
    known[:m] = 0.0
    settled[:m] = False
    by[:m] = -1
    count = 0
    limit = min(pool.shape[0], 1 + min(m // 8, n // 24))
    at = m // 2
    for _ in range(2 * limit):
        settled[at] = True
        words = masks[rows[at], cols[at]]
        x = px[at]
        y = py[at]
        value = known[at]
        reached = value
        exact = False
        if state[CLIMBS] == 0:
            seen_here = search_cell(
                x, y, words, landmarks, survey, sensor, False, work, orders, mark, seeds, state, True, triplet
            )
            exact = seen_here >= 0
            state[CLIMBS] = 0 if exact else _CLIMBS
        if exact:
            if triplet[0] >= 0:
                reached = value_at(x, y, triplet[0], triplet[1], triplet[2], landmarks, survey, sensor)
        else:
            state[CLIMBS] -= 1
            if value == 0.0:
                which, value = best_seed(x, y, words, seeds, state[N_KNOWN], landmarks, survey, sensor)
                if which >= 0:
                    triplet[:] = seeds[which]
            else:
                triplet[:] = pool[by[at]]
            if value > 0.0:
                reached = climb(
                    x, y, words, n, seen, landmarks, survey, sensor, work[GX], work[GY], work[RHO], work[CX],
                    triplet, value,
                )  # fmt: skip
        if reached > known[at]:
            pool[count] = triplet
            raise_known(0, m, rows, cols, px, py, known, by, count, masks, triplet, landmarks, survey, sensor)
            remember_sorted(triplet, seeds, state)
            count += 1
            if count == limit:
                break
        at = _least_known(m, px, py, known, settled)
        if at < 0:
            break
