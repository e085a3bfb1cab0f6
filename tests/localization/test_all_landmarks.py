"""All landmarks in view together: as the field sees them, and simulated."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.all_landmarks import fixes_of_all, landmarks_in_view, pose_covariance
from localization.errors import DegenerateGeometry, LocalizationError
from localization.field_builder import build_field
from localization.kernels import least_squares
from localization.method import FieldMethod
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA, Mount, OmnidirectionalSensor
from localization.simulation import simulate_fixes
from localization.triangulation import FixStatus, locate
from maps.io.site import bundled_site

PLACES = np.array([[6.0, 1.0], [1.0, 7.0], [-3.0, 2.0], [2.0, -4.0], [5.0, 5.0]])
POSE = np.array([1.0, 1.5, 0.6])
SENSORS = {
    "laser": LASER,
    "pan": MAS97_CAMERA,
    "optimal": replace(MAS97_CAMERA, pan_policy="optimal"),
    "limited": replace(MAS97_CAMERA, pan_min=-1.5, pan_max=1.5, bearing_floor=0.002),
    "fixed": replace(FORWARD_CAMERA, field_of_view=1.8),
    "mounted": replace(LASER, mount=Mount(0.4, 0.1, 0.5)),
}


def seen(pose, places):
    d = places - pose[:2]
    return np.arctan2(d[:, 1], d[:, 0]) - pose[2]


def test_many_are_one_after_the_other(rng):
    z = seen(POSE, PLACES) + rng.normal(size=(200, 5)) * 0.05
    z[3, 1] = math.nan
    sigma = np.full(5, 0.05)
    fixes = fixes_of_all(z, PLACES, sigma, POSE)
    assert fixes.status[3] == FixStatus.NOT_FINITE
    assert np.isnan(fixes.pose[3]).all()
    for k in np.flatnonzero(np.arange(200) != 3):
        one = locate(z[k], PLACES, 0.05)
        assert fixes.status[k] == one.status
        np.testing.assert_allclose(fixes.pose[k], one.pose, atol=1e-7)


def test_the_kernel_is_its_single_steps(rng):
    z = seen(POSE, PLACES) + rng.normal(size=(20, 5)) * 0.01
    weights = rng.uniform(50, 200, 5)
    starts = POSE + rng.normal(size=(20, 3)) * 0.2
    started = rng.random(20) > 0.3
    poses, outcome, cost = starts.copy(), np.empty(20, dtype=np.int64), np.empty(20)
    least_squares.refine_many(z, PLACES, weights, 60, started, poses, outcome, cost)
    for k in range(20):
        pose, covariance = starts[k].copy(), np.empty((3, 3))
        if started[k]:
            want, _, value = least_squares.refine(z[k], PLACES, weights, 60, pose, covariance)
            assert (outcome[k], cost[k]) == (want, value)
        else:
            assert (outcome[k], cost[k]) == (least_squares.SINGULAR, math.inf)
        np.testing.assert_array_equal(poses[k], pose)


@pytest.mark.parametrize("name", SENSORS)
def test_view_and_prediction_are_those_of_the_field(name, rng):
    world, sensor = bundled_site("mas97_room"), SENSORS[name]
    field = build_field(world, sensor, resolution=1.0, heading=0.4, method=FieldMethod("all_visible"))
    rows, cols = np.nonzero(field.has_fix)
    for k in rng.choice(len(rows), 12, replace=False):
        point = field.frame.centres()[rows[k], cols[k]]
        view = landmarks_in_view(world, sensor, point, heading=0.4)
        np.testing.assert_allclose(view.covariance, field.covariance[rows[k], cols[k]], rtol=1e-12)
        cloud = simulate_fixes(world, sensor, point, heading=0.4, estimator="all_visible", n=3, rng=rng)
        assert cloud.triplet == tuple(view.indices.tolist())
        P = cloud.predicted
        np.testing.assert_allclose([P[0, 0], P[0, 1], P[1, 1]], view.covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("name", SENSORS)
def test_clouds_fill_their_ellipse(name):
    world, sensor = bundled_site("mas97_room"), SENSORS[name]
    if name != "laser":
        sensor = replace(sensor, **({"column_sigma_px": 0.5} if hasattr(sensor, "focal_px") else {}))
    rng = np.random.default_rng(7)
    cloud = simulate_fixes(world, sensor, (6.0, 6.0), heading=0.4, estimator="all_visible", rng=rng)
    assert len(cloud.fixes) == 2000
    assert cloud.failures == 0
    assert cloud.share_inside == pytest.approx(0.95, abs=0.02)
    np.testing.assert_allclose(
        cloud.sample_covariance, cloud.predicted, rtol=0.15, atol=0.08 * cloud.predicted[:2, :2].max()
    )
    three = simulate_fixes(world, sensor, (6.0, 6.0), heading=0.4, n=100, rng=rng)
    assert np.linalg.det(cloud.predicted[:2, :2]) < 1.001 * np.linalg.det(three.predicted[:2, :2])


def test_survey_errors_are_part_of_it(rng):
    world = bundled_site("mas97_room")
    marks = world.landmarks
    rough = world.with_landmarks(
        type(marks)(marks.ids, marks.positions, marks.facing, marks.half_angle, np.full(len(marks), 0.03))
    )
    cloud = simulate_fixes(rough, OmnidirectionalSensor(1e-4), (6.0, 6.0), estimator="all_visible", rng=rng)
    assert cloud.share_inside == pytest.approx(0.95, abs=0.02)


def test_what_makes_no_sense_is_refused(rng):
    world = bundled_site("mas97_room")
    with pytest.raises(LocalizationError, match="estimator"):
        simulate_fixes(world, LASER, (6.0, 6.0), estimator="some", rng=rng)
    with pytest.raises(LocalizationError, match="leave the triplet out"):
        simulate_fixes(world, LASER, (6.0, 6.0), triplet=(0, 1, 2), estimator="all_visible", rng=rng)
    short = replace(LASER, max_range=0.1)
    assert landmarks_in_view(world, short, (6.0, 6.0)) is None
    with pytest.raises(DegenerateGeometry, match="give no fix"):
        simulate_fixes(world, short, (6.0, 6.0), estimator="all_visible", rng=rng)
    angles = np.array([0.3, 2.0, 4.0, 1.0])
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    with pytest.raises(DegenerateGeometry, match="no fix"):
        pose_covariance(np.array([math.cos(5.5), math.sin(5.5), 0.0]), circle, np.full(4, 0.01))
