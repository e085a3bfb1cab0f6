"""Bodies of requests."""

from __future__ import annotations

import math
from typing import get_args

import pytest
from pydantic import ValidationError

from api.schemas import FieldIn, PlanIn
from api.schemas_sensor import SENSOR_KINDS, PresetName
from localization.method import BEST_AREA, CRITERIA, ESTIMATORS, FieldMethod
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA, PRESETS
from planner.errors import InvalidProblem

PLAN = {
    "map": "warehouse",
    "start": {"x_m": 1, "y_m": 2.0},
    "goal": {"x_m": 3.0, "y_m": 4.0},
    "robot": {"radius_m": 0.3},
}


def test_a_plan_fills_in_its_defaults():
    problem, warnings = PlanIn.model_validate(PLAN).to_problem()
    assert (problem.start, problem.goal, problem.radius) == ((1.0, 2.0), (3.0, 4.0), 0.3)
    assert (problem.objective, problem.weight, problem.max_r95, problem.blind_r95) == (
        "weighted",
        4.0,
        None,
        None,
    )
    assert problem.deadline == 2.0
    assert warnings == ()


@pytest.mark.parametrize(("asked", "given"), [(99.0, 5.0), (1e-6, 0.05), (3.0, 3.0)])
def test_a_deadline_is_clamped_and_it_is_said(asked, given):
    problem, warnings = PlanIn.model_validate({**PLAN, "deadline_s": asked}).to_problem(max_deadline=5.0)
    assert problem.deadline == given
    assert len(warnings) == (asked != given)


@pytest.mark.parametrize(
    "change",
    [
        {"field": "f_1"},
        {"map": None},
        {"colour": 1},
        {"start": [1, 2]},
        {"start": {"x_m": math.nan, "y_m": 0.0}},
        {"start": {"x_m": math.inf, "y_m": 0.0}},
        {"start": {"x_m": "1", "y_m": 0.0}},
        {"start": {"x_m": True, "y_m": 0.0}},
        {"start": {"x_m": 1.0}},
        {"start": {"x_m": 1.0, "y_m": 1.0, "z_m": 1.0}},
        {"robot": {"radius_m": -0.1}},
        {"robot": {"radius_m": 0.3, "max_speed_m_s": 0.0}},
        {"robot": {"radius_m": 0.3, "max_speed_m_s": 1e-300}},
        {"robot": {"radius_m": 0.3, "max_accel_m_s2": 5e-324}},
        {"objective": {"kind": "fastest"}},
        {"objective": {"uncertainty_weight_per_m": -1.0}},
        {"constraints": {"max_r95_m": 0.0}},
        {"deadline_s": 0.0},
        {"seed": -1},
        {"seed": 1.5},
        {"client_ref": "x" * 201},
    ],
)
def test_wrong_plans_are_refused(change):
    with pytest.raises(ValidationError):
        PlanIn.model_validate({**PLAN, **change})


def test_numbers_beyond_the_planner_have_its_error():
    with pytest.raises(InvalidProblem):
        PlanIn.model_validate({**PLAN, "robot": {"radius_m": 51.0}}).to_problem()


def test_a_field_takes_presets_and_sensors():
    assert FieldIn.model_validate({"map": "a", "sensor": "laser"}).to_sensor() == LASER
    assert FieldIn.model_validate({"map": "a", "sensor": "mas97"}).to_sensor() == MAS97_CAMERA
    assert FieldIn.model_validate({"map": "a", "sensor": "forward"}).to_sensor() == FORWARD_CAMERA
    sensor = {"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "max_range_m": 30.0}
    assert FieldIn.model_validate({"map": "a", "sensor": sensor}).to_sensor() == LASER


def test_every_kind_preset_and_method_of_the_engine_has_its_word():
    assert set(get_args(PresetName)) == set(PRESETS)
    assert {s.kind for s in PRESETS.values()} == set(SENSOR_KINDS)
    properties = FieldIn.model_json_schema()["properties"]
    assert properties["estimator"]["enum"] == list(ESTIMATORS)
    assert properties["criterion"]["enum"] == list(CRITERIA)


def test_a_field_says_how_its_fixes_are_made():
    assert FieldIn.model_validate({"map": "a", "sensor": "laser"}).to_method() == BEST_AREA
    order = {"map": "a", "sensor": "laser", "estimator": "all_visible", "criterion": "trace"}
    assert FieldIn.model_validate(order).to_method() == FieldMethod("all_visible", "trace")


@pytest.mark.parametrize(
    "change",
    [
        {"sensor": "sonar"},
        {"estimator": "worst_triplet"},
        {"estimator": None},
        {"criterion": "volume"},
        {"criterion": ["area"]},
        {"sensor": ["laser"]},
        {"sensor": {"kind": ["omnidirectional"]}},
        {"sensor": {"kind": "preset"}},
        {"sensor": {"kind": "sonar"}},
        {"resolution_m": 0.0},
        {"resolution_m": 1e-300},
        {"resolution_m": math.nan},
        {"resolution_m": 101.0},
        {"heading_rad": 100.0},
        {"map": ""},
        {"map": 7},
    ],
)
def test_wrong_fields_are_refused(change):
    with pytest.raises(ValidationError):
        FieldIn.model_validate({"map": "a", "sensor": "laser", **change})
