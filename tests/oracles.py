"""Slow, obvious twins of the kernels: plain Python, no cleverness. Randomised tests compare them."""

from __future__ import annotations

import itertools

import numpy as np

# --- clearance ---


def point_to_segment(point, segment):
    """Distance from a point to a segment (x0, y0, x1, y1)."""
    (px, py), (x0, y0, x1, y1) = point, segment
    dx, dy = x1 - x0, y1 - y0
    length2 = dx * dx + dy * dy
    t = 0.0 if length2 == 0 else ((px - x0) * dx + (py - y0) * dy) / length2
    t = min(1.0, max(0.0, t))
    return ((px - x0 - t * dx) ** 2 + (py - y0 - t * dy) ** 2) ** 0.5


def point_to_segments(point, segments):
    """Distance from a point to the nearest of all segments; inf when there is none."""
    return min((point_to_segment(point, s) for s in segments), default=float("inf"))


def segment_to_segment(p, q):
    """Distance between two segments (x0, y0, x1, y1): 0 where they cross, else from an end of one."""

    def side(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    a, b, c, d = p[:2], p[2:], q[:2], q[2:]
    if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
        return 0.0
    return min(point_to_segment(a, q), point_to_segment(b, q), point_to_segment(c, p), point_to_segment(d, p))


def segment_to_segments(p, segments):
    """Distance from a segment to the nearest of all segments; inf when there is none."""
    return min((segment_to_segment(p, s) for s in segments), default=float("inf"))


# --- runs ---


def masks_of_runs(row_runs, row_offsets, col_runs, col_offsets, shape):
    """Masks (n_rows, n_cols, n_words), one bit set after the other."""
    n = len(row_offsets) - 1
    masks = np.zeros((*shape, max(1, -(-n // 64))), dtype=np.uint64)
    for i in range(n):
        bit = np.uint64(1 << (i % 64))
        for line, first, stop in row_runs[row_offsets[i] : row_offsets[i + 1]]:
            masks[line, first:stop, i // 64] |= bit
        for line, first, stop in col_runs[col_offsets[i] : col_offsets[i + 1]]:
            masks[first:stop, line, i // 64] |= bit
    return masks


# --- planner: line cost ---


def line_rate_integral(rate, start, end):
    """Integral of a piecewise constant rate along a line in cells: cut at every border, look at the middles.

    On a border the larger rate counts; outside the grid the rate is inf; coordinates within 1e-9 of a border
    are on it, pieces shorter than 1e-9 cells do not count.
    """

    def snap(v):
        return float(round(v)) if abs(v - round(v)) < 1e-9 else v

    (x0, y0), (x1, y1) = (tuple(snap(v) for v in p) for p in (start, end))
    length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
    cuts = {0.0, 1.0}
    for a, b in ((x0, x1), (y0, y1)):
        cuts |= {(k - a) / (b - a) for k in range(-2, 200) if a != b and min(a, b) < k < max(a, b)}
    cuts = sorted(cuts)
    total = 0.0
    for t0, t1 in itertools.pairwise(cuts):
        piece = (t1 - t0) * length
        if piece < 1e-9:
            continue
        x, y = x0 + (t0 + t1) / 2 * (x1 - x0), y0 + (t0 + t1) / 2 * (y1 - y0)
        columns = {int(x // 1)} | ({int(x) - 1} if x0 == x1 and x == int(x) else set())
        rows = {int(y // 1)} | ({int(y) - 1} if y0 == y1 and y == int(y) else set())
        inside = [(0 <= r < rate.shape[0] and 0 <= c < rate.shape[1], r, c) for r in rows for c in columns]
        total += piece * max(rate[r, c] if ok else float("inf") for ok, r, c in inside)
    return total
