"""Fixes from three bearings, from columns, and from more bearings by least squares."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares as scipy_least_squares

from localization.camera import Camera
from localization.errors import ColumnOutsideImage, DegenerateGeometry, InvalidMeasurement
from localization.kernels import least_squares
from localization.sensors import Mount
from localization.triangulation import FixStatus, locate, locate_columns, triangulate, triangulate_columns
from tests import oracles

THREE = np.array([[3.0, 1.0], [1.0, 2.0], [1.0, 0.0]])


def bearings_at(pose, landmarks):
    return np.array(oracles.bearings_from(pose, landmarks))


def test_one_fix():
    fixes = triangulate(bearings_at((1.5, 0.7, -2.0), THREE), THREE)
    assert len(fixes) == 1
    assert fixes.ok.tolist() == [True]
    np.testing.assert_allclose(fixes.pose[0], [1.5, 0.7, -2.0], atol=1e-14)
    assert fixes.covariance is None


def test_a_million_round_trips(rng):
    n = 1_000_000
    poses = np.column_stack([rng.uniform(0, 15, (n, 2)), rng.uniform(-math.pi, math.pi, n)])
    landmarks = rng.uniform(0, 15, (n, 3, 2))
    d = landmarks - poses[:, None, :2]
    fixes = triangulate(np.arctan2(d[..., 1], d[..., 0]) - poses[:, 2:], landmarks, sigma=1e-3)
    assert len(fixes) == n
    assert fixes.ok.mean() > 1 - 1e-5
    good = fixes.ok & (fixes.reliability > 1e-4)
    assert good.mean() > 0.999
    error = np.abs(fixes.pose - poses)
    error[:, 2] = np.abs(np.remainder(error[:, 2] + math.pi, 2 * math.pi) - math.pi)
    assert np.median(error[:, :2]) < 2e-14
    # Rounding of bearings (half a unit in the last place) seen through the fix's own covariance.
    spread = np.sqrt(np.einsum("nii->ni", fixes.covariance[good])) / 1e-3
    assert (error[good] < 1e-12 + 3e-14 * spread).all()


def test_sigmas_for_all_for_each_landmark_and_for_each_bearing(rng):
    bearings = np.array([bearings_at((*rng.uniform(0, 3, 2), 0.4), THREE) for _ in range(5)])
    one = triangulate(bearings, THREE, sigma=0.01).covariance
    np.testing.assert_array_equal(triangulate(bearings, THREE, sigma=[0.01] * 3).covariance, one)
    np.testing.assert_array_equal(triangulate(bearings, THREE, sigma=np.full((5, 3), 0.01)).covariance, one)
    np.testing.assert_allclose(triangulate(bearings, THREE, sigma=0.03).covariance, 9 * one)
    assert not triangulate(bearings, THREE, sigma=0.0).covariance.any()


def test_results_are_read_only():
    fixes = triangulate(bearings_at((1.5, 0.7, -2.0), THREE), THREE, sigma=0.1)
    for array in (fixes.pose, fixes.covariance, fixes.status, fixes.reliability):
        assert not array.flags.writeable


def test_input_may_be_of_any_layout(rng):
    bearings = np.array([bearings_at((*rng.uniform(0, 3, 2), 0.4), THREE) for _ in range(5)])
    want = triangulate(bearings, THREE).pose
    np.testing.assert_array_equal(triangulate(np.asfortranarray(bearings), THREE[::-1][::-1]).pose, want)
    np.testing.assert_array_equal(triangulate(bearings.tolist(), THREE.tolist()).pose, want)
    frozen = bearings.copy()
    frozen.flags.writeable = False
    np.testing.assert_array_equal(triangulate(frozen, THREE).pose, want)
    assert bearings.flags.writeable


def test_no_fixes_at_all():
    fixes = triangulate(np.empty((0, 3)), THREE, sigma=0.1)
    assert len(fixes) == 0
    assert fixes.covariance.shape == (0, 3, 3)


def test_outcomes_are_named_and_nothing_else_is_nan():
    good = bearings_at((1.5, 0.7, -2.0), THREE)
    on_circle = bearings_at((1 + math.cos(2.0), 1 + math.sin(2.0), 0.3), THREE)
    bearings = [good, good + np.array([0, math.pi, 0]), [0.1, math.nan, 0.2], [0.1, 0.2, math.inf], on_circle]
    fixes = triangulate(bearings, [[3, 1], [1, 2], [1, 0]], sigma=0.01)
    assert [FixStatus(s).name for s in fixes.status[:4]] == ["OK", "NO_POSE", "NOT_FINITE", "NOT_FINITE"]
    np.testing.assert_array_equal(np.isnan(fixes.pose).all(axis=1), ~fixes.ok)
    circle = np.array([[2.0, 1.0], [1.0, 2.0], [1.0, 0.0]])
    fix = triangulate(bearings_at((1 + math.cos(2.0), 1 + math.sin(2.0), 0.3), circle), circle, sigma=0.01)
    assert fix.count(FixStatus.DEGENERATE) == 1
    assert np.isnan(fix.covariance).all()
    # A stricter limit on reliability.
    near = bearings_at((1 + 1.1 * math.cos(2.0), 1 + 1.1 * math.sin(2.0), 0.3), circle)
    assert triangulate(near, circle).ok[0]
    assert triangulate(near, circle, min_reliability=0.3).status[0] == FixStatus.DEGENERATE


def test_coincident_landmarks_are_refused_when_shared_and_flagged_when_not():
    with pytest.raises(DegenerateGeometry, match="Landmarks 0 and 2 both stand at"):
        triangulate([0.1, 0.2, 0.3], [[1, 2], [3, 4], [1, 2]])
    with pytest.raises(DegenerateGeometry):
        triangulate([0.1, 0.2, 0.3], np.zeros((3, 2)))
    each = np.array([THREE, [[1, 2], [3, 4], [1, 2]]])
    bearings = np.array([bearings_at((1.5, 0.7, -2.0), THREE), [0.1, 0.2, 0.3]])
    assert triangulate(bearings, each).status.tolist() == [FixStatus.OK, FixStatus.DEGENERATE]


@pytest.mark.parametrize(
    ("bearings", "landmarks", "options", "message"),
    [
        ([0.1, 0.2], THREE, {}, "bearings have shape"),
        (np.zeros((2, 3, 1)), THREE, {}, "bearings have shape"),
        (0.3, THREE, {}, "bearings have shape"),
        (np.zeros((2, 3)), np.zeros((5, 3, 2)), {}, "Landmarks have shape"),
        (np.zeros((2, 3)), np.zeros((2, 3)), {}, "Landmarks have shape"),
        (np.zeros(3), [[0, 0], [1, 0], [math.nan, 2]], {}, "finite"),
        (np.zeros(3), [[0, 0], [1, 0], [1e13, 2]], {}, "1e12"),
        (np.zeros(3), THREE, {"sigma": -0.1}, "sigma must be ≥ 0"),
        (np.zeros(3), THREE, {"sigma": math.nan}, "sigma must be ≥ 0"),
        (np.zeros(3), THREE, {"sigma": math.inf}, "sigma must be ≥ 0"),
        (np.zeros((2, 3)), THREE, {"sigma": [0.1, 0.1]}, "sigma has shape"),
        (np.zeros((2, 3)), THREE, {"sigma": np.ones((3, 3))}, "sigma has shape"),
        (np.zeros(3), THREE, {"min_reliability": 1.0}, "min_reliability"),
        (np.zeros(3), THREE, {"min_reliability": 0.0}, "min_reliability"),
        (np.zeros(3), THREE, {"min_reliability": math.nan}, "min_reliability"),
    ],
)
def test_impossible_input(bearings, landmarks, options, message):
    with pytest.raises(InvalidMeasurement, match=message):
        triangulate(bearings, landmarks, **options)


# --- columns ---

VIEW = np.array([[8.0, -1.5], [9.0, 0.3], [7.0, 1.6]])


def test_columns_give_the_pose_of_the_robot(rng):
    camera = Camera(500.0, 310.0, 640.0)
    pan = rng.uniform(-3, 3, 20)
    poses = np.column_stack([rng.uniform(-1, 1, (20, 2)), np.zeros(20)])
    psi = np.array([bearings_at(p, VIEW) for p in poses])
    poses[:, 2] = [math.remainder(-a, 2 * math.pi) for a in pan]
    fixes = triangulate_columns(camera.columns(psi), VIEW, camera, pan=pan, sigma_px=2.0)
    assert fixes.ok.all()
    np.testing.assert_allclose(fixes.pose, poses, atol=1e-11)
    want = triangulate(psi + pan[:, None], VIEW, sigma=2.0 * np.cos(psi) ** 2 / 500.0)
    np.testing.assert_allclose(fixes.covariance, want.covariance, rtol=1e-9, atol=1e-14)
    one = triangulate_columns(camera.columns(psi[0]), VIEW, camera, pan=pan[0])
    np.testing.assert_allclose(one.pose[0], poses[0], atol=1e-11)


def test_columns_outside_the_image_and_nan():
    camera = Camera(500.0, 310.0, 640.0)
    inside = camera.columns(bearings_at((0.0, 0.0, 0.0), VIEW))
    columns = np.array([inside, inside - [0, 400, 0], inside, inside])
    columns[2, 1] = math.nan
    fixes = triangulate_columns(columns, VIEW, camera, pan=[0.1, 0.1, 0.1, math.nan], sigma_px=2.0)
    want = [FixStatus.OK, FixStatus.OUTSIDE_IMAGE, FixStatus.NOT_FINITE, FixStatus.NOT_FINITE]
    assert fixes.status.tolist() == want
    assert np.isnan(fixes.covariance[1:]).all()
    unlimited = triangulate_columns(columns[1], VIEW, Camera(500.0, 310.0))
    assert unlimited.status[0] != FixStatus.OUTSIDE_IMAGE


def test_impossible_columns():
    with pytest.raises(InvalidMeasurement, match="columns have shape"):
        triangulate_columns([1.0, 2.0], VIEW, Camera(500.0))
    with pytest.raises(InvalidMeasurement, match="pan has shape"):
        triangulate_columns(np.zeros((3, 3)), VIEW, Camera(500.0), pan=[0.0, 0.1])
    with pytest.raises(InvalidMeasurement, match="sigma"):
        triangulate_columns(np.zeros((3, 3)), VIEW, Camera(500.0), sigma_px=-1.0)


# --- more than three ---


def scene(rng, m, noise):
    landmarks = rng.uniform(0, 15, (m, 2))
    pose = np.array([*rng.uniform(3, 12, 2), rng.uniform(-3, 3)])
    sigma = noise * rng.uniform(0.5, 2.0, m)
    return pose, landmarks, sigma, bearings_at(pose, landmarks) + rng.normal(size=m) * sigma


def residuals(pose, bearings, landmarks, sigma):
    seen = bearings_at(pose, landmarks)
    return np.array([math.remainder(b - s, 2 * math.pi) for b, s in zip(bearings, seen, strict=True)]) / sigma


def test_exact_bearings_give_the_exact_pose(rng):
    for m in [3, 4, 5, 8, 30, 200]:
        pose, landmarks, sigma, _ = scene(rng, m, 1e-3)
        fix = locate(bearings_at(pose, landmarks) + 2 * math.pi * rng.integers(-3, 4, m), landmarks, sigma)
        assert fix.converged
        np.testing.assert_allclose(fix.pose, pose, atol=1e-9)
        assert fix.chi2 < 1e-12
        want = oracles.information_covariance(pose[:2], landmarks, sigma**2)
        np.testing.assert_allclose(fix.covariance, want, rtol=1e-5, atol=1e-9 * np.abs(want).max())


def test_noisy_bearings_against_scipy(rng):
    for _ in range(60):
        pose, landmarks, sigma, bearings = scene(rng, int(rng.integers(4, 15)), 5e-3)
        fix = locate(bearings, landmarks, sigma)
        assert fix.converged
        want = scipy_least_squares(
            residuals, pose, args=(bearings, landmarks, sigma), xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
        # Never worse than the minimum beside the truth.
        assert fix.chi2 <= 2 * want.cost * (1 + 1e-6)
        if fix.chi2 > 2 * want.cost * (1 - 1e-6):
            np.testing.assert_allclose(fix.pose[:2], want.x[:2], atol=1e-5)
        assert fix.chi2 == pytest.approx((residuals(fix.pose, bearings, landmarks, sigma) ** 2).sum())


def test_errors_and_residuals_are_as_large_as_they_claim(rng):
    _, landmarks, sigma, _ = scene(rng, 8, 2e-3)
    pose = np.array([7.0, 8.0, 3.1])
    distance, chi2 = [], []
    for _ in range(500):
        fix = locate(bearings_at(pose, landmarks) + rng.normal(size=8) * sigma, landmarks, sigma)
        error = fix.pose - pose
        error[2] = math.remainder(error[2], 2 * math.pi)
        distance.append(error @ np.linalg.solve(fix.covariance, error))
        chi2.append(fix.chi2)
    assert np.mean(distance) == pytest.approx(3.0, abs=0.4)
    assert np.mean(chi2) == pytest.approx(5.0, abs=0.5)


def test_start_does_not_matter(rng):
    pose, landmarks, sigma, bearings = scene(rng, 10, 2e-3)
    fix = locate(bearings, landmarks, sigma)
    for _ in range(30):
        start = pose + rng.normal(size=3) * [1.5, 1.5, 0.4]
        covariance = np.empty((3, 3))
        outcome, _, _ = least_squares.refine(bearings, landmarks, sigma**-2.0, 60, start, covariance)
        assert outcome == least_squares.CONVERGED
        np.testing.assert_allclose(start, fix.pose, atol=1e-7)
        np.testing.assert_allclose(covariance, fix.covariance, rtol=1e-5, atol=1e-12)


def test_a_landmark_may_be_measured_twice():
    landmarks = np.array([*THREE, THREE[0]])
    fix = locate(bearings_at((1.5, 0.7, -2.0), landmarks), landmarks, 0.01)
    np.testing.assert_allclose(fix.pose, [1.5, 0.7, -2.0], atol=1e-12)


def test_landmarks_and_robot_on_one_circle():
    at = np.radians([0.0, 50.0, 100.0, 170.0, 200.0])
    landmarks = np.column_stack([np.cos(at), np.sin(at)])
    fix = locate(bearings_at((math.cos(5.0), math.sin(5.0), 0.2), landmarks), landmarks, 0.01)
    assert fix.status in (FixStatus.DEGENERATE, FixStatus.SINGULAR)
    assert np.isnan(fix.pose).all()
    assert np.isnan(fix.covariance).all()


def test_singular_information(rng):
    # Four on a circle with the robot, moved by less than rounding of the information allows.
    at = np.radians([0.0, 50.0, 100.0, 170.0])
    landmarks = np.column_stack([np.cos(at), np.sin(at)]) + rng.normal(size=(4, 2)) * 1e-8
    fix = locate(bearings_at((math.cos(5.0), math.sin(5.0), 0.2), landmarks), landmarks, 0.01)
    assert fix.status == FixStatus.SINGULAR
    assert np.isnan(fix.pose).all()
    assert not fix.converged


def test_bearings_that_admit_no_pose():
    bearings = bearings_at((1.5, 0.7, -2.0), THREE) + np.array([0, math.pi, 0])
    fix = locate(bearings, THREE, 0.01)
    assert fix.status == FixStatus.NO_POSE
    assert np.isnan(fix.pose).all()
    assert math.isnan(fix.chi2)


def test_steps_run_out(monkeypatch, rng):
    _, landmarks, sigma, bearings = scene(rng, 10, 2e-2)
    monkeypatch.setattr("localization.triangulation.MAX_STEPS", 1)
    fix = locate(bearings, landmarks, sigma)
    assert fix.status == FixStatus.NO_CONVERGENCE
    assert np.isnan(fix.pose).all()


def test_start_on_a_landmark():
    pose, covariance = np.array([3.0, 1.0, 0.0]), np.empty((3, 3))
    outcome, _, _ = least_squares.refine(np.zeros(3), THREE, np.ones(3), 10, pose, covariance)
    assert outcome == least_squares.SINGULAR


@pytest.mark.parametrize(
    ("bearings", "landmarks", "sigma", "error", "message"),
    [
        ([0.1, 0.2], THREE[:2], 0.1, InvalidMeasurement, "M ≥ 3"),
        ([0.1, 0.2, 0.3], THREE[:2], 0.1, InvalidMeasurement, "M ≥ 3"),
        (np.zeros((3, 3)), THREE, 0.1, InvalidMeasurement, "M ≥ 3"),
        ([0.1, math.nan, 0.3], THREE, 0.1, InvalidMeasurement, "finite"),
        ([0.1, 0.2, 0.3], [[1, 2], [3, 4], [5, math.inf]], 0.1, InvalidMeasurement, "finite"),
        ([0.1, 0.2, 0.3], THREE, 0.0, InvalidMeasurement, "sigma"),
        ([0.1, 0.2, 0.3], THREE, [0.1, -0.1, 0.1], InvalidMeasurement, "sigma"),
        ([0.1, 0.2, 0.3], THREE, [0.1, 0.1], InvalidMeasurement, "sigma"),
        ([0.1, 0.2, 0.3], THREE, math.nan, InvalidMeasurement, "sigma"),
        ([0.1, 0.2, 0.3], THREE[[0, 1, 0]], 0.1, DegenerateGeometry, "fewer than three places"),
    ],
)
def test_impossible_input_of_least_squares(bearings, landmarks, sigma, error, message):
    with pytest.raises(error, match=message):
        locate(bearings, landmarks, sigma)


MOUNT = Mount(0.4, -0.2, 0.7)
PLACES = np.array([[6.0, 1.0], [1.0, 7.0], [-3.0, 2.0], [2.0, -4.0], [5.0, 5.0]])
ROBOT = np.array([1.0, 1.5, 0.6])


def sensor_pose(robot, mount):
    ox, oy = mount.offset(robot[2])
    return np.array([robot[0] + ox, robot[1] + oy, robot[2] + mount.theta])


def seen(pose, places):
    d = places - pose[:2]
    return np.arctan2(d[:, 1], d[:, 0]) - pose[2]


def test_a_mounted_sensor_gives_the_robot_s_pose(rng):
    z = seen(sensor_pose(ROBOT, MOUNT), PLACES)
    noise = rng.normal(size=(4000, 5)) * 1e-3
    many = triangulate(z[:3] + noise[:, :3], PLACES[:3], sigma=1e-3, mount=MOUNT)
    exact = triangulate(z[:3], PLACES[:3], sigma=1e-3, mount=MOUNT)
    np.testing.assert_allclose(exact.pose[0], ROBOT, atol=1e-12)
    sample = np.cov((many.pose - ROBOT).T)
    np.testing.assert_allclose(exact.covariance[0], sample, rtol=0.1, atol=0.05 * np.abs(sample).max())
    plain = triangulate(z[:3], PLACES[:3], sigma=1e-3)
    np.testing.assert_allclose(plain.of_robot(MOUNT).covariance, exact.covariance)
    fix = locate(z, PLACES, 1e-3, mount=MOUNT)
    np.testing.assert_allclose(fix.pose, ROBOT, atol=1e-9)
    fixes = np.array([locate(z + e, PLACES, 1e-3, mount=MOUNT).pose for e in noise[:1500]])
    sample = np.cov((fixes - ROBOT).T)
    np.testing.assert_allclose(fix.covariance, sample, rtol=0.15, atol=0.05 * np.abs(sample).max())
    assert triangulate([0.3, 0.3, 0.3], PLACES[:3], sigma=0.1, mount=MOUNT).count(FixStatus.DEGENERATE) == 1


def test_columns_of_a_mounted_camera():
    camera, pan = Camera(500.0, 300.0), -0.5
    front = PLACES[[0, 4, 1]]
    axis = sensor_pose(ROBOT, MOUNT) + np.array([0.0, 0.0, pan])
    u = camera.columns(seen(axis, front))
    fixes = triangulate_columns(u, front, camera, pan=pan, sigma_px=1.0, mount=MOUNT)
    np.testing.assert_allclose(fixes.pose[0], ROBOT, atol=1e-9)
    fix = locate_columns(u, front, camera, 1.0, pan=pan, mount=MOUNT)
    np.testing.assert_allclose(fix.pose, ROBOT, atol=1e-9)
    np.testing.assert_allclose(fix.covariance, fixes.covariance[0], rtol=1e-6)
    blurred = locate_columns(u, front, camera, 1.0, pan=pan, mount=MOUNT, bearing_floor=0.01)
    assert np.linalg.det(blurred.covariance) > np.linalg.det(fix.covariance)
    with pytest.raises(ColumnOutsideImage):
        locate_columns([1.0, 2.0, 700.0], front, Camera(500.0, 300.0, 600.0), 1.0)
    with pytest.raises(InvalidMeasurement, match="bearing_floor"):
        locate_columns(u, front, camera, 1.0, bearing_floor=-1.0)


def test_fixes_say_how_well_their_bearings_agree(rng):
    z = seen(ROBOT, PLACES)
    p = [locate(z + rng.normal(size=5) * 0.01, PLACES, 0.01).p_value for _ in range(400)]
    # Uniform, as p-values of a true model are.
    assert np.mean(p) == pytest.approx(0.5, abs=0.05)
    assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.05)
    misread = locate(z + np.array([0, 0, 0.5, 0, 0]), PLACES, 0.01)
    assert misread.status is FixStatus.OK
    assert misread.dof == 2
    assert misread.p_value < 1e-9
    assert not misread.is_consistent()
    good = locate(z, PLACES, 0.01)
    assert good.is_consistent(0.5)
    assert locate(z[:3], PLACES[:3], 0.01).p_value == 1.0
    none = locate([0.0, 0.0, 0.0], PLACES[:3], 0.01)
    assert math.isnan(none.p_value)
    assert not none.is_consistent()
    with pytest.raises(InvalidMeasurement, match="Level"):
        good.is_consistent(1.0)
