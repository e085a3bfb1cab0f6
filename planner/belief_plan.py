"""Plans over (place, uncertainty): by the filter's belief, or with a bound on the way without a fix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planner.belief_words import without_search
from planner.belief_work import SEARCH_SHARE, BeliefWork
from planner.blind_plan import BlindWork
from planner.clock import Clock
from planner.context import PlanningContext
from planner.dead_reckoning import with_dead_reckoning
from planner.fused_plan import FusedWork
from planner.problem import MAX_DEADLINE_S, PlanningProblem
from planner.result import PlanResult, PlanStatus, Route

Baseline = Callable[[], Route | None]


def plan_by_belief(
    problem: PlanningProblem, context: PlanningContext, clock: Clock, *, baseline: Baseline
) -> PlanResult:
    """Answer a question with ``covariance="fused"`` or a bound on the distance without a fix.

    Parameters
    ----------
    problem, context
        The question and the field.
    clock
        Of the plan.
    baseline
        Makes the shortest route for the same robot.

    Returns
    -------
    result
        ``EXACT`` when the label search ended by itself and its bounds hold on the path that is driven;
        ``RISK_UNMET`` with the smallest bounds possible otherwise; ``TIMEOUT`` with the shortest route,
        whatever its bounds, when the deadline came before the search had a path. Never worse, by bounds
        and objective, than the shortest route beside it.

    Raises
    ------
    InvalidProblem
        If the belief at the start is neither given nor that of a fix there.
    """
    work: BeliefWork = (FusedWork if problem.covariance == "fused" else BlindWork)(problem, context, clock)
    with clock.stage("grid"), clock.stop_flag() as stop:
        work.search_plain(stop)
    if clock.is_over():
        return _late(work)
    with clock.stage("labels"), clock.stop_flag(share=SEARCH_SHARE) as stop:
        found = work.search(stop)
    if not found.has_path:
        return _no_path(problem, clock) if found.is_complete else _late(work)
    with clock.stage("smoothing"):
        route, stages = work.route()
    clock.seconds["to_final_path"] = clock.elapsed
    with clock.stage("shortest"):
        shortest = baseline()
        if shortest is not None:
            shortest = work.told(shortest)
            if work.prefers(shortest, route):
                route, stages = shortest, ["any_angle"]
    return _result(work, route, shortest, ["label_search", *stages])


def _result(work: BeliefWork, route: Route, shortest: Route | None, stages: list[str]) -> PlanResult:
    found, clock = work.found, work.clock
    unmet = work.unmet(route)
    status = PlanStatus.EXACT if found.is_complete else PlanStatus.APPROXIMATE
    warnings = []
    if not found.is_complete:
        warnings.append(
            f"The deadline of {work.problem.deadline:g} s came before the search over beliefs ended."
        )
    return PlanResult(
        status=PlanStatus.RISK_UNMET if unmet else status,
        route=route,
        shortest=shortest,
        grid_cost=found.cost if found.is_complete else None,
        planner="+".join(stages),
        unmet=unmet,
        warnings=tuple(warnings),
        stats=clock.stats,
    )


def _late(work: BeliefWork) -> PlanResult:
    """The shortest way as best effort, when the search had no path in time."""
    clock, problem = work.clock, work.problem
    if work.plain is None:
        said = f"The deadline of {problem.deadline:g} s came before any path was found; allow more time."
        return PlanResult(
            PlanStatus.TIMEOUT, None, None, None, "label_search", warnings=(said,), stats=clock.stats
        )
    with clock.stage("annotate"):
        route = work.of_plain(work.plain)
        unmet = work.unmet(route, searched=False)
    return PlanResult(
        status=PlanStatus.TIMEOUT,
        route=route,
        shortest=route,
        grid_cost=None,
        planner="grid_search+any_angle",
        unmet=unmet,
        warnings=(without_search(problem, unmet, judged=work.is_ready),),
        stats=clock.stats,
    )


def _no_path(problem: PlanningProblem, clock: Clock) -> PlanResult:
    said = (
        f"Start and goal are not connected for a robot of radius {problem.radius:g} m under these "
        "bounds, however far it drives without a fix."
    )
    return PlanResult(
        PlanStatus.NO_PATH, None, None, None, "label_search", warnings=(said,), stats=clock.stats
    )


def warm_up(context: PlanningContext) -> None:
    """Compile or load what plans over beliefs need, in a room of at least 6 m × 6 m."""
    start, goal = (1.0, 1.0), (5.0, 5.0)
    problems = (
        PlanningProblem(
            start, goal, 0.2, covariance="fused", max_collision_probability=0.5, max_blind_distance=1.0
        ),
        PlanningProblem(start, goal, 0.2, max_blind_distance=1.0),
    )
    for problem in problems:
        made = plan_by_belief(problem, context, Clock(MAX_DEADLINE_S), baseline=lambda: None)
        if made.route is not None:
            known = np.arange(len(made.route.path.s)) % 3 == 0
            blind = replace(made.route, path=replace(made.route.path, has_fix=known))
            with_dead_reckoning(blind, context, problem.odometry, None)
