"""Passages narrower than the grid can show: a proof that there is none, or a finer grid to find it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label
from shapely import Polygon

from localization.uncertainty_field import LAYERS
from maps.arrays import IntArray
from maps.clearance import TOUCH_M
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_to_go import Place
from planner.grid_search import Way, find_way
from planner.problem import PlanningProblem

# Sides of a cell are divided by the largest of these that keeps the finer grid below its limit of cells.
_FACTORS = (4, 2)
_MAX_CELLS = 4_000_000


def first_way(
    problem: PlanningProblem, context: PlanningContext, clock: Clock
) -> tuple[Way | None, PlanningContext, bool]:
    """Best path on the grid, on finer cells where it needs them.

    Returns
    -------
    way, context, proven
        None when there is none or the deadline came first; the context of the cells that were searched; and
        whether it is proven that start and goal are not connected.
    """
    with clock.stage("grid"):
        way = find_way(problem, context, clock)
        proven = way is None and cannot_connect(problem, context)
        if way is None and not proven and not clock.is_over():
            finer = refined(context)
            if finer is not None:
                context = finer
                way = find_way(problem, context, clock)
    return way, context, proven


def cannot_connect(problem: PlanningProblem, context: PlanningContext) -> bool:
    """Whether it is proven that no path leads from the start to the goal of a question; the bounds aside."""
    return is_disconnected(context, problem.inner_radius, problem.start, problem.goal, problem.avoid)


def is_disconnected(
    context: PlanningContext, radius: float, start: Place, goal: Place, avoid: tuple[Polygon, ...] = ()
) -> bool:
    """Whether it is proven that no path of a disc leads from start to goal, clear of areas to avoid.

    A place with clearance ``radius`` lies in a cell whose centre has at least ``radius − resolution/√2``:
    where even such cells do not connect, nothing does.
    """
    a, b = components(context, radius, [start, goal], avoid)
    return bool(a != b)


def components(
    context: PlanningContext, radius: float, places: list[Place], avoid: tuple[Polygon, ...] = ()
) -> IntArray:
    """Number of the part of the map, less areas to avoid, that each place is in; shape (K,).

    Between different parts it is proven that no path leads (see :func:`is_disconnected`). The places must be
    on the map.
    """
    frame = context.field.frame
    least = radius - frame.resolution / math.sqrt(2.0) - TOUCH_M
    labels, _ = label(context.obstacles(avoid).centre_clearance >= least, structure=np.ones((3, 3)))
    rows, cols = frame.cell_at(places).T
    return np.asarray(labels[rows, cols], dtype=np.int64)


def refined(context: PlanningContext) -> PlanningContext | None:
    """The same field on cells of a half or a quarter the size; None where there would be too many.

    Every small cell has the values of the cell that it is a part of, so costs and figures are the same. The
    context keeps it.
    """
    if context.finer is not None:
        return context.finer
    field = context.field
    factors = [k for k in _FACTORS if k * k * field.free.size <= _MAX_CELLS]
    if not factors:
        return None
    k = factors[0]
    frame = field.frame.resampled(field.frame.resolution / k)
    if frame.shape != (k * field.frame.n_rows, k * field.frame.n_cols):
        return None

    def spread(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.repeat(np.repeat(values, k, axis=0), k, axis=1)

    layers: dict[str, Any] = {name: spread(getattr(field, name)) for name in ("free", *LAYERS)}
    context.finer = PlanningContext(replace(field, frame=frame, **layers))
    return context.finer
