"""Fronts on the grid against every level and many weights."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.context import PlanningContext
from planner.pareto_grid import GridFront, GridPoint, not_dominated, spread
from planner.problem import PlanningProblem
from tests.fields import synthetic_field
from tests.oracles import front_of_worst, hull_of_weights
from tests.planner.test_cost_to_go import random_world

RES = 0.25


def random_question(rng, share=0.93):
    noise = rng.integers(0, 40, size=(200, 200)) / 40
    world = random_world(rng, shape=(8, 9), share=share, yaw=0.0)
    field = synthetic_field(world, RES, lambda x, y: 0.01 + 0.1 * noise[: x.shape[0], : x.shape[1]])
    context = PlanningContext(field)
    space = context.graph(radius=0.1, weight=0.0).cost_space
    rows, cols = np.nonzero(space.passable)
    i, j = rng.integers(len(rows), size=2)
    ends = [tuple(space.centre(rows[k], cols[k]).tolist()) for k in (i, j)]
    cells = [(int(rows[k]), int(cols[k])) for k in (i, j)]
    front = GridFront(PlanningProblem(*ends, 0.1), context, np.zeros(1, dtype=np.uint8))
    return front, space, context.r95, cells


def test_all_points_against_the_worst_are_found(rng, monkeypatch):
    # Straight lines off the grid are no part of the oracle.
    monkeypatch.setattr("planner.cost_space.CostSpace.line_cost", lambda *_: math.inf)
    for _ in range(6):
        front, space, r95, cells = random_question(rng)
        theirs = front_of_worst(r95, space.passable, *cells, resolution=RES)
        front.against_worst(10_000)
        mine = [(p.length, p.worst) for p in front.points]
        np.testing.assert_allclose(np.array(mine).reshape(-1, 2), np.array(theirs).reshape(-1, 2), rtol=1e-9)


def test_some_points_are_some_of_all(rng, monkeypatch):
    monkeypatch.setattr("planner.cost_space.CostSpace.line_cost", lambda *_: math.inf)
    while True:
        front, space, r95, cells = random_question(rng, share=1.0)
        front.against_worst(10_000)
        if len(front.points) >= 7:
            break
    theirs = front_of_worst(r95, space.passable, *cells, resolution=RES)
    front.against_worst(5)
    assert len(front.points) == 5
    for point in front.points:
        assert any(np.allclose((point.length, point.worst), t) for t in theirs)
        found = front.graph(point).costs_to(front.problem.goal).path_from(front.problem.start)
        assert found[0] == pytest.approx(point.length)


def test_weighted_points_are_optimal_for_every_weight_once_all_are_found(rng, monkeypatch):
    monkeypatch.setattr("planner.cost_space.CostSpace.line_cost", lambda *_: math.inf)
    for _ in range(3):
        front, space, r95, cells = random_question(rng)
        front.against_mean(10_000)
        weights = [0.0, 0.5, 2.0, 7.0, 30.0, 200.0]
        values = np.nan_to_num(r95)
        least = hull_of_weights(values, space.passable, *cells, resolution=RES, weights=weights)
        for w, cost in zip(weights, least, strict=True):
            mine = min((p.length + w * p.integral for p in front.points), default=math.inf)
            assert mine == pytest.approx(cost)


def test_a_stop_ends_it(rng):
    front, *_ = random_question(rng)
    front.stop[0] = 1
    front.against_worst(10)
    assert front.points == []
    front.against_mean(10)
    assert front.points == []


def test_not_dominated():
    assert not_dominated([(3.0, 1.0), (1.0, 3.0), (2.0, 3.0), (2.0, 2.0), (3.0, 1.0)]) == [1, 3, 0]
    assert not_dominated([]) == []


def test_spread_takes_ends_and_then_gaps():
    points = [GridPoint(np.zeros((1, 2)), None, x, 0.0, 0.0, 0.0) for x in (0.0, 0.1, 5.0, 9.9, 10.0)]
    assert set(spread(points, [5.0, 4.9, 2.0, 0.1, 0.0], 3)) == {0, 4, 2}
    assert spread(points[:1], [1.0], 3) == [0]
    assert len(spread(points, [5.0, 4.9, 2.0, 0.1, 0.0], 10)) == 5
