"""The main job through the real application: real store, real worker processes."""

from __future__ import annotations

import io
import time

import numpy as np
import pytest
from PIL import Image

from api import answers, answers_many, answers_plan
from api.app import create_app
from api.settings import Settings
from tests.api.clients import TestClient
from tests.api.conftest import LASER, ROOM, problem_of

META = b"image: hall.png\nresolution: 0.1\norigin: [-1.0, -2.0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
MARKS = b"id,x,y\nA,-0.9,-1.9\nB,4.9,-1.9\nC,4.9,1.9\nD,-0.9,1.9\n"


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    settings = Settings(data_dir=tmp_path_factory.mktemp("data"), preload=False, workers=2)
    with TestClient(create_app(settings)) as client:
        limit = time.monotonic() + 200
        while client.get("/readyz").status_code != 200:
            assert time.monotonic() < limit, "the workers did not start"
            time.sleep(0.1)
        yield client


def _hall() -> bytes:
    """A picture of 60 × 40 cells: free, with a wall around and a pillar."""
    pixels = np.full((40, 60), 254, dtype=np.uint8)
    pixels[[0, -1], :] = pixels[:, [0, -1]] = 0
    pixels[15:25, 25:35] = 0
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def _field(client, map_id: str) -> str:
    ordered = client.post("/v1/fields", json={"map": map_id, "sensor": LASER, "resolution_m": 0.2}).json()
    limit = time.monotonic() + 60
    while (job := client.get(f"/v1/jobs/{ordered['job']}").json())["status"] in {"accepted", "running"}:
        assert time.monotonic() < limit
        time.sleep(0.05)
    assert job["status"] == "successful", job
    assert job["tiles"]["done"] == job["tiles"]["total"] > 0
    return ordered["field"]


def _plan(client, field: str, start, goal, **more):
    body = {
        "field": field,
        "start": {"x_m": start[0], "y_m": start[1]},
        "goal": {"x_m": goal[0], "y_m": goal[1]},
        "robot": {"radius_m": 0.3},
        "deadline_s": 20.0,
        **more,
    }
    return client.post("/v1/plans", json=body)


def test_polygons_from_upload_to_picture(service):
    map_id = service.post("/v1/maps", json=ROOM).json()["map"]
    field = _field(service, map_id)
    answer = _plan(service, field, (1.0, 5.0), (7.0, 1.0), client_ref="a")
    assert answer.status_code == 200
    plan = answer.json()
    answers_plan.Plan.model_validate(plan)
    assert plan["status"] in {"exact", "approximate"}
    (route,) = plan["routes"]
    assert route["length_m"] > 7.5, "around the obstacle and the blind places"
    assert route["min_clearance_m"] >= -1e-9
    assert route["path"][0]["triplet"] is not None
    assert service.get(f"/v1/plans/{plan['plan']}").json() == plan
    picture = service.get(f"/v1/plans/{plan['plan']}/picture.png?width=500")
    assert Image.open(io.BytesIO(picture.content)).width == 500


def test_a_ros_map_from_form_to_plan(service):
    files = {
        "image": ("hall.png", _hall()),
        "meta": ("hall.yaml", META),
        "landmarks": ("marks.csv", MARKS),
    }
    answer = service.post("/v1/maps", files=files, data={"name": "hall"})
    assert answer.status_code == 201
    found = answer.json()
    answers.MapUploaded.model_validate(found)
    assert (found["kind"], found["resolution_m"], found["landmarks"]) == ("grid", 0.1, 4)
    assert found["bounds"] == {"x_min_m": -1.0, "y_min_m": -2.0, "x_max_m": 5.0, "y_max_m": 2.0}
    assert found["free_area_m2"] == pytest.approx((58 * 38 - 100) * 0.01)
    plan = _plan(service, _field(service, found["map"]), (-0.5, 0.0), (4.5, 0.0)).json()
    assert plan["status"] in {"exact", "approximate"}


def test_mistakes_have_the_planners_names(service):
    field = _field_id(service)
    problem = problem_of(_plan(service, field, (1.0, 5.0), (4.0, 3.0)), 422, "goal_occupied")
    free = problem["hint"]["nearest_free"]
    again = _plan(service, field, (1.0, 5.0), (free["x_m"], free["y_m"]))
    assert again.status_code == 200, "the hint is a place where the robot fits"
    problem_of(_plan(service, field, (0.1, 3.0), (7.0, 3.0)), 422, "start_occupied")
    problem_of(_plan(service, field, (-5.0, 3.0), (7.0, 3.0)), 422, "start_outside_map")
    problem_of(_plan(service, field, (1.0, 5.0), (70.0, 3.0)), 422, "goal_outside_map")


def _field_id(client) -> str:
    map_id = client.post("/v1/maps", json=ROOM).json()["map"]
    ordered = client.post("/v1/fields", json={"map": map_id, "sensor": LASER, "resolution_m": 0.2})
    return ordered.json()["field"] if ordered.json()["job"] is None else _field(client, map_id)


def test_a_bound_that_cannot_be_kept_is_an_outcome(service):
    plan = _plan(service, _field_id(service), (1.0, 5.0), (7.0, 1.0), constraints={"max_r95_m": 1e-6}).json()
    answers_plan.Plan.model_validate(plan)
    assert plan["status"] == "risk_unmet"
    assert plan["unmet"][0]["bound"] == "max_r95_m"
    assert plan["unmet"][0]["smallest_possible"] > 1e-6


def test_several_routes_schedules_and_simulations_of_them(service):
    more = {"alternatives": {"count": 2, "max_cost_factor": 3.0}, "include": ["schedule"]}
    plan = _plan(service, _field_id(service), (1.0, 5.0), (7.0, 5.0), **more).json()
    answers_plan.Plan.model_validate(plan)
    assert plan["status"] == "exact"
    assert len(plan["routes"]) == 2
    assert all(route["schedule"] for route in plan["routes"])
    front = _plan(service, _field_id(service), (1.0, 5.0), (7.0, 5.0), objective={"kind": "pareto"}).json()
    answers_plan.Plan.model_validate(front)
    assert front["routes"][0]["front"]["against"] == "worst"
    for route in (0, 1):
        body = {"plan": plan["plan"], "route": route, "runs": 50}
        found = service.post("/v1/simulations", json=body).json()
        answers_many.Simulation.model_validate(found)
        assert (found["status"], found["runs"]) == ("complete", 50)
        assert service.post("/v1/simulations", json=body).json() == found


def test_a_short_deadline_leaves_a_part_of_a_list(service):
    began = time.monotonic()
    more = {"alternatives": {"count": 10, "max_cost_factor": 9.0}, "include": ["schedule"]}
    plan = _plan(service, _field_id(service), (1.0, 5.0), (7.0, 5.0), **more, deadline_s=0.3).json()
    assert time.monotonic() - began < 0.3 + 0.5 + 1.0, "the field may have to be read"
    answers_plan.Plan.model_validate(plan)
    assert plan["status"] in {"exact", "approximate", "timeout"}


def test_many_places(service):
    question = {"field": _field_id(service), "robot": {"radius_m": 0.3}}
    places = [{"x_m": x, "y_m": y} for x, y in ((1.0, 5.0), (7.0, 5.0), (4.0, 3.0))]
    matrix = service.post("/v1/matrix", json={**question, "sources": places}).json()
    answers_many.Matrix.model_validate(matrix)
    assert (matrix["status"], matrix["sources"][2]["status"]) == ("partial", "occupied")
    plan = _plan(service, question["field"], (1.0, 5.0), (7.0, 5.0)).json()
    assert plan["routes"][0]["cost"] <= matrix["cost"][0][1]
    region = service.post("/v1/reachability", json={**question, "start": places[0], "max_cost": 4.0}).json()
    answers_many.Region.model_validate(region)
    assert 0 < region["features"][0]["properties"]["area_m2"] < 40


@pytest.mark.parametrize(
    ("image", "meta", "status", "code"),
    [
        (b"GIF89a", META, 422, "invalid_map"),
        (_hall()[:60], META, 422, "invalid_map"),
        (b"P5\n20000 20000\n255\n", META, 413, "too_large"),
        (_hall(), b"image: [", 422, "invalid_map"),
        (_hall(), META.replace(b"0.1", b".nan"), 422, "invalid_map"),
        (_hall(), META.replace(b"0.1", b"-1"), 422, "invalid_map"),
        (_hall(), b"a: &a [1]\nb: *a\n", 422, "invalid_map"),
    ],
    ids=["gif", "cut", "huge", "yaml", "nan", "negative", "alias"],
)
def test_wrong_ros_maps(service, image, meta, status, code):
    before = service.get("/v1/maps").json()
    files = {"image": ("x.png", image), "meta": ("x.yaml", meta)}
    problem_of(service.post("/v1/maps", files=files), status, code)
    assert service.get("/v1/maps").json() == before


def test_too_few_landmarks(service):
    files = {"image": ("hall.png", _hall()), "meta": ("hall.yaml", META)}
    map_id = service.post("/v1/maps", files=files).json()["map"]
    problem_of(service.post("/v1/fields", json={"map": map_id, "sensor": LASER}), 422, "too_few_landmarks")


def test_a_field_beyond_the_limit(service):
    map_id = service.post("/v1/maps", json=ROOM).json()["map"]
    order = {"map": map_id, "sensor": LASER, "resolution_m": 0.001}
    settings = service.app.state.service.settings
    problem = service.post("/v1/fields", json=order).json()
    if settings.max_field_bytes // 120 < 8000 * 6000:
        assert problem["code"] == "limit_exceeded"
        assert problem["setting"].startswith("SUREPATH_MAX_FIELD")
    else:
        assert service.delete(f"/v1/jobs/{problem['job']}").status_code == 200
