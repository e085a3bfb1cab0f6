"""In words: which bound a route does not keep, where, and what would be possible."""

from __future__ import annotations

import math

import numpy as np

from localization import covariance as cov
from localization.uncertainty_field import UncertaintyField
from planner.context import PlanningContext
from planner.cost_to_go import Place
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
    for name, least in way.relaxed:
        out.append(_bound_not_kept(name, least, problem, route, cell))
    summary = route.summary
    limit = problem.max_collision_probability
    if limit is not None and not keeps_risk(route, limit) and not any(u.bound == _RISK for u in out):
        out.append(_bound_missed(limit, route, way, problem))
    if way.is_blind_forced:
        x, y = _first_blind_place(route)
        names = [n for n, k in (("start", 0), ("goal", -1)) if np.isnan(route.path.r95[k])]
        ends = "".join(
            f" The {name} itself has none: {no_fix_in_words(context.field, getattr(problem, name))}."
            for name in names
        )
        remedy = "Give blind_r95_m to accept such stretches at a cost"
        if problem.blind_r95 is not None:
            remedy = f"They count as r95 = {problem.blind_r95:g} m; a bound from there on opens them"
        message = (
            f"Every path crosses places without a fix (fewer than three usable landmarks in view).{ends} The "
            f"route returned drives {summary.blind:.2f} m without one, as little as possible, first at "
            f"({x:.2f}, {y:.2f}) m. {remedy}, or place landmarks there."
        )
        out.append(Unmet("blind", 0.0, summary.blind, (x, y), None, message))
    return tuple(out)


_RISK = "max_collision_probability"
# constraint -> attribute of the problem, of the summary, words, unit
_BOUNDS = {
    "max_r95_m": ("max_r95", "max_r95", "r95", " m"),
    "max_ellipse95_m": ("max_ellipse95", "max_ellipse95", "the 95 % ellipse's semi-major axis", " m"),
    "max_collision_probability": (
        "max_collision_probability",
        "max_collision_probability",
        "the collision probability of every pose",
        "",
    ),
}


def _bound_not_kept(name: str, least: float, problem: PlanningProblem, route: Route, cell: float) -> Unmet:
    asked, reached, words, unit = _BOUNDS[name]
    limit = getattr(problem, asked)
    got = getattr(route.summary, reached)
    value = least if got is None else got
    x, y = _place_of_worst(name, route)
    message = (
        f"No path keeps {words} at or below {limit:g}{unit}. The smallest bound that has a path is "
        f"{round_up(least)}{unit} (on cells of {cell:g} m); the route returned "
    )
    if value <= least * (1 + 1e-9):
        message += f"keeps it and is worst, {round_up(value)}{unit}, at ({x:.2f}, {y:.2f}) m."
    else:
        message += f"keeps it at their centres and has {round_up(value)}{unit} at ({x:.2f}, {y:.2f}) m."
    enough = f"Raise {name} to {round_up(max(least, value))}, or place landmarks there."
    if name == _RISK:
        k = worst_pose(route)
        ends = ends_over(limit, route)
        message += f" There the robot has {_room(route, k):.2f} m of room."
        if ends:
            message += f" {ends}"
            enough = f"Move it, or raise {name} to {round_up(max(least, value))}."
    return Unmet(name, limit, value, (x, y), least, f"{message} {enough}")


def keeps_risk(route: Route, limit: float) -> bool:
    """Whether no waypoint's collision probability is above a limit."""
    worst = route.summary.max_collision_probability
    return worst is None or worst <= limit * (1 + 1e-9)


def _bound_missed(limit: float, route: Route, way: Way, problem: PlanningProblem) -> Unmet:
    """The grid has a path within the limit, or was not judged by it, and the route does not keep it."""
    x, y = _place_of_worst(_RISK, route)
    k = worst_pose(route)
    value = float(route.path.collision_probability[k])
    message = (
        f"The route's collision probability is {round_up(value)} at ({x:.2f}, {y:.2f}) m, where the robot "
        f"has {_room(route, k):.2f} m of room; {limit:g} was asked for. "
    )
    ends = ends_over(limit, route)
    if way.is_unjudged:
        message += f"The deadline of {problem.deadline:g} s was too short to keep it: allow more time. "
    elif not ends:
        message += "The centres of the cells keep it: a field on smaller cells may help."
    return Unmet(_RISK, limit, value, (x, y), None, (message + ends).rstrip())


#: From this collision probability of a pose on, a route comes with a warning when no bound was asked for.
RISKY = 0.01


def risky_in_words(problem: PlanningProblem, route: Route) -> str | None:
    """A warning where a route is likely to touch something and no bound on that was asked for; else None."""
    worst = route.summary.max_collision_probability
    if problem.max_collision_probability is not None or worst is None or worst < RISKY:
        return None
    k = worst_pose(route)
    x, y = route.path.points[k]
    return (
        f"At ({x:.2f}, {y:.2f}) m the robot has {round_down(_room(route, k))} m of room and touches "
        f"something with a probability of up to {100 * worst:.2g} %, by the error of its place there; "
        "max_collision_probability bounds that."
    )


def unjudged_in_words(problem: PlanningProblem) -> str:
    """That the bound on collisions was left aside."""
    return (
        f"The deadline of {problem.deadline:g} s came before all cells were judged by their collision "
        "probability: the route was searched without that bound."
    )


def worst_pose(route: Route) -> int:
    """Index of the waypoint with the largest collision probability."""
    return int(np.argmax(np.nan_to_num(route.path.collision_probability, nan=-1.0)))


def _room(route: Route, k: int) -> float:
    return max(0.0, float(route.path.clearance[k]))


def ends_over(limit: float, route: Route) -> str:
    """In words which end breaks a bound on collisions whatever way leads there; empty when none does."""
    out = []
    for name, k in (("start", 0), ("goal", -1)):
        value = float(route.path.collision_probability[k])
        if value > limit * (1 + 1e-9):
            room = f"{_room(route, k):.2f} m of room"
            out.append(f"The {name} itself breaks it, whatever way is taken: {round_up(value)}, with {room}.")
    return " ".join(out)


def round_up(value: float) -> str:
    """Three significant digits, rounded up: as a bound the number in the text must be enough."""
    if value <= 0:
        return "0"
    scale = 10.0 ** (2 - math.floor(math.log10(value)))
    return f"{math.ceil(value * scale * (1 - 1e-12)) / scale:.6g}"


def round_down(value: float) -> str:
    """Millimetres, rounded down: as room the number in the text must not be too much."""
    return f"{math.floor(max(value, 0.0) * 1000 + 1e-6) / 1000:g}"


def _place_of_worst(name: str, route: Route) -> tuple[float, float]:
    points, s = route.path.points, route.path.s
    if name == "max_r95_m":
        at = route.summary.worst_at
        if at is None:
            return (float(points[0, 0]), float(points[0, 1]))
        return (float(np.interp(at, s, points[:, 0])), float(np.interp(at, s, points[:, 1])))
    values = route.path.collision_probability
    if name == "max_ellipse95_m":
        values = cov.ellipse95(route.path.covariance)[:, 0]
    k = int(np.argmax(np.nan_to_num(values, nan=-1.0)))
    return (float(points[k, 0]), float(points[k, 1]))


def no_fix_in_words(field: UncertaintyField, place: Place) -> str:
    """Why there is no fix at a place on the field: how many landmarks are in view there."""
    row, col = (int(v) for v in field.frame.cell_at(place))
    n = int(field.n_visible[row, col])
    seen = {0: "no landmark is", 1: "1 landmark is"}.get(n, f"{n} landmarks are")
    why = "and a fix needs three" if n < 3 else "but no three give a usable fix"
    return f"{seen} in view there, {why}"


def _first_blind_place(route: Route) -> tuple[float, float]:
    blind = np.isnan(route.path.r95)
    k = int(np.argmax(blind)) if blind.any() else 0
    return (float(route.path.points[k, 0]), float(route.path.points[k, 1]))
