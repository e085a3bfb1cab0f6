"""In words: which bounds a plan over beliefs does not keep, where, and what would be possible."""

from __future__ import annotations

import numpy as np

from localization import covariance as cov
from planner.fused_judge import ROUNDING, Judged, Reached
from planner.label_search import Stretches
from planner.problem import PlanningProblem
from planner.result import Route, Unmet
from planner.unmet import round_up

_BLIND = "max_blind_distance_m"
# constraint -> words, unit
_WORDS = {
    "max_r95_m": ("r95", " m"),
    "max_ellipse95_m": ("the 95 % ellipse's semi-major axis", " m"),
    "max_collision_probability": ("the collision probability of every pose", ""),
    _BLIND: ("every stretch without a fix", " m"),
}
# Metres from an end that are the end itself.
_AT_END_M = 0.05


def unmet_by_filter(judged: Judged, problem: PlanningProblem, *, searched: bool) -> tuple[Unmet, ...]:
    """Bounds that a way does not keep by the filter; ``smallest_possible`` is what the way itself reaches.

    Parameters
    ----------
    judged
        The way that is returned: the one that exceeds the bounds least.
    problem
        The question.
    searched
        Whether a way that keeps them was looked for.
    """
    length = float(judged.along[-1])
    missed = [r for r in judged.reached if not r.is_kept]
    # The start breaks a bound whatever the others are.
    several = searched and sum(r.at > _AT_END_M or r.bound == _BLIND for r in missed) > 1
    out = []
    for r in missed:
        words, unit = _WORDS[r.bound]
        begin = f"By the filter's belief no path was found that keeps {words} at or below {r.asked:g}{unit}"
        if not searched:
            begin = f"By the filter's belief the route does not keep {words} at or below {r.asked:g}{unit}"
        if several:
            begin += " with the other bounds; all were widened by one factor, as little as possible"
        message = f"{begin}. {_where(r, length)} {_remedy(r, problem)}"
        out.append(Unmet(r.bound, r.asked, r.value, r.place, r.value if searched else None, message))
    return tuple(out)


def _where(r: Reached, length: float) -> str:
    value, (x, y) = f"{round_up(r.value)}{_WORDS[r.bound][1]}", r.place
    if r.bound == _BLIND:
        return f"The route returned drives {value} without a fix, from ({x:.2f}, {y:.2f}) m on."
    if r.at <= _AT_END_M:
        return f"It is {value} at the start itself, ({x:.2f}, {y:.2f}) m, and no path changes that."
    place = f"at ({x:.2f}, {y:.2f}) m, after {r.at:.1f} of {length:.1f} m"
    if r.at >= length - _AT_END_M:
        place = f"at the goal itself, ({x:.2f}, {y:.2f}) m"
    return f"The route returned is worst {place}: {value}."


def _remedy(r: Reached, problem: PlanningProblem) -> str:
    raised = f"Raise {r.bound} to {round_up(r.value)}"
    if r.bound == _BLIND or r.at > _AT_END_M:
        return f"{raised}, or place landmarks there."
    if problem.start_covariance is None:
        return f"{raised}, give the covariance at the start if it is surer than one fix, or start elsewhere."
    return f"{raised}, start with a surer belief than the covariance given, or start elsewhere."


def bounds_of_cells_missed(route: Route, problem: PlanningProblem) -> tuple[Unmet, ...]:
    """Bounds on single fixes that a route does not keep, which a search over cells should have kept.

    Parameters
    ----------
    route, problem
        What is returned, and the question.
    """
    s, path = route.summary, route.path
    pairs = (
        ("max_r95_m", problem.max_r95, s.max_r95, path.r95),
        ("max_ellipse95_m", problem.max_ellipse95, s.max_ellipse95, cov.ellipse95(path.covariance)[:, 0]),
        (
            "max_collision_probability",
            problem.max_collision_probability,
            s.max_collision_probability,
            path.collision_probability,
        ),
    )
    out = []
    for name, asked, value, along in pairs:
        if asked is None or value is None or value <= asked * (1 + ROUNDING):
            continue
        words, unit = _WORDS[name]
        x, y = path.points[int(np.argmax(np.nan_to_num(along, nan=-1.0)))].tolist()
        message = (
            f"The route does not keep {words} at or below {asked:g}{unit}: it is {round_up(value)}{unit} at "
            f"({x:.2f}, {y:.2f}) m."
        )
        out.append(Unmet(name, asked, value, (x, y), None, message))
    return tuple(out)


def unmet_blind_distance(route: Route, lines: Stretches, asked: float, possible: float | None) -> Unmet:
    """The bound on stretches without a fix, where even the best path drives further.

    Parameters
    ----------
    route, lines
        What is returned, and its stretches.
    asked, possible
        The bound, and the smallest with which there is a path, m; None where that was not searched.
    """
    path = route.path
    at = lines.longest_from
    x, y = (float(np.interp(at, path.s, path.points[:, k])) for k in (0, 1))
    begin = f"The route does not keep every stretch without a fix at or below {asked:g} m"
    remedy = "Place landmarks there."
    if possible is not None:
        least = round_up(possible)
        begin = (
            f"No path keeps every stretch without a fix at or below {asked:g} m; the smallest bound that has "
            f"a path is {least} m"
        )
        remedy = f"Place landmarks there, or raise max_blind_distance_m to {least}."
    message = (
        f"{begin}. The route returned drives {round_up(lines.longest)} m without one, from "
        f"({x:.2f}, {y:.2f}) m on. {remedy}"
    )
    return Unmet(_BLIND, asked, lines.longest, (x, y), possible, message)


def without_search(problem: PlanningProblem, unmet: tuple[Unmet, ...], *, judged: bool) -> str:
    """What to say of the shortest route that stands in for one that was not found in time.

    Parameters
    ----------
    problem, unmet
        The question, and bounds that the route breaks.
    judged
        Whether there was time to look at them.
    """
    said = (
        f"The deadline of {problem.deadline:g} s came before the search over beliefs had a path; the route "
        "returned is the shortest one, searched without bounds."
    )
    if not judged:
        return f"{said} Its bounds were not checked, and its uncertainty is that of single fixes."
    if not unmet:
        return f"{said} It keeps all bounds that were asked for, but nothing better was looked for."
    broken = ", ".join(
        f"{u.bound} ({round_up(u.value)}{_WORDS[u.bound][1]} instead of {u.limit:g})" for u in unmet
    )
    return f"{said} It breaks {broken}; allow more time."
