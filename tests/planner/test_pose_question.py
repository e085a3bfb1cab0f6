"""Plans for robots with a heading: cars, outlines, poses at the ends, fixed cameras."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import Polygon

from localization.at_poses import fixes_at
from localization.field_builder import build_field, build_heading_field
from localization.sensors import LASER, PinholeFixedSensor
from maps.io.site import bundled_site
from planner.clock import Clock
from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.footprint import Footprint
from planner.plan import plan
from planner.pose_question import plan_with_poses
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from planner.unmet import round_up
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
    ####################
    #..................#
    #..................#
    #..................#
    #..................#
    ########..##########
    #..................#
    #..................#
    #..................#
    #..................#
    ####################
"""
LOW, HIGH = (2.0, 1.5), (8.0, 4.0)


def room(sigma=lambda x, y: 0.02 + 0 * x, resolution=0.25):
    return PlanningContext(synthetic_field(world_from_ascii(ROOM), resolution, sigma))


def ask(context, start=LOW, goal=HIGH, radius=0.2, **values):
    problem = PlanningProblem(start, goal, radius, deadline=20.0, refine=50, **values)
    return plan_with_poses(problem, context, Clock(problem.deadline), baseline=lambda: None)


def check_motion(result, problem_headings=()):
    trajectory = result.route.trajectory
    speed = np.hypot(*np.asarray(trajectory.velocity).T)
    assert speed.max() <= 1.2 * 1.001
    assert speed[0] == pytest.approx(0.0, abs=1e-6)
    assert speed[-1] == pytest.approx(0.0, abs=1e-6)
    for at, heading in problem_headings:
        assert result.route.path.heading[at] == pytest.approx(heading, abs=1e-6)


@pytest.mark.parametrize("kinematics", ["differential", "dubins", "reeds_shepp"])
def test_headings_at_the_ends_are_kept(kinematics):
    radius = 0.0 if kinematics == "differential" else 0.5
    result = ask(
        room(), kinematics=kinematics, min_turn_radius=radius, start_heading=math.pi / 2, goal_heading=0.0
    )
    assert result.status in {PlanStatus.EXACT, PlanStatus.APPROXIMATE}
    check_motion(result, [(0, math.pi / 2), (-1, 0.0)])
    np.testing.assert_allclose(result.route.path.points[[0, -1]], [LOW, HIGH], atol=1e-6)
    assert result.route.summary.min_clearance >= -2e-9
    # Through the door.
    assert np.abs(result.route.trajectory.points - [4.5, 2.75]).max(axis=1).min() < 0.6


def test_a_car_that_is_too_wide_in_its_turns_says_what_is_too_narrow():
    result = ask(
        room(), kinematics="dubins", min_turn_radius=4.0, start_heading=math.pi, goal_heading=math.pi
    )
    assert result.status is PlanStatus.NO_PATH
    assert result.warnings


def test_an_outline_turns_where_there_is_room():
    long = ((-0.5, -0.2), (0.9, -0.2), (0.9, 0.2), (-0.5, 0.2))
    context = room(resolution=0.125)
    result = ask(context, kinematics="differential", footprint=long, start_heading=0.0)
    assert result.status in {PlanStatus.EXACT, PlanStatus.APPROXIMATE}, result.warnings
    footprint = Footprint.of(long)
    poses = np.column_stack([result.route.path.points, result.route.path.heading])
    assert (footprint.clearance(context.clearance, poses) > -0.05).all()
    assert result.route.summary.min_clearance > -0.05
    wide = ((-0.5, -0.6), (0.9, -0.6), (0.9, 0.6), (-0.5, 0.6))
    assert ask(context, kinematics="differential", footprint=wide).status is PlanStatus.NO_PATH


def test_bounds_that_leave_no_way_are_raised_as_little_as_can_be():
    # The wall's gap is at x = 4 to 5 m; above it fixes get worse to the right, at the goal 0.1 m.
    context = room(lambda x, y: np.where(y > 2.5, 0.05 + 0.04 * np.abs(x - 6.5), 0.02))
    least = float(context.r95[context.field.frame.cell_at(HIGH)[0], context.field.frame.cell_at(HIGH)[1]])
    for values in ({"kinematics": "differential"}, {"kinematics": "dubins", "min_turn_radius": 0.4}):
        free = ask(context, **values)
        result = ask(context, max_r95=0.1 * least, **values)
        assert result.status is PlanStatus.RISK_UNMET
        unmet = result.unmet[0]
        assert unmet.bound == "max_r95_m"
        assert unmet.smallest_possible == pytest.approx(unmet.value)
        assert f"Raise max_r95_m to {round_up(unmet.value)}" in unmet.message
        assert 0.1 * least < unmet.value <= free.route.summary.max_r95 + 1e-9
        # With the bound that it names, the question has an answer; with a little less it has none.
        assert (
            ask(context, max_r95=float(round_up(unmet.value)), **values).status is not PlanStatus.RISK_UNMET
        )
        assert ask(context, max_r95=0.9 * unmet.value, **values).status is PlanStatus.RISK_UNMET


def test_minimax_is_the_smallest_worst_r95_then_the_shortest():
    # Two lanes: the straight one is bad in its middle.
    context = room(lambda x, y: np.where((y < 1.6) & (abs(x - 5) < 1.0), 0.3, 0.02))
    ends = {"start": (1.5, 1.2), "goal": (8.5, 1.2)}
    for values in ({"kinematics": "differential"}, {"kinematics": "reeds_shepp", "min_turn_radius": 0.4}):
        shortest = ask(context, objective="shortest", **values, **ends)
        surest = ask(context, objective="minimax", **values, **ends)
        assert surest.status in {PlanStatus.EXACT, PlanStatus.APPROXIMATE}
        assert surest.route.summary.max_r95 < 0.2 < shortest.route.summary.max_r95
        bounded = ask(
            context, objective="shortest", max_r95=surest.route.summary.max_r95 * (1 + 1e-9), **values, **ends
        )
        assert surest.route.summary.length == pytest.approx(bounded.route.summary.length, rel=0.02)
        missed = ask(context, objective="minimax", max_r95=0.001, **values, **ends)
        assert [u.bound for u in missed.unmet] == ["max_r95_m"]


def test_places_without_a_fix_count_as_blind_r95_in_bounds():
    context = room(lambda x, y: np.where(y > 2.5, 0.02, np.where(x > 1.0, np.nan, 0.02)))
    values = {"kinematics": "differential", "blind_r95": 0.5}
    assert ask(context, **values).status in {PlanStatus.EXACT, PlanStatus.APPROXIMATE}
    assert ask(context, max_r95=0.6, **values).status in {PlanStatus.EXACT, PlanStatus.APPROXIMATE}
    closed = ask(context, max_r95=0.4, **values)
    assert closed.status is PlanStatus.RISK_UNMET
    assert "0.5 m" in closed.unmet[0].message


def test_an_outline_stays_out_of_areas():
    area = Polygon([(4.5, 0.2), (5.5, 0.2), (5.5, 1.0), (4.5, 1.0)])
    long = ((-0.7, -0.2), (0.7, -0.2), (0.7, 0.2), (-0.7, 0.2))
    result = ask(room(), (2.0, 1.2), (8.0, 1.2), kinematics="differential", footprint=long, avoid=(area,))
    footprint = Footprint.of(long)
    t = result.route.trajectory
    poses = np.column_stack([t.points, t.heading])
    assert not any(footprint.at(pose).intersects(area) for pose in poses)


def test_a_way_without_fixes_is_told_in_metres():
    context = room(lambda x, y: np.where((y > 2.0) & (y < 3.5), np.nan, 0.02) + 0 * x)
    result = ask(context, kinematics="differential", start_heading=0.0)
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert unmet.bound == "blind"
    assert unmet.value == pytest.approx(result.route.summary.blind)
    assert result.route.summary.longest_blind == pytest.approx(unmet.value)
    assert f"drives {round_up(unmet.value)} m without one, first at (" in unmet.message
    assert "keeps blind" not in unmet.message


HALL = """
    ########################
    #A..B..C..D..E..F..G..H#
    #......................#
    #......................#
    #......................#
    #......................#
    #......................#
    ########################
"""


def test_a_forward_camera_is_told_by_its_heading():
    world = world_from_ascii(HALL)
    sensor = PinholeFixedSensor(1.6, 400.0, 1.0, max_range=9.0)
    headings = build_heading_field(world, sensor, resolution=0.25, headings=16)
    context = PlanningContext(headings)
    result = ask(context, (2.0, 1.2), (9.5, 2.0), weight=4.0, blind_r95=2.0)
    assert result.status in {PlanStatus.EXACT, PlanStatus.APPROXIMATE}
    path = result.route.path
    # What is told is the fix at the pose itself.
    poses = np.column_stack([path.points, path.heading])
    fixes = fixes_at(world, sensor, poses)
    np.testing.assert_array_equal(path.covariance, fixes.covariance)
    np.testing.assert_array_equal(path.triplet, fixes.triplet)
    summary = result.route.summary
    assert summary.blind < summary.length
    share = np.diff(path.s)
    blind = np.isnan(path.r95)
    assert summary.blind == pytest.approx(float(share @ (0.5 * (blind[1:] * 1.0 + blind[:-1]))), abs=0.6)
    assert summary.max_r95 >= np.nanmax(path.r95) - 1e-3


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kinematics": "tank"}, "'reeds_shepp'"),
        ({"kinematics": "dubins"}, "needs a positive one"),
        ({"min_turn_radius": -1.0}, "not negative"),
        ({"start_heading": math.nan}, "start_heading"),
        ({"max_turn_accel": 0.0}, "max_turn_accel"),
        ({"footprint": ((0.0, 0.0), (1.0, 1.0))}, "3 to 100"),
        ({"footprint": ((-1.0, -1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0))}, "simple polygon"),
    ],
)
def test_impossible_robots(values, words):
    with pytest.raises(InvalidProblem, match=words):
        PlanningProblem(LOW, HIGH, 0.2, **values)


def test_an_outline_that_may_not_turn_everywhere_on_its_way_ends_at_the_goal():
    field = build_field(bundled_site("mas97_room"), LASER, resolution=0.25)
    problem = PlanningProblem(
        (2.2, 5.6), (2.4, 10.8), 0.35, footprint=((0.8, 0.4), (0.8, -0.4), (-0.4, -0.4), (-0.4, 0.4)),
        kinematics="differential", deadline=20.0,
    )  # fmt: skip
    result = plan(problem, PlanningContext(field))
    assert result.route.trajectory.points[-1] == pytest.approx([2.4, 10.8], abs=1e-6)
    assert result.route.path.points[-1] == pytest.approx([2.4, 10.8], abs=1e-6)
