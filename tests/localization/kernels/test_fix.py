"""Covariance of one fix against the printed equations; pan axes against a fine scan."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.kernels.fix import (
    information_covariance,
    pan_axis,
    triplet_covariance,
    triplet_fix,
    wrapped,
)
from localization.sensors import kernel_args
from tests import oracles
from tests.triplet_arrays import SENSORS


def inverted(point, landmarks):
    d = landmarks - point
    return d / (d**2).sum(axis=1, keepdims=True)


def symmetric(xx, xy, yy):
    return np.array([[xx, xy], [xy, yy]])


def test_madsen_1997_equation_5_multiplied_out(rng):
    for _ in range(100):
        point, three = rng.uniform(-5, 5, 2), rng.uniform(-5, 5, (3, 2))
        variances = rng.uniform(1e-6, 1e-4, 3)
        xx, xy, yy, heading, d = triplet_covariance(*inverted(point, three).ravel(), *variances, 0.0, 0.0)
        want = oracles.mas97_covariance(point, three, variances)
        np.testing.assert_allclose(symmetric(xx, xy, yy), want, rtol=1e-6, atol=1e-9 * want.max())
        full = oracles.information_covariance(point, three, variances)
        np.testing.assert_allclose(heading, full[2, 2], rtol=1e-6)
        w1, w2, w3 = 1 / variances
        assert 1 / (xx * yy - xy * xy) == pytest.approx(w1 * w2 * w3 / (w1 + w2 + w3) * d * d, rel=1e-6)


def test_both_forms_agree_to_rounding(rng):
    for _ in range(100):
        # Landmarks all around, so that both forms are well conditioned.
        angles = np.array([0.0, 2.0, 4.0]) + rng.uniform(-0.4, 0.4, 3)
        three = rng.uniform(1.0, 9.0, (3, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
        variances = rng.uniform(1e-6, 1e-4, 3)
        g = inverted(np.zeros(2), three)
        np.testing.assert_allclose(
            triplet_covariance(*g.ravel(), *variances, 0.0, 0.0)[:4],
            information_covariance(g, variances, 0.0, 0.0),
            rtol=1e-12,
        )


def test_information_of_many_landmarks(rng):
    point, landmarks = rng.uniform(-5, 5, 2), rng.uniform(-5, 5, (12, 2))
    variances = rng.uniform(1e-6, 1e-4, 12)
    xx, xy, yy, heading = information_covariance(inverted(point, landmarks), variances, 0.0, 0.0)
    want = oracles.information_covariance(point, landmarks, variances)
    np.testing.assert_allclose(
        [xx, xy, yy, heading], [want[0, 0], want[0, 1], want[1, 1], want[2, 2]], rtol=1e-9
    )


def test_more_landmarks_never_know_less(rng):
    point, landmarks = rng.uniform(-5, 5, 2), rng.uniform(-5, 5, (12, 2))
    g, variances = inverted(point, landmarks), rng.uniform(1e-6, 1e-4, 12)
    before = None
    for n in range(3, 13):
        xx, xy, yy, heading = information_covariance(g[:n], variances[:n], 0.0, 0.0)
        now = symmetric(xx, xy, yy)
        if before is not None:
            assert np.linalg.eigvalsh(before[0] - now).min() >= -1e-9 * np.trace(now)
            assert heading <= before[1] * (1 + 1e-12)
        before = (now, heading)


@pytest.mark.parametrize("radius", [0.3, 4.0, 50.0])
def test_danger_circle_gives_no_fix(rng, radius):
    angles = np.sort(rng.uniform(0, 2 * math.pi, 4))
    circle = radius * np.column_stack([np.cos(angles), np.sin(angles)]) + [3.0, -2.0]
    g = inverted(circle[0], circle[1:])
    assert np.isnan(triplet_covariance(*g.ravel(), 1e-6, 1e-6, 1e-6, 0.0, 0.0)[:4]).all()
    assert np.isnan(information_covariance(g, np.full(3, 1e-6), 0.0, 0.0)).all()


def test_two_bearings_give_no_fix():
    assert np.isnan(information_covariance(np.eye(2), np.ones(2), 0.0, 0.0)).all()


def test_robot_on_the_line_of_collinear_landmarks_gives_no_fix():
    g = inverted(np.array([1.0, 1.0]), np.array([[2.0, 2.0], [3.0, 3.0], [-1.0, -1.0]]))
    assert np.isnan(triplet_covariance(*g.ravel(), 1e-6, 1e-6, 1e-6, 0.0, 0.0)[:4]).all()


def test_wrapped():
    for angle in (-math.pi, 0.0, 1.0, math.pi, 3 * math.pi, -7.0, np.nextafter(-math.pi, -10)):
        assert -math.pi <= wrapped(angle) < math.pi
        assert math.cos(wrapped(angle)) == pytest.approx(math.cos(angle))
        assert math.sin(wrapped(angle)) == pytest.approx(math.sin(angle), abs=1e-12)


PANNED = [name for name, s in SENSORS.items() if s.kind == "pinhole_pan"]


@pytest.mark.parametrize("name", PANNED)
def test_axis_against_a_fine_scan(rng, name):
    sensor = SENSORS[name]
    seen = 0
    for _ in range(60):
        heading = 0.0 if sensor.has_free_pan else rng.uniform(-4, 4)
        middle = rng.uniform(-4, 4)
        three = middle + rng.uniform(-0.55, 0.55, 3) * sensor.field_of_view
        shares = rng.choice([0.0, 1e-5], 3)
        args = kernel_args(sensor, heading)
        relative = [wrapped(a - heading) for a in three]
        axis = pan_axis(*relative, *shares, args, 1e-12)
        axes, centre = oracles.axes_of_three(list(three), sensor, heading)
        if not axes:
            assert math.isnan(axis)
            continue
        seen += 1
        scale = sensor.column_sigma_px / sensor.focal_px

        def size(a, three=three, shares=shares, scale=scale):
            v = [(scale * math.cos(t - a) ** 2) ** 2 + s for t, s in zip(three, shares, strict=True)]
            return v[0] * v[1] + v[0] * v[2] + v[1] * v[2]

        offset = min((wrapped(a - heading - axis) for a in axes), key=abs)
        assert abs(offset) < 4e-3  # the axis is one of the allowed
        if sensor.pan_policy == "optimal":
            assert size(axis + heading) <= min(size(a) for a in axes) * (1 + 1e-9)
        else:
            nearest = min(abs(a - centre) for a in axes)
            assert abs(wrapped(axis + heading - centre)) == pytest.approx(nearest, abs=1e-9)
    assert seen > 3


def test_optimal_axis_can_lie_inside():
    # Two far apart and one between, in a very wide view: neither end is best.
    sensor = SENSORS["wide optimal"]
    args = kernel_args(sensor)
    axis = pan_axis(-0.9, 0.0, 0.9, 0.0, 0.0, 0.0, args, 1e-12)
    axes, _ = oracles.axes_of_three([-0.9, 0.0, 0.9], sensor, 0.0, steps=200_001)

    def size(a):
        v = [math.cos(b - a) ** 4 for b in (-0.9, 0.0, 0.9)]
        return v[0] * v[1] + v[0] * v[2] + v[1] * v[2]

    assert size(axis) <= min(map(size, axes)) * (1 + 1e-12)


@pytest.mark.parametrize("name", SENSORS)
def test_fix_of_a_triplet(rng, name):
    sensor = SENSORS[name]
    fixes = 0
    for _ in range(60):
        point, three = rng.uniform(-2, 2, 2), rng.uniform(-5, 5, (3, 2)) + np.array([7.0, 0.0])
        sigmas = rng.choice([0.0, 0.05], 3)
        heading = rng.uniform(-0.5, 0.5) if sensor.depends_on_heading else 0.0
        place = oracles.sensor_place(point, sensor, heading)
        xx, xy, yy, variance, pan = triplet_fix(
            place[0], place[1], 0, 1, 2, three, sigmas**2, kernel_args(sensor, heading)
        )
        want = oracles.fix_of_three(point, [tuple(m) for m in three], sigmas, sensor, heading)
        if want is None:
            muted = not all(oracles.is_measurable(place, m, sensor, heading) for m in three)
            assert math.isnan(xx) or (muted and sensor.kind == "omnidirectional")
            assert math.isnan(pan)
            continue
        fixes += 1
        got = symmetric(xx, xy, yy)
        # A scan finds the best axis to a thousandth, its covariance to second order.
        np.testing.assert_allclose(got, want[0], rtol=1e-3, atol=1e-3 * np.abs(want[0]).max())
        assert np.linalg.det(got) <= np.linalg.det(want[0]) * (1 + 1e-6)
        full = oracles.information_covariance(place, three, want[1])
        assert variance == pytest.approx(full[2, 2], rel=1e-2)
        if sensor.kind != "pinhole_pan":
            assert math.isnan(pan)
        else:
            assert -math.pi <= pan < math.pi
    assert fixes > 3
