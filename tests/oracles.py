"""Slow, obvious twins of the kernels: plain Python, no cleverness. Randomised tests compare them."""

from __future__ import annotations

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
