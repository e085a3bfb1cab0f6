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
from planner.errors import InvalidProblem
from planner.kernels.landmark_schedule import schedule
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


def cheapest(cost, pan, lengths, seconds, switch, blind, rate):
    """Every sequence of triplets, one after the other."""
    n, m = cost.shape
    best = math.inf
    for way in itertools.product(range(m + 1), repeat=n):
        total = 0.0
        for k, c in enumerate(way):
            total += (blind if c == m else cost[k, c]) * lengths[k]
            if k and c != way[k - 1]:
                total += switch
                a = way[k - 1]
                if c < m and not math.isnan(pan[k, c]):
                    turn = abs(math.remainder(pan[k, c] - pan[k - 1, a], 2 * math.pi)) if a < m else math.pi
                    total += max(0.0, turn / rate - seconds[k]) * lengths[k] / seconds[k] * blind
        best = min(best, total)
    return best


def test_the_choice_is_the_cheapest(rng):
    for _ in range(20):
        n, m = 5, 3
        cost = rng.uniform(0.01, 0.5, (n, m))
        cost[rng.random((n, m)) < 0.3] = np.inf
        pan = np.where(np.isfinite(cost), rng.uniform(-3, 3, (n, m)), np.nan)
        lengths, seconds = rng.uniform(0.1, 0.3, n), rng.uniform(0.1, 0.3, n)
        choice = np.empty(n, dtype=np.int64)
        args = (cost, pan, lengths, seconds, 0.01, 0.4, 2.0)
        assert schedule(*args, choice) == pytest.approx(cheapest(*args), rel=1e-12)


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


def test_stretches_cover_the_path(warehouse, drive):
    plan = schedule_landmarks(warehouse, MAS97_CAMERA, drive, pan_rate=1.0)
    assert plan.stretches[0].start == 0.0
    assert plan.stretches[-1].end == pytest.approx(plan.s[-1])
    for a, b in itertools.pairwise(plan.stretches):
        assert a.end == b.start
        assert a.t_end == b.t_start
        assert a.triplet != b.triplet
    fixes = [x for x in plan.stretches if x.triplet is not None]
    assert fixes
    for stretch in fixes:
        assert 0 < stretch.mean_r95 <= stretch.max_r95
        assert -math.pi <= stretch.pan_start < math.pi
        assert stretch.usable_after >= 0
        if stretch.late_r95 is not None:
            assert stretch.usable_after > 0
        if stretch.turn_from is not None:
            assert stretch.turn_from <= stretch.t_start


def test_a_slow_pan_head_switches_less(warehouse, drive):
    fast = schedule_landmarks(warehouse, MAS97_CAMERA, drive, switch_cost=0.0)
    slow = schedule_landmarks(warehouse, MAS97_CAMERA, drive, switch_cost=0.0, pan_rate=0.2)
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
