"""The narrowest place of the widest way: drawn doors, and fine grids searched threshold by threshold."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity, box

from maps.floor_plan import FloorPlan
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.context import PlanningContext
from planner.widest import narrowest_of_widest
from tests.fields import synthetic_field
from tests.oracles import point_to_segment, widest_on_cells
from tests.worlds import world_from_ascii

NEVER = np.zeros(1, dtype=np.uint8)
TWO_DOORS = """
####################
#........#.........#
#..................#
#........#.........#
#........#.........#
#........#.........#
#..................#
#..................#
#........#.........#
####################
"""


def made(world, resolution):
    return PlanningContext(synthetic_field(world, resolution))


def narrowest(context, start, goal, avoid=(), stop=NEVER):
    return narrowest_of_widest(context.obstacles(avoid), context.field.frame, start, goal, stop=stop)


@pytest.mark.parametrize("resolution", [0.25, 0.1, 0.07])
def test_the_wider_door_counts(resolution):
    context = made(world_from_ascii(TWO_DOORS, resolution=0.5), resolution)
    found = narrowest(context, (2.0, 3.5), (8.0, 3.5))
    assert found.largest_radius == pytest.approx(0.5, abs=1e-5)
    assert found.place[1] == pytest.approx(1.5, abs=1e-3)  # rows 2 and 3 from below
    assert 4.5 <= found.place[0] <= 5.0
    assert found.between == (0, 0)
    assert found.is_proven


def test_an_area_narrows_the_door_and_is_named():
    context = made(world_from_ascii(TWO_DOORS, resolution=0.5), 0.1)
    start, goal = (2.0, 3.5), (8.0, 3.5)
    beside = (box(20, 20, 21, 21), box(4.6, 0.9, 4.9, 1.3))
    found = narrowest(context, start, goal, beside)
    # 0.7 m are left of the wide door: still more than the other one.
    assert found.largest_radius == pytest.approx(0.35, abs=1e-5)
    assert sorted(found.between) == [0, 2]
    assert found.areas == (2,)
    assert found.place[1] == pytest.approx(1.65, abs=1e-3)
    # With 0.4 m left the other door is the wider one.
    other = narrowest(context, start, goal, (box(4.6, 0.9, 4.9, 1.6),))
    assert other.largest_radius == pytest.approx(0.25, abs=1e-5)
    assert other.place[1] == pytest.approx(3.75, abs=1e-3)
    assert other.areas == ()


def test_what_closes_every_way_is_named():
    context = made(world_from_ascii(TWO_DOORS, resolution=0.5), 0.1)
    start, goal = (2.0, 3.5), (8.0, 3.5)
    across = narrowest(context, start, goal, (box(20, 20, 21, 21), box(6.0, -1.0, 6.2, 9.0)))
    assert across.largest_radius == 0.0
    assert across.areas == (2,)
    walls = narrowest(
        made(world_from_ascii(TWO_DOORS.replace("..................", "........#.........")), 0.1),
        start,
        goal,
    )
    assert walls.largest_radius == 0.0
    assert walls.areas == ()
    assert 4.5 <= walls.place[0] <= 5.0  # in the wall between both


def test_ends_bound_every_way_and_neighbours_have_none():
    context = made(world_from_ascii(TWO_DOORS, resolution=0.5), 0.1)
    near = narrowest(context, (0.6, 3.5), (4.0, 3.5))
    assert near.place == (0.6, 3.5)
    assert near.largest_radius == pytest.approx(0.1)
    assert narrowest(context, (2.0, 2.0), (2.05, 2.05)) is None
    assert narrowest(context, (2.0, 3.5), (8.0, 3.5), stop=np.ones(1, dtype=np.uint8)) is None


def test_against_fine_grids(rng):
    """Obstacles at all angles, the last two as areas: cells of 2 cm, tried threshold by threshold."""
    fine, start, goal = 0.02, (0.25, 1.0), (2.75, 1.0)
    slack = fine / np.sqrt(2)
    open_ways = 0
    for _ in range(6):
        shapes = [turned_box(rng) for _ in range(5)]
        floor = FloorPlan((box(0, 0, 3, 2),), tuple(shapes[:3]), (True,) * 3)
        world = World("random", floor, LandmarkSet(("A", "B", "C"), np.array([[0, 0], [3, 0], [0, 2.0]])))
        avoid = tuple(shapes[3:])
        found = narrowest(made(world, 0.1), start, goal, avoid)

        segments = [*floor.free_edges(), *(edge for area in avoid for edge in edges(area))]
        points = [((c + 0.5) * fine, (r + 0.5) * fine) for r in range(100) for c in range(150)]
        values = np.array([min(point_to_segment(p, s) for s in segments) for p in points])
        values[~floor.free_at(points)] = 0.0
        for area in avoid:
            values[shapely.intersects_xy(area, *np.array(points).T)] = 0.0
        ends = [(int(y / fine), int(x / fine)) for x, y in (start, goal)]
        theirs = widest_on_cells(np.round(values, 3).reshape(100, 150), *ends)
        if theirs <= slack:
            assert found.largest_radius <= 2 * slack
            continue
        open_ways += 1
        assert theirs - 1e-3 <= found.largest_radius <= theirs + slack + 1e-3
    assert open_ways > 3


def turned_box(rng):
    size, turn = rng.uniform(0.1, 0.35, 2), rng.uniform(0, 180)
    upright = box(*-size, *size)
    return affinity.translate(affinity.rotate(upright, turn), rng.uniform(0.8, 2.2), rng.uniform(0.3, 1.7))


def edges(area):
    ring = np.array(area.exterior.coords)
    return np.concatenate([ring[:-1], ring[1:]], axis=1)
