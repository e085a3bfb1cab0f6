"""What is known along a path, recomputed by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest

from localization.covariance import CHI2_95
from localization.sensors import MAS97_CAMERA
from planner.annotate import SPACING_M, annotate, longest_run
from planner.context import PlanningContext
from planner.timing import time_polyline
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

HALL = """
####################
#..................#
#..................#
#..................#
#..................#
####################
"""
K = math.sqrt(CHI2_95)


def context(sigma=lambda x, y: np.where(x < 4, 0.01, np.where(x < 6, np.nan, 0.03))):
    return PlanningContext(synthetic_field(world_from_ascii(HALL), 0.5, sigma))


def route(points, c, radius=0.2):
    space = c.graph(radius=radius, weight=2.0, blind_rate=5.0).cost_space
    return annotate(time_polyline(points, max_speed=1.0, max_accel=1.0), c, space), space


def test_figures_of_a_straight_run():
    r, space = route([[1.0, 1.25], [9.0, 1.25]], context())
    s = r.summary
    assert s.length == pytest.approx(8.0)
    assert s.blind == pytest.approx(2.0)
    assert s.mean_r95 == pytest.approx((3 * 0.01 + 3 * 0.03) / 6 * K)
    assert s.max_r95 == pytest.approx(0.03 * K)
    assert s.max_area95 == pytest.approx(math.pi * (0.03 * K) ** 2)
    assert s.max_ellipse95 == pytest.approx(0.03 * K)
    assert 5.0 <= s.worst_at <= 5.5
    assert s.cost == pytest.approx(8.0 - 2 + 2 * (3 * 0.01 + 3 * 0.03) * K + 2 * 5.0)
    assert s.cost == pytest.approx(space.line_cost([[1.0, 1.25], [9.0, 1.25]]))
    assert s.min_clearance == pytest.approx(0.5 - 0.2)
    assert s.duration == r.trajectory.duration == pytest.approx(9.0)


def test_waypoints_are_dense_and_carry_the_values_of_their_cells():
    c = context()
    r, _ = route([[1.0, 1.25], [4.7, 2.2], [9.0, 1.25]], c)
    p = r.path
    np.testing.assert_array_equal(p.points[[0, -1]], [[1.0, 1.25], [9.0, 1.25]])
    assert (np.hypot(*(p.points - [4.7, 2.2]).T)).min() < 1e-9
    assert np.diff(p.s).max() <= max(SPACING_M, 0.5) + 1e-6
    np.testing.assert_allclose(np.diff(p.s), np.hypot(*np.diff(p.points, axis=0).T), atol=1e-9)
    rows, cols = c.field.frame.cell_at(p.points).T
    inside = np.abs(p.points / 0.5 - np.round(p.points / 0.5)).min(axis=1) > 1e-6
    np.testing.assert_allclose(p.r95[inside], c.field.r95[rows, cols][inside])
    np.testing.assert_array_equal(p.triplet[inside], c.field.triplet[rows, cols][inside])
    blind = np.isnan(p.r95)
    assert blind.any()
    assert (p.triplet[blind] == -1).all()
    assert np.isnan(p.covariance[blind]).all()
    np.testing.assert_allclose(p.clearance, c.clearance.distance(p.points) - 0.2)
    first = math.atan2(0.95, 3.7)
    np.testing.assert_allclose(p.heading[[0, -1]], [first, math.atan2(-0.95, 4.3)])


def test_on_a_border_the_worse_cell_counts():
    c = context(lambda x, y: np.where(y < 1.5, 0.01, 0.04))
    r, _ = route([[1.0, 1.5], [9.0, 1.5]], c)
    assert r.summary.mean_r95 == pytest.approx(0.04 * K)
    np.testing.assert_allclose(r.path.r95, 0.04 * K)


def test_a_diagonal_through_corners_has_only_the_cells_it_enters():
    bad = lambda x, y: np.where(np.abs(x - y) < 0.1, 0.01, 5.0)  # noqa: E731
    r, _ = route([[0.75, 0.75], [2.25, 2.25]], context(bad))
    assert r.summary.max_r95 == pytest.approx(0.01 * K)
    np.testing.assert_allclose(r.path.r95, 0.01 * K)


def test_wholly_blind_and_standing_still():
    blind = context(lambda x, y: np.nan * x)
    r, _ = route([[1.0, 1.0], [2.0, 1.0]], blind)
    assert r.summary.mean_r95 is r.summary.max_r95 is r.summary.worst_at is None
    assert r.summary.blind == pytest.approx(1.0)
    still, _ = route([[1.1, 1.1]], context())
    assert still.summary.length == still.summary.duration == still.summary.blind == 0.0
    assert still.summary.max_r95 == pytest.approx(0.01 * K)
    assert len(still.path.points) == 1


def test_pan_is_told_from_the_direction_of_travel():
    base = context().field
    pan = np.where(base.has_fix, 1.0, np.nan)
    camera = replace(base, sensor=MAS97_CAMERA, pan=pan)
    r, _ = route([[1.0, 1.25], [1.0, 2.0]], PlanningContext(camera))
    np.testing.assert_allclose(r.path.pan, 1.0 - math.pi / 2)


def test_the_longest_stretch_without_a_fix(rng):
    for _ in range(50):
        lengths, blind = rng.random(12), rng.random(12) < 0.6
        pairs = groupby(zip(blind, lengths, strict=True), lambda pair: pair[0])
        runs = [sum(length for _, length in run) for is_blind, run in pairs if is_blind]
        assert longest_run(blind, lengths) == pytest.approx(max(runs, default=0.0))
