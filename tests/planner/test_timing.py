"""Stop-and-go along polylines."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.errors import InvalidProblem
from planner.timing import MAX_SAMPLES, SAMPLE_S, distinct_points, time_polyline


def check_motion(trajectory, max_speed, max_accel):
    """Limits for the samples and for differences, exact kinematics between samples, at rest at both ends."""
    t, p, v, a = trajectory.t, trajectory.points, trajectory.velocity, trajectory.acceleration
    assert t[0] == 0
    dt = np.diff(t)
    assert (dt > 0).all()
    assert np.hypot(*v.T).max() <= max_speed * (1 + 1e-9)
    assert np.hypot(*a.T).max() <= max_accel * (1 + 1e-9)
    assert np.hypot(*(np.diff(p, axis=0) / dt[:, None]).T).max() <= max_speed * (1 + 1e-9)
    assert np.hypot(*(np.diff(v, axis=0) / dt[:, None]).T).max() <= max_accel * (1 + 1e-9)
    np.testing.assert_array_equal(v[[0, -1]], 0)
    # Places follow the velocities: the trapezoidal rule, whose error the acceleration bounds.
    step = 0.5 * (v[1:] + v[:-1]) * dt[:, None]
    assert (np.hypot(*(np.diff(p, axis=0) - step).T) <= 0.25 * max_accel * dt**2 + 1e-9).all()


@pytest.mark.parametrize(
    ("length", "expected"),
    [(10.0, 10.0 / 1.2 + 1.5), (1.8, 3.0), (0.5, 2 * math.sqrt(0.5 / 0.8)), (1e-3, None)],
)
def test_one_segment_is_a_trapezoid_or_a_triangle(length, expected):
    trajectory = time_polyline([[1.0, 2.0], [1.0, 2.0 + length]], max_speed=1.2, max_accel=0.8)
    check_motion(trajectory, 1.2, 0.8)
    assert trajectory.duration == pytest.approx(expected or 2 * math.sqrt(length / 0.8))
    np.testing.assert_array_equal(trajectory.points[[0, -1]], [[1.0, 2.0], [1.0, 2.0 + length]])
    assert np.diff(trajectory.t).max() <= SAMPLE_S + 1e-12


def test_stops_at_every_corner_and_only_there():
    points = [[0, 0], [1, 0], [4, 0], [4, 0], [4, 5], [4.05, 5]]
    trajectory = time_polyline(points, max_speed=1.2, max_accel=0.8)
    check_motion(trajectory, 1.2, 0.8)
    slow = trajectory.points[np.hypot(*trajectory.velocity.T) < 1e-9]
    np.testing.assert_allclose(slow, [[0, 0], [4, 0], [4, 5], [4.05, 5]])
    parts = [4 / 1.2 + 1.5, 5 / 1.2 + 1.5, 2 * math.sqrt(0.05 / 0.8)]
    assert trajectory.duration == pytest.approx(sum(parts))


def test_zigzags_with_random_lengths(rng):
    for _ in range(10):
        points = np.cumsum(rng.normal(size=(20, 2)) * rng.uniform(0.01, 5), axis=0)
        check_motion(time_polyline(points, max_speed=1.5, max_accel=0.4), 1.5, 0.4)


def test_places_lie_on_the_polyline(rng):
    points = np.cumsum(rng.normal(size=(6, 2)), axis=0)
    trajectory = time_polyline(points, max_speed=0.9, max_accel=2.0)
    for p in trajectory.points:
        a, b = points[:-1], points[1:]
        share = np.clip(((p - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1), 0, 1)
        assert np.hypot(*(a + share[:, None] * (b - a) - p).T).min() < 1e-9


def test_no_way_to_go():
    for points in ([[3.0, 4.0]], [[3.0, 4.0], [3.0, 4.0]]):
        trajectory = time_polyline(points, max_speed=1.0, max_accel=1.0)
        assert trajectory.duration == 0
        assert len(trajectory.t) == 1
        np.testing.assert_array_equal(trajectory.points, [[3.0, 4.0]])


def test_back_and_forth_stops_at_the_turn():
    trajectory = time_polyline([[0, 0], [2, 0], [0, 0]], max_speed=1.0, max_accel=1.0)
    check_motion(trajectory, 1.0, 1.0)
    assert trajectory.duration == pytest.approx(6.0)


def test_long_ways_have_a_bounded_number_of_samples():
    trajectory = time_polyline([[0, 0], [2000.0, 0], [2000.0, 1.0]], max_speed=1.0, max_accel=1.0)
    assert len(trajectory.t) <= MAX_SAMPLES + 10
    check_motion(trajectory, 1.0, 1.0)


def test_points_that_coincide_count_once():
    p = distinct_points([[0, 0], [0, 1e-12], [1, 0], [1, 0], [1, 1e-10]])
    np.testing.assert_array_equal(p, [[0, 0], [1, 1e-10]])


@pytest.mark.parametrize("points", [[], [[0, math.nan]], [1, 2], [[1, 2, 3]]])
def test_impossible_points(points):
    with pytest.raises(InvalidProblem, match="path"):
        time_polyline(points, max_speed=1.0, max_accel=1.0)


@pytest.mark.parametrize("limits", [(0.0, 1.0), (1.0, -1.0), (math.inf, 1.0), (1.0, math.nan)])
def test_impossible_limits(limits):
    with pytest.raises(InvalidProblem, match="max_"):
        time_polyline([[0, 0], [1, 0]], max_speed=limits[0], max_accel=limits[1])
