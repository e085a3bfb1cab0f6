"""Exact search between places: A* in buckets with octile and differential heuristics, cells to a cost limit.

Grids as in ``planner.kernels.cost_to_go``: flat, padded by one blocked cell, ``half`` (n,) half the cost of
crossing a cell, ``width`` its columns with padding. Work arrays of (n,) come back as they were taken:
``cost`` inf, ``least`` NaN, ``state`` 0 everywhere; ``clear`` does that for the cells that a search touched.

A differential heuristic [GH05] bounds what a cell costs to a place from what both cost to a pivot:
``table`` (n, K) holds ``floor(cost to pivot k / units[k])``, ``UNREACHED`` where there is no way.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_SQRT2 = math.sqrt(2.0)
_N_LAYERS = 2048
_N_SLOTS = 8192
_GROUP = 32
UNREACHED = 65535
# Bounds are lowered by this share, so that rounding never makes one too high.
_LOWER = 1.0 - 1e-6
_WAITS = 1
_IS_END = 2


@njit(cache=True, nogil=True)
def quantised(cost, unit, pivot, table):
    """Column ``pivot`` of a table (n, K) from costs (n,): the largest multiple of ``unit`` not above."""
    for i in range(cost.shape[0]):
        table[i, pivot] = UNREACHED if cost[i] == math.inf else int(cost[i] / unit)


@njit(cache=True, nogil=True)
def spans_of_ends(ends, table, units, low, high):
    """Smallest and largest entries of ends (E,) in a table (n, K) into ``low``, ``high`` (K,)."""
    for k in range(units.shape[0]):
        low[k] = UNREACHED
        high[k] = 0
        for e in ends:
            low[k] = min(low[k], table[e, k])
            high[k] = max(high[k], table[e, k])


@njit(cache=True, nogil=True)
def _pivot_bound(v, table, chosen, units, low, high):
    """What cell v costs at least to the ends, by the pivots chosen (C,); inf where there is no way."""
    bound = 0.0
    for i in range(chosen.shape[0]):
        k = chosen[i]
        entry = int(table[v, k])
        if entry == UNREACHED:
            return math.inf
        steps = max(entry - int(high[k]), int(low[k]) - entry) - 1
        bound = max(bound, steps * units[k])
    return bound


@njit(cache=True, nogil=True)
def best_pivots(seed, count, table, units, low, high):
    """The ``count`` pivots (C,) that bound the way from ``seed`` best, of those that reach the ends."""
    n = units.shape[0]
    bounds = np.empty(n)
    one = np.empty(1, np.int64)
    usable = 0
    for k in range(n):
        one[0] = k
        bounds[k] = -1.0
        if high[k] < UNREACHED:
            bounds[k] = _pivot_bound(seed, table, one, units, low, high)
            usable += 1
    chosen = np.empty(min(count, usable), np.int64)
    for i in range(chosen.shape[0]):
        chosen[i] = np.argmax(bounds)
        bounds[chosen[i]] = -2.0
    return chosen


@njit(cache=True, nogil=True)
def _longer(array):
    """The array with twice the room."""
    out = np.empty(2 * array.shape[0], array.dtype)
    out[: array.shape[0]] = array
    return out


@njit(cache=True, nogil=True)
def search(
    half,
    width,
    seeds,
    seed_costs,
    ends,
    end_costs,
    smallest,
    table,
    chosen,
    units,
    low,
    high,
    limit,
    slack,
    stop,
    cost,
    least,
    state,
):
    """Costs from seeds (S,) with costs (S,) towards ends (E,) with costs (E,).

    Every cell with ``cost + bound to the ends ≤ limit`` gets its exact cost; the limit falls to ``slack``
    times the cheapest way to an end. A cost is an upper bound elsewhere, or inf. ``smallest``: of half.

    Cells wait in layers of cost plus bound, those of the lowest layer in slots of cost. A layer is taken
    from its lowest slot upwards, so that a cell is expanded again only where a bound falls by more than a
    move costs. Returns the touched cells (T,) and whether it was not stopped.
    """
    scale = 1.0 / (2.0 * smallest * _LOWER)
    per_layer = 2.0 * scale
    straight = 2.0 * smallest * _LOWER
    diagonal = (_SQRT2 - 1.0) * straight
    per_width = 1.0 / width
    n_chosen = chosen.shape[0]
    which = chosen.astype(np.int32)
    highest = high[chosen]
    lowest_end = low[chosen]
    unit = units[chosen]
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    touched = np.empty(4096, np.int32)
    n_touched = 0
    r0 = c0 = 1 << 40
    r1 = c1 = -1
    for e in ends:
        state[e] |= _IS_END
        r0 = min(r0, e // width)
        r1 = max(r1, e // width)
        c0 = min(c0, e % width)
        c1 = max(c1, e % width)
    cells = np.empty(4096, np.int32)
    after = np.empty(4096, np.int32)
    n_nodes = 0
    spare = -1
    # Lists: layers first, then those beyond the last layer, then the slots of the lowest layer.
    far = _N_LAYERS
    slots = _N_LAYERS + 1
    head = np.full(slots + _N_SLOTS, -1, np.int32)
    tail = np.full(slots + _N_SLOTS, -1, np.int32)
    # How many wait in groups of slots, so that empty ones are passed at once.
    crowd = np.zeros((slots + _N_SLOTS) // _GROUP + 1, np.int32)
    n_waiting = 0
    n_here = 0
    first = 0  # number of layer 0
    layer = far  # the lowest layer
    slot = slots
    complete = True
    # The seeds are handled as neighbours of a cell before all others.
    u = -1
    cost_u = 0.0
    half_u = 0.0
    n_next = seeds.shape[0]
    while True:
        for k in range(n_next):
            if u < 0:
                v = seeds[k]
                old = cost[v]
                new = seed_costs[k] if half[v] < math.inf else math.inf
                for i in range(n_chosen):
                    if table[v, which[i]] == UNREACHED:
                        new = math.inf  # and none of the ends is reached
            else:
                v = u + steps[k]
                old = cost[v]
                if old <= cost_u:
                    continue
                edge = half_u + half[v]
                new = cost_u + (edge * _SQRT2 if k >= 4 else edge)
            if new >= old:
                continue
            bound = least[v]
            if math.isnan(bound):
                row = int((v + 0.5) * per_width)
                col = v - row * width
                dr = max(r0 - row, row - r1, 0)
                dc = max(c0 - col, col - c1, 0)
                value = max(dr, dc) * straight + min(dr, dc) * diagonal
                # As in _pivot_bound, too slow to call here; seeds that pivots do not reach are left out.
                for i in range(n_chosen):
                    entry = int(table[v, which[i]])
                    value = max(value, (max(entry - highest[i], lowest_end[i] - entry) - 1) * unit[i])
                bound = np.float32(value * _LOWER)
                least[v] = bound
                if n_touched == touched.shape[0]:
                    touched = _longer(touched)
                touched[n_touched] = v
                n_touched += 1
            total = new + bound
            if total > limit:
                continue
            cost[v] = new
            if state[v] & _IS_END:
                for e in range(ends.shape[0]):
                    if ends[e] == v:
                        limit = min(limit, (new + end_costs[e]) * slack)
            to = far
            if layer < far:
                to = min(max(int(total * per_layer) - first, layer), far)
            if to == layer and layer < far:
                to = slots + min(int(new * scale), _N_SLOTS - 1)
                # Bounds that fall lead back.
                slot = min(slot, to)
                crowd[to // _GROUP] += 1
                n_here += 1
            elif state[v] & _WAITS and (
                layer == far or to == min(max(int((old + bound) * per_layer) - first, layer), far)
            ):
                continue  # waits there already
            state[v] |= _WAITS
            if spare >= 0:
                at = spare
                spare = after[at]
            else:
                if n_nodes == cells.shape[0]:
                    cells = _longer(cells)
                    after = _longer(after)
                at = n_nodes
                n_nodes += 1
            cells[at] = v
            after[at] = -1
            if head[to] < 0:
                head[to] = at
            else:
                after[tail[to]] = at
            tail[to] = at
            n_waiting += 1
        u = -1
        while n_waiting > 0:
            if n_here > 0:
                while head[slot] < 0:
                    slot += 1
                    while crowd[slot // _GROUP] == 0:
                        slot = (slot // _GROUP + 1) * _GROUP
                at = head[slot]
                head[slot] = after[at]
                after[at] = spare
                spare = at
                n_waiting -= 1
                n_here -= 1
                crowd[slot // _GROUP] -= 1
                v = cells[at]
                if state[v] & _WAITS:
                    state[v] &= ~_WAITS
                    if cost[v] + least[v] <= limit:
                        u = v
                        break
                continue
            while layer < far and head[layer] < 0:
                layer += 1
            source = layer
            if layer == far:
                # The next layers, from the cheapest cell that waits.
                lowest = math.inf
                at = head[far]
                while at >= 0:
                    lowest = min(lowest, cost[cells[at]] + least[cells[at]])
                    at = after[at]
                first = int(lowest * per_layer)
                layer = 0
            if (first + layer) > limit * per_layer:
                break
            slot = slots + _N_SLOTS
            at = head[source]
            head[source] = -1
            while at >= 0:
                following = after[at]
                v = cells[at]
                to = min(max(int((cost[v] + least[v]) * per_layer) - first, layer), far)
                if to == layer:
                    to = slots + min(int(cost[v] * scale), _N_SLOTS - 1)
                    slot = min(slot, to)
                    crowd[to // _GROUP] += 1
                    n_here += 1
                after[at] = -1
                if head[to] < 0:
                    head[to] = at
                else:
                    after[tail[to]] = at
                tail[to] = at
                at = following
        if u < 0:
            break
        if stop[0] != 0:
            complete = False
            break
        cost_u = cost[u]
        half_u = half[u]
        n_next = 8
    for e in ends:
        state[e] = 0
    return touched[:n_touched].copy(), complete


@njit(cache=True, nogil=True)
def search_back(half, width, seeds, seed_costs, to_go, limit, smallest, stop, cost, state):
    """Cells (T,) through which a path of at most ``limit`` leads, and whether the search was not stopped.

    ``cost`` (n,) gets the exact cost from the seeds (S,) to them; ``to_go`` (n,) is the exact cost from
    each cell to the other end, inf or too high only where no such path leads.
    """
    scale = 1.0 / (2.0 * smallest)
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    n_buckets = max(1, int(limit * scale) + 2) if limit < math.inf else 0
    found = np.empty(4096, np.int32)
    n_found = 0
    lowest = math.inf
    for k in range(seeds.shape[0]):
        lowest = min(lowest, seed_costs[k] + to_go[seeds[k]])
    if n_buckets == 0 or not lowest <= limit:
        return found[:0].copy(), True
    n_buckets = int((limit - lowest) * scale) + 2
    head = np.full(n_buckets, -1, np.int32)
    tail = np.full(n_buckets, -1, np.int32)
    cells = np.empty(4096, np.int32)
    after = np.empty(4096, np.int32)
    n_cells = 0
    current = 0
    u = -1
    cost_u = 0.0
    half_u = 0.0
    n_next = seeds.shape[0]
    complete = True
    while True:
        for k in range(n_next):
            if u < 0:
                v = seeds[k]
                new = seed_costs[k] if half[v] < math.inf else math.inf
            else:
                v = u + steps[k]
                edge = half_u + half[v]
                new = cost_u + (edge * _SQRT2 if k >= 4 else edge)
            if new >= cost[v]:
                continue
            total = new + to_go[v]
            if not total <= limit:
                continue
            if cost[v] == math.inf:
                if n_found == found.shape[0]:
                    longer = np.empty(2 * n_found, np.int32)
                    longer[:n_found] = found
                    found = longer
                found[n_found] = v
                n_found += 1
            cost[v] = new
            state[v] = _WAITS
            to = max(int((total - lowest) * scale), current)
            if n_cells == cells.shape[0]:
                longer = np.empty(2 * n_cells, np.int32)
                longer[:n_cells] = cells
                cells = longer
                longer = np.empty(2 * n_cells, np.int32)
                longer[:n_cells] = after
                after = longer
            cells[n_cells] = v
            after[n_cells] = -1
            if head[to] < 0:
                head[to] = n_cells
            else:
                after[tail[to]] = n_cells
            tail[to] = n_cells
            n_cells += 1
        u = -1
        while current < n_buckets:
            at = head[current]
            if at < 0:
                current += 1
                continue
            head[current] = after[at]
            v = cells[at]
            if state[v] & _WAITS:
                state[v] = 0
                u = v
                break
        if u < 0:
            break
        if stop[0] != 0:
            complete = False
            break
        cost_u = cost[u]
        half_u = half[u]
        n_next = 8
    return found[:n_found].copy(), complete


@njit(cache=True, nogil=True)
def clear(touched, cost, least, state):
    """Make the work arrays (n,) of a search as they were before it touched the cells (T,)."""
    for v in touched:
        cost[v] = math.inf
        least[v] = math.nan
        state[v] = 0
