"""The smallest collision probability per pose under which a way exists, found without judging every cell."""

from __future__ import annotations

import math

import numpy as np

from maps.arrays import BoolArray, FloatArray
from planner.clock import Stopped
from planner.context import PlanningContext
from planner.cost_to_go import GridGraph, Place, smallest_bound
from planner.extras import judged_covariance
from planner.risk import Stop, cell_probabilities, risky_cells

# Limits that are tried, each this many times the one before.
_STEP = 4.0


def smallest_risk(
    context: PlanningContext,
    graph: GridGraph,
    start: Place,
    goal: Place,
    *,
    above: float,
    blind_r95: float | None,
    stop: Stop | None = None,
) -> float:
    """Smallest bound on the collision probability with which the goal can be reached on the grid.

    Larger limits are tried until there is a way: whether a cell exceeds a limit is soon known. Exact
    probabilities are made only of the cells between the last two limits, among which is the answer.

    Parameters
    ----------
    context
        Field, clearance, and what is known already.
    graph
        Of a cost space without a bound on collisions.
    start, goal
        (x, y) in W, m.
    above
        Limit under which there is no way.
    blind_r95
        What stands for r95 without a fix, m; None: such cells are not judged.
    stop
        Shape (1,); another thread sets it to end early.

    Returns
    -------
    bound
        With it as limit a path exists, with less there is none; 1 where some pose touches; inf when there is
        no path at all.

    Raises
    ------
    Stopped
        If the flag was set before the end.
    """
    radius = graph.cost_space.radius
    frame, clearance, room = context.field.frame, context.clearance, context.centre_clearance
    covariance = judged_covariance(context.field, blind_r95)

    def least(values: FloatArray | BoolArray) -> float:
        if stop is not None and stop[0] != 0:
            raise Stopped
        return smallest_bound(graph, np.asarray(values, dtype=np.float64), start, goal)

    risky = context.risky(above, radius=radius, blind_r95=blind_r95, stop=stop)
    limit = above
    while True:
        limit *= _STEP
        if limit >= 1:
            between, beyond = risky, np.zeros_like(risky)
            break
        over = risky_cells(
            clearance, frame, room, covariance, radius=radius, limit=limit, among=risky, stop=stop
        )
        found = least(over)
        if not math.isfinite(found):
            return found
        if found == 0:
            between, beyond = risky & ~over, over
            break
        risky = over
    values = cell_probabilities(clearance, frame, room, covariance, radius=radius, among=between, stop=stop)
    values = np.where(beyond, 1.0, np.nan_to_num(values, nan=0.0))
    bound = least(values)
    if above < bound < 1:
        context.keep_risky(values > bound, bound, radius=radius, blind_r95=blind_r95)
    return bound
