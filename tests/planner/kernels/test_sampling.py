"""Cost of the best way through each cell."""

from __future__ import annotations

import numpy as np

from planner.kernels.sampling import through_cost


def test_sum_of_both_ways_or_distance_for_the_first(rng):
    to_go, so_far = rng.uniform(0, 9, (7, 5)), rng.uniform(0, 9, (7, 5))
    to_go[2, 3] = np.inf
    so_far[4, 1] = np.inf
    angle = 0.7
    transform = np.array([1.0, 2.0, np.cos(angle), np.sin(angle), 0.5])
    out = np.empty((7, 5))
    through_cost(to_go, so_far, np.array([9.0, 9.0, 1.0]), 1.5, transform, out)
    np.testing.assert_array_equal(out, to_go + so_far)
    start = np.array([3.0, 1.0])
    through_cost(to_go, so_far, np.array([*start, 0.0]), 1.5, transform, out)
    for row in range(7):
        for col in range(5):
            gx, gy = 0.5 * (col + 0.5), 0.5 * (row + 0.5)
            x = 1.0 + np.cos(angle) * gx - np.sin(angle) * gy
            y = 2.0 + np.sin(angle) * gx + np.cos(angle) * gy
            expected = to_go[row, col] + 1.5 * np.hypot(x - start[0], y - start[1])
            assert out[row, col] == expected or abs(out[row, col] - expected) < 1e-9
