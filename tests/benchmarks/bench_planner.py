"""Whole plans on real and synthetic floors: time, success, and cost against the grid and the best path known."""

from __future__ import annotations

import math
import time

import numpy as np

from planner import sampling
from planner.any_angle import shorten
from planner.plan import plan, warm_up
from planner.problem import PlanningProblem
from tests.benchmarks.planning import BLIND_R95, RADIUS, WEIGHT, available, case, ms

PAIRS = 100
TITLE = (
    f"Plan: {PAIRS} seeded pairs (radius {RADIUS:g} m, weight {WEIGHT:g} per m, without a fix as at r95 = "
    f"{BLIND_R95:g} m; p50 / p95, processor time of the thread that plans)"
)
# The best path known is searched for the first pairs: so many samples around the path, another seed.
BEST, BEST_SAMPLES = 20, 1000


def run():
    warm_up()
    return [_row(name) for name in available()]


def _row(name):
    it = case(name, PAIRS)
    context = it.context
    for graph in (it.graph, it.length):
        context.prepare(graph)
    context.background.add = lambda *_: None  # nothing else runs while plans are timed
    cold, wall, route_only, cached, cached_route, over_grid, over_best, taut_over_best = (
        [] for _ in range(8)
    )
    n_ok = n_smooth = n_ompl = 0
    for k, (start, goal) in enumerate(it.pairs):
        problem = PlanningProblem(
            start, goal, RADIUS, weight=WEIGHT, blind_r95=BLIND_R95, deadline=30.0, seed=1
        )
        began = time.perf_counter(), time.thread_time()
        result = plan(problem, context)
        wall.append(time.perf_counter() - began[0])
        cold.append(time.thread_time() - began[1])
        route_only.append(result.stats["to_final_path_s"])
        if result.route is None:
            continue
        n_ok += 1
        n_smooth += "casadi" in result.planner
        n_ompl += "ompl" in result.planner
        over_grid.append(result.route.summary.cost / result.grid_cost - 1)
        if k < BEST:
            best, taut = _best_known(it, problem, result)
            over_best.append(result.route.summary.cost / best - 1)
            taut_over_best.append(taut / best - 1)
        for graph in (it.graph, it.length):
            context.costs_to(graph, goal)
        began = time.thread_time()
        again = plan(problem, context)
        cached.append(time.thread_time() - began)
        cached_route.append(again.stats["to_final_path_s"])
        if again.route.summary.cost != result.route.summary.cost:
            raise AssertionError(f"{name}: a known goal changes the answer for {problem}.")
    if max(over_grid) > 1e-9:
        raise AssertionError(f"{name}: a final path costs {max(over_grid):.2e} more than the grid's.")
    return {
        "floor": name,
        "answered": f"{n_ok} of {PAIRS}",
        "cold [ms]": ms(cold),
        "cold, wall [ms]": ms(wall),
        "until the route, wall": ms(route_only),
        "goal known [ms]": ms(cached),
        "until the route, goal known, wall": ms(cached_route),
        "cost − grid p50, largest": _shares(over_grid),
        "any-angle − best known p50, largest": _shares(taut_over_best),
        "trajectory − best known p50, largest": _shares(over_best),
        "improved by OMPL": n_ompl,
        "smooth": n_smooth,
    }


def _shares(values):
    return f"{100 * np.median(values):.2f} %, {100 * max(values):.2f} %"


def _best_known(it, problem, result):
    """Cost of the best polyline that long sampling finds, or of the route; and of the pulled string."""
    space = it.graph.cost_space
    points = it.context.path(it.graph, problem.start, problem.goal).points
    best, cost = shorten(points, space)
    taut = cost
    for _ in range(2):
        cells = it.context.informed_cells(
            it.graph, problem.start, problem.goal, max(cost * sampling.OCTILE_EXCESS, result.grid_cost)
        )
        best, _ = sampling.refine_with_ompl(
            space,
            problem.start,
            problem.goal,
            best,
            cells=cells,
            samples=BEST_SAMPLES,
            deadline_at=math.inf,
            seed=9,
        )
        best, cost = shorten(best, space)
    return min(cost, result.route.summary.cost), taut
