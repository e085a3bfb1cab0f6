"""Covariances of routes on stretches without a fix."""

from __future__ import annotations

import numpy as np
import pytest

from localization import covariance as cov
from localization.field_builder import build_field
from localization.motion import OdometryModel
from localization.sensors import OmnidirectionalSensor
from planner.annotate import annotate, longest_run
from planner.context import PlanningContext
from planner.dead_reckoning import with_dead_reckoning
from planner.fused_belief import FusedField, as_matrices, fix_covariance_in
from planner.timing import time_polyline
from tests.planner.test_belief_plan import FLOOR
from tests.worlds import world_from_ascii

ODOMETRY = OdometryModel(0.05, 0.06, 0.03, 0.02)


@pytest.fixture(scope="module")
def floor():
    sensor = OmnidirectionalSensor(0.004, max_range=3.6)
    return PlanningContext(build_field(world_from_ascii(FLOOR), sensor, resolution=0.25))


def route_of(context, points):
    space = context.graph(radius=0.3, weight=0.0, blind_rate=1.0).cost_space
    return annotate(time_polyline(np.array(points), max_speed=1.0, max_accel=1.0), context, space)


def test_stretches_without_a_fix_grow_from_the_last_one(floor):
    points = [(4.0, 4.0), (4.0, 1.0), (10.0, 1.0), (10.0, 4.0)]
    plain = route_of(floor, points)
    told = with_dead_reckoning(plain, floor, ODOMETRY, None)
    known = told.path.has_fix
    assert np.array_equal(known, np.isfinite(plain.path.r95))
    assert 5 < np.count_nonzero(~known) < len(known) - 5
    assert np.array_equal(told.path.covariance[known], plain.path.covariance[known])
    assert np.isfinite(told.path.r95).all()
    blind = np.flatnonzero(~known)
    assert (np.diff(blind) == 1).all()
    assert (np.diff(told.path.r95[blind]) > 0).all()
    assert np.allclose(told.path.r95, cov.r95(told.path.covariance))
    # The drift of the heading alone.
    driven = told.path.s[blind[-1]] - told.path.s[blind[0]]
    assert told.path.r95[blind[-1]] > 0.3 * 0.03 * driven**1.5
    # Figures stay those of single fixes.
    assert told.summary.max_r95 == plain.summary.max_r95
    assert np.isnan(told.path.collision_probability[~known]).all()


def test_before_the_first_fix_only_what_is_given_is_known(floor):
    plain = route_of(floor, [(4.0, 1.0), (4.0, 4.0)])
    unknown = with_dead_reckoning(plain, floor, ODOMETRY, None)
    assert np.isnan(unknown.path.r95[~unknown.path.has_fix]).all()
    start = np.diag([0.01, 0.01, 1e-4])
    given = with_dead_reckoning(plain, floor, ODOMETRY, start)
    assert np.isfinite(given.path.r95).all()
    assert np.allclose(given.path.covariance[0], (0.01, 0.0, 0.01))


def test_the_fix_of_one_cell_is_that_of_the_field(floor):
    fused = FusedField.from_field(floor.field)
    for row, col in np.argwhere(fused.has_fix)[::37]:
        one = fix_covariance_in(floor.field, int(row), int(col))
        assert np.allclose(one, np.linalg.inv(as_matrices(fused.information[row, col])), rtol=1e-9)


def test_the_longest_stretch_is_told(floor):
    route = route_of(floor, [(4.0, 4.0), (4.0, 1.0), (8.0, 1.0), (8.0, 4.0), (10.0, 4.0), (10.0, 1.0)])
    assert 0 < route.summary.longest_blind < route.summary.blind
    known = route.path.has_fix
    s = route.path.s
    runs, begun = [], None
    for k, ok in enumerate(known):
        begun = k if begun is None and not ok else begun
        if begun is not None and (ok or k == len(known) - 1):
            runs.append(s[k] - s[begun])
            begun = None
    assert len(runs) == 2
    assert route.summary.longest_blind == pytest.approx(max(runs), abs=0.5)


@pytest.mark.parametrize(
    ("mask", "expected"),
    [("....", 0.0), ("xx.x", 4.0), ("xxx.", 6.0), ("xxxx", 10.0), (".xx.", 5.0), ("x..x", 4.0)],
)
def test_longest_runs(mask, expected):
    marked = np.array([c == "x" for c in mask])
    assert longest_run(marked, np.array([1.0, 2.0, 3.0, 4.0])) == expected
