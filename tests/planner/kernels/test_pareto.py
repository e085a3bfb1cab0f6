"""Of all cheapest walks the best one, against all of them one by one."""

from __future__ import annotations

import math

import numpy as np

from planner.kernels.cost_to_go import one_to_all, padded_half_costs
from planner.kernels.pareto import least_worst_of_cheapest
from tests.oracles import front_of_worst


def test_against_the_front(rng):
    """The shortest walk's best worst value is that of the front's first point."""
    found = 0
    for _ in range(40):
        passable = rng.random((9, 11)) < 0.8
        values = rng.integers(1, 9, size=passable.shape).astype(float)
        rows, cols = np.nonzero(passable)
        i, j = rng.integers(len(rows), size=2)
        source, target = (int(rows[i]), int(cols[i])), (int(rows[j]), int(cols[j]))
        front = front_of_worst(values, passable, source, target, resolution=1.0)
        half = np.empty(11 * 13)
        smallest = padded_half_costs(np.ones(passable.shape), passable, 1.0, half)
        cost = np.empty(len(half))
        seeds = np.array([(target[0] + 1) * 13 + target[1] + 1])
        stop = np.zeros(1, dtype=np.uint8)
        one_to_all(half, 13, seeds, np.zeros(1), smallest, math.inf, stop, cost)
        at = (source[0] + 1) * 13 + source[1] + 1
        if not front:
            assert cost[at] == math.inf
            continue
        found += 1
        padded = np.full((11, 13), np.inf)
        padded[1:-1, 1:-1] = values
        best = least_worst_of_cheapest(half, 13, cost, padded.ravel(), at, seeds, np.zeros(1))
        assert best == front[0][1]
    assert found > 20
