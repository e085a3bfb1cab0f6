"""One door to visibility: both kinds of floors, masks and single points, ranges, wrong input."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
import shapely

from maps.errors import InvalidGeometry
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.visibility import buried_landmarks, compute_visibility, visible_landmarks
from maps.world import World
from tests.worlds import world_from_ascii

ROOM = """
    #########
    #A..#..B#
    #...#...#
    #...#...#
    #......C#
    #########
"""


def plan_world():
    """A room of 10 m × 6 m with an opaque rack and a glass wall."""
    floor = shapely.box(0, 0, 10, 6)
    rack, glass = shapely.box(4, 2, 5, 4), shapely.box(7, 1, 7.1, 5)
    landmarks = LandmarkSet(
        ("W", "E", "N"),
        np.array([[0.0, 3.1], [10.0, 2.9], [5.3, 6.0]]),
        np.array([0.0, math.pi, np.nan]),
        np.array([math.pi / 2, 0.6, np.nan]),
    )
    return World("plan", FloorPlan((floor,), (rack, glass), (True, False)), landmarks)


def grid_world(rng, n=70):
    frame = GridFrame(-2.0, 1.0, 0.4, 0.25, 30, 40)
    opaque = rng.random(frame.shape) < 0.08
    places = frame.to_world(rng.uniform([0, 0], [40, 30], (n, 2)))
    facing = np.where(rng.random(n) < 0.5, np.nan, rng.uniform(-3, 3, n))
    names = tuple(f"L{i}" for i in range(n))
    return World("cells", OccupancyGrid(frame, ~opaque, opaque), LandmarkSet(names, places, facing))


def as_bool(visibility, rows=slice(None), cols=slice(None)):
    masks = visibility.masks(rows, cols)
    i = np.arange(visibility.n_landmarks)
    return (masks[..., i // 64] >> (i % 64).astype(np.uint64) & np.uint64(1)).astype(bool)


@pytest.mark.parametrize("ranges", [{}, {"max_range": 3.0}, {"min_range": 1.2, "max_range": 4.0}])
@pytest.mark.parametrize("kind", ["cells", "plan"])
def test_masks_agree_with_single_points_on_free_cells(rng, kind, ranges):
    world = grid_world(rng) if kind == "cells" else plan_world()
    frame = world.grid_frame(0.13)
    visibility = compute_visibility(world, frame, **ranges)
    assert visibility.shape == frame.shape
    assert visibility.n_landmarks == len(world.landmarks)
    assert visibility.n_words == (2 if kind == "cells" else 1)
    centres = frame.centres()
    free = world.floor.free_at(centres)
    got = as_bool(visibility)[free]
    assert (got == visible_landmarks(world, centres[free], **ranges)).all()
    assert 0.02 < got.mean() < 0.98
    distance = np.hypot(*np.moveaxis(centres[free][:, None] - world.landmarks.positions, -1, 0))
    assert not got[distance > ranges.get("max_range", math.inf) + 1e-6].any()
    assert not got[distance < ranges.get("min_range", 0.0) - 1e-6].any()


@pytest.mark.parametrize("ranges", [{}, {"min_range": 0.9, "max_range": 4.0}])
@pytest.mark.parametrize("kind", ["cells", "plan"])
def test_cells_judged_beside_their_centres_see_what_single_points_see(rng, kind, ranges):
    seen = moved = 0
    for offset in [(0.0, 0.0), (0.31, -0.22), (-0.25, 0.5), (0.0, 0.125), *rng.uniform(-3, 3, (4, 2))]:
        world = grid_world(rng) if kind == "cells" else plan_world()
        frame = world.grid_frame(float(rng.choice([0.13, 0.25, 0.4])))
        got = as_bool(compute_visibility(world, frame, offset=tuple(offset), **ranges))
        points = frame.centres().reshape(-1, 2) + offset
        # Every cell, also where the place beside its centre is not free or off the floor.
        assert (got.reshape(len(points), -1) == visible_landmarks(world, points, **ranges)).all()
        seen += got.sum()
        moved += (got != as_bool(compute_visibility(world, frame, **ranges))).sum()
    assert seen > 1000
    assert moved > 1000


def test_offset_on_random_drawn_floors(rng):
    for _ in range(60):
        rows, cols = (int(v) for v in rng.integers(3, 12, 2))
        frame = GridFrame(*rng.choice([0.0, -3.7, 12.25], 2), rng.choice([0.0, 0.3, -2.0]), 0.1, rows, cols)
        opaque = rng.random(frame.shape) < rng.choice([0.05, 0.3])
        cells = rng.uniform(0, [cols, rows], (4, 2))
        cells[:2] = np.floor(cells[:2]) + rng.choice([0.0, 0.5], (2, 2)) + [[0.0, 0.0], [0.25, 0.0]]
        landmarks = LandmarkSet(tuple("abcd"), frame.to_world(cells), np.array([np.nan, 0.4, np.nan, -2.0]))
        world = World("drawn", OccupancyGrid(frame, ~opaque, opaque), landmarks)
        field = world.grid_frame(float(rng.choice([0.1, 0.05, 0.3])))
        # Whole and half cells put places on rims of cells and on the landmarks.
        turn = np.array(
            [[math.cos(frame.yaw), math.sin(frame.yaw)], [-math.sin(frame.yaw), math.cos(frame.yaw)]]
        )
        offset = rng.integers(-4, 5, 2) * 0.05 @ turn
        got = as_bool(compute_visibility(world, field, offset=tuple(offset)))
        points = field.centres().reshape(-1, 2) + offset
        assert (got.reshape(len(points), -1) == visible_landmarks(world, points)).all()


@pytest.mark.parametrize("offset", [(math.nan, 0.0), (0.0, math.inf), (1e9, 0.0)])
def test_impossible_offsets_are_refused(rng, offset):
    for world in (grid_world(rng, 3), plan_world()):
        with pytest.raises(InvalidGeometry, match="offset"):
            compute_visibility(world, world.grid_frame(0.5), offset=offset)


def test_drawn_room():
    world = world_from_ascii(ROOM)
    seen = as_bool(compute_visibility(world, world.floor.frame))
    left, right = seen[1:5, 1:4], seen[1:5, 5:8]
    assert left[..., 0].sum() == 11  # all but its own place
    assert not left[1:, :, 1].any()  # B is behind the wall
    assert right[..., 1].sum() == 11
    assert left[0, :, 2].all()  # C along the passage
    assert not seen[4, 1, 2]


def test_windows_are_parts_of_the_whole(rng):
    world = grid_world(rng)
    visibility = compute_visibility(world, world.grid_frame(0.2))
    whole = visibility.masks()
    for rows, cols in [
        (slice(3, 9), slice(5, 40)),
        (slice(0, 1), slice(None)),
        (slice(-4, None), slice(-3, None)),
    ]:
        assert (visibility.masks(rows, cols) == whole[rows, cols]).all()
    again = pickle.loads(pickle.dumps(visibility))
    assert (again.masks() == whole).all()


def test_smallest_range_cuts_discs_out_of_a_plan():
    world = plan_world()
    frame = world.grid_frame(0.1)
    near, far = (as_bool(compute_visibility(world, frame, min_range=r)) for r in (0.0, 2.5))
    d = np.hypot(*np.moveaxis(frame.centres()[..., None, :] - world.landmarks.positions, -1, 0))
    assert (far == (near & (d >= 2.5 - 1e-9))).all()
    assert (near & (d < 2.4)).any(axis=(0, 1)).all()


@pytest.mark.parametrize("kind", ["cells", "plan"])
def test_ticks_count_to_the_number_of_landmarks(rng, kind):
    world = grid_world(rng, 5) if kind == "cells" else plan_world()
    calls = []
    compute_visibility(world, world.grid_frame(0.5), threads=2, tick=lambda *a: calls.append(a))
    n = len(world.landmarks)
    assert calls == [(i + 1, n) for i in range(n)]


def test_buried_landmarks_of_both_kinds(rng):
    assert not buried_landmarks(plan_world()).any()
    inside = LandmarkSet(("in", "on"), np.array([[4.5, 3.0], [4.0, 3.0]]))
    assert buried_landmarks(plan_world().with_landmarks(inside)).tolist() == [True, False]
    solid = world_from_ascii("""
        #######
        #######
        #######
        #######
        #.....#
        #######
    """).with_landmarks(LandmarkSet(("in", "on"), np.array([[1.75, 2.25], [1.75, 1.0]])))
    assert buried_landmarks(solid).tolist() == [True, False]


def test_no_landmarks(rng):
    for world in (grid_world(rng, 3), plan_world()):
        empty = world.with_landmarks(LandmarkSet.empty())
        assert not compute_visibility(empty, empty.grid_frame(0.5)).masks().any()
        assert visible_landmarks(empty, [[1.0, 2.0]]).shape == (1, 0)
        assert visible_landmarks(world, np.empty((0, 2))).shape == (0, 3)


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"min_range": -1.0}, "Smallest range"),
        ({"min_range": math.nan}, "Smallest range"),
        ({"max_range": 0.0}, "Largest range"),
        ({"max_range": math.nan}, "Largest range"),
        ({"min_range": 3.0, "max_range": 2.0}, "exceed the smallest, 3"),
    ],
)
def test_impossible_ranges_are_refused(ranges, words):
    world = plan_world()
    with pytest.raises(InvalidGeometry, match=words):
        compute_visibility(world, world.grid_frame(0.5), **ranges)
    with pytest.raises(InvalidGeometry, match=words):
        visible_landmarks(world, [[1.0, 1.0]], **ranges)


def test_wrong_points_are_refused():
    with pytest.raises(InvalidGeometry, match=r"shape \(2,\)"):
        visible_landmarks(plan_world(), [1.0, 2.0])
    with pytest.raises(InvalidGeometry, match="not finite"):
        visible_landmarks(plan_world(), [[1.0, math.nan]])
