"""Kernels of the filter against plain twins; also without the compiler."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.kernels import ekf
from tests.oracles import kalman_update, moved_by, numeric_jacobian

NOISE = np.array([4e-4, 9e-4, 1e-4, 2.5e-5])
PLACES = np.array([[0.0, 0.0], [6.0, 0.5], [5.5, 7.0], [-0.5, 6.0]])


def covariance(rng):
    a = rng.normal(size=(3, 3)) * [[0.3], [0.3], [0.1]]
    return a @ a.T


def test_chord_of_an_arc_and_its_slope():
    for h in (0.0, 1e-9, 1e-4, -9.99e-4, 1.001e-3, 0.1, -2.0, 3.0):
        c, slope = ekf.sinc_and_slope(h)
        assert c == pytest.approx(np.sinc(h / math.pi), abs=1e-15)
        step = 1e-5
        numeric = (np.sinc((h + step) / math.pi) - np.sinc((h - step) / math.pi)) / (2 * step)
        assert slope == pytest.approx(numeric, abs=1e-9)


def test_prediction_moves_mean_and_covariance(rng):
    for d, w in ((0.4, 0.6), (-0.3, 0.0), (0.0, 1.0), (0.2, -1e-5)):
        mean, P = np.array([1.0, 2.0, 0.3]), covariance(rng)
        before, P_before = mean.copy(), P.copy()
        ekf.predict(mean, P, d, w, NOISE)
        np.testing.assert_allclose(mean, moved_by(before, d, w), atol=1e-6)
        F = numeric_jacobian(lambda q, d=d, w=w: moved_by(q, d, w), before)
        G = numeric_jacobian(lambda q, before=before: moved_by(before, *q), [d, w, 0.0])
        G[:, 2] *= np.sinc(w / 2 / math.pi)
        M = np.diag([NOISE[0] * abs(d), NOISE[1] * abs(w) + NOISE[2] * abs(d), NOISE[3] * abs(d)])
        np.testing.assert_allclose(P, F @ P_before @ F.T + G @ M @ G.T, atol=1e-6)
        np.testing.assert_array_equal(P, P.T)


def test_factor_gives_back_the_covariance(rng):
    L = np.empty((3, 3))
    for _ in range(20):
        P = covariance(rng)
        ekf.factor(P, L)
        np.testing.assert_allclose(L @ L.T, P, atol=1e-14)
        assert not np.triu(L, 1).any()
    for P in (np.zeros((3, 3)), np.diag([1.0, 0.0, 2.0]), np.outer([1.0, 2, 3], [1.0, 2, 3])):
        ekf.factor(P, L)
        np.testing.assert_allclose(L @ L.T, P, atol=1e-12)


def test_rows_one_by_one_are_the_joint_update(rng):
    for _ in range(20):
        mean, P = np.array([1.0, 2.0, 0.3]), covariance(rng)
        rows, v = rng.normal(size=(4, 3)), rng.normal(size=4) * 0.1
        noise = rng.uniform(1e-4, 1e-2, 4)
        accepted = np.array([True, True, False, True])
        expected, P_expected = kalman_update(mean, P, v[accepted], rows[accepted], np.diag(noise[accepted]))
        ekf.update_rows(mean, P, rows, v, noise, accepted)
        np.testing.assert_allclose(mean, expected, atol=1e-9)
        np.testing.assert_allclose(P, P_expected, atol=1e-10)


def test_survey_adds_its_share(rng):
    mean, P = np.array([3.0, 3.0, 0.2]), covariance(rng)
    h = np.empty((4, 3))
    z = np.array(
        [ekf.bearing_row(mean, np.zeros(3), x, y, row) for (x, y), row in zip(PLACES, h, strict=True)]
    )
    total = 1e-4 + 0.05**2 / np.sum((PLACES - mean[:2]) ** 2, axis=1)
    _, expected = kalman_update(mean, P, np.zeros(4), h, np.diag(total))
    out = np.empty(4), np.empty(4), np.empty(4, dtype=np.bool_)
    ekf.update_bearings(mean, P, np.zeros(3), z, PLACES, np.full(4, 1e-4), np.full(4, 0.05**2), np.inf, *out)
    np.testing.assert_allclose(P, expected, atol=1e-12)
    assert out[2].all()


def test_a_log_is_its_steps_one_after_the_other(rng):
    steps, scan_step, offsets = 30, np.array([0, 7, 7, 30]), np.array([0, 4, 6, 7, 11])
    d, w = rng.uniform(0, 0.1, steps), rng.uniform(-0.1, 0.1, steps)
    index = np.array([0, 1, 2, 3, 0, 2, 1, 0, 1, 2, 3])
    z, places = rng.uniform(-3, 3, 11), PLACES[index]
    variances, survey = np.full(11, 1e-3), np.full(11, 1e-4)
    start, P_start = np.array([3.0, 3.0, 0.0]), np.diag([0.1, 0.1, 0.05])
    out_mean, out_P = np.empty((4, 3)), np.empty((4, 3, 3))
    normalised, accepted = np.empty(11), np.empty(11, dtype=np.bool_)
    ekf.filter_log(
        start.copy(), P_start.copy(), d, w, NOISE, scan_step, offsets, z, places, variances, survey, 50.0,
        0, np.zeros(4, dtype=np.bool_), 0, 0, out_mean, out_P, normalised, accepted,
    )  # fmt: skip
    mean, P, t = start.copy(), P_start.copy(), 0
    for s in range(4):
        while t < scan_step[s]:
            ekf.predict(mean, P, d[t], w[t], NOISE)
            t += 1
        part = slice(offsets[s], offsets[s + 1])
        n = offsets[s + 1] - offsets[s]
        out = np.empty(n), np.empty(n), np.empty(n, dtype=np.bool_)
        ekf.update_bearings(
            mean, P, np.zeros(3), z[part], places[part], variances[part], survey[part], 50.0, *out
        )
        np.testing.assert_array_equal(out_mean[s], mean)
        np.testing.assert_array_equal(out_P[s], P)
        np.testing.assert_array_equal(accepted[part], out[2])
    assert 0 < accepted.sum() < 11
