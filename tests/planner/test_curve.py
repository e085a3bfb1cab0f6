"""Curves: geometry, checks, fastest motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.curve import check_curve, curve_through, time_curve
from planner.example_space import example_space
from tests.planner.test_timing import check_motion


def circle(radius, n=40, share=1.0):
    angle = np.linspace(0, 2 * math.pi * share, n)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def test_length_and_curvature_of_a_circle():
    curve = curve_through(circle(2.0))
    assert curve.length == pytest.approx(4 * math.pi, rel=1e-4)
    middle = slice(len(curve.s) // 4, 3 * len(curve.s) // 4)
    np.testing.assert_allclose(curve.kappa[middle], 0.5, rtol=3e-3)
    np.testing.assert_allclose(np.hypot(*curve.points[middle].T), 2.0, rtol=1e-4)
    np.testing.assert_allclose(curve.kappa[[0, -1]], 0.0, atol=1e-12)


def test_the_points_given_lie_on_the_curve(rng):
    points = np.column_stack([np.arange(12) * 0.3, rng.normal(size=12) * 0.1])
    curve = curve_through(points)
    for p in points:
        assert np.hypot(*(curve.points - p).T).min() < 0.011
    np.testing.assert_array_equal(curve.points[[0, -1]], points[[0, -1]])


def test_motion_on_a_circle_is_as_fast_as_the_sideways_acceleration_allows():
    curve = curve_through(circle(1.0))
    trajectory = time_curve(curve, max_speed=3.0, max_accel=0.64)
    check_motion(trajectory, 3.0, 0.64)
    speed = np.hypot(*trajectory.velocity.T)
    middle = (trajectory.t > 3) & (trajectory.t < trajectory.duration - 3)
    np.testing.assert_allclose(speed[middle], 0.8, rtol=5e-3)


def test_motion_on_wiggly_curves_keeps_the_limits(rng):
    for _ in range(10):
        n = int(rng.integers(3, 60))
        points = np.column_stack([np.arange(n) * 0.25, rng.normal(size=n) * rng.uniform(0, 0.3)])
        curve = curve_through(points)
        trajectory = time_curve(curve, max_speed=1.2, max_accel=0.8)
        check_motion(trajectory, 1.2, 0.8)
        np.testing.assert_array_equal(trajectory.points[[0, -1]], points[[0, -1]])
        for p in trajectory.points[:: max(1, len(trajectory.t) // 20)]:
            assert np.hypot(*(curve.points - p).T).min() < 0.02


def test_a_straight_curve_is_a_trapezoid():
    curve = curve_through(np.array([[0.0, 0.0], [4.0, 3.0], [8.0, 6.0]]))
    trajectory = time_curve(curve, max_speed=1.0, max_accel=0.5)
    assert trajectory.duration == pytest.approx(10.0 + 2.0, rel=2e-3)


def test_check_says_what_is_wrong():
    space = example_space()
    good = check_curve(curve_through(np.array([[0.5, 0.5], [1.5, 0.6], [2.5, 2.5]])), space)
    assert good.is_valid
    assert math.isfinite(good.cost)
    near = check_curve(curve_through(np.array([[0.5, 0.5], [1.5, 0.15], [2.5, 0.5]])), space)
    assert not near.is_valid
    assert "clearance" in near.complaint()
    outside = check_curve(curve_through(np.array([[0.5, 0.5], [1.5, -1.0], [2.5, 0.5]])), space)
    assert not outside.is_valid
    assert "forbidden" in outside.complaint()


def test_clearance_of_the_curve_itself_is_covered_by_that_of_its_chords(rng):
    space = example_space()
    valid = 0
    for _ in range(40):
        points = circle(rng.uniform(0.1, 1.4), int(rng.integers(8, 60)), rng.uniform(0.3, 0.9))
        curve = curve_through(points + np.array([1.5, rng.uniform(0.3, 2.7)]))
        dense = curve.spline(np.linspace(0, curve.u[-1], 5_000))
        check = check_curve(curve, space)
        if not np.isfinite(check.cost):
            continue
        real = space.clearance.distance(dense).min()
        assert real >= space.need - check.worst - 1e-9
        valid += check.is_valid
    assert valid > 3
