"""Fields over HTTP."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from api import answers
from localization.uncertainty_field import METRICS
from tests.api.conftest import LASER, finish, problem_of


def test_an_order_is_a_job_and_then_a_field(client, room):
    order = {"map": "room", "sensor": LASER, "resolution_m": 0.5}
    first = client.post("/v1/fields", json=order)
    assert first.status_code == 202
    body = first.json()
    answers.FieldOrdered.model_validate(body)
    assert first.headers["location"] == f"/v1/jobs/{body['job']}"
    again = client.post("/v1/fields", json={**order, "map": room})
    assert (again.status_code, again.json()["job"]) == (202, body["job"]), "one job for one field"
    field = f"/v1/fields/{body['field']}"
    assert client.get(field).json()["status"] == "running"
    for part in ("/heatmap.png", "/heatmap.npy", "/point?x_m=1&y_m=1"):
        problem = problem_of(client.get(field + part), 409, "field_not_ready")
        assert problem["hint"] == {"job": f"/v1/jobs/{body['job']}"}
    problem_of(client.delete(field), 409, "in_use")
    finish(client, body["job"])
    ready = client.post("/v1/fields", json=order)
    assert (ready.status_code, ready.json()["job"]) == (200, None)
    assert ready.headers["location"] == field


def test_a_field_tells_what_it_is(client, field):
    found = client.get(field.path).json()
    answers.UncertaintyField.model_validate(found)
    assert found["status"] == "ready"
    assert found["shape"] == {"rows": 12, "columns": 16}
    order = {"map": found["map"], "sensor": found["sensor"], "resolution_m": found["resolution_m"]}
    assert client.post("/v1/fields", json=order).json()["field"] == field.id, "its sensor is an order again"
    assert client.get("/v1/fields").json()["fields"] == [found]
    assert client.get("/v1/fields?map=room").json()["fields"] == [found]
    problem_of(client.get("/v1/fields?map=hall"), 404, "not_found")


def test_a_method_is_ordered_and_told(client, room):
    order = {"map": room, "sensor": "forward", "resolution_m": 0.5, "heading_rad": 1.0}
    order |= {"estimator": "all_visible", "criterion": "max_axis"}
    made = client.post("/v1/fields", json=order).json()
    found = client.get(f"/v1/fields/{made['field']}").json()
    answers.UncertaintyField.model_validate(found)
    assert {k: found[k] for k in ("heading_rad", "estimator", "criterion")} == {
        "heading_rad": 1.0,
        "estimator": "all_visible",
        "criterion": "max_axis",
    }
    assert found["sensor"]["kind"] == "pinhole_fixed"
    assert client.post("/v1/fields", json={**order, "criterion": "area"}).json()["field"] != made["field"]


def test_a_field_of_an_earlier_version_offers_its_order(client, room):
    order = {"map": room, "sensor": LASER, "resolution_m": 0.5}
    made = client.post("/v1/fields", json=order).json()
    finish(client, made["job"])
    store = client.app.state.service.store
    with store._write() as connection:
        connection.exec_driver_sql("UPDATE fields SET field_format = 1")
    store._recover_fields()
    path = f"/v1/fields/{made['field']}"
    for part in ("/heatmap.png", "/heatmap.npy", "/point?x_m=1&y_m=1"):
        problem = problem_of(client.get(path + part), 409, "field_not_ready")
        assert "earlier version" in problem["detail"]
    question = {
        "map": room,
        "start": {"x_m": 1, "y_m": 2},
        "goal": {"x_m": 2, "y_m": 5},
        "robot": {"radius_m": 0.3},
    }
    planned = problem_of(client.post("/v1/plans", json=question), 409, "field_not_ready")
    assert "earlier version" in planned["detail"]
    found = client.get(path).json()
    answers.UncertaintyField.model_validate(found)
    assert (found["status"], found["job"]) == ("failed", None)
    assert "earlier version" in found["error"]
    assert client.get("/").status_code == 200
    for hint in (problem["hint"], planned["hint"]):
        assert client.post("/v1/fields", json=hint["order"]).status_code == 202, "the offer is an order"
    assert client.delete(path).status_code == 409, "it is being computed again"


def test_the_heatmap_is_a_picture_of_the_size_asked_for(gallery):
    answer = gallery.client.get(f"{gallery.path}/heatmap.png?width=500&height=400")
    assert answer.headers["content-type"] == "image/png"
    assert Image.open(io.BytesIO(answer.content)).size == (500, 400)
    assert "max-age=3600" in answer.headers["cache-control"]
    again = gallery.client.get(f"{gallery.path}/heatmap.png?height=400&width=500&metric=area95_m2")
    assert again.headers["etag"] == answer.headers["etag"], "the same question in other words"
    assert again.content == answer.content
    held = {"if-none-match": answer.headers["etag"]}
    assert (
        gallery.client.get(f"{gallery.path}/heatmap.png?width=500&height=400", headers=held).status_code
        == 304
    )
    assert (
        gallery.client.get(f"{gallery.path}/heatmap.png?width=501&height=400", headers=held).status_code
        == 200
    )


@pytest.mark.parametrize("metric", METRICS)
def test_every_metric_is_drawn_and_read(gallery, metric):
    scale = "linear" if metric in {"n_visible", "validity"} else "log"
    picture = gallery.client.get(f"{gallery.path}/heatmap.png?metric={metric}&width=300&scale={scale}")
    assert picture.status_code == 200
    usual = gallery.client.get(f"{gallery.path}/heatmap.png?metric={metric}&width=300")
    assert usual.headers["etag"] == picture.headers["etag"], "the scale that suits the metric is the default"
    values = np.load(io.BytesIO(gallery.client.get(f"{gallery.path}/heatmap.npy?metric={metric}").content))
    assert values.shape == (12, 16)
    stored = gallery.client.app.state.service.store.load_field(gallery.id)
    np.testing.assert_array_equal(values, stored.metric(metric))


@pytest.mark.parametrize(
    ("query", "code"),
    [
        ("metric=beauty", "invalid_request"),
        ("width=abc", "invalid_request"),
        ("width=15", "invalid_request"),
        ("width=99999999999999999999", "invalid_request"),
        ("width=16000&height=16000", "invalid_picture"),
        ("width=199", "invalid_picture"),
        ("width=199&legend=false", None),
        ("height=129", "invalid_picture"),
        ("width=16&height=16&legend=false", None),
        ("max_size=16", None),
        ("max_size=16384", "invalid_picture"),
        ("rescale=1e-9,1e9", None),
        ("rescale=-1e9,1e9&scale=linear&metric=n_visible", None),
        ("bbox=7.98,5.98,8,6", None),
        ("scale=cubic", "invalid_request"),
        ("colormap_name=jet", "invalid_picture"),
        ("rescale=1", "invalid_request"),
        ("rescale=1,2,3", "invalid_request"),
        ("rescale=a,b", "invalid_request"),
        ("rescale=nan,1", "invalid_request"),
        ("rescale=0,inf", "invalid_request"),
        ("rescale=0,1", "invalid_picture"),
        ("rescale=2,1", "invalid_picture"),
        ("rescale=1,1", "invalid_picture"),
        ("rescale=-1,1e99&scale=linear", "invalid_request"),
        ("bbox=1,2,3", "invalid_request"),
        ("bbox=nan,0,1,1", "invalid_request"),
        ("bbox=3,3,1,1", "invalid_picture"),
        ("bbox=100,100,101,101", "invalid_picture"),
        ("bbox=0,0,1e-300,1", "invalid_picture"),
        ("bbox=0,0,8,0.011", "invalid_picture" if 0.011 / 8 < 1e-3 else None),
        ("bbox=-1e9,0,1e9,1", "invalid_picture"),
    ],
)
def test_wrong_pictures(gallery, query, code):
    answer = gallery.client.get(f"{gallery.path}/heatmap.png?{query}")
    if code is None:
        assert answer.status_code == 200
    else:
        problem_of(answer, 422, code)


def test_a_place_with_a_fix(gallery):
    value = gallery.client.get(f"{gallery.path}/point?x_m=1.2&y_m=3.1").json()
    answers.PointValue.model_validate(value)
    assert value["state"] == "fix"
    assert value["cell"] == {"row": 6, "column": 2}
    sigma = 0.02 + 0.01 * 1.25
    assert value["covariance"] == pytest.approx([sigma**2, 0.0, sigma**2])
    assert value["metrics"]["sigma_max_m"] == pytest.approx(sigma)
    assert value["ellipse95"]["a_m"] == pytest.approx(value["metrics"]["ellipse95_m"])
    assert value["triplet"] == ["A", "B", "C"]
    assert value["pan_rad"] is None


@pytest.mark.parametrize(
    ("place", "state"), [((1.0, 0.4), "no_fix"), ((4.0, 3.0), "occupied"), ((-3.0, 3.0), "outside")]
)
def test_a_place_without_a_fix_says_why(gallery, place, state):
    value = gallery.client.get(f"{gallery.path}/point?x_m={place[0]}&y_m={place[1]}").json()
    answers.PointValue.model_validate(value)
    assert value["state"] == state
    assert value["reason"]
    assert value["covariance"] is value["triplet"] is value["metrics"]["area95_m2"] is None


@pytest.mark.parametrize("query", ["", "x_m=1", "x_m=nan&y_m=1", "x_m=a&y_m=1", "x_m=1e999&y_m=0"])
def test_wrong_places(gallery, query):
    problem_of(gallery.client.get(f"{gallery.path}/point?{query}"), 422, "invalid_request")


@pytest.mark.parametrize("query", ["x_m=1e308&y_m=-1e308", "x_m=1e19&y_m=1"])
def test_far_away_is_outside(gallery, query):
    assert gallery.client.get(f"{gallery.path}/point?{query}").json()["state"] == "outside"


@pytest.mark.parametrize(
    ("change", "status", "code", "pointer"),
    [
        ({"map": "hall"}, 404, "not_found", None),
        ({"sensor": {"kind": "omnidirectional", "bearing_sigma_deg": -1}}, 422, "invalid_request", "#/sensor/bearing_sigma_deg"),
        ({"sensor": {"kind": "omnidirectional", "bearing_sigma_deg": 500}}, 422, "invalid_request", "#/sensor/bearing_sigma_deg"),
        ({"sensor": {**LASER, "min_range_m": 50}}, 422, "invalid_sensor", "#/sensor"),
        ({"sensor": {**LASER, "muted": [{"begin_deg": 0, "end_deg": 999}]}}, 422, "invalid_request", "#/sensor/muted/0/end_deg"),
        ({"sensor": {**LASER, "mount": {"x_m": 1e9}}}, 422, "invalid_request", "#/sensor/mount/x_m"),
        ({"sensor": "sonar"}, 422, "invalid_request", "#/sensor"),
        ({"estimator": "worst"}, 422, "invalid_request", "#/estimator"),
        ({"criterion": 1}, 422, "invalid_request", "#/criterion"),
        ({"sensor": {"kind": "sonar"}}, 422, "invalid_request", "#/sensor"),
        ({"resolution_m": 0}, 422, "invalid_request", "#/resolution_m"),
        ({"colour": 1}, 422, "invalid_request", "#/colour"),
    ],
)  # fmt: skip
def test_wrong_orders(client, room, change, status, code, pointer):
    order = {"map": room, "sensor": LASER, "resolution_m": 0.5, **change}
    problem = problem_of(client.post("/v1/fields", json=order), status, code)
    if pointer is not None:
        assert [e["pointer"] for e in problem["errors"]] == [pointer]
    assert client.get("/v1/fields").json() == {"fields": []}


def test_nan_is_never_echoed(client):
    body = b'{"map": "room", "sensor": "laser", "resolution_m": NaN}'
    answer = client.post("/v1/fields", content=body, headers={"content-type": "application/json"})
    problem_of(answer, 422, "invalid_request")
    assert "NaN" not in answer.text


def test_delete(client, field):
    assert client.delete(field.path).status_code == 204
    for part in ("", "/heatmap.png", "/heatmap.npy", "/point?x_m=1&y_m=1"):
        problem_of(client.get(field.path + part), 404, "not_found")
