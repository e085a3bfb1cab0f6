"""Regions within reach: obvious ones, random ones against cells, shapes of polygons, wrong input."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from maps.grid import GridFrame
from planner.context import PlanningContext
from planner.errors import InvalidProblem, StartOccupied, StartOutsideMap
from planner.matrix import cost_matrix
from planner.reachability import polygons_of_cells, reachable_region
from planner.travel import Travel
from tests.fields import synthetic_field
from tests.oracles import grid_dijkstra
from tests.planner.test_cost_to_go import random_world
from tests.worlds import place_in_ascii, world_from_ascii

HALL = """
##########################
#........................#
#........................#
#s.......................#
#........................#
#........................#
##########################
"""
START = place_in_ascii(HALL, "s")


def context_of(drawing, sigma=lambda x, y: 0.02 + 0.0 * x, resolution=0.25):
    return PlanningContext(synthetic_field(world_from_ascii(drawing), resolution, sigma))


def test_everything_that_is_connected():
    region = reachable_region(context_of(HALL), START, travel=Travel(0.2))
    assert region.is_complete
    (polygon,) = region.polygons
    assert polygon.bounds == pytest.approx((0.75, 0.75, 12.25, 2.75))
    assert region.area == pytest.approx(polygon.area) == pytest.approx(11.5 * 2.0)


def test_within_a_length_and_a_time():
    context = context_of(HALL)
    travel = Travel(0.2, max_speed=0.5)
    by_length = reachable_region(context, START, travel=travel, measure="length", limit=5.0)
    by_time = reachable_region(context, START, travel=travel, measure="time", limit=10.0)
    np.testing.assert_array_equal(by_length.cells, by_time.cells)
    assert by_length.polygons[0].bounds[2] == pytest.approx(START[0] + 5.0, abs=0.25)
    cheap = reachable_region(context, START, travel=travel, measure="cost", limit=5.0)
    assert cheap.area < by_length.area


def test_without_exceeding_a_bound_and_around_blind_places():
    def sigma(x, y):
        return np.where((x > 8) & (x < 9), np.nan, np.where(x > 5, 0.1, 0.02))

    context = context_of(HALL, sigma)
    k = math.sqrt(-2 * math.log(0.05))
    sure = reachable_region(context, START, travel=Travel(0.2, max_r95=0.05))
    assert sure.polygons[0].bounds[2] == pytest.approx(5.0)
    seeing = reachable_region(context, START, travel=Travel(0.2, max_r95=0.1 * k * 1.001))
    assert seeing.polygons[0].bounds[2] == pytest.approx(8.0)
    blind = reachable_region(context, START, travel=Travel(0.2, blind_r95=0.5))
    assert blind.polygons[0].bounds[2] == pytest.approx(12.25)


def test_a_hole_stays_a_hole():
    drawing = HALL.replace("#s.......................#", "#s........######.........#")
    region = reachable_region(context_of(drawing), START, travel=Travel(0.2))
    (polygon,) = region.polygons
    assert len(polygon.interiors) == 1
    assert not polygon.contains(shapely.Point(6.5, 1.75))
    assert region.area == pytest.approx(polygon.area, rel=0.05)


def test_against_cells_reached_one_by_one(rng):
    for _ in range(3):
        context = PlanningContext(
            synthetic_field(random_world(rng, (14, 16), 0.93), 0.5, lambda x, y: 0.05 + 0.04 * np.sin(x + y))
        )
        travel = Travel(0.1, weight=5.0)
        space = travel.graph(context).cost_space
        rows, cols = np.nonzero(space.passable)
        k = int(rng.integers(len(rows)))
        place = tuple(space.centre(rows[k], cols[k]).tolist())
        region = reachable_region(context, place, travel=travel, limit=4.3)
        reached = grid_dijkstra(space.rate, space.passable, (rows[k], cols[k]), 0.5)
        theirs = np.zeros(space.frame.shape, dtype=bool)
        for cell, cost in reached.items():
            theirs[cell] = cost <= 4.3
        np.testing.assert_array_equal(region.cells, theirs)
        # From every cell of the region the place is reached at that cost, too.
        sample = space.centre(*np.nonzero(region.cells))[:10]
        back = cost_matrix(context, sample, [place], travel=travel)
        assert (back.cost <= 4.3 + 1e-9).all()


def test_polygons_are_valid_and_within_half_a_cell(rng):
    frame = GridFrame(3.0, -1.0, 0.3, 0.5, 25, 30)
    for share in (0.2, 0.5, 0.6, 0.8, 0.95):
        cells = rng.random(frame.shape) < share
        polygons = polygons_of_cells(cells, frame)
        boxes = [
            shapely.Polygon(frame.to_world([[c, r], [c + 1, r], [c + 1, r + 1], [c, r + 1]]))
            for r, c in np.argwhere(cells)
        ]
        exact = shapely.union_all(boxes, grid_size=1e-9)
        assert all(p.is_valid and p.geom_type == "Polygon" for p in polygons)
        assert [p.area for p in polygons] == sorted((p.area for p in polygons), reverse=True)
        reach = 0.25 + 1e-6
        for mine, other in ((shapely.union_all(polygons), exact), (exact, shapely.union_all(polygons))):
            assert shapely.difference(mine, other.buffer(reach)).area == pytest.approx(0.0, abs=1e-6)
    assert polygons_of_cells(np.zeros((25, 30), dtype=bool), frame) == ()
    (whole,) = polygons_of_cells(np.ones((25, 30), dtype=bool), frame)
    assert len(whole.exterior.coords) == 5
    assert whole.area == pytest.approx(25 * 30 * 0.25)


def test_what_was_stopped_says_so():
    stop = np.ones(1, dtype=np.uint8)
    region = reachable_region(context_of(HALL), START, travel=Travel(0.2), stop=stop)
    assert not region.is_complete


def test_mistakes():
    context = context_of(HALL)
    travel = Travel(0.2)
    with pytest.raises(StartOutsideMap):
        reachable_region(context, (-4.0, 1.0), travel=travel)
    with pytest.raises(StartOccupied):
        reachable_region(context, (0.55, 0.55), travel=travel)
    for values, words in (
        ({"measure": "money"}, "measure is 'money'"),
        ({"limit": 0.0}, "limit is 0"),
        ({"limit": math.nan}, "limit is nan"),
        ({"deadline": -1.0}, "deadline"),
    ):
        with pytest.raises(InvalidProblem, match=words):
            reachable_region(context, START, travel=travel, **values)
    shut = reachable_region(context, START, travel=Travel(0.2, max_r95=1e-3))
    assert shut.polygons == ()
    assert shut.area == 0.0
