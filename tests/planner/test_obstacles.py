"""Walls and areas as obstacles of one kind."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon, box

from maps.grid import GridFrame
from planner.context import PlanningContext
from planner.obstacles import cells_around
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
############
#..........#
#....##....#
#..........#
############
"""


def context():
    return PlanningContext(synthetic_field(world_from_ascii(ROOM, resolution=0.5), 0.1))


def test_clearance_of_centres_is_that_of_walls_and_areas():
    c = context()
    ring = Polygon(box(1.0, 0.7, 2.2, 1.9).exterior, [box(1.3, 1.0, 1.9, 1.6).exterior.coords])
    areas = (ring, box(4.0, -3.0, 4.4, 1.1))
    made = c.obstacles(areas)
    assert c.obstacles(areas) is made
    x, y = np.moveaxis(c.field.frame.centres(), -1, 0)
    theirs = np.array(c.centre_clearance)
    for area in areas:
        theirs = np.minimum(theirs, shapely.distance(shapely.points(x, y), area))
    np.testing.assert_allclose(made.centre_clearance, theirs, atol=1e-12)
    assert made.areas_at(1.1, 0.8) == (1,)
    assert made.areas_at(1.6, 1.3) == ()  # in the hole
    assert made.areas_at(4.4, 1.0) == (2,)


def test_without_areas_nothing_is_made():
    c = context()
    assert c.obstacles().centre_clearance is c.centre_clearance
    assert c.obstacles().clearance is c.clearance


def test_cells_around_hold_all_that_is_near():
    frame = GridFrame(1.0, -2.0, 0.6, 0.25, 30, 40)
    for area in (box(2, 1, 3, 2), box(-9, -9, -8, -8), box(-50, -50, 50, 50)):
        near = shapely.distance(shapely.points(*np.moveaxis(frame.centres(), -1, 0)), area) <= 0.4
        inside = np.zeros(frame.shape, dtype=bool)
        inside[cells_around(frame, area, 0.4)] = True
        assert not (near & ~inside).any()
