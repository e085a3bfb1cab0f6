"""Fix from every landmark in view, against an enumeration of axes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.kernels.all_visible import all_visible_tile, criterion_cost
from localization.sensors import CRITERIA, kernel_args
from tests import oracles
from tests.triplet_arrays import SENSORS


def fix_at(point, landmarks, sigmas, sensor, heading, criterion):
    out = (
        np.full((1, 1, 3), np.nan),
        np.full((1, 1), np.nan),
        np.full((1, 1), np.nan),
        np.zeros((1, 1), int),
    )
    masks = np.array([[[(1 << len(landmarks)) - 1]]], dtype=np.uint64)
    centre, free = np.array(point).reshape(1, 1, 2), np.ones((1, 1), dtype=bool)
    all_visible_tile(centre, free, masks, landmarks, sigmas**2, kernel_args(sensor, heading, criterion), *out)
    return [a[0, 0] for a in out]


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("name", SENSORS)
def test_against_every_axis(rng, name, criterion):
    sensor = SENSORS[name]
    fixes = 0
    for trial in range(6):
        heading = rng.uniform(-3, 3) if sensor.depends_on_heading else 0.0
        landmarks, point = rng.uniform(-8, 8, (9, 2)), rng.uniform(-3, 3, 2)
        sigmas = rng.choice([0.0, 0.02], 9) if trial % 2 else np.zeros(9)
        want = oracles.all_visible_fix(point, landmarks, sigmas, sensor, heading, criterion)
        covariance, sigma_theta, pan, n_visible = fix_at(point, landmarks, sigmas, sensor, heading, criterion)
        place = oracles.sensor_place(point, sensor, heading)
        assert n_visible == sum(oracles.is_measurable(place, m, sensor, heading) for m in landmarks)
        if want is None:
            assert np.isnan(covariance).all()
            continue
        fixes += 1
        got = criterion_cost(*covariance, CRITERIA[criterion])
        assert got <= want * (1 + 1e-9)
        assert got == pytest.approx(want, rel=1e-3 if "optimal" in name else 1e-9)
        assert sigma_theta > 0
        assert math.isnan(pan) == (sensor.kind != "pinhole_pan")
    assert fixes > 0


def test_two_landmarks_or_a_circle_give_no_fix():
    angles = np.array([0.1, 1.0, 2.0, 3.0])
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    at = (math.cos(4.0), math.sin(4.0))
    for name in ("laser", "mas97", "wide optimal"):
        assert np.isnan(fix_at(at, circle, np.zeros(4), SENSORS[name], 0.0, "area")[0]).all()
        assert np.isnan(fix_at((0.0, 0.0), circle[:2], np.zeros(2), SENSORS[name], 0.0, "area")[0]).all()


def test_more_landmarks_are_never_worse(rng):
    sensor = SENSORS["laser"]
    for _ in range(20):
        landmarks, point = rng.uniform(-8, 8, (12, 2)), rng.uniform(-3, 3, 2)
        costs = []
        for n in range(3, 13):
            covariance = fix_at(point, landmarks[:n], np.zeros(n), sensor, 0.0, "area")[0]
            costs.append(criterion_cost(*covariance, CRITERIA["area"]))
        assert (np.diff(costs) <= 1e-12 * np.array(costs[:-1])).all()
