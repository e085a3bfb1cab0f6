"""Cutting paths and joining motions."""

from __future__ import annotations

import numpy as np

from planner.pieces import cut_around, joined
from planner.timing import time_polyline
from tests.planner.test_timing import check_motion

PATH = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])


def test_cut_in_the_middle_keeps_every_point_in_order():
    before, middle, after = cut_around(PATH, np.array([3.8, 0.1]), 0.5)
    np.testing.assert_allclose(before, [[0, 0], [3.3, 0]])
    np.testing.assert_allclose(middle, [[3.3, 0], [4, 0], [4, 0.3]])
    np.testing.assert_allclose(after, [[4, 0.3], [4, 3]])


def test_cut_near_the_ends():
    before, middle, after = cut_around(PATH, np.array([0.2, 0.0]), 0.5)
    assert before is None
    np.testing.assert_allclose(middle, [[0, 0], [0.7, 0]])
    assert after is not None
    before, middle, after = cut_around(PATH, np.array([4.0, 2.9]), 0.5)
    assert after is None
    np.testing.assert_allclose(middle, [[4, 2.4], [4, 3]])
    before, middle, after = cut_around(PATH, np.array([4.0, 0.0]), 50.0)
    assert before is None
    assert after is None
    np.testing.assert_array_equal(middle, PATH)


def test_joined_motions_follow_each_other():
    parts = [time_polyline(p, max_speed=1.0, max_accel=0.5) for p in (PATH[:2], PATH[1:])]
    whole = joined(parts)
    check_motion(whole, 1.0, 0.5)
    assert whole.duration == parts[0].duration + parts[1].duration
    alone = time_polyline(PATH, max_speed=1.0, max_accel=0.5)
    np.testing.assert_allclose(whole.points, alone.points, atol=1e-12)
    np.testing.assert_allclose(whole.acceleration, alone.acceleration, atol=1e-12)
