"""Sampling as a refinement: where a cheaper path may lead, and for as long as that brings something."""

from __future__ import annotations

from maps.arrays import FloatArray
from planner import sampling
from planner.any_angle import shorten
from planner.clock import Clock
from planner.context import PlanningContext
from planner.grid_search import NEAR, Way
from planner.problem import PlanningProblem

# No more samples are drawn after so many in a row without a gain.
_PATIENCE = 40
# What is gained less than this share is left: polishing alone may gain as much.
_GAIN = 1e-5


def sampled_from(
    points: FloatArray,
    cost: float,
    way: Way,
    problem: PlanningProblem,
    context: PlanningContext,
    *,
    clock: Clock,
    share: float,
) -> tuple[FloatArray, float]:
    """Look for a path cheaper than the one at hand.

    Parameters
    ----------
    points, cost
        Shape (K, 2), W, m: a valid path, and its cost.
    way, problem, context
        The grid path that it came from, the question, the field.
    clock, share
        Sampling ends when this share of the time is over.

    Returns
    -------
    points, cost
        Those given where nothing cheaper was found.
    """
    space = way.graph.cost_space
    grid_cost = cost * sampling.OCTILE_EXCESS if way.grid_cost is None else way.grid_cost
    cells = way.cells
    if cells is None:
        with clock.stop_flag() as stop:
            cells = context.informed_cells(
                way.graph, problem.start, problem.goal, grid_cost * (1.0 + NEAR), stop=stop
            )
    if cells is None:
        return points, cost
    refined, _ = sampling.refine_with_ompl(
        space,
        problem.start,
        problem.goal,
        points,
        cells=cells,
        samples=problem.refine,
        deadline_at=clock.at(share),
        seed=problem.seed,
        patience=_PATIENCE,
    )
    if space.line_cost(refined) >= cost * (1.0 - _GAIN):
        return points, cost
    return shorten(refined, space, deadline_at=clock.at(share))
