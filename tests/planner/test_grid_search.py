"""The first path: bounds kept, or broken as little as possible, in the stated order."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.clock import Clock
from planner.context import PlanningContext
from planner.grid_search import find_shortest, find_way
from planner.problem import PlanningProblem
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

HALL = """
########################
#......................#
#......................#
#......................#
########################
"""
START, GOAL = (1.125, 1.125), (10.875, 1.125)
K = math.sqrt(-2 * math.log(0.05))


def search(sigma, **values):
    context = PlanningContext(synthetic_field(world_from_ascii(HALL), 0.25, sigma))
    problem = PlanningProblem(START, GOAL, 0.3, **values)
    return find_way(problem, context, Clock(10.0)), find_shortest(problem, context, Clock(10.0))


def test_with_nothing_in_the_way_it_is_the_straight_line():
    way, shortest = search(lambda x, y: 0.01 + 0 * x)
    for w in (way, shortest):
        np.testing.assert_array_equal(w.points, [START, GOAL])
        assert w.is_complete
    assert shortest.grid_cost == pytest.approx(9.75)
    assert way.grid_cost == pytest.approx(9.75 * (1 + 4 * 0.01 * K))
    assert way.bound is None
    assert not way.is_blind_forced


def test_a_raised_bound_goes_before_blindness():
    def sigma(x, y):
        return np.where((x > 5) & (x < 6), np.where(y < 1.0, np.nan, 0.2), 0.01)

    way, _ = search(sigma, max_r95=0.1)
    assert way.bound == pytest.approx(0.2 * K)
    assert not way.is_blind_forced


def test_blindness_when_raising_does_not_help():
    way, _ = search(lambda x, y: np.where((x > 5) & (x < 6), np.nan, 0.01), max_r95=0.1)
    assert way.bound is None
    assert way.is_blind_forced


def test_a_stopped_clock_finds_nothing():
    context = PlanningContext(synthetic_field(world_from_ascii(HALL), 0.25, lambda x, y: np.nan * x))
    clock = Clock(0.0)
    assert find_way(PlanningProblem(START, GOAL, 0.3), context, clock) is None
