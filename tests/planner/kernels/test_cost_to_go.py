"""One-to-all search against MCP_Geometric and plain Dijkstra; smallest bounds against flooding."""

from __future__ import annotations

import math

import numpy as np
import pytest
from skimage.graph import MCP_Geometric

from planner.kernels.cost_to_go import one_to_all, padded_half_costs, smallest_worst, walk_back
from tests.oracles import grid_dijkstra, grid_smallest_worst


def frozen(a):
    a.flags.writeable = False
    return a


def case(rng, shape, spread, free=0.75):
    rate = frozen(1.0 + spread * rng.random(shape) ** 4)
    passable = frozen(rng.random(shape) < free)
    rows, cols = np.nonzero(passable)
    k = rng.integers(len(rows))
    return rate, passable, (int(rows[k]), int(cols[k]))


def search(rate, passable, cell, resolution, *, limit=math.inf, stop=0):
    ny, nx = rate.shape
    half = np.empty((ny + 2) * (nx + 2))
    smallest = padded_half_costs(rate, passable, resolution, half)
    seeds = np.array([(cell[0] + 1) * (nx + 2) + cell[1] + 1])
    cost = np.empty_like(half)
    flag = np.array([stop], dtype=np.uint8)
    frozen(half), frozen(seeds)
    zero = frozen(np.zeros(1))
    complete = one_to_all(half, nx + 2, seeds, zero, smallest, limit, flag, cost)
    return half, seeds, cost, complete


@pytest.mark.parametrize("spread", [0.0, 3.0, 1e3, 1e6])
def test_costs_are_those_of_mcp_geometric_and_of_plain_dijkstra(rng, spread):
    for shape in ((1, 1), (1, 17), (23, 1), (21, 30), (35, 24)):
        rate, passable, cell = case(rng, shape, spread)
        _, _, cost, complete = search(rate, passable, cell, 0.05)
        assert complete
        ours = cost.reshape(shape[0] + 2, shape[1] + 2)[1:-1, 1:-1]
        twin = np.full(shape, np.inf)
        for at, value in grid_dijkstra(rate, passable, cell, 0.05).items():
            twin[at] = value
        np.testing.assert_allclose(ours, twin, rtol=1e-12)
        theirs, _ = MCP_Geometric(np.where(passable, 0.05 * rate, -1.0)).find_costs([cell])
        np.testing.assert_allclose(ours[passable], theirs[passable], rtol=1e-9)


def test_the_walk_back_costs_what_it_says(rng):
    rate, passable, cell = case(rng, (30, 30), 5.0)
    half, seeds, cost, _ = search(rate, passable, cell, 0.1)
    reached = np.flatnonzero(np.isfinite(cost))
    for at in rng.choice(reached, 20):
        cells = walk_back(half, 32, frozen(cost), int(at), seeds, np.zeros(1))
        assert cells[0] == at
        assert cells[-1] == seeds[0]
        rows, cols = np.divmod(cells, 32)
        dr, dc = np.abs(np.diff(rows)), np.abs(np.diff(cols))
        assert max(dr.max(initial=0), dc.max(initial=0)) <= 1
        total = (np.hypot(dr, dc) * (half[cells[:-1]] + half[cells[1:]])).sum()
        assert total == pytest.approx(cost[at], rel=1e-12)


def test_seeds_may_have_costs_and_blocked_ones_do_not_count():
    rate, passable = frozen(np.ones((1, 9))), frozen(np.arange(9) != 4).reshape(1, 9)
    half = np.empty(3 * 11)
    smallest = padded_half_costs(rate, passable, 1.0, half)
    cost = np.empty_like(half)
    seeds, costs = np.array([12, 15, 16, 15]), np.array([5.0, 1.5, 0.0, 0.5])
    one_to_all(half, 11, seeds, costs, smallest, math.inf, np.zeros(1, np.uint8), cost)
    np.testing.assert_allclose(cost[12:21], [3.5, 2.5, 1.5, 0.5, *[np.inf] * 5])
    assert list(walk_back(half, 11, cost, 12, seeds, costs)) == [12, 13, 14, 15]


def test_a_limit_leaves_dear_cells_unfinished_and_a_stop_ends_it(rng):
    rate, passable, cell = case(rng, (40, 40), 3.0, free=0.95)
    _, _, full, _ = search(rate, passable, cell, 0.1)
    limit = float(np.median(full[np.isfinite(full)]))
    _, _, part, complete = search(rate, passable, cell, 0.1, limit=limit)
    assert complete
    cheap = full <= limit
    np.testing.assert_array_equal(part[cheap], full[cheap])
    assert (part[~cheap] >= full[~cheap]).all()
    assert np.isinf(part[np.isfinite(full)]).any()
    _, _, nothing, complete = search(rate, passable, cell, 0.1, stop=1)
    assert not complete
    assert np.isfinite(nothing).sum() == 1


def test_no_passable_cell():
    _, _, cost, complete = search(frozen(np.ones((3, 3))), frozen(np.zeros((3, 3), dtype=bool)), (1, 1), 0.1)
    assert complete
    assert np.isinf(cost).all()


def test_smallest_worst_is_where_flooding_first_arrives(rng):
    for _ in range(10):
        values = rng.random((9, 11)).round(2)
        passable = rng.random((9, 11)) < 0.75
        rows, cols = np.nonzero(passable)
        (i, j) = rng.integers(len(rows), size=2)
        source, target = (rows[i], cols[i]), (rows[j], cols[j])
        flat = np.full((11, 13), np.inf)
        flat[1:-1, 1:-1] = np.where(passable, values, np.inf)
        worst = np.empty(flat.size)
        seed = np.array([(source[0] + 1) * 13 + source[1] + 1])
        smallest_worst(flat.ravel(), 13, seed, np.zeros(1), worst)
        got = worst[(target[0] + 1) * 13 + target[1] + 1]
        assert got == grid_smallest_worst(values, passable, source, target)
