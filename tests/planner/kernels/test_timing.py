"""Speed profiles: the limits hold, nothing is given away."""

from __future__ import annotations

import numpy as np
import pytest

from planner.kernels.timing import motion_at, speed_profile, station_times
from tests.oracles import fastest_speeds


def profile(kappa, step, max_speed, accel):
    out = np.empty(len(kappa))
    speed_profile(np.asarray(kappa, dtype=float), np.asarray(step, dtype=float), max_speed, accel, out)
    return out


def accelerations(b, kappa, step):
    along = np.diff(b) / (2 * step)
    return np.hypot(along, kappa[:-1] * b[:-1]), np.hypot(along, kappa[1:] * b[1:])


def test_straight_line_is_a_trapezoid():
    step = np.full(100, 0.05)
    b = profile(np.zeros(101), step, 1.0, 0.5)
    s = np.concatenate([[0], np.cumsum(step)])
    np.testing.assert_allclose(b, np.minimum(1.0, np.minimum(s, 5.0 - s)), atol=1e-12)


def test_profiles_match_exhaustive_search(rng):
    for _ in range(4):
        n = 8
        kappa, step = rng.uniform(0.5, 2.0, n), rng.uniform(0.05, 0.1, n - 1)
        b = profile(kappa, step, 0.7, 0.8)
        slow = np.array(fastest_speeds(kappa.tolist(), step.tolist(), 0.7, 0.8, levels=120))
        # The twin knows 121 levels of v² and loses up to one per station; the kernel gives away less.
        assert (slow <= b + 0.01).all()
        assert (b <= slow + 7 * 0.7**2 / 120).all()


def test_the_limit_is_kept_and_met_almost_everywhere(rng):
    for _ in range(20):
        n = 400
        kappa = np.abs(np.convolve(rng.normal(size=n + 40), np.ones(41) / 41, "valid")) * 15
        step = rng.uniform(0.015, 0.025, n - 1)
        b = profile(kappa, step, 1.5, 1.0)
        before, after = accelerations(b, kappa, step)
        assert b[0] == b[-1] == 0
        assert (b >= 0).all()
        assert (b[1:-1] > 0).all()
        assert b.max() <= 1.5**2 + 1e-12
        assert max(before.max(), after.max()) <= 1.0 + 1e-9
        busy = np.maximum(before, after) > 0.98
        assert (busy | (np.sqrt(np.maximum(b[:-1], b[1:])) > 1.49)).mean() > 0.9


def test_hairpin_in_one_station_slows_down_in_time():
    kappa = np.zeros(201)
    kappa[100] = 50.0
    step = np.full(200, 0.02)
    b = profile(kappa, step, 2.0, 1.0)
    assert b[100] <= 1.0 / 50 + 1e-12
    assert max(x.max() for x in accelerations(b, kappa, step)) <= 1.0 + 1e-9


@pytest.mark.parametrize("n", [2, 3])
def test_few_stations(n):
    b = profile(np.zeros(n), np.full(n - 1, 0.5), 1.0, 1.0)
    assert b[0] == b[-1] == 0


def test_motion_follows_the_profile():
    step = np.full(50, 0.04)
    b = profile(np.zeros(51), step, 0.7, 0.5)
    arc = np.concatenate([[0], np.cumsum(step)])
    times = np.empty(51)
    station_times(b, step, times)
    assert times[-1] == pytest.approx(2.0 / 0.7 + 0.7 / 0.5, rel=1e-3)
    t = np.linspace(0, times[-1], 400)
    s, v, a = np.empty(400), np.empty(400), np.empty(400)
    motion_at(t, times, b, step, arc, s, v, a)
    assert s[0] == v[0] == 0
    assert s[-1] == pytest.approx(2.0)
    assert (np.diff(s) >= 0).all()
    np.testing.assert_allclose(np.diff(s) / np.diff(t), 0.5 * (v[1:] + v[:-1]), atol=2e-3)
    np.testing.assert_allclose(np.abs(a[(v > 0.01) & (v < 0.69)]), 0.5, rtol=1e-6)
