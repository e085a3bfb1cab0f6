"""Motions from pose to pose: limits hold densely, the robot really gets there, and no slower than need be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.se2 import wrap
from planner import timing
from planner.curve import curve_through
from planner.errors import InvalidProblem
from planner.kernels.pose_timing import turning_profile
from planner.pose_timing import MotionLimits, drive, time_poses, time_smooth_curve
from planner.ramps import fine_curve, plain_rows, with_ramps
from planner.steering import PoseCurve, PoseSpace, Steering, shortest_curve
from tests import oracles
from tests.paths import space_of
from tests.worlds import world_from_ascii

FULL = MotionLimits(1.2, 0.8, 1.0, 2.0)
OPEN = world_from_ascii("\n".join(["#" * 40, *["#" + "." * 38 + "#"] * 38, "#" * 40]))


@pytest.fixture
def dense(monkeypatch):
    """Samples every 4 ms."""
    monkeypatch.setattr(timing, "SAMPLE_S", 0.004)
    monkeypatch.setattr(timing, "MAX_SAMPLES", 10**6)


@pytest.fixture(scope="module")
def room():
    return space_of(OPEN, lambda x, y: 0.1 + 0.0 * x, radius=0.3)


def check_motion(motion, limits, start, goal):
    """Limits for samples and differences, and a unicycle that gets from start to goal with the given controls."""
    dt = np.diff(motion.t)
    assert motion.t[0] == 0
    assert (dt > 0).all()
    assert motion.speed[[0, -1]] == pytest.approx([0, 0])
    assert motion.turn_rate[[0, -1]] == pytest.approx([0, 0], abs=1e-9)
    slack = 1 + 1e-9
    turned = np.abs(wrap(np.diff(motion.poses[:, 2]))) / dt
    moved = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T) / dt
    assert np.abs(motion.speed).max() <= limits.max_speed * slack
    assert moved.max() <= limits.max_speed * slack
    assert np.hypot(motion.acceleration, motion.speed * motion.turn_rate).max() <= limits.max_accel * slack
    assert np.abs(np.diff(motion.speed) / dt).max() <= limits.max_accel * slack
    assert np.abs(motion.turn_rate).max() <= limits.max_turn_rate * slack
    assert turned.max() <= limits.max_turn_rate * (1 + 1e-6)
    assert np.abs(motion.turn_acceleration).max() <= limits.max_turn_accel * slack
    assert np.abs(np.diff(motion.turn_rate) / dt).max() <= limits.max_turn_accel * (1 + 1e-6)
    # Replay: speed and turn rate, linear between samples.
    x, y, theta = motion.poses[0]
    for k, h in enumerate(dt):
        v = 0.5 * (motion.speed[k] + motion.speed[k + 1])
        w = 0.5 * (motion.turn_rate[k] + motion.turn_rate[k + 1])
        x += h * v * math.cos(theta + 0.5 * h * w)
        y += h * v * math.sin(theta + 0.5 * h * w)
        theta += h * w
    np.testing.assert_allclose([x, y], goal[:2], atol=2e-3)
    assert abs(math.remainder(theta - goal[2], 2 * math.pi)) < 2e-3
    for pose, end in ((motion.poses[0], start), (motion.poses[-1], goal)):
        np.testing.assert_allclose(pose[:2], end[:2], atol=1e-6)
        assert abs(math.remainder(pose[2] - end[2], 2 * math.pi)) < 1e-6


@pytest.mark.parametrize("kinematics", ["differential", "dubins", "reeds_shepp"])
@pytest.mark.parametrize("limits", [FULL, MotionLimits(0.6, 2.0, 0.5, 0.4), MotionLimits(3.0, 0.3, 9.0, 0.5)])
def test_limits_hold_and_the_robot_arrives(kinematics, limits, dense, room, rng):
    steering = Steering(kinematics, 0.8)
    space = PoseSpace(room, room.rate[None], steering)
    ramped = 0
    for _ in range(6):
        a, b = (np.array([*rng.uniform(5, 14, 2), rng.uniform(-3, 3)]) for _ in range(2))
        curve = shortest_curve(a, b, steering)
        check_motion(time_poses(curve, limits), limits, a, b)
        motion, ramps = drive(curve, space, limits)
        check_motion(motion, limits, a, b)
        ramped += ramps is not None
        assert motion.duration <= time_poses(curve, limits).duration
    assert ramped or kinematics == "differential"


def test_a_straight_line_is_the_trapezoid():
    curve = PoseCurve(np.zeros(3), np.array([[10.0, 0, 0]]))
    plain = timing.time_polyline([[0, 0], [10, 0]], max_speed=1.2, max_accel=0.8)
    for limits in (FULL, MotionLimits(1.2, 0.8)):
        motion = time_poses(curve, limits)
        assert motion.duration == pytest.approx(plain.duration, rel=2e-3)
        assert motion.duration >= plain.duration
    back = time_poses(PoseCurve(np.zeros(3), np.array([[-10.0, 0, 0]])), FULL)
    assert back.duration == pytest.approx(plain.duration, rel=2e-3)
    assert back.speed.min() == pytest.approx(-1.2)
    np.testing.assert_allclose(back.poses[-1], [-10, 0, 0], atol=1e-9)


def test_a_turn_in_place_is_a_trapezoid_of_the_turn_rate():
    curve = PoseCurve(np.array([1.0, 2.0, 0.5]), np.array([[0, 0, -2.0]]))
    motion = time_poses(curve, FULL)
    assert motion.duration == pytest.approx(2.0 / 1.0 + 1.0 / 2.0)
    np.testing.assert_array_equal(motion.speed, 0)
    np.testing.assert_allclose(motion.poses[[0, -1], 2], [0.5, -1.5])
    assert time_poses(curve, MotionLimits(1, 1, 0.5)).duration == pytest.approx(4.0)
    assert time_poses(curve, MotionLimits(1, 1)).duration == 0
    assert time_poses(curve, MotionLimits(1, 1, math.inf, 2.0)).duration == pytest.approx(2.0)


def test_a_circle_is_driven_at_the_turn_rate():
    curve = PoseCurve(np.zeros(3), np.array([[20.0, 1.0, 0]]))
    motion = time_poses(curve, MotionLimits(2.0, 50.0, 0.5, 50.0))
    assert np.median(motion.turn_rate) == pytest.approx(0.5, rel=1e-2)
    assert motion.duration == pytest.approx(40.0, rel=1e-2)
    # Without a limit of turning, that of the sideways acceleration holds.
    assert np.median(time_poses(curve, MotionLimits(2.0, 0.25)).speed) == pytest.approx(0.5, rel=1e-2)


def test_stops_where_the_curvature_jumps_only_if_turning_is_limited(room):
    curve = shortest_curve((5, 5, 0), (12, 9, 0), Steering("dubins", 1.0))
    assert len(curve.parts) == 3
    free = time_poses(curve, MotionLimits(1.2, 0.8))
    bound = time_poses(curve, FULL)
    assert np.count_nonzero(free.speed[1:-1] < 1e-9) == 0
    assert np.count_nonzero(bound.speed[1:-1] < 1e-9) == 2
    motion, ramps = drive(curve, PoseSpace(room, room.rate[None], Steering("dubins", 1.0)), FULL)
    assert ramps is not None
    assert np.count_nonzero(motion.speed[1:-1] < 1e-9) == 0
    assert free.duration < motion.duration < bound.duration - 2.0


def test_stops_to_change_gear():
    curve = PoseCurve(np.zeros(3), np.array([[2.0, 0, 0], [-2.0, 0, 0]]))
    motion = time_poses(curve, FULL)
    assert motion.speed.max() > 0.9
    assert motion.speed.min() < -0.9
    np.testing.assert_allclose(motion.poses[-1], 0, atol=1e-9)


@pytest.mark.parametrize("kinematics", ["dubins", "reeds_shepp"])
def test_ramps_keep_ends_curvature_and_room(kinematics, room, rng):
    steering = Steering(kinematics, 0.8)
    space = PoseSpace(room, room.rate[None], steering)
    found = 0
    for _ in range(20):
        a, b = (np.array([*rng.uniform(5, 14, 2), rng.uniform(-3, 3)]) for _ in range(2))
        curve = shortest_curve(a, b, steering)
        rows = with_ramps(curve, space, speed=0.8, max_turn_accel=2.0)
        if rows is None:
            continue
        found += 1
        assert np.abs(rows[:, 1:3]).max() <= 1 / 0.8 + 1e-9
        fine = fine_curve(curve.start, rows)
        np.testing.assert_allclose(fine.joints()[-1][:2], b[:2], atol=1e-4)
        assert abs(math.remainder(fine.joints()[-1][2] - b[2], 2 * math.pi)) < 1e-6
        assert space.cost(fine) <= 1.01 * space.cost(curve)
        # Beside the curve by centimetres at most.
        other = curve.sample(0.01).poses[:, :2]
        for p in fine.sample(0.2).poses[:, :2]:
            assert np.hypot(*(other - p).T).min() < 0.1
    assert found > 10


def test_ramps_that_do_not_fit_are_left_out():
    # A corridor as wide as the robot, with a kink.
    drawing = """
        ############
        #..........#
        ############
        """
    tight = space_of(world_from_ascii(drawing), lambda x, y: 0.1 + 0.0 * x, radius=0.2475)
    space = PoseSpace(tight, tight.rate[None], Steering("dubins", 0.5))
    curve = shortest_curve((1.0, 0.749, 0.0), (4.0, 0.751, 0.0), space.steering)
    assert len(curve.parts) == 3
    motion, _ = drive(curve, space, FULL)
    assert motion.duration > 0
    assert with_ramps(curve, space, speed=1.0, max_turn_accel=math.inf) is None
    np.testing.assert_array_equal(plain_rows(curve)[:, 0], curve.parts[:, 0])


def test_profile_is_as_fast_as_a_search_over_levels(rng):
    for _ in range(6):
        n = 9
        knots = rng.uniform(-1.5, 1.5, n)
        kappa = np.column_stack([knots[:-1], knots[1:]])
        step = rng.uniform(0.1, 0.4, n - 1)
        limits = (1.0, 0.8, 0.9, 1.1)
        b = np.empty(n)
        turning_profile(kappa, step, *limits, b)
        for i in range(n - 1):
            assert oracles.turning_allowed(b[i], b[i + 1], *kappa[i], step[i], *limits)
        times = 2 * step / (np.sqrt(b[:-1]) + np.sqrt(b[1:]))
        best = oracles.turning_time(kappa, step, *limits, levels=60)
        assert times.sum() <= 1.06 * best


@pytest.mark.parametrize("headings", [(None, None), (2.0, -1.0), (0.1, None)])
def test_smooth_curves_with_turns_at_the_ends(headings, dense):
    points = np.array([[0, 0], [1, 0.2], [2.5, 1.5], [4, 1.5], [5, 0.2]], dtype=float)
    curve = curve_through(points)
    motion = time_smooth_curve(curve, FULL, start_heading=headings[0], goal_heading=headings[1])
    ends = [time_smooth_curve(curve, FULL).poses[k] for k in (0, -1)]
    start, goal = ([*e[:2], e[2] if h is None else h] for e, h in zip(ends, headings, strict=True))
    check_motion(motion, FULL, start, goal)
    assert motion.duration >= time_smooth_curve(curve, FULL).duration
    centre = motion.to_trajectory()
    assert np.hypot(*centre.acceleration.T).max() <= FULL.max_accel * (1 + 1e-9)
    gap = np.diff(centre.points, axis=0) / np.diff(centre.t)[:, None] - 0.5 * (
        centre.velocity[1:] + centre.velocity[:-1]
    )
    assert np.abs(gap).max() < 2e-3


def test_nowhere_to_go():
    motion = time_poses(PoseCurve(np.array([1.0, 2.0, 3.0]), np.empty((0, 3))), FULL)
    assert motion.duration == 0
    np.testing.assert_allclose(motion.poses, [[1, 2, 3]])


@pytest.mark.parametrize(
    "numbers", [(0, 1, 1, 1), (1, -1, 1, 1), (1, 1, 0, 1), (1, 1, 1, math.nan), (1, math.inf, 1, 1)]
)
def test_impossible_limits(numbers):
    with pytest.raises(InvalidProblem, match="max_"):
        MotionLimits(*numbers)
