"""Clearance of points, motions and whole grids, on cell and polygon floors."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
import shapely

from maps.clearance import ClearanceIndex
from maps.errors import InvalidGeometry
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World
from tests.oracles import point_to_segments, segment_to_segments
from tests.worlds import place_in_ascii, world_from_ascii

ROOM = """
    ##########
    #........#
    #.s..#...#
    #....#.g.#
    #........#
    ##########
"""


def _grid_world(rng, yaw=0.0, share_free=0.8, shape=(20, 25)):
    frame = GridFrame(-3.0, 11.0, yaw, 0.25, *shape)
    free = rng.random(frame.shape) < share_free
    return World("cells", OccupancyGrid(frame, free, ~free), LandmarkSet.empty())


def _polygon_world(rng):
    obstacles = []
    for _ in range(9):
        x, y = rng.uniform([0, 0], [30, 18])
        box = shapely.box(x, y, x + rng.uniform(0.2, 4), y + rng.uniform(0.2, 4))
        obstacles.append(shapely.affinity.rotate(box, rng.uniform(0, 90)))
    floor = (shapely.box(0, 0, 20, 18), shapely.box(19, 2, 30, 9))
    return World("shapes", FloorPlan(floor, tuple(obstacles), (True,) * 9), LandmarkSet.empty())


def _worlds(rng):
    return [
        _grid_world(rng),
        _grid_world(rng, yaw=-2.1, share_free=0.5),
        _grid_world(rng, yaw=0.4, share_free=0.995),
        _polygon_world(rng),
        _polygon_world(rng),
    ]


def _random_points(rng, world, n):
    x0, y0, x1, y1 = world.bounds
    return rng.uniform([x0 - 2, y0 - 2], [x1 + 2, y1 + 2], (n, 2))


def test_points_against_all_segments_and_shapely(rng):
    for world in _worlds(rng):
        index = ClearanceIndex.from_world(world)
        points = _random_points(rng, world, 150)
        clearance = index.distance(points)
        edges = world.floor.free_edges()
        slow = np.array([point_to_segments(p, edges.tolist()) for p in points.tolist()])
        np.testing.assert_allclose(np.abs(clearance), slow, atol=1e-9)
        lines = shapely.multilinestrings(edges.reshape(-1, 2, 2))
        np.testing.assert_allclose(
            np.abs(clearance), shapely.distance(shapely.points(points), lines), atol=1e-9
        )
        free = world.floor.free_at(points)
        assert (clearance[free] > 0).all()
        assert (clearance[~free] <= 0).all()
        assert free.any()
        assert not free.all()


def test_motions_against_all_segments_and_shapely(rng):
    for world in _worlds(rng):
        index = ClearanceIndex.from_world(world)
        start = _random_points(rng, world, 80)
        stop = np.concatenate([_random_points(rng, world, 30), start[30:] + rng.normal(0, 0.15, (50, 2))])
        clearance = index.segment_distance(start, stop)
        edges = world.floor.free_edges()
        motions = np.concatenate([start, stop], axis=1)
        slow = np.array([segment_to_segments(m, edges.tolist()) for m in motions.tolist()])
        np.testing.assert_allclose(np.abs(clearance), slow, atol=1e-9)
        lines = shapely.multilinestrings(edges.reshape(-1, 2, 2))
        shapes = shapely.linestrings(motions.reshape(-1, 2, 2))
        np.testing.assert_allclose(np.abs(clearance), shapely.distance(shapes, lines), atol=1e-9)
        assert (clearance[shapely.intersects(shapes, lines)] == 0).all()
        stays_free = (slow > 0) & world.floor.free_at(start)
        np.testing.assert_array_equal(clearance > 0, stays_free)


def test_a_motion_is_never_clearer_than_its_points(rng):
    world = _grid_world(rng, yaw=0.2, share_free=0.97)
    index = ClearanceIndex.from_world(world)
    start = _random_points(rng, world, 60)
    stop = start + rng.normal(0, 1.0, (60, 2))
    along = np.stack([index.distance(start + t * (stop - start)) for t in np.linspace(0, 1, 41)])
    clearance = index.segment_distance(start, stop)
    assert (np.maximum(clearance, 0) <= np.maximum(along.min(axis=0), 0) + 1e-9).all()
    assert (clearance > 0).any()


def test_hand_made_room():
    world = world_from_ascii(ROOM)
    index = ClearanceIndex.from_world(world)
    s, g = place_in_ascii(ROOM, "s"), place_in_ascii(ROOM, "g")
    np.testing.assert_allclose(index.distance([s, g]), [0.75, 0.75])
    np.testing.assert_allclose(index.distance([[1.0, 0.5], [2.75, 1.75], [-1.0, 1.0]]), [0.0, -0.25, -1.5])
    motions = index.segment_distance([s, s, (1.0, 0.75)], [g, (1.25, 1.0), (4.0, 0.75)])
    np.testing.assert_allclose(motions, [0.0, 0.5, 0.25])


def test_on_the_boundary_is_no_clearance(rng):
    world = _polygon_world(rng)
    index = ClearanceIndex.from_world(world)
    ends = index.segments
    t = rng.random((len(ends), 1))
    on = ends[:, :2] + t * (ends[:, 2:] - ends[:, :2])
    assert (index.distance(ends[:, :2]) == 0).all()
    assert (np.abs(index.distance(on)) <= 1e-9).all()
    assert (index.segment_distance(on, on + 0.01) <= 1e-9).all()


@pytest.mark.parametrize("yaw", [0.0, 1.1])
def test_a_large_empty_hall(yaw):
    frame = GridFrame(5.0, -2.0, yaw, 0.5, 100, 160)
    free = np.ones(frame.shape, dtype=bool)
    world = World("hall", OccupancyGrid(frame, free, ~free), LandmarkSet.empty())
    index = ClearanceIndex.from_world(world)
    assert len(index.segments) == 4
    points = frame.to_world([[80.0, 50.0], [10.0, 50.0], [80.0, 98.0]])
    np.testing.assert_allclose(index.distance(points), [25.0, 5.0, 1.0])
    motion = frame.to_world([[4.0, 6.0], [150.0, 90.0]])
    np.testing.assert_allclose(index.segment_distance(motion[:1], motion[1:]), [2.0])


def test_centres_are_the_same_as_single_points(rng):
    for world in _worlds(rng):
        index = ClearanceIndex.from_world(world)
        for frame in (world.grid_frame(0.4), GridFrame(-6.0, 8.0, 0.3, 0.7, 70, 12)):
            clearance = index.at_centres(frame)
            single = index.distance(frame.centres().reshape(-1, 2)).reshape(frame.shape)
            np.testing.assert_allclose(clearance, np.maximum(single, 0), atol=1e-12)
            np.testing.assert_array_equal(clearance, index.at_centres(frame, threads=1))


def test_no_free_space_at_all():
    frame = GridFrame(0.0, 0.0, 0.0, 1.0, 3, 3)
    none = np.zeros(frame.shape, dtype=bool)
    index = ClearanceIndex.from_world(World("solid", OccupancyGrid(frame, none, ~none), LandmarkSet.empty()))
    assert index.distance([[1.0, 1.0]])[0] == -math.inf
    assert index.segment_distance([[1.0, 1.0]], [[2.0, 1.0]])[0] == -math.inf
    assert not index.at_centres(frame).any()
    assert index.nearest_free([[1.0, 1.0]], 0.1) is None


def test_pickled_index_is_the_same_and_still_read_only(rng):
    for world in (_grid_world(rng), _polygon_world(rng)):
        index = ClearanceIndex.from_world(world)
        again = pickle.loads(pickle.dumps(index))
        points = _random_points(rng, world, 20)
        np.testing.assert_array_equal(again.distance(points), index.distance(points))
        assert not any(a.flags.writeable for a in again.arrays)


class TestNearestFree:
    def test_the_place_has_the_clearance_and_none_nearer_does(self, rng):
        for world in _worlds(rng):
            index = ClearanceIndex.from_world(world)
            points = _random_points(rng, world, 25)
            frame = world.grid_frame(0.1)
            centres = index.at_centres(frame)
            need = 0.5 * float(centres.max())
            places = index.nearest_free(points, need, frame=frame, centre_clearance=centres)
            assert places is not None
            assert (index.distance(places) >= need).all()
            gone = np.hypot(*(places - points).T)
            assert (gone[index.distance(points) >= need] == 0).all()
            good = frame.centres()[centres >= need]
            nearest = np.array([np.hypot(*(good - p).T).min() for p in points])
            assert (gone <= nearest + 1e-9).all()

    def test_without_a_grid_at_hand(self):
        index = ClearanceIndex.from_world(world_from_ascii(ROOM))
        places = index.nearest_free([[0.6, 1.4]], 0.3)
        np.testing.assert_allclose(places, [[0.8, 1.4]], atol=0.02)

    def test_nowhere_wide_enough(self):
        index = ClearanceIndex.from_world(world_from_ascii(ROOM))
        assert index.nearest_free([[0.6, 1.4]], 1.5) is None

    @pytest.mark.parametrize("clearance", [-0.1, math.nan, math.inf])
    def test_refuses_an_impossible_clearance(self, clearance):
        index = ClearanceIndex.from_world(world_from_ascii(ROOM))
        with pytest.raises(InvalidGeometry, match="Clearance is"):
            index.nearest_free([[0.6, 1.4]], clearance)


@pytest.mark.parametrize("cell", [0.0, -1.0, math.nan, math.inf])
def test_refuses_impossible_buckets(cell):
    with pytest.raises(InvalidGeometry, match="Bucket side"):
        ClearanceIndex.from_world(world_from_ascii(ROOM), cell)


def test_refuses_points_that_are_none():
    index = ClearanceIndex.from_world(world_from_ascii(ROOM))
    with pytest.raises(InvalidGeometry, match="not finite"):
        index.distance([[0.0, math.nan]])
    with pytest.raises(InvalidGeometry, match="shape"):
        index.distance([0.0, 1.0])
    with pytest.raises(InvalidGeometry, match="one end per start"):
        index.segment_distance([[0.0, 1.0]], [[0.0, 1.0], [1.0, 1.0]])
