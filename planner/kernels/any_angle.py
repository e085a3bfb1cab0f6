"""Shortening and bending polylines under the exact line cost: string pulling and elastic relaxation.

The arguments after the points are ``CostSpace.kernel_args``: see ``planner.kernels.line_cost``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.kernels.clearance import segment_distance
from planner.kernels.line_cost import motion_cost, motion_rate_cost

# Share of the cost that a point less is worth: rounding must not keep points on straight lines.
_TIE = 1e-13


@njit(cache=True, nogil=True)
def pull_string(
    points,
    window,
    lowest,
    rate,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    bucket_grid,
):
    """Cheapest choice (M, 2) of points (K, 2), no gap above ``window``; rates are at least ``lowest``."""
    n = points.shape[0]
    best = np.full(n, math.inf)
    came = np.zeros(n, np.int64)
    best[0] = 0.0
    for j in range(1, n):
        x1 = points[j, 0]
        y1 = points[j, 1]
        for i in range(j - 1, max(j - window, 0) - 1, -1):
            x0 = points[i, 0]
            y0 = points[i, 1]
            room = best[j] * (1.0 + _TIE)
            if best[i] + lowest * math.hypot(x1 - x0, y1 - y0) > room:
                continue
            new = best[i] + motion_rate_cost(x0, y0, x1, y1, rate, transform)
            if new > room or new == math.inf:
                continue
            kept = segment_distance(
                x0, y0, x1, y1, need, segments, bucket_start, bucket_items, bucket_gap, bucket_grid
            )
            if kept >= need:
                best[j] = new
                came[j] = i
    if best[n - 1] == math.inf:
        return points.copy()
    count = 1
    j = n - 1
    while j > 0:
        j = came[j]
        count += 1
    out = np.empty((count, 2))
    j = n - 1
    for k in range(count - 1, -1, -1):
        out[k] = points[j]
        j = came[j]
    return out


@njit(cache=True, nogil=True)
def subdivide(points, spacing):
    """Polyline (K, 2) with points added so that none are more than ``spacing`` apart: (M, 2)."""
    total = 1
    for k in range(points.shape[0] - 1):
        d = math.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
        total += max(1, math.ceil(d / spacing))
    out = np.empty((total, 2))
    out[0] = points[0]
    n = 1
    for k in range(points.shape[0] - 1):
        d = math.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
        parts = max(1, math.ceil(d / spacing))
        for i in range(1, parts):
            out[n] = points[k] + (points[k + 1] - points[k]) * (i / parts)
            n += 1
        out[n] = points[k + 1]
        n += 1
    return out


@njit(cache=True, nogil=True)
def relax(
    points,
    step,
    smallest_step,
    max_sweeps,
    rate,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    bucket_grid,
):
    """Move points (K, 2) in place, each across and along the way, while the cost falls; ends stay.

    The step starts at ``step`` m and is halved when a sweep finds nothing, down to ``smallest_step``. Points
    are tried again at the same step only when they or a neighbour moved.
    """
    n = points.shape[0]
    costs = np.empty(n - 1)
    settled = np.zeros(n, np.bool_)
    for k in range(n - 1):
        costs[k] = motion_cost(
            points[k, 0], points[k, 1], points[k + 1, 0], points[k + 1, 1], rate, transform, need,
            segments, bucket_start, bucket_items, bucket_gap, bucket_grid,
        )  # fmt: skip
    for _ in range(max_sweeps):
        moved = False
        for k in range(1, n - 1):
            if settled[k]:
                continue
            settled[k] = True
            tx = points[k + 1, 0] - points[k - 1, 0]
            ty = points[k + 1, 1] - points[k - 1, 1]
            length = math.hypot(tx, ty)
            if length > 0.0:
                tx /= length
                ty /= length
            else:
                tx = 1.0
                ty = 0.0
            for direction in range(4):
                ux = (-ty, ty, tx, -tx)[direction]
                uy = (tx, -tx, ty, -ty)[direction]
                x = points[k, 0] + step * ux
                y = points[k, 1] + step * uy
                room = (costs[k - 1] + costs[k]) * (1.0 - 1e-12)
                before = motion_cost(
                    points[k - 1, 0], points[k - 1, 1], x, y, rate, transform, need,
                    segments, bucket_start, bucket_items, bucket_gap, bucket_grid,
                )  # fmt: skip
                if before >= room:
                    continue
                after = motion_cost(
                    x, y, points[k + 1, 0], points[k + 1, 1], rate, transform, need,
                    segments, bucket_start, bucket_items, bucket_gap, bucket_grid,
                )  # fmt: skip
                if before + after < room:
                    points[k, 0] = x
                    points[k, 1] = y
                    costs[k - 1] = before
                    costs[k] = after
                    settled[k - 1] = settled[k] = settled[k + 1] = False
                    moved = True
                    break
        if not moved:
            settled[:] = False
            step *= 0.5
            if step < smallest_step:
                break
