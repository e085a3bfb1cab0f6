"""Bounds that the route of a robot with a heading does not keep, in words that say what would help."""

from __future__ import annotations

import numpy as np

from localization import covariance as cov
from planner.grid_search import Bounds
from planner.problem import PlanningProblem, blind_rate_of
from planner.result import Route, Unmet
from planner.unmet import round_up

_ROUNDING = 1e-6
_WORDS = {
    "max_r95_m": ("r95", " m"),
    "max_ellipse95_m": ("the 95 % ellipse's semi-major axis", " m"),
    "max_collision_probability": ("the collision probability of every pose", ""),
}


def measured(route: Route, bounds: Bounds) -> float:
    """Largest of the route's figures as a multiple of its bound; 0 without bounds."""
    s = route.summary
    found = {
        "max_r95_m": s.max_r95,
        "max_ellipse95_m": s.max_ellipse95,
        "max_collision_probability": s.max_collision_probability,
    }
    ratios = [(found[name] or 0.0) / getattr(bounds, name) for name in bounds.given()]
    return max((r if r > 1 + _ROUNDING else min(r, 1.0) for r in ratios), default=0.0)


def unmet_at_poses(
    problem: PlanningProblem, route: Route, *, is_relaxed: bool, least: float
) -> tuple[Unmet, ...]:
    """What a route does not keep.

    Parameters
    ----------
    problem, route
        The question and its answer.
    is_relaxed
        Whether bounds had to be raised, or places without a fix crossed.
    least
        Factor of the bounds up to which it is known that there is no way.
    """
    path, summary = route.path, route.summary
    figures = {
        "max_r95_m": (problem.max_r95, summary.max_r95, path.r95),
        "max_ellipse95_m": (
            problem.max_ellipse95,
            summary.max_ellipse95,
            cov.ellipse95(path.covariance)[:, 0],
        ),
        "max_collision_probability": (
            problem.max_collision_probability,
            summary.max_collision_probability,
            path.collision_probability,
        ),
    }
    out = []
    for name, (limit, value, along) in figures.items():
        if limit is None or value is None or value <= limit * (1 + _ROUNDING):
            continue
        x, y = (float(v) for v in path.points[int(np.argmax(np.nan_to_num(along, nan=-1.0)))])
        words, unit = _WORDS[name]
        said = f"({x:.2f}, {y:.2f}) m"
        if is_relaxed:
            message = (
                f"No way for this robot keeps {words} at {limit:g}{unit}; the best one found reaches "
                f"{round_up(value)}{unit}, at {said}. Raise {name} to {round_up(value)}"
                + (f" (below {round_up(least * limit)} there is none)" if least > 1 else "")
                + ", or place landmarks there."
            )
        else:
            message = (
                f"Between the cells and headings that were searched {words} reaches {round_up(value)}{unit} "
                f"at {said}, above {limit:g}{unit}; ask for a little less, or use smaller cells and more "
                "headings."
            )
        out.append(Unmet(name, limit, value, (x, y), value if is_relaxed else None, message))
    closed = blind_rate_of(1.0, problem.blind_r95, problem.max_r95, problem.max_ellipse95) is None
    if closed and summary.blind > _ROUNDING:
        out.append(_blind(problem, route, is_relaxed=is_relaxed))
    return tuple(out)


def _blind(problem: PlanningProblem, route: Route, *, is_relaxed: bool) -> Unmet:
    path, blind = route.path, route.summary.blind
    x, y = (float(v) for v in path.points[int(np.argmax(np.isnan(path.r95)))])
    remedy = "give blind_r95_m to accept such stretches at a cost"
    if problem.blind_r95 is not None:
        remedy = f"they count as r95 = {problem.blind_r95:g} m, a bound from there on opens them"
    cause = (
        "Every way for this robot crosses places without a fix at the heading driven"
        if is_relaxed
        else "Between the cells and headings that were searched there are places without a fix"
    )
    message = (
        f"{cause}. The route returned drives {round_up(blind)} m without one, first at ({x:.2f}, {y:.2f}) m. "
        f"Place landmarks there, or {remedy}."
    )
    return Unmet("blind", 0.0, blind, (x, y), None, message)
