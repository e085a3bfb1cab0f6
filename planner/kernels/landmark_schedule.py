"""Which triplet to look at when: shortest path over looks (station, triplet), with inertia."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import (
    FIXED,
    HEADING,
    LEVER_X,
    LEVER_Y,
    MODE,
    PAN_MAX,
    PAN_MIN,
    VIEW,
    triplet_fix,
    wrapped,
)

# Times are sums: a turn that just fits must not fail by rounding.
_ROUNDING = 1e-9
# rad
_ON_EDGE = 1e-9


@njit(cache=True, nogil=True)
def fixes_along(poses, offsets, args, landmarks, survey, seen, triplets, out_covariance, out_pan, out_slack):
    """Fix of each triplet (C, 3) at each station: poses (K, 3), sensor offsets (K, 2), ``seen`` (K, N).

    ``args`` are the sensor's at heading 0. Outputs hold NaN before: (K, C, 3), (K, C) and, how far a pan head
    may look to the right (negative) and left of that angle so that all three stay in view, (K, C, 2).
    """
    sensor = args.copy()
    for k in range(poses.shape[0]):
        x, y = _stand(poses[k], offsets[k], args, sensor)
        for c in range(triplets.shape[0]):
            i = triplets[c, 0]
            j = triplets[c, 1]
            m = triplets[c, 2]
            if not (seen[k, i] and seen[k, j] and seen[k, m]):
                continue
            xx, xy, yy, _, pan = triplet_fix(x, y, i, j, m, landmarks, survey, sensor)
            if math.isnan(xx):
                continue
            out_covariance[k, c, 0] = xx
            out_covariance[k, c, 1] = xy
            out_covariance[k, c, 2] = yy
            out_pan[k, c] = pan
            if math.isnan(pan):
                continue
            right = 0.0
            left = 0.0
            for n in triplets[c]:
                azimuth = math.atan2(landmarks[n, 1] - y, landmarks[n, 0] - x)
                off = wrapped(azimuth - sensor[HEADING] - pan)
                right = min(right, off)
                left = max(left, off)
            half = 0.5 * sensor[VIEW]
            low = left - half
            high = right + half
            if sensor[PAN_MAX] - sensor[PAN_MIN] < 2.0 * math.pi - 1e-9:
                low = max(low, sensor[PAN_MIN] - pan)
                high = min(high, sensor[PAN_MAX] - pan)
            out_slack[k, c, 0] = min(0.0, low)
            out_slack[k, c, 1] = max(0.0, high)


@njit(cache=True, nogil=True)
def _stand(pose, offset, args, sensor):
    """Sets the numbers of a sensor for a pose (3,) with the sensor's offset (2,) in W; returns its place."""
    sensor[HEADING] = args[HEADING] + pose[2]
    sensor[LEVER_X] = -offset[1]
    sensor[LEVER_Y] = offset[0]
    return pose[0] + offset[0], pose[1] + offset[1]


@njit(cache=True, nogil=True)
def best_by_direction(poses, offsets, args, landmarks, survey, seen, most, out):
    """Triplet of the smallest ellipse for each sector of the pan angle, (K, S, 3), -1 for none.

    The S sectors share a full turn from -π on. Of the landmarks that are ``seen`` (K, N) from a station only
    the nearest ``most`` count.
    """
    sensor = args.copy()
    n_sectors = out.shape[1]
    near = np.empty(landmarks.shape[0], dtype=np.int64)
    distance = np.empty(landmarks.shape[0])
    least = np.empty(n_sectors)
    out[:] = -1
    for k in range(poses.shape[0]):
        x, y = _stand(poses[k], offsets[k], args, sensor)
        n = 0
        for i in range(landmarks.shape[0]):
            if seen[k, i]:
                near[n] = i
                distance[n] = math.hypot(landmarks[i, 0] - x, landmarks[i, 1] - y)
                n += 1
        if n > most:
            near[:most] = np.sort(near[np.argsort(distance[:n])[:most]])
            n = most
        least[:] = np.inf
        for a in range(n):
            for b in range(a + 1, n):
                for c in range(b + 1, n):
                    fix = triplet_fix(x, y, near[a], near[b], near[c], landmarks, survey, sensor)
                    if math.isnan(fix[0]) or math.isnan(fix[4]):
                        continue
                    sector = int((fix[4] + math.pi) / (2.0 * math.pi) * n_sectors) % n_sectors
                    size = fix[0] * fix[2] - fix[1] * fix[1]
                    if size < least[sector]:
                        least[sector] = size
                        out[k, sector, 0] = near[a]
                        out[k, sector, 1] = near[b]
                        out[k, sector, 2] = near[c]


@njit(cache=True, nogil=True)
def fixes_off_axis(poses, offsets, args, landmarks, survey, triplets, own, pan, covariance):
    """``covariance`` (K, C, 3) where the head looks at ``pan`` (K, C) and not at its ``own`` angle, rad."""
    sensor = args.copy()
    sensor[MODE] = FIXED
    # What lies on the edge of the view is in view.
    sensor[VIEW] = args[VIEW] + _ON_EDGE
    for k in range(poses.shape[0]):
        x, y = _stand(poses[k], offsets[k], args, sensor)
        heading = sensor[HEADING]
        for c in range(triplets.shape[0]):
            if math.isnan(pan[k, c]) or pan[k, c] == own[k, c]:
                continue
            sensor[HEADING] = heading + pan[k, c]
            i = triplets[c, 0]
            xx, xy, yy, _, _ = triplet_fix(x, y, i, triplets[c, 1], triplets[c, 2], landmarks, survey, sensor)
            covariance[k, c, 0] = xx
            covariance[k, c, 1] = xy
            covariance[k, c, 2] = yy


@njit(cache=True, nogil=True)
def follow(pan, slack, is_endless, times, pan_rate, out):
    """Where a head of ``pan_rate`` (rad/s) looks to follow each triplet, as near ``pan`` (K, C) as it can.

    ``slack`` (K, C, 2) is how far to the right (negative) and left the three stay in view; ``out`` (K, C) is
    ``pan`` plus what the head is ahead or behind. From one station to the next it turns no faster than the
    rate, unless even that does not keep them in view: then a new piece begins there.
    """
    n = pan.shape[0]
    centre = np.empty(n)
    low = np.empty(n)
    high = np.empty(n)
    reach = np.empty(n)
    for c in range(pan.shape[1]):
        first = 0
        while first < n:
            if math.isnan(pan[first, c]):
                first += 1
                continue
            # Forwards: which angles can be reached from anywhere in the window of the first station.
            centre[first] = pan[first, c]
            low[first] = centre[first] + slack[first, c, 0]
            high[first] = centre[first] + slack[first, c, 1]
            last = first
            while last + 1 < n and not math.isnan(pan[last + 1, c]):
                k = last + 1
                turn = pan[k, c] - pan[last, c]
                centre[k] = centre[last] + (wrapped(turn) if is_endless else turn)
                reach[k] = pan_rate * (times[k] - times[last]) if pan_rate < np.inf else np.inf
                low[k] = max(centre[k] + slack[k, c, 0], low[last] - reach[k])
                high[k] = min(centre[k] + slack[k, c, 1], high[last] + reach[k])
                if low[k] > high[k]:
                    break
                last = k
            # Backwards: from which of them one gets on to the end.
            for k in range(last - 1, first - 1, -1):
                low[k] = max(low[k], low[k + 1] - reach[k + 1])
                high[k] = min(high[k], high[k + 1] + reach[k + 1])
            angle = min(max(centre[first], low[first]), high[first])
            out[first, c] = pan[first, c] + (angle - centre[first])
            for k in range(first + 1, last + 1):
                angle = min(max(centre[k], low[k], angle - reach[k]), high[k], angle + reach[k])
                out[k, c] = pan[k, c] + (angle - centre[k])
            first = last + 1


@njit(cache=True, nogil=True)
def turn_between(a, b, is_endless):
    """How far a pan head turns from ``a`` to ``b`` (rad); endless: the shorter way round. 0 if one is NaN."""
    turn = b - a
    if math.isnan(turn):
        return 0.0
    return abs(wrapped(turn)) if is_endless else abs(turn)


@njit(cache=True, nogil=True)
def share_of_halves(k, j, tau, times, borders):
    """Share of the half cells after station k and before station j that a turn of ``tau`` (s) takes.

    The cells between take what they can; inf where there is not enough time from k to j.
    """
    halves = (borders[k + 1] - times[k]) + (times[j] - borders[j])
    rest = tau - (borders[j] - borders[k + 1])
    if rest <= 0.0:
        return 0.0
    if rest > halves * (1.0 + _ROUNDING):
        return np.inf
    return min(1.0, rest / halves)


@njit(cache=True, nogil=True)
def schedule(
    cost, blind, pan, is_endless, half_metres, times, borders, switch, pan_rate, out_station, out_triplet
):
    """Which triplet is looked at where, at least cost: the looks in order, their number, and the cost.

    ``cost`` (K, C) per metre, inf without a fix, else at most ``blind`` (K,), the cost per metre without;
    ``pan`` (K, C) of the head, rad, NaN without one. Station k is passed at ``times`` (K,); its cell lies
    between the times ``borders`` (K + 1,), ``half_metres`` (K, 2) before and after it. Another triplet costs
    ``switch``. The head keeps its angle between looks, turns by at most ``pan_rate`` (rad/s) from one to the
    next, and has no fix while it turns to another triplet. ``out_station``, ``out_triplet`` (K,).
    """
    n, m = cost.shape
    total = np.full((n, m), np.inf)
    came_station = np.full((n, m), -1, dtype=np.int32)
    came_triplet = np.full((n, m), -1, dtype=np.int32)
    active = np.empty((n, m), dtype=np.int32)
    n_active = np.zeros(n, dtype=np.int64)
    # What the way to each cell costs without a fix from the start.
    unseen = np.zeros(n + 1)
    for k in range(n):
        unseen[k + 1] = unseen[k] + blind[k] * (half_metres[k, 0] + half_metres[k, 1])
        for c in range(m):
            if cost[k, c] < np.inf:
                active[k, n_active[k]] = c
                n_active[k] += 1
    # Least cost, over and above that of no fix at all, after a look at station k, and up to station k.
    low = np.full(n, np.inf)
    lowest = np.full(n, np.inf)
    for j in range(n):
        for i in range(n_active[j]):
            c = active[j, i]
            # The first look: the head was turned there before the start.
            best = unseen[j]
            station = -1
            triplet = -1
            if j > 0 and total[j - 1, c] < np.inf:
                # To follow the same three from station to station is no interruption.
                turn = turn_between(pan[j - 1, c], pan[j, c], is_endless)
                seconds = (times[j] - times[j - 1]) * (1.0 + _ROUNDING)
                if turn / pan_rate <= seconds and total[j - 1, c] <= best:
                    best = total[j - 1, c]
                    station = j - 1
                    triplet = c
            for k in range(j - 1, -1, -1):
                if not lowest[k] + unseen[j] < best:
                    break
                if not low[k] + unseen[j] < best:
                    continue
                gap = unseen[j] - unseen[k + 1]
                for h in range(n_active[k]):
                    a = active[k, h]
                    value = total[k, a] + gap
                    if a != c:
                        value += switch
                    if not value < best:
                        continue
                    tau = turn_between(pan[k, a], pan[j, c], is_endless) / pan_rate
                    share = share_of_halves(k, j, tau, times, borders)
                    if share > 0.0:
                        if math.isinf(share):
                            continue
                        value += share * half_metres[k, 1] * (blind[k] - cost[k, a])
                        value += share * half_metres[j, 0] * (blind[j] - cost[j, c])
                    if value < best:
                        best = value
                        station = k
                        triplet = a
            total[j, c] = best + cost[j, c] * (half_metres[j, 0] + half_metres[j, 1])
            came_station[j, c] = station
            came_triplet[j, c] = triplet
            low[j] = min(low[j], total[j, c] - unseen[j + 1])
        lowest[j] = min(low[j], lowest[j - 1]) if j > 0 else low[j]
    result = unseen[n]
    station = -1
    triplet = -1
    for k in range(n):
        for i in range(n_active[k]):
            c = active[k, i]
            value = total[k, c] + unseen[n] - unseen[k + 1]
            # No tie is for less to see.
            if value < result or (value == result and k > station):
                result = value
                station = k
                triplet = c
    count = 0
    while station >= 0:
        out_station[count] = station
        out_triplet[count] = triplet
        count += 1
        station, triplet = came_station[station, triplet], came_triplet[station, triplet]
    out_station[:count] = out_station[:count][::-1].copy()
    out_triplet[:count] = out_triplet[:count][::-1].copy()
    return count, result
