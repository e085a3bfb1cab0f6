"""Label searches over (cell, metres since the last fix) on the padded flat grids of ``cost_to_go``.

A stretch without a fix is measured where it is driven: a move between two cells belongs to each by half.
Cells with ``blind`` (n,) have no fix. ``half`` (n,) is half the cost of crossing a cell, inf where blocked;
``length`` is half the side of a cell, m. In the searches of bounds, ``gap`` (n,) is how far each cell is from
the nearest place that ends a stretch, along blind cells, and ``owner`` (n,) which one that is.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

_SQRT2 = math.sqrt(2.0)
#: Outcomes of a search.
FOUND, EXHAUSTED, STOPPED, FULL = range(4)


@njit(cache=True, nogil=True)
def blind_gaps(half, blind, width, length, seeds, seed_gaps, seed_owners, gap, owner, stop):
    """Fill ``gap`` (n,) and ``owner`` (n,), -1 where nothing is reached, from all cells with a fix.

    Seeds (S,) are further ends: blind cells with their own gaps (S,), m, and owners (S,). A cell with a fix
    owns itself. Returns whether it came to its end before ``stop`` (1,) was set.
    """
    n = half.shape[0]
    gap[:] = math.inf
    owner[:] = -1
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    heap = [(0.0, np.int64(0))]
    heapq.heappop(heap)
    for u in range(n):
        if half[u] < math.inf and blind[u] == 0:
            gap[u] = 0.0
            owner[u] = u
    for u in range(n):
        if half[u] == math.inf or blind[u] == 0:
            continue
        for k in range(8):
            v = u + steps[k]
            if half[v] == math.inf or blind[v] != 0:
                continue
            new = length * (_SQRT2 if k >= 4 else 1.0)
            if new < gap[u]:
                gap[u] = new
                owner[u] = v
    for k in range(seeds.shape[0]):
        u = seeds[k]
        if half[u] < math.inf and seed_gaps[k] < gap[u]:
            gap[u] = seed_gaps[k]
            owner[u] = seed_owners[k]
    for u in range(n):
        if blind[u] != 0 and gap[u] < math.inf:
            heapq.heappush(heap, (gap[u], np.int64(u)))
    popped = 0
    while len(heap) > 0:
        value, u = heapq.heappop(heap)
        popped += 1
        if popped & 1023 == 1 and stop[0] != 0:
            return False
        if value > gap[u]:
            continue
        for k in range(8):
            v = u + steps[k]
            if half[v] == math.inf or blind[v] == 0:
                continue
            new = value + 2.0 * length * (_SQRT2 if k >= 4 else 1.0)
            if new < gap[v]:
                gap[v] = new
                owner[v] = owner[u]
                heapq.heappush(heap, (new, np.int64(v)))
    return True


@njit(cache=True, nogil=True)
def reach_within(half, blind, width, length, gap, owner, seeds, seed_values, bound, worst, stop):
    """Smallest possible longest stretch from seeds (S,) with values (S,) to each cell into ``worst`` (n,), m.

    A move between cells of different owners joins two ends of stretches; its stretch is as long as both gaps
    and the move (Mehlhorn 1988: such moves hold a smallest spanning tree of the ends). Values up to
    ``bound`` are not told apart: where they are enough, ``worst`` is ``bound`` and no order is kept. Returns
    whether it came to its end before ``stop`` (1,) was set.
    """
    worst[:] = math.inf
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    done = np.zeros(half.shape[0], np.bool_)
    stack = np.empty(half.shape[0], np.int64)
    visited = 0
    heap = [(0.0, np.int64(0))]
    heapq.heappop(heap)
    for k in range(seeds.shape[0]):
        value = max(seed_values[k], bound)
        u = seeds[k]
        if value < worst[u]:
            worst[u] = value
            heapq.heappush(heap, (value, np.int64(u)))
    while len(heap) > 0:
        value, u = heapq.heappop(heap)
        if done[u]:
            continue
        # All that is reached without a longer stretch comes at once.
        done[u] = True
        stack[0] = u
        n = 1
        while n > 0:
            n -= 1
            u = stack[n]
            visited += 1
            if visited & 1023 == 1 and stop[0] != 0:
                return False
            own = length if blind[u] != 0 else 0.0
            for k in range(8):
                v = u + steps[k]
                if half[v] == math.inf or done[v]:
                    continue
                new = value
                if owner[u] != owner[v]:
                    between = (own + (length if blind[v] != 0 else 0.0)) * (_SQRT2 if k >= 4 else 1.0)
                    new = max(value, gap[u] + between + gap[v])
                if new < worst[v]:
                    worst[v] = new
                    if new == value:
                        done[v] = True
                        stack[n] = v
                        n += 1
                    else:
                        heapq.heappush(heap, (new, np.int64(v)))
    return True


@njit(cache=True, nogil=True)
def grown(array, size):
    """A longer copy of an array whose rest is not set."""
    out = np.empty(size, array.dtype)
    out[: array.shape[0]] = array
    return out


@njit(cache=True, nogil=True)
def least_blind(
    half,
    blind,
    width,
    length,
    to_go,
    gap,
    starts,
    goals,
    limit,
    tolerance,
    stop,
):
    """Cheapest walk whose stretches without a fix are at most ``limit`` m: outcome, cost, cells, metres (K,).

    A* over labels (cell, metres since the last fix) with the costs to go (n,) of the same grid or one with
    more ways, which never rise by more than a move costs: labels of a cell come in the order of their cost,
    and one is of use only if it has more than ``tolerance`` m fewer metres than all before it. ``starts``
    (S, 3): cell, cost, metres there; ``goals`` (T, 3): cell, cost from there to the goal, metres without a
    fix on that way until it ends or sees one. ``gap``: see ``blind_gaps``.
    """
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    size = 4096
    cells = np.empty(size, np.int32)
    parents = np.empty(size, np.int32)
    costs = np.empty(size)
    metres = np.empty(size)
    count = 0
    # Fewest metres among the labels of a cell that are final, and the label that waits and costs least.
    fewest = np.full(half.shape[0], math.inf)
    waiting = np.full(half.shape[0], -1, np.int32)
    heap = [(0.0, 0.0, np.int64(0))]
    heapq.heappop(heap)
    for k in range(starts.shape[0]):
        u = np.int64(starts[k, 0])
        if starts[k, 2] > limit or not to_go[u] < math.inf:
            continue
        if count == size:
            size *= 2
            cells = grown(cells, size)
            parents = grown(parents, size)
            costs = grown(costs, size)
            metres = grown(metres, size)
        cells[count] = u
        parents[count] = -1
        costs[count] = starts[k, 1]
        metres[count] = starts[k, 2]
        heapq.heappush(heap, (starts[k, 1] + to_go[u], starts[k, 2], np.int64(count)))
        count += 1
    outcome = EXHAUSTED
    last = -1
    best = math.inf
    popped = 0
    while len(heap) > 0:
        f, b, label = heapq.heappop(heap)
        if f >= best:
            break
        popped += 1
        if popped & 255 == 1 and stop[0] != 0:
            outcome = STOPPED
            break
        u = np.int64(cells[label])
        if b > 0.0 and not b + tolerance < fewest[u]:
            continue
        if b == 0.0 and fewest[u] == 0.0:
            continue
        fewest[u] = b
        cost_u = costs[label]
        for k in range(goals.shape[0]):
            if np.int64(goals[k, 0]) == u and b + goals[k, 2] <= limit and cost_u + goals[k, 1] < best:
                best = cost_u + goals[k, 1]
                last = label
        half_u = half[u]
        blind_u = blind[u] != 0
        for k in range(8):
            v = u + steps[k]
            if half[v] == math.inf:
                continue
            factor = _SQRT2 if k >= 4 else 1.0
            b_new = b
            if blind_u:
                b_new += length * factor
                if b_new > limit:
                    continue
            if blind[v] == 0:
                b_new = 0.0
            else:
                b_new += length * factor
                if b_new + gap[v] > limit:
                    continue
            if b_new > 0.0:
                if not b_new + tolerance < fewest[v]:
                    continue
            elif fewest[v] == 0.0:
                continue
            new = cost_u + (half_u + half[v]) * factor
            w = waiting[v]
            if w >= 0 and costs[w] <= new and metres[w] <= b_new:
                continue
            if not new + to_go[v] < best:
                continue
            if count == size:
                size *= 2
                cells = grown(cells, size)
                parents = grown(parents, size)
                costs = grown(costs, size)
                metres = grown(metres, size)
            cells[count] = v
            parents[count] = label
            costs[count] = new
            metres[count] = b_new
            if w < 0 or new < costs[w] or (new == costs[w] and b_new < metres[w]):
                waiting[v] = count
            heapq.heappush(heap, (new + to_go[v], b_new, np.int64(count)))
            count += 1
    if last < 0:
        return outcome, math.inf, np.empty(0, np.int64), np.empty(0)
    n = 0
    label = last
    while label >= 0:
        n += 1
        label = parents[label]
    walked = np.empty(n, np.int64)
    since = np.empty(n)
    label = last
    for k in range(n - 1, -1, -1):
        walked[k] = cells[label]
        since[k] = metres[label]
        label = parents[label]
    return (FOUND if outcome == EXHAUSTED else outcome), best, walked, since
