"""Exact integral of a piecewise constant rate along straight lines, and the exact clearance beside it.

``rate`` (ny, nx) is the cost per metre of each cell, inf where forbidden; ``transform`` (5,): corner of
cell (0, 0) in W, cosine and sine of the grid's yaw, side of a cell, m; ``need``: clearance that the
robot's centre must keep, m; the rest are the arrays of ``maps.clearance.ClearanceIndex``.

One rule for borders: a line that runs along the border of two cells has the larger of the two rates; a
line through a corner touches only the cells that it enters. Coordinates within 1e-9 cells of a border
are on it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.kernels.clearance import segment_distance

# Cells: closer than this to a border is on the border.
_EPS = 1e-9


@njit(cache=True, nogil=True)
def _snap(v):
    """The nearest integer when v is within 1e-9 of it, else v."""
    nearest = math.floor(v + 0.5)
    return nearest if abs(v - nearest) < _EPS else v


@njit(cache=True, nogil=True)
def _rate_at(row, col, rate):
    """Rate of a cell; inf outside the grid."""
    if row < 0 or col < 0 or row >= rate.shape[0] or col >= rate.shape[1]:
        return math.inf
    return rate[row, col]


@njit(cache=True, nogil=True)
def point_rate(x, y, rate):
    """Smallest rate (ny, nx) of the cells that meet at a place given in cells (column, row)."""
    x = _snap(x)
    y = _snap(y)
    best = math.inf
    for row in (math.ceil(y) - 1, math.floor(y)):
        for col in (math.ceil(x) - 1, math.floor(x)):
            best = min(best, _rate_at(int(row), int(col), rate))
    return best


@njit(cache=True, nogil=True)
def walk(x0, y0, x1, y1, rate, pieces):
    """Integral of rate (ny, nx) along a line given in cells, and how many pieces it has.

    ``pieces`` is None, or (K, 5) to fill with row, column, row and column of the other cell (the same
    one but on borders), and length in cells. Without it the walk ends at the first forbidden cell.
    """
    x0 = _snap(x0)
    y0 = _snap(y0)
    x1 = _snap(x1)
    y1 = _snap(y1)
    dx = x1 - x0
    dy = y1 - y0
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return (0.0 if point_rate(x0, y0, rate) < math.inf else math.inf), 0
    step_col = 1 if dx > 0.0 else -1
    step_row = 1 if dy > 0.0 else -1
    col = int(math.floor(x0) if dx >= 0.0 else math.ceil(x0) - 1)
    row = int(math.floor(y0) if dy >= 0.0 else math.ceil(y0) - 1)
    beside_col = col - 1 if dx == 0.0 and x0 == col else col
    beside_row = row - 1 if dy == 0.0 and y0 == row else row
    on_border = beside_col != col or beside_row != row
    eps = _EPS / length
    total = 0.0
    count = 0
    t = 0.0
    while True:
        t_col = math.inf
        t_row = math.inf
        if dx != 0.0:
            t_col = (col + (1 if dx > 0.0 else 0) - x0) / dx
        if dy != 0.0:
            t_row = (row + (1 if dy > 0.0 else 0) - y0) / dy
        t_next = min(t_col, t_row, 1.0)
        if t_next > t:
            here = _rate_at(row, col, rate)
            if on_border:
                here = max(here, _rate_at(beside_row, beside_col, rate))
            total += (t_next - t) * length * here
            if pieces is not None:
                pieces[count, 0] = row
                pieces[count, 1] = col
                pieces[count, 2] = beside_row
                pieces[count, 3] = beside_col
                pieces[count, 4] = (t_next - t) * length
            elif here == math.inf:
                return math.inf, 0
            count += 1
            t = t_next
        if t_next >= 1.0:
            return total, count
        # Both at once at a corner: the cells beside it are not entered.
        if t_col <= t_next + eps:
            col += step_col
            beside_col += step_col
        if t_row <= t_next + eps:
            row += step_row
            beside_row += step_row


@njit(cache=True, nogil=True)
def motion_rate_cost(x0, y0, x1, y1, rate, transform):
    """Cost of a straight motion in W by the rates (ny, nx) alone, whatever its clearance."""
    c = transform[2]
    s = transform[3]
    cell = transform[4]
    ax = x0 - transform[0]
    ay = y0 - transform[1]
    bx = x1 - transform[0]
    by = y1 - transform[1]
    cost, _ = walk(
        (c * ax + s * ay) / cell,
        (c * ay - s * ax) / cell,
        (c * bx + s * by) / cell,
        (c * by - s * bx) / cell,
        rate,
        None,
    )
    return cost * cell


@njit(cache=True, nogil=True)
def motion_cost(
    x0, y0, x1, y1, rate, transform, need, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
):
    """Cost of a straight motion in W; inf when it enters a forbidden cell or comes too close."""
    cost = motion_rate_cost(x0, y0, x1, y1, rate, transform)
    if cost == math.inf:
        return cost
    kept = segment_distance(
        x0, y0, x1, y1, need, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
    )
    return cost if kept >= need else math.inf


@njit(cache=True, nogil=True)
def polyline_cost(
    points, rate, transform, need, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
):
    """Cost of a polyline (K, 2) in W; inf when it enters a forbidden cell or comes too close."""
    if points.shape[0] == 1:
        x = points[0, 0]
        y = points[0, 1]
        return motion_cost(
            x, y, x, y, rate, transform, need, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
        )
    total = 0.0
    for k in range(points.shape[0] - 1):
        total += motion_cost(
            points[k, 0],
            points[k, 1],
            points[k + 1, 0],
            points[k + 1, 1],
            rate,
            transform,
            need,
            segments,
            bucket_start,
            bucket_items,
            bucket_gap,
            bucket_grid,
        )
        if total == math.inf:
            break
    return total


@njit(cache=True, nogil=True)
def motions_cost(
    queries, out, rate, transform, need, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
):
    """Costs of straight motions (N, 4) in W into ``out`` (N,)."""
    for i in range(queries.shape[0]):
        out[i] = motion_cost(
            queries[i, 0],
            queries[i, 1],
            queries[i, 2],
            queries[i, 3],
            rate,
            transform,
            need,
            segments,
            bucket_start,
            bucket_items,
            bucket_gap,
            bucket_grid,
        )


@njit(cache=True, nogil=True)
def polyline_pieces(cells, rate):
    """Pieces of a polyline given in cells (K, 2): (M, 6) row, col, other row, other col, length, segment."""
    room = 0
    for k in range(cells.shape[0] - 1):
        room += int(abs(cells[k + 1, 0] - cells[k, 0]) + abs(cells[k + 1, 1] - cells[k, 1])) + 5
    out = np.empty((room, 6))
    n = 0
    for k in range(cells.shape[0] - 1):
        _, count = walk(cells[k, 0], cells[k, 1], cells[k + 1, 0], cells[k + 1, 1], rate, out[n:, :5])
        out[n : n + count, 5] = k
        n += count
    return out[:n].copy()
