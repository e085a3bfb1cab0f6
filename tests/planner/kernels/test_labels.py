"""The label search over metres without a fix against every label of small random grids."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.kernels.cost_to_go import one_to_all, padded_half_costs
from planner.kernels.labels import EXHAUSTED, FOUND, STOPPED, blind_gaps, least_blind, reach_within
from tests.oracles import cheapest_with_stretches, grid_dijkstra, smallest_stretch

RESOLUTION = 0.5


def random_grid(rng, shape=(6, 7), seen=0.45):
    passable = rng.random(shape) < 0.8
    has_fix = rng.random(shape) < seen
    rate = rng.choice([1.0, 1.5, 3.0], size=shape)
    cells = np.argwhere(passable)
    a, b = rng.choice(len(cells), size=2, replace=False)
    return rate, passable, has_fix, tuple(cells[a].tolist()), tuple(cells[b].tolist())


class Search:
    """The kernels on one grid, between two cells."""

    def __init__(self, rate, passable, has_fix, source, target):
        ny, nx = rate.shape
        self.width = nx + 2
        self.half = np.empty((ny + 2) * (nx + 2))
        self.smallest = padded_half_costs(rate, passable, RESOLUTION, self.half)
        self.blind = np.pad(~has_fix, 1).astype(np.uint8).ravel()
        self.a, self.b = ((row + 1) * self.width + col + 1 for row, col in (source, target))
        n = len(self.half)
        self.gap, self.owner = np.empty(n), np.empty(n, dtype=np.int64)
        ends, owners = np.array([self.a, self.b]), np.array([n, n + 1])
        self.stop = np.zeros(1, dtype=np.uint8)
        assert blind_gaps(
            self.half,
            self.blind,
            self.width,
            0.5 * RESOLUTION,
            ends,
            np.zeros(2),
            owners,
            self.gap,
            self.owner,
            self.stop,
        )

    def smallest_stretch(self, bound=0.0):
        worst = np.empty(len(self.half))
        args = (self.half, self.blind, self.width, 0.5 * RESOLUTION, self.gap, self.owner)
        reach_within(*args, np.array([self.a]), np.zeros(1), bound, worst, self.stop)
        return worst[self.b]

    def cheapest(self, limit, tolerance=0.0):
        to_go = np.empty(len(self.half))
        seeds = np.array([self.b])
        one_to_all(self.half, self.width, seeds, np.zeros(1), self.smallest, math.inf, np.zeros(1), to_go)
        starts, goals = np.array([[self.a, 0.0, 0.0]]), np.array([[self.b, 0.0, 0.0]])
        args = (self.half, self.blind, self.width, 0.5 * RESOLUTION, to_go, self.gap)
        return least_blind(*args, starts, goals, limit + 1e-9, tolerance, self.stop)


def test_costs_are_those_of_every_label():
    rng = np.random.default_rng(1)
    outcomes = {FOUND: 0, EXHAUSTED: 0}
    binding = 0
    for _ in range(60):
        grid = random_grid(rng)
        limit = float(rng.choice([0.5, 1.0, 1.7, 2.5]))
        outcome, cost, cells, metres = Search(*grid).cheapest(limit)
        expected = cheapest_with_stretches(*grid, resolution=RESOLUTION, limit=limit)
        assert cost == pytest.approx(expected, abs=1e-9)
        outcomes[outcome] += 1
        if outcome == FOUND:
            assert metres.max() <= limit + 1e-8
            assert len(cells) == len(metres)
            free = grid_dijkstra(*grid[:2], grid[3], RESOLUTION)[grid[4]]
            binding += cost > free + 1e-9
    assert outcomes[FOUND] > 20
    assert outcomes[EXHAUSTED] > 5
    assert binding > 5


def test_the_smallest_stretch_is_that_of_bisection():
    rng = np.random.default_rng(2)
    beyond = 0
    for _ in range(25):
        grid = random_grid(rng, shape=(5, 6), seen=0.25)
        search = Search(*grid)
        expected = smallest_stretch(*grid, resolution=RESOLUTION)
        assert search.smallest_stretch() == pytest.approx(expected, abs=1e-6)
        assert search.smallest_stretch(1.0) == pytest.approx(max(expected, 1.0), abs=1e-6)
        if expected < math.inf:
            assert search.cheapest(expected + 1e-8)[0] == FOUND
            beyond += expected > 1.0
        if 0.0 < expected < math.inf:
            assert search.cheapest(expected - 1e-3)[0] == EXHAUSTED
    assert beyond > 3


def test_a_tolerance_never_lowers_the_cost():
    rng = np.random.default_rng(3)
    for _ in range(40):
        search = Search(*random_grid(rng))
        exact, near = search.cheapest(1.7)[1], search.cheapest(1.7, 0.1)[1]
        assert near >= exact - 1e-12


def test_a_search_that_is_stopped_says_so():
    shape = (60, 60)
    everywhere = np.ones(shape, dtype=bool)
    has_fix = np.random.default_rng(4).random(shape) < 0.2
    search = Search(np.ones(shape), everywhere, has_fix, (0, 0), (59, 59))
    assert search.cheapest(2.0)[0] == FOUND
    search.stop[0] = 1
    outcome, cost, cells, _ = search.cheapest(2.0)
    assert outcome == STOPPED
    assert cost == math.inf
    assert len(cells) == 0


def test_searches_of_bounds_end_early():
    grid = (np.ones((40, 40)), np.ones((40, 40), bool), np.zeros((40, 40), bool), (0, 0), (39, 39))
    search = Search(*grid)
    args = (search.half, search.blind, search.width, 0.5 * RESOLUTION)
    ends, owners = np.array([search.a, search.b]), np.array([-2, -3])
    stop = np.ones(1, dtype=np.uint8)
    gap, owner, worst = np.empty_like(search.gap), np.empty_like(search.owner), np.empty_like(search.gap)
    assert not blind_gaps(*args, ends, np.zeros(2), owners, gap, owner, stop)
    assert not reach_within(*args, search.gap, search.owner, ends[:1], np.zeros(1), 0.0, worst, stop)
