"""Questions about one place of a map over HTTP."""

from __future__ import annotations

import math

import numpy as np
import pytest

from api import answers, answers_places
from api.store_files import write_field
from localization.field_builder import build_field
from tests.api.conftest import LASER, ROOM, problem_of

HALL = {
    **ROOM,
    "name": "hall",
    "features": [
        *ROOM["features"],
        *(
            {
                "type": "Feature",
                "properties": {"kind": "landmark", "id": name},
                "geometry": {"type": "Point", "coordinates": place},
            }
            for name, place in (("E", [2, 6]), ("F", [0, 4]))
        ),
    ],
}
AT = {"map": "room", "sensor": LASER, "pose": {"x_m": 1.25, "y_m": 4.75}}


@pytest.fixture
def hall(client):
    """The id of an uploaded room with six landmarks."""
    return client.post("/v1/maps", json=HALL).json()["map"]


def built_field(client, map_id: str, sensor=LASER, resolution=0.5) -> str:
    """Path of a field with the numbers that a worker would compute."""
    ordered = client.post(
        "/v1/fields", json={"map": map_id, "sensor": sensor, "resolution_m": resolution}
    ).json()
    store = client.app.state.service.store
    job = store.claim_job(ordered["job"])
    record = store.field(job.field_id)
    field = build_field(
        store.world(record.map_id), record.sensor, resolution=record.resolution, heading=record.heading
    )
    staged = store.staging_path(job.id)
    size, checksum = write_field(field, staged)
    assert store.commit_field(job.id, staged, size=size, checksum=checksum)
    return f"/v1/fields/{ordered['field']}"


def test_a_point_ranks_its_triplets_as_the_field_does(client, hall):
    path = built_field(client, hall)
    value = client.get(f"{path}/point?x_m=1.4&y_m=4.6&ranking=10").json()
    answers.PointValue.model_validate(value)
    ranking = value["ranking"]
    assert ranking["place"] == {"x_m": 1.25, "y_m": 4.75}, "the middle of the cell"
    best = ranking["triplets"][0]
    assert sorted(best["triplet"]) == sorted(value["triplet"])
    assert best["area95_m2"] == pytest.approx(value["metrics"]["area95_m2"])
    assert best["ellipse95"] == pytest.approx(value["ellipse95"])
    areas = [t["area95_m2"] for t in ranking["triplets"]]
    assert areas == sorted(areas)
    by_id = {m["id"]: m for m in ranking["landmarks"]}
    assert (by_id["B"]["x_m"], by_id["B"]["y_m"]) == (8, 0)
    assert by_id["A"]["distance_m"] == pytest.approx(math.hypot(1.25, 4.75))
    assert by_id["A"]["bearing_rad"] == pytest.approx(math.atan2(-4.75, -1.25))
    assert len(areas) > 3
    assert sum(ranking["counts"].values()) == math.comb(6, 3)


def test_the_ranking_is_part_of_the_tag(gallery):
    plain = gallery.client.get(f"{gallery.path}/point?x_m=1&y_m=3")
    assert plain.json()["ranking"] is None
    ranked = gallery.client.get(f"{gallery.path}/point?x_m=1&y_m=3&ranking=2")
    assert ranked.headers["etag"] != plain.headers["etag"]
    held = {"if-none-match": ranked.headers["etag"]}
    assert gallery.client.get(f"{gallery.path}/point?x_m=1&y_m=3&ranking=2", headers=held).status_code == 304
    assert gallery.client.get(f"{gallery.path}/point?x_m=1&y_m=3&ranking=3", headers=held).status_code == 200


def test_outside_nothing_is_ranked_and_on_obstacles_it_is_said(gallery):
    assert gallery.client.get(f"{gallery.path}/point?x_m=-3&y_m=3&ranking=2").json()["ranking"] is None
    ranking = gallery.client.get(f"{gallery.path}/point?x_m=4.1&y_m=3.1&ranking=2").json()["ranking"]
    assert (ranking["free"], ranking["triplets"]) == (False, [])
    assert "not free" in ranking["reason"]


@pytest.mark.parametrize(
    ("count", "code"), [("0", "invalid_request"), ("10001", "invalid_request"), ("1001", "limit_exceeded")]
)
def test_rankings_have_a_limit(gallery, count, code):
    problem = problem_of(gallery.client.get(f"{gallery.path}/point?x_m=1&y_m=3&ranking={count}"), 422, code)
    if code == "limit_exceeded":
        assert (problem["limit"], problem["setting"]) == (1000, "SUREPATH_MAX_RANKING")


def test_triplets_at_a_pose(gallery):
    found = gallery.client.post("/v1/triplets", json={**AT, "count": 2})
    assert found.status_code == 200, found.text
    body = found.json()
    answers_places.Triplets.model_validate(body)
    assert body["map"] == gallery.map
    assert [sorted(t["triplet"]) for t in body["triplets"]] == [["A", "C", "D"]]
    assert body["asked"] is None
    of_field = gallery.client.post(
        "/v1/triplets", json={"field": gallery.id, "pose": AT["pose"], "count": 2}
    ).json()
    assert of_field == body, "the field has the same sensor"


def test_a_hidden_landmark_is_named_with_what_it_would_bring(gallery):
    # From just above the block's middle, the corners below are hidden behind it.
    body = gallery.client.post("/v1/triplets", json={**AT, "pose": {"x_m": 4.0, "y_m": 4.2}}).json()
    status = {m["id"]: m["status"] for m in body["landmarks"]}
    assert (status["A"], status["B"], status["C"]) == ("hidden", "hidden", "measurable")
    assert body["triplets"] == []
    assert body["reason"].startswith("2 of 4 landmarks can be measured (2 are hidden): a fix needs three.")
    assert "something opaque is in between" in body["reason"]
    for missed in body["missed"]:
        assert set(missed["blocking"]) == set(missed["triplet"]) & {"A", "B"}


def test_one_triplet_is_asked_about(client, hall):
    at = {**AT, "map": hall}
    body = client.post("/v1/triplets", json={**at, "count": 1, "triplet": ["D", "A", "E"]}).json()
    answers_places.Triplets.model_validate(body)
    assert len(body["triplets"]) == 1
    asked = body["asked"]
    assert (asked["status"], asked["blocking"]) == ("fix", {})
    everything = client.post("/v1/triplets", json=at).json()["triplets"]
    rank = [set(t["triplet"]) for t in everything].index({"A", "D", "E"}) + 1
    assert (asked["rank"], asked["of"]) == (rank, len(everything))
    assert asked["fix"]["area95_m2"] == pytest.approx(everything[rank - 1]["area95_m2"])


@pytest.mark.parametrize(("degrees", "status"), [(20.0, "measurable"), (180.0, "outside_view")])
def test_the_heading_turns_a_fixed_camera(gallery, degrees, status):
    at = {**AT, "sensor": "forward", "pose": {**AT["pose"], "theta_deg": degrees}}
    landmarks = gallery.client.post("/v1/triplets", json=at).json()["landmarks"]
    assert {m["id"]: m["status"] for m in landmarks}["C"] == status


@pytest.mark.parametrize(
    ("change", "status", "code", "pointer"),
    [
        ({"map": "hall"}, 404, "not_found", None),
        ({"field": "f_1"}, 422, "invalid_request", "#"),
        ({"sensor": None}, 422, "invalid_request", "#"),
        ({"sensor": "sonar"}, 422, "invalid_request", "#/sensor"),
        ({"pose": {"x_m": 99.0, "y_m": 0.0}}, 422, "invalid_request", "#/pose"),
        ({"pose": {"x_m": 1.0, "y_m": 1.0, "theta_deg": 1.0, "theta_rad": 1.0}}, 422, "invalid_request", "#/pose"),
        ({"count": 1001}, 422, "limit_exceeded", "#/count"),
        ({"count": 0}, 422, "invalid_request", "#/count"),
        ({"triplet": ["A", "B"]}, 422, "invalid_request", "#/triplet"),
        ({"triplet": ["A", "B", "Z"]}, 422, "invalid_request", None),
        ({"triplet": ["A", "B", "B"]}, 422, "invalid_request", None),
        ({"colour": 1}, 422, "invalid_request", "#/colour"),
    ],
)  # fmt: skip
def test_wrong_questions_about_triplets(gallery, change, status, code, pointer):
    problem = problem_of(gallery.client.post("/v1/triplets", json={**AT, **change}), status, code)
    if pointer is not None:
        assert [e["pointer"] for e in problem["errors"]] == [pointer]


def test_two_landmarks_are_too_few(client):
    features = [f for f in ROOM["features"] if f["properties"].get("id") not in {"A", "B"}]
    client.post("/v1/maps", json={**ROOM, "features": features})
    problem_of(client.post("/v1/triplets", json=AT), 422, "too_few_landmarks")


def test_numbers_are_plain(client, hall):
    """A NaN in an answer would be a bug; a camera has pan angles and validities of its own."""
    at = {**AT, "map": hall, "sensor": "mas97", "pose": {"x_m": 5.5, "y_m": 5.0}}
    body = client.post("/v1/triplets", json=at).json()
    answers_places.Triplets.model_validate(body)
    assert body["triplets"], body["reason"]
    assert all(t["pan_rad"] is not None and np.isfinite(t["pan_rad"]) for t in body["triplets"])
