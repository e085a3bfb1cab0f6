"""Kernels of timed poses: clothoids against fine steps, profiles against their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.kernels.pose_timing import advance_row, poses_at, stations, turning_profile
from tests import oracles


def by_steps(pose, way, k0, k1, n=4000):
    kappas = k0 + (k1 - k0) * (np.arange(n) + 0.5) / n
    return oracles.pose_along(pose, [(way / n, float(k), 0.0) for k in kappas])


@pytest.mark.parametrize("way", [0.3, -0.3])
def test_a_row_is_the_sum_of_its_steps(way, rng):
    for _ in range(5):
        pose = tuple(rng.normal(size=3))
        k0, k1 = rng.uniform(-1.5, 1.5, 2)
        assert advance_row(*pose, way, k0, k1) == pytest.approx(by_steps(pose, way, k0, k1), abs=1e-7)
    assert advance_row(1.0, 2.0, 3.0, 0.0, 1.0, 1.0) == (1.0, 2.0, 3.0)


def test_stations_and_places_between(rng):
    rows = np.array([[0.5, 0.0, 0.0], [0.4, 0.0, 1.2], [0.6, 1.2, 1.2], [0.2, -1.0, -1.0]])
    counts = np.array([3, 8, 6, 2])
    table = np.empty((counts.sum() + 1, 6))
    stations(np.array([1.0, 2.0, 0.5]), rows, counts, table)
    end = (1.0, 2.0, 0.5)
    for row in rows:
        end = by_steps(end, *row)
    assert table[-1, :3] == pytest.approx(end, abs=1e-7)
    assert table[-1, 3] == pytest.approx(1.7)
    s = np.sort(rng.uniform(0, 1.7, 20))
    out = np.empty((20, 4))
    poses_at(s, 1.0, table, out)
    for at, pose in zip(s, out, strict=True):
        left, expected, kappa = at, (1.0, 2.0, 0.5), 0.0
        for way, k0, k1 in rows:
            ahead = min(left, way)
            kappa = k0 + (k1 - k0) * ahead / way
            expected = by_steps(expected, ahead, k0, kappa) if ahead > 0 else expected
            left -= ahead
            if left <= 0:
                break
        assert pose[:3] == pytest.approx(expected, abs=1e-6)
        assert pose[3] == pytest.approx(kappa, abs=1e-9)


@pytest.mark.parametrize("alpha", [0.6, math.inf])
def test_profiles_keep_their_limits(alpha, rng):
    for _ in range(5):
        n = 40
        knots = np.cumsum(rng.normal(size=n)) * 0.2
        kappa = np.column_stack([knots[:-1], knots[1:]])
        step = rng.uniform(0.02, 0.1, n - 1)
        b = np.empty(n)
        limits = (1.2, 0.8, 0.9, alpha)
        turning_profile(kappa, step, *limits, b)
        assert b[0] == b[-1] == 0
        assert (b[1:-1] > 0).all()
        for i in range(n - 1):
            assert oracles.turning_allowed(b[i], b[i + 1], *kappa[i], step[i], *limits)
