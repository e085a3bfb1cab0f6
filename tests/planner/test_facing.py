"""Robots that turn in place: the smooth way of a disc, faced and timed anew."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.se2 import wrap
from planner.errors import InvalidProblem
from planner.facing import faced
from planner.plan import plan
from planner.pose_timing import MotionLimits
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from planner.timing import time_polyline
from tests.planner.test_pose_question import HIGH, LOW, room

LIMITS = MotionLimits(1.2, 0.8, 1.0, 2.0)


def space_of(context):
    return context.graph(radius=0.2, weight=0.0, blind_rate=1.0).cost_space


def check(motion, limits=LIMITS):
    t = np.asarray(motion.t)
    assert (np.diff(t) > -1e-12).all()
    assert np.abs(motion.turn_rate).max() <= limits.max_turn_rate * 1.001
    assert np.abs(motion.speed).max() <= limits.max_speed * 1.001
    # The heading is the way's.
    moved = np.diff(np.asarray(motion.poses)[:, :2], axis=0)
    far = np.hypot(*moved.T) > 1e-3
    off = wrap(np.arctan2(moved[far, 1], moved[far, 0]) - np.asarray(motion.poses)[:-1, 2][far])
    assert np.abs(off).max() < 0.2


def test_corners_are_turned_on_the_spot():
    context = room()
    line = time_polyline(np.array([[2.0, 1.5], [4.5, 1.5], [4.5, 4.0]]), max_speed=1.2, max_accel=0.8)
    motion = faced(line, space_of(context), LIMITS, start_heading=math.pi / 2, goal_heading=-math.pi / 2)
    check(motion)
    poses = np.asarray(motion.poses)
    np.testing.assert_allclose(poses[0], [2.0, 1.5, math.pi / 2], atol=1e-9)
    np.testing.assert_allclose(poses[-1, :2], [4.5, 4.0], atol=1e-9)
    assert abs(wrap(poses[-1, 2] + math.pi / 2)) < 1e-9
    corner = np.hypot(*(poses[:, :2] - [4.5, 1.5]).T) < 1e-9
    assert np.ptp(poses[corner, 2]) == pytest.approx(math.pi / 2, abs=1e-6)


def test_a_motion_that_stays_turns_at_most():
    context = room()
    point = time_polyline(np.array([[2.0, 1.5]]), max_speed=1.2, max_accel=0.8)
    assert faced(point, space_of(context), LIMITS, goal_heading=1.0).poses[0, 2] == 1.0


@pytest.mark.parametrize("ends", [(None, None), (math.pi, 1.0)])
def test_plans_of_differential_robots_keep_the_smooth_way(ends):
    context = room()
    values = {"kinematics": "differential", "start_heading": ends[0], "goal_heading": ends[1]}
    result = plan(PlanningProblem(LOW, HIGH, 0.2, deadline=20.0, max_turn_accel=2.0, **values), context)
    assert result.status is PlanStatus.EXACT
    assert result.planner.endswith("+facing")
    plain = plan(PlanningProblem(LOW, HIGH, 0.2, deadline=20.0), context)
    assert result.route.summary.length == pytest.approx(plain.route.summary.length, rel=1e-3)
    assert result.route.summary.duration > plain.route.summary.duration
    for at, heading in zip((0, -1), ends, strict=True):
        if heading is not None:
            assert abs(wrap(result.route.path.heading[at] - heading)) < 1e-6
    assert result.route.summary.min_clearance >= -1e-6


def test_beliefs_and_poses_do_not_go_together():
    with pytest.raises(InvalidProblem, match="leave out"):
        plan(PlanningProblem(LOW, HIGH, 0.2, covariance="fused", kinematics="differential"), room())


def test_cars_go_by_the_lattice_through_via_points():
    result = plan(
        PlanningProblem(
            LOW, HIGH, 0.2, deadline=20.0, refine=20, kinematics="reeds_shepp", min_turn_radius=0.5,
            start_heading=0.0, goal_heading=0.0, via=((6.5, 1.5),),
        ),
        room(),
    )  # fmt: skip
    assert result.route is not None
    assert np.hypot(*(np.asarray(result.route.trajectory.points) - [6.5, 1.5]).T).min() < 1e-6
