"""Straight lines along a path on the grid: as long as they are valid and stay close to it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planner.kernels.line_cost import motion_cost, motion_rate_cost

# Points of a grid path that one straight line may stand for.
_WINDOW = 400
# So many points in a row that do not fit end a line.
_PATIENCE = 8
# Means along a line may be larger by this than along the part of the path that it stands for.
_MORE_HARM = 1.02
_ROUNDING = 1e-6


@njit(cache=True, nogil=True)
def is_close(points, i, j, limit):
    """Whether points (K, 2) between the i-th and the j-th lie within about ``limit`` m of their line."""
    wx = points[j, 0] - points[i, 0]
    wy = points[j, 1] - points[i, 1]
    length = math.hypot(wx, wy)
    if length == 0.0:
        return False
    for k in range(i + 1, j):
        dx = points[k, 0] - points[i, 0]
        dy = points[k, 1] - points[i, 1]
        along = dx * wx + dy * wy
        if abs(dx * wy - dy * wx) > limit * length:
            return False
        if along < -limit * length or along > (length + limit) * length:
            return False
    return True


@njit(cache=True, nogil=True)
def line_ends(
    points,
    limit,
    harms,
    kept,
    rate,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    bucket_grid,
):
    """Indices of the points (K, 2), W, m, where straight lines begin and end into ``kept`` (K,): how many.

    A line is valid, all points that it stands for are within ``limit`` m of it, and the mean of no layer of
    ``harms`` (H, ny, nx) along it is more than 2 % above that along them. The rest: as of ``line_cost``.
    """
    n = points.shape[0]
    arc = np.zeros(n)
    sums = np.zeros((harms.shape[0], n))
    for k in range(1, n):
        x0, y0, x1, y1 = points[k - 1, 0], points[k - 1, 1], points[k, 0], points[k, 1]
        arc[k] = arc[k - 1] + math.hypot(x1 - x0, y1 - y0)
        for h in range(harms.shape[0]):
            sums[h, k] = sums[h, k - 1] + motion_rate_cost(x0, y0, x1, y1, harms[h], transform)
    kept[0] = 0
    count = 1
    i = 0
    while i < n - 1:
        best = i + 1
        missed = 0
        for j in range(i + 2, min(i + _WINDOW, n - 1) + 1):
            x0, y0, x1, y1 = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
            fits = is_close(points, i, j, limit) and (
                motion_cost(
                    x0,
                    y0,
                    x1,
                    y1,
                    rate,
                    transform,
                    need,
                    segments,
                    bucket_start,
                    bucket_items,
                    bucket_gap,
                    bucket_grid,
                )
                < math.inf
            )
            if fits:
                more = _MORE_HARM * math.hypot(x1 - x0, y1 - y0) / (arc[j] - arc[i])
                for h in range(harms.shape[0]):
                    cost = motion_rate_cost(x0, y0, x1, y1, harms[h], transform)
                    fits = fits and cost <= more * (sums[h, j] - sums[h, i]) + _ROUNDING
            if fits:
                best = j
                missed = 0
            else:
                missed += 1
                if missed > _PATIENCE:
                    break
        kept[count] = best
        count += 1
        i = best
    return count
