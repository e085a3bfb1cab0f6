"""Landmark schedules: exact for their candidates, without flicker, aware of the pan head's speed."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA, Mount
from localization.triplets import best_triplet
from maps.io.site import bundled_site
from planner import landmark_schedule
from planner.errors import InvalidProblem
from planner.kernels import landmark_schedule as kernels
from planner.landmark_schedule import schedule_landmarks, stations_of
from planner.timing import time_polyline
from tests.worlds import world_from_ascii


@pytest.fixture(scope="module")
def warehouse():
    return bundled_site("warehouse")


@pytest.fixture(scope="module")
def drive():
    return time_polyline(
        np.array([[6.2, 18.0], [6.2, 10.0], [30.0, 10.0], [54.0, 10.0]]), max_speed=1.2, max_accel=0.8
    )


@pytest.mark.parametrize(
    "sensor", [LASER, MAS97_CAMERA, replace(FORWARD_CAMERA, field_of_view=1.6, mount=Mount(0.2))]
)
def test_without_inertia_every_station_has_its_best(warehouse, drive, sensor):
    plan = schedule_landmarks(warehouse, sensor, drive, switch_cost=0.0, blind_r95=1e3)
    np.testing.assert_array_equal(plan.r95, plan.best_r95)
    s, _, poses = stations_of(drive)
    found = 0
    for k in range(0, len(s), 17):
        choice = best_triplet(warehouse, sensor, poses[k, :2], heading=float(poses[k, 2]))
        assert (choice is None) == math.isnan(plan.best_r95[k])
        if choice is not None:
            found += 1
            assert plan.best_r95[k] == pytest.approx(choice.r95, rel=1e-6)
    assert found > 5


def test_inertia_brings_fewer_switches_at_little_cost(warehouse, drive):
    nervous, calm, still = (
        schedule_landmarks(warehouse, LASER, drive, switch_cost=cost, blind_r95=10.0)
        for cost in (0.0, 0.02, 0.2)
    )
    assert nervous.n_switches > calm.n_switches > still.n_switches
    lengths = np.gradient(calm.s)
    for plan, switch in ((calm, 0.02), (still, 0.2)):
        spent, least = (np.where(np.isnan(p.r95), 10.0, p.r95) @ lengths for p in (plan, nervous))
        loss = spent - least
        assert -1e-9 <= loss <= switch * (nervous.n_switches - plan.n_switches) + 1e-9


@pytest.fixture(scope="module")
def room():
    """MAS97's room, a curve through it, and what a head of 30 °/s looks at."""
    world = bundled_site("mas97_room")
    line = time_polyline(
        np.array([[5.0, 1.0], [4.7, 3.0], [7.0, 5.5], [10.0, 8.0], [11.8, 11.0], [11.0, 14.0]]),
        max_speed=1.0,
        max_accel=0.8,
    )
    return world, line, schedule_landmarks(world, MAS97_CAMERA, line, pan_rate=math.radians(30))


def pan_at(plan):
    """Times and angles (unwrapped) of the head, without those at which it stands."""
    rows = [point for stretch in plan.stretches for point in stretch.pan]
    t, pan = np.array(rows).T
    return t, np.unwrap(pan)


@pytest.mark.parametrize("rate", [0.15, math.radians(30), 1.5, 6.0])
def test_the_head_never_turns_faster_than_it_can(room, rate):
    world, line, _ = room
    plan = schedule_landmarks(world, MAS97_CAMERA, line, pan_rate=rate)
    t, pan = pan_at(plan)
    seconds, turns = np.diff(t), np.abs(np.diff(pan))
    assert (seconds >= -1e-9).all()
    assert (turns <= rate * np.maximum(seconds, 0) + 1e-6).all()
    assert turns.sum() > 0.3


@pytest.mark.parametrize("sensor", [MAS97_CAMERA, replace(MAS97_CAMERA, pan_min=-2.0, pan_max=2.5)])
def test_stretches_cover_the_path(room, sensor):
    world, line, _ = room
    plan = schedule_landmarks(world, sensor, line, pan_rate=0.6)
    assert plan.stretches[0].start == 0.0
    assert plan.stretches[-1].end == pytest.approx(plan.s[-1])
    assert len(plan.fixes) > 3
    for a, b in itertools.pairwise(plan.stretches):
        assert a.end == pytest.approx(b.start, abs=1e-9)
        assert a.t_end == pytest.approx(b.t_start, abs=1e-9)
        assert (a.kind, a.triplet) != (b.kind, b.triplet)
        assert a.pan_end == pytest.approx(b.pan_start, abs=1e-9), "the head keeps its angle"
    for stretch in plan.stretches:
        assert stretch.t_end > stretch.t_start
        assert (stretch.triplet is None) == (stretch.kind != "fix")
        assert (stretch.max_r95 is None) == (stretch.kind != "fix")
        if stretch.kind == "fix":
            assert 0 < stretch.mean_r95 <= stretch.max_r95
            assert stretch.usable_after >= 0
    if sensor.pan_max < 3:
        angles = pan_at(plan)[1]
        assert (angles >= -2.0 - 1e-9).all()
        assert (angles <= 2.5 + 1e-9).all()


def test_use_ends_when_turning_begins(room):
    plan = room[2]
    turns = 0
    for before, now in itertools.pairwise(plan.fixes):
        between = [x for x in plan.stretches if before.t_end - 1e-9 <= x.t_start < now.t_start - 1e-9]
        turning = [x for x in between if x.kind == "turning"]
        if turning:
            turns += 1
            assert turning[0].t_start == pytest.approx(before.t_end), "before anything is waited for"
        assert before.t_end <= now.turn_from + 1e-6, "it may turn as soon as the last use ends"
        assert now.turn_from <= now.t_start
    assert plan.fixes[0].turn_from is None
    assert turns > 2


def test_figures_are_of_what_is_seen(room):
    world, line, plan = room
    fixes = [x for x in plan.stretches if x.kind == "fix"]
    without = [x for x in plan.stretches if x.kind != "fix"]
    assert plan.blind == pytest.approx(sum(x.end - x.start for x in without))
    assert plan.blind + sum(x.end - x.start for x in fixes) == pytest.approx(plan.s[-1])
    assert plan.blind_seconds == pytest.approx(sum(x.t_end - x.t_start for x in without))
    assert 0 < plan.turning <= plan.blind
    assert 0 < plan.turning_seconds <= plan.blind_seconds
    assert plan.max_r95 == max(x.max_r95 for x in fixes) == np.nanmax(plan.r95)
    assert plan.max_r95 > plan.mean_r95 > np.nanmin(plan.r95)
    assert plan.unavoidable <= plan.blind + 1e-9
    # A head that turns at once sees wherever something can be seen.
    quick = schedule_landmarks(world, MAS97_CAMERA, line)
    assert quick.blind == pytest.approx(quick.unavoidable)
    assert quick.turning == 0.0
    assert quick.unavoidable < plan.blind


def test_it_turns_while_nothing_can_be_seen():
    world = world_from_ascii(
        """
        #########################################
        #...............#########...............#
        A...............#########...............D
        B...............#########...............E
        C...............#########...............F
        #...............#########...............#
        #.......................................#
        #.......................................#
        #########################################
        """.replace("        ", ""),
    )
    line = time_polyline(np.array([[3.0, 0.75], [17.0, 0.75]]), max_speed=1.0, max_accel=1.0)
    camera = replace(MAS97_CAMERA, max_range=7.0)
    quick = schedule_landmarks(world, camera, line)
    blind = [gap for gap in quick.gaps if gap.start > 0.5 and gap.end < 13.5]
    assert len(blind) == 1
    seconds = blind[0].t_end - blind[0].t_start
    first, second = quick.fixes[0], quick.fixes[-1]
    turn = abs(math.remainder(second.pan_start - first.pan_end, 2 * math.pi))
    assert turn > 2.0
    enough = schedule_landmarks(world, camera, line, pan_rate=1.01 * turn / seconds)
    assert enough.blind == pytest.approx(quick.blind, abs=0.05)
    assert [x.kind for x in enough.stretches if x.start > 0.5][:3][-2:] != ["fix", "fix"]
    slow = schedule_landmarks(world, camera, line, pan_rate=0.75 * turn / seconds)
    assert slow.blind > quick.blind + 1.0
    assert slow.fixes[-1].triplet == second.triplet, "it gets there, if later"


def test_a_second_late(room):
    world, line, plan = room
    for now, after in itertools.pairwise(plan.fixes):
        assert now.late_blind is not None
        assert 0 <= now.late_blind <= 1.2 + 1e-9
        slack = after.turn_from - now.t_end
        if slack >= 1.0:
            assert now.late_blind <= 1e-6
        if now.late_r95 is not None:
            assert now.usable_after > 0
    assert plan.fixes[-1].late_blind is None
    laser = schedule_landmarks(world, LASER, line)
    assert all(x.late_blind == 0 for x in laser.fixes[:-1] if x.late_r95 is not None)
    assert any(x.late_r95 for x in laser.fixes)
    assert any(x.late_blind for x in plan.fixes)


def test_a_slow_pan_head_switches_less(warehouse, drive):
    fast = schedule_landmarks(warehouse, MAS97_CAMERA, drive, switch_cost=0.0)
    slow = schedule_landmarks(warehouse, MAS97_CAMERA, drive, switch_cost=0.0, pan_rate=0.2)
    assert slow.n_switches > 0
    assert slow.n_switches < fast.n_switches


def test_dead_reckoning_where_nothing_is_seen():
    world = world_from_ascii(
        """
        ####################
        #A...B.............#
        #..................#
        #C...D.............#
        ####################
        """.replace("        ", "")
    )
    line = time_polyline(np.array([[1.5, 1.25], [9.0, 1.25]]), max_speed=1.0, max_accel=1.0)
    plan = schedule_landmarks(world, replace(LASER, max_range=4.0), line)
    assert plan.stretches[-1].triplet is None
    assert plan.stretches[-1].mean_r95 is None
    assert plan.stretches[0].usable_after == 0.0
    point = schedule_landmarks(
        world, LASER, time_polyline(np.array([[1.5, 1.25]]), max_speed=1.0, max_accel=1.0)
    )
    assert len(point.stretches) == 1


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"switch_cost": -1.0}, "switch_cost"),
        ({"pan_rate": 0.0}, "pan_rate"),
        ({"blind_r95": math.nan}, "blind_r95"),
    ],
)
def test_impossible_numbers(warehouse, drive, values, words):
    with pytest.raises(InvalidProblem, match=words):
        schedule_landmarks(warehouse, LASER, drive, **values)


def test_a_robot_that_drives_backwards_looks_the_other_way(drive):
    forwards = stations_of(drive)[2][:, 2]
    ahead = np.arctan2(drive.velocity[:, 1], drive.velocity[:, 0])
    ahead[[0, -1]] = ahead[[1, -2]]
    backwards = replace(drive, heading=ahead + math.pi)
    turned = stations_of(backwards)[2][:, 2]
    off = np.cos(turned - forwards)
    assert np.median(off) == pytest.approx(-1.0, abs=1e-6)


def test_what_is_warmed_up_is_what_schedules_need(room):
    """The same kinds of arrays: no kernel is compiled anew for a question."""
    landmark_schedule.warm_up()
    used = [
        kernels.best_by_direction,
        kernels.fixes_along,
        kernels.fixes_off_axis,
        kernels.follow,
        kernels.schedule,
        kernels.share_of_halves,
    ]
    if not hasattr(used[0], "signatures"):
        pytest.skip("not compiled")
    before = [len(kernel.signatures) for kernel in used]
    assert min(before) > 0
    schedule_landmarks(room[0], MAS97_CAMERA, room[1], pan_rate=0.5)
    assert [len(kernel.signatures) for kernel in used] == before
