"""Sensor models."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from localization.errors import InvalidSensor
from localization.sensors import (
    FORWARD_CAMERA,
    LASER,
    MAS97_CAMERA,
    PRESETS,
    Mount,
    OmnidirectionalSensor,
    PinholePanSensor,
    kernel_args,
    sensor_from_dict,
    sensor_hash,
    sensor_to_dict,
)

LIMITED = replace(MAS97_CAMERA, pan_min=-1.0, pan_max=2.0, pan_policy="optimal", max_range=12.0)


def test_madsen_1997_camera():
    # 512 columns over 53.13° with a 6 mm lens before a 6 mm chip.
    assert math.degrees(MAS97_CAMERA.field_of_view) == pytest.approx(53.13, abs=0.005)
    assert 2 * MAS97_CAMERA.focal_px * math.tan(MAS97_CAMERA.field_of_view / 2) == pytest.approx(512)


@pytest.mark.parametrize("sensor", [LASER, MAS97_CAMERA, LIMITED, OmnidirectionalSensor(0.1, 1.0, 3.0)])
def test_round_trip_through_json(sensor):
    again = sensor_from_dict(json.loads(json.dumps(sensor_to_dict(sensor))))
    assert again == sensor
    assert sensor_hash(again) == sensor_hash(sensor)
    assert pickle.loads(pickle.dumps(sensor)) == sensor


def test_hash_changes_with_every_number():
    seen = {sensor_hash(s) for s in (LASER, MAS97_CAMERA, LIMITED)}
    for name, value in {
        "field_of_view": 1.0,
        "focal_px": 511.0,
        "column_sigma_px": 4.0,
        "pan_min": -0.5,
        "pan_max": 0.5,
        "min_range": 0.1,
        "max_range": 20.0,
        "pan_policy": "centred",
    }.items():
        seen.add(sensor_hash(replace(LIMITED, **{name: value})))
    assert len(seen) == 3 + 8


@pytest.mark.parametrize(
    ("kind", "bad", "names"),
    [
        (OmnidirectionalSensor, {"bearing_sigma": 0.0}, "bearing_sigma"),
        (OmnidirectionalSensor, {"bearing_sigma": -0.1}, "bearing_sigma"),
        (OmnidirectionalSensor, {"bearing_sigma": math.nan}, "bearing_sigma"),
        (OmnidirectionalSensor, {"bearing_sigma": math.inf}, "bearing_sigma"),
        (OmnidirectionalSensor, {"bearing_sigma": 1e-200}, "bearing_sigma"),
        (OmnidirectionalSensor, {"min_range": -1.0}, "min_range"),
        (OmnidirectionalSensor, {"min_range": 5.0, "max_range": 5.0}, "max_range"),
        (OmnidirectionalSensor, {"max_range": math.nan}, "max_range"),
        (PinholePanSensor, {"field_of_view": math.pi}, "field_of_view"),
        (PinholePanSensor, {"field_of_view": 0.0}, "field_of_view"),
        (PinholePanSensor, {"focal_px": 0.0}, "focal_px"),
        (PinholePanSensor, {"focal_px": math.inf}, "focal_px"),
        (PinholePanSensor, {"column_sigma_px": -5.0}, "column_sigma_px"),
        (PinholePanSensor, {"column_sigma_px": 1e9}, "column_sigma_px / focal_px"),
        (PinholePanSensor, {"column_sigma_px": 1e-200}, "column_sigma_px / focal_px"),
        (PinholePanSensor, {"pan_min": -4.0}, "pan_min"),
        (PinholePanSensor, {"pan_min": 1.0, "pan_max": 0.0}, "pan_max"),
        (PinholePanSensor, {"pan_max": math.nan}, "pan_max"),
        (PinholePanSensor, {"pan_policy": "best"}, "pan_policy"),
    ],
)
def test_impossible_numbers_are_named(kind, bad, names):
    good = (
        {"bearing_sigma": 0.01}
        if kind is OmnidirectionalSensor
        else {"field_of_view": 1.0, "focal_px": 500.0, "column_sigma_px": 1.0}
    )
    with pytest.raises(InvalidSensor, match=names):
        kind(**{**good, **bad})


def test_unknown_kinds_and_names_are_refused():
    with pytest.raises(InvalidSensor, match="kind"):
        sensor_from_dict({"kind": "radar"})
    with pytest.raises(InvalidSensor, match="no 'colour'"):
        sensor_from_dict({"kind": "omnidirectional", "bearing_sigma": 0.1, "colour": 1})


def test_only_pan_limits_make_the_heading_matter():
    assert not LASER.depends_on_heading
    assert not MAS97_CAMERA.depends_on_heading
    assert MAS97_CAMERA.has_free_pan
    assert LIMITED.depends_on_heading


def test_kernel_args():
    assert kernel_args(LASER)[:2].tolist() == [0.0, math.radians(0.1) ** 2]
    assert kernel_args(MAS97_CAMERA)[0] == 1.0
    assert kernel_args(replace(LIMITED, pan_policy="centred"))[0] == 2.0
    args = kernel_args(LIMITED, 0.3)
    assert args.tolist() == [
        3.0,
        (5 / 512) ** 2,
        LIMITED.field_of_view,
        -1.0,
        2.0,
        0.3,
        math.cos(LIMITED.field_of_view),
        *[0.0] * 6,
    ]
    mounted = OmnidirectionalSensor(0.1, bearing_floor=0.2, muted=((3.0, -3.0),), mount=Mount(1.0, 0.5, 0.25))
    args = kernel_args(mounted, math.pi / 2, "trace")
    assert args[5] == math.pi / 2 + 0.25
    # The sensor is half a metre to the right of and a metre ahead of a robot that looks along y.
    want = [0.04, 2.0, math.hypot(1.0, 0.5), -1.0, -0.5, 1.0, 3.0, 2 * math.pi - 6.0]
    np.testing.assert_allclose(args[7:], want)
    with pytest.raises(InvalidSensor, match="'best'"):
        kernel_args(LASER, criterion="best")


def test_mounted_sensors_depend_on_the_heading():
    assert not LASER.depends_on_heading
    assert not replace(LASER, mount=Mount(theta=1.0)).depends_on_heading
    assert replace(LASER, mount=Mount(x=0.1)).depends_on_heading
    assert replace(LASER, muted=((0.0, 1.0),)).depends_on_heading
    assert not MAS97_CAMERA.depends_on_heading
    assert replace(MAS97_CAMERA, mount=Mount(y=0.1)).depends_on_heading
    assert FORWARD_CAMERA.depends_on_heading


ODD = [
    replace(LASER, bearing_floor=0.001, muted=((2.0, -2.0), (0.1, 0.2)), mount=Mount(0.2, -0.1, 3.0)),
    replace(FORWARD_CAMERA, max_range=12.0, mount=Mount(0.3)),
    replace(MAS97_CAMERA, bearing_floor=0.002, mount=Mount(theta=1.0)),
]


@pytest.mark.parametrize("sensor", ODD)
def test_new_parts_survive_json(sensor):
    values = json.loads(json.dumps(sensor_to_dict(sensor)))
    again = sensor_from_dict(values)
    assert again == sensor
    assert sensor_hash(again) == sensor_hash(sensor)
    for other in (LASER, MAS97_CAMERA, FORWARD_CAMERA, *(o for o in ODD if o != sensor)):
        assert sensor_hash(other) != sensor_hash(sensor)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Mount(x=math.nan), "mount.x is nan"),
        (lambda: Mount(x=200.0), "at most 100 m"),
        (lambda: replace(LASER, bearing_floor=-0.1), "bearing_floor is -0.1"),
        (lambda: replace(LASER, muted=((0.0, 7.0),)), "within ±2π"),
        (lambda: replace(LASER, muted=((1.0, 1.0),)), "apart from where it begins"),
        (lambda: replace(FORWARD_CAMERA, field_of_view=math.pi), "below π"),
        (lambda: replace(FORWARD_CAMERA, min_range=3.0, max_range=2.0), "max_range is 2"),
        (lambda: sensor_from_dict({"kind": "pinhole_fixed"}), "incomplete"),
        (
            lambda: sensor_from_dict({"kind": "omnidirectional", "bearing_sigma": 0.1, "mount": 3}),
            "malformed",
        ),
    ],
)
def test_impossible_new_parts(make, words):
    with pytest.raises(InvalidSensor, match=words):
        make()


def test_offset_turns_with_the_robot():
    np.testing.assert_allclose(Mount(1.0, 0.5).offset(math.pi / 2), (-0.5, 1.0), atol=1e-15)


def test_presets():
    assert set(PRESETS) == {"mas97", "laser", "forward"}
