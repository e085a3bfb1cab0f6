"""Best triplets of a tile of cells: blocks of neighbours together where that pays, the others one by one.

What a cell gets depends on its own place and mask alone; how it is found, on what was found nearby.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from localization.kernels.block_known import best_seed, know_block, raise_known
from localization.kernels.block_search import (
    compare_in_cell,
    count_visible,
    list_block,
    middle,
    shorten,
    together,
)
from localization.kernels.blocks import N_ROWS
from localization.kernels.cell_search import (
    GX,
    GY,
    KEY,
    N_KNOWN,
    N_WORK,
    NEWEST,
    ORDER,
    RHO,
    remember,
    search_cell,
)
from localization.kernels.few import search_few
from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    CRITERION,
    FIXED,
    FLOOR,
    LEVER,
    LEVER_X,
    LEVER_Y,
    MODE,
    N_MUTED,
    OMNIDIRECTIONAL,
)

# Triplets remembered from cells nearby.
_N_SEEDS = 16
# Cells along a block's side, fewest cells that are searched together, most triplets listed for them.
_BLOCK = 8
_FEWEST = 4
_MOST = 4096
# Most triplets known in a block.
_POOL = 10
# Lists longer than this are shortened for every quarter of a block.
_LONG = 16


@njit(cache=True, nogil=True)
def _gather(top, left, block, free, done, centres, sensor, rows, cols, px, py):
    """Cells of a block still to be searched, quarter by quarter, and where the sensor is; their number."""
    m = 0
    half = block // 2
    for quarter in range(4):
        r0 = top + half * (quarter // 2)
        c0 = left + half * (quarter % 2)
        for row in range(r0, min(r0 + half, free.shape[0])):
            for col in range(c0, min(c0 + half, free.shape[1])):
                if not free[row, col] or done[row, col]:
                    continue
                rows[m] = row
                cols[m] = col
                # The sensor stands a lever arm away: (LEVER_Y, -LEVER_X) from the robot's centre.
                px[m] = centres[row, col, 0] + sensor[LEVER_Y]
                py[m] = centres[row, col, 1] - sensor[LEVER_X]
                m += 1
    return m


@njit(cache=True, nogil=True)
def _put(row, col, best, n, out_triplet, out_n_visible, done):
    """The result of a cell."""
    out_n_visible[row, col] = n
    out_triplet[row, col, 0] = best[0]
    out_triplet[row, col, 1] = best[1]
    out_triplet[row, col, 2] = best[2]
    done[row, col] = True


@njit(cache=True, nogil=True)
def search_tile(centres, free, masks, landmarks, survey, has_survey, sensor, out_triplet, out_n_visible):
    """Best triplet of every free cell of a tile, and how many landmarks it sees; see ``field_tile``."""
    done = np.zeros(free.shape, dtype=np.bool_)
    plain = sensor[N_MUTED] == 0.0 and not has_survey and sensor[FLOOR] == 0.0 and sensor[LEVER] == 0.0
    left = 1
    if plain and sensor[MODE] in (OMNIDIRECTIONAL, CENTRED_FREE, FIXED):
        left = search_few(centres, free, masks, landmarks, sensor, out_triplet, out_n_visible, done)
    if left > 0:
        _search_rest(
            centres, free, masks, landmarks, survey, has_survey, sensor, out_triplet, out_n_visible, done
        )


@njit(cache=True, nogil=True)
def _search_rest(
    centres, free, masks, landmarks, survey, has_survey, sensor, out_triplet, out_n_visible, done
):
    """Cells that are not done: blocks where that pays, then one by one."""
    h, w = free.shape
    n_all = landmarks.shape[0]
    mode = sensor[MODE]
    hull_only = mode == OMNIDIRECTIONAL and not (
        has_survey or sensor[CRITERION] != AREA or sensor[LEVER] > 0.0
    )
    in_blocks = mode in (OMNIDIRECTIONAL, CENTRED_FREE, FIXED) and not hull_only
    in_blocks = in_blocks and sensor[N_MUTED] == 0.0 and n_all >= 3 and h * w >= _FEWEST
    work = np.zeros((N_WORK, 2 * n_all + 1))
    orders = np.zeros((6, n_all + 1), dtype=np.int64)
    mark = np.zeros(n_all, dtype=np.int8)
    seeds = np.empty((_N_SEEDS, 3), dtype=np.int64)
    state = np.zeros(5, dtype=np.int64)
    state[NEWEST] = _N_SEEDS - 1
    best = np.empty(3, dtype=np.int64)
    # Of blocks.
    size = _BLOCK * _BLOCK if in_blocks else 0
    rows = np.empty(size, dtype=np.int64)
    cols = np.empty(size, dtype=np.int64)
    px = np.empty(size)
    py = np.empty(size)
    known = np.empty(size)
    by = np.empty(size, dtype=np.int64)
    settled = np.empty(size, dtype=np.bool_)
    pool = np.empty((_POOL, 3), dtype=np.int64)
    block_orders = np.zeros((2, n_all), dtype=np.int64)
    n_orders = np.zeros(2, dtype=np.int64)
    sure = np.zeros(masks.shape[2], dtype=np.uint64)
    block_work = np.empty((N_ROWS, 2 * n_all if in_blocks else 0))
    most = _MOST if in_blocks else 0
    found = np.empty((3, most), dtype=np.int64)
    sums = np.empty(most)
    tops = np.empty((3, most))
    short = np.empty((3, most), dtype=np.int64)
    short_sums = np.empty(most)
    excess = np.empty(most)
    ids = np.empty(n_all, dtype=np.int64)
    gx = work[GX]
    gy = work[GY]
    rho = work[RHO]
    seen = np.empty(n_all, dtype=np.int64)
    block = _BLOCK if in_blocks else 1
    while block > 1:
        for place in range(-(-h // block) * -(-w // block)):
            top = block * (place // -(-w // block))
            left = block * (place % -(-w // block))
            m = _gather(top, left, block, free, done, centres, sensor, rows, cols, px, py)
            if m < _FEWEST:
                continue
            x0, y0, hx, hy = middle(0, m, px, py)
            n = together(m, rows, cols, masks, x0, y0, hx, hy, landmarks, sensor, seen, sure)
            if n < 3:
                continue
            if state[N_KNOWN] == 0:
                # Any good triplet will do, and the best by area is found fastest.
                by_area = sensor.copy()
                by_area[CRITERION] = AREA
                search_cell(
                    px[0], py[0], masks[rows[0], cols[0]], landmarks, survey, by_area, hull_only, work,
                    orders, mark, seeds, state, False, best,
                )  # fmt: skip
            know_block(
                m, rows, cols, px, py, known, by, settled, pool, masks, n, seen, landmarks,
                survey, sensor, seeds, state, work, orders, mark, best,
            )  # fmt: skip
            kept = 0
            for a in range(m):
                value = known[a]
                words = masks[rows[a], cols[a]]
                if value == 0.0:
                    _, value = best_seed(
                        px[a], py[a], words, seeds, state[N_KNOWN], landmarks, survey, sensor
                    )
                if value > 0.0:
                    known[kept] = value
                    rows[kept] = rows[a]
                    cols[kept] = cols[a]
                    px[kept] = px[a]
                    py[kept] = py[a]
                    kept += 1
                    continue
                n = search_cell(
                    px[a], py[a], words, landmarks, survey, sensor, hull_only, work, orders, mark, seeds,
                    state, False, best,
                )  # fmt: skip
                _put(rows[a], cols[a], best, n, out_triplet, out_n_visible, done)
            if kept < _FEWEST:
                continue
            x0, y0, hx, hy = middle(0, kept, px, py)
            n = together(kept, rows, cols, masks, x0, y0, hx, hy, landmarks, sensor, seen, sure)
            count, n_ids, loose, slope_x, slope_y = list_block(
                n, kept, px, py, known, landmarks, survey, sensor, block_orders, n_orders, mark, seen,
                orders[ORDER], work[KEY], block_work, found, sums, tops, ids,
            )  # fmt: skip
            if count < 0:
                continue
            for quarter in range(4):
                first = (kept * quarter) // 4
                end = (kept * (quarter + 1)) // 4
                shortened = count > _LONG
                rest = count
                if shortened:
                    a = (first + end) // 2
                    compare_in_cell(
                        px[a], py[a], masks[rows[a], cols[a]], known[a], -1, count, n_ids, loose, landmarks,
                        survey, sensor, found, sums, ids, gx, gy, rho, excess, best,
                    )  # fmt: skip
                    if best[0] >= 0:
                        remember(best, seeds, state)
                        raise_known(
                            first, end, rows, cols, px, py, known, by, 0, masks, best, landmarks, survey,
                            sensor,
                        )  # fmt: skip
                    rest = shorten(
                        first, end, px, py, known, x0, y0, slope_x, slope_y, loose, count, found, sums, tops,
                        short, short_sums,
                    )  # fmt: skip
                row = -1
                for a in range(first, end):
                    words = masks[rows[a], cols[a]]
                    row = compare_in_cell(
                        px[a], py[a], words, known[a], row, rest, n_ids, loose, landmarks, survey, sensor,
                        short if shortened else found, short_sums if shortened else sums, ids, gx, gy, rho,
                        excess, best,
                    )  # fmt: skip
                    if row >= 0:
                        n = count_visible(px[a], py[a], words, sure, landmarks, sensor)
                        _put(rows[a], cols[a], best, n, out_triplet, out_n_visible, done)
                if row >= 0:
                    remember(best, seeds, state)
        block //= 2
    for row in range(h):
        for col in range(w):
            if free[row, col] and not done[row, col]:
                x = centres[row, col, 0] + sensor[LEVER_Y]
                y = centres[row, col, 1] - sensor[LEVER_X]
                n = search_cell(
                    x, y, masks[row, col], landmarks, survey, sensor, hull_only, work, orders, mark, seeds,
                    state, False, best,
                )  # fmt: skip
                _put(row, col, best, n, out_triplet, out_n_visible, done)
