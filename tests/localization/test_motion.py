"""Odometry: arcs, Jacobians, noise that adds up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.errors import LocalizationError
from localization.motion import OdometryModel, increments_between, move, wheel_increments
from maps.se2 import wrap
from tests.oracles import moved_by, numeric_jacobian

MODEL = OdometryModel(distance_sigma=0.03, turn_sigma=0.05, drift_sigma=0.02, slip_sigma=0.01)


def increments(rng, n):
    turns = rng.uniform(-3, 3, n)
    turns[::4] *= 1e-6
    turns[1::8] = 0.0
    return rng.uniform(-2, 2, n), turns


def test_poses_agree_with_small_pieces(rng):
    for d, w in zip(*increments(rng, 40), strict=True):
        pose = rng.uniform(-3, 3, 3)
        expected = moved_by(pose, d, w)
        np.testing.assert_allclose(move(pose, distance=d, turn=w).pose[:2], expected[:2], atol=2e-6)
        assert wrap(move(pose, distance=d, turn=w).pose[2] - expected[2]) == pytest.approx(0, abs=1e-12)


def test_jacobians_agree_with_central_differences(rng):
    distances, turns = increments(rng, 40)
    # Half the turns, away from the seam of the angle.
    for d, w in zip(distances, 0.5 * turns, strict=True):
        pose = np.array([*rng.uniform(-3, 3, 2), rng.uniform(-1, 1)])
        motion = move(pose, distance=d, turn=w, model=MODEL)
        F = numeric_jacobian(lambda q, d=d, w=w: move(q, distance=d, turn=w).pose, pose)
        np.testing.assert_allclose(motion.transition_matrix, F, atol=1e-8)
        G = numeric_jacobian(lambda q, pose=pose: moved_by(pose, *q), [d, w, 0.0])
        # The slip of the model shrinks with the arc's chord.
        G[:, 2] *= np.sinc(w / 2 / math.pi)
        np.testing.assert_allclose(motion.noise_gain, G, atol=1e-5)
        M = np.diag([0.03**2 * abs(d), 0.05**2 * abs(w) + 0.02**2 * abs(d), 0.01**2 * abs(d)])
        np.testing.assert_allclose(
            motion.process_noise, motion.noise_gain @ M @ motion.noise_gain.T, atol=1e-15
        )


def test_noise_adds_up_over_steps():
    """A step in a hundred parts has nearly the noise of the step, and more parts change little."""

    def driven(parts, d=2.0, w=0.8):
        pose, P = np.zeros(3), np.zeros((3, 3))
        for _ in range(parts):
            motion = move(pose, distance=d / parts, turn=w / parts, model=MODEL)
            P = motion.transition_matrix @ P @ motion.transition_matrix.T + motion.process_noise
            pose = motion.pose
        return pose, P

    pose_1, P_1 = driven(1)
    pose_100, P_100 = driven(100)
    _, P_200 = driven(200)
    np.testing.assert_allclose(pose_1, pose_100, atol=1e-12)
    assert P_100[2, 2] == pytest.approx(P_1[2, 2])
    assert np.trace(P_100[:2, :2]) == pytest.approx(np.trace(P_1[:2, :2]), rel=0.3)
    np.testing.assert_allclose(P_200, P_100, rtol=2e-3, atol=1e-9)


def test_standing_still_costs_nothing():
    assert not move([1.0, 2.0, 3.0], distance=0.0, turn=0.0, model=MODEL).process_noise.any()


def test_first_order_agrees_with_drives(rng):
    model = OdometryModel(distance_sigma=0.01, turn_sigma=0.02, drift_sigma=0.01, slip_sigma=0.005)
    motion = move([0.5, -1.0, 0.3], distance=1.5, turn=0.7, model=model)
    s = np.sqrt([0.01**2 * 1.5, 0.02**2 * 0.7 + 0.01**2 * 1.5, 0.005**2 * 1.5])
    draws = rng.normal(size=(20_000, 3)) * s
    ends = np.array([move([0.5, -1.0, 0.3], distance=1.5 + a, turn=0.7 + b).pose for a, b, _ in draws])
    ends += draws[:, 2:] * motion.noise_gain[:, 2]
    np.testing.assert_allclose(np.cov(ends.T), motion.process_noise, rtol=0.06, atol=2e-6)


def test_wheels_give_distance_and_turn():
    distance, turn = wheel_increments([0.9, 1.0], [1.1, 1.0], track=0.5)
    np.testing.assert_allclose(distance, [1.0, 1.0])
    np.testing.assert_allclose(turn, [0.4, 0.0], atol=1e-15)
    with pytest.raises(LocalizationError, match="Track is 0"):
        wheel_increments(1.0, 1.0, track=0.0)


def test_increments_lead_back_through_the_poses(rng):
    pose = np.array([0.3, 0.2, 3.0])
    poses = [pose]
    for d, w in zip(*increments(rng, 30), strict=True):
        poses.append(move(poses[-1], distance=d, turn=w).pose)
    distance, turn = increments_between(np.array(poses))
    for k in range(30):
        reached = move(poses[k], distance=distance[k], turn=turn[k]).pose
        np.testing.assert_allclose(reached, poses[k + 1], atol=1e-9)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_impossible_numbers_are_refused(value):
    with pytest.raises(LocalizationError, match="drift_sigma"):
        OdometryModel(drift_sigma=value)
    with pytest.raises(LocalizationError, match="finite"):
        move([0, 0, 0], distance=math.inf, turn=0)
    with pytest.raises(LocalizationError, match="Pose"):
        move([0, 0, math.nan], distance=1, turn=0)
