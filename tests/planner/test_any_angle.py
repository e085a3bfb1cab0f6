"""Shortening grid paths: never dearer, ends kept, close to the true optimum."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from planner.any_angle import shorten, with_fewer_corners
from planner.context import PlanningContext
from tests.fields import synthetic_field
from tests.planner.test_cost_to_go import random_world
from tests.worlds import world_from_ascii

CORNER = """
####################
#..................#
#..................#
#.........##########
#.........##########
#..................#
#..................#
####################
"""


def test_around_a_corner_it_is_nearly_the_taut_string():
    world = world_from_ascii(CORNER)
    graph = PlanningContext(synthetic_field(world, 0.1)).graph(radius=0.3, weight=0.0)
    start, goal = (9.0, 3.2), (9.0, 0.8)
    cost, points = graph.costs_to(goal).path_from(start)
    short, short_cost = shorten(points, graph.cost_space)
    # Two corners at (5, 2.5) and (5, 1.5), each passed on a circle of 0.3 m.
    run = math.hypot(4.0, 0.7)
    arc = math.pi / 2 - math.atan2(0.7, 4.0) + math.asin(0.3 / run)
    taut = 2 * (math.sqrt(run**2 - 0.3**2) + 0.3 * arc) + 1.0
    assert taut <= short_cost <= 1.004 * taut
    assert short_cost < cost
    assert graph.cost_space.line_cost(short) == pytest.approx(short_cost)


def test_never_dearer_and_the_ends_stay(rng):
    world = random_world(rng, share=0.93)
    field = synthetic_field(world, 0.25, lambda x, y: 0.02 + 0.1 * np.sin(x) ** 2 * np.cos(y) ** 2)
    graph = PlanningContext(field).graph(radius=0.25, weight=8.0)
    space = graph.cost_space
    rows, cols = np.nonzero(space.passable)
    gains = []
    for i, j in rng.integers(len(rows), size=(15, 2)):
        ends = space.centre(rows[[i, j]], cols[[i, j]])
        cost, points = graph.costs_to(tuple(ends[1])).path_from(tuple(ends[0]))
        if points is None or len(points) < 2:
            continue
        short, short_cost = shorten(points, space)
        assert short_cost <= cost * (1 + 1e-12)
        assert space.line_cost(short) == pytest.approx(short_cost)
        np.testing.assert_array_equal(short[[0, -1]], points[[0, -1]])
        gains.append(1 - short_cost / cost)
    assert len(gains) > 5
    assert 0.02 < np.mean(gains) < 0.1


def test_one_point_and_no_time():
    world = world_from_ascii(CORNER)
    space = PlanningContext(synthetic_field(world, 0.25)).graph(radius=0.3, weight=0.0).cost_space
    assert shorten([[1.0, 1.0]], space)[1] == 0.0
    path = [[1.0, 1.0], [2.0, 1.1], [3.0, 1.0]]
    late, cost = shorten(path, space, deadline_at=time.monotonic() - 1)
    np.testing.assert_array_equal(late, path)
    assert cost == space.line_cost(path)
    assert len(shorten(path, space)[0]) == 2


def test_fewer_corners_within_a_limit(rng):
    world = world_from_ascii(CORNER)
    space = PlanningContext(synthetic_field(world, 0.25)).graph(radius=0.3, weight=0.0).cost_space
    x = np.linspace(1.0, 4.4, 30)
    wavy = np.column_stack([x, 2.0 + 0.05 * rng.standard_normal(30)])
    cost = space.line_cost(wavy)
    np.testing.assert_array_equal(with_fewer_corners(wavy, space, 10 * cost), wavy[[0, -1]])
    for limit in (cost, 1.01 * cost):
        fewer = with_fewer_corners(wavy, space, limit)
        assert 2 <= len(fewer) < 30
        assert space.line_cost(fewer) <= limit * (1 + 1e-12)
        np.testing.assert_array_equal(fewer[[0, -1]], wavy[[0, -1]])
    around = np.array([[9.0, 3.2], [4.5, 2.9], [4.5, 1.1], [9.0, 0.8]])
    assert len(with_fewer_corners(around, space, 1e9)) >= 3
