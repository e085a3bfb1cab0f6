"""Covariances by dead reckoning between fixes against plain matrices."""

from __future__ import annotations

import math

import numpy as np

from localization.motion import OdometryModel
from planner.fused_belief import as_matrices, as_packed
from planner.kernels.belief import reckoned
from tests.oracles import dead_reckoning

ODOMETRY = OdometryModel(0.05, 0.06, 0.03, 0.02)


def test_covariances_are_those_of_the_oracle():
    rng = np.random.default_rng(4)
    for _ in range(20):
        n = 12
        fixes = np.full((n, 6), np.nan)
        some = rng.random(n) < 0.3
        for k in np.flatnonzero(some):
            root = rng.normal(size=(3, 3)) * (0.1, 0.1, 0.02)
            fixes[k] = as_packed(root @ root.T)
        steps, directions = rng.uniform(0.0, 1.0, n - 1), rng.uniform(-math.pi, math.pi, n - 1)
        out = np.empty((n, 6))
        reckoned(fixes, steps, directions, ODOMETRY.kernel_args, out)
        expected = dead_reckoning(
            [as_matrices(f) if k else None for f, k in zip(fixes, some, strict=True)],
            steps,
            directions,
            (0.05, 0.06, 0.03, 0.02),
        )
        for got, want in zip(out, expected, strict=True):
            if want is None:
                assert np.isnan(got).all()
            else:
                # The oracle drives in four pieces.
                assert np.allclose(as_matrices(got), want, rtol=1e-9, atol=1e-12)
