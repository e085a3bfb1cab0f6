"""Stretches of a line of targets against a look at each target."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.kernels.grid_targets import SCALE, allowed_stretches, first_beyond, start_slopes
from maps.kernels.grid_visibility import in_cone


def targets(rng, n):
    step = int(rng.integers(1, 40))
    tx = rng.integers(-50, 50) + step * np.arange(n, dtype=np.int64)
    inverse = (n - 1) / float(tx[-1] - tx[0]) if n > 1 else 0.0
    return tx, inverse


def test_first_beyond_is_the_first(rng):
    for _ in range(300):
        tx, inverse = targets(rng, int(rng.integers(1, 20)))
        lx, num, den, y = (int(v) for v in rng.integers([-99, -99, 1, 1], [400, 99, 30, 60]))
        for more in (0, 1):
            good = np.flatnonzero((tx - lx) * den >= num * y + more)
            expected = good[0] if len(good) else len(tx)
            assert first_beyond(tx, inverse, lx, num, den, y, more) == expected


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_stretches_hold_each_allowed_target_once(rng, mode):
    found = 0
    for _ in range(600):
        tx, inverse = targets(rng, int(rng.integers(1, 25)))
        lx, y, strict = int(rng.integers(-60, 500)), int(rng.integers(1, 300)), int(rng.integers(2))
        cone = rng.integers(-3, 4, 4)
        gx, mx = tx / 8.0, lx / 8.0
        dy2 = (y / 8.0) ** 2
        low2 = float(rng.choice([0.0, dy2, dy2 + 20.0]))
        high2 = float(rng.choice([math.inf, dy2, dy2 + 40.0, dy2 + 900.0]))
        pieces = np.empty((4, 2), dtype=np.int64)
        n = allowed_stretches(
            pieces, tx, inverse, lx, y, gx, mx, dy2, low2, high2, mode, *(int(v) for v in cone), strict
        )
        got = np.zeros(len(tx), dtype=int)
        for first, last in pieces[:n]:
            got[first : last + 1] += 1
        d2 = (gx - mx) ** 2 + dy2
        expected = [
            abs(x) <= y - strict and low2 <= d <= high2 and in_cone(mode, cone, x, y)
            for x, d in zip(tx - lx, d2, strict=True)
        ]
        assert got.tolist() == np.array(expected, dtype=int).tolist()
        found += got.sum()
    assert found > 300


def test_sweeps_start_a_little_beyond_sector_and_cone():
    low, high = start_slopes(0, 0, 0, 0, 0)
    assert low < -SCALE
    assert high > SCALE
    low, high = start_slopes(1, 2, 1, -2, 1)  # -0.5 ≤ slope ≤ 0.5
    assert -0.51 * SCALE < low < -0.5 * SCALE
    assert 0.5 * SCALE < high < 0.51 * SCALE
    low, high = start_slopes(1, 0, -1, 0, 1)
    assert low >= high
    low, high = start_slopes(1, 1, -2, 0, 1)  # slope ≥ 2: not in this sector
    assert low >= high
