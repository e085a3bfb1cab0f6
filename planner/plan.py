"""plan(): grid search, any-angle, OMPL, CasADi, annotation, and the shortest route beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from localization.at_poses import warm_up as warm_up_fixes
from maps.arrays import FloatArray
from planner import belief_plan, risk, sampling, smoothing
from planner.annotate import annotate
from planner.any_angle import shorten
from planner.clock import Clock
from planner.context import PlanningContext
from planner.ends import check_ends
from planner.errors import InvalidProblem
from planner.example_context import example_context
from planner.extras import Extras
from planner.grid_search import Way, find_shortest, find_way
from planner.informed import sampled_from
from planner.margin import hugs_forbidden, way_with_room
from planner.motion import Motion, least_limit, move_along, stops_in_words
from planner.narrow import cannot_connect, first_way
from planner.no_way import explained, nothing_found
from planner.pose_plan import warm_up as warm_up_poses
from planner.pose_question import plan_facing, plan_with_poses
from planner.pose_route import facing_its_way
from planner.problem import PlanningProblem
from planner.result import PlanResult, PlanStatus, Route, Trajectory
from planner.timing import time_polyline
from planner.unmet import ends_over, keeps_risk, unjudged_in_words, unmet_bounds
from planner.via import plan_via

Report = Callable[[PlanResult], None]

# Shares of the deadline at which sampling and smoothing end: of the route, then of the shortest one. Sampling
# gains a percent; without smoothing the robot stops at every corner.
_ROUTE_SHARES = (0.35, 0.85)
_SHORTEST_SHARES = (0.6, 1.0)
# Where a smoothed path passes closer than the centres of its cells, the grid is asked for this share of the
# collision probability.
_RISK_SHARES = (0.8, 0.4, 0.1)


@dataclass(slots=True)
class _Work:
    """One route in the making: what shaped it, and what there is to say."""

    name: str
    shares: tuple[float, float]
    stages: list[str] = field(default_factory=lambda: ["grid_search"])
    warnings: list[str] = field(default_factory=list)


def plan(problem: PlanningProblem, context: PlanningContext, *, report: Report | None = None) -> PlanResult:
    """Answer a planning question.

    Parameters
    ----------
    problem
        Robot, start, goal, objective, bounds, deadline.
    context
        The field.
    report
        Called with the first path and with every improvement, in this thread; with via points once, at the
        end.

    Returns
    -------
    result
        ``EXACT``: bounds kept, optimal on the planning grid, then improved. ``APPROXIMATE``: bounds kept,
        but the deadline cut the grid search short, or the grid has no path and a straight line does.
        ``RISK_UNMET``: no path keeps the bounds; the route has the smallest possible bound, or drives as
        little as possible without a fix. ``NO_PATH``: start and goal are not connected: proven, or else
        not even on finer cells, and then a warning says so.
        ``TIMEOUT``: the deadline came before any path. When it comes later, the best path so far is
        returned with a warning. No route costs more than its grid path.

    Raises
    ------
    StartOutsideMap, GoalOutsideMap, StartOccupied, GoalOccupied
        If the robot cannot stand at an end.
    ViaOutsideMap, ViaOccupied
        If it cannot stand at a via point.
    """
    if problem.via:
        legs: list[PlanResult] = []

        def leg(part: PlanningProblem, there: PlanningContext) -> PlanResult:
            legs.append(plan(part, there))
            return legs[-1]

        result = plan_via(problem, context, leg)
        if result.status is PlanStatus.NO_PATH:
            result = replace(result, blocked=legs[-1].blocked)
        if report is not None and result.route is not None:
            report(result)
        return result
    clock = Clock(problem.deadline)
    check_ends(problem, context)
    special = _special(problem, context, clock)
    if special is not None:
        if report is not None and special.route is not None:
            report(special)
        return special
    way, context, proven = first_way(problem, context, clock)
    if way is None:
        return nothing_found(problem, context, clock, proven=proven)
    work = _Work("route", _ROUTE_SHARES)

    def tell(points: FloatArray) -> None:
        clock.seconds.setdefault("to_first_path", clock.elapsed)
        if report is not None:
            report(
                _result(problem, way, _quick_route(points, way, problem, context), None, work, clock, context)
            )

    tell(way.points)
    route = _finish(way, problem, context, clock, work, tell)
    kept, route = _within_risk(way, route, problem, context, clock, work)
    clock.seconds["to_final_path"] = clock.elapsed
    shortest = _shortest(problem, context, clock, work, route)
    return _result(problem, kept, route, shortest, work, clock, context)


def finished(
    way: Way,
    problem: PlanningProblem,
    context: PlanningContext,
    clock: Clock,
    *,
    name: str,
    shares: tuple[float, float] = _ROUTE_SHARES,
) -> tuple[Route, tuple[str, ...]]:
    """Route from a grid path: any-angle, sampling, smoothing, annotation.

    Parameters
    ----------
    way
        The path and the space in which it is valid.
    problem, context, clock
        The question, the field of the way, the time.
    name
        For warnings, e.g. ``alternative 2``.
    shares
        Of the deadline at which sampling and smoothing end.

    Returns
    -------
    route, warnings
        What was made of it, and what there is to say.
    """
    work = _Work(name, shares)
    return _finish(way, problem, context, clock, work), tuple(work.warnings)


def _finish(
    way: Way,
    problem: PlanningProblem,
    context: PlanningContext,
    clock: Clock,
    work: _Work,
    tell: Callable[[FloatArray], None] = lambda _: None,
) -> Route:
    """Any-angle, sampling, smoothing and annotation of a grid path."""
    space = way.graph.cost_space
    sampling_end, smoothing_end = work.shares
    points, cost = way.points, space.line_cost(way.points)
    if len(points) > 1 and np.array_equal(points[0], points[-1]):
        points = points[:1]
        return annotate(_timed(points, problem), context, space, cost=_asked_cost(points, problem, context))
    with clock.stage("any_angle"):
        shorter, shorter_cost = shorten(points, space, deadline_at=clock.at(sampling_end))
    if len(shorter) < len(points) or shorter_cost < cost:
        points, cost = shorter, shorter_cost
        work.stages.append("any_angle")
        tell(points)
    if problem.refine > 0 and len(points) > 2 and not clock.is_over(sampling_end):
        with clock.stage("ompl"):
            sampled, sampled_cost = sampled_from(
                points, cost, way, problem, context, clock=clock, share=sampling_end
            )
        if sampled_cost < cost:
            points, cost = sampled, sampled_cost
            work.stages.append("ompl")
            tell(points)
    if clock.is_over(sampling_end):
        work.warnings.append(_late(problem, work, "refined"))
    with clock.stage("smoothing"):
        motion = _move(points, cost, way, problem, clock.at(smoothing_end))
    trajectory = motion.trajectory
    if motion.is_smooth:
        work.stages.append("casadi")
    if (said := stops_in_words(motion, work.name)) is not None:
        work.warnings.append(said)
    with clock.stage("annotate"):
        final = np.asarray(trajectory.points)
        return annotate(trajectory, context, space, cost=_asked_cost(final, problem, context))


def _within_risk(
    way: Way, route: Route, problem: PlanningProblem, context: PlanningContext, clock: Clock, work: _Work
) -> tuple[Way, Route]:
    """A route that keeps the collision probability between the cells' centres, too, where the grid has one.

    The grid judges centres; a smoothed path passes beside them. Where it goes too close, the grid is asked
    for less.
    """
    limit = problem.max_collision_probability
    if limit is None or way.relaxed or way.is_unjudged or keeps_risk(route, limit):
        return way, route
    if ends_over(limit, route):
        return way, route  # no way is any better there
    for share in _RISK_SHARES:
        if clock.is_over():
            break
        with clock.stage("risk"):
            careful = find_way(replace(problem, max_collision_probability=share * limit), context, clock)
        if careful is None or careful.is_unjudged or careful.relaxed:
            break
        if careful.is_blind_forced != way.is_blind_forced:
            break
        other = _finish(careful, problem, context, clock, work)
        if keeps_risk(other, limit):
            return careful, other
    # Smoothing may pass closer; lines with stops at their corners are slow, but keep what was asked.
    for points in (shorten(way.points, way.graph.cost_space)[0], way.points):
        cost = _asked_cost(points, problem, context)
        plain = annotate(_timed(points, problem), context, way.graph.cost_space, cost=cost)
        if keeps_risk(plain, limit):
            work.warnings.append(
                f"A smooth path would exceed the collision probability of {limit:g}; the route stops at its "
                "corners."
            )
            return way, plain
    return way, route


def _move(points: FloatArray, cost: float, way: Way, problem: PlanningProblem, deadline_at: float) -> Motion:
    """Smooth a path, on a way with more room where it runs along forbidden cells."""

    def roomy() -> FloatArray | None:
        return way_with_room(way, problem.start, problem.goal, deadline_at=deadline_at)

    space = way.graph.cost_space
    other = roomy() if len(points) > 2 and hugs_forbidden(points, space) else None
    return move_along(
        points if other is None else other,
        space,
        max_speed=problem.max_speed,
        max_accel=problem.max_accel,
        cost_limit=least_limit(cost, way.grid_cost),
        deadline_at=deadline_at,
        other_way=roomy if other is None else lambda: points,
    )


def _shortest(
    problem: PlanningProblem,
    context: PlanningContext,
    clock: Clock,
    work: _Work,
    route: Route,
) -> Route | None:
    """The shortest route for the same robot, whatever its uncertainty."""
    if _asks_for_length(problem):
        return route
    if clock.is_over():
        work.warnings.append("The deadline came before the shortest route was searched.")
        return None
    with clock.stage("shortest"):
        found = find_shortest(problem, context, clock)
        if found is None:
            work.warnings.append("The deadline came before the shortest route was found.")
            return None
        other = _Work("shortest route", _SHORTEST_SHARES)
        # Where only length counts, a pulled string is taut: samples would not shorten it.
        shortest = _finish(found, replace(problem, refine=0), context, clock.quiet(), other)
    work.warnings.extend(other.warnings)
    # The route itself is shorter where its smoothing went further.
    return route if route.summary.length < shortest.summary.length else shortest


def _special(problem: PlanningProblem, context: PlanningContext, clock: Clock) -> PlanResult | None:
    """Answer to a question that another search than that over cells has to find; None for the others."""

    def baseline() -> Route | None:
        return _baseline(problem, context, clock)

    by_pose = problem.has_pose or context.headings is not None
    by_belief = problem.covariance == "fused" or problem.max_blind_distance is not None
    if by_pose and by_belief:
        raise InvalidProblem(
            "Beliefs and blind distances are searched for a disc that drives in every direction, on a field "
            "of one heading; leave out kinematics, headings and footprint, or covariance 'fused' and "
            "max_blind_distance."
        )
    if by_pose and problem.faces_its_way and context.headings is None:
        plain = replace(problem, kinematics="holonomic", start_heading=None, goal_heading=None)
        faced = plan_facing(problem, context, plan(plain, context))
        if faced is not None:
            return faced
    if not (by_pose or by_belief):
        return None
    if cannot_connect(problem, context):
        # Said at once: a search over headings or beliefs would look at all that is reached first.
        return nothing_found(problem, context, clock, proven=True)
    if by_pose:
        found = plan_with_poses(problem, context, clock, baseline=baseline)
    else:
        found = belief_plan.plan_by_belief(problem, context, clock, baseline=baseline)
    return explained(found, problem, context, clock)


def _baseline(problem: PlanningProblem, context: PlanningContext, clock: Clock) -> Route | None:
    """The shortest route beside one that a search over beliefs found; None when there is no time for it."""
    if clock.is_over():
        return None
    found = find_shortest(problem, context, clock)
    if found is None:
        return None
    plain = replace(problem, refine=0)  # a pulled string is taut
    route = _finish(found, plain, context, clock.quiet(), _Work("shortest route", _SHORTEST_SHARES))
    return route if context.headings is None else facing_its_way(route, problem, context)


def _asks_for_length(problem: PlanningProblem) -> bool:
    """Whether the question is the one for the shortest route: length counts, nothing else is asked."""
    is_free = problem.max_r95 is None and problem.blind_r95 is not None and problem.objective != "minimax"
    return (
        is_free and problem.effective_weight == 0.0 and problem.extras == Extras(avoid=problem.extras.avoid)
    )


def _asked_cost(points: FloatArray, problem: PlanningProblem, context: PlanningContext) -> float:
    """Integral of the objective that was asked for, bounds left aside; inf across forbidden blind cells."""
    weight = problem.effective_weight
    blind = None if problem.blind_r95 is None else 1.0 + weight * problem.blind_r95
    graph = context.graph(
        radius=problem.radius,
        weight=weight,
        max_r95=None,
        blind_rate=blind,
        extras=problem.extras.without_bounds(),
    )
    return graph.cost_space.line_cost(points)


def _timed(points: FloatArray, problem: PlanningProblem) -> Trajectory:
    return time_polyline(points, max_speed=problem.max_speed, max_accel=problem.max_accel)


def _quick_route(points: FloatArray, way: Way, problem: PlanningProblem, context: PlanningContext) -> Route:
    if np.array_equal(points[0], points[-1]):
        points = points[:1]
    cost = _asked_cost(points, problem, context)
    return annotate(_timed(points, problem), context, way.graph.cost_space, cost=cost)


def _late(problem: PlanningProblem, work: _Work, verb: str) -> str:
    return f"The deadline of {problem.deadline:g} s came before the {work.name} was fully {verb}."


def _result(
    problem: PlanningProblem,
    way: Way,
    route: Route,
    shortest: Route | None,
    work: _Work,
    clock: Clock,
    context: PlanningContext,
) -> PlanResult:
    unmet = unmet_bounds(problem, way, route, context)
    if way.is_unjudged:
        status = PlanStatus.TIMEOUT if unmet else PlanStatus.APPROXIMATE
        work.warnings.insert(0, unjudged_in_words(problem))
    elif unmet:
        status = PlanStatus.RISK_UNMET
    elif way.is_complete and way.grid_cost is not None:
        status = PlanStatus.EXACT
    else:
        status = PlanStatus.APPROXIMATE
    return PlanResult(
        status=status,
        route=route,
        shortest=shortest,
        grid_cost=None if way.is_blind_forced else way.grid_cost,
        planner="+".join(work.stages),
        unmet=unmet,
        warnings=tuple(dict.fromkeys(work.warnings)),
        stats=clock.stats,
    )


def warm_up() -> None:
    """Compile or load the kernels and solvers of every stage, by small plans in a made-up room."""
    context = example_context()
    sampling.warm_up()
    smoothing.warm_up()
    warm_up_poses()
    small = PlanningProblem((1.0, 1.0), (5.0, 5.0), 0.2, deadline=30.0)
    for bound in (None, 0.05):
        plan(replace(small, max_r95=bound, refine=50), context, report=lambda _: None)
    belief_plan.warm_up(context)
    risk.warm_up(context.clearance, context.field.frame, context.centre_clearance)
    warm_up_fixes()
    outline = ((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2))
    plan(replace(small, footprint=outline, kinematics="differential"), context)
    plan(replace(small, avoid=(shapely.box(2.9, -1.0, 3.1, 9.0),)), context)
