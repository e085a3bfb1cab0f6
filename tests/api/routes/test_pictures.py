"""Legends, tiles, statistics and windows over HTTP."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from api import answers_fields
from api.routes.heatmaps import RENDERER
from planner.problem import MAX_AREAS
from tests.api.conftest import problem_of

SQUARE = {"type": "Polygon", "coordinates": [[[0, 0], [3, 0], [3, 3], [0, 3], [0, 0]]]}


def test_the_legend_as_values(gallery):
    found = gallery.client.get(f"{gallery.path}/legend.json?metric=r95_m&rescale=0.01,1").json()
    answers_fields.Legend.model_validate(found)
    assert (found["unit"], found["scale"], found["rescale"]) == ("m", "log", [0.01, 1.0])
    assert (len(found["colors"]), found["colors"][0]) == (256, "#440154")
    at = {t["value"]: t["position"] for t in found["ticks"]}
    assert at[0.1] == pytest.approx(0.5)


def test_the_legend_as_a_picture(gallery):
    answer = gallery.client.get(f"{gallery.path}/legend.png?height=300")
    assert Image.open(io.BytesIO(answer.content)).size == (118, 300)
    assert "max-age=3600" in answer.headers["cache-control"]
    kept = gallery.client.get(f"{gallery.path}/legend.png?height=300&v={RENDERER}")
    assert "immutable" in kept.headers["cache-control"]
    other = gallery.client.get(f"{gallery.path}/legend.png?height=300&v={RENDERER + 1}")
    assert "immutable" not in other.headers["cache-control"], "another renderer would give another picture"


def test_tiles_are_where_the_document_says(gallery):
    found = gallery.client.get(f"{gallery.path}/tilejson.json?metric=sigma_max_m").json()
    answers_fields.TileJson.model_validate(found)
    assert (found["minzoom"], found["maxzoom"], found["pixel_m"]) == (0, 0, [0.5])
    assert (found["extent"]["x_min_m"], found["extent"]["y_max_m"]) == (0.0, 6.0)
    url = found["tiles"][0].format(z=0, x=0, y=0)
    answer = gallery.client.get(url)
    assert answer.status_code == 200, answer.text
    assert "immutable" in answer.headers["cache-control"]
    shown = np.asarray(Image.open(io.BytesIO(answer.content)))
    assert shown.shape == (256, 256, 4)
    assert shown[:12, :16, 3].any()
    assert not shown[12:, :, 3].any()
    array = gallery.client.get(found["arrays"][0].format(z=0, x=0, y=0))
    values = np.load(io.BytesIO(array.content))
    stored = gallery.client.app.state.service.store.load_field(gallery.id).metric("sigma_max_m")
    np.testing.assert_array_equal(values[-12:, :16], stored.astype(np.float32))
    legend = gallery.client.get(found["legend"]).json()
    assert legend["rescale"] == found["rescale"]
    again = gallery.client.get(url, headers={"if-none-match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize("tile", ["1/0/0", "0/1/0", "0/0/1", "40/0/0"])
@pytest.mark.parametrize("kind", ["png", "npy"])
def test_there_are_no_other_tiles(gallery, tile, kind):
    problem_of(gallery.client.get(f"{gallery.path}/tiles/{tile}.{kind}"), 404, "not_found")


@pytest.mark.parametrize(
    ("part", "code"),
    [
        ("tiles/0/0/x.png", "invalid_request"),
        ("tiles/-1/0/0.png", "invalid_request"),
        ("tiles/0/0/0.png?metric=beauty", "invalid_request"),
        ("tiles/0/0/0.png?rescale=2,1", "invalid_picture"),
        ("tiles/0/0/0.png?rescale=0,1", "invalid_picture"),
        ("tiles/0/0/0.png?colormap_name=jet", "invalid_picture"),
        ("legend.json?rescale=nan,1", "invalid_request"),
        ("legend.png?height=10", "invalid_request"),
        ("tilejson.json?scale=cubic", "invalid_request"),
        ("statistics?percentiles=101", "invalid_request"),
        ("statistics?percentiles=a", "invalid_request"),
        ("statistics?bbox=1,2,3", "invalid_request"),
        ("statistics?bbox=100,100,101,101", "invalid_picture"),
        ("statistics?bins=0", "invalid_request"),
        ("heatmap.json?max_size=0", "invalid_request"),
        ("heatmap.json?metric=x", "invalid_request"),
    ],
)
def test_wrong_questions(gallery, part, code):
    problem_of(gallery.client.get(f"{gallery.path}/{part}"), 422, code)


def test_statistics_of_the_field(gallery):
    answer = gallery.client.get(f"{gallery.path}/statistics?metric=sigma_max_m&percentiles=50,95&bins=4")
    found = answer.json()
    answers_fields.FieldStatistics.model_validate(found)
    stored = gallery.client.app.state.service.store.load_field(gallery.id)
    values = stored.metric("sigma_max_m")
    assert found["share_with_fix"] == pytest.approx(np.isfinite(values).sum() / stored.free.sum())
    assert [p["value"] for p in found["percentiles"]] == pytest.approx(np.nanpercentile(values, [50, 95]))
    assert len(found["histogram"]["counts"]) == 4
    held = {"if-none-match": answer.headers["etag"]}
    same = f"{gallery.path}/statistics?percentiles=50,95&bins=4&metric=sigma_max_m&scale=log"
    assert gallery.client.get(same, headers=held).status_code == 304
    part = gallery.client.get(f"{gallery.path}/statistics?bbox=0,0,8,1").json()
    assert (part["cells"], part["share_with_fix"], part["mean"]) == (32, 0.0, None)


def test_statistics_of_areas(gallery):
    body = {"metric": "r95_m", "areas": [SQUARE, {**SQUARE, "coordinates": [[[50, 0], [53, 0], [53, 3]]]}]}
    answer = gallery.client.post(f"{gallery.path}/statistics", json=body)
    assert answer.status_code == 200, answer.text
    answers_fields.AreaStatistics.model_validate(answer.json())
    first, beside = answer.json()["areas"]
    assert first["cells"] == 36
    assert first["share_with_fix"] == pytest.approx(24 / 36)
    assert beside["cells"] == 0
    schemas = gallery.client.get("/openapi.json").json()["components"]["schemas"]
    example = schemas["StatisticsIn"]["examples"][0]
    assert gallery.client.post(f"{gallery.path}/statistics", json=example).status_code == 200


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({}, "invalid_request"),
        ({"areas": []}, "invalid_request"),
        ({"areas": [SQUARE] * (MAX_AREAS + 1)}, "invalid_request"),
        ({"areas": [SQUARE], "metric": "beauty"}, "invalid_request"),
        ({"areas": [SQUARE], "percentiles": [101]}, "invalid_request"),
        ({"areas": [{**SQUARE, "coordinates": [[[0, 0], [2, 2], [2, 0], [0, 2]]]}]}, "invalid_geometry"),
        ({"areas": [{**SQUARE, "coordinates": [[[0, 0], [1, 1], [2, 2]]]}]}, "invalid_geometry"),
        ({"areas": [{**SQUARE, "coordinates": [[[0, 0], [1e308, 0], [1e308, 1e308]]]}]}, "invalid_geometry"),
    ],
)
def test_wrong_areas(gallery, body, code):
    problem_of(gallery.client.post(f"{gallery.path}/statistics", json=body), 422, code)


def test_a_window_as_json(gallery):
    found = gallery.client.get(f"{gallery.path}/heatmap.json?metric=sigma_max_m&bbox=0,2,2,4").json()
    answers_fields.Window.model_validate(found)
    stored = gallery.client.app.state.service.store.load_field(gallery.id).metric("sigma_max_m")
    np.testing.assert_allclose(np.array(found["values"]), stored[4:8, 0:4], rtol=1e-5)
    small = gallery.client.get(f"{gallery.path}/heatmap.json?max_size=4").json()
    assert max(small["rows"], small["columns"]) == 4


def test_a_window_as_json_has_a_limit(client, field, monkeypatch):
    service = client.app.state.service
    monkeypatch.setattr(service, "settings", service.settings.model_copy(update={"max_json_cells": 10}))
    problem = problem_of(client.get(f"{field.path}/heatmap.json"), 422, "limit_exceeded")
    assert (problem["limit"], problem["requested"], problem["setting"]) == (
        10,
        192,
        "SUREPATH_MAX_JSON_CELLS",
    )


@pytest.mark.parametrize(
    "part",
    [
        "legend.json",
        "legend.png",
        "tilejson.json",
        "tiles/0/0/0.png",
        "tiles/0/0/0.npy",
        "statistics",
        "heatmap.json",
    ],
)
def test_fields_that_are_not_there(gallery, part):
    problem_of(gallery.client.get(f"/v1/fields/f_1/{part}"), 404, "not_found")
