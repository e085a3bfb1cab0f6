"""Clouds of simulated fixes against what first order predicts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from localization import covariance as cov
from localization.errors import DegenerateGeometry, LocalizationError
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA, Mount, OmnidirectionalSensor
from localization.simulation import FixCloud, simulate_fixes
from localization.triangulation import FixStatus, triangulate
from localization.triplets import best_triplet
from maps.grid import GridFrame, OccupancyGrid
from maps.io.site import bundled_site
from maps.landmarks import LandmarkSet
from maps.world import World


def room(landmarks, **options):
    """A room of 15 m × 15 m, landmarks on its walls or inside."""
    frame = GridFrame(-0.5, -0.5, 0.0, 0.5, 32, 32)
    nothing = np.zeros((32, 32), dtype=bool)
    ids = tuple(f"m{i}" for i in range(len(landmarks)))
    return World("room", OccupancyGrid(frame, ~nothing, nothing), LandmarkSet(ids, landmarks, **options))


def flat(covariance):
    return covariance[[0, 0, 1], [0, 1, 1]]


@pytest.mark.parametrize("sensor", [MAS97_CAMERA, LASER], ids=["camera", "laser"])
def test_best_triplet_is_the_default_and_predicts_the_cloud(sensor, rng):
    world, place = bundled_site("mas97_room"), (2.5, 3.0)
    cloud = simulate_fixes(world, sensor, place, heading=0.3, n=20_000, rng=rng)
    choice = best_triplet(world, sensor, place, heading=0.3)
    assert cloud.triplet == choice.triplet
    np.testing.assert_allclose(flat(cloud.predicted), choice.covariance, rtol=1e-9)
    assert math.sqrt(cloud.predicted[2, 2]) == pytest.approx(choice.sigma_theta, rel=1e-9)
    np.testing.assert_equal(cloud.pan, choice.pan)
    assert cloud.failures == 0
    assert cloud.share_inside == pytest.approx(0.95, abs=0.01)
    np.testing.assert_allclose(
        cloud.sample_covariance, cloud.predicted, rtol=0.05, atol=0.03 * cloud.predicted[:2, :2].max()
    )
    assert (np.abs(cloud.bias) < 0.2 * np.sqrt(np.diag(cloud.predicted))).all()


def test_pan_limits_and_policies(rng):
    world, place = bundled_site("mas97_room"), (2.5, 3.0)
    for sensor in (
        replace(MAS97_CAMERA, pan_min=-1.0, pan_max=1.0, column_sigma_px=1.0),
        replace(MAS97_CAMERA, pan_policy="optimal", column_sigma_px=1.0),
    ):
        cloud = simulate_fixes(world, sensor, place, heading=1.0, n=5000, rng=rng)
        choice = best_triplet(world, sensor, place, heading=1.0)
        assert cloud.pan == choice.pan
        np.testing.assert_allclose(flat(cloud.predicted), choice.covariance, rtol=1e-9)
        assert cloud.share_inside == pytest.approx(0.95, abs=0.015)


def test_survey_errors_are_part_of_the_cloud(rng):
    landmarks = [[1.0, 14.0], [8.0, 13.0], [13.0, 5.0]]
    for sensor in (
        OmnidirectionalSensor(1e-4),
        replace(MAS97_CAMERA, field_of_view=2.5, column_sigma_px=0.05),
    ):
        world = room(landmarks, sigma=[0.02, 0.03, 0.05])
        cloud = simulate_fixes(world, sensor, (6.0, 6.0), n=20_000, rng=rng)
        sharp = simulate_fixes(room(landmarks), sensor, (6.0, 6.0), n=100, rng=rng)
        assert np.linalg.det(cloud.predicted[:2, :2]) > 100 * np.linalg.det(sharp.predicted[:2, :2])
        assert cloud.share_inside == pytest.approx(0.95, abs=0.01)
        assert cov.area95(flat(cloud.sample_covariance)) == pytest.approx(
            cov.area95(flat(cloud.predicted)), rel=0.05
        )


def test_the_same_state_gives_the_same_cloud():
    world = bundled_site("mas97_room")
    one, other = (
        simulate_fixes(world, LASER, (2.5, 3.0), n=50, rng=np.random.default_rng(3)) for _ in range(2)
    )
    np.testing.assert_array_equal(one.fixes.pose, other.fixes.pose)


def test_a_chosen_triplet_in_any_order(rng):
    world = room([[1.0, 14.0], [8.0, 13.0], [13.0, 2.0], [0.0, 0.0]])
    cloud = simulate_fixes(world, LASER, (6.0, 6.0), triplet=(3, 0, 2), n=5000, rng=rng)
    assert cloud.triplet == (3, 0, 2)
    np.testing.assert_array_equal(cloud.landmarks, world.landmarks.positions[[3, 0, 2]])
    assert cloud.share_inside == pytest.approx(0.95, abs=0.015)


def test_failures_count_as_outside():
    three = np.array([[3.0, 1.0], [1.0, 2.0], [1.0, 0.0]])
    d = three - [1.5, 0.7]
    good = np.arctan2(d[:, 1], d[:, 0])
    fixes = triangulate([good, good + np.array([0, math.pi, 0]), good, [math.nan, 0, 1]], three)
    cloud = FixCloud(np.array([1.5, 0.7, 0.0]), (0, 1, 2), three, math.nan, fixes, np.eye(3) * 1e-4)
    assert cloud.failures == 2
    assert cloud.inside.tolist() == [True, False, True, False]
    assert cloud.share_inside == 0.5
    assert cloud.errors.shape == (2, 3)
    np.testing.assert_allclose(cloud.errors, 0.0, atol=1e-13)
    none = FixCloud(
        np.array([1.5, 0.7, 0.0]), (0, 1, 2), three, math.nan, triangulate([0, 0, 0], three), np.eye(3)
    )
    assert none.failures == 1
    assert np.isnan(none.sample_covariance).all()
    assert np.isnan(none.bias).all()
    assert none.share_inside == 0.0


def test_headings_wrap(rng):
    world = bundled_site("mas97_room")
    cloud = simulate_fixes(world, LASER, (2.5, 3.0), heading=3 * math.pi, n=500, rng=rng)
    assert cloud.pose[2] == -math.pi
    assert np.abs(cloud.errors[:, 2]).max() < 0.1


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"n": 0}, LocalizationError, "Number of fixes is 0"),
        ({"n": 10**8}, LocalizationError, "Number of fixes"),
        ({"point": (1.0, math.nan)}, LocalizationError, "finite"),
        ({"point": (1.0,)}, LocalizationError, "finite"),
        ({"heading": math.inf}, LocalizationError, "finite"),
        ({"triplet": (0, 1, 1)}, LocalizationError, "three different numbers from 0 to 3"),
        ({"triplet": (0, 1, 4)}, LocalizationError, "three different numbers"),
        ({"triplet": (-1, 1, 2)}, LocalizationError, "three different numbers"),
        ({"triplet": (0, 1)}, LocalizationError, "three different numbers"),
        (
            {"sensor": replace(LASER, max_range=7.0), "triplet": (0, 1, 2)},
            DegenerateGeometry,
            r"cannot be seen .* m2 \(too far\)",
        ),
        ({"sensor": replace(LASER, max_range=1.0)}, DegenerateGeometry, "No triplet gives a fix"),
        ({"sensor": MAS97_CAMERA, "triplet": (0, 1, 2)}, DegenerateGeometry, "not fit into the view"),
        ({"point": (4.0, 6.0), "triplet": (0, 1, 3)}, DegenerateGeometry, "circle"),
    ],
)
def test_impossible_requests(options, error, message, rng):
    # Landmarks 0, 1, 3 and (4, 6) lie on one circle.
    world = room([[9.0, 6.0], [6.5, 8.5], [13.0, 2.0], [6.5, 3.5]])
    arguments = {"sensor": LASER, "point": (5.0, 6.0), **options}
    with pytest.raises(error, match=message):
        simulate_fixes(world, arguments.pop("sensor"), arguments.pop("point"), rng=rng, **arguments)


def test_madsen_1997_figure_3_poor_triplet(rng):
    # §2: in a room of 15 m, fixes of a poor triplet cover about 2 m × 1 m; the ellipse matches 1000 fixes.
    world = room([[0.0, 0.9], [0.0, 5.3], [0.0, 10.0]])
    cloud = simulate_fixes(world, MAS97_CAMERA, (9.2, 4.9), n=1000, rng=rng)
    a, b, _ = cov.ellipse95(flat(cloud.predicted))
    assert 1.5 < 2 * a < 3.0
    assert 0.4 < 2 * b < 1.5
    assert cloud.failures == 0
    assert cloud.share_inside == pytest.approx(0.95, abs=0.025)
    assert np.sqrt(np.diag(cloud.sample_covariance)) == pytest.approx(
        np.sqrt(np.diag(cloud.predicted)), rel=0.1
    )
    extent = np.ptp(cloud.errors[:, :2], axis=0)
    assert 0.7 < extent.min() < 1.5 < extent.max() < 4.5


@pytest.mark.parametrize(("radius", "area"), [(4.0, 24.0), (5.0, 37.0)])
def test_madsen_1997_figure_8_cloud_on_a_curve(radius, area, rng):
    # §5.2: worst triplets have ellipses of 24 and 37 m²; the cloud lies on a curve and not in the ellipse.
    centre = np.array([7.5, 9.5])
    at = np.radians([50.0, 90.0, 130.0])
    landmarks = centre + radius * np.column_stack([np.cos(at), np.sin(at)])
    place = centre - [0.0, radius + 1.5]
    cloud = simulate_fixes(room(landmarks), MAS97_CAMERA, place, triplet=(0, 1, 2), n=5000, rng=rng)
    assert cov.area95(flat(cloud.predicted)) == pytest.approx(area, rel=0.1)
    assert cloud.failures < 50
    assert cloud.share_inside < 0.4
    # The horopter: circle through the robot and the outer landmarks.
    half = landmarks[0, 0] - centre[0]
    rise = landmarks[0, 1] - place[1]
    r = (half**2 + rise**2) / (2 * rise)
    found = cloud.fixes.pose[cloud.fixes.ok, :2]
    off_curve = np.abs(np.hypot(*(found - place - [0.0, r]).T) - r)
    off_axis = np.abs(found[:, 1] - place[1])  # the ellipse's long axis is level
    assert np.median(off_curve) < 0.3 * np.median(off_axis)
    # Fixes bend towards the landmarks on both sides: far out they are above the ellipse.
    far = np.abs(found[:, 0] - place[0]) > 3.0
    assert far.mean() > 0.2
    assert (found[far, 1] > place[1]).mean() > 0.99


def test_a_cloud_across_the_danger_circle_has_failures(rng):
    centre = np.array([7.5, 9.5])
    at = np.radians([50.0, 90.0, 130.0])
    landmarks = centre + 4.0 * np.column_stack([np.cos(at), np.sin(at)])
    cloud = simulate_fixes(
        room(landmarks), MAS97_CAMERA, centre - [0.0, 4.2], triplet=(0, 1, 2), n=5000, rng=rng
    )
    assert cloud.failures > 100
    assert cloud.fixes.count(FixStatus.NO_POSE) + cloud.fixes.count(FixStatus.DEGENERATE) == cloud.failures
    assert cloud.share_inside < 0.2


@pytest.mark.parametrize(
    "sensor",
    [
        replace(LASER, bearing_sigma=0.004, mount=Mount(0.6, -0.3, 2.0)),
        replace(LASER, bearing_sigma=0.003, bearing_floor=0.004, muted=((2.9, -2.9),)),
        replace(FORWARD_CAMERA, field_of_view=1.8, mount=Mount(0.4, 0.2, -0.3)),
        replace(MAS97_CAMERA, bearing_floor=0.01, mount=Mount(-0.5, 0.0, 1.0)),
    ],
)
def test_mounted_and_fixed_sensors_scatter_as_predicted(sensor, rng):
    world = room([[12.0, 6.0], [10.5, 9.5], [13.0, 3.0], [9.0, 5.0], [11.0, 7.5]])
    cloud = simulate_fixes(world, sensor, (6.0, 5.5), heading=0.3, n=20_000, rng=rng)
    best = best_triplet(world, sensor, (6.0, 5.5), heading=0.3)
    np.testing.assert_allclose(flat(cloud.predicted), best.covariance, rtol=1e-9)
    assert math.sqrt(cloud.predicted[2, 2]) == pytest.approx(best.sigma_theta, rel=1e-9)
    assert cloud.share_inside == pytest.approx(best.validity, abs=0.006)
    np.testing.assert_allclose(flat(cloud.sample_covariance), best.covariance, rtol=0.12, atol=2e-5)
    # Heading and position are told apart by the lever arm: their correlation is predicted, too.
    np.testing.assert_allclose(
        cloud.sample_covariance[2, :2],
        cloud.predicted[2, :2],
        rtol=0.2,
        atol=0.05 * math.sqrt(cloud.predicted[2, 2] * cloud.predicted[:2, :2].max()),
    )
