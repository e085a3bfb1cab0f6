"""Distance to the nearest of many segments, bucketed on a regular grid.

All queries take the arrays of ``ClearanceIndex.arrays``: ``segments`` (M, 4) in W; ``bucket_start``
(ny, nx + 1) and ``bucket_items`` (K,), the segments that touch each bucket, so that a run of buckets in
one row is one run of items; ``bucket_gap`` (ny, nx), rings of buckets around each that are empty;
``grid`` (3,): corner of bucket (0, 0) in W and side of a bucket, m. Inputs must be finite.
"""

from __future__ import annotations

import math

from numba import njit

# Share of a bucket by which searches reach further, so that rounding cannot hide a segment.
_SLACK = 1e-6
# Share of a bucket below which a segment counts as level and is not cut by rows.
_LEVEL = 1e-3


@njit(cache=True, nogil=True)
def point_segment_squared(x, y, x0, y0, x1, y1):
    """Squared distance from (x, y) to the segment (x0, y0) … (x1, y1)."""
    dx = x1 - x0
    dy = y1 - y0
    px = x - x0
    py = y - y0
    length2 = dx * dx + dy * dy
    if length2 > 0.0:
        t = (px * dx + py * dy) / length2
        if t >= 1.0:
            px = x - x1
            py = y - y1
        elif t > 0.0:
            px -= t * dx
            py -= t * dy
    return px * px + py * py


@njit(cache=True, nogil=True)
def segment_segment_squared(ax, ay, bx, by, cx, cy, dx, dy):
    """Squared distance between the segments a … b and c … d; 0 where they cross."""
    a_side = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    b_side = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    c_side = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    d_side = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    # Where an end lies on the other line, the four distances decide.
    if a_side * b_side < 0.0 and c_side * d_side < 0.0:
        return 0.0
    best = point_segment_squared(ax, ay, cx, cy, dx, dy)
    best = min(best, point_segment_squared(bx, by, cx, cy, dx, dy))
    best = min(best, point_segment_squared(cx, cy, ax, ay, bx, by))
    return min(best, point_segment_squared(dx, dy, ax, ay, bx, by))


@njit(cache=True, nogil=True)
def _part_in_band(x0, y0, x1, y1, low, high, level):
    """Smallest and largest x of the part of a segment with low ≤ y ≤ high; (1, 0) when there is none."""
    if max(y0, y1) < low or min(y0, y1) > high:
        return 1.0, 0.0
    dy = y1 - y0
    if abs(dy) <= level:
        return min(x0, x1), max(x0, x1)
    t_low = min(max((low - y0) / dy, 0.0), 1.0)
    t_high = min(max((high - y0) / dy, 0.0), 1.0)
    xa = x0 + t_low * (x1 - x0)
    xb = x0 + t_high * (x1 - x0)
    return min(xa, xb), max(xa, xb)


@njit(cache=True, nogil=True)
def bucket_segments(segments, grid, cursor, items):
    """Count (items empty) or list the segments touching each bucket; (M, 4), (3,), (ny, nx), (K,).

    ``cursor`` grows by one per entry: zeros when counting, first free places when listing.
    """
    n_rows, n_cols = cursor.shape
    cell = grid[2]
    slack = _SLACK * cell
    for i in range(segments.shape[0]):
        x0 = segments[i, 0] - grid[0]
        y0 = segments[i, 1] - grid[1]
        x1 = segments[i, 2] - grid[0]
        y1 = segments[i, 3] - grid[1]
        first = max(0, math.floor((min(y0, y1) - slack) / cell))
        last = min(n_rows - 1, math.floor((max(y0, y1) + slack) / cell))
        for row in range(first, last + 1):
            low = row * cell - slack
            xa, xb = _part_in_band(x0, y0, x1, y1, low, low + cell + 2.0 * slack, _LEVEL * cell)
            if xa > xb:
                continue
            c0 = max(0, math.floor((xa - slack) / cell))
            c1 = min(n_cols - 1, math.floor((xb + slack) / cell))
            for col in range(c0, c1 + 1):
                if items.shape[0] > 0:
                    items[cursor[row, col]] = i
                cursor[row, col] += 1


@njit(cache=True, nogil=True)
def _nearest_of(x, y, best, segments, bucket_items, first, stop):
    """Squared distance to the nearest of items first … stop - 1, at most ``best``."""
    for k in range(first, stop):
        i = bucket_items[k]
        d = point_segment_squared(x, y, segments[i, 0], segments[i, 1], segments[i, 2], segments[i, 3])
        best = min(best, d)
    return best


@njit(cache=True, nogil=True)
def point_distance(x, y, cap, segments, bucket_start, bucket_items, bucket_gap, grid):
    """Distance from (x, y) to the nearest segment, m; at most ``cap``, which may be inf."""
    if cap <= 0.0:
        return 0.0
    n_rows, n_cols = bucket_gap.shape
    cell = grid[2]
    gx = (x - grid[0]) / cell
    gy = (y - grid[1]) / cell
    col = math.floor(gx)
    row = math.floor(gy)
    # Rings of buckets around (row, col), from the first that can hold anything.
    ring = max(-row, row - n_rows + 1, -col, col - n_cols + 1)
    if ring <= 0:
        ring = int(bucket_gap[row, col])
    last = max(row, n_rows - 1 - row, col, n_cols - 1 - col)
    side = min(gx - col, col + 1 - gx, gy - row, row + 1 - gy) - _SLACK
    best = cap * cap
    while ring <= last:
        reach = max((ring - 1 + side) * cell, 0.0)
        if ring > 0 and reach * reach >= best:
            break
        for k in range(2):
            r = row - ring if k == 0 else row + ring
            if r < 0 or r >= n_rows or (ring == 0 and k == 1):
                continue
            c0 = max(col - ring, 0)
            c1 = min(col + ring, n_cols - 1)
            if ring > 0 and best < math.inf:
                across = max((gy - r - 1 if k == 0 else r - gy) - _SLACK, 0.0) * cell
                if across * across >= best:
                    continue
                half = math.sqrt(best - across * across) / cell + _SLACK
                c0 = max(c0, math.floor(max(gx - half, -1.0)))
                c1 = min(c1, math.floor(min(gx + half, n_cols + 1.0)))
            if c0 <= c1:
                first = bucket_start[r, c0]
                best = _nearest_of(x, y, best, segments, bucket_items, first, bucket_start[r, c1 + 1])
        for k in range(2):
            c = col - ring if k == 0 else col + ring
            if c < 0 or c >= n_cols or ring == 0:
                continue
            r0 = max(row - ring + 1, 0)
            r1 = min(row + ring - 1, n_rows - 1)
            if best < math.inf:
                across = max((gx - c - 1 if k == 0 else c - gx) - _SLACK, 0.0) * cell
                if across * across >= best:
                    continue
                half = math.sqrt(best - across * across) / cell + _SLACK
                r0 = max(r0, math.floor(max(gy - half, -1.0)))
                r1 = min(r1, math.floor(min(gy + half, n_rows + 1.0)))
            for r in range(r0, r1 + 1):
                first = bucket_start[r, c]
                best = _nearest_of(x, y, best, segments, bucket_items, first, bucket_start[r, c + 1])
        ring += 1
    return min(cap, math.sqrt(best))


@njit(cache=True, nogil=True)
def points_distance(points, cap, out, segments, bucket_start, bucket_items, bucket_gap, grid):
    """Distance of points (N, 2) to the nearest segment, at most ``cap``, into ``out`` (N,)."""
    for i in range(points.shape[0]):
        x = points[i, 0]
        y = points[i, 1]
        out[i] = point_distance(x, y, cap, segments, bucket_start, bucket_items, bucket_gap, grid)


@njit(cache=True, nogil=True)
def segment_distance(x0, y0, x1, y1, cap, segments, bucket_start, bucket_items, bucket_gap, grid):
    """Distance from the segment (x0, y0) … (x1, y1) to the nearest segment, m; 0 if they cross, ≤ ``cap``."""
    if cap <= 0.0:
        return 0.0
    half = 0.5 * math.hypot(x1 - x0, y1 - y0)
    mx = 0.5 * (x0 + x1)
    my = 0.5 * (y0 + y1)
    middle = point_distance(mx, my, cap + half, segments, bucket_start, bucket_items, bucket_gap, grid)
    if middle >= cap + half:
        return cap
    n_rows, n_cols = bucket_gap.shape
    cell = grid[2]
    slack = _SLACK * cell
    best = min(cap, middle)
    best2 = best * best
    ax = x0 - grid[0]
    ay = y0 - grid[1]
    bx = x1 - grid[0]
    by = y1 - grid[1]
    low_row = max(0, math.floor(max((min(ay, by) - best - slack) / cell, -1.0)))
    high_row = min(n_rows - 1, math.floor(min((max(ay, by) + best + slack) / cell, n_rows + 1.0)))
    for row in range(low_row, high_row + 1):
        reach = math.sqrt(best2) + slack
        low = row * cell - reach
        xa, xb = _part_in_band(ax, ay, bx, by, low, low + cell + 2.0 * reach, _LEVEL * cell)
        if xa > xb:
            continue
        c0 = max(0, math.floor(max((xa - reach) / cell, -1.0)))
        c1 = min(n_cols - 1, math.floor(min((xb + reach) / cell, n_cols + 1.0)))
        if c0 > c1:
            continue
        for k in range(bucket_start[row, c0], bucket_start[row, c1 + 1]):
            i = bucket_items[k]
            d = segment_segment_squared(
                x0, y0, x1, y1, segments[i, 0], segments[i, 1], segments[i, 2], segments[i, 3]
            )
            if d < best2:
                best2 = d
                if d == 0.0:
                    return 0.0
    return min(cap, math.sqrt(best2))


@njit(cache=True, nogil=True)
def segments_distance(queries, cap, out, segments, bucket_start, bucket_items, bucket_gap, grid):
    """Distance of segments (N, 4) to the nearest boundary segment, at most ``cap``, into ``out`` (N,)."""
    for i in range(queries.shape[0]):
        x0 = queries[i, 0]
        y0 = queries[i, 1]
        x1 = queries[i, 2]
        y1 = queries[i, 3]
        out[i] = segment_distance(x0, y0, x1, y1, cap, segments, bucket_start, bucket_items, bucket_gap, grid)
