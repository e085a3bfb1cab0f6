"""The filter along moves, and the search over beliefs, against plain matrices and every walk there is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization import covariance as cov
from localization.kernels.ekf import predict
from localization.motion import OdometryModel
from planner.fused_belief import as_matrices, as_packed
from planner.kernels.belief import advance, fold_in, largest_variance, predict_straight, r95_of, turned
from planner.kernels.cost_to_go import one_to_all, padded_half_costs
from planner.kernels.fused import BY_COST, BY_EXCESS, BY_R95, fused_labels
from planner.kernels.labels import EXHAUSTED, FOUND, FULL, STOPPED
from tests.oracles import belief_after, every_fused_walk

ODOMETRY = OdometryModel(distance_sigma=0.05, turn_sigma=0.06, drift_sigma=0.04, slip_sigma=0.01)
SIGMAS = (0.05, 0.06, 0.04, 0.01)
RESOLUTION = 0.5


def random_covariance(rng, scale=0.1):
    A = rng.normal(size=(3, 3)) * [scale, scale, 0.3 * scale]
    return A.T @ A + 1e-5 * np.eye(3)


def random_information(rng):
    return np.linalg.inv(random_covariance(rng, 0.05))


def test_a_straight_prediction_is_that_of_the_filter(rng):
    for _ in range(20):
        P, heading, d = random_covariance(rng), rng.uniform(-3, 3), rng.uniform(0.1, 2)
        packed = as_packed(P)
        predict_straight(packed, math.cos(heading), math.sin(heading), d, ODOMETRY.kernel_args)
        predict(np.array([0.0, 0.0, heading]), P, d, 0.0, ODOMETRY.kernel_args)
        assert np.allclose(as_matrices(packed), P, rtol=1e-12, atol=1e-15)


def test_fixes_add_their_information(rng):
    for times in (1.0, 2.5, 40.0):
        P, J = random_covariance(rng), random_information(rng)
        packed = as_packed(P)
        fold_in(packed, as_packed(J), times)
        expected = np.linalg.inv(np.linalg.inv(P) + times * J)
        assert np.allclose(as_matrices(packed), expected, rtol=1e-8, atol=1e-14)
        assert largest_variance(packed) == pytest.approx(np.linalg.eigvalsh(expected[:2, :2]).max())
        assert r95_of(packed) == pytest.approx(float(cov.r95(packed[:3])))


def test_a_fix_of_a_certain_belief_changes_nothing(rng):
    packed = np.zeros(6)
    fold_in(packed, as_packed(random_information(rng)), 3.0)
    assert (packed == 0).all()


def test_moves_are_those_of_plain_matrices(rng):
    for _ in range(60):
        P = random_covariance(rng)
        fixes = [None if rng.random() < 0.4 else random_information(rng) for _ in range(2)]
        direction, turn = rng.uniform(-3, 3), float(rng.choice([0.0, 0.8, 2.4]))
        d, driven = rng.uniform(0.05, 1.0), rng.uniform(0.0, 0.2)
        period = float(rng.choice([0.1, 0.2, 0.5]))
        packed = as_packed(P)
        a, b = (np.zeros(6) if J is None else as_packed(J) for J in fixes)
        then, worst, variance = advance(
            packed, math.cos(direction), math.sin(direction), d, turn, driven, a, b, ODOMETRY.kernel_args,
            period,
        )  # fmt: skip
        options = {"fixes": fixes, "sigmas": SIGMAS, "period": period}
        expected, driven_then, r95 = belief_after(P, direction, d, turn, driven, **options)
        assert np.allclose(as_matrices(packed), expected, rtol=1e-7, atol=1e-13)
        assert (then, worst) == pytest.approx((driven_then, r95))
        assert variance >= largest_variance(packed) * (1 - 1e-12)


def test_alternating_directions_are_no_turns_and_a_lone_turn_counts_whole():
    play = math.pi / 8
    total, last, anchor = 0.0, math.nan, 0.0
    for direction in (0.0, math.pi / 4, 0.0, math.pi / 4, 0.0):
        turn, anchor = turned(direction, last, anchor, play)
        total, last = total + turn, direction
    assert total == pytest.approx(math.pi / 4)
    for angle in (math.pi / 4, math.pi / 2, -math.pi / 2, math.pi):
        assert turned(angle, 0.0, 0.0, play)[0] == pytest.approx(abs(angle))
        assert turned(angle, 0.0, 0.0, 0.0)[0] == pytest.approx(abs(angle))
    assert turned(-3 * math.pi / 4, math.pi, math.pi, play)[0] == pytest.approx(math.pi / 4)


class Search:
    """The kernel on one small grid; every corner is driven."""

    def __init__(self, passable, fixes, source, target, P, *, period=0.5):
        ny, nx = passable.shape
        self.width = nx + 2
        self.half = np.empty((ny + 2) * (nx + 2))
        smallest = padded_half_costs(np.ones(passable.shape), passable, RESOLUTION, self.half)
        J = np.zeros((ny + 2, nx + 2, 6))
        for cell, information in fixes.items():
            if information is not None:
                J[cell[0] + 1, cell[1] + 1] = as_packed(information)
        self.J = J.reshape(-1, 6)
        self.blind = (self.J[:, 5] <= 0).astype(np.uint8)
        a, b = ((row + 1) * self.width + col + 1 for row, col in (source, target))
        self.to_go = np.empty(len(self.half))
        no_stop = np.zeros(1, dtype=np.uint8)
        one_to_all(self.half, self.width, np.array([b]), np.zeros(1), smallest, math.inf, no_stop, self.to_go)
        self.starts = np.array([[a, 0.0, 0.0, math.nan, 0.0]])
        self.first = np.array([*as_packed(P), 0.0, math.nan])
        self.goals = np.array([[b, 0.0, 0.0]])
        self.period = period
        self.stop = no_stop

    def run(
        self, *, weight=0.0, max_r95=math.inf, max_blind=math.inf, largest=math.inf, mode=BY_COST, ratio=0.97,
        arm=5.0, max_labels=1_000_000,
    ):  # fmt: skip
        return fused_labels(
            self.half, self.blind, self.width, 0.5 * RESOLUTION, self.J, np.full(len(self.half), largest),
            self.to_go, self.starts, self.first, self.goals, ODOMETRY.kernel_args, self.period, weight,
            max_r95, max_blind, mode, ratio, arm, 0.0, max_labels, self.stop,
        )  # fmt: skip


def random_case(rng, shape=(3, 4)):
    passable = rng.random(shape) < 0.85
    cells = [tuple(int(v) for v in c) for c in np.argwhere(passable)]
    fixes = dict.fromkeys(np.ndindex(shape))
    for cell in cells:
        if rng.random() < 0.3:
            fixes[cell] = random_information(rng)
    a, b = rng.choice(len(cells), size=2, replace=False)
    return passable, fixes, cells[a], cells[b], random_covariance(rng, 0.05)


def test_costs_are_those_of_every_walk():
    rng = np.random.default_rng(5)
    compared = detours = impossible = 0
    for _ in range(60):
        case = random_case(rng)
        weight = float(rng.choice([0.0, 3.0]))
        free = Search(*case).run(weight=weight, mode=BY_R95)
        if free[0] == EXHAUSTED:
            continue
        bound = free[2] * float(rng.choice([0.9, 1.05, 1.1, 1.4]))
        options = {"sigmas": SIGMAS, "period": 0.5, "most": 1500}
        expected = every_fused_walk(*case, resolution=RESOLUTION, weight=weight, max_r95=bound, **options)
        if expected is None:
            continue
        whole = Search(*case).run(weight=weight, max_r95=bound, ratio=math.inf)
        near = Search(*case).run(weight=weight, max_r95=bound)
        assert whole[1] == pytest.approx(expected)
        if expected < math.inf:
            assert whole[0] == FOUND
            assert near[1] >= expected - 1e-9
            assert near[1] <= expected * 1.001
        compared += 1
        impossible += expected == math.inf
        detours += math.inf > expected > Search(*case).run(weight=weight)[1] + 1e-9
    assert compared > 20
    assert impossible > 2
    assert detours > 2


def test_the_smallest_worst_r95_cannot_be_beaten():
    rng = np.random.default_rng(6)
    beaten = 0
    for _ in range(30):
        search = Search(*random_case(rng, (3, 5)))
        outcome, _, worst, cells, _, _ = search.run(mode=BY_R95, ratio=1.0)
        if outcome == EXHAUSTED:
            continue
        assert len(cells) > 0
        assert search.run(max_r95=worst * (1 + 1e-9), ratio=1.0)[0] == FOUND
        beaten += search.run(max_r95=worst * 0.98, ratio=1.0)[0] == FOUND
        # The factor on a bound says the same, and a start above the bound counts.
        bound = 0.5 * worst
        start = r95_of(search.first)
        factor = search.run(mode=BY_EXCESS, max_r95=bound, ratio=1.0)[2]
        assert factor == pytest.approx(max(worst, start) / bound, rel=1e-9)
    # Two numbers do not order covariances: seldom, on fixes as odd as these, the better one is dropped.
    assert beaten <= 2


def test_what_is_stopped_or_full_says_so():
    rng = np.random.default_rng(7)
    passable = np.ones((20, 20), dtype=bool)
    search = Search(passable, dict.fromkeys(np.ndindex(20, 20)), (0, 0), (19, 19), random_covariance(rng))
    assert search.run()[0] == FOUND
    assert search.run(max_labels=5)[0] == FULL
    search.stop[0] = 1
    assert search.run()[0] == STOPPED
