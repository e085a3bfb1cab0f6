"""String pulling against all choices of points; relaxation that only ever improves."""

from __future__ import annotations

import numpy as np
import pytest

from planner.example_space import example_space
from planner.kernels.any_angle import pull_string, relax, subdivide
from planner.kernels.line_cost import motion_cost, polyline_cost
from tests.oracles import cheapest_points


def test_pulled_strings_are_the_cheapest_choice(rng):
    args = example_space().kernel_args
    for _ in range(10):
        points = 0.3 + 2.4 * rng.random((9, 2))
        pulled = pull_string(points, 64, 1.0, *args)
        cost, _ = cheapest_points(9, lambda i, j, p=points: motion_cost(*p[i], *p[j], *args))
        assert polyline_cost(pulled, *args) == pytest.approx(cost)
        np.testing.assert_array_equal(pulled[[0, -1]], points[[0, -1]])


def test_a_window_limits_what_is_left_out():
    args = example_space().kernel_args
    points = np.column_stack([np.linspace(0.3, 2.7, 13), np.full(13, 1.1)])
    assert len(pull_string(points, 64, 1.0, *args)) == 2
    np.testing.assert_array_equal(pull_string(points, 4, 1.0, *args), points[::4])


def test_what_is_not_allowed_comes_back_as_it_was():
    args = example_space().kernel_args
    points = np.array([[0.3, 0.3], [0.3, 2.0], [-1.0, 0.3]])
    np.testing.assert_array_equal(pull_string(points, 64, 1.0, *args), points)


def test_subdivision_keeps_the_line():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 2.5]])
    fine = subdivide(points, 0.5)
    assert np.hypot(*np.diff(fine, axis=0).T).max() <= 0.5 + 1e-12
    np.testing.assert_allclose(np.hypot(*np.diff(fine, axis=0).T).sum(), 3.5)
    np.testing.assert_array_equal(fine[[0, -1]], points[[0, -1]])


def test_relaxation_straightens_and_never_costs_more(rng):
    args = example_space().kernel_args
    for _ in range(5):
        points = 0.3 + 2.4 * rng.random((7, 2))
        ends = points[[0, -1]].copy()
        before = polyline_cost(points, *args)
        relax(points, 0.25, 0.01, 200, *args)
        after = polyline_cost(points, *args)
        assert after < before
        assert after <= 1.02 * polyline_cost(ends, *args)
        np.testing.assert_array_equal(points[[0, -1]], ends)
