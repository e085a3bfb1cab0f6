"""NEES, coverage and their bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from localization.consistency import coverage, mean_nees, nees, share_bounds
from localization.errors import LocalizationError


def drawn(rng, n, dof):
    a = rng.normal(size=(n, dof, dof)) * 10.0 ** rng.uniform(-3, 2, (n, dof, 1))
    P = a @ np.swapaxes(a, 1, 2)
    return np.einsum("nij,nj->ni", a, rng.normal(size=(n, dof))), P


@pytest.mark.parametrize("dof", [2, 3])
def test_nees_agrees_with_the_inverse(rng, dof):
    errors, P = drawn(rng, 200, dof)
    expected = [e @ np.linalg.inv(C) @ e for e, C in zip(errors, P, strict=True)]
    np.testing.assert_allclose(nees(errors, P), expected, rtol=1e-5)
    if dof == 2:
        flat = P.reshape(-1, 4)[:, [0, 1, 3]]
        np.testing.assert_allclose(nees(errors, flat), expected, rtol=1e-5)


def test_true_covariances_are_consistent(rng):
    errors, P = drawn(rng, 4000, 3)
    values = nees(errors, P)
    assert mean_nees(values, 3, level=0.999).is_consistent
    assert coverage(values, 3, level=0.999).allows(0.95)
    assert not mean_nees(2.0 * values, 3).is_consistent
    assert not coverage(2.0 * values, 3).allows(0.95)
    assert not coverage(0.5 * values, 3).allows(0.95)


def test_bounds_hold_as_often_as_they_say(rng):
    inside = rng.binomial(60, 0.95, 2000)
    bounds = {int(k): share_bounds(int(k), 60) for k in set(inside.tolist())}
    held = np.mean([bounds[int(k)][0] <= 0.95 <= bounds[int(k)][1] for k in inside])
    assert held >= 0.95
    means = chi2.rvs(3, size=(2000, 50), random_state=rng).mean(axis=1)
    limits = mean_nees(np.ones(50), 3)
    assert np.mean((means > limits.low) & (means < limits.high)) == pytest.approx(0.95, abs=0.015)


def test_ends_of_the_bounds():
    assert share_bounds(0, 10)[0] == 0.0
    assert share_bounds(10, 10)[1] == 1.0
    assert share_bounds(0, 0) == (0.0, 1.0)


def test_missing_and_singular_values():
    P = np.array(
        [np.eye(2), np.eye(2), np.zeros((2, 2)), [[1.0, 1.0], [1.0, 1.0 - 1e-9]], np.full((2, 2), np.nan)]
    )
    errors = np.array([[1.0, 1.0], [math.nan, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    values = nees(errors, P)
    assert values[0] == pytest.approx(2.0)
    assert np.isnan(values[[1, 4]]).all()
    assert np.isinf(values[[2, 3]]).all()
    assert coverage(values, 2).n == 3
    assert math.isnan(mean_nees([math.nan], 2).value)
    assert math.isnan(coverage([], 2).share)


def test_shapes_are_checked():
    with pytest.raises(LocalizationError, match="give"):
        nees(np.zeros((2, 3)), np.zeros((2, 2, 2)))
