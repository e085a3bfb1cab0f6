"""Cells of a grid that a landmark sees: its sectors painted row by row, exact at their rims.

``frame`` (5,) is the grid: corner x, y in W in m, cosine and sine of its yaw, side of a cell in m;
``lattice`` (3,) is the lattice: its corner in W in m, units per m. A cell is judged at its centre, rounded to
the lattice.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.kernels.vector_sectors import find_sectors, gather_edges
from maps.kernels.vector_visibility import in_range

# Lattice units by which a rounded centre may be off, with room for the rounding of doubles.
_SURE = 1.0
_LEVEL = 1e-9


@njit(cache=True, nogil=True)
def cell_centre(frame, row, col):
    """Centre of a cell in W, m, to the last bit as GridFrame.to_world gives it; (5,)."""
    gx = (col + 0.5) * frame[4]
    gy = (row + 0.5) * frame[4]
    return frame[0] + frame[2] * gx - frame[3] * gy, frame[1] + frame[3] * gx + frame[2] * gy


@njit(cache=True, nogil=True)
def _at_least(offset, step, level, low, high):
    """Part of low … high where offset + step · c ≥ level."""
    if abs(step) < _LEVEL:
        return (low, high) if offset >= level else (1.0, 0.0)
    c = (level - offset) / step
    if step > 0.0:
        return max(low, c), high
    return low, min(high, c)


@njit(cache=True, nogil=True)
def _row_limits(frame, lattice, extent, mx, my, high2, row0, n_rows, n_cols, low, high):
    """Columns low … high (n_rows,) within range and on the plan, from row0 on; first and last such row."""
    first = n_rows
    last = -1
    step_x = frame[2] * frame[4]
    step_y = frame[3] * frame[4]
    slack = 2.0 / lattice[2]
    for row in range(row0, n_rows):
        bx, by = cell_centre(frame, row, 0)
        a, b = _at_least(bx - lattice[0] + slack, step_x, 0.0, 0.0, n_cols - 1.0)
        a, b = _at_least(lattice[0] + extent[0] / lattice[2] + slack - bx, -step_x, 0.0, a, b)
        a, b = _at_least(by - lattice[1] + slack, step_y, 0.0, a, b)
        a, b = _at_least(lattice[1] + extent[1] / lattice[2] + slack - by, -step_y, 0.0, a, b)
        if high2 < math.inf:
            across = frame[2] * (my - by) - frame[3] * (mx - bx)
            half2 = high2 * (1.0 + 1e-9) - across * across
            if half2 < 0.0:
                b = -1.0
            else:
                along = (frame[2] * (mx - bx) + frame[3] * (my - by)) / frame[4]
                half = math.sqrt(half2) / frame[4] + 1e-6
                a = max(a, along - half)
                b = min(b, along + half)
        c0 = 1
        c1 = 0
        if a <= b:
            c0 = math.ceil(a)
            c1 = math.floor(b)
        if high2 < math.inf:
            while c0 <= c1:
                x, y = cell_centre(frame, row, c0)
                if (x - mx) ** 2 + (y - my) ** 2 <= high2:
                    break
                c0 += 1
            while c0 <= c1:
                x, y = cell_centre(frame, row, c1)
                if (x - mx) ** 2 + (y - my) ** 2 <= high2:
                    break
                c1 -= 1
        low[row] = c0
        high[row] = c1
        if c0 <= c1:
            first = min(first, row)
            last = row
    return first, last


@njit(cache=True, nogil=True)
def _cell_in_sector(frame, lattice, row, col, lx, ly, v0x, v0y, v1x, v1y, ax, ay, bx, by):
    """Whether the rounded centre of a cell lies in the closed triangle between two rays and an edge."""
    x, y = cell_centre(frame, row, col)
    px = np.int64(np.rint((x - lattice[0]) * lattice[2])) - lx
    py = np.int64(np.rint((y - lattice[1]) * lattice[2])) - ly
    if v0x * py - v0y * px < 0 or v1x * py - v1y * px > 0:
        return False
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax) >= 0


@njit(cache=True, nogil=True)
def _paint_sector(
    frame, lattice, lx, ly, l_row, v0x, v0y, v1x, v1y, ax, ay, bx, by, low, high, first, last, mask
):
    """Set the cells of one sector in mask (h, w), whose first row is ``first``."""
    scale = frame[4] * lattice[2]
    wx = float(bx - ax)
    wy = float(by - ay)
    # Rows between the three corners of the triangle: L and where the rays meet the edge.
    side = float(ax * by - ay * bx)
    t0 = side / float(v0x * (by - ay) - v0y * (bx - ax))
    t1 = side / float(v1x * (by - ay) - v1y * (bx - ax))
    row0 = l_row + t0 * (frame[2] * v0y - frame[3] * v0x) / scale
    row1 = l_row + t1 * (frame[2] * v1y - frame[3] * v1x) / scale
    slack = 2.0 / scale + 1e-6
    begin = max(float(first), math.ceil(min(l_row, row0, row1) - slack))
    end = min(float(last), math.floor(max(l_row, row0, row1) + slack))
    if begin > end:
        return
    length0 = math.hypot(float(v0x), float(v0y))
    length1 = math.hypot(float(v1x), float(v1y))
    length2 = math.hypot(wx, wy)
    n0x, n0y = -v0y / length0, v0x / length0
    n1x, n1y = v1y / length1, -v1x / length1
    n2x, n2y = -wy / length2, wx / length2
    ux = frame[2] * scale
    uy = frame[3] * scale
    d0 = n0x * ux + n0y * uy
    d1 = n1x * ux + n1y * uy
    d2 = n2x * ux + n2y * uy
    for row in range(int(begin), int(end) + 1):
        if low[row] > high[row]:
            continue
        x, y = cell_centre(frame, row, 0)
        px = (x - lattice[0]) * lattice[2] - lx
        py = (y - lattice[1]) * lattice[2] - ly
        g0 = n0x * px + n0y * py
        g1 = n1x * px + n1y * py
        g2 = n2x * (px - ax) + n2y * (py - ay)
        a, b = _at_least(g0, d0, -_SURE, float(low[row]), float(high[row]))
        a, b = _at_least(g1, d1, -_SURE, a, b)
        a, b = _at_least(g2, d2, -_SURE, a, b)
        if a > b:
            continue
        c0 = math.ceil(a)
        c1 = math.floor(b)
        if c0 > c1:
            continue
        a, b = _at_least(g0, d0, _SURE, a, b)
        a, b = _at_least(g1, d1, _SURE, a, b)
        a, b = _at_least(g2, d2, _SURE, a, b)
        s0 = c1 + 1
        s1 = c1
        if a <= b and math.ceil(a) <= math.floor(b):
            s0 = math.ceil(a)
            s1 = math.floor(b)
            mask[row - first, s0 : s1 + 1] = 1
        for col in range(c0, s0):
            if _cell_in_sector(frame, lattice, row, col, lx, ly, v0x, v0y, v1x, v1y, ax, ay, bx, by):
                mask[row - first, col] = 1
        for col in range(s1 + 1, c1 + 1):
            if _cell_in_sector(frame, lattice, row, col, lx, ly, v0x, v0y, v1x, v1y, ax, ay, bx, by):
                mask[row - first, col] = 1


@njit(cache=True, nogil=True)
def _take_runs(mask, first, low, high, runs):
    """Count (runs empty) or list the stretches of set cells as row, first column, column after the last."""
    k = 0
    for r in range(mask.shape[0]):
        row = first + r
        col = low[row]
        while col <= high[row]:
            if not mask[r, col]:
                col += 1
                continue
            begin = col
            while col <= high[row] and mask[r, col]:
                col += 1
            if runs.shape[0] > 0:
                runs[k, 0] = row
                runs[k, 1] = begin
                runs[k, 2] = col
            k += 1
    return k


@njit(cache=True, nogil=True)
def _clear_own_place(frame, mx, my, first, mask):
    """Unset the cells whose centres are the landmark's own place."""
    dx = mx - frame[0]
    dy = my - frame[1]
    row = math.floor((frame[2] * dy - frame[3] * dx) / frame[4])
    col = math.floor((frame[2] * dx + frame[3] * dy) / frame[4])
    for r in range(max(row - 1, first), min(row + 2, first + mask.shape[0])):
        for c in range(max(col - 1, 0), min(col + 2, mask.shape[1])):
            x, y = cell_centre(frame, r, c)
            if not in_range(x - mx, y - my, math.inf):
                mask[r - first, c] = 0


@njit(cache=True, nogil=True)
def scan_landmark(
    edges, extent, lx, ly, cone, span, mx, my, max_range, high2, frame, lattice, row0, n_rows, n_cols
):
    """Runs (K, 3) int32 of the cells that see the landmark at lattice place (lx, ly), surveyed at (mx, my) m.

    ``edges`` (M, 4) and ``extent`` (2,), the plan's size, on the lattice; ``cone`` (4,) start and end. The
    rows are row0 … n_rows - 1.
    """
    low = np.empty(n_rows, dtype=np.int64)
    high = np.empty(n_rows, dtype=np.int64)
    first, last = _row_limits(frame, lattice, extent, mx, my, high2, row0, n_rows, n_cols, low, high)
    if first > last:
        return np.empty((0, 3), dtype=np.int32)
    near = np.empty((edges.shape[0] + 4, 4), dtype=np.int64)
    reach = (max_range + 1e-3) * lattice[2]
    n = gather_edges(edges, lx, ly, reach, max(extent[0], extent[1]) + 8, near)
    directions, ids = find_sectors(near, n, cone[0], cone[1], cone[2], cone[3], span)
    mask = np.zeros((last - first + 1, n_cols), dtype=np.uint8)
    dx = lx / lattice[2] + lattice[0] - frame[0]
    dy = ly / lattice[2] + lattice[1] - frame[1]
    l_row = (frame[2] * dy - frame[3] * dx) / frame[4] - 0.5
    for k in range(ids.shape[0]):
        e = ids[k]
        if e < 0:
            continue
        v0x, v0y = directions[k, 0], directions[k, 1]
        v1x, v1y = directions[k + 1, 0], directions[k + 1, 1]
        ax, ay, bx, by = near[e, 0], near[e, 1], near[e, 2], near[e, 3]
        _paint_sector(
            frame, lattice, lx, ly, l_row, v0x, v0y, v1x, v1y, ax, ay, bx, by, low, high, first, last, mask
        )
    _clear_own_place(frame, mx, my, first, mask)
    runs = np.empty((0, 3), dtype=np.int32)
    count = _take_runs(mask, first, low, high, runs)
    runs = np.empty((count, 3), dtype=np.int32)
    if count > 0:
        _take_runs(mask, first, low, high, runs)
    return runs
