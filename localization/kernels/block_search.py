"""Best triplets of a block of cells together: what is known at every cell, one list, one comparison per cell.

Values are computed as by every other search, to the last bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.block_known import level_and_slope, value_at
from localization.kernels.block_lists import block_triplets, few_are_strong, strong_block_triplets
from localization.kernels.blocks import MOST_TURN, known_share, place_landmarks
from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    COS_VIEW,
    CRITERION,
    FIT_TOLERANCE,
    FIXED,
    FLOOR,
    HEADING,
    LEVER,
    MAX_AXIS,
    MODE,
    OMNIDIRECTIONAL,
    ON_AXIS,
    VIEW,
)
from localization.kernels.seen import TOUCH_M, bits_set, has_bit, strongest_first
from localization.kernels.spans import azimuth_key
from localization.kernels.triplets import SLACK, comes_before, sorted_three

# Orders kept from block to block: by azimuth, by strength.
RING, STRONG = range(2)
# Longest list that pays: constant, and per cell.
_LISTED = 512
_LISTED_MORE = 64


@njit(cache=True, nogil=True)
def middle(first, last, px, py):
    """Middle and half sides of the rectangle that holds the cells (first … last - 1)."""
    x0 = px[first]
    x1 = px[first]
    y0 = py[first]
    y1 = py[first]
    for a in range(first + 1, last):
        x0 = min(x0, px[a])
        x1 = max(x1, px[a])
        y0 = min(y0, py[a])
        y1 = max(y1, py[a])
    x = 0.5 * (x0 + x1)
    y = 0.5 * (y0 + y1)
    return x, y, (x1 - x) * (1.0 + 1e-9) + 1e-9, (y1 - y) * (1.0 + 1e-9) + 1e-9


@njit(cache=True, nogil=True)
def together(m, rows, cols, masks, x0, y0, hx, hy, landmarks, sensor, seen, sure):
    """Landmarks seen from any cell into ``seen``, bits of those surely in view into ``sure``; -1: near."""
    h = math.hypot(hx, hy)
    half = math.cos(0.5 * sensor[VIEW])
    n = 0
    for w in range(sure.shape[0]):
        word = np.uint64(0)
        for a in range(m):
            word |= masks[rows[a], cols[a], w]
        sure[w] = word
        i = w * 64
        while word != 0:
            if word & np.uint64(255) == 0:
                word >>= np.uint64(8)
                i += 8
                continue
            if word & np.uint64(1):
                dx = landmarks[i, 0] - x0
                dy = landmarks[i, 1] - y0
                r = math.sqrt(dx * dx + dy * dy)
                if r * MOST_TURN < h or r < h + 2.0 * TOUCH_M:
                    return -1
                out = False
                if sensor[MODE] == FIXED:
                    c = (dx * math.cos(sensor[HEADING]) + dy * math.sin(sensor[HEADING])) / r
                    turned = 1.1 * h / r + 2.0 * FIT_TOLERANCE
                    out = c + turned < half
                    if c - turned < half:
                        sure[w] &= ~(np.uint64(1) << np.uint64(i & 63))
                if not out:
                    seen[n] = i
                    n += 1
            word >>= np.uint64(1)
            i += 1
    return n


@njit(cache=True, nogil=True)
def _is_ahead(dx, dy, ahead_x, ahead_y, half):
    """Whether (dx, dy) is in the view of a fixed camera, decided as by ``fix.fixed_variance``."""
    forward = dx * ahead_x + dy * ahead_y
    return not (forward < 0.0 or forward < half * math.sqrt(dx * dx + dy * dy))


@njit(cache=True, nogil=True)
def count_visible(x, y, words, sure, landmarks, sensor):
    """How many landmarks of ``words`` can be measured from (x, y); all of ``sure`` can be if visible."""
    n = 0
    ahead_x = math.cos(sensor[HEADING])
    ahead_y = math.sin(sensor[HEADING])
    half = math.cos(0.5 * sensor[VIEW]) - FIT_TOLERANCE
    for w in range(words.shape[0]):
        n += bits_set(words[w] & sure[w])
        word = words[w] & ~sure[w]
        i = w * 64
        while word != 0:
            if word & np.uint64(1):
                dx = landmarks[i, 0] - x
                dy = landmarks[i, 1] - y
                n += _is_ahead(dx, dy, ahead_x, ahead_y, half)
            word >>= np.uint64(1)
            i += 1
    return n


@njit(cache=True, nogil=True)
def list_block(
    n, m, px, py, known, landmarks, survey, sensor, orders, n_orders, mark, seen, order, key, work, found,
    sums, tops, ids,
):  # fmt: skip
    """Triplets of ``seen`` (n,) that may be best in any of m cells: number, landmarks, lowering, slope.

    ``found`` (3, C) become places in ``ids``, the landmarks that occur. ``known`` (m,) is reached there.
    Number -1: too many.
    """
    x0, y0, hx, hy = middle(0, m, px, py)
    limit = min(found.shape[1], _LISTED + _LISTED_MORE * m)
    level, slope_x, slope_y = level_and_slope(m, px, py, known, x0, y0)
    for a in range(n):
        dx = landmarks[seen[a], 0] - x0
        dy = landmarks[seen[a], 1] - y0
        key[seen[a]] = 1.0 / (dx * dx + dy * dy)
    strongest_first(n, seen, key, orders[STRONG], n_orders[STRONG], mark, order)
    orders[STRONG, :n] = order[:n]
    n_orders[STRONG] = n
    turn = place_landmarks(n, order, x0, y0, hx, hy, 0.0, 0.0, landmarks, survey, sensor, work)
    if few_are_strong(n, work, hx, hy, slope_x, slope_y, level, turn, sensor):
        count = strong_block_triplets(
            n, work, turn, hx, hy, slope_x, slope_y, level, sensor, found, sums, tops, limit
        )
    else:
        for a in range(n):
            dx = landmarks[seen[a], 0] - x0
            dy = landmarks[seen[a], 1] - y0
            key[seen[a]] = -azimuth_key(dx, dy)
        strongest_first(n, seen, key, orders[RING], n_orders[RING], mark, order)
        orders[RING, :n] = order[:n]
        n_orders[RING] = n
        turn = place_landmarks(n, order, x0, y0, hx, hy, slope_x, slope_y, landmarks, survey, sensor, work)
        count = block_triplets(
            n, work, turn, hx, hy, slope_x, slope_y, level, sensor, found, sums, tops, limit
        )
    if count < 0:
        return -1, 0, 0.0, 0.0, 0.0
    # Only landmarks that occur are looked at in the cells.
    slot = seen
    slot[:n] = -1
    n_ids = 0
    for c in range(count):
        for corner in range(3):
            a = found[corner, c]
            if slot[a] < 0:
                slot[a] = n_ids
                ids[n_ids] = order[a]
                n_ids += 1
            found[corner, c] = slot[a]
    return count, n_ids, known_share(turn, math.hypot(hx, hy), sensor), slope_x, slope_y


@njit(cache=True, nogil=True)
def shorten(
    first, last, px, py, known, x0, y0, slope_x, slope_y, loose, count, found, sums, tops, out, out_sums
):
    """Those of a list that may be best in cells (first … last - 1) into ``out``; their number."""
    level = np.inf
    for a in range(first, last):
        level = min(level, math.log(known[a]) - slope_x * (px[a] - x0) - slope_y * (py[a] - y0))
    # A landmark within the lever arm bounds nothing.
    level = level + math.log(loose) if loose > 0.0 else -np.inf
    x, y, hx, hy = middle(first, last, px, py)
    x -= x0
    y -= y0
    n = 0
    for c in range(count):
        out[0, n] = found[0, c]
        out[1, n] = found[1, c]
        out[2, n] = found[2, c]
        out_sums[n] = sums[c]
        kx = tops[1, c]
        ky = tops[2, c]
        n += tops[0, c] + kx * x + ky * y + abs(kx) * hx + abs(ky) * hy >= level
    return n


@njit(cache=True, nogil=True)
def _excess(count, found, sums, bar, cos_view, axis_need, flat, gx, gy, rho, out):
    """By how much D² of every triplet exceeds ``bar`` times its least pair sum; NaN: not visible.

    Negative where the outer two are not in one view, or D² under ``axis_need`` times all squared sides.
    """
    for step in range(count):
        c = np.uint64(step)
        a = np.uint64(found[0, c])
        b = np.uint64(found[1, c])
        e = np.uint64(found[2, c])
        xa = gx[a]
        ya = gy[a]
        d = (gx[b] - xa) * (gy[e] - ya) - (gy[b] - ya) * (gx[e] - xa)
        dot = xa * gx[e] + ya * gy[e]
        d *= d
        sides = 2.0 * (
            rho[a] * rho[a]
            + rho[b] * rho[b]
            + rho[e] * rho[e]
            - dot
            - gx[b] * (xa + gx[e])
            - gy[b] * (ya + gy[e])
        )
        # The larger eigenvalue is all of the trace when Σ is flat, half of it when round.
        whole = 1.0 + math.sqrt(max(0.0, 1.0 - flat * d / (sides * sides)))
        least = axis_need * sides * (whole if flat > 0.0 else 1.0)
        fits = dot >= cos_view * (rho[a] * rho[e]) and d >= least
        out[c] = d - bar * sums[c] if fits else -1.0


@njit(cache=True, nogil=True)
def _most_share(n, ids, x, y, landmarks, survey, sensor):
    """Largest variance that survey and floor add to the bearing of one of ``ids`` (n,) from (x, y)."""
    most = 0.0
    for a in range(n):
        i = ids[a]
        if survey[i] > 0.0:
            most = max(most, survey[i] / ((landmarks[i, 0] - x) ** 2 + (landmarks[i, 1] - y) ** 2))
    return most + sensor[FLOOR]


@njit(cache=True, nogil=True)
def compare_in_cell(
    x, y, words, known, first, count, n_ids, loose, landmarks, survey, sensor, found, sums, ids, gx, gy, rho,
    excess, best,
):  # fmt: skip
    """Best triplet of a list (see ``list_block``) seen from (x, y), ascending, into ``best`` (3,); its row.

    ``first`` is the row that was best in the cell before.
    """
    if count == 1:
        # Something is known, and nothing else can be it.
        best[0], best[1], best[2] = sorted_three(ids[found[0, 0]], ids[found[1, 0]], ids[found[2, 0]])
        return 0
    fixed = sensor[MODE] == FIXED
    if fixed:
        ahead_x = math.cos(sensor[HEADING])
        ahead_y = math.sin(sensor[HEADING])
        half = math.cos(0.5 * sensor[VIEW]) - FIT_TOLERANCE
    for a in range(n_ids):
        i = ids[a]
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        s = 1.0 / (dx * dx + dy * dy) if has_bit(words, i) else np.nan
        if fixed and not _is_ahead(dx, dy, ahead_x, ahead_y, half):
            s = np.nan
        gx[a] = dx * s
        gy[a] = dy * s
        rho[a] = math.sqrt(s)
    cos_view = sensor[COS_VIEW] - 2.0 * FIT_TOLERANCE if sensor[MODE] == CENTRED_FREE else -2.0
    best[:] = -1
    row = -1
    top = known * (1.0 - SLACK)
    value_first = 0.0
    if first >= 0:
        i = ids[found[0, first]]
        j = ids[found[1, first]]
        k = ids[found[2, first]]
        if has_bit(words, i) and has_bit(words, j) and has_bit(words, k):
            value_first = value_at(x, y, i, j, k, landmarks, survey, sensor)
            top = max(top, value_first * (1.0 - SLACK))
    bar = top * loose
    axis_need = 0.0
    flat = 0.0
    if sensor[CRITERION] != AREA and sensor[LEVER] == 0.0:
        low = sensor[ON_AXIS]
        if sensor[MODE] != OMNIDIRECTIONAL:
            low *= math.cos(0.5 * sensor[VIEW]) ** 4
        axis_need = 0.5 * math.sqrt(bar) * low * (1.0 - SLACK)
        if sensor[CRITERION] == MAX_AXIS:
            # 4 det / trace² is no more than this times D² / (sum of squared sides)².
            high = sensor[ON_AXIS] + _most_share(n_ids, ids, x, y, landmarks, survey, sensor)
            flat = 12.0 * high * high / (low * low)
    _excess(count, found, sums, bar, cos_view, axis_need, flat, gx, gy, rho, excess)
    for c in range(count):
        if not excess[c] >= 0.0:
            continue
        i = ids[found[0, c]]
        j = ids[found[1, c]]
        k = ids[found[2, c]]
        value = value_first if c == first else value_at(x, y, i, j, k, landmarks, survey, sensor)
        if value >= top:
            i, j, k = sorted_three(i, j, k)
            if value > top or best[0] < 0 or comes_before(i, j, k, best):
                top = value
                row = c
                best[0] = i
                best[1] = j
                best[2] = k
    return row
