"""JSON at the doors."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from api import answers_plan
from api.codec import (
    DocumentError,
    parse_json,
    plan_to_json,
    read_json_file,
    sensor_from_json,
    sensor_to_json,
    to_json_bytes,
)
from localization.errors import InvalidSensor
from localization.sensors import PRESETS, Mount, OmnidirectionalSensor, PinholeFixedSensor, PinholePanSensor
from planner.problem import PlanningProblem
from planner.result import PlanResult, PlanStatus
from tests.api.answers_by_hand import plan_by_hand
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

SENSORS = [
    *PRESETS.values(),
    OmnidirectionalSensor(0.1),
    OmnidirectionalSensor(
        0.1, bearing_floor=0.01, muted=((2.9, -2.9), (1.0, 1.1)), mount=Mount(0.2, -0.1, 7.0)
    ),
    OmnidirectionalSensor(0.1, muted=((math.radians(170), math.radians(-170)),)),
    PinholePanSensor(1.0, 500.0, 2.0, pan_min=-0.3, pan_max=0.1, max_range=7.5, pan_policy="optimal"),
    PinholePanSensor(1.0, 500.0, 2.0, bearing_floor=1 / 3, mount=Mount(0.1, 0.0, -math.pi)),
    PinholeFixedSensor(1.0, 500.0, 2.0, min_range=0.7, bearing_floor=0.1, mount=Mount(0.0, 1 / 3, 0.7)),
]
CAMERA = {"kind": "pinhole_fixed", "fov_deg": 90, "focal_px": 500, "column_sigma_px": 1}
LASER = {"kind": "omnidirectional", "bearing_sigma_deg": 0.1}


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda s: s.kind)
def test_a_sensor_comes_back_bit_for_bit(sensor):
    text = json.dumps(sensor_to_json(sensor), allow_nan=False)
    assert sensor_from_json(json.loads(text)) == sensor


def test_degrees_are_taken_at_the_door():
    sensor = sensor_from_json(
        {"kind": "pinhole_pan", "fov_deg": 90.0, "focal_px": 500, "column_sigma_px": 1, "pan_max_deg": 45}
    )
    assert sensor.field_of_view == math.radians(90.0)
    assert sensor.pan_max == math.radians(45)
    assert sensor.pan_min == -math.pi


def test_mounts_sectors_and_floors_are_taken_in_degrees():
    scanner = sensor_from_json(
        {
            **LASER,
            "bearing_floor_deg": 0.05,
            "muted": [{"begin_deg": 170, "end_deg": -170}, {"begin_rad": 1, "end_rad": 1.5}],
            "mount": {"x_m": 0.2, "theta_deg": 90},
        }
    )
    assert scanner.bearing_floor == math.radians(0.05)
    assert scanner.muted == ((math.radians(170), math.radians(-170)), (1.0, 1.5))
    assert scanner.mount == Mount(0.2, 0.0, math.radians(90))
    camera = sensor_from_json({**CAMERA, "mount": {"x_m": 0.2, "y_m": 0, "theta_rad": 0}})
    assert camera == PinholeFixedSensor(math.radians(90), 500.0, 1.0, mount=Mount(0.2))


@pytest.mark.parametrize(
    ("obj", "word"),
    [
        (None, "dictionary"),
        ([], "dictionary"),
        ({}, "kind"),
        ({"kind": "sonar"}, "omnidirectional"),
        ({"kind": "omnidirectional"}, "bearing_sigma_deg"),
        ({"kind": "omnidirectional", "bearing_sigma_deg": -1.0}, "bearing_sigma_deg"),
        ({"kind": "omnidirectional", "bearing_sigma_deg": math.nan}, "finite"),
        ({"kind": "omnidirectional", "bearing_sigma_deg": "1"}, "number"),
        ({"kind": "omnidirectional", "bearing_sigma_deg": True}, "number"),
        ({"kind": "omnidirectional", "bearing_sigma_deg": 1.0, "bearing_sigma_rad": 0.1}, "not both"),
        ({"kind": "omnidirectional", "bearing_sigma_deg": 200.0}, "bearing_sigma"),
        ({"kind": "omnidirectional", "bearing_sigma_deg": 1.0, "colour": 1}, "colour"),
        (
            {"kind": "omnidirectional", "bearing_sigma_deg": 1.0, "min_range_m": 5, "max_range_m": 4},
            "max_range",
        ),
        ({**LASER, "bearing_floor_deg": -0.1}, "bearing_floor_deg is -0.1"),
        ({**LASER, "bearing_floor_deg": 180}, "bearing_floor_deg is 180"),
        ({**LASER, "bearing_floor_deg": 0.1, "bearing_floor_rad": 0.1}, "not both"),
        ({**LASER, "mount": 0.2}, "mount is 0.2"),
        ({**LASER, "mount": {"x_m": math.nan}}, "mount.x_m is nan"),
        ({**LASER, "mount": {"x_m": 200}}, "mount.x_m is 200"),
        ({**LASER, "mount": {"x_m": 90, "y_m": 90}}, "mount arm is 127"),
        ({**LASER, "mount": {"x": 1}}, "mount.x is 1"),
        (
            {**LASER, "mount": {"theta_rad": 1, "theta_deg": 1}},
            "mount: give theta_deg or theta_rad, not both",
        ),
        ({**LASER, "mount": {"theta_deg": math.inf}}, "mount.theta_deg is inf"),
        ({**LASER, "muted": {"begin_deg": 1, "end_deg": 2}}, "muted: .*list"),
        ({**LASER, "muted": [{"begin_deg": 1}]}, "muted.0: give begin_deg and end_deg"),
        ({**LASER, "muted": [{"begin_deg": 1, "end_rad": 2}]}, "begin_rad and end_rad"),
        ({**LASER, "muted": [{"begin_deg": 1, "begin_rad": 1, "end_rad": 2}]}, "begin_rad and end_rad"),
        ({**LASER, "muted": [{"begin_deg": 0, "end_deg": 400}]}, "muted.0.end_deg is 400"),
        ({**LASER, "muted": [{"begin_deg": 190, "end_deg": -170}]}, "empty or the whole turn"),
        ({**LASER, "muted": [{"begin_rad": 1, "end_rad": 1}]}, "empty or the whole turn"),
        ({**LASER, "muted": [{"begin_deg": 1, "end_deg": 2}] * 65}, "muted: .*64"),
        ({**CAMERA, "muted": []}, "muted"),
        ({**CAMERA, "fov_deg": 180}, "fov_deg is 180: .*less than 180"),
        ({**CAMERA, "fov_rad": 1}, "give fov_deg or fov_rad, not both"),
        ({**CAMERA, "fov_deg": None}, "give fov_deg or fov_rad"),
        ({**CAMERA, "focal_px": 0}, "focal_px is 0"),
        ({**CAMERA, "column_sigma_px": 5000}, "column_sigma_px / focal_px"),
        ({**CAMERA, "pan_min_deg": 0}, "pan_min_deg"),
        ({**CAMERA, "kind": "pinhole_pan", "pan_max_deg": 181}, "pan_max_deg is 181"),
        ({**CAMERA, "kind": "pinhole_pan", "pan_min_deg": 20, "pan_max_deg": 10}, "pan_max"),
    ],
)
def test_wrong_sensors_are_named(obj, word):
    with pytest.raises(InvalidSensor, match=word):
        sensor_from_json(obj)


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (b"", "not JSON"),
        (b"{", "line 1"),
        (b"\xff\xfe", "UTF-8"),
        (b'{"a": NaN}', "NaN"),
        (b"[Infinity]", "Infinity"),
        (b"[" * 100_000, "nested"),
        (b"[" * 40 + b"]" * 40, "nested"),
        (b"1" * 10_000, "digits"),
    ],
    ids=["empty", "cut", "bytes", "nan", "infinity", "deep", "deeper than 32", "digits"],
)
def test_what_is_not_json_is_refused(data, word):
    with pytest.raises(DocumentError, match=word):
        parse_json(data)


def test_32_levels_are_allowed():
    assert parse_json(b"[" * 32 + b"]" * 32)
    with pytest.raises(DocumentError):
        parse_json(b"[" * 33 + b"]" * 33)


def test_a_file_must_be_there_small_and_an_object(tmp_path):
    with pytest.raises(DocumentError, match="no sensor"):
        read_json_file(tmp_path / "missing.json", what="sensor")
    (tmp_path / "list.json").write_text("[1]")
    with pytest.raises(DocumentError, match="object"):
        read_json_file(tmp_path / "list.json")
    (tmp_path / "large.json").write_text('"' + "x" * 1_000_001 + '"')
    with pytest.raises(DocumentError, match="larger"):
        read_json_file(tmp_path / "large.json")
    (tmp_path / "good.json").write_text('{"a": 1}', encoding="utf-8-sig")
    assert read_json_file(tmp_path / "good.json") == {"a": 1}


def test_texts_that_are_not_unicode_still_encode():
    assert to_json_bytes({"a": "\ud800"}) == b'{"a":"\\ud800"}'
    with pytest.raises(ValueError, match="JSON"):
        to_json_bytes(math.nan)


def plan_on(field, **kind) -> tuple[PlanResult, object, PlanningProblem]:
    """A plan made by hand with its question."""
    start, goal = (0.25, 0.75), (2.25, 0.75)
    return plan_by_hand(start, goal, **kind), field, PlanningProblem(start, goal, 0.2)


def _plan(blind: bool = False) -> tuple[PlanResult, object, PlanningProblem]:
    return plan_on(synthetic_field(world_from_ascii("A....\n.....\nB...C")), blind=blind)


@pytest.mark.parametrize("blind", [False, True])
def test_a_plan_says_everything_and_matches_its_schema(blind):
    result, field, problem = _plan(blind)
    answer = plan_to_json(result, field, problem=problem, client_ref="order-17", warnings=["clamped"])
    json.dumps(answer, allow_nan=False)
    answers_plan.Plan.model_validate(answer, strict=True)
    assert answer["warnings"] == ["clamped", "note"]
    assert answer["map"] == "m_" + field.world.content_hash()
    assert answer["request"]["robot"]["radius_m"] == 0.2
    assert "seconds" not in json.dumps(answer), "times of computation do not belong to the answer"
    waypoint = answer["routes"][0]["path"][1]
    assert waypoint["t_s"] == pytest.approx(1.0)
    if blind:
        assert waypoint["covariance"] is waypoint["triplet"] is waypoint["ellipse95"] is None
        assert waypoint["covariance_of"] is None
        assert answer["routes"][0]["uncertainty"]["mean_r95_m"] is None
    else:
        assert waypoint["covariance"] == [0.01, 0.002, 0.02]
        assert waypoint["covariance_of"] == "fix"
        assert waypoint["triplet"] == ["A", "B", "C"]


def test_whose_a_covariance_is_and_how_much_dearer_than_the_grid_the_route():
    result, field, problem = _plan()
    route = result.route
    known = np.arange(len(route.path.s)) != 1
    path = replace(route.path, has_fix=known)
    summary = replace(route.summary, cost=2.2, longest_blind=0.75)
    made = replace(result, route=replace(route, path=path, summary=summary), grid_cost=2.0)
    answer = plan_to_json(made, field, problem=problem)
    answers_plan.Plan.model_validate(answer, strict=True)
    waypoints = answer["routes"][0]["path"]
    assert [w["covariance_of"] for w in waypoints] == ["fix" if k else "dead_reckoning" for k in known]
    assert waypoints[1]["covariance"] is not None
    assert answer["gap"] == pytest.approx(0.1)
    assert answer["routes"][0]["uncertainty"]["longest_blind_m"] == 0.75
    for unknown in (replace(made, grid_cost=None), replace(made, route=None)):
        assert plan_to_json(unknown, field, problem=problem)["gap"] is None
    lost = replace(made, route=replace(made.route, summary=replace(summary, cost=math.inf)))
    assert plan_to_json(lost, field, problem=problem)["gap"] is None


def test_the_id_of_a_plan_is_its_content():
    result, field, problem = _plan()
    one = plan_to_json(result, field, problem=problem)
    two = plan_to_json(result, field, problem=problem)
    other = plan_to_json(result, field, problem=problem, client_ref="x")
    assert one == two
    assert one["plan"] != other["plan"]


def test_a_plan_without_a_route_has_empty_routes():
    _, field, problem = _plan()
    answer = plan_to_json(
        PlanResult(PlanStatus.NO_PATH, None, None, None, "grid_search"), field, problem=problem
    )
    answers_plan.Plan.model_validate(answer, strict=True)
    assert answer["routes"] == []
    assert answer["shortest_baseline"] is None
