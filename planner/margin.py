"""A way that keeps off the borders of forbidden cells, for where a smooth curve needs room."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation

from maps.arrays import BoolArray, FloatArray
from planner.any_angle import shorten
from planner.cost_space import CostSpace
from planner.cost_to_go import GridGraph, Place
from planner.grid_search import Way
from planner.kernels.line_cost import polyline_pieces

# How much dearer cells beside forbidden ones are made.
_FACTOR = 1.2
#: A path with more than this beside forbidden cells, m, is smoothed on a way with more room.
HUGGING_M = 1.0


def way_with_room(way: Way, start: Place, goal: Place, *, deadline_at: float) -> FloatArray | None:
    """A path that avoids cells beside free but forbidden ones where it can.

    The cheapest line often runs along the staircase of cells where a bound begins to hold, with a corner at
    every step; a smooth curve needs a little room there.

    Parameters
    ----------
    way
        The path and the space in which it is valid.
    start, goal
        (x, y) in W, m.
    deadline_at
        ``time.monotonic()`` after which the path is no longer shortened, s.

    Returns
    -------
    points
        Shape (K, 2), W, m: valid, and not dearer than the grid path of ``way``; None when there is none or
        no cell is forbidden.
    """
    space = way.graph.cost_space
    beside = _beside_forbidden(space)
    if not beside.any():
        return None
    dearer = replace(space, rate=np.where(beside, _FACTOR, 1.0) * space.rate)
    graph = GridGraph.from_cost_space(dearer)
    _, points = graph.costs_to(goal, limit=_FACTOR * space.line_cost(way.points)).path_from(start)
    if points is None:
        return None
    points, _ = shorten(points, dearer, deadline_at=deadline_at)
    limit = math.inf if way.grid_cost is None else way.grid_cost
    return points if space.line_cost(points) <= limit else None


def hugs_forbidden(points: FloatArray, space: CostSpace) -> bool:
    """Whether a path (K, 2) runs for more than ``HUGGING_M`` through cells beside free but forbidden ones."""
    if len(points) < 2:
        return False
    pieces = polyline_pieces(space.frame.to_grid(points), space.rate)
    rows, cols = pieces[:, :2].astype(np.int64).T
    ny, nx = space.frame.shape
    beside = np.zeros(len(pieces), dtype=np.bool_)
    # Only the cells along the path are looked at: there may be millions of others.
    for row_step in (-1, 0, 1):
        for col_step in (-1, 0, 1):
            r, c = np.clip(rows + row_step, 0, ny - 1), np.clip(cols + col_step, 0, nx - 1)
            beside |= np.isinf(space.rate[r, c]) & (space.centre_clearance[r, c] > 0)
    return float(pieces[beside, 4].sum()) * space.frame.resolution > HUGGING_M


def _beside_forbidden(space: CostSpace) -> BoolArray:
    forbidden = np.isinf(space.rate) & (space.centre_clearance > 0)
    return np.asarray(binary_dilation(forbidden, np.ones((3, 3), dtype=np.bool_)) & ~forbidden)
