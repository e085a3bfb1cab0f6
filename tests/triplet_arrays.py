"""What the triplet kernels take, made from a point and landmarks the plain way."""

from __future__ import annotations

import math

import numpy as np

from localization.kernels.fix import fixed_variance
from localization.kernels.spans import ranked_by_span
from localization.kernels.triplets import ranked_triplets
from localization.sensors import (
    LASER,
    MAS97_CAMERA,
    Mount,
    OmnidirectionalSensor,
    PinholeFixedSensor,
    PinholePanSensor,
    kernel_args,
)
from tests.oracles import is_measurable, sensor_place

WIDE = PinholePanSensor(2.6, 300.0, 3.0)
SENSORS = {
    "laser": LASER,
    "coarse": OmnidirectionalSensor(0.02),
    "mas97": MAS97_CAMERA,
    "mas97 optimal": PinholePanSensor(2 * math.atan(0.5), 512.0, 5.0, pan_policy="optimal"),
    "limited": PinholePanSensor(1.2, 512.0, 5.0, pan_min=-1.0, pan_max=0.7),
    "limited optimal": PinholePanSensor(1.5, 512.0, 5.0, pan_min=-2.0, pan_max=2.5, pan_policy="optimal"),
    "nearly full turn": PinholePanSensor(1.9, 512.0, 5.0, pan_min=-3.0, pan_max=3.1),
    "wide": WIDE,
    "wide optimal": PinholePanSensor(2.6, 300.0, 3.0, pan_policy="optimal"),
    "fixed": PinholePanSensor(1.8, 512.0, 5.0, pan_min=0.4, pan_max=0.4),
    "pinhole fixed": PinholeFixedSensor(1.8, 512.0, 5.0),
    "pinhole fixed, mounted": PinholeFixedSensor(
        2.2, 512.0, 5.0, bearing_floor=0.004, mount=Mount(0.4, -0.2, 0.5)
    ),
    "laser, mounted": OmnidirectionalSensor(0.002, mount=Mount(0.5, 0.3, 1.0)),
    "laser, muted": OmnidirectionalSensor(0.002, bearing_floor=0.001, muted=((2.0, -2.0), (0.1, 0.4))),
    "camera, mounted": PinholePanSensor(1.4, 512.0, 5.0, bearing_floor=0.003, mount=Mount(-0.3, 0.6)),
}


def nearest_first(point, landmarks, survey_sigmas, heading=0.0):
    """Indices by falling 1/r (then index) and the arrays gx, gy, rho, azimuth, survey in that order."""
    d = np.asarray(landmarks, float) - np.asarray(point, float)
    strength = 1.0 / (d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1])
    order = np.array(sorted(range(len(d)), key=lambda i: (-strength[i], i)), dtype=np.int64)
    s = strength[order]
    azimuth = np.array([math.remainder(math.atan2(y, x) - heading, 2 * math.pi) for x, y in d[order]])
    shares = np.asarray(survey_sigmas, float)[order] ** 2 * s
    return order, d[order, 0] * s, d[order, 1] * s, np.sqrt(s), azimuth, shares


def search(
    point, landmarks, survey_sigmas, sensor, heading=0.0, count=1, known=0.0, by_span=False, criterion="area"
):
    """Values and triplets of a kernel's ranking; ``point`` is the robot's centre."""
    place = sensor_place(point, sensor, heading)
    seen = np.array([i for i, m in enumerate(landmarks) if is_measurable(place, m, sensor, heading)], int)
    values, triplets = np.empty(count), np.empty((count, 3), dtype=np.int64)
    if len(seen) == 0:
        return values[:0], triplets[:0]
    landmarks, survey_sigmas = np.asarray(landmarks)[seen], np.asarray(survey_sigmas)[seen]
    order, *arrays = nearest_first(place, landmarks, survey_sigmas, heading + sensor.mount.theta)
    n = len(order)
    args = kernel_args(sensor, heading, criterion)
    arrays[4] += sensor.bearing_floor**2
    if sensor.kind == "pinhole_fixed":
        d = landmarks[order] - place
        pairs = zip(d, arrays[4], strict=True)
        arrays[4] = np.array([fixed_variance(x, y, x * x + y * y, s, args) for (x, y), s in pairs])
    order = seen[order]
    if by_span:
        ring = np.argsort(np.arctan2(arrays[1], arrays[0]), kind="stable")
        scratch = [np.empty(2 * n) for _ in range(8)]
        found = ranked_by_span(n, order, *arrays, args, known, ring, *scratch, values, triplets)
    else:
        scratch = [np.empty(n) for _ in range(3)]
        found = ranked_triplets(
            n, order, *arrays, args, known, *scratch, np.empty(n, dtype=np.int64), values, triplets
        )
    return values[:found], triplets[:found]
