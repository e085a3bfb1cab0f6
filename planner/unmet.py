"""In words: which bound a route does not keep, where, and what would be possible."""

from __future__ import annotations

import math

import numpy as np

from planner.context import PlanningContext
from planner.grid_search import Way
from planner.problem import PlanningProblem
from planner.result import Route, Unmet


def unmet_bounds(
    problem: PlanningProblem, way: Way, route: Route, context: PlanningContext
) -> tuple[Unmet, ...]:
    """Bounds that a best-effort route does not keep; empty when it keeps all.

    Parameters
    ----------
    problem, way, route
        The question, the grid path, what it became.
    context
        For the size of its cells.
    """
    out = []
    cell = context.field.frame.resolution
    summary = route.summary
    if way.bound is not None and problem.max_r95 is not None:
        x, y = _place_of_worst(route)
        value = summary.max_r95 if summary.max_r95 is not None else way.bound
        limit = problem.max_r95
        message = (
            f"No path keeps r95 at or below {limit:g} m. The smallest bound that has a path is "
            f"{round_up(way.bound)} m (on cells of {cell:g} m); the route returned keeps it and is worst, "
            f"{round_up(value)} m, at ({x:.2f}, {y:.2f}) m. Raise max_r95_m to {round_up(way.bound)}, or "
            "place landmarks there."
        )
        out.append(Unmet("max_r95_m", limit, value, (x, y), way.bound, message))
    if way.is_blind_forced:
        x, y = _first_blind_place(route)
        message = (
            "Every path crosses places without a fix (fewer than three usable landmarks in view). The route "
            f"returned drives {summary.blind:.2f} m without one, as little as possible, first at "
            f"({x:.2f}, {y:.2f}) m. Give blind_r95_m to accept such stretches at a cost, or place "
            "landmarks there."
        )
        out.append(Unmet("blind", 0.0, summary.blind, (x, y), None, message))
    return tuple(out)


def round_up(value: float) -> str:
    """Three significant digits, rounded up: as a bound the number in the text must be enough."""
    if value <= 0:
        return "0"
    scale = 10.0 ** (2 - math.floor(math.log10(value)))
    return f"{math.ceil(value * scale * (1 - 1e-12)) / scale:.6g}"


def _place_of_worst(route: Route) -> tuple[float, float]:
    points, s = route.path.points, route.path.s
    at = route.summary.worst_at
    if at is None:
        return (float(points[0, 0]), float(points[0, 1]))
    return (float(np.interp(at, s, points[:, 0])), float(np.interp(at, s, points[:, 1])))


def _first_blind_place(route: Route) -> tuple[float, float]:
    blind = np.isnan(route.path.r95)
    k = int(np.argmax(blind)) if blind.any() else 0
    return (float(route.path.points[k, 0]), float(route.path.points[k, 1]))
