"""Plans over HTTP."""

from __future__ import annotations

import io

import pytest
from PIL import Image

from api import answers_plan
from tests.api.conftest import LASER, problem_of

PLAN = {
    "start": {"x_m": 1.0, "y_m": 5.0},
    "goal": {"x_m": 7.0, "y_m": 5.0},
    "robot": {"radius_m": 0.2},
    "client_ref": "order-17",
}


def test_a_plan_is_made_kept_and_drawn(client, field):
    answer = client.post("/v1/plans", json={**PLAN, "field": field.id})
    assert answer.status_code == 200
    assert answer.headers["cache-control"] == "no-store"
    plan = answer.json()
    answers_plan.Plan.model_validate(plan)
    assert (plan["client_ref"], plan["field"], plan["map"]) == ("order-17", field.id, field.map)
    again = client.get(f"/v1/plans/{plan['plan']}")
    assert again.json() == plan
    held = {"if-none-match": again.headers["etag"]}
    assert client.get(f"/v1/plans/{plan['plan']}", headers=held).status_code == 304
    picture = client.get(f"/v1/plans/{plan['plan']}/picture.png?width=600")
    assert Image.open(io.BytesIO(picture.content)).width == 600


def test_a_map_stands_for_its_newest_ready_field(client, field):
    assert client.post("/v1/plans", json={**PLAN, "map": "room"}).json()["field"] == field.id


def test_a_map_without_a_ready_field_is_409(client, room):
    problem_of(client.post("/v1/plans", json={**PLAN, "map": room}), 409, "field_not_ready")
    job = client.post("/v1/fields", json={"map": room, "sensor": LASER, "resolution_m": 0.5}).json()["job"]
    problem = problem_of(client.post("/v1/plans", json={**PLAN, "map": room}), 409, "field_not_ready")
    assert problem["hint"] == {"job": f"/v1/jobs/{job}"}


def test_a_long_deadline_is_cut_and_it_is_said(client, field):
    plan = client.post("/v1/plans", json={**PLAN, "field": field.id, "deadline_s": 99}).json()
    assert plan["request"]["deadline_s"] == 10.0
    assert "deadline_s was 99" in plan["warnings"][0]


def test_an_occupied_goal_comes_with_a_free_one(client, field):
    body = {**PLAN, "field": field.id, "goal": {"x_m": 4.0, "y_m": 3.0}}
    problem = problem_of(client.post("/v1/plans", json=body), 422, "goal_occupied")
    assert problem["hint"] == {"nearest_free": {"x_m": 2.0, "y_m": 3.0}}
    assert problem["errors"][0]["pointer"] == "#/goal"


@pytest.mark.parametrize(
    ("change", "status", "code"),
    [
        ({"field": "f_unknown"}, 404, "not_found"),
        ({"field": None, "map": "hall"}, 404, "not_found"),
        ({"field": None}, 422, "invalid_request"),
        ({"map": "room"}, 422, "invalid_request"),
        ({"goal": {"x_m": 1.0}}, 422, "invalid_request"),
        ({"robot": {"radius_m": 51.0}}, 422, "invalid_request"),
        ({"visit": []}, 422, "invalid_request"),
        ({"via": [{"x_m": 1.0}]}, 422, "invalid_request"),
        ({"objective": {"kind": "fastest"}}, 422, "invalid_request"),
        ({"constraints": {"max_collision_probability": 1.0}}, 422, "invalid_request"),
        ({"avoid": [{"type": "Point", "coordinates": [1.0, 2.0]}]}, 422, "invalid_request"),
        (
            {
                "avoid": [
                    {"type": "Polygon", "coordinates": [[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]]}
                ]
            },
            422,
            "invalid_request",
        ),
    ],
)
def test_wrong_questions(gallery, change, status, code):
    problem_of(gallery.client.post("/v1/plans", json={**PLAN, "field": gallery.id, **change}), status, code)


def test_unknown_plans(client):
    problem_of(client.get("/v1/plans/p_1"), 404, "not_found")
    problem_of(client.get("/v1/plans/p_1/picture.png"), 404, "not_found")


def test_wrong_robots(gallery):
    for robot in ({}, {"radius_m": 0.2, "kinematics": "tank"}, {"radius_m": 0.2, "kinematics": "dubins"}):
        problem_of(
            gallery.client.post("/v1/plans", json={**PLAN, "field": gallery.id, "robot": robot}),
            422,
            "invalid_request",
        )
    both = {**PLAN, "field": gallery.id, "goal": {**PLAN["goal"], "theta_rad": 1.0, "theta_deg": 3.0}}
    problem_of(gallery.client.post("/v1/plans", json=both), 422, "invalid_request")
