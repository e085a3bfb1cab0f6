"""Belief along a path: twin, dead reckoning, limits, truth by simulation, an independent library."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import chi2

from localization.belief import NotPositiveDefinite, PoseBelief, is_positive_semidefinite
from localization.ekf import predict, update_with_bearings
from localization.errors import LocalizationError
from localization.motion import OdometryModel, increments_between, move
from localization.propagation import fix_stations, propagate
from localization.schedule import Drive, LandmarkSchedule, drive_along
from maps.se2 import wrap
from tests.oracles import belief_along

PLACES = np.array([[0.0, 0.0], [6.0, 0.5], [5.5, 7.0], [-0.5, 6.0]])
SIGMAS = (0.03, 0.05, 0.02, 0.01)
MODEL = OdometryModel(*SIGMAS)
START = np.diag([0.02**2, 0.02**2, 0.01**2])


def schedule(n, seen, sigma=0.01):
    """Landmarks 0 to 3 at each of n stations where ``seen`` (n, 4)."""
    seen = np.broadcast_to(seen, (n, 4))
    index = np.where(seen, np.arange(4), -1)
    return LandmarkSchedule(index, np.broadcast_to(PLACES, (n, 4, 2)), np.where(seen, sigma**2, np.nan))


def some_drive(spacing=0.4):
    return drive_along([[1, 1], [4, 1.5], [4.5, 4], [2, 5]], speed=0.5, spacing=spacing, spacing_rad=0.4)


def test_agrees_with_the_slow_twin(rng):
    drive = some_drive()
    n = len(drive.times)
    seen = rng.random((n, 4)) < 0.75
    seen[0] = False
    belief = propagate(drive, schedule(n, seen), START, odometry=MODEL)
    sightings = [[(PLACES[i], 0.01) for i in np.flatnonzero(row)] for row in seen]
    # A slip of the twin is across the chord of the arc, which is hardly shorter.
    expected = belief_along(drive.poses, START, SIGMAS, sightings)
    np.testing.assert_allclose(belief.covariance, expected, rtol=2e-3, atol=1e-8)
    np.testing.assert_array_equal(belief.n_used, np.where(seen.sum(1) >= 3, seen.sum(1), 0))


def test_fewer_than_three_landmarks_are_dead_reckoning():
    drive = some_drive()
    n = len(drive.times)
    none = propagate(drive, schedule(n, [False] * 4), START, odometry=MODEL)
    two = propagate(drive, schedule(n, [True, True, False, False]), START, odometry=MODEL)
    np.testing.assert_array_equal(two.covariance, none.covariance)
    length = np.sum(np.hypot(*np.diff(drive.poses[:, :2], axis=0).T))
    assert two.max_blind_distance == pytest.approx(length)
    assert (np.diff(np.trace(two.covariance, axis1=1, axis2=2)) >= 0).all()
    assert two.at(n - 1).kind == "prediction"


def test_fixes_bound_the_belief_and_reset_the_blind_distance():
    drive = some_drive(0.1)
    n = len(drive.times)
    all_along = propagate(drive, schedule(n, [True] * 4), START, odometry=MODEL, fix_rate=1.0)
    never = propagate(drive, schedule(n, [False] * 4), START, odometry=MODEL)
    assert all_along.r95.max() < 0.5 * never.r95.max()
    # One fix a second at 0.5 m/s: half a metre and less than a station more.
    assert all_along.max_blind_distance <= 0.6 + 1e-9
    assert all_along.at(int(np.flatnonzero(all_along.n_used)[0])).kind == "posterior"
    assert all(is_positive_semidefinite(P) for P in all_along.covariance)


def test_more_fixes_and_more_landmarks_never_hurt():
    drive = some_drive(0.1)
    n = len(drive.times)
    rates = [0.25, 0.5, 1.0, math.inf]
    runs = [propagate(drive, schedule(n, [True] * 4), START, odometry=MODEL, fix_rate=r) for r in rates]
    for fewer, more in itertools.pairwise(runs):
        assert np.trace(fewer.covariance[-1] - more.covariance[-1]) >= -1e-12
        assert np.linalg.eigvalsh(fewer.covariance[-1] - more.covariance[-1])[0] >= -1e-9
    three = propagate(drive, schedule(n, [True, True, True, False]), START, odometry=MODEL)
    for a, b in zip(three.covariance, runs[-1].covariance, strict=True):
        assert np.linalg.eigvalsh(a - b)[0] >= -1e-12


def test_rate_of_fixes():
    times = np.arange(0, 2.01, 0.1)
    np.testing.assert_array_equal(np.flatnonzero(fix_stations(times, 2.0)), [5, 10, 15, 20])
    np.testing.assert_array_equal(np.flatnonzero(fix_stations(times, 0.4)), [])
    assert fix_stations(times, math.inf).sum() == 20
    assert fix_stations(times, 100.0).sum() == 20
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(LocalizationError, match="Fix rate"):
            fix_stations(times, bad)


def test_results_do_not_vary():
    drive = some_drive()
    n = len(drive.times)
    a, b = (propagate(drive, schedule(n, [True] * 4), START, odometry=MODEL).covariance for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_a_landmark_under_the_robot_is_no_bearing():
    drive = Drive(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.arange(2.0))
    belief = propagate(drive, schedule(2, [True, True, True, False]), START, odometry=MODEL)
    assert belief.n_used[1] == 0
    assert np.isfinite(belief.covariance).all()


def test_impossible_values_are_refused():
    drive = some_drive()
    with pytest.raises(LocalizationError, match="stations"):
        propagate(drive, schedule(3, [True] * 4), START, odometry=MODEL)
    with pytest.raises(NotPositiveDefinite):
        propagate(drive, schedule(len(drive.times), [True] * 4), -START, odometry=MODEL)


def test_predicted_ellipses_hold_along_simulated_drives():
    """300 filtered drives, fixed seed: errors at every station against the covariance predicted beforehand."""
    rng = np.random.default_rng(11)
    drive = drive_along([[1, 1], [4, 1.5], [4.5, 4], [2, 5]], speed=0.5, spacing=0.5, spacing_rad=0.5)
    n, sigma, n_drives = len(drive.times), 0.01, 300
    plan = propagate(drive, schedule(n, [True] * 4, sigma), START, odometry=MODEL, fix_rate=0.5)
    distances, turns = increments_between(drive.poses)
    nees = np.empty((n_drives, n))
    for i in range(n_drives):
        truth = drive.poses[0] + rng.normal(size=3) * np.sqrt(np.diag(START))
        belief = PoseBelief(drive.poses[0], START)
        for k in range(n):
            if k > 0:
                d, w = distances[k - 1], turns[k - 1]
                s = np.sqrt([0.03**2 * abs(d), 0.05**2 * abs(w) + 0.02**2 * abs(d), 0.01**2 * abs(d)])
                e = rng.normal(size=3) * s
                motion = move(truth, distance=d + e[0], turn=w + e[1])
                truth = motion.pose + motion.noise_gain[:, 2] * e[2]
                belief = predict(belief, MODEL, distance=d, turn=w)
            if plan.n_used[k]:
                to = PLACES - truth[:2]
                z = wrap(np.arctan2(to[:, 1], to[:, 0]) - truth[2] + rng.normal(size=4) * sigma)
                belief = update_with_bearings(belief, z, PLACES, sigma=sigma).posterior
            error = belief.error_of(truth)
            nees[i, k] = error @ np.linalg.solve(plan.covariance[k], error)
    inside = np.mean(nees < chi2.ppf(0.95, 3), axis=0)
    assert inside.mean() == pytest.approx(0.95, abs=0.015)
    assert inside.min() > 0.9


def test_marginals_of_gtsam_agree():
    """GTSAM's marginals of a pose graph with odometry and bearings, linearised at the same poses."""
    gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed (development extra)")
    drive = drive_along([[1, 1], [4, 1.5], [4.5, 4]], speed=0.5, spacing=0.7, spacing_rad=0.5)
    n = len(drive.times)
    seen = np.zeros((n, 4), dtype=bool)
    seen[3::3] = True
    ours = propagate(drive, schedule(n, seen), START, odometry=MODEL)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()

    def in_body(P, theta):
        c, s = math.cos(theta), math.sin(theta)
        R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        return R @ P @ R.T

    poses = [gtsam.Pose2(*p) for p in drive.poses]
    prior = gtsam.noiseModel.Gaussian.Covariance(in_body(START, drive.poses[0, 2]))
    graph.add(gtsam.PriorFactorPose2(0, poses[0], prior))
    for i, (x, y) in enumerate(PLACES):
        values.insert(1000 + i, np.array([x, y]))
        graph.add(gtsam.NonlinearEqualityPoint2(1000 + i, np.array([x, y])))
    distances, turns = increments_between(drive.poses)
    bearing_noise = gtsam.noiseModel.Isotropic.Sigma(1, 0.01)
    for k in range(n):
        values.insert(k, poses[k])
        if k > 0:
            motion = move(drive.poses[k - 1], distance=distances[k - 1], turn=turns[k - 1], model=MODEL)
            # A turn on the spot has noise in one direction only; GTSAM needs a little in the others.
            Q = in_body(motion.process_noise, drive.poses[k, 2]) + 1e-12 * np.eye(3)
            noise = gtsam.noiseModel.Gaussian.Covariance(Q)
            graph.add(gtsam.BetweenFactorPose2(k - 1, k, poses[k - 1].between(poses[k]), noise))
        for i in np.flatnonzero(seen[k]):
            bearing = poses[k].bearing(PLACES[i])
            graph.add(gtsam.BearingFactor2D(k, 1000 + i, bearing, bearing_noise))
        # The newest pose: what comes later must not improve it.
        theirs = gtsam.Marginals(graph, _only(gtsam, values, k)).marginalCovariance(k)
        expected = in_body(ours.covariance[k], drive.poses[k, 2])
        np.testing.assert_allclose(theirs, expected, rtol=1e-4, atol=1e-9)


def _only(gtsam, values, k):
    """Values of the poses up to k and of the landmarks."""
    out = gtsam.Values()
    for key in range(k + 1):
        out.insert(key, values.atPose2(key))
    for i, place in enumerate(PLACES):
        out.insert(1000 + i, place)
    return out
