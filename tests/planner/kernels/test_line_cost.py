"""The integral along lines against its slow twin, at corners, on borders and on turned grids."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from maps.grid import GridFrame
from planner.kernels.line_cost import (
    motion_rate_cost,
    point_rate,
    polyline_pieces,
    walk,
)
from tests.oracles import line_rate_integral


def rates(rng, shape=(7, 9), forbidden=0.0):
    rate = 1.0 + rng.random(shape) * 5
    rate[rng.random(shape) < forbidden] = np.inf
    rate.flags.writeable = False
    return rate


@pytest.mark.parametrize("forbidden", [0.0, 0.15])
def test_integral_is_that_of_the_slow_twin(rng, forbidden):
    rate = rates(rng, forbidden=forbidden)
    for k in range(400):
        p, q = rng.random((2, 2)) * [9, 7]
        if k % 3 == 0:  # corners, borders and centres
            p, q = np.round(2 * p) / 2, np.round(2 * q) / 2
        elif k % 3 == 1:
            q[k % 2] = p[k % 2] = round(p[k % 2])
        cost, _ = walk(p[0], p[1], q[0], q[1], rate, None)
        back, _ = walk(q[0], q[1], p[0], p[1], rate, None)
        if (p != q).any():
            assert cost == pytest.approx(line_rate_integral(rate, p, q), rel=1e-12)
        assert cost == pytest.approx(back, rel=1e-12)


def test_a_line_through_a_corner_enters_two_cells_only():
    rate = np.array([[1.0, np.inf], [np.inf, 3.0]])
    rate.flags.writeable = False
    cost, _ = walk(0.5, 0.5, 1.5, 1.5, rate, None)
    assert cost == pytest.approx(math.sqrt(2) * 2)
    assert walk(0.5, 0.5, 1.5, 1.5 + 1e-6, rate, None)[0] == math.inf


def test_corners_hold_on_turned_grids_far_from_the_origin(rng):
    rate = np.full((40, 40), np.inf)
    rate[np.arange(40), np.arange(40)] = 2.0
    rate.flags.writeable = False
    for _ in range(100):
        yaw = rng.uniform(-math.pi, math.pi)
        frame = GridFrame(*rng.uniform(-500, 500, 2), yaw, 0.05, 40, 40)
        (x0, y0), (x1, y1) = frame.to_world([[0.5, 0.5], [39.5, 39.5]])
        transform = np.array([frame.origin_x, frame.origin_y, math.cos(yaw), math.sin(yaw), 0.05])
        cost = motion_rate_cost(x0, y0, x1, y1, rate, transform)
        assert cost == pytest.approx(2 * math.sqrt(2) * 39 * 0.05)


def test_on_a_border_the_larger_rate_counts():
    rate = np.array([[1.0, 1.0], [4.0, np.inf]])
    rate.flags.writeable = False
    assert walk(0.0, 1.0, 1.0, 1.0, rate, None)[0] == pytest.approx(4.0)
    assert walk(0.5, 1.0 + 1e-12, 0.9, 1.0 - 1e-12, rate, None)[0] == pytest.approx(1.6)
    assert walk(0.5, 1.0, 1.5, 1.0, rate, None)[0] == math.inf
    assert walk(0.0, 0.0, 1.0, 0.0, rate, None)[0] == math.inf  # the edge of the grid
    assert walk(0.5, 0.5, -0.5, 0.5, rate, None)[0] == math.inf


def test_a_place_has_the_best_of_the_cells_that_meet_there():
    rate = np.array([[1.0, 2.0], [4.0, np.inf]])
    rate.flags.writeable = False
    assert point_rate(1.0, 1.0, rate) == 1.0
    assert point_rate(1.5, 1.0, rate) == 2.0
    assert point_rate(1.5, 1.5, rate) == math.inf
    assert walk(1.5, 1.5, 1.5, 1.5, rate, None)[0] == math.inf
    assert walk(0.5, 0.5, 0.5, 0.5, rate, None)[0] == 0.0


def test_pieces_add_up(rng):
    rate = rates(rng)
    points = rng.random((6, 2)) * [9, 7]
    points[3, 0] = points[2, 0] = 4.0
    pieces = polyline_pieces(points, rate)
    steps = np.hypot(*np.diff(points, axis=0).T)
    np.testing.assert_allclose(np.bincount(pieces[:, 5].astype(int), pieces[:, 4]), steps)
    row, col, row2, col2 = pieces[:, :4].astype(int).T
    larger = np.maximum(rate[row, col], rate[row2, col2])
    total = sum(walk(*p, *q, rate, None)[0] for p, q in itertools.pairwise(points))
    assert (larger * pieces[:, 4]).sum() == pytest.approx(total)
    beside = (row != row2) | (col != col2)
    assert set(pieces[beside, 5]) == {2.0}
