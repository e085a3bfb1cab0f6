"""Other landmarks for a map, and where on it a robot fits, over HTTP."""

from __future__ import annotations

import copy
import math

import pytest

from api import answers
from tests.api.conftest import LASER, problem_of


@pytest.fixture
def held(client, room):
    """The landmarks of the room as GET gives them, and their ETag."""
    found = client.get(f"/v1/maps/{room}/landmarks")
    return found.json(), found.headers["etag"]


def put(client, where, body, tag, query=""):
    headers = {} if tag is None else {"if-match": tag}
    return client.put(f"/v1/maps/{where}/landmarks{query}", json=body, headers=headers)


def moved(body, x=1.0):
    changed = copy.deepcopy(body)
    changed["landmarks"][0]["x_m"] = x
    return changed


def test_a_moved_landmark_makes_a_version_with_a_parent(client, room, held):
    body, tag = held
    made = put(client, "room", moved(body), tag)
    assert made.status_code == 201, made.text
    answers.MapEdited.model_validate(made.json())
    newer = made.json()["map"]
    assert newer != room
    assert made.json()["parent"] == room
    assert made.headers["location"] == f"/v1/maps/{newer}"
    assert client.get("/v1/maps/room").json()["map"] == newer, "the name moves forward"
    assert client.get(f"/v1/maps/{room}/landmarks").json() == body, "versions never change"
    now = client.get("/v1/maps/room/landmarks")
    assert now.json()["landmarks"][0]["x_m"] == 1.0
    assert now.headers["etag"] == made.json()["landmarks_etag"]
    again = put(client, "room", {"landmarks": moved(body)["landmarks"]}, made.json()["landmarks_etag"])
    assert (again.status_code, again.json()["map"]) == (200, newer)


def test_what_get_gives_can_be_put_unchanged(client, room, held):
    same = put(client, room, *held)
    assert (same.status_code, same.json()["map"], same.json()["parent"]) == (200, room, None)
    assert len(client.get("/v1/maps").json()["maps"]) == 1


def test_nobodys_change_is_lost(client, room, held):
    body, tag = held
    problem_of(put(client, "room", moved(body), None), 428, "if_match_required")
    problem_of(put(client, "room", moved(body), '"other"'), 412, "version_changed")
    problem_of(put(client, "room", moved(body), f"W/{tag}"), 412, "version_changed")
    newer = put(client, "room", moved(body), f'"other", {tag}').json()["map"]
    late = problem_of(put(client, "room", moved(body, 2.0), tag), 412, "version_changed")
    assert late["hint"] == {"map": f"/v1/maps/{newer}"}
    by_id = problem_of(put(client, room, moved(body, 2.0), tag), 412, "version_changed")
    assert by_id["hint"] == {"map": f"/v1/maps/{newer}"}
    fork = put(client, room, moved(body, 2.0), tag, "?name=trial")
    assert (fork.status_code, fork.json()["name"], fork.json()["parent"]) == (201, "trial", room)
    assert client.get("/v1/maps/room").json()["map"] == newer
    assert put(client, "room", {"landmarks": moved(body, 2.5)["landmarks"]}, "*").status_code == 201
    problem_of(put(client, "room", moved(body, 2.6), "*"), 412, "version_changed")


def test_angles_and_sigmas_come_back(client, room, held):
    body = {
        "landmarks": [
            {"id": "N", "x_m": 1, "y_m": 1, "facing_deg": 90.0, "half_angle_deg": 45.0, "sigma_m": 0.02}
        ]
    }
    assert put(client, "room", body, held[1]).status_code == 201
    (mark,) = client.get("/v1/maps/room/landmarks").json()["landmarks"]
    assert mark["facing_rad"] == pytest.approx(math.pi / 2)
    assert mark["half_angle_rad"] == pytest.approx(math.pi / 4)
    assert mark["sigma_m"] == 0.02
    # Too few for a field, which is said when one is ordered.
    assert client.get("/v1/maps/room").json()["landmarks"] == 1


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({}, "invalid_request"),
        ({"landmarks": [{"id": "A", "x_m": 1}]}, "invalid_request"),
        ({"landmarks": [{"id": "A", "x_m": 1, "y_m": 1, "z_m": 1}]}, "invalid_request"),
        ({"landmarks": [{"id": "", "x_m": 1, "y_m": 1}]}, "invalid_request"),
        ({"landmarks": [{"id": "A\n", "x_m": 1, "y_m": 1}]}, "invalid_landmark"),
        ({"landmarks": [{"id": "A", "x_m": 1, "y_m": 1, "facing_deg": 1, "facing_rad": 1}]}, "invalid_request"),
        ({"landmarks": [{"id": "A", "x_m": 99, "y_m": 1}]}, "landmark_outside_map"),
        ({"landmarks": [{"id": "A", "x_m": 1, "y_m": 1}] * 2}, "duplicate_landmark"),
    ],
)  # fmt: skip
def test_wrong_landmarks(client, room, held, body, code):
    problem_of(put(client, "room", body, held[1]), 422, code)
    assert len(client.get("/v1/maps").json()["maps"]) == 1


def test_too_many_landmarks_name_the_limit(client, room, held, monkeypatch):
    service = client.app.state.service
    monkeypatch.setattr(service, "settings", service.settings.model_copy(update={"max_landmarks": 3}))
    problem = problem_of(put(client, "room", moved(held[0]), held[1]), 422, "limit_exceeded")
    assert (problem["limit"], problem["requested"]) == (3, 4)
    assert problem["setting"] == "SUREPATH_MAX_LANDMARKS"


def test_unknown_maps(client):
    problem_of(put(client, "hall", {"landmarks": []}, "*"), 404, "not_found")
    problem_of(client.get("/v1/maps/hall/snap?x_m=1&y_m=1"), 404, "not_found")


def test_fields_of_the_new_version_are_its_own(client, field, held):
    body, tag = held
    newer = put(client, "room", moved(body), tag).json()["map"]
    assert client.get(f"/v1/fields?map={newer}").json() == {"fields": []}
    made = client.post("/v1/fields", json={"map": "room", "sensor": LASER, "resolution_m": 0.5})
    assert (made.status_code, made.json()["field"] != field.id) == (202, True)


def test_the_example_of_the_document_works(client):
    upload = client.get("/openapi.json").json()
    example = upload["paths"]["/v1/maps"]["post"]["requestBody"]["content"]["application/json"]["example"]
    client.post("/v1/maps", json={**example, "name": "room"})
    body = upload["components"]["schemas"]["LandmarksIn"]["examples"][0]
    assert put(client, "room", body, "*").status_code == 201


def test_a_free_place_stays_where_it_is(gallery):
    answer = gallery.client.get(f"/v1/maps/{gallery.map}/snap?x_m=1.5&y_m=3&radius_m=0.3&theta_rad=4")
    found = answer.json()
    answers.Snapped.model_validate(found)
    assert found["pose"] == {"x_m": 1.5, "y_m": 3.0, "theta_rad": pytest.approx(4 - 2 * math.pi)}
    assert (found["moved_m"], found["clearance_m"]) == (0.0, pytest.approx(1.5))
    held = {"if-none-match": answer.headers["etag"]}
    url = "/v1/maps/room/snap?x_m=1.5&y_m=3&radius_m=0.3&theta_rad=4"
    assert gallery.client.get(url, headers=held).status_code == 304


@pytest.mark.parametrize(("x", "y", "snapped"), [(3.2, 3.0, (2.7, 3.0)), (-5.0, 3.0, (0.3, 3.0))])
def test_the_nearest_place_is_found(gallery, x, y, snapped):
    found = gallery.client.get(f"/v1/maps/room/snap?x_m={x}&y_m={y}&radius_m=0.3").json()
    assert (found["pose"]["x_m"], found["pose"]["y_m"]) == pytest.approx(snapped, abs=0.02)
    assert found["clearance_m"] >= 0.3
    assert found["moved_m"] == pytest.approx(abs(x - snapped[0]), abs=0.02)


def test_a_robot_that_fits_nowhere(gallery):
    found = gallery.client.get("/v1/maps/room/snap?x_m=1&y_m=1&radius_m=50").json()
    answers.Snapped.model_validate(found)
    assert found["pose"] is found["moved_m"] is None


@pytest.mark.parametrize("query", ["", "x_m=1", "x_m=nan&y_m=1", "x_m=1e9&y_m=1", "x_m=1&y_m=1&radius_m=-1"])
def test_wrong_places_to_snap(gallery, query):
    problem_of(gallery.client.get(f"/v1/maps/room/snap?{query}"), 422, "invalid_request")
