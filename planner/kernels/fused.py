"""A label search over (cell, covariance): ``planner.kernels.belief`` says how a covariance is carried along.

Grids are those of ``cost_to_go``. ``play`` (rad): see ``belief.turned``.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

from planner.kernels.belief import advance, largest_variance, r95_of, turned
from planner.kernels.labels import EXHAUSTED, FOUND, FULL, STOPPED

_SQRT2 = math.sqrt(2.0)
# Rounding of bounds.
_EPS = 1e-9

#: What a search minimises: the cost under bounds, the largest r95 under the others, the factor on all bounds.
BY_COST, BY_R95, BY_EXCESS = range(3)
#: Columns of a label: covariance (0-5), then these.
COST, R95, SCALE, METRES, DRIVEN, DIRECTION, ANCHOR, WORST, MOST, N_COLUMNS = range(6, 16)


@njit(cache=True, nogil=True)
def _grown(array, size):
    """A longer copy (size, n) of an array (m, n) whose rest is not set."""
    out = np.empty((size, array.shape[1]), array.dtype)
    out[: array.shape[0]] = array
    return out


@njit(cache=True, nogil=True)
def fused_labels(
    half,
    blind,
    width,
    length,
    information,
    largest,
    to_go,
    starts,
    first,
    goals,
    noise,
    period,
    weight,
    max_r95,
    max_blind,
    mode,
    ratio,
    arm,
    play,
    max_labels,
    stop,
):
    """Search over (cell, covariance): outcome, cost, worst value, cells (K,), labels (K, 15), labels made.

    ``half``, ``blind``, ``width``, ``length``: as in ``labels``; a move costs the sum of its halves times
    ``1 + weight · r95``, the mean of both ends. ``information`` (n, 6) of one fix per cell, zero without;
    ``largest`` (n,): variance of the position that is allowed there, m²; ``to_go`` (n,): never above what is
    left. ``starts`` (S, 5): cell, cost, length, direction to its centre (NaN: none), metres without a fix;
    ``first`` (8,): covariance, fix driven and heading (NaN: free) at the start. ``goals`` (T, 3): cell, cost
    to the goal, metres without a fix. ``mode``: BY_COST keeps ``max_r95``, ``largest`` and ``max_blind`` (m);
    BY_R95 keeps them and minimises the largest r95; BY_EXCESS the largest ratio to any bound, keeping none.
    Of two labels in a cell the later one is dropped if it is worse in what is minimised and neither its r95
    nor its ``√(λ + arm² θθ)`` is below ``ratio`` of the other's; inf: none is dropped.
    """
    steps = (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1)
    ups = (0.0, 0.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0)
    rights = (1.0, -1.0, 0.0, 0.0, 1.0, -1.0, 1.0, -1.0)
    size = 4096
    data = np.empty((size, N_COLUMNS))
    # Cell, parent, next label of the cell, whether it counts still.
    links = np.empty((size, 4), np.int32)
    head = np.full(half.shape[0], -1, np.int32)
    P = np.empty(6)
    heap = [(0.0, 0.0, np.int64(0))]
    heapq.heappop(heap)
    count = 0
    outcome = EXHAUSTED
    best_worst = math.inf
    best_cost = math.inf
    last = -1
    popped = 0
    label = -1
    waiting_start = 0
    n_starts = starts.shape[0]
    while True:
        if waiting_start < n_starts:
            k_first = waiting_start
            k_end = k_first + 1
            waiting_start += 1
            u = np.int64(starts[k_first, 0])
        else:
            if len(heap) == 0:
                break
            worst_u, f, label = heapq.heappop(heap)
            if worst_u > best_worst or (worst_u == best_worst and f >= best_cost):
                break
            if links[label, 3] == 0:
                continue
            popped += 1
            if popped & 255 == 1 and stop[0] != 0:
                outcome = STOPPED
                break
            if count > max_labels:
                outcome = FULL
                break
            u = np.int64(links[label, 0])
            links[label, 3] = 2
            cost_u = data[label, COST]
            for k in range(goals.shape[0]):
                if np.int64(goals[k, 0]) != u:
                    continue
                metres = data[label, METRES] + goals[k, 2]
                total = cost_u + goals[k, 1] * (1.0 + weight * data[label, R95])
                value = data[label, WORST]
                if mode == BY_EXCESS:
                    value = max(value, metres / max_blind if max_blind > 0.0 else 0.0)
                elif metres > max_blind:
                    continue
                if mode == BY_COST:
                    value = 0.0
                if value < best_worst or (value == best_worst and total < best_cost):
                    best_worst = value
                    best_cost = total
                    last = label
            k_first = 0
            k_end = 8
        for k in range(k_first, k_end):
            if label < 0:
                # From the place itself to the first cell.
                v = u
                if not to_go[v] < math.inf:
                    continue
                P[:] = first[:6]
                d = starts[k, 2]
                direction = starts[k, 3]
                heading = first[7]
                turn, anchor = 0.0, direction
                if d > 0.0 and not math.isnan(heading):
                    turn, anchor = turned(direction, heading, heading, play)
                if d == 0.0:
                    direction = heading
                    anchor = heading
                ux = math.cos(direction) if d > 0.0 else 0.0
                uy = math.sin(direction) if d > 0.0 else 0.0
                r_u = r95_of(P)
                driven = first[6]
                most = r_u
                variance = largest_variance(P)
                if d > 0.0:
                    driven, most, variance = advance(
                        P, ux, uy, d, turn, driven, information[v], information[v], noise, period
                    )
                base = starts[k, 1]
                metres = starts[k, 4]
                leaving = metres
                worst = 0.0
                if mode == BY_R95:
                    worst = r_u
                elif mode == BY_EXCESS:
                    worst = max(r_u / max_r95, math.sqrt(largest_variance(first) / largest[v]))
                before = 0.0
            else:
                v = u + steps[k]
                if half[v] == math.inf or not to_go[v] < math.inf:
                    continue
                factor = _SQRT2 if k >= 4 else 1.0
                metres = data[label, METRES]
                if blind[u] != 0:
                    metres += length * factor
                leaving = metres
                if blind[v] == 0:
                    metres = 0.0
                else:
                    metres += length * factor
                if mode != BY_EXCESS and max(leaving, metres) > max_blind:
                    continue
                base = (half[u] + half[v]) * factor
                before = data[label, COST]
                if mode == BY_COST and not before + base + to_go[v] < best_cost:
                    continue
                P[:] = data[label, :6]
                r_u = data[label, R95]
                ux = rights[k] / factor
                uy = ups[k] / factor
                direction = math.atan2(uy, ux)
                turn, anchor = turned(direction, data[label, DIRECTION], data[label, ANCHOR], play)
                d = 2.0 * length * factor
                driven, most, variance = advance(
                    P, ux, uy, d, turn, data[label, DRIVEN], information[u], information[v], noise, period
                )
                worst = data[label, WORST]
            r = r95_of(P)
            cost = before + base * (1.0 + 0.5 * weight * (r_u + r))
            if mode == BY_EXCESS:
                worst = max(worst, most / max_r95, math.sqrt(variance / largest[v]))
                if max_blind < math.inf:
                    worst = max(worst, leaving / max_blind, metres / max_blind)
            else:
                if most > max_r95 * (1.0 + _EPS) or variance > largest[v] * (1.0 + _EPS):
                    continue
                if mode == BY_R95:
                    worst = max(worst, most)
            if worst > best_worst or (worst == best_worst and not cost + to_go[v] < best_cost):
                continue
            scale = math.sqrt(largest_variance(P) + arm * arm * P[5])
            primary = cost if mode == BY_COST else worst
            at = COST if mode == BY_COST else WORST
            dropped = False
            previous = -1
            other = head[v]
            while other >= 0:
                following = links[other, 2]
                value = data[other, at]
                if (
                    value <= primary
                    and data[other, SCALE] * ratio <= scale
                    and data[other, R95] * ratio <= r
                    and (max_blind == math.inf or data[other, METRES] <= metres)
                ):
                    dropped = True
                    break
                if (
                    primary <= value
                    and scale * max(ratio, 1.0) <= data[other, SCALE]
                    and r * max(ratio, 1.0) <= data[other, R95]
                    and links[other, 3] == 1
                    and (max_blind == math.inf or metres <= data[other, METRES])
                ):
                    links[other, 3] = 0
                    if previous >= 0:
                        links[previous, 2] = following
                    else:
                        head[v] = following
                else:
                    previous = other
                other = following
            if dropped:
                continue
            if count == size:
                size *= 2
                data = _grown(data, size)
                links = _grown(links, size)
            data[count, :6] = P
            data[count, COST] = cost
            data[count, R95] = r
            data[count, SCALE] = scale
            data[count, METRES] = metres
            data[count, DRIVEN] = driven
            data[count, DIRECTION] = direction
            data[count, ANCHOR] = anchor
            data[count, WORST] = worst
            data[count, MOST] = most
            links[count, 0] = v
            links[count, 1] = label
            links[count, 2] = head[v]
            links[count, 3] = 1
            head[v] = count
            heapq.heappush(heap, (worst, cost + to_go[v], np.int64(count)))
            count += 1
    n = 0
    label = last
    while label >= 0:
        n += 1
        label = links[label, 1]
    walked = np.empty(n, np.int64)
    labels = np.empty((n, N_COLUMNS))
    label = last
    for k in range(n - 1, -1, -1):
        walked[k] = links[label, 0]
        labels[k] = data[label]
        label = links[label, 1]
    if outcome == EXHAUSTED and last >= 0:
        outcome = FOUND
    return outcome, best_cost, best_worst, walked, labels, count
