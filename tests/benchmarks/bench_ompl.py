"""OMPL alone against OMPL that draws from informed cells and starts from a path at hand: cost over time."""

from __future__ import annotations

import math
import time

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from planner import sampling
from planner.any_angle import shorten
from tests.benchmarks.chart import log_chart
from tests.benchmarks.planning import case

FLOOR, PAIRS = "plant", 10
BUDGETS_S = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
TITLE = f"OMPL in the plane: cost above the best path known, mean of {PAIRS} pairs on the {FLOOR} (wall time)"
# On the logarithmic chart less than this counts as this, percent.
LEAST_PERCENT = 0.01
ALONE = "RRT* alone"
WARM = "RRT* in informed cells, from the grid path"
FULL = "RRT* in informed cells, from the pulled string"


def run():
    it = case(FLOOR, PAIRS, seed=11)
    space = it.graph.cost_space
    it.context.prepare(it.graph)
    it.context.background.add = lambda *_: None
    sampling.warm_up()
    costs = {name: np.full((PAIRS, len(BUDGETS_S)), np.inf) for name in (ALONE, WARM, FULL)}
    for k, (start, goal) in enumerate(it.pairs):
        for i, budget in enumerate(BUDGETS_S):
            for name, search in ((WARM, _warm), (FULL, _full)):
                costs[name][k, i] = search(it, start, goal, time.monotonic() + budget)
        costs[ALONE][k] = _alone(space, start, goal)
    best = np.min([c.min(axis=1) for c in costs.values()], axis=0)
    rows = []
    for name, cost in costs.items():
        excess = 100 * (cost / best[:, None] - 1)
        row = {"search": name}
        for i, budget in enumerate(BUDGETS_S):
            solved = np.isfinite(excess[:, i])
            few = "" if solved.all() else f" ({solved.sum()} of {PAIRS})"
            row[f"{budget:g} s"] = f"{excess[solved, i].mean():.2f} %{few}" if solved.any() else "none"
        rows.append(row)
    return rows


def draw(rows, folder):
    """Write the chart; returns its name and caption. Times at which not all pairs are solved are left out."""
    series = {}
    for row in rows:
        points = [
            (budget, max(float(row[f"{budget:g} s"].split()[0]), LEAST_PERCENT))
            for budget in BUDGETS_S
            if row[f"{budget:g} s"].endswith("%")
        ]
        if points:
            series[row["search"]] = tuple(zip(*points, strict=True))
    title = f"OMPL: cost over time, {FLOOR}"
    log_chart(
        folder / "bench_ompl.png",
        title,
        "seconds",
        f"% above the best known, at least {LEAST_PERCENT}",
        series,
    )
    return [("bench_ompl.png", title)]


def _refined(it, start, goal, warm, deadline_at):
    """Cost after drawing from all cells through which a path cheaper than the warm one may lead."""
    space = it.graph.cost_space
    limit = sampling.OCTILE_EXCESS * space.line_cost(warm)
    path, _ = sampling.refine_with_ompl(
        space,
        start,
        goal,
        warm,
        cells=it.context.informed_cells(it.graph, start, goal, limit),
        samples=10_000_000,
        deadline_at=deadline_at,
        seed=3,
    )
    return space.line_cost(path)


def _alone(space, start, goal):
    """Costs at the budgets of OMPL's own sampling over the whole map, with the same motion costs."""
    ou.setLogLevel(ou.LOG_NONE)
    plane = ob.RealVectorStateSpace(2)
    plane.setBounds(sampling._bounds(space))
    info = ob.SpaceInformation(plane)
    info.setStateValidityChecker(sampling._Validity(info, space))
    info.setMotionValidator(sampling._Motions(info, space))
    info.setup()
    question = ob.ProblemDefinition(info)
    states = [plane.allocState(), plane.allocState()]
    for state, (x, y) in zip(states, (start, goal), strict=True):
        state[0], state[1] = x, y
    question.setStartAndGoalStates(*states, 1e-6)
    question.setOptimizationObjective(sampling._Cost(info, space))
    planner = og.RRTstar(info)
    planner.setProblemDefinition(question)
    planner.setRange(sampling._RANGE_M)
    planner.setup()
    began, costs = time.monotonic(), []
    for budget in BUDGETS_S:
        end = began + budget
        planner.solve(ob.PlannerTerminationCondition(lambda end=end: time.monotonic() >= end))
        path = question.getSolutionPath() if question.hasExactSolution() else None
        points = [] if path is None else [(s[0], s[1]) for s in path.getStates()]
        costs.append(space.line_cost(points) if points else math.inf)
    return costs


def _warm(it, start, goal, deadline_at):
    return _refined(it, start, goal, it.context.path(it.graph, start, goal).points, deadline_at)


def _full(it, start, goal, deadline_at):
    points = it.context.path(it.graph, start, goal).points
    taut, _ = shorten(points, it.graph.cost_space, deadline_at=deadline_at)
    return _refined(it, start, goal, taut, deadline_at)
