"""Logs of a simulated robot whose noise is known."""

from __future__ import annotations

import math

import numpy as np

from localization.logs import BearingLog, Sighting, blocks_of, expected_bearings
from localization.motion import move
from maps.landmarks import LandmarkSet
from maps.se2 import wrap

PLACES = np.array([[0.0, 0.0], [6.0, 0.5], [5.5, 7.0], [-0.5, 6.0], [9.0, 4.0], [3.0, 9.0], [-2.0, 2.0]])
LANDMARKS = LandmarkSet(tuple("ABCDEFG"), PLACES)


def standing_log(
    rng, *, n=400, sigma=0.01, range_sigma=0.0, bias=0.0, landmark_bias=None, outliers=0.0, column_sigma=0.0
):
    """Scans of all landmarks, each from another place; one block per scan."""
    poses = np.column_stack([rng.uniform(1, 5, n), rng.uniform(1, 5, n), rng.uniform(-math.pi, math.pi, n)])
    m = len(PLACES)
    reference = np.repeat(poses, m, axis=0)
    landmark = np.tile(np.arange(m), n)
    true, distance = expected_bearings(reference, PLACES[landmark])
    own = np.zeros(m) if landmark_bias is None else np.asarray(landmark_bias)
    noise = sigma**2 + (range_sigma / distance) ** 2 + (column_sigma * np.cos(true) ** 2) ** 2
    bearing = true + bias + own[landmark] + rng.normal(size=n * m) * np.sqrt(noise)
    wrong = rng.random(n * m) < outliers
    bearing[wrong] += rng.uniform(0.3, 2.0, int(wrong.sum()))
    return BearingLog(
        "standing",
        LANDMARKS,
        np.repeat(np.arange(n, dtype=float), m),
        landmark,
        wrap(bearing),
        reference,
        np.full(n * m, Sighting.USABLE),
        np.repeat(np.arange(n), m),
    )


def driven_log(
    rng, *, n=6000, sigma=0.01, lag=0.0, scales=(1.0, 1.0), noise=(0.02, 0.03, 0.01, 0.005), still=False
):
    """A drive at 50 Hz that turns left and right, with a scan every 0.2 s; odometry off by scales and noise."""
    dt = 0.02
    t = np.arange(n) * dt
    speed = np.where(np.floor(t / 7) % 3 == 0, 0.0, 0.3) if not still else np.zeros(n)
    rate = 0.5 * np.sin(t / 3.0) if not still else np.zeros(n)
    track, pose = np.empty((n, 4)), np.array([3.0, 3.0, 0.0])
    for k in range(n):
        track[k] = [t[k], *pose]
        d, w = scales[0] * speed[k] * dt, scales[1] * rate[k] * dt
        e = rng.normal(size=3) * np.sqrt(
            [noise[0] ** 2 * abs(d), noise[1] ** 2 * abs(w) + noise[2] ** 2 * abs(d), noise[3] ** 2 * abs(d)]
        )
        motion = move(pose, distance=d + e[0], turn=w + e[1])
        pose = motion.pose + motion.noise_gain[:, 2] * e[2]
    step = 10
    shown = np.arange(step, n, step)
    early = shown - round(lag / dt)
    m = len(PLACES)
    landmark = np.tile(np.arange(m), len(shown))
    true, _ = expected_bearings(np.repeat(track[early, 1:], m, axis=0), PLACES[landmark])
    time = np.repeat(t[shown], m)
    return BearingLog(
        "driven",
        LANDMARKS,
        time,
        landmark,
        wrap(true + rng.normal(size=len(true)) * sigma),
        np.repeat(track[shown, 1:], m, axis=0),
        np.full(len(time), Sighting.USABLE),
        blocks_of(time, 5.0),
        np.column_stack([t, speed, rate]),
        track,
    )
