"""Answers where there is no way: what keeps the robot from the goal, where, by how much, in words."""

from __future__ import annotations

from dataclasses import replace

from planner.clock import Clock
from planner.context import PlanningContext
from planner.problem import PlanningProblem
from planner.result import Blockage, PlanResult, PlanStatus
from planner.unmet import round_down
from planner.widest import Narrowest, Stop, narrowest_of_widest


def nothing_found(
    problem: PlanningProblem, context: PlanningContext, clock: Clock, *, proven: bool
) -> PlanResult:
    """Answer where there is no path, or none was found in time.

    Parameters
    ----------
    problem
        The question.
    context
        Of the cells that were searched.
    clock
        Of the plan: what blocks the way is searched in the time that is left.
    proven
        Whether it is proven that start and goal are not connected.
    """
    if not proven and clock.is_over():
        return PlanResult(
            PlanStatus.TIMEOUT, None, None, None, "grid_search", warnings=(_late(problem),), stats=clock.stats
        )
    blocked = blockage(problem, context, clock)
    said = _in_words(problem, context, blocked, proven=proven)
    return PlanResult(
        PlanStatus.NO_PATH,
        None,
        None,
        None,
        "grid_search",
        warnings=(said,),
        stats=clock.stats,
        blocked=blocked,
    )


def explained(
    result: PlanResult, problem: PlanningProblem, context: PlanningContext, clock: Clock
) -> PlanResult:
    """Another search's answer: where it has no path, with what blocks the way of the robot asked for.

    Where the deadline came first, the one that was given is named.
    """
    if result.route is not None:
        return result
    if result.status is PlanStatus.TIMEOUT:
        return replace(result, warnings=(_late(problem),))
    if result.status is not PlanStatus.NO_PATH:
        return result
    blocked = blockage(problem, context, clock)
    if blocked is not None and blocked.largest_radius < problem.inner_radius:
        said = _in_words(problem, context, blocked, proven=False)
        return replace(result, blocked=blocked, warnings=(said,))
    disc = f"a robot of radius {problem.inner_radius:g} m"
    return replace(result, warnings=tuple(w.replace(disc, problem.robot_in_words) for w in result.warnings))


def _late(problem: PlanningProblem) -> str:
    return f"The deadline of {problem.deadline:g} s came before any path was found; allow more time."


def blockage(problem: PlanningProblem, context: PlanningContext, clock: Clock) -> Blockage | None:
    """What blocks the way of a robot, walls and areas to avoid considered; None when it is not known in time.

    Areas are dropped, those beside the narrowest place first, until the robot passes: they block its way.
    """
    if clock.is_over():
        return None
    with clock.stop_flag() as stop:
        first = _narrowest(problem, context, tuple(range(len(problem.avoid))), stop)
        if first is None:
            return None
        blocking: list[int] = []
        without: float | None = None
        now: Narrowest | None = first
        while now is not None and now.areas and now.largest_radius < problem.inner_radius:
            left = [k for k in range(len(problem.avoid)) if k + 1 not in blocking]
            beside = [left[number - 1] + 1 for number in now.areas]
            blocking += beside
            left = [k for k in left if k + 1 not in beside]
            now = _narrowest(problem, context, tuple(left), stop)
            without = None if now is None else now.largest_radius
    return Blockage(
        first.place,
        problem.inner_radius,
        first.largest_radius,
        first.between,
        tuple(sorted(blocking)),
        without,
    )


def _narrowest(
    problem: PlanningProblem, context: PlanningContext, areas: tuple[int, ...], stop: Stop
) -> Narrowest | None:
    obstacles = context.obstacles(tuple(problem.avoid[k] for k in areas))
    return narrowest_of_widest(obstacles, context.field.frame, problem.start, problem.goal, stop=stop)


def _in_words(
    problem: PlanningProblem, context: PlanningContext, blocked: Blockage | None, *, proven: bool
) -> str:
    said = f"Start and goal are not connected for {problem.robot_in_words}"
    cells = f"cells of {context.field.frame.resolution:g} m"
    caveat = (
        ""
        if proven
        else f" This holds on {cells}; a passage that leaves less than half a cell on both sides of the "
        "robot may be missed."
    )
    if blocked is None:
        return f"{said}.{caveat}"
    x, y = blocked.place
    at = f"({x:.2f}, {y:.2f}) m"
    if blocked.largest_radius >= blocked.radius:
        spare = blocked.largest_radius - blocked.radius
        return (
            f"{said} on {cells}: the widest passage, at {at}, leaves it {round_down(spare)} m on both sides. "
            "A field on smaller cells may find a way."
        )
    if blocked.largest_radius > 0:
        needs = "needs" if problem.footprint is None else "needs at least"
        said += (
            f": the widest way leaves {round_down(2 * blocked.largest_radius)} m between "
            f"{_beside(blocked)} at {at}, and this robot {needs} {2 * blocked.radius:g} m."
        )
        if problem.footprint is None:
            said += f" A radius of up to {round_down(blocked.largest_radius)} m passes."
    elif blocked.areas:
        said += f": {_areas(blocked)} {'closes' if len(blocked.areas) == 1 else 'close'} every way."
    else:
        said += f", nor for a smaller one: walls close every way that {cells} show, and are thinnest at {at}."
    return said + _without(blocked, problem) + caveat


def _without(blocked: Blockage, problem: PlanningProblem) -> str:
    if not blocked.areas or blocked.radius_without_areas is None:
        return ""
    most = blocked.radius_without_areas
    if most < blocked.radius:
        return f" Without {_areas(blocked)} the walls leave {round_down(2 * most)} m, too little as well."
    if problem.footprint is not None:
        return f" Without {_areas(blocked)} the walls leave {round_down(2 * most)} m."
    return f" Without {_areas(blocked)} a radius of up to {round_down(most)} m passes."


def _areas(blocked: Blockage) -> str:
    *most, last = (str(k) for k in blocked.areas)
    return f"avoid areas {', '.join(most)} and {last}" if most else f"avoid area {last}"


def _beside(blocked: Blockage) -> str:
    a, b = (f"avoid area {k}" if k else "a wall" for k in blocked.between)
    return "two walls" if a == b == "a wall" else f"{a} and {b}"
