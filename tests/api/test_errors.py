"""The one table from exceptions to codes."""

from __future__ import annotations

import json

import pytest
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException

import localization.errors
import maps.errors
import planner.errors
from api import answers, store_records
from api.canvas import InvalidPicture
from api.errors import CODES, TABLE, InvalidRequest, Problem
from maps.errors import SurepathError


def _document(error: Exception) -> dict:
    response = Problem.of_exception(error).response("/v1/plans", "id-1")
    assert response.headers["content-type"] == "application/problem+json"
    assert response.headers["cache-control"] == "no-store"
    document = json.loads(response.body)
    answers.Problem.model_validate(document, strict=True)
    assert document["status"] == response.status_code
    return document


def _errors_of(module) -> list[type[SurepathError]]:
    return [
        v
        for v in vars(module).values()
        if isinstance(v, type) and issubclass(v, SurepathError) and v.__module__ == module.__name__
    ]


@pytest.mark.parametrize(
    "kind",
    [k for m in (maps.errors, localization.errors, planner.errors, store_records) for k in _errors_of(m)],
    ids=lambda k: k.__name__,
)
def test_every_error_of_ours_has_a_code_that_is_not_internal(kind):
    assert _document(kind("words"))["code"] != "internal"
    assert _document(kind("words"))["detail"] == "words"


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (maps.errors.DuplicateLandmark("x"), 422, "duplicate_landmark"),
        (maps.errors.MapTooLarge("x"), 413, "too_large"),
        (maps.errors.TooFewLandmarks("x"), 422, "too_few_landmarks"),
        (localization.errors.InvalidSensor("x"), 422, "invalid_sensor"),
        (planner.errors.StartOutsideMap("x"), 422, "start_outside_map"),
        (planner.errors.GoalOccupied("x"), 422, "goal_occupied"),
        (InvalidPicture("x"), 422, "invalid_picture"),
        (store_records.NotFound("x"), 404, "not_found"),
        (store_records.InUse("x"), 409, "in_use"),
        (store_records.FieldNotReady("x"), 409, "field_not_ready"),
        (store_records.StorageFull("x"), 507, "storage_full"),
        (store_records.StoreUnavailable("x"), 503, "store_unavailable"),
        (HTTPException(405), 405, "method_not_allowed"),
        (HTTPException(404), 404, "not_found"),
        (HTTPException(400), 400, "malformed_body"),
        (HTTPException(418), 422, "invalid_request"),
        (ZeroDivisionError("secret"), 500, "internal"),
    ],
    ids=lambda v: v if isinstance(v, str) else None,
)
def test_status_and_code(error, status, code):
    document = _document(error)
    assert (document["status"], document["code"]) == (status, code)
    assert "secret" not in json.dumps(document)


def test_503_says_when_to_come_back():
    response = Problem.of_exception(store_records.StoreUnavailable("x")).response("/", "i")
    assert int(response.headers["retry-after"]) > 0


def test_a_place_that_is_occupied_comes_with_the_nearest_free_one():
    document = _document(planner.errors.GoalOccupied("x", nearest_free=(1.5, 2.0)))
    assert document["hint"] == {"nearest_free": {"x_m": 1.5, "y_m": 2.0}}
    assert document["errors"] == [{"pointer": "#/goal", "detail": "x"}]


def test_limits_and_jobs_are_told():
    full = _document(store_records.StorageFull("x", limit=10, requested=20))
    assert (full["limit"], full["requested"]) == (10, 20)
    assert _document(store_records.FieldNotReady("x", job="j_1"))["hint"] == {"job": "/v1/jobs/j_1"}


def test_validation_names_places_and_never_values():
    found = [
        {
            "type": "finite_number",
            "loc": ("body", "start", "x_m"),
            "msg": "not finite",
            "input": float("nan"),
        },
        {"type": "missing", "loc": ("query", "y_m"), "msg": "Field required", "input": "secret"},
        {"type": "extra", "loc": ("body", "a/b~c\ud800" + "x" * 500), "msg": "Extra", "input": "secret"},
    ]
    document = _document(RequestValidationError(found))
    assert document["code"] == "invalid_request"
    assert document["errors"][0] == {"pointer": "#/start/x_m", "detail": "not finite"}
    assert document["errors"][1] == {"parameter": "y_m", "detail": "Field required"}
    assert document["errors"][2]["pointer"].startswith("#/a~1b~0c")
    assert len(document["errors"][2]["pointer"]) < 100
    assert "secret" not in json.dumps(document)


def test_a_parameter_that_is_wrong_is_named():
    assert _document(InvalidRequest("x", place="bbox"))["errors"] == [{"parameter": "bbox", "detail": "x"}]


def test_every_code_of_the_table_exists():
    assert {code for code, _ in TABLE.values()} <= set(CODES)
