from __future__ import annotations

import math
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from shapely.geometry import Point, Polygon, box

from maps import floor_plan
from maps.errors import InvalidGeometry
from maps.floor_plan import FloorPlan

L_SHAPE = (box(0, 0, 10, 4), box(0, 4, 4, 8))
PLAN = FloorPlan(L_SHAPE, (box(1, 1, 2, 2), box(6, 1, 7, 3), box(9.5, 3, 12, 5)), (True, False, True))


def test_free_space_is_the_floor_without_obstacles():
    assert PLAN.free_area_m2 == pytest.approx(40 + 16 - 1 - 2 - 0.5)
    assert PLAN.see_through().area == pytest.approx(40 + 16 - 1 - 0.5)
    assert PLAN.bounds == (0, 0, 10, 8)
    assert PLAN.floor_area().area == pytest.approx(56)


def test_points_are_free_strictly_inside_and_opaque_on_walls_and_outside():
    points = [[0.5, 0.5], [2, 4], [0, 1], [1, 1.5], [1.5, 1.5], [6.5, 2], [5, 5], [-1, 0], [9.8, 3.5]]
    np.testing.assert_array_equal(PLAN.free_at(points), [1, 1, 0, 0, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(PLAN.opaque_at(points), [0, 0, 1, 1, 1, 0, 1, 1, 1])
    assert PLAN.free_at([0.5, 0.5]).shape == ()
    assert PLAN.free_at(np.zeros((3, 4, 2))).shape == (3, 4)


def test_edges_are_the_boundaries_without_the_seam_between_floors():
    def length(edges):
        return np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1]).sum()

    assert length(PLAN.free_edges()) == pytest.approx(PLAN.free_space().length)
    assert length(PLAN.opaque_edges()) == pytest.approx(36 + 4)
    assert length(PLAN.free_edges()) == pytest.approx(36 + 4 + 6)


def test_two_separate_floors_have_the_edges_of_both():
    plan = FloorPlan((box(0, 0, 1, 1), box(5, 0, 6, 1)))
    assert plan.free_edges().shape == (8, 4)


def test_frames_cover_the_floor():
    frame = PLAN.grid_frame(0.3)
    assert frame.as_tuple() == (0, 0, 0, 0.3, 27, 34)
    assert PLAN.grid_frame(100).shape == (1, 1)
    for bad in (0, -1, math.nan):
        with pytest.raises(InvalidGeometry, match="resolution"):
            PLAN.grid_frame(bad)


@pytest.mark.parametrize(
    ("floor", "obstacles", "opaque", "says"),
    [
        ((), (), (), "no floor polygon"),
        ((Polygon(),), (), (), "floor number 0 is not a polygon"),
        ((Point(0, 0),), (), (), "floor number 0 is not a polygon"),
        (
            (box(0, 0, 1, 1), Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])),
            (),
            (),
            "floor number 1 is not valid: Self-inter",
        ),
        ((box(0, 0, 1, 1),), (box(0, 0, 2, 2),), (True,), "no free space is left"),
        ((box(0, 0, 1, 1),), (box(0, 0, 2, 2),), (), "1 obstacles but 0 opaque flags"),
        ((box(0, 0, 1, 1e8),), (), (), "reaches 1e.08 m; the limit is 1e.07"),
        ((Polygon([(0, 0, 1), (1, 0, 1), (0, 1, 1)]),), (), (), "has heights"),
        ((Polygon([(0, 0), (1, 0), (1, math.inf)]),), (), (), "not finite"),
    ],
)
def test_impossible_plans_are_named(floor, obstacles, opaque, says):
    with pytest.raises(InvalidGeometry, match=says):
        FloorPlan(floor, obstacles, opaque)


def test_too_many_vertices_are_refused(monkeypatch):
    monkeypatch.setattr(floor_plan, "MAX_VERTICES", 4)
    with pytest.raises(InvalidGeometry, match="5 vertices, the limit is 4"):
        FloorPlan((box(0, 0, 1, 1),))


def test_plans_can_be_pickled_and_hash_all_they_hold():
    again = pickle.loads(pickle.dumps(PLAN))
    assert again.content_hash() == PLAN.content_hash()
    assert again.free_at([0.5, 0.5])
    floor = (box(0, 0, 3, 3),)
    plans = [
        FloorPlan(floor),
        FloorPlan(floor, (box(1, 1, 2, 2),), (True,)),
        FloorPlan(floor, (box(1, 1, 2, 2),), (False,)),
        FloorPlan((box(0, 0, 3, 3.001),)),
        FloorPlan((Polygon(box(0, 0, 3, 3).exterior, [box(1, 1, 2, 2).exterior.coords]),)),
    ]
    assert len({p.content_hash() for p in plans}) == 5


def test_questions_may_come_from_many_threads(rng):
    points = rng.uniform(-1, 11, (4000, 2))
    expected = PLAN.free_at(points)
    fresh = pickle.loads(pickle.dumps(PLAN))
    with ThreadPoolExecutor(8) as pool:
        for found in pool.map(lambda _: fresh.free_at(points), range(32)):
            np.testing.assert_array_equal(found, expected)
