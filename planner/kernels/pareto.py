"""Of all cheapest walks, the one whose worst cell is best."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_SQRT2 = math.sqrt(2.0)
# Walks that cost this share more are as cheap: equal but for rounding.
_TIE = 1e-12


@njit(cache=True, nogil=True)
def least_worst_of_cheapest(half, width, cost, values, at, seeds, seed_costs):
    """Smallest possible largest value (n,) on a cheapest walk from cell ``at`` to the seeds (S,).

    ``half``, ``width``, ``cost`` (n,), seeds and their costs as in ``planner.kernels.cost_to_go.one_to_all``.
    """
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    number = np.full(cost.shape[0], -1, np.int32)
    cells = np.empty(1024, np.int64)
    cells[0] = at
    number[at] = 0
    count = 1
    done = 0
    # All cells on cheapest walks.
    while done < count:
        u = cells[done]
        done += 1
        for k in range(8):
            v = u + steps[k]
            if half[v] == math.inf or number[v] >= 0 or not cost[v] < cost[u]:
                continue
            edge = half[u] + half[v]
            if k >= 4:
                edge *= _SQRT2
            if cost[v] + edge <= cost[u] * (1.0 + _TIE):
                if count == cells.shape[0]:
                    longer = np.empty(2 * count, np.int64)
                    longer[:count] = cells
                    cells = longer
                number[v] = count
                cells[count] = v
                count += 1
    cells = cells[:count]
    worst = np.full(count, math.inf)
    for k in range(seeds.shape[0]):
        i = number[seeds[k]]
        if i >= 0 and seed_costs[k] <= cost[seeds[k]] * (1.0 + _TIE):
            worst[i] = values[seeds[k]]
    # From the seeds outward: a cell costs more than all that its walks go through.
    for i in np.argsort(cost[cells]):
        u = cells[i]
        for k in range(8):
            v = u + steps[k]
            if half[v] == math.inf or number[v] < 0 or not cost[v] < cost[u]:
                continue
            edge = half[u] + half[v]
            if k >= 4:
                edge *= _SQRT2
            if cost[v] + edge <= cost[u] * (1.0 + _TIE):
                worst[i] = min(worst[i], max(worst[number[v]], values[u]))
    return worst[0]
