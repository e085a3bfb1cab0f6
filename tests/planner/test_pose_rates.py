"""Rates over headings: between two bins the worse one counts."""

import math

import numpy as np

from planner.pose_rates import between_bins


def test_between_two_bins_the_worse_one_counts(rng):
    values = rng.uniform(0.1, 2.0, (8, 3, 4))
    values[rng.random(values.shape) < 0.2] = math.nan
    doubled, careful = between_bins(values), between_bins(values, is_careful=True)
    assert doubled.shape == careful.shape == (16, 3, 4)

    def worst(*some):
        return math.nan if any(map(math.isnan, some)) else max(some)

    for k in range(8):
        for at in np.ndindex(3, 4):
            a, b, c = (values[(k + i) % 8][at] for i in (-1, 0, 1))
            np.testing.assert_equal(doubled[2 * k][at], b)
            np.testing.assert_equal(doubled[2 * k + 1][at], worst(b, c))
            np.testing.assert_equal(careful[2 * k][at], worst(a, b, c))
            np.testing.assert_equal(careful[2 * k + 1][at], worst(b, c))
