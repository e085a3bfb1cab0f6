"""Poses at even times: headings, turns on the spot, what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from planner.curve import curve_through, time_curve
from planner.errors import InvalidProblem
from planner.pose_timing import MotionLimits, time_poses
from planner.reference import MAX_STEPS, fitting_steering, reference_of
from planner.result import Trajectory
from planner.steering import PoseCurve
from planner.timing import at_rest, time_polyline

CORNER = [[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]]


def test_a_differential_drive_turns_on_the_spot_at_corners():
    trajectory = time_polyline(CORNER, max_speed=1.0, max_accel=1.0)
    r = reference_of(trajectory, step=0.05, max_turn_rate=0.5)
    assert r.times[-1] == pytest.approx(trajectory.duration + math.pi / 2 / 0.5, abs=0.06)
    np.testing.assert_allclose(r.poses[0], [0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(r.poses[-1], [2, 3, math.pi / 2], atol=1e-12)
    assert r.s[-1] == pytest.approx(5.0)
    turning = (r.poses[:, 2] > 1e-9) & (r.poses[:, 2] < math.pi / 2 - 1e-9)
    assert turning.sum() * 0.05 == pytest.approx(math.pi, abs=0.1)
    np.testing.assert_allclose(r.poses[turning, :2], np.tile([2.0, 0.0], (turning.sum(), 1)), atol=1e-9)
    distances, turns = r.increments("differential")
    assert np.abs(turns).max() <= 0.5 * 0.05 + 1e-12
    assert (distances >= -1e-12).all()
    assert distances.sum() == pytest.approx(5.0)


def test_corners_turn_the_short_way_round():
    back = time_polyline([[0, 0], [-1, -0.1], [-2, 0.1]], max_speed=1.0, max_accel=1.0)
    r = reference_of(back, step=0.05)
    assert np.abs(np.diff(np.unwrap(r.poses[:, 2]))).sum() == pytest.approx(0.297, abs=0.01)
    assert (np.abs(r.poses[:, 2]) <= math.pi).all()


def test_smooth_curves_keep_their_time_and_place():
    curve = curve_through(np.array([[0, 0], [2, 0.5], [4, 0.0], [6, 1.0]], float))
    trajectory = time_curve(curve, max_speed=1.0, max_accel=0.5)
    r = reference_of(trajectory, step=0.05)
    assert r.times[-1] == pytest.approx(trajectory.duration, abs=0.05)
    at = np.array([np.interp(r.times[:-1], trajectory.t, trajectory.points[:, i]) for i in (0, 1)]).T
    np.testing.assert_allclose(r.poses[:-1, :2], at, atol=1e-9)
    along = np.arctan2(*np.gradient(r.poses[:, :2], axis=0).T[::-1])
    np.testing.assert_allclose(r.poses[2:-2, 2], along[2:-2], atol=0.02)


def test_time_is_stretched_where_the_robot_cannot_turn_so_fast():
    curve = curve_through(np.array([[0, 0], [1, 0], [1, 0.4], [0, 0.4]], float))
    trajectory = time_curve(curve, max_speed=1.0, max_accel=2.0)
    slow = reference_of(trajectory, step=0.02, max_turn_rate=0.3)
    assert slow.times[-1] > 1.5 * trajectory.duration
    assert np.abs(slow.increments("differential")[1]).max() <= 0.3 * 0.02 + 1e-9


def test_a_holonomic_robot_keeps_its_heading():
    trajectory = time_polyline(CORNER, max_speed=1.0, max_accel=1.0)
    r = reference_of(trajectory, step=0.05, steering="holonomic")
    assert r.times[-1] == pytest.approx(trajectory.duration, abs=0.05)
    np.testing.assert_array_equal(r.poses[:, 2], np.zeros(len(r)))
    distances, turns = r.increments("holonomic")
    assert distances.sum() == pytest.approx(5.0, abs=0.01)
    np.testing.assert_array_equal(turns, np.zeros(len(turns)))


def test_headings_of_the_motion_are_driven_backwards_too():
    shape = PoseCurve(
        np.array([5.0, 5.0, 3.0]), np.array([[1.0, 0.5, 0], [-2.0, -0.5, 0], [0, 0, 1.0], [1.0, 0, 0]])
    )
    motion = time_poses(shape, MotionLimits(1.0, 1.0, 0.8)).to_trajectory()
    assert fitting_steering(motion) == "differential"
    r = reference_of(motion, step=0.02)
    assert r.times[-1] == pytest.approx(motion.duration, abs=0.03)
    np.testing.assert_allclose(r.poses[-1, :2], motion.points[-1], atol=1e-9)
    assert math.remainder(r.poses[-1, 2] - motion.heading[-1], 2 * math.pi) == pytest.approx(0, abs=1e-9)
    distances, turns = r.increments("differential")
    assert distances[distances < 0].sum() == pytest.approx(-2.0, abs=1e-3)
    assert distances.sum() == pytest.approx(0.0, abs=1e-3)
    assert turns.sum() == pytest.approx(0.5 + 1.0 + 1.0, abs=1e-6)
    slow = reference_of(motion, step=0.02, max_turn_rate=0.1)
    assert np.abs(slow.increments("differential")[1]).max() <= 0.1 * 0.02 + 1e-9
    # The poses lie on the curve: between samples no heading is off the way by more than the sampling's.
    np.testing.assert_allclose(
        np.hypot(*np.diff(r.poses[:, :2], axis=0).T), np.abs(distances), rtol=1e-3, atol=1e-6
    )


def test_sideways_is_for_holonomic_robots():
    straight = time_polyline([[0, 0], [3, 0]], max_speed=1.0, max_accel=1.0)
    aside = replace(straight, heading=np.linspace(1.0, 2.0, len(straight.t)))
    assert fitting_steering(aside) == "holonomic"
    with pytest.raises(InvalidProblem, match=r"sideways at 0.0 s.*holonomic"):
        reference_of(aside, step=0.05)
    r = reference_of(aside, step=0.05, steering="holonomic")
    np.testing.assert_allclose(r.poses[[0, -1], 2], [1.0, 2.0])
    assert r.increments("holonomic")[0].sum() == pytest.approx(3.0)
    with pytest.raises(InvalidProblem, match="heading"):
        reference_of(replace(straight, heading=np.full(len(straight.t), math.nan)), step=0.05)


def test_what_cannot_be_driven_is_refused():
    with pytest.raises(InvalidProblem, match="stays where it is"):
        reference_of(at_rest(np.array([1.0, 2.0])), step=0.05)
    long = time_polyline([[0, 0], [100, 0]], max_speed=0.1, max_accel=1.0)
    with pytest.raises(InvalidProblem, match=f"limit is {MAX_STEPS}"):
        reference_of(long, step=0.001)
    t = Trajectory(
        np.array([0.0, 1.0]), np.array([[0, 0], [math.nan, 1]]), np.zeros((2, 2)), np.zeros((2, 2))
    )
    with pytest.raises(InvalidProblem, match="not finite"):
        reference_of(t, step=0.05)
