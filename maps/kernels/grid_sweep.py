"""Sector shadow sweep: all cells of a target grid that one landmark sees, without a ray per cell.

A quarter plane ``|x| ≤ y`` as seen from the landmark is swept line by line (up and down; left and right on
the transposed grid). A sorted list of closed intervals of slopes x / y is kept, its ends being whole vectors
to corners of opaque cells. A target line is emitted when all lines nearer than it are blocked: the targets
whose slope lies in an interval, without those in, on or behind opaque cells of their own line. Blocking
subtracts the open interval of slopes that a run of opaque cells covers; an interval of a single slope is
dropped, for such a line of sight touches opaque cells on its left and on its right.

Everything is compared in whole numbers of lattice units (see ``grid_visibility``), hence exact. The lists of
opaque runs are ``lines`` (K, 2) int32, first column and column after the last, those of row r at
``offsets[r] … offsets[r + 1]``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from maps.kernels.grid_targets import SCALE, allowed_stretches, first_beyond, start_slopes
from maps.kernels.grid_visibility import clear_sight, touches_opaque


@njit(cache=True, nogil=True)
def opaque_lines(opaque, offsets, lines):
    """Count (lines empty) or list the opaque runs of each row; (n_rows, n_cols), (n_rows + 1,), (K, 2)."""
    n = 0
    for row in range(opaque.shape[0]):
        offsets[row] = n
        inside = False
        for col in range(opaque.shape[1]):
            if opaque[row, col] != inside:
                inside = not inside
                if inside:
                    n += 1
                    if lines.shape[0] > 0:
                        lines[n - 1, 0] = col
                        lines[n - 1, 1] = opaque.shape[1]
                elif lines.shape[0] > 0:
                    lines[n - 1, 1] = col
    offsets[opaque.shape[0]] = n
    return n


@njit(cache=True, nogil=True)
def _line(lines, offsets, row, window, corner_row, corner_col, scratch):
    """Opaque runs of a row for one landmark: an array and its first and last + 1 entry."""
    a = 0
    b = 0
    if 0 <= row < offsets.shape[0] - 1:
        a = offsets[row]
        b = offsets[row + 1]
    r = row - corner_row
    if r < 0 or r >= window.shape[0]:
        return lines, a, b
    # The window replaces a stretch of the row.
    n = 0
    right = corner_col + window.shape[1]
    for k in range(a, b):
        if lines[k, 0] < corner_col:
            scratch[n, 0] = lines[k, 0]
            scratch[n, 1] = min(lines[k, 1], corner_col)
            n += 1
    inside = False
    for c in range(window.shape[1] + 1):
        value = c < window.shape[1] and window[r, c]
        if value and not inside:
            scratch[n, 0] = corner_col + c
        if inside and not value:
            scratch[n, 1] = corner_col + c
            n += 1
        inside = value
    for k in range(a, b):
        if lines[k, 1] > right:
            scratch[n, 0] = max(lines[k, 0], right)
            scratch[n, 1] = lines[k, 1]
            n += 1
    return scratch, 0, n


@njit(cache=True, nogil=True)
def _block(intervals, spare, count, line, a, b, shift, lx, y0, y1):
    """Subtract what runs a … b - 1 at y0 … y1 above the landmark cover; returns both lists and the count."""
    need = count + b - a + 1
    if spare.shape[0] < need:
        spare = np.empty((2 * need, 4), dtype=np.int64)
    # The slopes where runs end rise: skip those that end before the first interval.
    p = a
    stop = b
    while p < stop:
        middle = (p + stop) // 2
        x1 = (int(line[middle, 1]) << shift) - lx
        if x1 * intervals[0, 1] <= intervals[0, 0] * (y0 if x1 > 0 else y1):
            p = middle + 1
        else:
            stop = middle
    n = 0
    for t in range(count):
        num = intervals[t, 0]
        den = intervals[t, 1]
        end_num = intervals[t, 2]
        end_den = intervals[t, 3]
        while p < b:
            x1 = (int(line[p, 1]) << shift) - lx
            if x1 * den > num * (y0 if x1 > 0 else y1):
                break
            p += 1
        open_end = True
        for k in range(p, b):
            x0 = (int(line[k, 0]) << shift) - lx
            d0 = y0 if x0 < 0 else y1
            if x0 * end_den >= end_num * d0:
                break
            if x0 * den > num * d0:
                spare[n, 0] = num
                spare[n, 1] = den
                spare[n, 2] = x0
                spare[n, 3] = d0
                n += 1
            x1 = (int(line[k, 1]) << shift) - lx
            d1 = y0 if x1 > 0 else y1
            if x1 * den > num * d1:
                num = x1
                den = d1
            if num * end_den >= end_num * den:
                open_end = False
                break
        if open_end:
            spare[n, 0] = num
            spare[n, 1] = den
            spare[n, 2] = end_num
            spare[n, 3] = end_den
            n += 1
    return spare, intervals, n


@njit(cache=True, nogil=True)
def _add_run(runs, n, line, first, stop):
    """Append [line, first, stop) to runs (·, 3), which grows when it is full."""
    if n == runs.shape[0]:
        bigger = np.empty((2 * n, 3), dtype=np.int32)
        bigger[:n] = runs
        runs = bigger
    runs[n, 0] = line
    runs[n, 1] = first
    runs[n, 2] = stop
    return runs


@njit(cache=True, nogil=True)
def _emit(
    runs, n, i, j0, j1, tx, py, inverse, line, a, b, y, near,
    opaque, window, corner_row, corner_col, shift, lx, ly,
):  # fmt: skip
    """Append targets j0 … j1 of line i without those in, on or behind opaque runs a … b - 1 of that line.

    The line of sight enters the row of the targets ``near`` units above the landmark and ends at ``y``; on
    that way it is less than a cell wide, hence only the runs beside a target can hide it.
    """
    unit = 1 << shift
    k = a
    stop = b
    while k < stop:
        middle = (k + stop) // 2
        if (int(line[middle, 1]) << shift) + unit <= tx[j0]:
            k = middle + 1
        else:
            stop = middle
    start = j0
    while k < b and start <= j1:
        left = int(line[k, 0]) << shift
        right = int(line[k, 1]) << shift
        k += 1
        if left - unit >= tx[j1]:
            break
        first = first_beyond(tx, inverse, 0, left, 1, 1, 0)
        while first > start and tx[first - 1] < lx:
            order = (tx[first - 1] - lx) * near - (left - lx) * y
            if order < 0:
                break
            if order == 0 and clear_sight(
                opaque, window, corner_row, corner_col, shift, lx, ly, tx[first - 1], py
            ):
                break
            first -= 1
        last = first_beyond(tx, inverse, 0, right, 1, 1, 1) - 1
        while last < j1 and tx[last + 1] > lx:
            order = (right - lx) * y - (tx[last + 1] - lx) * near
            if order < 0:
                break
            if order == 0 and clear_sight(
                opaque, window, corner_row, corner_col, shift, lx, ly, tx[last + 1], py
            ):
                break
            last += 1
        if first > last:
            continue
        if first > start:
            runs = _add_run(runs, n, i, start, min(first, j1 + 1))
            n += 1
        start = max(start, last + 1)
    if start <= j1:
        runs = _add_run(runs, n, i, start, j1 + 1)
        n += 1
    return runs, n


@njit(cache=True, nogil=True)
def _sweep(
    runs, n, lines, offsets, opaque, window, corner_row, corner_col, shift, lx, ly, mx, my,
    tx, ty, gx, gy, low2, high2, mode, a1, b1, a2, b2, strict, down, scratch,
):  # fmt: skip
    """Append the runs of one sector, upwards or downwards."""
    n_rows = opaque.shape[0]
    top = n_rows << shift
    y_landmark = ly
    if down:
        y_landmark = top - ly
        b1 = -b1
        b2 = -b2
    low, high = start_slopes(mode, a1, b1, a2, b2)
    if low >= high:
        return runs, n
    intervals = np.empty((64, 4), dtype=np.int64)
    spare = np.empty((64, 4), dtype=np.int64)
    intervals[0, 0] = low
    intervals[0, 1] = SCALE
    intervals[0, 2] = high
    intervals[0, 3] = SCALE
    count = np.int64(1)  # a plain 1 would compile all of this twice
    pieces = np.empty((4, 2), dtype=np.int64)
    n_lines = ty.shape[0]
    inverse = (tx.shape[0] - 1) / float(tx[-1] - tx[0]) if tx.shape[0] > 1 else 0.0
    unit = 1 << shift
    row = y_landmark >> shift
    for step in range(n_lines):
        i = n_lines - 1 - step if down else step
        y_target = top - ty[i] if down else ty[i]
        y = y_target - y_landmark
        if y <= 0:
            continue
        dy2 = (gy[i] - my) ** 2
        if dy2 > high2:
            break
        last = y_target >> shift
        while row < last:
            actual = n_rows - 1 - row if down else row
            line, a, b = _line(lines, offsets, actual, window, corner_row, corner_col, scratch)
            if b > a:
                y0 = max((row << shift) - y_landmark, 0)
                y1 = ((row + 1) << shift) - y_landmark
                intervals, spare, count = _block(intervals, spare, count, line, a, b, shift, lx, y0, y1)
                if count == 0:
                    return runs, n
            row += 1
        n_pieces = allowed_stretches(
            pieces, tx, inverse, lx, y, gx, mx, dy2, low2, high2, mode, a1, b1, a2, b2, strict
        )
        near = max((last << shift) - y_landmark, 0)
        on_edge = (y_target & (unit - 1)) == 0
        actual = n_rows - 1 - last if down else last
        line, a, b = _line(lines, offsets, actual, window, corner_row, corner_col, scratch)
        for t in range(count):
            first = first_beyond(tx, inverse, lx, intervals[t, 0], intervals[t, 1], y, 0)
            final = first_beyond(tx, inverse, lx, intervals[t, 2], intervals[t, 3], y, 1) - 1
            for s in range(n_pieces):
                j0 = max(first, pieces[s, 0])
                j1 = min(final, pieces[s, 1])
                # On a line between rows, a target at the end of an interval may touch the row before it.
                if on_edge and j0 <= j1:
                    if touches_opaque(opaque, window, corner_row, corner_col, shift, tx[j0], ty[i]):
                        j0 += 1
                    if j0 <= j1 and touches_opaque(
                        opaque, window, corner_row, corner_col, shift, tx[j1], ty[i]
                    ):
                        j1 -= 1
                if j0 <= j1:
                    runs, n = _emit(
                        runs, n, i, j0, j1, tx, ty[i], inverse, line, a, b, y, near,
                        opaque, window, corner_row, corner_col, shift, lx, ly,
                    )  # fmt: skip
    return runs, n


@njit(cache=True, nogil=True)
def sweep_landmark(
    lines, offsets, opaque, window, corner_row, corner_col, shift, lx, ly, mx, my,
    tx, ty, gx, gy, low2, high2, mode, a1, b1, a2, b2, strict,
):  # fmt: skip
    """Runs (n, 3) of the targets with |x| ≤ |y| (strict: <) that a landmark sees, as line, first, stop.

    Given are the opaque runs and the grid (n_rows, n_cols); the landmark's window; its place on the lattice
    and in m; targets on the lattice, tx (n,), ty (m,), and in m, gx, gy; squared ranges in m²; facing forms
    as for ``in_cone``. On the transposed grid all is swapped and ``strict`` is 1: no cell comes twice.
    """
    longest = 0
    for row in range(offsets.shape[0] - 1):
        longest = max(longest, offsets[row + 1] - offsets[row])
    scratch = np.empty((longest + window.shape[1] + 2, 2), dtype=np.int32)
    runs = np.empty((256, 3), dtype=np.int32)
    n = np.int64(0)
    for down in (False, True):
        runs, n = _sweep(
            runs, n, lines, offsets, opaque, window, corner_row, corner_col, shift, lx, ly, mx, my,
            tx, ty, gx, gy, low2, high2, mode, a1, b1, a2, b2, strict, down, scratch,
        )  # fmt: skip
    return runs[:n].copy()
