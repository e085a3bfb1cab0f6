"""Which bounds a place itself breaks, whatever way leads there, in words."""

from __future__ import annotations

import numpy as np

from localization import covariance as cov
from planner.context import PlanningContext
from planner.cost_to_go import Place
from planner.extras import judged_covariance
from planner.problem import PlanningProblem
from planner.risk import collision_risk
from planner.unmet import no_fix_in_words, round_down, round_up


def bounds_broken_at(place: Place, problem: PlanningProblem, context: PlanningContext) -> tuple[str, ...]:
    """What keeps a place from being on any way of a question: its bounds, with the values there.

    Parameters
    ----------
    place
        (x, y) in W, m, on the field; the robot fits there.
    problem
        For its bounds and its radius; the ends play no part.
    context
        The field.

    Returns
    -------
    reasons
        Each without a full stop; empty when the place keeps all.
    """
    row, col = (int(v) for v in context.field.frame.cell_at(place))
    r95 = float(context.r95[row, col])
    out = []
    if np.isnan(r95) and problem.blind_r95 is None:
        out.append(f"there is no fix: {no_fix_in_words(context.field, place)}")
    if problem.max_r95 is not None and r95 > problem.max_r95:
        out.append(f"r95 is {round_up(r95)} m and max_r95 {problem.max_r95:g} m")
    axis = float(cov.ellipse95(context.field.covariance[row, col])[0])
    if problem.max_ellipse95 is not None and axis > problem.max_ellipse95:
        out.append(
            f"the 95 % ellipse's semi-major axis is {round_up(axis)} m and max_ellipse95 "
            f"{problem.max_ellipse95:g} m"
        )
    limit = problem.max_collision_probability
    if limit is not None:
        blind = problem.blind_r95
        covariance = judged_covariance(context.field, blind)[row, col]
        risk = float(collision_risk(context.clearance, [place], [covariance], problem.radius).tight[0])
        if risk > limit:
            room = float(context.clearance.distance([place])[0]) - problem.radius
            out.append(
                f"the collision probability is {round_up(risk)}, with {round_down(room)} m of room, and "
                f"max_collision_probability {limit:g}"
            )
    return tuple(out)
