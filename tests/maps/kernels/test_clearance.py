"""Bucketed nearest-segment search against a walk over all segments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.clearance import ClearanceIndex
from maps.grid import GridFrame, OccupancyGrid
from maps.kernels.clearance import (
    point_distance,
    point_segment_squared,
    points_distance,
    segment_distance,
    segment_segment_squared,
    segments_distance,
)
from maps.landmarks import LandmarkSet
from maps.world import World
from tests.oracles import point_to_segments, segment_to_segment, segment_to_segments


def _world(rng, share_free, yaw):
    frame = GridFrame(float(rng.uniform(-40, 40)), float(rng.uniform(-40, 40)), yaw, 0.3, 9, 14)
    free = rng.random(frame.shape) < share_free
    free[4, 4] = True
    return World("random", OccupancyGrid(frame, free, ~free), LandmarkSet.empty())


def _queries(rng, world, n):
    x0, y0, x1, y1 = world.bounds
    start = rng.uniform([x0 - 3, y0 - 3], [x1 + 3, y1 + 3], (n, 2))
    stop = rng.uniform([x0 - 3, y0 - 3], [x1 + 3, y1 + 3], (n, 2))
    near = rng.random(n) < 0.5
    stop[near] = start[near] + rng.normal(0, 0.2, (near.sum(), 2))
    return np.concatenate([start, stop], axis=1)


@pytest.mark.parametrize("cell", [0.07, 0.3, 1.0, 50.0])
@pytest.mark.parametrize("share_free", [0.03, 0.5, 0.97])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_the_nearest_segment_is_found_whatever_the_buckets(rng, cell, share_free, yaw):
    world = _world(rng, share_free, yaw)
    index = ClearanceIndex.from_world(world, cell)
    queries = _queries(rng, world, 15)
    points, motions = np.empty(15), np.empty(15)
    points_distance(np.ascontiguousarray(queries[:, :2]), math.inf, points, *index.arrays)
    segments_distance(queries, math.inf, motions, *index.arrays)
    edges = [tuple(e) for e in index.segments.tolist()]
    for query, d_point, d_motion in zip(queries.tolist(), points, motions, strict=True):
        assert d_point == pytest.approx(point_to_segments(query[:2], edges), abs=1e-9)
        assert d_motion == pytest.approx(segment_to_segments(query, edges), abs=1e-9)


def test_the_cap_cuts_and_changes_nothing_below_it(rng):
    world = _world(rng, 0.9, 0.3)
    index = ClearanceIndex.from_world(world)
    seen = set()
    for x0, y0, x1, y1 in _queries(rng, world, 60).tolist():
        exact_point = point_distance(x0, y0, math.inf, *index.arrays)
        exact_motion = segment_distance(x0, y0, x1, y1, math.inf, *index.arrays)
        for cap in (0.05, 0.3, 1.0):
            assert point_distance(x0, y0, cap, *index.arrays) == min(cap, exact_point)
            assert segment_distance(x0, y0, x1, y1, cap, *index.arrays) == pytest.approx(
                min(cap, exact_motion), abs=1e-12
            )
            seen.add((exact_point > cap, exact_motion > cap))
    assert {(True, True), (False, False)} <= seen


@pytest.mark.parametrize("cap", [0.0, -1.0])
def test_a_cap_of_nothing_is_reached_at_once(rng, cap):
    index = ClearanceIndex.from_world(_world(rng, 0.5, 0.0))
    assert point_distance(0.0, 0.0, cap, *index.arrays) == 0.0
    assert segment_distance(0.0, 0.0, 1.0, 0.0, cap, *index.arrays) == 0.0


def test_segment_pairs(rng):
    # Few distinct integer corners: touching, crossing, collinear and point-like pairs are common.
    for values in rng.integers(0, 4, (400, 8)).astype(float).tolist():
        a, b = values[:4], values[4:]
        expected = segment_to_segment(a, b)
        assert math.sqrt(segment_segment_squared(*a, *b)) == pytest.approx(expected, abs=1e-12)
        assert math.sqrt(segment_segment_squared(*b, *a)) == pytest.approx(expected, abs=1e-12)


def test_a_segment_of_length_zero_is_a_point():
    assert point_segment_squared(3.0, 4.0, 0.0, 0.0, 0.0, 0.0) == 25.0
    assert segment_segment_squared(3.0, 4.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0) == 25.0


def test_far_outside_the_buckets():
    free = np.ones((2, 3), dtype=bool)
    frame = GridFrame(0.0, 0.0, 0.0, 1.0, 2, 3)
    index = ClearanceIndex.from_world(World("box", OccupancyGrid(frame, free, ~free), LandmarkSet.empty()))
    assert point_distance(1e5 + 3.0, 1.0, math.inf, *index.arrays) == pytest.approx(1e5, rel=1e-12)
    assert point_distance(1e5 + 3.0, 1.0, 7.0, *index.arrays) == 7.0
    assert segment_distance(-4.0, -9.0, 900.0, -9.0, math.inf, *index.arrays) == pytest.approx(9.0)
    assert segment_distance(1.5, -900.0, 1.5, 900.0, math.inf, *index.arrays) == 0.0
