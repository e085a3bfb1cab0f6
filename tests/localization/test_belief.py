"""Beliefs and what is called a covariance."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from localization import covariance as cov
from localization.belief import NotPositiveDefinite, PoseBelief, is_positive_semidefinite
from localization.errors import LocalizationError


def test_random_squares_are_covariances(rng):
    for _ in range(100):
        scale = np.diag(10.0 ** rng.uniform(-6, 3, 3))
        a = rng.normal(size=(3, rng.integers(1, 4)))
        assert is_positive_semidefinite(scale @ a @ a.T @ scale)


def test_negative_directions_are_found(rng):
    for _ in range(100):
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        scale = np.diag(10.0 ** rng.uniform(-6, 3, 3))
        assert not is_positive_semidefinite(scale @ q @ np.diag([1.0, 0.5, -0.05]) @ q.T @ scale)


def test_small_units_hide_nothing():
    # Correlation 2 between a metre and a microradian.
    P = np.diag([1.0, 1.0, 1e-12])
    P[0, 2] = P[2, 0] = 2e-6
    assert np.linalg.eigvalsh(P)[0] > -1e-11
    assert not is_positive_semidefinite(P)


@pytest.mark.parametrize(
    "P",
    [
        np.eye(2),
        np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1.0, math.nan, 1.0]),
        [[0.0, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]],
    ],
)
def test_no_belief_without_a_covariance(P):
    with pytest.raises(NotPositiveDefinite, match="covariance of a belief"):
        PoseBelief(np.zeros(3), P)


def test_belief_figures_are_those_of_its_position():
    P = np.array([[4.0, 1.0, 0.1], [1.0, 2.0, 0.2], [0.1, 0.2, 0.3]]) * 1e-4
    belief = PoseBelief(np.array([1.0, 2.0, 4.0]), P, "posterior")
    np.testing.assert_array_equal(belief.position_covariance, [4e-4, 1e-4, 2e-4])
    assert belief.r95 == float(cov.r95([4e-4, 1e-4, 2e-4]))
    assert belief.area95 == pytest.approx(math.pi * belief.r95**2)
    assert belief.sigma_theta == pytest.approx(math.sqrt(0.3e-4))
    assert belief.mean[2] == pytest.approx(4.0 - 2 * math.pi)


def test_error_is_wrapped():
    belief = PoseBelief.from_sigmas([0.0, 0.0, 3.1], position=1.0, heading=0.1)
    np.testing.assert_allclose(belief.error_of([1.0, -1.0, -3.1]), [-1.0, 1.0, 6.2 - 2 * math.pi])


def test_beliefs_are_frozen_also_after_a_journey():
    belief = PoseBelief.from_sigmas([0.0, 0.0, 0.0], position=1.0, heading=0.1)
    again = pickle.loads(pickle.dumps(belief))
    for b in (belief, again):
        with pytest.raises(ValueError, match="read-only"):
            b.covariance[0, 0] = 2.0
    assert again.kind == "prior"


def test_impossible_beliefs_are_refused():
    with pytest.raises(LocalizationError, match="three finite"):
        PoseBelief(np.array([0.0, math.nan, 0.0]), np.eye(3))
    with pytest.raises(LocalizationError, match="kind 'guess'"):
        PoseBelief(np.zeros(3), np.eye(3), "guess")
