"""Ways with room beside forbidden cells."""

from __future__ import annotations

import math
import time

import numpy as np

from planner.clock import Clock
from planner.context import PlanningContext
from planner.grid_search import find_way
from planner.margin import hugs_forbidden, way_with_room
from planner.problem import PlanningProblem
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

HALL = """
########################
#......................#
#......................#
#......................#
#......................#
#......................#
#......................#
#......................#
########################
"""
START, GOAL = (0.9, 0.9), (11.1, 0.9)


def way_of(sigma, start=START, goal=GOAL):
    context = PlanningContext(synthetic_field(world_from_ascii(HALL), 0.25, sigma))
    problem = PlanningProblem(start, goal, 0.3)
    return find_way(problem, context, Clock(10.0))


def test_a_path_around_a_blind_disc_keeps_off_its_staircase():
    def sigma(x, y):
        return np.where(np.hypot(x - 6, y - 0.5) < 2.2, np.nan, 0.01)

    way = way_of(sigma)
    space = way.graph.cost_space
    assert hugs_forbidden(way.points, space)
    points = way_with_room(way, START, GOAL, deadline_at=time.monotonic() + 10)
    assert not hugs_forbidden(points, space)
    np.testing.assert_array_equal(points[[0, -1]], [START, GOAL])
    assert space.line_cost(points) <= way.grid_cost


def test_without_forbidden_cells_there_is_nothing_to_avoid():
    way = way_of(lambda x, y: 0.01 + 0 * x)
    assert not hugs_forbidden(way.points, way.graph.cost_space)
    assert way_with_room(way, START, GOAL, deadline_at=math.inf) is None


def test_where_there_is_no_room_it_stays_near_or_gives_up():
    def corridor(x, y):
        return np.where(np.abs(y - 0.9) < 0.3, 0.01, np.nan)

    way = way_of(corridor)
    points = way_with_room(way, START, GOAL, deadline_at=math.inf)
    assert points is None or way.graph.cost_space.line_cost(points) <= way.grid_cost
