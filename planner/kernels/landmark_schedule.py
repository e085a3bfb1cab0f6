"""Which triplet to look at from station to station: shortest path over (station, triplet), with inertia."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import HEADING, LEVER_X, LEVER_Y, triplet_fix


@njit(cache=True, nogil=True)
def fixes_along(poses, offsets, args, landmarks, survey, seen, triplets, out_covariance, out_sigma, out_pan):
    """Fix of each triplet (C, 3) at each station: poses (K, 3), sensor offsets (K, 2), ``seen`` (K, N).

    ``args`` are the sensor's at heading 0; outputs (K, C, 3), (K, C), (K, C) hold NaN before.
    """
    sensor = args.copy()
    for k in range(poses.shape[0]):
        sensor[HEADING] = args[HEADING] + poses[k, 2]
        sensor[LEVER_X] = -offsets[k, 1]
        sensor[LEVER_Y] = offsets[k, 0]
        x = poses[k, 0] + offsets[k, 0]
        y = poses[k, 1] + offsets[k, 1]
        for c in range(triplets.shape[0]):
            i = triplets[c, 0]
            j = triplets[c, 1]
            m = triplets[c, 2]
            if not (seen[k, i] and seen[k, j] and seen[k, m]):
                continue
            xx, xy, yy, variance, pan = triplet_fix(x, y, i, j, m, landmarks, survey, sensor)
            if math.isnan(xx):
                continue
            out_covariance[k, c, 0] = xx
            out_covariance[k, c, 1] = xy
            out_covariance[k, c, 2] = yy
            out_sigma[k, c] = math.sqrt(variance)
            out_pan[k, c] = pan


@njit(cache=True, nogil=True)
def schedule(cost, pan, lengths, seconds, switch, blind, pan_rate, choice):
    """Cheapest choice (K,) of a triplet per station, C for none; its cost.

    ``cost`` (K, C) per metre, inf where there is no fix; station k stands for ``lengths`` (K,) metres and is
    reached after ``seconds`` (K,) from the one before. A switch costs ``switch`` (m) and, for a pan head of
    ``pan_rate`` (rad/s; inf: at once), what it takes to turn there without a fix, ``blind`` per metre.
    """
    n, m = cost.shape
    total = np.empty(m + 1)
    before = np.empty(m + 1)
    came = np.empty((n, m + 1), dtype=np.int32)
    for c in range(m):
        total[c] = cost[0, c] * lengths[0]
        came[0, c] = -1
    total[m] = blind * lengths[0]
    came[0, m] = -1
    for k in range(1, n):
        before[:] = total
        speed = lengths[k] / seconds[k] if seconds[k] > 0.0 else 0.0
        for c in range(m + 1):
            own = blind if c == m else cost[k, c]
            best = np.inf
            at = -1
            if own < np.inf:
                for a in range(m + 1):
                    if not before[a] < best:
                        continue
                    value = before[a]
                    if a != c:
                        value += switch
                        if c < m and not math.isnan(pan[k, c]):
                            # Where it looked before a blind stretch is not kept: at worst half a turn.
                            turn = math.pi
                            if a < m:
                                turn = abs(pan[k, c] - pan[k - 1, a])
                                turn = min(turn, 2.0 * math.pi - turn)
                            late = max(0.0, turn / pan_rate - seconds[k])
                            value += late * speed * blind
                    if value < best:
                        best = value
                        at = a
            total[c] = best + own * lengths[k] if own < np.inf else np.inf
            came[k, c] = at
    last = 0
    for c in range(m + 1):
        if total[c] < total[last]:
            last = c
    result = total[last]
    for k in range(n - 1, -1, -1):
        choice[k] = last
        last = came[k, last]
    return result
