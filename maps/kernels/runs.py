"""Painting runs of cells into bit masks.

Runs are rows ``[line, first, stop)`` of an int32 array, those of landmark i from ``offsets[i]`` on,
sorted by line; the runs of one landmark on one line do not overlap.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def first_run(runs, low, high, line):
    """First index in low … high whose run lies on ``line`` or after it; runs (K, 3) sorted by line."""
    while low < high:
        middle = (low + high) // 2
        if runs[middle, 0] < line:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def paint_runs(row_runs, row_offsets, col_runs, col_offsets, row0, col0, planes, out):
    """Bit i % 64 of out[r, c, i // 64] is set where a run of landmark i covers cell (row0 + r, col0 + c).

    Shapes (K, 3), (N + 1,), (K', 3), (N + 1,), scratch (2, h, w) uint64, out (h, w, n_words) uint64 zeros.
    Each run toggles its bit where it starts and behind its end; a running XOR then fills it.
    """
    n_landmarks = row_offsets.shape[0] - 1
    height, width, n_words = out.shape
    for word in range(n_words):
        any_row = False
        any_col = False
        for i in range(64 * word, min(64 * word + 64, n_landmarks)):
            bit = np.uint64(1) << np.uint64(i - 64 * word)
            last = row_offsets[i + 1]
            for k in range(first_run(row_runs, row_offsets[i], last, row0), last):
                row = row_runs[k, 0] - row0
                if row >= height:
                    break
                start = max(row_runs[k, 1] - col0, 0)
                stop = row_runs[k, 2] - col0
                if start >= width or stop <= start:
                    continue
                if not any_row:
                    planes[0, :, :] = 0
                    any_row = True
                planes[0, row, start] ^= bit
                if stop < width:
                    planes[0, row, stop] ^= bit
            last = col_offsets[i + 1]
            for k in range(first_run(col_runs, col_offsets[i], last, col0), last):
                col = col_runs[k, 0] - col0
                if col >= width:
                    break
                start = max(col_runs[k, 1] - row0, 0)
                stop = col_runs[k, 2] - row0
                if start >= height or stop <= start:
                    continue
                if not any_col:
                    planes[1, :, :] = 0
                    any_col = True
                planes[1, start, col] ^= bit
                if stop < height:
                    planes[1, stop, col] ^= bit
        if any_col:
            for r in range(1, height):
                for c in range(width):
                    planes[1, r, c] ^= planes[1, r - 1, c]
        if any_row:
            for r in range(height):
                bits = np.uint64(0)
                for c in range(width):
                    bits ^= planes[0, r, c]
                    out[r, c, word] = bits
        if any_col:
            for r in range(height):
                for c in range(width):
                    out[r, c, word] |= planes[1, r, c]
