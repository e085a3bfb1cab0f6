"""Exact search over poses: cell, heading, gear. Moves as ``planner.primitives`` makes them.

``first`` (K + 1,): where the moves of each heading begin; ``heads`` (P, 5): heading before and after, rows,
columns, gear; ``extra`` (P,): price beside the way; ``piece_start`` (P + 1,) and ``cells`` (M, 3): row,
column from the first cell and heading of the rates; ``pieces`` (M, 3): length, m, largest and smallest
distance from that cell's centre, m; ``chord_start`` (P + 1,) and ``chords`` (C, 5): both ends from the first
cell's centre in the grid's frame, m, and how far the arc lies beside. ``rates`` (H, ny, nx), ``room``
(ny, nx): clearance of the cells' centres; the rest as in ``planner.kernels.line_cost``.

A state is ``((row · nx + col) · K + heading) · G + gear``, G = 2 with a reverse gear,
which is gear 1, else G = 1.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

from maps.kernels.clearance import segment_distance

# The heuristic is exact where ways cost up to this many times what the best one does without headings.
_BEYOND = 1.12

FOUND = 0
NO_WAY = 1
STOPPED = 2


@njit(cache=True, nogil=True)
def _chords_clear(
    p, row, col, chord_start, chords, transform, need, segments, bucket_start, bucket_items, bucket_gap, grid
):
    """Whether every chord of a move from a cell keeps its clearance."""
    c = transform[2]
    s = transform[3]
    gx = (col + 0.5) * transform[4]
    gy = (row + 0.5) * transform[4]
    for k in range(chord_start[p], chord_start[p + 1]):
        ax = gx + chords[k, 0]
        ay = gy + chords[k, 1]
        bx = gx + chords[k, 2]
        by = gy + chords[k, 3]
        want = need + chords[k, 4]
        kept = segment_distance(
            transform[0] + c * ax - s * ay,
            transform[1] + s * ax + c * ay,
            transform[0] + c * bx - s * by,
            transform[1] + s * bx + c * by,
            want,
            segments,
            bucket_start,
            bucket_items,
            bucket_gap,
            grid,
        )
        if kept < want:
            return False
    return True


@njit(cache=True, nogil=True)
def move_cost(
    p,
    row,
    col,
    limit,
    heads,
    extra,
    piece_start,
    cells,
    pieces,
    chord_start,
    chords,
    rates,
    room,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    grid,
):
    """Cost of move p from a cell; inf where it is not valid or from ``limit`` on.

    Exact clearance is asked only near obstacles.
    """
    n_rows, n_cols = room.shape
    end_row = row + heads[p, 2]
    end_col = col + heads[p, 3]
    if end_row < 0 or end_row >= n_rows or end_col < 0 or end_col >= n_cols:
        return math.inf
    total = extra[p]
    sure = True
    for k in range(piece_start[p], piece_start[p + 1]):
        r = row + cells[k, 0]
        c = col + cells[k, 1]
        if r < 0 or r >= n_rows or c < 0 or c >= n_cols:
            return math.inf
        rate = rates[cells[k, 2], r, c]
        if rate == math.inf:
            return math.inf
        total += rate * pieces[k, 0]
        if total >= limit:
            return math.inf
        kept = room[r, c]
        if kept < need + pieces[k, 1]:
            # The nearest point of the piece has at most the centre's clearance and its distance from it.
            if kept + pieces[k, 2] < need:
                return math.inf
            sure = False
    if not sure and not _chords_clear(
        p,
        row,
        col,
        chord_start,
        chords,
        transform,
        need,
        segments,
        bucket_start,
        bucket_items,
        bucket_gap,
        grid,
    ):
        return math.inf
    return total


@njit(cache=True, nogil=True)
def costs_without_headings(
    seeds,
    seed_costs,
    starts,
    guide,
    bound,
    stop,
    out,
    first,
    heads,
    extra,
    piece_start,
    cells,
    pieces,
    chord_start,
    chords,
    rates,
    room,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    grid,
):
    """Least cost from every cell to the seeds by moves of any heading, into ``out`` (ny, nx).

    ``seeds`` (S,) cells ``row · nx + col`` with costs (S,). ``guide`` (3,): row and column of the start,
    smallest rate. A* until all cells are final through which ways cost at most 1.12 times as much as from the
    first of the cells ``starts`` (T,) that is reached, or ``bound``; the others get a consistent bound: never
    more than the true cost, inf where there is no way. Returns whether another thread did not set ``stop``
    (1,).
    """
    n_cols = room.shape[1]
    n_rows = room.shape[0]
    cost = out.ravel()
    cost[:] = math.inf
    is_start = np.zeros(cost.shape[0], np.bool_)
    for k in range(starts.shape[0]):
        is_start[starts[k]] = True
    settled = np.zeros(cost.shape[0], np.bool_)
    scale = guide[2] * transform[4] * (1.0 - 1e-12)
    # Curves there and back have the same cost where headings do not count: those ahead stand for both.
    one_way = rates.shape[0] == 1
    waiting = [(0.0, 0)]
    waiting.pop()
    for k in range(seeds.shape[0]):
        at = int(seeds[k])
        if seed_costs[k] < cost[at]:
            cost[at] = seed_costs[k]
            ahead = scale * math.hypot(at // n_cols - guide[0], at % n_cols - guide[1])
            heapq.heappush(waiting, (seed_costs[k] + ahead, at))
    limit = bound
    seen_start = False
    reached = math.inf
    while len(waiting) > 0:
        value, at = heapq.heappop(waiting)
        if settled[at]:
            continue
        if value > limit:
            reached = value
            break
        if stop[0] != 0:
            return False
        settled[at] = True
        if is_start[at] and not seen_start:
            seen_start = True
            limit = min(limit, _BEYOND * value)
        so_far = cost[at]
        row = at // n_cols
        col = at - row * n_cols
        for p in range(heads.shape[0]):
            r = row - heads[p, 2]
            c = col - heads[p, 3]
            if r < 0 or r >= n_rows or c < 0 or c >= n_cols or (r == row and c == col):
                continue
            before = r * n_cols + c
            if settled[before] or (one_way and heads[p, 4] < 0):
                continue
            straight = math.hypot(heads[p, 2], heads[p, 3])
            if so_far + scale * straight >= cost[before]:
                continue
            step = move_cost(
                p,
                r,
                c,
                cost[before] - so_far,
                heads,
                extra,
                piece_start,
                cells,
                pieces,
                chord_start,
                chords,
                rates,
                room,
                transform,
                need,
                segments,
                bucket_start,
                bucket_items,
                bucket_gap,
                grid,
            )
            new = so_far + step
            if new < cost[before]:
                cost[before] = new
                heapq.heappush(waiting, (new + scale * math.hypot(r - guide[0], c - guide[1]), before))
    if reached < math.inf:
        for k in range(cost.shape[0]):
            if not settled[k]:
                away = scale * math.hypot(k // n_cols - guide[0], k % n_cols - guide[1])
                cost[k] = max(reached - away, 0.0)
    return True


@njit(cache=True, nogil=True)
def search_poses(
    n_gears,
    gear_price,
    seeds,
    seed_costs,
    goal_keys,
    goal_costs,
    goal_gears,
    bound,
    to_go,
    stop,
    so_far,
    parent,
    first,
    heads,
    extra,
    piece_start,
    cells,
    pieces,
    chord_start,
    chords,
    rates,
    room,
    transform,
    need,
    segments,
    bucket_start,
    bucket_items,
    bucket_gap,
    grid,
):
    """A* from states ``seeds`` (S,) with costs (S,) to the goal, for less than ``bound``.

    ``goal_keys`` (T,), ascending: ``state // n_gears`` from which the goal is reached in one curve at costs
    (T,), beginning in gears (T,): 1, -1, 0 any. ``to_go`` (ny, nx): consistent lower bound. ``so_far``,
    ``parent`` (n_states,) zero, for costs plus 1 (0: not seen, negative: final) and 1 + 2 · move + gear
    before (0: a seed). Returns outcome, cost, last state, states expanded.
    """
    n_cols = room.shape[1]
    n_headings = first.shape[0] - 1
    waiting = [(0.0, 0)]
    waiting.pop()
    for k in range(seeds.shape[0]):
        at = seeds[k]
        cell = at // (n_headings * n_gears)
        ahead = to_go[cell // n_cols, cell % n_cols]
        if ahead < math.inf and (so_far[at] == 0.0 or seed_costs[k] + 1.0 < so_far[at]):
            so_far[at] = seed_costs[k] + 1.0
            heapq.heappush(waiting, (seed_costs[k] + ahead, int(at)))
    best = bound
    last = -1
    expanded = 0
    while len(waiting) > 0:
        value, at = heapq.heappop(waiting)
        if value >= best:
            break
        if so_far[at] < 0.0:
            continue
        if stop[0] != 0:
            return STOPPED, best, last, expanded
        cost = so_far[at] - 1.0
        so_far[at] = -so_far[at]
        expanded += 1
        key = at // n_gears
        gear = at - key * n_gears
        k = np.searchsorted(goal_keys, key)
        while k < goal_keys.shape[0] and goal_keys[k] == key:
            whole = cost + goal_costs[k]
            if n_gears == 2 and goal_gears[k] != 0 and (goal_gears[k] < 0) != (gear == 1):
                whole += gear_price
            if whole < best:
                best = whole
                last = at
            k += 1
        cell = key // n_headings
        heading = key - cell * n_headings
        row = cell // n_cols
        col = cell - row * n_cols
        for p in range(first[heading], first[heading + 1]):
            r = row + heads[p, 2]
            c = col + heads[p, 3]
            if r < 0 or r >= room.shape[0] or c < 0 or c >= n_cols:
                continue
            ahead = to_go[r, c]
            if cost + ahead >= best:
                continue
            next_gear = 1 if n_gears == 2 and heads[p, 4] < 0 else 0
            state = ((r * n_cols + c) * n_headings + heads[p, 1]) * n_gears + next_gear
            known = so_far[state]
            if known < 0.0:
                continue
            # Only a way that is cheaper than those known to the pose, and to the goal, is of use.
            spare = best - ahead - cost
            if known > 0.0:
                spare = min(spare, known - 1.0 - cost)
            new = cost + move_cost(
                p,
                row,
                col,
                spare,
                heads,
                extra,
                piece_start,
                cells,
                pieces,
                chord_start,
                chords,
                rates,
                room,
                transform,
                need,
                segments,
                bucket_start,
                bucket_items,
                bucket_gap,
                grid,
            )
            if next_gear != gear:
                new += gear_price
            if new == math.inf or (known > 0.0 and new + 1.0 >= known):
                continue
            so_far[state] = new + 1.0
            parent[state] = 1 + 2 * p + gear
            heapq.heappush(waiting, (new + ahead, state))
    return (FOUND if best < bound else NO_WAY), best, last, expanded


@njit(cache=True, nogil=True)
def trace(at, n_gears, n_cols, parent, first, heads):
    """Moves (N,) that lead to a state, in order, and the state (seed) from which they begin."""
    n_headings = first.shape[0] - 1
    moves = [0]
    moves.pop()
    while parent[at] > 0:
        p = (parent[at] - 1) // 2
        gear = (parent[at] - 1) % 2
        moves.append(p)
        cell = at // n_gears // n_headings
        row = cell // n_cols - heads[p, 2]
        col = cell % n_cols - heads[p, 3]
        at = ((row * n_cols + col) * n_headings + heads[p, 0]) * n_gears + gear
    out = np.empty(len(moves), np.int64)
    for k in range(len(moves)):
        out[k] = moves[len(moves) - 1 - k]
    return out, at
