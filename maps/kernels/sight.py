"""Sight of one landmark from one place, on either kind of floor, for loops that ask one by one."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from maps.kernels import grid_visibility, vector_visibility

GRID, PLAN = 0, 1
# Where the numbers of a scene stand in ``frame``.
ORIGIN_X, ORIGIN_Y, COS, SIN, METRES, UNITS, LOW2, HIGH2, LIMIT_X, LIMIT_Y = range(10)


@njit(cache=True, nogil=True)
def sees(
    x, y, i, kind, frame, edges, opaque, windows, states, shift, places, places_m, hidden, modes, cones, spans
):
    """Whether landmark i is seen from (x, y), W, m, by the rule of ``maps.visibility``.

    ``frame`` (10,): origin, cosine and sine of the yaw, metres and lattice units per unit of the frame,
    squared ranges, largest lattice coordinates. The rest is what the two ``see_points`` take.
    """
    dx = x - frame[ORIGIN_X]
    dy = y - frame[ORIGIN_Y]
    gx = (frame[COS] * dx + frame[SIN] * dy) / frame[METRES]
    gy = (frame[COS] * dy - frame[SIN] * dx) / frame[METRES]
    ux = gx * frame[UNITS]
    uy = gy * frame[UNITS]
    point = np.empty((1, 2), dtype=np.int64)
    point_m = np.empty((1, 2))
    out = np.empty((1, 1), dtype=np.bool_)
    one = slice(i, i + 1)
    if kind == GRID:
        if not (abs(ux) < frame[LIMIT_X] and abs(uy) < frame[LIMIT_Y]):
            return False
        point_m[0, 0] = gx * frame[METRES]
        point_m[0, 1] = gy * frame[METRES]
    else:
        if not (-1.0 <= ux <= frame[LIMIT_X] + 1.0 and -1.0 <= uy <= frame[LIMIT_Y] + 1.0):
            return False
        point_m[0, 0] = x
        point_m[0, 1] = y
        away = math.hypot(x - places_m[i, 0], y - places_m[i, 1])
        if away * away < frame[LOW2]:
            return False
    point[0, 0] = round(ux)
    point[0, 1] = round(uy)
    if kind == GRID:
        grid_visibility.see_points(
            opaque, windows[one], states[one], shift, places[one], places_m[one], modes[one], cones[one],
            point, point_m, frame[LOW2], frame[HIGH2], out,
        )  # fmt: skip
    else:
        vector_visibility.see_points(
            edges, places[one], places_m[one], hidden[one], cones[one], spans[one], point, point_m,
            frame[HIGH2], out,
        )  # fmt: skip
    return out[0, 0]


@njit(cache=True, nogil=True)
def sees_pairs(points, indices, out, scene):
    """Sight of landmarks ``indices`` (K,) from ``points`` (K, 2), pair by pair, into ``out`` (K,)."""
    for k in range(points.shape[0]):
        out[k] = sees(points[k, 0], points[k, 1], indices[k], *scene)
