"""Predicted shares against simulated fixes, and the laws that they keep."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import qmc

from localization.kernels.coverage import NOMINAL_SHARE, VALID_TOLERANCE, is_valid, predicted_share
from tests import oracles


@pytest.fixture(scope="module")
def normals():
    """Evenly spread normal numbers (n, 6): shares come out to about 3e-4."""
    points = qmc.Sobol(6, rng=np.random.default_rng(7)).random(1 << 15)
    return ndtri(np.clip(points, 1e-12, 1 - 1e-12))


def share(three, variances, axis=0.0, column_variance=0.0):
    return predicted_share(*np.ravel(three).tolist(), *map(float, variances), axis, column_variance)


def scanner_case(rng, low=-3.0, high=-1.0):
    """Landmarks all around, uneven variances."""
    r, azimuth = rng.uniform(0.5, 10, 3), rng.uniform(-math.pi, math.pi, 3)
    three = np.stack([r * np.cos(azimuth), r * np.sin(azimuth)], axis=1)
    return three, 10 ** (2 * rng.uniform(low, high)) * rng.uniform(0.3, 3, 3), 0.0, 0.0


def camera_case(rng, low=-3.0, high=-1.5):
    """Landmarks in a view of 53°, on half of the cases with noise of the bearings on top."""
    r, psi, axis = rng.uniform(0.5, 10, 3), rng.uniform(-0.46, 0.46, 3), rng.uniform(-3, 3)
    three = np.stack([r * np.cos(psi + axis), r * np.sin(psi + axis)], axis=1)
    column = 10 ** (2 * rng.uniform(low, high))
    extra = rng.integers(0, 2) * column * rng.uniform(0, 2, 3)
    return three, column * np.cos(psi) ** 4 + extra, axis, column


@pytest.mark.parametrize("case", [scanner_case, camera_case])
def test_share_equals_that_of_simulated_fixes(case, normals, rng):
    errors, shares = [], []
    for _ in range(120):
        three, variances, axis, column = case(rng)
        got = share(three, variances, axis, column)
        errors.append(got - oracles.share_inside(three, variances, axis, column, normals))
        shares.append(got)
    errors, shares = np.abs(errors), np.array(shares)
    mild = np.abs(shares - NOMINAL_SHARE) <= 0.05
    assert mild.sum() > 40
    assert (~mild).sum() > 15
    assert errors[mild].max() < 6e-3
    assert np.quantile(errors[mild], 0.9) < 1.5e-3
    assert errors.max() < 0.07
    assert np.median(errors[~mild]) < 0.01


@pytest.mark.parametrize("case", [scanner_case, camera_case])
def test_small_noise_gives_the_nominal_share(case, rng):
    for _ in range(100):
        three, _, axis, column = case(rng)
        tiny = 1e-12
        if column > 0:
            azimuth = np.arctan2(three[:, 1], three[:, 0])
            assert share(three, tiny * np.cos(azimuth - axis) ** 4, axis, tiny) == pytest.approx(
                0.95, abs=5e-3
            )
        else:
            assert share(three, [tiny] * 3) == pytest.approx(0.95, abs=5e-3)


def test_leaving_first_order_is_quadratic_in_the_noise():
    """The cloud's odd terms cancel between opposite directions."""
    three = [(4.0, 0.5), (-1.0, 3.0), (-2.0, -3.5)]
    lost = [NOMINAL_SHARE - share(three, [(sigma) ** 2] * 3) for sigma in (0.04, 0.08, 0.16)]
    assert lost[0] > 0
    assert lost[1] / lost[0] == pytest.approx(4, rel=0.2)
    assert lost[2] / lost[1] == pytest.approx(4, rel=0.4)


@pytest.mark.parametrize("case", [scanner_case, camera_case])
def test_turning_mirroring_scaling_and_order_do_not_matter(case, rng):
    for _ in range(60):
        three, variances, axis, column = case(rng, high=-1.8)
        expected = share(three, variances, axis, column)
        tolerance = 3e-3 if abs(expected - 0.95) < 0.04 else 0.05
        turn = rng.uniform(-3, 3)
        c, s = math.cos(turn), math.sin(turn)
        turned = three @ np.array([[c, s], [-s, c]])
        assert share(turned, variances, axis + turn, column) == pytest.approx(expected, abs=1e-6)
        assert share(7.0 * three, variances, axis, column) == pytest.approx(expected, abs=1e-6)
        mirrored = three * [1.0, -1.0]
        assert share(mirrored, variances, -axis, column) == pytest.approx(expected, abs=tolerance)
        for order in itertools.permutations(range(3)):
            chosen = list(order)
            assert share(three[chosen], variances[chosen], axis, column) == pytest.approx(
                expected, abs=tolerance
            )


def test_share_falls_towards_the_danger_circle():
    """Landmarks on a circle of radius 5 m, the sensor ever closer to it from inside."""
    angles = np.radians([30.0, 90.0, 170.0])
    circle = 5.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shares = [
        share(circle - [0.0, -5.0 + gap], [math.radians(0.1) ** 2] * 3) for gap in (3, 1, 0.5, 0.2, 0.05)
    ]
    assert shares[0] == pytest.approx(0.95, abs=1e-3)
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] < 0.6


def test_collinear_landmarks_close_to_their_line():
    row = np.array([(-1.0, 0.0), (0.0, 0.0), (1.0, 0.0)])
    shares = [share(row - [5.0, y], [math.radians(0.3) ** 2] * 3) for y in (5.0, 0.4, 0.1)]
    assert shares[0] > shares[1] > shares[2]


def test_no_fix_has_no_share():
    on_circle = [(math.cos(a) - 1.0, math.sin(a)) for a in (0.5, 1.5, 2.5)]
    good = [(1.0, 0.0), (0.0, 1.0), (-1.0, -1.0)]
    assert math.isnan(share(on_circle, [1e-6] * 3))
    assert math.isnan(share([(0.0, 0.0), *good[1:]], [1e-6] * 3))
    assert math.isnan(share(good, [1e-6, math.nan, 1e-6]))
    assert math.isnan(share(good, [1e-6, 0.0, 1e-6]))
    assert math.isnan(share([(math.nan, 0.0), *good[1:]], [1e-6] * 3))


def test_huge_noise_still_gives_a_share(rng):
    for case in (scanner_case, camera_case):
        for _ in range(100):
            three, variances, axis, column = case(rng, low=-1.0, high=0.4)
            assert 0.0 <= share(three, variances, axis, column) <= 1.0


def test_valid_is_near_the_nominal_share():
    assert is_valid(0.95)
    assert is_valid(0.95 - 0.99 * VALID_TOLERANCE)
    assert not is_valid(0.95 - 1.01 * VALID_TOLERANCE)
    assert not is_valid(0.95 + 1.01 * VALID_TOLERANCE)
    assert not is_valid(math.nan)
