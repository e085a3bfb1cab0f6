"""The filter of a pose: laws, twins, bad covariances, consistency by Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from localization.belief import NotPositiveDefinite, PoseBelief, is_positive_semidefinite
from localization.ekf import predict, update_with_bearings, update_with_fix
from localization.errors import LocalizationError
from localization.fixes import carried_to_robot
from localization.kernels import ekf as kernel
from localization.kernels.fix import information_covariance
from localization.motion import OdometryModel, move
from localization.sensors import Mount
from maps.se2 import wrap
from tests.oracles import kalman_update, numeric_jacobian

LANDMARKS = np.array([[0.0, 0.0], [6.0, 0.5], [5.5, 7.0], [-0.5, 6.0], [2.0, 9.0]])
MODEL = OdometryModel(distance_sigma=0.03, turn_sigma=0.04, drift_sigma=0.02, slip_sigma=0.01)


def random_belief(rng):
    a = rng.normal(size=(3, 3)) * [[0.3], [0.3], [0.1]]
    return PoseBelief(np.array([*rng.uniform(1, 5, 2), rng.uniform(-math.pi, math.pi)]), a @ a.T)


def bearings_from(pose, landmarks=LANDMARKS):
    d = landmarks - pose[:2]
    return wrap(np.arctan2(d[:, 1], d[:, 0]) - pose[2])


def rows_at(pose, landmarks=LANDMARKS):
    rows = np.empty((len(landmarks), 3))
    for row, (x, y) in zip(rows, landmarks, strict=True):
        kernel.bearing_row(np.asarray(pose), np.zeros(3), x, y, row)
    return rows


def test_measurement_matrix_agrees_with_central_differences(rng):
    for _ in range(30):
        pose = random_belief(rng).mean
        for (x, y), row in zip(LANDMARKS, rows_at(pose), strict=True):

            def bearing(q, x=x, y=y, pose=pose):
                # The bearing itself, followed across the seam.
                d = np.array([x, y]) - q[:2]
                at = math.atan2(y - pose[1], x - pose[0]) - pose[2]
                return [at + wrap(math.atan2(d[1], d[0]) - q[2] - at)]

            np.testing.assert_allclose(row, numeric_jacobian(bearing, pose)[0], atol=1e-7)


def test_prediction_agrees_with_the_motion_model(rng):
    for _ in range(20):
        belief = random_belief(rng)
        d, w = rng.uniform(-1, 1, 2)
        out = predict(belief, MODEL, distance=d, turn=w)
        motion = move(belief.mean, distance=d, turn=w, model=MODEL)
        F = motion.transition_matrix
        np.testing.assert_allclose(out.mean, motion.pose, atol=1e-14)
        np.testing.assert_allclose(
            out.covariance, F @ belief.covariance @ F.T + motion.process_noise, atol=1e-14
        )
        assert out.kind == "prediction"


def test_joint_update_agrees_with_the_information_form(rng):
    for _ in range(30):
        belief = random_belief(rng)
        sigma = rng.uniform(0.002, 0.05, len(LANDMARKS))
        z = wrap(bearings_from(belief.mean) + rng.normal(size=len(LANDMARKS)) * 0.05)
        update = update_with_bearings(belief, z, LANDMARKS, sigma=sigma)
        innovation = wrap(z - bearings_from(belief.mean))
        mean, P = kalman_update(
            belief.mean, belief.covariance, innovation, rows_at(belief.mean), np.diag(sigma**2)
        )
        np.testing.assert_allclose(update.posterior.covariance, P, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(wrap(update.posterior.mean - mean), 0, atol=1e-8)
        np.testing.assert_allclose(update.innovations, innovation, atol=1e-12)
        assert update.accepted.all()
        assert update.posterior.kind == "posterior"


def test_order_of_bearings_does_not_matter(rng):
    belief = random_belief(rng)
    z = wrap(bearings_from(belief.mean) + 0.02)
    a = update_with_bearings(belief, z, LANDMARKS, sigma=0.01).posterior
    b = update_with_bearings(belief, z[::-1], LANDMARKS[::-1], sigma=0.01).posterior
    np.testing.assert_allclose(a.mean, b.mean, atol=1e-10)
    np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-12)


def test_fix_agrees_with_the_information_form(rng):
    for n in (2, 3):
        for _ in range(20):
            belief = random_belief(rng)
            a = rng.normal(size=(n, n)) * 0.1
            R = a @ a.T + 1e-6 * np.eye(n)
            fix = belief.mean[:n] + rng.normal(size=n) * 0.1
            update = update_with_fix(belief, fix, R)
            mean, P = kalman_update(belief.mean, belief.covariance, fix - belief.mean[:n], np.eye(n, 3), R)
            np.testing.assert_allclose(update.posterior.covariance, P, rtol=1e-5, atol=1e-10)
            np.testing.assert_allclose(wrap(update.posterior.mean - mean), 0, atol=1e-7)
            S = belief.covariance[:n, :n] + R
            v = fix - belief.mean[:n]
            assert update.normalised[0] == pytest.approx(v @ np.linalg.solve(S, v), rel=1e-6)


def test_bearings_and_their_fix_say_the_same():
    """From an uninformed prior, three bearings give the covariance of one triangulation."""
    pose = np.array([2.0, 3.0, 0.7])
    belief = PoseBelief(pose, np.diag([1e8, 1e8, 1e6]))
    posterior = update_with_bearings(belief, bearings_from(pose)[:3], LANDMARKS[:3], sigma=0.01).posterior
    d = LANDMARKS[:3] - pose[:2]
    inverted = d / np.sum(d * d, axis=1, keepdims=True)
    xx, xy, yy, variance = information_covariance(inverted, np.full(3, 1e-4), 0.0, 0.0)
    np.testing.assert_allclose(posterior.position_covariance, [xx, xy, yy], rtol=1e-3)
    assert posterior.sigma_theta**2 == pytest.approx(variance, rel=1e-3)


def test_more_bearings_never_lose_information(rng):
    for _ in range(20):
        belief = random_belief(rng)
        z = bearings_from(belief.mean)
        last = belief.covariance
        for m in range(1, len(LANDMARKS) + 1):
            P = update_with_bearings(belief, z[:m], LANDMARKS[:m], sigma=0.02).posterior.covariance
            assert np.linalg.eigvalsh(last - P)[0] > -1e-12
            last = P


@pytest.mark.parametrize(("big", "correlation", "variance"), [(1e8, 0.9, 1e-12), (1e4, 0.9, 1e-16)])
def test_factored_joseph_form_survives_what_others_do_not(big, correlation, variance):
    """Regression case: a prior of kilometres against bearings of a microradian, one after the other."""
    P = np.diag([big, big, 1e2])
    P[0, 1] = P[1, 0] = correlation * big
    rows, short, joseph, ours = rows_at(np.array([2.0, 3.0, 0.7])), P.copy(), P.copy(), P.copy()
    broken = set()
    for row in [*rows] * 20:
        gain = short @ row / (row @ short @ row + variance)
        short = short - np.outer(gain, row @ short)
        gain = joseph @ row / (row @ joseph @ row + variance)
        A = np.eye(3) - np.outer(gain, row)
        joseph = A @ joseph @ A.T + variance * np.outer(gain, gain)
        joseph = 0.5 * (joseph + joseph.T)
        kernel.update_scalar(np.zeros(3), ours, row, 0.0, variance)
        broken |= set() if is_positive_semidefinite(0.5 * (short + short.T)) else {"short"}
        broken |= set() if is_positive_semidefinite(joseph) else {"joseph"}
        assert is_positive_semidefinite(ours)
        assert np.diag(ours).min() > 0
    assert "short" in broken, "the case is not nasty enough to tell the forms apart"


def test_exact_pose_stays_exact():
    belief = PoseBelief(np.array([1.0, 2.0, 0.0]), np.zeros((3, 3)))
    update = update_with_bearings(belief, bearings_from(belief.mean) + 0.01, LANDMARKS, sigma=0.01)
    np.testing.assert_array_equal(update.posterior.mean, belief.mean)
    assert not update.posterior.covariance.any()


def test_innovations_are_wrapped():
    belief = PoseBelief.from_sigmas([3.0, 0.0, 0.0], position=0.1, heading=0.1)
    # The landmark is right behind: 3.13 and -3.13 rad are 0.023 apart.
    update = update_with_bearings(belief, [-3.13], [[0.0, 0.001]], sigma=0.1)
    assert abs(update.innovations[0]) < 0.02
    fix = update_with_fix(
        PoseBelief.from_sigmas([0, 0, 3.1], position=1, heading=1), [0, 0, -3.1], np.eye(3) * 0.01
    )
    assert fix.innovations[2] == pytest.approx(2 * math.pi - 6.2)
    assert abs(fix.posterior.mean[2]) > 3.1


def test_gate_leaves_outliers_out():
    pose = np.array([2.0, 3.0, 0.7])
    belief = PoseBelief.from_sigmas(pose, position=0.02, heading=0.01)
    z = bearings_from(pose)
    z[1] = wrap(z[1] + 1.0)
    open_update = update_with_bearings(belief, z, LANDMARKS, sigma=0.01)
    gated = update_with_bearings(belief, z, LANDMARKS, sigma=0.01, gate=0.999)
    np.testing.assert_array_equal(gated.accepted, [True, False, True, True, True])
    assert open_update.accepted.all()
    assert np.hypot(*(gated.posterior.mean - pose)[:2]) < 1e-9
    assert np.hypot(*(open_update.posterior.mean - pose)[:2]) > 1e-3
    assert gated.normalised[1] > chi2.ppf(0.999, 1)
    away = update_with_fix(belief, pose + np.array([1.0, 0, 0]), np.eye(3) * 1e-4, gate=0.999)
    assert not away.accepted[0]
    np.testing.assert_array_equal(away.posterior.mean, pose)


def test_touched_landmarks_and_missing_bearings_do_not_count():
    pose = np.array([2.0, 3.0, 0.7])
    belief = PoseBelief.from_sigmas(pose, position=0.1, heading=0.1)
    update = update_with_bearings(belief, [0.3, math.nan], [[2.0, 3.0], [5.0, 5.0]], sigma=0.01)
    np.testing.assert_array_equal(update.accepted, [False, False])
    np.testing.assert_array_equal(update.posterior.covariance, belief.covariance)
    assert np.isnan(update.innovations).all()


def test_impossible_measurements_are_refused():
    belief = PoseBelief.from_sigmas([0, 0, 0], position=1, heading=1)
    with pytest.raises(LocalizationError, match="bearings but"):
        update_with_bearings(belief, [0.1, 0.2], LANDMARKS, sigma=0.1)
    with pytest.raises(LocalizationError, match="Sigma"):
        update_with_bearings(belief, bearings_from(belief.mean + 1), LANDMARKS, sigma=0.0)
    with pytest.raises(LocalizationError, match="finite"):
        update_with_bearings(belief, [math.inf], [[1.0, 1.0]], sigma=0.1)
    with pytest.raises(LocalizationError, match="No fix, no update"):
        update_with_fix(belief, [1.0, math.nan, 0.0], np.eye(3))
    with pytest.raises(NotPositiveDefinite, match="to be used"):
        update_with_fix(belief, [1.0, 0.0], np.zeros((2, 2)))
    with pytest.raises(NotPositiveDefinite, match="covariance of a fix"):
        update_with_fix(belief, [1.0, 0.0], np.eye(3))
    with pytest.raises(LocalizationError, match="Gate"):
        update_with_fix(belief, [1.0, 0.0], np.eye(2), gate=95.0)
    with pytest.raises(LocalizationError, match="finite"):
        predict(belief, MODEL, distance=math.nan, turn=0.0)


@pytest.mark.parametrize("with_fix", [False, True])
def test_filter_is_consistent_along_simulated_drives(with_fix):
    """NEES of 200 drives, fixed seed: the mean over drives stays within its 99.9 % bounds nearly everywhere."""
    rng = np.random.default_rng(7)
    n_drives, n_steps, sigma = 200, 40, 0.01
    start = PoseBelief.from_sigmas([2.0, 2.0, 0.0], position=0.05, heading=0.03)
    scale = np.sqrt([0.05**2, 0.05**2, 0.03**2])
    nees = np.empty((n_drives, n_steps))
    for drive in range(n_drives):
        truth, belief = start.mean + rng.normal(size=3) * scale, start
        for step in range(n_steps):
            d, w = 0.1, 0.15
            s = np.sqrt([0.03**2 * d, 0.04**2 * w + 0.02**2 * d, 0.01**2 * d])
            e = rng.normal(size=3) * s
            motion = move(truth, distance=d + e[0], turn=w + e[1])
            truth = motion.pose + motion.noise_gain[:, 2] * e[2]
            belief = predict(belief, MODEL, distance=d, turn=w)
            if step % 3 == 2:
                z = wrap(bearings_from(truth) + rng.normal(size=len(LANDMARKS)) * sigma)
                if with_fix:
                    R = np.linalg.inv(rows_at(truth).T @ rows_at(truth) / sigma**2)
                    fix = truth + R @ rows_at(truth).T @ wrap(z - bearings_from(truth)) / sigma**2
                    belief = update_with_fix(belief, fix, R).posterior
                else:
                    belief = update_with_bearings(belief, z, LANDMARKS, sigma=sigma).posterior
            error = belief.error_of(truth)
            nees[drive, step] = error @ np.linalg.solve(belief.covariance, error)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * n_drives) / n_drives
    mean = nees.mean(axis=0)
    assert np.mean((mean > low) & (mean < high)) >= 0.95
    assert np.mean(nees < chi2.ppf(0.95, 3)) == pytest.approx(0.95, abs=0.015)


def test_bearings_of_a_mounted_sensor(rng):
    mount = Mount(0.5, -0.3, 0.7)
    landmarks = rng.uniform(-6, 6, (6, 2))
    pose = np.array([0.4, -0.2, 0.3])
    at = pose[:2] + mount.offset(pose[2])
    d = landmarks - at
    z = wrap(np.arctan2(d[:, 1], d[:, 0]) - pose[2] - mount.theta)
    row = np.empty(3)
    for m in landmarks:
        kernel.bearing_row(pose, mount.as_array(), m[0], m[1], row)
        numeric = numeric_jacobian(
            lambda q, m=m: np.array([kernel.bearing_row(q, mount.as_array(), m[0], m[1], np.empty(3))]), pose
        )
        np.testing.assert_allclose(row, numeric[0], atol=1e-8)
    belief = PoseBelief(pose + np.array([0.1, -0.05, 0.02]), np.diag([0.04, 0.04, 0.01]))
    for _ in range(5):
        belief = update_with_bearings(belief, z, landmarks, sigma=1e-3, mount=mount).posterior
    np.testing.assert_allclose(belief.mean, pose, atol=1e-3)
    off = update_with_bearings(PoseBelief(pose, np.eye(3) * 1e-4), z, landmarks, sigma=1e-3).innovations
    assert np.abs(off).max() > 0.1


def test_fixes_of_a_mounted_sensor_equal_those_of_the_robot(rng):
    """To first order: the fix carried over to the centre, or an update with the sensor's own pose."""
    mount = Mount(0.5, 0.2, 0.8)
    belief = PoseBelief([1.0, 2.0, 0.3], np.diag([0.04, 0.02, 1e-4]))
    ox, oy = mount.offset(0.3)
    own = np.array([1.0 + ox + 0.02, 2.0 + oy - 0.01, 1.1 + 0.002])
    R = np.diag([0.01, 0.02, 1e-4])
    pose, covariance = carried_to_robot(own, R, mount)
    direct = update_with_fix(belief, own, R, mount=mount)
    carried = update_with_fix(belief, pose, covariance)
    np.testing.assert_allclose(direct.posterior.mean, carried.posterior.mean, atol=1e-5)
    np.testing.assert_allclose(
        direct.posterior.covariance, carried.posterior.covariance, rtol=5e-3, atol=1e-6
    )
    assert direct.normalised[0] == pytest.approx(carried.normalised[0], rel=0.02)
    # A position alone says something about the heading too, through the arm.
    position = update_with_fix(belief, own[:2], 1e-8 * np.eye(2), mount=Mount(20.0))
    assert position.posterior.sigma_theta < belief.sigma_theta
