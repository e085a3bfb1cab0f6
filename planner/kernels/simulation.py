"""Closed loop: a robot that follows a reference on what it believes, many runs of it.

Everything random comes in as standard normals: per run 3 for where it starts, 3 per step (distance, turn,
slip), 7 per fix (three bearings, their floors, the choice), 2 per landmark (where it really stands) where
the survey has errors. Reports distance and turn as odometry; the truth is off by the model's noise.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.ekf import (
    factor,
    predict,
    update_bearings,
)
from localization.kernels.field import TOUCH_M
from localization.kernels.fix import (
    FIXED,
    FLOOR,
    HEADING,
    LEVER_X,
    LEVER_Y,
    MODE,
    N_MUTED,
    OMNIDIRECTIONAL,
    ON_AXIS,
    VIEW,
    is_muted,
    pan_axis,
    wrapped,
)
from localization.kernels.triangulation import OK, fixes
from maps.kernels.clearance import point_distance, segment_distance
from maps.kernels.sight import sees
from planner.kernels.follower import CONTACT_M, REACH, SINGLE_FIXES, drift, off_path, steer, touches

# Positions in ``table``: where the choice of landmarks is looked up; resolution 0 is step by step.
ORIGIN_X, ORIGIN_Y, COS, SIN, RESOLUTION, N_ROWS, N_COLS, N_HEADINGS = range(8)
# Columns of what is written per run …
HIT_STEP, HIT_X, HIT_Y, GOAL_ERROR, FIXES, MISSED, BLIND, DRIVEN, N_RUN = range(9)
# … and per run and station.
OFF_PATH, ERROR_X, ERROR_Y, ERROR_THETA, NEES_PLACE, NEES_POSE, DISPLACED, N_STATION = range(8)

_START, _PER_STEP, _PER_FIX = 3, 3, 7
_TURN = 2.0 * math.pi
# A triplet that fits into the view where it was chosen may stick out by rounding, rad.
_FIT = 1e-9
_MIN_RELIABILITY = 1e-9


@njit(cache=True, nogil=True)
def draws_per_run(n_steps, n_fixes, n_landmarks, has_survey):
    """How many normals one run takes."""
    return _START + _PER_STEP * n_steps + _PER_FIX * n_fixes + (2 * n_landmarks if has_survey else 0)


@njit(cache=True, nogil=True)
def choose(k, mean, draw, table, offsets, triplets, three):
    """The triplet to look at, by step or by the cell of the believed place, into ``three`` (3,)."""
    index = k
    if table[RESOLUTION] > 0.0:
        dx = mean[0] - table[ORIGIN_X]
        dy = mean[1] - table[ORIGIN_Y]
        col = math.floor((table[COS] * dx + table[SIN] * dy) / table[RESOLUTION])
        row = math.floor((table[COS] * dy - table[SIN] * dx) / table[RESOLUTION])
        if row < 0 or col < 0 or row >= table[N_ROWS] or col >= table[N_COLS]:
            return False
        n = int(table[N_HEADINGS])
        bin_ = round(mean[2] / _TURN * n) % n
        index = int((bin_ * table[N_ROWS] + row) * table[N_COLS] + col)
    if offsets.shape[0] > 0:
        count = offsets[index + 1] - offsets[index]
        if count == 0:
            return False
        # The normal distribution of a normal is even.
        share = 0.5 * math.erfc(-draw / math.sqrt(2.0))
        index = offsets[index] + min(int(share * count), count - 1)
    for a in range(3):
        three[a] = triplets[index, a]
    return three[0] >= 0


@njit(cache=True, nogil=True)
def sensor_at(pose, mount, args):
    """Where the sensor is when the robot is at ``pose`` (3,); ``args`` of the sensor get its heading."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    ox = c * mount[0] - s * mount[1]
    oy = s * mount[0] + c * mount[1]
    args[HEADING] = pose[2] + mount[2]
    args[LEVER_X] = -oy
    args[LEVER_Y] = ox
    return pose[0] + ox, pose[1] + oy


@njit(cache=True, nogil=True)
def axis_for(mean, three, mount, args, landmarks, survey):
    """Optical axis off the sensor's heading for three landmarks as the robot believes to be; NaN: no fit."""
    if args[MODE] == OMNIDIRECTIONAL or args[MODE] == FIXED:
        return 0.0
    x, y = sensor_at(mean, mount, args)
    b = np.empty(3)
    s = np.empty(3)
    for a in range(3):
        dx = landmarks[three[a], 0] - x
        dy = landmarks[three[a], 1] - y
        b[a] = wrapped(math.atan2(dy, dx) - args[HEADING])
        s[a] = survey[three[a]] / max(dx * dx + dy * dy, TOUCH_M * TOUCH_M) + args[FLOOR]
    return pan_axis(b[0], b[1], b[2], s[0], s[1], s[2], args, _FIT)


@njit(cache=True, nogil=True)
def measure(true, mean, three, draw, mount, args, landmarks, survey, stand, scene, bearings, variances):
    """Noisy bearings (3,) of three landmarks from the true pose, and their variances; False if one is lost.

    ``stand`` (N, 2): where the landmarks really are; ``draw`` (6,): normals. A camera looks where it would if
    the robot were where it believes to be.
    """
    axis = axis_for(mean, three, mount, args, landmarks, survey)
    if math.isnan(axis):
        return False
    x, y = sensor_at(true, mount, args)
    for a in range(3):
        i = three[a]
        dx = stand[i, 0] - x
        dy = stand[i, 1] - y
        if dx * dx + dy * dy < TOUCH_M * TOUCH_M or not sees(x, y, i, *scene):
            return False
        if args[N_MUTED] > 0.0 and is_muted(dx, dy, args):
            return False
        off = wrapped(math.atan2(dy, dx) - args[HEADING] - axis)
        if args[MODE] == OMNIDIRECTIONAL:
            bearings[a] = off + math.sqrt(args[ON_AXIS]) * draw[a]
            variances[a] = args[ON_AXIS] + args[FLOOR]
        else:
            if abs(off) > 0.5 * args[VIEW] + _FIT:
                return False
            # Noise is on the image column; the robot judges it by the column that it read.
            off = math.atan(math.tan(off) + math.sqrt(args[ON_AXIS]) * draw[a])
            bearings[a] = axis + off
            variances[a] = args[ON_AXIS] * math.cos(off) ** 4 + args[FLOOR]
        bearings[a] += math.sqrt(args[FLOOR]) * draw[3 + a]
    return True


@njit(cache=True, nogil=True)
def fix_alone(mean, P, bearings, variances, places, survey, mount, scratch):
    """Replace belief ``mean`` (3,), ``P`` (3, 3) by the triangulation of three bearings; False if none.

    ``places`` (3, 2) of the landmarks, ``survey`` (3,) variances of them; ``scratch`` (1, 3, 3).
    """
    ox = math.cos(mean[2]) * mount[0] - math.sin(mean[2]) * mount[1]
    oy = math.sin(mean[2]) * mount[0] + math.cos(mean[2]) * mount[1]
    measured = np.empty((1, 3))
    three = np.empty((1, 3, 2))
    spread = np.empty((1, 3))
    for a in range(3):
        measured[0, a] = bearings[a]
        three[0, a, 0] = places[a, 0]
        three[0, a, 1] = places[a, 1]
        away = (places[a, 0] - mean[0] - ox) ** 2 + (places[a, 1] - mean[1] - oy) ** 2
        spread[0, a] = variances[a] + survey[a] / max(away, TOUCH_M * TOUCH_M)
    pose = np.empty((1, 3))
    status = np.empty(1, dtype=np.uint8)
    reliability = np.empty(1)
    pan = np.zeros(1)
    camera = np.empty(0)
    fixes(measured, three, spread, pan, camera, _MIN_RELIABILITY, pose, scratch, status, reliability)
    if status[0] != OK:
        return False
    theta = wrapped(pose[0, 2] - mount[2])
    ox = math.cos(theta) * mount[0] - math.sin(theta) * mount[1]
    oy = math.sin(theta) * mount[0] + math.cos(theta) * mount[1]
    mean[0] = pose[0, 0] - ox
    mean[1] = pose[0, 1] - oy
    mean[2] = theta
    # The lever arm turns with the heading: p_robot = p_sensor - R(θ) arm.
    C = scratch[0]
    C[0, 2] += oy * C[2, 2]
    C[1, 2] -= ox * C[2, 2]
    P[0, 0] = C[0, 0] + oy * (C[0, 2] + C[2, 0])
    P[0, 1] = C[0, 1] + oy * C[1, 2] - ox * C[2, 0]
    P[1, 1] = C[1, 1] - ox * (C[1, 2] + C[2, 1])
    P[0, 2] = C[0, 2]
    P[1, 2] = C[1, 2]
    P[2, 2] = C[2, 2]
    P[1, 0] = P[0, 1]
    P[2, 0] = P[0, 2]
    P[2, 1] = P[1, 2]
    return True


@njit(cache=True, nogil=True)
def write_station(k, true, mean, P, reference, footprint, reach, clearance, out):
    """Errors at step k into ``out`` (7,): see the column names."""
    e = np.empty(3)
    e[0] = mean[0] - true[0]
    e[1] = mean[1] - true[1]
    e[2] = wrapped(mean[2] - true[2])
    out[OFF_PATH] = off_path(true[0], true[1], k, reference)
    out[ERROR_X] = e[0]
    out[ERROR_Y] = e[1]
    out[ERROR_THETA] = e[2]
    L = np.empty((3, 3))
    factor(P, L)
    total = 0.0
    for i in range(3):
        z = e[i]
        for j in range(i):
            z -= L[i, j] * e[j]
        # Without variance only no error is consistent.
        z = z / L[i, i] if L[i, i] > 0.0 else (0.0 if z == 0.0 else math.inf)
        e[i] = z
        total += z * z
        if i == 1:
            out[NEES_PLACE] = total
    out[NEES_POSE] = total
    # Were the robot, by what it believes, exactly on its path here: would it touch something?
    x = reference[k, 0]
    y = reference[k, 1]
    theta = reference[k, 2]
    x1 = x - out[ERROR_X]
    y1 = y - out[ERROR_Y]
    hit = segment_distance(x, y, x1, y1, 1.0, *clearance) == 0.0
    if not hit and point_distance(x1, y1, reach, *clearance) < reach - CONTACT_M:
        e[0] = x1
        e[1] = y1
        e[2] = theta - out[ERROR_THETA]
        hit = touches(e, e, footprint, reach, clearance)
    out[DISPLACED] = 1.0 if hit else 0.0


@njit(cache=True, nogil=True)
def drive_once(
    draw, reference, distances, turns, is_fix, station, start, P0, follower, noise, footprint, mount, sensor,
    landmarks, survey, has_survey, table, offsets, triplets, scene, clearance, run, stations, track,
):  # fmt: skip
    """One run: ``draw`` (n,) normals, ``run`` (8,) and ``stations`` (S, 7) out, ``track`` (K or 0, 4).

    ``reference`` (K, 3), ``distances`` and ``turns`` (K - 1,), ``is_fix`` (K,), ``station`` (K,) numbers, -1
    for none; ``start`` (3, 3) root of the start's covariance ``P0``.
    """
    n_steps = reference.shape[0]
    n_fixes = 0
    for k in range(n_steps):
        n_fixes += 1 if is_fix[k] else 0
    args = sensor.copy()
    P = P0.copy()
    mean = reference[0].copy()
    true = reference[0].copy()
    for i in range(3):
        for j in range(i + 1):
            true[i] += start[i, j] * draw[j]
    true[2] = wrapped(true[2])
    stand = landmarks
    if has_survey:
        stand = landmarks.copy()
        base = _START + _PER_STEP * (n_steps - 1) + _PER_FIX * n_fixes
        for i in range(landmarks.shape[0]):
            stand[i, 0] += math.sqrt(survey[i]) * draw[base + 2 * i]
            stand[i, 1] += math.sqrt(survey[i]) * draw[base + 2 * i + 1]
    three = np.empty(3, dtype=np.int64)
    bearings = np.empty(3)
    variances = np.empty(3)
    places = np.empty((3, 2))
    shares = np.empty(3)
    innovations = np.empty(3)
    normalised = np.empty(3)
    accepted = np.empty(3, dtype=np.bool_)
    scratch = np.empty((1, 3, 3))
    reach = follower[REACH]
    slack = 0.0
    blind = 0.0
    fix = 0
    before = reference[0].copy()
    run[:] = 0.0
    run[HIT_STEP] = -1.0
    stations[:, :] = np.nan
    for k in range(n_steps):
        if k > 0:
            d, w, direction = steer(k - 1, mean, reference, distances, turns, follower)
            at = _START + _PER_STEP * (k - 1)
            drift(true, d, w, direction, noise, draw[at : at + _PER_STEP])
            mean[2] = wrapped(mean[2] + direction)
            predict(mean, P, d, w, noise)
            mean[2] = wrapped(mean[2] - direction)
            blind += abs(d)
            run[DRIVEN] += abs(d)
        # Clearance changes by no more than the way driven: far from walls nothing needs to be computed.
        slack -= math.hypot(true[0] - before[0], true[1] - before[1])
        if slack <= 0.0:
            slack = point_distance(true[0], true[1], reach + 5.0, *clearance) - reach
            if touches(before, true, footprint, reach, clearance):
                run[HIT_STEP] = k
                run[HIT_X] = true[0]
                run[HIT_Y] = true[1]
                run[GOAL_ERROR] = np.nan
                run[BLIND] = max(run[BLIND], blind)
                if k < track.shape[0]:
                    track[k:, :] = np.nan
                return
        before[:] = true
        if is_fix[k]:
            at = _START + _PER_STEP * (n_steps - 1) + _PER_FIX * fix
            fix += 1
            run[FIXES] += 1.0
            got = choose(k, mean, draw[at + 6], table, offsets, triplets, three) and measure(
                true, mean, three, draw[at : at + 6], mount, args, landmarks, survey, stand, scene, bearings,
                variances,
            )  # fmt: skip
            if got:
                for a in range(3):
                    places[a] = landmarks[three[a]]
                    shares[a] = survey[three[a]]
                if follower[SINGLE_FIXES] > 0.0:
                    got = fix_alone(mean, P, bearings, variances, places, shares, mount, scratch)
                else:
                    update_bearings(
                        mean, P, mount, bearings, places, variances, shares, math.inf, innovations,
                        normalised, accepted,
                    )  # fmt: skip
                    got = accepted.all()
            if got:
                run[BLIND] = max(run[BLIND], blind)
                blind = 0.0
            else:
                run[MISSED] += 1.0
        if station[k] >= 0:
            write_station(k, true, mean, P, reference, footprint, reach, clearance, stations[station[k]])
        if k < track.shape[0]:
            track[k, 0] = true[0]
            track[k, 1] = true[1]
            track[k, 2] = mean[0]
            track[k, 3] = mean[1]
    run[BLIND] = max(run[BLIND], blind)
    goal = reference[n_steps - 1]
    run[GOAL_ERROR] = math.hypot(true[0] - goal[0], true[1] - goal[1])


@njit(cache=True, nogil=True)
def drive_runs(
    draws, reference, distances, turns, is_fix, station, start, P0, follower, noise, footprint, mount, sensor,
    landmarks, survey, has_survey, table, offsets, triplets, scene, clearance, runs, stations, tracks,
):  # fmt: skip
    """Runs of :func:`drive_once`: ``draws`` (R, n), ``runs`` (R, 8), ``stations`` (R, S, 7).

    ``tracks`` (T, K, 4), T ≤ R: true and believed places of the first runs; ``stations`` is float32.
    """
    none = np.empty((0, 4))
    found = np.empty((stations.shape[1], N_STATION))
    for r in range(draws.shape[0]):
        track = tracks[r] if r < tracks.shape[0] else none
        drive_once(
            draws[r], reference, distances, turns, is_fix, station, start, P0, follower, noise, footprint,
            mount, sensor, landmarks, survey, has_survey, table, offsets, triplets, scene, clearance,
            runs[r], found, track,
        )  # fmt: skip
        for i in range(found.shape[0]):
            for j in range(found.shape[1]):
                stations[r, i, j] = found[i, j]
