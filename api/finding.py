"""Plans with all that may be asked for beside one route: alternatives, fronts, schedules of landmarks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from api.questions import AlternativesAsked, Found, FrontAsked, FrontPlace, ListedRoute, More
from api.schedule_notes import schedule_notes
from planner import landmark_schedule, pareto
from planner import plan as planning
from planner.alternatives import Alternatives, find_alternatives
from planner.clock import Clock
from planner.context import PlanningContext
from planner.example_context import example_context
from planner.landmark_plan import LandmarkPlan
from planner.landmark_schedule import BLIND_R95, schedule_landmarks
from planner.pareto import ParetoFront, pareto_front
from planner.problem import MAX_DEADLINE_S, MIN_DEADLINE_S, PlanningProblem
from planner.result import PlanResult, Trajectory
from planner.unmet import risky_in_words

Report = Callable[[Found], None]
# Part of the deadline in which routes are found when a schedule is asked for.
_ROUTES_SHARE = 0.7
# r95 without a fix where that is forbidden, as a multiple of the route's worst.
_FORBIDDEN = 3.0


def find(
    problem: PlanningProblem, context: PlanningContext, more: More, *, report: Report | None = None
) -> Found:
    """Answer a question.

    Parameters
    ----------
    problem, context
        As of :func:`planner.plan.plan`; the deadline is for everything.
    more
        What is asked for beside one route. With a front the objective is left aside.
    report
        Called with everything that is better than before.

    Raises
    ------
    PlannerError
        If the question is wrong, or asks for what does not go together.
    """
    clock = Clock(problem.deadline)
    hurried = problem
    if more.schedule:
        hurried = replace(problem, deadline=max(MIN_DEADLINE_S, _ROUTES_SHARE * problem.deadline))
    if more.front is not None:
        found = _front(hurried, context, more.front, report)
    elif more.alternatives is not None:
        found = _alternatives(hurried, context, more.alternatives, report)
    else:
        tell = None if report is None else _telling(report)
        found = Found.of(planning.plan(hurried, context, report=tell))
    found = _with_risk_said(found, problem)
    if not more.schedule:
        return found
    if report is not None:
        report(found)
    return _scheduled(found, context, problem, more.pan_rate, clock)


def _with_risk_said(found: Found, problem: PlanningProblem) -> Found:
    """The same with a warning for the first route that is likely to touch something, if any is."""
    for number, listed in enumerate(found.routes, 1):
        said = risky_in_words(problem, listed.route)
        if said is not None:
            where = f"Route {number}: " if len(found.routes) > 1 else ""
            warnings = (*found.result.warnings, where + said)
            return replace(found, result=replace(found.result, warnings=warnings))
    return found


def _telling(report: Report) -> Callable[[PlanResult], None]:
    return lambda result: report(Found.of(result))


def _alternatives(
    problem: PlanningProblem, context: PlanningContext, asked: AlternativesAsked, report: Report | None
) -> Found:
    clock = Clock(problem.deadline)

    def listed(found: Alternatives) -> Found:
        routes = zip(found.routes, found.shares, strict=True)
        result = replace(found.best, warnings=tuple(dict.fromkeys(found.best.warnings + found.warnings)))
        return Found(result, tuple(ListedRoute(route, share=share) for route, share in routes))

    def tell(found: Alternatives) -> None:
        if report is not None:
            report(listed(found))

    found = listed(
        find_alternatives(
            problem,
            context,
            count=asked.count,
            max_cost_factor=asked.max_cost_factor,
            max_share=asked.max_share,
            report=tell,
        )
    )
    if not 0 < len(found.routes) < asked.count or clock.is_over():
        return found
    said = (
        f"{len(found.routes)} of {asked.count} routes were found; others would cost more than "
        f"{asked.max_cost_factor:g} times the best one, or share more than {100 * asked.max_share:g} % of "
        "their length, or the search missed them."
    )
    return replace(found, result=replace(found.result, warnings=(*found.result.warnings, said)))


def _front(
    problem: PlanningProblem, context: PlanningContext, asked: FrontAsked, report: Report | None
) -> Found:
    notes = ("The factors of areas do not count in a front.",) if problem.areas else ()

    def listed(front: ParetoFront) -> Found:
        routes = tuple(
            ListedRoute(p.route, front=FrontPlace(front.against, p.r95, p.setting)) for p in front.points
        )
        first = routes[0].route if routes else None
        warnings = (*notes, *front.warnings)
        result = PlanResult(
            front.status, first, None, None, "pareto", front.unmet, warnings, blocked=front.blocked
        )
        return Found(result, routes)

    def tell(front: ParetoFront) -> None:
        if report is not None:
            report(listed(front))

    return listed(pareto_front(problem, context, against=asked.against, count=asked.count, report=tell))


def _scheduled(
    found: Found, context: PlanningContext, problem: PlanningProblem, pan_rate: float, clock: Clock
) -> Found:
    """The same routes with their schedules, as far as the time reaches."""
    routes: list[ListedRoute] = []
    warnings = list(found.result.warnings)
    # Bounds on the filter's belief are not bounds on single fixes.
    max_r95 = problem.max_r95 if problem.covariance == "fix" else None
    for number, listed in enumerate(found.routes, 1):
        if clock.is_over() and number > 1:
            warnings.append(f"The deadline came before the schedule of route {number}.")
            routes.append(listed)
            continue
        trajectory, summary = listed.route.trajectory, listed.route.summary
        blind_r95 = problem.blind_r95
        if blind_r95 is None:
            # To drive without a fix is forbidden: it must be far worse than any place of the route.
            blind_r95 = max(BLIND_R95, _FORBIDDEN * (summary.max_r95 or 0.0))
        at_rate = partial(_schedule, context, trajectory, blind_r95=blind_r95, pan_rate=pan_rate)
        plan = at_rate()
        warnings += schedule_notes(
            plan,
            number,
            blind=summary.blind,
            max_r95=max_r95,
            max_blind=problem.max_blind_distance,
            faster=None if clock.is_over() else at_rate,
        )
        routes.append(replace(listed, schedule=plan))
    return Found(replace(found.result, warnings=tuple(warnings)), tuple(routes))


def _schedule(
    context: PlanningContext,
    trajectory: Trajectory,
    factor: float = 1.0,
    *,
    blind_r95: float,
    pan_rate: float,
) -> LandmarkPlan:
    """With a pan head ``factor`` times as fast."""
    world, sensor = context.field.world, context.field.sensor
    return schedule_landmarks(world, sensor, trajectory, pan_rate=factor * pan_rate, blind_r95=blind_r95)


def warm_up(more: More | None = None) -> None:
    """Compile or load what plans need, in a made-up room; with ``more`` only what that asks for."""
    planning.warm_up()
    if more is None or more.front is not None:
        pareto.warm_up()
    if more is None or more.schedule:
        landmark_schedule.warm_up()
    if more is None or more.alternatives is not None or more.schedule:
        problem = PlanningProblem((1.0, 1.0), (5.0, 5.0), 0.2, weight=0.0, deadline=MAX_DEADLINE_S)
        find(problem, example_context(), More(AlternativesAsked(count=2), schedule=True))
