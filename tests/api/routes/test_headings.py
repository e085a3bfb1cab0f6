"""Fields over headings over HTTP."""

from __future__ import annotations

import io
import math
from types import SimpleNamespace

import numpy as np
import pytest

from api import answers, answers_fields
from api.store_files import write_field
from localization.field_builder import build_heading_field
from tests.api.conftest import problem_of, ready_field
from tests.api.routes.test_places import HALL

COUNT = 8
ORDER = {"sensor": "forward", "resolution_m": 0.5, "headings": COUNT}


@pytest.fixture
def turning(client):
    """A room with a field of a fixed camera at eight headings, as a worker would compute it."""
    room = client.post("/v1/maps", json=HALL).json()["map"]
    ordered = client.post("/v1/fields", json={"map": room, **ORDER}).json()
    store = client.app.state.service.store
    job = store.claim_job(ordered["job"])
    record = store.field(job.field_id)
    field = build_heading_field(
        store.world(record.map_id), record.sensor, resolution=0.5, headings=record.headings
    )
    assert "f_" + field.content_hash() == record.id, "the id is known before the field is there"
    staged = store.staging_path(job.id)
    size, checksum = write_field(field, staged)
    assert store.commit_field(job.id, staged, size=size, checksum=checksum)
    return SimpleNamespace(id=record.id, path=f"/v1/fields/{record.id}", field=field, map=room)


def values(client, turning, query):
    return np.load(io.BytesIO(client.get(f"{turning.path}/heatmap.npy?{query}").content))


def test_a_field_says_over_how_many_headings_it_is(client, turning):
    found = client.get(turning.path).json()
    answers.UncertaintyField.model_validate(found)
    assert (found["headings"], found["heading_rad"]) == (COUNT, 0.0)
    again = client.post("/v1/fields", json={"map": turning.map, **ORDER})
    assert (again.status_code, again.json()["field"]) == (200, turning.id)
    single = client.post("/v1/fields", json={"map": turning.map, **ORDER, "headings": 1}).json()
    assert single["field"] != turning.id


@pytest.mark.parametrize("which", ["best", "worst"])
def test_heatmaps_show_the_best_or_the_worst(client, turning, which):
    np.testing.assert_array_equal(
        values(client, turning, f"metric=r95_m&heading={which}"), turning.field.reduced(which).metric("r95_m")
    )


def test_heatmaps_show_a_heading_or_the_mean(client, turning):
    expected = turning.field.slices[2].metric("n_visible")
    for angle in (math.pi / 2, math.pi / 2 + 0.2, -3 * math.pi / 2):
        np.testing.assert_array_equal(values(client, turning, f"metric=n_visible&heading={angle}"), expected)
    np.testing.assert_array_equal(
        values(client, turning, "metric=n_visible&heading=mean"), turning.field.mean("n_visible")
    )
    assert np.nanmax(np.abs(expected - turning.field.slices[0].metric("n_visible"))) > 0


def test_words_that_mean_the_same_are_the_same_picture(client, turning):
    plain = client.get(f"{turning.path}/heatmap.png?width=300")
    assert plain.status_code == 200
    best = client.get(f"{turning.path}/heatmap.png?width=300&heading=best")
    assert best.headers["etag"] == plain.headers["etag"]
    worst = client.get(f"{turning.path}/heatmap.png?width=300&heading=worst")
    assert worst.headers["etag"] != plain.headers["etag"]
    assert worst.content != plain.content
    east, nearly = (client.get(f"{turning.path}/legend.json?heading={a}") for a in ("0", "0.1"))
    assert east.headers["etag"] == nearly.headers["etag"]


def test_tiles_and_figures_know_headings(client, turning):
    found = client.get(f"{turning.path}/tilejson.json?heading=worst&metric=r95_m").json()
    answers_fields.TileJson.model_validate(found)
    assert "heading=worst" in found["tiles"][0]
    array = np.load(io.BytesIO(client.get(found["arrays"][0].format(z=0, x=0, y=0)).content))
    worst = turning.field.reduced("worst").metric("r95_m").astype(np.float32)
    np.testing.assert_array_equal(array[-12:, :16], worst)
    assert client.get(found["tiles"][0].format(z=0, x=0, y=0)).status_code == 200
    shares = {
        which: client.get(f"{turning.path}/statistics?heading={which}").json()["share_with_fix"]
        for which in ("best", "worst")
    }
    assert shares["worst"] < shares["best"]
    window = client.get(f"{turning.path}/heatmap.json?heading=worst&metric=n_visible").json()
    answers_fields.Window.model_validate(window)
    square = {"type": "Polygon", "coordinates": [[[0, 0], [8, 0], [8, 6], [0, 6]]]}
    body = {"areas": [square], "heading": "worst"}
    areas = client.post(f"{turning.path}/statistics", json=body).json()["areas"]
    assert areas[0]["share_with_fix"] == pytest.approx(shares["worst"])


def test_a_point_has_a_profile_over_headings(client, turning):
    at = f"{turning.path}/point?x_m=6.2&y_m=5.2"
    best = client.get(at).json()
    answers.PointValue.model_validate(best)
    profile = best["headings"]
    assert [h["theta_rad"] for h in profile] == pytest.approx(turning.field.headings.tolist())
    areas = [h["area95_m2"] for h in profile if h["area95_m2"] is not None]
    assert areas, "some heading has a fix there"
    assert best["metrics"]["area95_m2"] == min(areas)
    best_at = next(h for h in profile if h["area95_m2"] == min(areas))
    assert best["heading_rad"] == pytest.approx(best_at["theta_rad"])
    for theta, shown in zip(
        (-math.pi, 0.1), (turning.field.at(-math.pi), turning.field.at(0.1)), strict=True
    ):
        one = client.get(f"{at}&theta_rad={theta}&ranking=3").json()
        answers.PointValue.model_validate(one)
        assert one["heading_rad"] == one["ranking"]["heading_rad"] == pytest.approx(shown.heading)
        assert one["n_visible"] == shown.n_visible[10, 12]
        assert bool(one["ranking"]["triplets"]) == (one["state"] == "fix")
    outside = client.get(f"{turning.path}/point?x_m=-5&y_m=1").json()
    answers.PointValue.model_validate(outside)
    assert outside["headings"] is None


def test_fields_of_one_heading_take_no_other(client, turning):
    one = ready_field(client, turning.map)
    problem_of(client.get(f"{one.path}/heatmap.png?heading=best"), 422, "invalid_request")
    assert client.get(f"{one.path}/point?x_m=1&y_m=3&theta_rad=1").status_code == 200, "a laser does not care"
    for heading in ("north", "nan", "1e9"):
        problem_of(client.get(f"{turning.path}/heatmap.npy?heading={heading}"), 422, "invalid_request")


def test_plans_and_questions_on_a_field_over_headings(client, turning):
    question = {
        "field": turning.id,
        "start": {"x_m": 1, "y_m": 5},
        "goal": {"x_m": 2, "y_m": 5},
        "robot": {"radius_m": 0.2},
    }
    planned = client.post("/v1/plans", json=question)
    assert planned.status_code == 200, planned.text
    assert planned.json()["field"] == turning.id
    assert client.get(f"/v1/plans/{planned.json()['plan']}/picture.png").status_code == 200
    body = {
        "field": turning.id,
        "robot": {"radius_m": 0.2},
        "constraints": {"blind_r95_m": 1.0},
        "sources": [{"x_m": 1, "y_m": 5}],
        "targets": [{"x_m": 7, "y_m": 5}],
    }
    matrix = client.post("/v1/matrix", json=body)
    assert matrix.status_code == 200, matrix.text
    assert matrix.json()["field"] == turning.id
    assert any("worst" in w for w in matrix.json()["warnings"])


@pytest.mark.parametrize(
    ("change", "code", "pointer"),
    [
        ({"headings": 0}, "invalid_request", "#/headings"),
        ({"headings": 721}, "invalid_request", "#/headings"),
        ({"heading_rad": 1.0}, "invalid_request", "#"),
    ],
)
def test_wrong_orders(client, room, change, code, pointer):
    problem = problem_of(client.post("/v1/fields", json={"map": room, **ORDER, **change}), 422, code)
    assert problem["errors"][0]["pointer"] == pointer
