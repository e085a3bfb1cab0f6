"""Plans on the plant: time to the first and to the final path, cost against MCP_Geometric, on one cost grid."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from skimage.graph import MCP_Geometric

from localization.field_builder import build_field
from localization.sensors import LASER
from maps.io.load import load_world
from planner.context import PlanningContext
from planner.plan import plan, warm_up
from planner.problem import PlanningProblem
from tests.conftest import SHARED

TITLE = "Plan: 50 seeded pairs on the plant (0.1 m, radius 0.35 m, weight 4 per m)"
PAIRS = 50
RADIUS, WEIGHT = 0.35, 4.0


def pairs(context, blind_rate, rng):
    """Pairs of cell centres that a grid path connects."""
    graph = context.graph(radius=RADIUS, weight=WEIGHT, blind_rate=blind_rate)
    rows, cols = np.nonzero(graph.cost_space.passable)
    found = []
    while len(found) < PAIRS:
        i, j = rng.integers(len(rows), size=2)
        start, goal = (tuple(p) for p in graph.cost_space.centre(rows[[i, j]], cols[[i, j]]))
        if i != j and graph.costs_to(goal).path_from(start)[1] is not None:
            found.append((start, goal))
    return graph, found


def mcp_cost(graph, start, goal):
    """Cost and seconds of scikit-image's search between two cell centres."""
    space = graph.cost_space
    costs = np.where(space.passable, space.frame.resolution * space.rate, -1.0)
    (r0, c0), (r1, c1) = space.frame.cell_at([start, goal])
    began = time.perf_counter()
    theirs, _ = MCP_Geometric(costs).find_costs([(r0, c0)], [(r1, c1)])
    return float(theirs[r1, c1]), time.perf_counter() - began


def ms(values):
    """Median and 95th percentile of seconds, in milliseconds."""
    p50, p95 = 1000 * np.percentile(values, [50, 95])
    return f"{p50:.1f} / {p95:.1f}"


def run():
    site = SHARED / "landmark_maps" / "cob" / "ipa-production-plant"
    if not site.is_dir():
        return "the plant's map is not at hand"
    context = PlanningContext(build_field(load_world(site), LASER, resolution=0.1))
    warm_up()
    out = []
    for label, blind in (("forbidden", None), ("as r95 0.5 m", 0.5)):
        graph, ends = pairs(context, None if blind is None else 1 + WEIGHT * blind, np.random.default_rng(7))
        first, again, final, total, theirs, on_grid, excess = [], [], [], [], [], [], []
        stages: dict[str, int] = {}
        for start, goal in ends:
            problem = PlanningProblem(
                start, goal, RADIUS, weight=WEIGHT, blind_r95=blind, deadline=30.0, seed=1
            )
            result = plan(problem, context)
            first.append(result.stats["to_first_path_s"])
            final.append(result.stats["to_final_path_s"])
            total.append(result.stats["total_s"])
            # Only the first path is looked at: no sampling.
            again.append(plan(replace(problem, refine=0), context).stats["to_first_path_s"])
            cost, seconds = mcp_cost(graph, start, goal)
            theirs.append(seconds)
            on_grid.append(result.grid_cost / cost - 1)
            excess.append(result.route.summary.cost / cost - 1)
            for stage in result.planner.split("+"):
                stages[stage] = stages.get(stage, 0) + 1
        out.append(
            {
                "without a fix": label,
                "pairs": len(ends),
                "MCP_Geometric p50 / p95 [ms]": ms(theirs),
                "first path": ms(first),
                "goal again": ms(again),
                "final path": ms(final),
                "with the shortest beside it": ms(total),
                "grid cost − MCP, largest": f"{np.abs(on_grid).max():.0e}",
                "final cost − MCP p50": f"{100 * np.median(excess):.1f} %",
                "largest": f"{100 * max(excess):.1f} %",
                "improved by OMPL": stages.get("ompl", 0),
                "smooth": stages.get("casadi", 0),
            }
        )
        if max(excess) > 1e-9:
            raise AssertionError(f"A final path costs {max(excess):.2e} more than the grid's.")
    return out
