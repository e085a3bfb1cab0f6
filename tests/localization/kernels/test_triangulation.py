"""Closed form against plain formulas, round trips and finite differences."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from localization.kernels.triangulation import (
    DEGENERATE,
    MAX_COORDINATE,
    NO_POSE,
    NOT_FINITE,
    OK,
    OUTSIDE_IMAGE,
    fixes,
)
from tests import oracles

NO_CAMERA = np.empty(0)
CAMERA = np.array([512.0, 256.0, 512.0])


def run(measured, landmarks, variances=None, pan=0.0, camera=NO_CAMERA, least=1e-9):
    measured = np.atleast_2d(np.asarray(measured, float))
    n = len(measured)
    landmarks = np.asarray(landmarks, float)
    pose, status, reliability = np.full((n, 3), 7.7), np.full(n, 99, np.uint8), np.full(n, 7.7)
    covariance = np.full((0 if variances is None else n, 3, 3), 7.7)
    v = np.zeros((1, 3)) if variances is None else np.atleast_2d(np.asarray(variances, float))
    given = [
        measured,
        landmarks if landmarks.ndim == 3 else landmarks[None],
        v,
        np.atleast_1d(float(pan)),
        camera,
    ]
    for array in given:
        array.flags.writeable = False
    fixes(*given, least, pose, covariance, status, reliability)
    assert ((status == OK) == np.isfinite(pose).all(axis=1)).all()
    assert np.isnan(pose[status != OK]).all()
    if variances is not None:
        assert ((status == OK) == np.isfinite(covariance).all(axis=(1, 2))).all()
        assert np.isnan(covariance[status != OK]).all()
    return pose, covariance, status, reliability


def scenes(rng, n):
    poses = np.column_stack([rng.uniform(-8, 8, (n, 2)), rng.uniform(-math.pi, math.pi, n)])
    landmarks = rng.uniform(-8, 8, (n, 3, 2))
    return (
        poses,
        landmarks,
        np.array([oracles.bearings_from(p, m) for p, m in zip(poses, landmarks, strict=True)]),
    )


def assert_poses(got, want, tolerance):
    error = np.abs(got - want)
    error[:, 2] = np.abs([math.remainder(e, 2 * math.pi) for e in got[:, 2] - want[:, 2]])
    np.testing.assert_array_less(error, np.broadcast_to(tolerance, error.shape[::-1]).T)


def test_pose_to_bearings_and_back(rng):
    # More than two blocks.
    poses, landmarks, bearings = scenes(rng, 300)
    got, _, status, reliability = run(bearings, landmarks)
    assert (status == OK).all()
    assert_poses(got, poses, 1e-12 / reliability**2)
    assert ((reliability > 0) & (reliability <= 1)).all()
    assert ((got[:, 2] >= -math.pi) & (got[:, 2] < math.pi)).all()


def test_against_the_published_formulas_for_any_bearings(rng):
    # Random bearings: some admit a pose, some only modulo π.
    bearings, three = rng.uniform(-math.pi, math.pi, (300, 3)), rng.uniform(-8, 8, (3, 2))
    got, _, status, _ = run(bearings, three)
    found = [oracles.triangulated(b, three) for b in bearings]
    assert [w is None for w in found] == (status == NO_POSE).tolist()
    some = [i for i, w in enumerate(found) if w is not None]
    assert 20 < len(some) < 280
    assert_poses(got[some], np.array([found[i] for i in some]), 1e-7)


def test_one_set_of_landmarks_is_that_set_for_every_fix(rng):
    bearings, three = rng.uniform(-math.pi, math.pi, (290, 3)), rng.uniform(-8, 8, (3, 2))
    each = np.broadcast_to(three, (290, 3, 2)).copy()
    for one, other in zip(run(bearings, three, [1e-4] * 3), run(bearings, each, [1e-4] * 3), strict=True):
        np.testing.assert_array_equal(one, other)


def test_covariance_neither_changes_poses_nor_outcomes(rng):
    bearings, three = rng.uniform(-math.pi, math.pi, (200, 3)), rng.uniform(-8, 8, (3, 2))
    plain, full = run(bearings, three), run(bearings, three, [1e-4] * 3)
    for i in (0, 2, 3):
        np.testing.assert_array_equal(plain[i], full[i])


def test_order_of_landmarks_does_not_matter(rng):
    poses, landmarks, bearings = scenes(rng, 20)
    for order in itertools.permutations(range(3)):
        got, covariance, status, reliability = run(
            bearings[:, order], landmarks[:, order], [[1e-4, 2e-4, 5e-4][i] for i in order]
        )
        assert (status == OK).all()
        assert_poses(got, poses, 1e-12 / reliability**2)
        if order == (0, 1, 2):
            first = covariance
        np.testing.assert_allclose(covariance, first, rtol=1e-6, atol=1e-9 * np.abs(first).max())


def test_turns_of_bearings_do_not_matter(rng):
    poses, landmarks, bearings = scenes(rng, 20)
    turns = 2 * math.pi * rng.integers(-9, 10, bearings.shape)
    got, _, status, reliability = run(bearings + turns, landmarks)
    assert (status == OK).all()
    assert_poses(got, poses, 1e-11 / reliability**2)


def test_covariance_is_the_inverse_information(rng):
    poses, landmarks, bearings = scenes(rng, 60)
    variances = rng.uniform(1e-6, 1e-4, (60, 3))
    _, covariance, _, reliability = run(bearings, landmarks, variances)
    for i in np.flatnonzero(reliability > 1e-2):
        want = oracles.information_covariance(poses[i, :2], landmarks[i], variances[i])
        np.testing.assert_allclose(covariance[i], want, rtol=1e-6, atol=1e-8 * np.abs(want).max())
        np.testing.assert_array_equal(covariance[i], covariance[i].T)
        assert np.linalg.eigvalsh(covariance[i])[0] > -1e-15 * np.abs(want).max()


def test_covariance_by_finite_differences(rng):
    _, landmarks, bearings = scenes(rng, 20)
    _, covariance, _, reliability = run(bearings, landmarks, [1.0, 2.0, 3.0])
    h = 1e-6
    for i in np.flatnonzero(reliability > 0.05):
        columns = []
        for k in range(3):
            step = np.eye(3)[k] * h
            ends, _, _, _ = run([bearings[i] + step, bearings[i] - step], landmarks[i])
            difference = ends[0] - ends[1]
            difference[2] = math.remainder(difference[2], 2 * math.pi)
            columns.append(difference / (2 * h))
        jacobian = np.array(columns).T
        want = jacobian @ np.diag([1.0, 2.0, 3.0]) @ jacobian.T
        np.testing.assert_allclose(covariance[i], want, rtol=1e-3, atol=1e-5 * np.abs(want).max())


@pytest.mark.parametrize("t", [-2.5, -0.3, 0.2, 0.5, 0.9, 1.7])
@pytest.mark.parametrize("pair", [(0, 1), (1, 2), (0, 2)])
def test_robot_in_line_with_two_landmarks(t, pair):
    three = np.array([[0.0, 0.0], [4.0, 1.0], [1.0, 5.0]])
    place = (1 - t) * three[pair[0]] + t * three[pair[1]]
    pose = np.array([[*place, 0.7]])
    got, covariance, status, _ = run(oracles.bearings_from(pose[0], three), three, [1e-4] * 3)
    assert status == OK
    assert_poses(got, pose, 1e-13)
    want = oracles.information_covariance(place, three, [1e-4] * 3)
    np.testing.assert_allclose(covariance[0], want, rtol=1e-9, atol=1e-12 * np.abs(want).max())


@pytest.mark.parametrize("k", range(3))
def test_robot_at_a_landmark(k):
    three = np.array([[0.0, 0.0], [4.0, 1.0], [1.0, 5.0]])
    for heading in (0.0, 0.7, 2.5):
        bearings = np.array(oracles.bearings_from((*three[k], heading), three))
        for any_bearing in (-2.0, 0.3, 1.9):
            bearings[k] = any_bearing
            assert run(bearings, three)[2] == DEGENERATE
    # A millimetre away all is well.
    pose = np.array([[three[k, 0] + 1e-3, three[k, 1], 0.7]])
    got, _, status, _ = run(oracles.bearings_from(pose[0], three), three)
    assert status == OK
    assert_poses(got, pose, 1e-12)


def test_danger_circle():
    centre, radius = np.array([3.0, -1.0]), 4.0

    def at(degrees, r=radius):
        return centre + r * np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])

    three = np.array([at(60), at(100), at(170)])
    for degrees in (0, 80, 130, 200, 290):
        on = oracles.bearings_from((*at(degrees), 0.4), three)
        assert run(on, three)[2] == DEGENERATE
        before = 1.0
        for offset in (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
            pose = np.array([[*at(degrees, radius + offset), 0.4]])
            got, _, status, reliability = run(oracles.bearings_from(pose[0], three), three)
            assert status == OK
            # Error and reliability go with the distance to the circle.
            assert_poses(got, pose, 1e-12 / offset)
            assert reliability < before
            before = reliability
        assert before == pytest.approx(1e-6 / radius, rel=30)
        assert run(oracles.bearings_from((*at(degrees, radius + 0.1), 0.4), three), three, least=0.9)[2] == 1


def test_landmarks_in_line():
    three = np.array([[0.0, 0.0], [1.0, 0.5], [4.0, 2.0]])
    pose = np.array([[2.0, -3.0, 1.0]])
    got, _, status, _ = run(oracles.bearings_from(pose[0], three), three)
    assert status == OK
    assert_poses(got, pose, 1e-13)
    # On their own line all bearings are equal or opposite.
    for x in (-2.0, 0.5, 3.0, 6.0):
        assert run(oracles.bearings_from((x, x / 2, 0.3), three), three)[2] == DEGENERATE


def test_coincident_landmarks(rng):
    for i, j in itertools.combinations(range(3), 2):
        three = rng.uniform(-5, 5, (3, 2)) + 1e3
        three[j] = three[i]
        assert (run(rng.uniform(-3, 3, (20, 3)), three, [1e-4] * 3)[2] == DEGENERATE).all()
    assert (run(rng.uniform(-3, 3, (20, 3)), np.ones((3, 2)))[2] == DEGENERATE).all()


def test_a_bearing_turned_round_admits_no_pose(rng):
    poses, landmarks, bearings = scenes(rng, 40)
    for k in range(3):
        turned = bearings.copy()
        turned[:, k] += math.pi
        assert (run(turned, landmarks)[2] == NO_POSE).all()
    # All three turned: the same robot facing backwards.
    got, _, status, reliability = run(bearings + math.pi, landmarks)
    assert (status == OK).all()
    assert_poses(got, poses - [0, 0, math.pi], 1e-12 / reliability**2)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, 1.1e5])
def test_numbers_that_are_none(bad, rng):
    _, landmarks, bearings = scenes(rng, 3)
    for k in range(3):
        measured = bearings.copy()
        measured[1, k] = bad
        _, _, status, reliability = run(measured, landmarks, [1e-4] * 3)
        assert status.tolist() == [OK, NOT_FINITE, OK]
        assert np.isnan(reliability).tolist() == [False, True, False]
    if abs(bad) < MAX_COORDINATE:
        return
    for k, axis in itertools.product(range(3), range(2)):
        moved = landmarks.copy()
        moved[1, k, axis] = bad
        assert run(bearings, moved, [1e-4] * 3)[2].tolist() == [OK, NOT_FINITE, OK]


@pytest.mark.parametrize("scale", [1e-150, 1e-60, 1e-9, 1e9, 1e10])
def test_any_scale(scale, rng):
    # `run` checks that nothing is NaN without a flag; small triangles lose precision, not truth.
    poses, landmarks, bearings = scenes(rng, 20)
    got, _, status, reliability = run(bearings, landmarks * scale, [1e-4] * 3)
    if scale > 1e-100:
        assert (status == OK).all()
        assert_poses(got / [scale, scale, 1.0], poses, 1e-12 / reliability**2)


def test_nothing_is_nan_without_a_flag(rng):
    values = [
        0.0,
        math.pi,
        -math.pi,
        math.pi / 2,
        1e-300,
        1e-17,
        1e-9,
        1.0,
        3.0,
        1e5,
        1e12,
        math.nan,
        math.inf,
    ]
    measured = rng.choice(values, (400, 3))
    landmarks = rng.choice(values[:-1], (400, 3, 2))
    _, _, status, _ = run(measured, landmarks, [1e-4] * 3)
    assert {OK, DEGENERATE, NO_POSE, NOT_FINITE} == set(status.tolist())
    run(rng.choice([*values, 256.0, 512.0, 100.0], (400, 3)), landmarks, [1e-4] * 3, camera=CAMERA)


def test_columns_are_bearings(rng):
    three = np.array([[0.0, 8.0], [2.0, 9.0], [3.5, 7.0]])
    poses = np.column_stack([rng.uniform(0, 3, (30, 2)), rng.uniform(-3, 3, 30)])
    psi = np.array([oracles.bearings_from((x, y, math.pi / 2), three) for x, y, _ in poses])
    columns = 256.0 - 512.0 * np.tan(psi)
    wide = np.array([512.0, 256.0, math.inf])
    pan = poses[:, 2]
    seen = psi - pan[:, None]
    variances = (0.01 * np.cos(psi) ** 2) ** 2
    want = run(seen, three, variances)
    given = [columns, three[None], np.full((1, 3), 1e-4), -pan, wide]
    for array in given:
        array.flags.writeable = False
    pose, covariance = np.empty((30, 3)), np.empty((30, 3, 3))
    status, reliability = np.empty(30, np.uint8), np.empty(30)
    fixes(*given, 1e-9, pose, covariance, status, reliability)
    np.testing.assert_allclose(pose, want[0], rtol=1e-10)
    np.testing.assert_allclose(covariance, want[1], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(reliability, want[3], rtol=1e-10)


def test_columns_outside_the_image():
    three = np.array([[0.0, 8.0], [2.0, 9.0], [3.5, 7.0]])
    columns = np.array(
        [[0.0, 200.0, 512.0], [-0.1, 200.0, 300.0], [10.0, 200.0, 512.1], [10.0, math.nan, 30.0]]
    )
    _, _, status, reliability = run(columns, three, [1e-4] * 3, camera=CAMERA)
    assert status[1:].tolist() == [OUTSIDE_IMAGE, OUTSIDE_IMAGE, NOT_FINITE]
    assert status[0] in (OK, NO_POSE)
    assert np.isnan(reliability[1:]).all()
    assert run(columns[:1], three, pan=math.nan, camera=CAMERA)[2] == NOT_FINITE
