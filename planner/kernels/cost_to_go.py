"""Exact searches over the passable cells of a grid: one-to-all costs, walks back, smallest possible bounds.

Grids are flat and padded by one blocked cell on every side: cell (row, col) of (ny, nx) is index
``(row + 1) · (nx + 2) + col + 1``. ``half`` (n,) is half the cost of crossing a cell straight, inf where
blocked; a move costs the sum of its two halves, times √2 on a diagonal, as in
``skimage.graph.MCP_Geometric``.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

_SQRT2 = math.sqrt(2.0)
# Buckets that are open at a time; what lies further waits in one list.
_N_BUCKETS = 8192


@njit(cache=True, nogil=True)
def padded_half_costs(rate, passable, resolution, half):
    """Fill ``half`` ((ny + 2)(nx + 2),) from rate and passable (ny, nx); returns the smallest."""
    ny, nx = rate.shape
    half[:] = math.inf
    smallest = math.inf
    for row in range(ny):
        at = (row + 1) * (nx + 2) + 1
        for col in range(nx):
            if passable[row, col]:
                value = 0.5 * resolution * rate[row, col]
                half[at + col] = value
                smallest = min(smallest, value)
    return smallest


@njit(cache=True, nogil=True)
def one_to_all(half, width, seeds, seed_costs, smallest, limit, stop, cost):
    """Cheapest cost from seeds (S,) with costs (S,) to every cell into ``cost`` (n,), inf where unreached.

    Label setting in buckets of the smallest cost of a move: a cell in the lowest bucket is final. Cells
    dearer than ``limit`` are not finished: their entries are upper bounds, as are all beyond the last
    bucket when another thread sets ``stop`` (1,). ``width``: nx + 2. Returns whether it was not stopped.
    """
    n = half.shape[0]
    cost[:] = math.inf
    bucket = 2.0 * smallest * (1.0 - 1e-9)
    if not bucket < math.inf:
        return True
    scale = 1.0 / bucket
    following = np.full(n, -1, np.int32)
    before = np.full(n, -1, np.int32)
    # Where a cell waits: -1 nowhere, else its bucket; n_buckets is the list of far ones.
    place = np.full(n, -1, np.int32)
    head = np.full(_N_BUCKETS + 1, -1, np.int32)
    settled = np.zeros(n, np.bool_)
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    first = 0.0  # number of the first open bucket
    waiting = 0
    for k in range(seeds.shape[0]):
        at = seeds[k]
        if half[at] == math.inf or seed_costs[k] >= cost[at]:
            continue
        if place[at] == -1:
            place[at] = _N_BUCKETS
            following[at] = head[_N_BUCKETS]
            if head[_N_BUCKETS] >= 0:
                before[head[_N_BUCKETS]] = at
            head[_N_BUCKETS] = at
            waiting += 1
        cost[at] = seed_costs[k]
    current = _N_BUCKETS
    while waiting > 0:
        while current < _N_BUCKETS and head[current] < 0:
            current += 1
        if current == _N_BUCKETS:
            # Open the next buckets, from the cheapest cell that waits.
            lowest = math.inf
            at = head[_N_BUCKETS]
            while at >= 0:
                lowest = min(lowest, cost[at])
                at = following[at]
            first = math.floor(lowest * scale)
            at = head[_N_BUCKETS]
            while at >= 0:
                after = following[at]
                key = math.floor(cost[at] * scale) - first
                if key < _N_BUCKETS:
                    b = before[at]
                    if b >= 0:
                        following[b] = after
                    else:
                        head[_N_BUCKETS] = after
                    if after >= 0:
                        before[after] = b
                    to = int(key)
                    place[at] = to
                    before[at] = -1
                    following[at] = head[to]
                    if head[to] >= 0:
                        before[head[to]] = at
                    head[to] = at
                at = after
            current = 0
            continue
        if (first + current) * bucket > limit:
            break
        if stop[0] != 0:
            return False
        u = head[current]
        head[current] = following[u]
        if head[current] >= 0:
            before[head[current]] = -1
        settled[u] = True
        waiting -= 1
        cost_u = cost[u]
        half_u = half[u]
        for k in range(8):
            v = u + steps[k]
            if settled[v] or half[v] == math.inf:
                continue
            edge = half_u + half[v]
            if k >= 4:
                edge *= _SQRT2
            new = cost_u + edge
            if new >= cost[v]:
                continue
            cost[v] = new
            to = int(min(max(math.floor(new * scale) - first, current), _N_BUCKETS))
            old = place[v]
            if old == to:
                continue
            if old >= 0:
                b = before[v]
                a = following[v]
                if b >= 0:
                    following[b] = a
                else:
                    head[old] = a
                if a >= 0:
                    before[a] = b
            else:
                waiting += 1
            place[v] = to
            before[v] = -1
            following[v] = head[to]
            if head[to] >= 0:
                before[head[to]] = v
            head[to] = v
    return True


@njit(cache=True, nogil=True)
def walk_back(half, width, cost, at, seeds, seed_costs):
    """Cells (K,) from ``at`` down the costs (n,) of ``one_to_all`` to the seed that is cheapest from there.

    Each step goes to the neighbour through which the cell is cheapest; the first in a fixed order wins.
    """
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    cells = np.empty(1024, np.int64)
    n = 0
    while True:
        if n == cells.shape[0]:
            longer = np.empty(2 * n, np.int64)
            longer[:n] = cells
            cells = longer
        cells[n] = at
        n += 1
        best = math.inf
        for k in range(seeds.shape[0]):
            if seeds[k] == at:
                best = min(best, seed_costs[k])
        to = -1
        for k in range(8):
            v = at + steps[k]
            if half[v] == math.inf or not cost[v] < cost[at]:
                continue
            edge = half[at] + half[v]
            if k >= 4:
                edge *= _SQRT2
            if cost[v] + edge < best:
                best = cost[v] + edge
                to = v
        if to < 0:
            return cells[:n].copy()
        at = to


@njit(cache=True, nogil=True)
def smallest_worst(values, width, seeds, seed_values, worst):
    """Smallest possible largest value on a walk from the seeds (S,) to every cell into ``worst`` (n,).

    ``values`` (n,) is what each cell adds, inf where blocked; a seed starts with its own value (S,).
    """
    # Cells not above the level that is flooded wait on a stack, the others, each once, in a heap.
    worst[:] = math.inf
    seen = np.zeros(values.shape[0], np.bool_)
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    heap = [(0.0, np.int64(0))]
    heapq.heappop(heap)
    for k in range(seeds.shape[0]):
        at = seeds[k]
        value = max(seed_values[k], values[at])
        if value < worst[at]:
            worst[at] = value
            heapq.heappush(heap, (value, np.int64(at)))
    stack = np.empty(1024, np.int64)
    while len(heap) > 0:
        level, u = heapq.heappop(heap)
        if seen[u] and worst[u] < level:
            continue
        seen[u] = True
        worst[u] = level
        stack[0] = u
        waiting = 1
        while waiting > 0:
            waiting -= 1
            u = stack[waiting]
            for k in range(8):
                v = u + steps[k]
                if seen[v] or values[v] == math.inf:
                    continue
                if values[v] > level:
                    seen[v] = True
                    worst[v] = values[v]
                    heapq.heappush(heap, (values[v], np.int64(v)))
                    continue
                seen[v] = True
                worst[v] = level
                if waiting == stack.shape[0]:
                    longer = np.empty(2 * waiting, np.int64)
                    longer[:waiting] = stack
                    stack = longer
                stack[waiting] = v
                waiting += 1
