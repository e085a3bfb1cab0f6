"""The first path: optimal on the grid under the bounds, or the best effort where they cannot be kept."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_to_go import CostToGo, GridGraph, smallest_bound
from planner.problem import PlanningProblem

# Cost per metre without a fix where that is forbidden and cannot be avoided: as little of it as possible.
_BLIND_RATE = 1e4

Stop = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A path on the grid and the space in which it is valid.

    Attributes
    ----------
    graph, to_go
        Where it was searched.
    points
        Shape (K, 2), W, m, from start to goal.
    grid_cost
        Cost of the optimal grid path; None when only the straight line from start to goal is valid.
    bound
        The smallest possible ``max_r95`` when the one asked for cannot be kept, m; else None.
    is_blind_forced
        Whether it goes without a fix although that was forbidden.
    """

    graph: GridGraph
    to_go: CostToGo
    points: FloatArray
    grid_cost: float | None
    bound: float | None = None
    is_blind_forced: bool = False


def find_way(problem: PlanningProblem, context: PlanningContext, clock: Clock) -> Way | None:
    """Best path on the grid.

    When the bounds cannot be kept, first ``max_r95`` is raised to the smallest value for which there is a
    path; if that is not enough, cells without a fix are entered, as few as possible; then both.

    Returns
    -------
    way
        None when there is no path at all, or the deadline came first.
    """
    weight = problem.effective_weight
    blind = None if problem.blind_r95 is None else 1.0 + weight * problem.blind_r95
    with clock.stop_flag() as stop:
        way = _search(problem, context, stop, weight=weight, max_r95=problem.max_r95, blind_rate=blind)
        if way is None and problem.max_r95 is not None and not clock.is_over():
            way = _with_smallest_bound(problem, context, stop, weight=weight, blind_rate=blind)
        if way is None and blind is None and not clock.is_over():
            way = _search(
                problem, context, stop, weight=weight, max_r95=problem.max_r95, blind_rate=_BLIND_RATE
            )
            if way is None and problem.max_r95 is not None and not clock.is_over():
                way = _with_smallest_bound(problem, context, stop, weight=weight, blind_rate=_BLIND_RATE)
            if way is not None:
                return Way(way.graph, way.to_go, way.points, way.grid_cost, way.bound, is_blind_forced=True)
    return way


def find_shortest(problem: PlanningProblem, context: PlanningContext, clock: Clock) -> Way | None:
    """Shortest path on the grid, whatever its uncertainty."""
    with clock.stop_flag() as stop:
        return _search(problem, context, stop, weight=0.0, max_r95=None, blind_rate=1.0)


def _search(
    problem: PlanningProblem,
    context: PlanningContext,
    stop: Stop,
    *,
    weight: float,
    max_r95: float | None,
    blind_rate: float | None,
) -> Way | None:
    graph = context.graph(radius=problem.radius, weight=weight, max_r95=max_r95, blind_rate=blind_rate)
    to_go = context.costs_to(graph, problem.goal, stop=stop)
    cost, points = to_go.path_from(problem.start)
    line = np.array([problem.start, problem.goal])
    straight = graph.cost_space.line_cost(line)
    grid_cost = cost if math.isfinite(cost) else None
    if math.isfinite(straight) and straight <= cost:
        points = line
    return None if points is None else Way(graph, to_go, points, grid_cost)


def _with_smallest_bound(
    problem: PlanningProblem,
    context: PlanningContext,
    stop: Stop,
    *,
    weight: float,
    blind_rate: float | None,
) -> Way | None:
    free = context.graph(radius=problem.radius, weight=weight, max_r95=None, blind_rate=blind_rate)
    bound = smallest_bound(free, context.r95, problem.start, problem.goal)
    if not math.isfinite(bound):
        return None
    way = _search(problem, context, stop, weight=weight, max_r95=bound, blind_rate=blind_rate)
    return None if way is None else Way(way.graph, way.to_go, way.points, way.grid_cost, bound)
