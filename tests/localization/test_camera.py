"""Columns and bearings: signs, edges, impossible numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.camera import BehindCamera, Camera, ColumnOutsideImage
from localization.errors import InvalidSensor
from localization.sensors import MAS97_CAMERA, PinholePanSensor

CAMERA = Camera(500.0, 300.0, 640.0)


def test_columns_grow_to_the_right_and_bearings_to_the_left():
    assert CAMERA.columns(0.0) == 300.0
    assert CAMERA.columns(0.1) < 300.0
    assert CAMERA.bearings(640.0) == pytest.approx(-math.atan(340 / 500))
    assert CAMERA.bearings(0.0) == pytest.approx(math.atan(300 / 500))


def test_columns_and_back(rng):
    columns = rng.uniform(0, 640, (7, 3))
    np.testing.assert_allclose(CAMERA.columns(CAMERA.bearings(columns)), columns, rtol=1e-12)


def test_madsen_1997_camera():
    # §2: 512 columns over 53.13°.
    camera = Camera.from_sensor(MAS97_CAMERA)
    assert camera.width_px == pytest.approx(512.0)
    assert camera.principal_px == pytest.approx(256.0)
    half = 0.5 * MAS97_CAMERA.field_of_view
    np.testing.assert_allclose(camera.columns([half, -half]), [0.0, 512.0], atol=1e-9)
    assert Camera.from_sensor(MAS97_CAMERA, principal_px=250.0).principal_px == 250.0


def test_sigma_of_a_bearing():
    sensor = PinholePanSensor(1.0, 500.0, 2.0)
    camera = Camera.from_sensor(sensor)
    bearings = np.array([-0.4, 0.0, 0.3])
    got = camera.bearing_sigma(camera.columns(bearings), sensor.column_sigma_px)
    np.testing.assert_allclose(got, 2.0 * np.cos(bearings) ** 2 / 500.0)
    step = 1e-4
    slope = np.abs(camera.bearings(200.0 + step) - camera.bearings(200.0 - step)) / (2 * step)
    assert camera.bearing_sigma(200.0, 1.0) == pytest.approx(slope, rel=1e-6)


def test_edges_of_the_image():
    np.testing.assert_array_equal(
        CAMERA.inside([-0.1, 0.0, 640.0, 640.1, math.nan]), [False, True, True, False, False]
    )
    np.testing.assert_array_equal(Camera(500.0).inside([-1e6, math.inf, math.nan]), [True, False, False])
    with pytest.raises(ColumnOutsideImage, match=r"2 of 3 .* first is -1\.0; they must be from 0 to 640 px"):
        CAMERA.bearings([-1.0, 5.0, 641.0])
    with pytest.raises(ColumnOutsideImage, match="must be finite"):
        Camera(500.0).bearings(math.nan)


@pytest.mark.parametrize("bearing", [math.pi / 2, -math.pi / 2, 3.0, math.nan])
def test_behind_the_camera(bearing):
    with pytest.raises(BehindCamera, match="1 of 2"):
        CAMERA.columns([0.1, bearing])


@pytest.mark.parametrize(
    ("numbers", "name"),
    [
        ((0.0,), "focal_px"),
        ((-1.0,), "focal_px"),
        ((math.nan,), "focal_px"),
        ((math.inf,), "focal_px"),
        ((500.0, math.nan), "principal_px"),
        ((500.0, 10.0, 0.0), "width_px"),
        ((500.0, 10.0, math.inf), "width_px"),
        ((500.0, 700.0, 640.0), "principal_px"),
        ((500.0, -1.0, 640.0), "principal_px"),
    ],
)
def test_impossible_cameras(numbers, name):
    with pytest.raises(InvalidSensor, match=name):
        Camera(*numbers)
