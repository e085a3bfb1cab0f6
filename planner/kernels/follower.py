"""What a simulated robot does in one step: steers on what it believes, drifts, and may touch something."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.ekf import odometry_variances, sinc_and_slope
from localization.kernels.fix import wrapped
from maps.kernels.clearance import segment_distance

# Positions in ``follower``.
LENGTH, TIME, STEP, MAX_DISTANCE, MAX_TURN, HOLONOMIC, SINGLE_FIXES, REACH, MIN_RADIUS = range(9)
N_FOLLOWER = 9

#: Nearer than the radius by more than this is a collision, m: plans keep their clearance up to that.
CONTACT_M = 1e-6
# Steps before and after the present one in which the nearest place of the path is looked for.
_WINDOW = 60


@njit(cache=True, nogil=True)
def steer(k, mean, reference, distances, turns, follower):
    """Distance, turn and direction off the heading to drive from step k to k + 1; ``mean`` (3,)."""
    dx = reference[k, 0] - mean[0]
    dy = reference[k, 1] - mean[1]
    c = math.cos(mean[2])
    s = math.sin(mean[2])
    turned = wrapped(reference[k, 2] - mean[2])
    share = min(follower[STEP] / follower[TIME], 1.0)
    if follower[HOLONOMIC] > 0.0:
        wx = reference[k + 1, 0] - reference[k, 0] + share * dx
        wy = reference[k + 1, 1] - reference[k, 1] + share * dy
        turn = min(max(turns[k] + share * turned, -follower[MAX_TURN]), follower[MAX_TURN])
        distance = min(math.hypot(wx, wy), follower[MAX_DISTANCE])
        # The way of a step leads off the heading in its middle.
        return distance, turn, wrapped(math.atan2(wy, wx) - mean[2] - 0.5 * turn)
    ahead = c * dx + s * dy
    aside = min(max(c * dy - s * dx, -follower[LENGTH]), follower[LENGTH])
    d = distances[k]
    distance = 0.0
    turn = turns[k]
    if d == 0.0:
        turn += share * turned
    else:
        # In the way driven, the distance from the path falls as a critically damped oscillator of one length.
        distance = d * math.cos(turned) + share * ahead
        distance = max(distance, 0.0) if d > 0.0 else min(distance, 0.0)
        distance = min(max(distance, -follower[MAX_DISTANCE]), follower[MAX_DISTANCE])
        turn += d * aside / (follower[LENGTH] * follower[LENGTH])
        turn += 2.0 * abs(d) * math.sin(turned) / follower[LENGTH]
    most = follower[MAX_TURN]
    if follower[MIN_RADIUS] > 0.0:
        most = min(most, abs(distance) / follower[MIN_RADIUS])
    return distance, min(max(turn, -most), most), 0.0


@njit(cache=True, nogil=True)
def drift(pose, distance, turn, direction, noise, draw):
    """Move the true ``pose`` (3,) by a reported step and its noise, ``draw`` (3,) standard normals."""
    variances = np.empty(3)
    odometry_variances(distance, turn, noise, variances)
    d = distance + math.sqrt(variances[0]) * draw[0]
    w = turn + math.sqrt(variances[1]) * draw[1]
    slip = math.sqrt(variances[2]) * draw[2]
    c, _ = sinc_and_slope(0.5 * w)
    phi = pose[2] + direction + 0.5 * w
    pose[0] += c * (d * math.cos(phi) - slip * math.sin(phi))
    pose[1] += c * (d * math.sin(phi) + slip * math.cos(phi))
    pose[2] = wrapped(pose[2] + w)


@njit(cache=True, nogil=True)
def touches(before, after, footprint, reach, clearance):
    """Whether a robot that goes from one pose (3,) to another touches the boundary of free space.

    A disc of radius ``reach`` along the straight way of its centre, or a polygon ``footprint`` (K, 2): its
    sides at the second pose, and the straight ways of its corners and centre.
    """
    x0 = before[0]
    y0 = before[1]
    x1 = after[0]
    y1 = after[1]
    if footprint.shape[0] == 0:
        d = segment_distance(x0, y0, x1, y1, reach + CONTACT_M, *clearance)
        return d == 0.0 or d < reach - CONTACT_M
    if segment_distance(x0, y0, x1, y1, 1.0, *clearance) == 0.0:
        return True
    c0 = math.cos(before[2])
    s0 = math.sin(before[2])
    c1 = math.cos(after[2])
    s1 = math.sin(after[2])
    n = footprint.shape[0]
    last = footprint[n - 1]
    px = x1 + c1 * last[0] - s1 * last[1]
    py = y1 + s1 * last[0] + c1 * last[1]
    for i in range(n):
        fx = footprint[i, 0]
        fy = footprint[i, 1]
        qx = x1 + c1 * fx - s1 * fy
        qy = y1 + s1 * fx + c1 * fy
        if segment_distance(px, py, qx, qy, 1.0, *clearance) == 0.0:
            return True
        ax = x0 + c0 * fx - s0 * fy
        ay = y0 + s0 * fx + c0 * fy
        if segment_distance(ax, ay, qx, qy, 1.0, *clearance) == 0.0:
            return True
        px = qx
        py = qy
    return False


@njit(cache=True, nogil=True)
def off_path(x, y, k, reference):
    """Distance from (x, y) to the path about step k, m."""
    best = math.inf
    for i in range(max(0, k - _WINDOW), min(reference.shape[0] - 1, k + _WINDOW)):
        ax = reference[i, 0]
        ay = reference[i, 1]
        dx = reference[i + 1, 0] - ax
        dy = reference[i + 1, 1] - ay
        length2 = dx * dx + dy * dy
        share = 0.0
        if length2 > 0.0:
            share = min(max(((x - ax) * dx + (y - ay) * dy) / length2, 0.0), 1.0)
        best = min(best, (x - ax - share * dx) ** 2 + (y - ay - share * dy) ** 2)
    return math.sqrt(best)
