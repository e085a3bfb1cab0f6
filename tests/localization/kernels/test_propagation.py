"""Kernel of the belief along a path against its twin; also without the compiler."""

from __future__ import annotations

import numpy as np

from localization.kernels.propagation import covariances_along
from localization.motion import increments_between
from tests.oracles import belief_along

PLACES = np.array([[0.0, 0.0], [6.0, 0.5], [5.5, 7.0], [-0.5, 6.0]])


def test_agrees_with_the_slow_twin(rng):
    n = 12
    poses = np.column_stack(
        [1 + 0.3 * np.arange(n), 1 + 0.2 * np.arange(n), np.full(n, np.arctan2(0.2, 0.3))]
    )
    seen = rng.random((n, 4)) < 0.8
    is_fix = np.arange(n) % 2 == 0
    is_fix[0] = False
    P, out_P = np.diag([4e-4, 4e-4, 1e-4]), np.empty((n, 3, 3))
    used, blind = np.zeros(n, dtype=np.int64), np.zeros(n)
    distances, turns = increments_between(poses)
    noise = np.array([0.03, 0.05, 0.02, 0.01]) ** 2
    places = np.broadcast_to(PLACES, (n, 4, 2)).copy()
    variances = np.where(seen, 1e-4, np.nan)
    expected = belief_along(
        poses,
        P.copy(),
        (0.03, 0.05, 0.02, 0.01),
        [[(PLACES[i], 0.01) for i in np.flatnonzero(seen[k] & is_fix[k])] for k in range(n)],
    )
    covariances_along(
        poses, distances, turns, noise, np.zeros(3), places, variances, is_fix, P, out_P, used, blind
    )
    np.testing.assert_allclose(out_P, expected, rtol=1e-5, atol=1e-10)
    fixed = is_fix & (seen.sum(axis=1) >= 3)
    np.testing.assert_array_equal(used, np.where(fixed, seen.sum(axis=1), 0))
    assert fixed.any()
    assert (blind[fixed] == 0).all()
    assert (blind[1:][~fixed[1:]] > 0).all()
