"""The search by outer pairs finds what the search by strong pairs finds, to the last bit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.kernels.spans import azimuth_key
from tests.triplet_arrays import SENSORS, search

PANNED = [name for name, s in SENSORS.items() if s.kind != "omnidirectional"]


def layouts(rng, n):
    yield rng.uniform(-8, 8, (n, 2))
    t, wall = rng.uniform(-8, 8, n), rng.integers(0, 4, n)
    eight = np.full(n, 8.0)
    yield np.column_stack([np.choose(wall, [t, eight, t, -eight]), np.choose(wall, [-eight, t, eight, t])])
    yield np.column_stack([rng.uniform(-8, 8, n), rng.choice([-4.0, 4.0], n)])
    angles = rng.uniform(0, 2 * math.pi, n)
    yield 6.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    # Two near and the others far behind, and the other way round.
    for near, far in ((3.0, 30.0), (30.0, 9.0)):
        spread = rng.uniform(-0.35, 0.35, n)
        r = far * rng.uniform(0.98, 1.0, n)
        spread[:2], r[:2] = (-0.37, 0.37), near
        yield np.column_stack([r * np.cos(spread), r * np.sin(spread)])
    grid = rng.permutation(81)[:n]
    yield np.column_stack([grid % 9, grid // 9]) * 2.0 - 8.0  # equal azimuths, equal distances, ties


@pytest.mark.parametrize("name", PANNED)
def test_same_as_by_strong_pairs(rng, name):
    sensor = SENSORS[name]
    found = 0
    for n in (3, 7, 16):
        for landmarks in layouts(rng, n):
            for point in (rng.uniform(-3, 3, 2), np.array([1.0, 1.0]), np.array([0.01, 0.0])):
                heading = rng.uniform(-3, 3) if sensor.depends_on_heading else 0.0
                sigmas = rng.choice([0.0, 0.01], n) * rng.integers(0, 2)
                if np.min(np.hypot(*(landmarks - point).T)) < 1e-3:
                    continue
                for count, criterion in ((4, "trace"), (4, "max_axis"), (1, "area"), (4, "area")):
                    want = search(point, landmarks, sigmas, sensor, heading, count, criterion=criterion)
                    got = search(
                        point, landmarks, sigmas, sensor, heading, count, by_span=True, criterion=criterion
                    )
                    np.testing.assert_array_equal(got[0], want[0])
                    np.testing.assert_array_equal(got[1], want[1])
                    found += len(want[0])
                if len(want[0]) > 0:
                    # Told the best value, every bound is as tight as it gets.
                    got = search(point, landmarks, sigmas, sensor, heading, 1, want[0][0], by_span=True)
                    np.testing.assert_array_equal(got[1], want[1][:1])
                if len(want[0]) == 4:
                    got = search(point, landmarks, sigmas, sensor, heading, 1, want[0][2], by_span=True)
                    np.testing.assert_array_equal(got[1], want[1][:1])
    assert found > 20


def test_azimuth_key_rises_with_the_azimuth(rng):
    angles = np.sort(rng.uniform(-math.pi, math.pi, 200))
    r = rng.uniform(0.1, 50.0, 200)
    keys = [azimuth_key(a * math.cos(t), a * math.sin(t)) for a, t in zip(r, angles, strict=True)]
    assert (np.diff(keys) > 0).all()
    assert azimuth_key(1.0, 0.0) == 0.0
    assert keys[0] >= -2.0
    assert keys[-1] <= 2.0
