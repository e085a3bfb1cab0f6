"""Rounded corners: valid, never much dearer, and only where there is room."""

import math

import numpy as np
import pytest

from planner.fillet import filleted
from planner.pose_timing import MotionLimits, drive
from planner.steering import PoseCurve, PoseSpace, Steering
from tests.planner.test_pose_plan import space_of
from tests.worlds import world_from_ascii

EMPTY = """
    ################
    #..............#
    #..............#
    #..............#
    #..............#
    #..............#
    ################
"""
STEERING = Steering("differential", turn_price=0.5)


@pytest.fixture(scope="module")
def space():
    cells = space_of(world_from_ascii(EMPTY), lambda x, y: 0.02 + 0 * x, resolution=0.25, radius=0.2)
    return PoseSpace(cells, cells.rate[None], STEERING)


def polyline(points):
    """The way of a robot that faces it."""
    d = np.diff(np.array(points, dtype=float), axis=0)
    angles = np.arctan2(d[:, 1], d[:, 0])
    parts = []
    for k, (step, angle) in enumerate(zip(d, angles, strict=True)):
        if k > 0:
            parts.append([0.0, 0.0, math.remainder(angle - angles[k - 1], 2 * math.pi)])
        parts.append([math.hypot(*step), 0.0, 0.0])
    return PoseCurve(np.array([*points[0], angles[0]]), np.array(parts))


def test_a_corner_with_room_is_driven_through(space):
    corner = polyline([[1, 1], [4, 1], [4, 2.4]])
    round_, cost = filleted(corner, space, space.cost(corner))
    assert round_.turned == 0.0
    assert cost == pytest.approx(space.cost(round_))
    assert cost < space.cost(corner)
    np.testing.assert_allclose(round_.joints()[-1], corner.joints()[-1], atol=1e-9)
    limits = MotionLimits(1.2, 0.8, 1.0)
    assert drive(round_, space, limits)[0].duration < drive(corner, space, limits)[0].duration - 1.0


def test_corners_keep_their_place_where_arcs_are_closed(space):
    corner = polyline([[1, 1], [4, 1], [4, 2.4]])
    assert filleted(corner, space, space.cost(corner), most=0.5 * space.cost(corner))[0].turned > 1.5
    back = polyline([[1, 1], [4, 1], [1, 1.05]])
    assert filleted(back, space, space.cost(back))[0].turned == pytest.approx(back.turned)


def test_random_ways_stay_valid_and_end_where_they_ended(space, rng):
    fewer = 0
    for _ in range(60):
        way = polyline(rng.uniform([0.6, 0.6], [6.9, 2.4], (rng.integers(3, 7), 2)))
        cost = space.cost(way)
        found, price = filleted(way, space, cost)
        assert price == pytest.approx(space.cost(found))
        assert price <= cost * 1.0021
        np.testing.assert_allclose(found.joints()[-1][:2], way.joints()[-1][:2], atol=1e-6)
        assert found.turned <= way.turned + 1e-9
        fewer += found.turned < way.turned - 0.1
    assert fewer > 30
