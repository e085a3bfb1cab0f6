"""Looks at least cost, and heads that follow: against all sequences."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from localization.sensors import MAS97_CAMERA, PinholeFixedSensor, kernel_args
from planner.kernels.landmark_schedule import (
    best_by_direction,
    fixes_along,
    fixes_off_axis,
    follow,
    schedule,
    turn_between,
)
from tests.oracles import cheapest_looks, fix_of_three, nearest_following


def drawn(rng, n, m, *, fixes=0.7):
    """Costs, pan angles and times of n stations."""
    times = np.cumsum(rng.uniform(0.1, 0.3, n))
    middle = times[:-1] + np.diff(times) * rng.uniform(0.2, 0.8, n - 1)
    borders = np.concatenate([times[:1], middle, times[-1:]])
    halves = np.column_stack([times - borders[:-1], borders[1:] - times]) * rng.uniform(0.5, 1.5, (n, 2))
    blind = rng.uniform(0.3, 1.0, n)
    cost = rng.uniform(0.05, 1.0, (n, m)) * blind[:, None]
    cost[rng.random((n, m)) > fixes] = np.inf
    pan = np.where(np.isfinite(cost), rng.uniform(-math.pi, math.pi, (n, m)), np.nan)
    return cost, blind, pan, halves, times, borders


def solved(cost, blind, pan, halves, times, borders, switch, rate, *, is_endless):
    n = len(times)
    station, triplet = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    args = (cost, blind, pan, is_endless, halves, times, borders, switch, rate)
    count, total = schedule(*args, station, triplet)
    return list(zip(station[:count].tolist(), triplet[:count].tolist(), strict=True)), total


@pytest.mark.parametrize("rate", [1.0, 3.0, 8.0, 30.0, math.inf])
@pytest.mark.parametrize("is_endless", [True, False])
def test_the_looks_are_the_cheapest(rng, rate, is_endless):
    seen = set()
    for _ in range(12):
        question = drawn(rng, 6, 2, fixes=rng.uniform(0.4, 1.0))
        switch = float(rng.choice([0.0, 0.01, 0.1]))
        looks, total = solved(*question, switch, rate, is_endless=is_endless)
        assert total == pytest.approx(
            cheapest_looks(*question, switch, rate, is_endless=is_endless), rel=1e-12
        )
        # The cost is that of the looks which are returned.
        only = np.full_like(question[0], np.inf)
        for k, c in looks:
            only[k, c] = question[0][k, c]
        again = cheapest_looks(only, *question[1:], switch, rate, is_endless=is_endless)
        assert total == pytest.approx(again, rel=1e-12)
        seen.add(len(looks))
    assert len(seen) > 1


def test_a_head_keeps_its_angle_through_a_stretch_without_a_fix(rng):
    n = 6
    times = np.arange(n) * 1.0
    borders = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
    halves = np.column_stack([times - borders[:-1], borders[1:] - times])
    cost = np.full((n, 2), np.inf)
    cost[:2, 0] = cost[4:, 1] = 0.1
    pan = np.where(np.isfinite(cost), [0.0, 3.0], np.nan)
    question = (cost, np.full(n, 1.0), pan, halves, times, borders)
    # Three seconds from look to look, two of them without anything to see: 3 rad at 1.5 rad/s cost nothing.
    looks, total = solved(*question, 0.0, 1.5, is_endless=False)
    assert looks == [(0, 0), (1, 0), (4, 1), (5, 1)]
    assert total == pytest.approx(0.1 * 3.0 + 1.0 * 2.0)
    # At 1.2 rad/s half a second more: half of both half cells.
    looks, total = solved(*question, 0.0, 1.2, is_endless=False)
    assert total == pytest.approx(0.1 * 2.5 + 1.0 * 2.5)
    # At 0.9 rad/s there is one station less, and a third of a second more.
    cost[0, 0] = 0.2
    looks, total = solved(*question, 0.0, 0.9, is_endless=False)
    assert looks == [(0, 0), (4, 1), (5, 1)]
    third = 3.0 / 0.9 - 3.0
    assert total == pytest.approx((0.2 + 0.1) * 0.5 * (1 - third) + 0.1 + 3.0 + third)


def test_the_shorter_way_round():
    assert turn_between(3.0, -3.0, True) == pytest.approx(2 * math.pi - 6.0)
    assert turn_between(3.0, -3.0, False) == pytest.approx(6.0)
    assert turn_between(math.nan, 1.0, True) == 0.0


def followed(pan, slack, times, rate, *, is_endless):
    out = np.full((len(pan), 1), np.nan)
    follow(pan[:, None], slack[:, None], is_endless, times, rate, out)
    return out[:, 0]


def test_a_head_follows_within_view_and_rate(rng):
    possible = 0
    for _ in range(60):
        n, step = 6, 0.05
        pan = np.round(np.cumsum(rng.uniform(-0.4, 0.4, n)) / step) * step
        slack = np.round(np.column_stack([-rng.uniform(0, 0.3, n), rng.uniform(0, 0.3, n)]) / step) * step
        times = np.arange(n) * 0.5
        rate = step * (float(rng.integers(1, 6)) + 1e-6) / 0.5
        angle = followed(pan, slack, times, rate, is_endless=False)
        assert (angle >= pan + slack[:, 0] - 1e-9).all()
        assert (angle <= pan + slack[:, 1] + 1e-9).all()
        pieces = int((np.abs(np.diff(angle)) > rate * 0.5 + 1e-9).sum())
        least = nearest_following(pan, slack, np.diff(times), rate, step)
        assert (pieces == 0) == math.isfinite(least)
        if pieces == 0:
            possible += 1
            assert np.abs(angle - pan).sum() >= least - 1e-5
    assert 5 < possible < 55


def test_a_quick_head_looks_at_the_middle(rng):
    pan = np.array([3.0, 3.1, -3.1, -3.0, math.nan, 1.0])
    slack = np.tile([-0.2, 0.2], (6, 1))
    times = np.arange(6.0)
    np.testing.assert_array_equal(followed(pan, slack, times, math.inf, is_endless=True), pan)
    np.testing.assert_allclose(followed(pan, slack, times, 0.11, is_endless=True), pan, atol=1e-12)
    # Slower, it stays behind on the shorter way; after the gap it begins anew.
    slow = followed(pan, slack, times, 0.05, is_endless=True)
    assert np.abs(np.mod(np.diff(slow[:4]) + math.pi, 2 * math.pi) - math.pi).max() <= 0.05 + 1e-12
    assert slow[5] == 1.0


def test_fixes_and_what_a_head_may_be_off(rng):
    landmarks = np.array([[6.0, 1.0], [5.0, -1.0], [4.0, 0.5], [-5.0, 0.0]])
    survey = np.full(4, 0.02)
    poses = np.column_stack([rng.uniform(-0.3, 0.3, (8, 2)), rng.uniform(-3, 3, 8)])
    offsets = np.zeros((8, 2))
    triplets = np.array([[0, 1, 2], [0, 1, 3]])
    seen = np.ones((8, 4), dtype=np.bool_)
    covariance, pan, slack = np.full((8, 2, 3), np.nan), np.full((8, 2), np.nan), np.full((8, 2, 2), np.nan)
    args = kernel_args(MAS97_CAMERA, 0.0)
    fixes_along(poses, offsets, args, landmarks, survey**2, seen, triplets, covariance, pan, slack)
    assert np.isnan(covariance[:, 1]).all()
    share = rng.uniform(0, 1, 8)
    turned = pan.copy()
    turned[:, 0] += slack[:, 0, 0] + share * (slack[:, 0, 1] - slack[:, 0, 0])
    turned[0, 0], turned[1, 0] = pan[0, 0] + slack[0, 0, 0], pan[1, 0] + slack[1, 0, 1]
    fixes_off_axis(poses, offsets, args, landmarks, survey**2, triplets, pan, turned, covariance)
    for k in range(8):
        looking = PinholeFixedSensor(
            MAS97_CAMERA.field_of_view + 1e-9, MAS97_CAMERA.focal_px, MAS97_CAMERA.column_sigma_px
        )
        expected = fix_of_three(poses[k, :2], landmarks[:3], survey[:3], looking, poses[k, 2] + turned[k, 0])
        np.testing.assert_allclose(covariance[k, 0], np.asarray(expected[0])[[0, 0, 1], [0, 1, 1]], rtol=1e-6)
        # A hair further and one of the three is lost.
        for side, sign in ((0, -1), (1, 1)):
            off = np.arctan2(landmarks[:3, 1] - poses[k, 1], landmarks[:3, 0] - poses[k, 0]) - poses[k, 2]
            beyond = off - pan[k, 0] - slack[k, 0, side] - sign * 1e-6
            beyond = np.mod(beyond + math.pi, 2 * math.pi) - math.pi
            assert np.abs(beyond).max() > 0.5 * MAS97_CAMERA.field_of_view


@pytest.mark.parametrize("sensor", [MAS97_CAMERA, replace(MAS97_CAMERA, pan_min=-1.0, pan_max=2.0)])
def test_the_best_of_each_direction(rng, sensor):
    landmarks = rng.uniform(-6, 6, (12, 2))
    survey = np.full(12, 0.02)
    poses = np.column_stack([rng.uniform(-1, 1, (6, 2)), rng.uniform(-3, 3, 6)])
    seen = rng.random((6, 12)) < 0.9
    for most in (12, 9):
        out = np.empty((6, 5, 3), dtype=np.int64)
        args = kernel_args(sensor, 0.0)
        best_by_direction(poses, np.zeros((6, 2)), args, landmarks, survey**2, seen, most, out)
        for k, pose in enumerate(poses):
            inside = sorted(np.flatnonzero(seen[k]), key=lambda i: math.dist(landmarks[i], pose[:2]))[:most]
            least = {}
            for three in itertools.combinations(sorted(inside), 3):
                at = list(three)
                fix = fix_of_three(pose[:2], landmarks[at], survey[at], sensor, pose[2])
                if fix is None:
                    continue
                covariance, _, axis = fix
                sector = int(((axis - pose[2] + math.pi) % (2 * math.pi)) / (2 * math.pi) * 5)
                least[sector] = min(least.get(sector, (math.inf, three)), (np.linalg.det(covariance), three))
            for sector in range(5):
                expected = least[sector][1] if sector in least else (-1, -1, -1)
                assert tuple(out[k, sector]) == tuple(int(i) for i in expected)
        assert (out >= 0).any()


def test_ties_are_for_more_to_see():
    for n, m in itertools.product((1, 3), (1, 2)):
        times = np.arange(float(n))
        borders = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
        halves = np.column_stack([times - borders[:-1], borders[1:] - times])
        pan = np.full((n, m), np.nan)
        question = (np.full((n, m), 1.0), np.full(n, 1.0), pan, halves, times, borders)
        looks, _ = solved(*question, 0.0, math.inf, is_endless=True)
        assert [k for k, _ in looks] == list(range(n))
        assert len({c for _, c in looks}) == 1
