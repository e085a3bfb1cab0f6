"""Figures of polylines against tiny steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.kernels.matrix import way_figures
from tests.oracles import figures_by_samples


def test_against_samples(rng):
    for _ in range(20):
        r95 = np.where(rng.random((6, 7)) < 0.3, np.nan, rng.random((6, 7)))
        cells = rng.random((4, 2)) * [7, 6]
        theirs = figures_by_samples(cells, r95)
        np.testing.assert_allclose(way_figures(cells, r95), theirs, atol=0.02)
        if not math.isnan(theirs[3]):
            assert way_figures(cells, r95)[3] >= theirs[3]


def test_along_a_border_the_worse_cell_counts():
    r95 = np.array([[0.1, 0.2], [0.3, np.nan]])
    assert way_figures(np.array([[0.0, 1.0], [1.0, 1.0]]), r95) == pytest.approx((1.0, 0.3, 0.0, 0.3))
    length, integral, blind, worst = way_figures(np.array([[1.0, 1.0], [2.0, 1.0]]), r95)
    assert (length, integral, blind) == (1.0, 0.0, 1.0)
    assert math.isnan(worst)
