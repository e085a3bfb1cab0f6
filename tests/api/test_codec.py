"""JSON at the doors."""

from __future__ import annotations

import json
import math

import pytest

from api import answers
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
from localization.sensors import PRESETS, OmnidirectionalSensor, PinholePanSensor
from planner.problem import PlanningProblem
from planner.result import PlanResult, PlanStatus
from tests.api.answers_by_hand import plan_by_hand
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

SENSORS = [
    *PRESETS.values(),
    OmnidirectionalSensor(0.1),
    PinholePanSensor(1.0, 500.0, 2.0, pan_min=-0.3, pan_max=0.1, max_range=7.5, pan_policy="optimal"),
]


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


def _plan(blind: bool = False) -> tuple[PlanResult, object, PlanningProblem]:
    field = synthetic_field(world_from_ascii("A....\n.....\nB...C"))
    start, goal = (0.25, 0.75), (2.25, 0.75)
    return plan_by_hand(start, goal, blind=blind), field, PlanningProblem(start, goal, 0.2)


@pytest.mark.parametrize("blind", [False, True])
def test_a_plan_says_everything_and_matches_its_schema(blind):
    result, field, problem = _plan(blind)
    answer = plan_to_json(result, field, problem=problem, client_ref="order-17", warnings=["clamped"])
    json.dumps(answer, allow_nan=False)
    answers.Plan.model_validate(answer, strict=True)
    assert answer["warnings"] == ["clamped", "note"]
    assert answer["map"] == "m_" + field.world.content_hash()
    assert answer["request"]["robot"]["radius_m"] == 0.2
    assert "seconds" not in json.dumps(answer), "times of computation do not belong to the answer"
    waypoint = answer["routes"][0]["path"][1]
    assert waypoint["t_s"] == pytest.approx(1.0)
    if blind:
        assert waypoint["covariance"] is waypoint["triplet"] is waypoint["ellipse95"] is None
        assert answer["routes"][0]["uncertainty"]["mean_r95_m"] is None
    else:
        assert waypoint["covariance"] == [0.01, 0.002, 0.02]
        assert waypoint["triplet"] == ["A", "B", "C"]


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
    answers.Plan.model_validate(answer, strict=True)
    assert answer["routes"] == []
    assert answer["shortest_baseline"] is None
