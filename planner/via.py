"""Plans through via points: leg after leg, joined into one route on which the robot stops at each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from maps.arrays import FloatArray
from planner.annotate import annotate
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_to_go import Place, known_or, smallest_bound
from planner.ends import check_ends
from planner.errors import StartOccupied, StartOutsideMap, ViaOccupied, ViaOutsideMap
from planner.problem import MIN_DEADLINE_S, PlanningProblem, blind_rate_of
from planner.result import Path, PlanResult, PlanStatus, Route, RouteSummary, Trajectory, Unmet

PlanLeg = Callable[[PlanningProblem, PlanningContext], PlanResult]


def plan_via(problem: PlanningProblem, context: PlanningContext, plan_leg: PlanLeg) -> PlanResult:
    """Plan from start to goal through all via points in their order.

    Each leg is planned by itself with its part of the time that is left; places that follow themselves are
    one. A filtered belief and metres without a fix begin anew at each via point; a warning names those
    without a fix where that matters. Under ``minimax`` every leg is the shortest under the worst r95 that the
    hardest leg needs.

    Parameters
    ----------
    problem
        With via points.
    context
        The field.
    plan_leg
        Plans one leg: a problem without via points.

    Returns
    -------
    result
        Route and shortest route are the legs one after the other, at rest at each via point; figures are of
        the whole. The status is that of the worst leg; an unmet bound is that of the leg that misses it most,
        and says which leg. Without a route when one leg has none; a warning says which.

    Raises
    ------
    StartOutsideMap, GoalOutsideMap, StartOccupied, GoalOccupied
        If the robot cannot stand at an end.
    ViaOutsideMap, ViaOccupied
        If it cannot stand at a via point.
    """
    clock = Clock(problem.deadline)
    check_ends(problem, context)
    _check_via(problem, context)
    places = [problem.start]
    names = ["the start"]
    for k, place in enumerate((*problem.via, problem.goal)):
        name = "the goal" if k == len(problem.via) else f"via point {k + 1}"
        if place != places[-1]:
            places.append(place)
            names.append(name)
    if len(places) == 1:
        return plan_leg(replace(problem, via=()), context)
    legs = list(pairwise(places))
    whole = _with_common_worst(problem, context, legs)
    results: list[PlanResult] = []
    said = _begun_anew(problem, context)
    for k, (start, goal) in enumerate(legs):
        where = f"Leg {k + 1} of {len(legs)}, from {names[k]} to {names[k + 1]}: "
        left = (clock.deadline - clock.elapsed) / (len(legs) - k)
        result = None
        if not clock.is_over():
            deadline = max(left, MIN_DEADLINE_S)
            leg = replace(whole, start=start, goal=goal, via=(), deadline=deadline)
            # These are of the ends of the whole.
            if k > 0:
                leg = replace(leg, start_covariance=None, start_heading=_heading_so_far(results))
            if k < len(legs) - 1:
                leg = replace(leg, goal_heading=None)
            result = plan_leg(leg, context)
            results.append(result)
            said += [where + warning for warning in result.warnings]
        if result is None or result.route is None:
            status = PlanStatus.TIMEOUT if result is None else result.status
            late = f"{where}the deadline of {problem.deadline:g} s came first."
            warnings = (*said, late) if result is None else tuple(said)
            return _result(problem, results, status, None, None, warnings, clock)
    route = _joined([r.route for r in results], problem, context)
    shortest = _joined([r.shortest for r in results], problem, context)
    order = (PlanStatus.RISK_UNMET, PlanStatus.APPROXIMATE, PlanStatus.EXACT)
    status = next(s for s in order if any(r.status is s for r in results))
    return _result(problem, results, status, route, shortest, tuple(said), clock)


def _heading_so_far(results: list[PlanResult]) -> float | None:
    """Heading with which the last leg ends, rad; None for a robot without one."""
    route = results[-1].route
    if route is None or route.trajectory.heading is None:
        return None
    return float(route.trajectory.heading[-1])


def _check_via(problem: PlanningProblem, context: PlanningContext) -> None:
    for k, place in enumerate(problem.via):
        try:
            check_ends(replace(problem, start=place, goal=place, via=()), context)
        except (StartOutsideMap, StartOccupied) as error:
            kind = ViaOutsideMap if isinstance(error, StartOutsideMap) else ViaOccupied
            said = str(error).replace("Start", f"Via point {k + 1}", 1)
            raise kind(said, nearest_free=error.nearest_free) from error


def _begun_anew(problem: PlanningProblem, context: PlanningContext) -> list[str]:
    """Via points without a fix where what was before them counts."""
    if problem.max_blind_distance is None and problem.covariance == "fix":
        return []
    cells = context.field.frame.cell_at(list(problem.via))
    blind = np.flatnonzero(~context.field.has_fix[cells[:, 0], cells[:, 1]])
    return [
        f"Via point {k + 1} has no fix; metres without one and the belief are counted anew from there."
        for k in blind
    ]


def _with_common_worst(
    problem: PlanningProblem, context: PlanningContext, legs: list[tuple[Place, Place]]
) -> PlanningProblem:
    """For ``minimax``: the shortest under the worst r95 that the hardest leg needs."""
    if problem.objective != "minimax":
        return problem
    graph = context.graph(
        radius=problem.radius,
        weight=0.0,
        blind_rate=blind_rate_of(0.0, problem.blind_r95, problem.max_ellipse95),
        extras=problem.extras,
    )
    values = known_or(context.r95, problem.blind_r95)
    least = max(smallest_bound(graph, values, a, b) for a, b in legs)
    if not math.isfinite(least) or least <= 0:
        return problem
    asked = problem.max_r95
    return replace(problem, objective="shortest", max_r95=least if asked is None else min(asked, least))


def _joined(
    routes: list[Route] | list[Route | None], problem: PlanningProblem, context: PlanningContext
) -> Route | None:
    """Routes one after the other as one; None when one is missing."""
    legs = [r for r in routes if r is not None]
    if len(legs) < len(routes):
        return None
    trajectory, stops = _joined_trajectory([leg.trajectory for leg in legs])
    if trajectory.heading is not None:
        return Route(_joined_path(legs), trajectory, _joined_summary(legs))
    weight = problem.effective_weight
    blind = blind_rate_of(weight, problem.blind_r95, problem.max_r95, problem.max_ellipse95)
    options = {"radius": problem.radius, "weight": weight}
    space = context.graph(
        max_r95=problem.max_r95, blind_rate=blind, extras=problem.extras, **options
    ).cost_space
    if not math.isfinite(space.line_cost(trajectory.points)):
        # A leg does not keep a bound.
        loose = problem.extras.without_bounds()
        space = context.graph(blind_rate=blind or 1.0, extras=loose, **options).cost_space
    cost = sum(leg.summary.cost for leg in legs)
    return annotate(trajectory, context, space, cost=cost, stops=stops)


def _joined_path(legs: list[Route]) -> Path:
    """Waypoints one after the other, those where legs meet once: with the heading of arrival."""
    values: dict[str, Any] = {}
    offsets = np.concatenate([[0.0], np.cumsum([leg.summary.length for leg in legs])])
    for one in fields(Path):
        parts = [getattr(leg.path, one.name) for leg in legs]
        if not isinstance(parts[0], np.ndarray):
            values[one.name] = parts[0]
            continue
        if one.name == "s":
            parts = [part + offset for part, offset in zip(parts, offsets, strict=False)]
        values[one.name] = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    return Path(**values)


def _joined_summary(legs: list[Route]) -> RouteSummary:
    """Figures of legs as those of one route."""
    all_ = [leg.summary for leg in legs]

    def largest(name: str) -> float | None:
        return max((v for s in all_ if (v := getattr(s, name)) is not None), default=None)

    known = [(s.length - s.blind, s.mean_r95) for s in all_ if s.mean_r95 is not None]
    seen = sum(way for way, _ in known)
    worst, before, worst_at = -math.inf, 0.0, None
    for s in all_:
        if s.max_r95 is not None and s.worst_at is not None and s.max_r95 > worst:
            worst, worst_at = s.max_r95, before + s.worst_at
        before += s.length
    return RouteSummary(
        cost=sum(s.cost for s in all_),
        length=before,
        duration=sum(s.duration for s in all_),
        mean_r95=sum(way * mean for way, mean in known) / seen if seen > 0 else largest("mean_r95"),
        max_r95=largest("max_r95"),
        max_area95=largest("max_area95"),
        max_ellipse95=largest("max_ellipse95"),
        worst_at=worst_at,
        blind=sum(s.blind for s in all_),
        longest_blind=max(s.longest_blind for s in all_),
        min_clearance=min(s.min_clearance for s in all_),
        max_collision_probability=largest("max_collision_probability"),
        max_collision_bound=largest("max_collision_bound"),
    )


def _joined_trajectory(legs: list[Trajectory]) -> tuple[Trajectory, tuple[int, ...]]:
    """Trajectories one after the other, and the samples at which one ends and the next begins."""
    names = ["points", "velocity", "acceleration"]
    if all(leg.heading is not None for leg in legs):
        names.append("heading")
    parts: dict[str, list[FloatArray]] = {name: [] for name in ("t", *names)}
    offset, count, stops = 0.0, 0, []
    for k, leg in enumerate(legs):
        first = 0 if k == 0 else 1
        parts["t"].append(leg.t[first:] + offset)
        for name in names:
            parts[name].append(getattr(leg, name)[first:])
        offset += leg.duration
        count += len(leg.t) - first
        stops.append(count - 1)
    joined = {name: np.concatenate(values) for name, values in parts.items()}
    return Trajectory(**joined), tuple(stops[:-1])


def _result(
    problem: PlanningProblem,
    results: list[PlanResult],
    status: PlanStatus,
    route: Route | None,
    shortest: Route | None,
    warnings: tuple[str, ...],
    clock: Clock,
) -> PlanResult:
    grid_costs = [r.grid_cost for r in results]
    known = [c for c in grid_costs if c is not None]
    stats: dict[str, float] = {}
    for result in results:
        for name, seconds in result.stats.items():
            stats[name] = stats.get(name, 0.0) + seconds
    stages = [stage for r in results for stage in r.planner.split("+")] or ["grid_search"]
    return PlanResult(
        status=status,
        route=route,
        shortest=shortest,
        grid_cost=sum(known) if route is not None and len(known) == len(grid_costs) else None,
        planner="+".join(dict.fromkeys(stages)),
        unmet=_merged(problem, results, route) if route is not None else (),
        warnings=tuple(dict.fromkeys(warnings)),
        stats=stats | {"total_s": clock.elapsed},
    )


def _merged(problem: PlanningProblem, results: list[PlanResult], route: Route) -> tuple[Unmet, ...]:
    """One entry per bound: of the leg that misses it most; metres without a fix are added up."""
    out: dict[str, Unmet] = {}
    for k, result in enumerate(results):
        for unmet in result.unmet:
            named = replace(unmet, message=f"Leg {k + 1} of {len(results)}: {unmet.message}")
            before = out.get(unmet.bound)
            if before is None or unmet.value > before.value:
                out[unmet.bound] = named
    if "blind" in out and problem.blind_r95 is None:
        out["blind"] = replace(out["blind"], value=route.summary.blind)
    return tuple(out.values())
