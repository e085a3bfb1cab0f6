"""Maps over HTTP."""

from __future__ import annotations

import copy
import io

import pytest
from PIL import Image

from api import answers
from tests.api.conftest import ROOM, problem_of


def test_a_room_goes_in_and_comes_out(client):
    first = client.post("/v1/maps", json=ROOM)
    assert first.status_code == 201
    answers.MapUploaded.model_validate(first.json())
    map_id = first.json()["map"]
    assert first.headers["location"] == f"/v1/maps/{map_id}"
    again = client.post("/v1/maps", json=ROOM)
    assert (again.status_code, again.json()["map"]) == (200, map_id)
    listed = client.get("/v1/maps").json()
    answers.Maps.model_validate(listed)
    assert [m["map"] for m in listed["maps"]] == [map_id]
    assert listed["maps"][0]["free_area_m2"] == pytest.approx(44.0)
    back = client.get(f"/v1/maps/{map_id}/world.geojson")
    assert back.headers["content-type"] == "application/geo+json"
    assert client.post("/v1/maps", content=back.content, headers=back.headers).json()["map"] == map_id


def test_a_name_stands_for_the_newest_map(client, room):
    assert client.get("/v1/maps/room").json()["map"] == room
    other = copy.deepcopy(ROOM)
    other["features"].pop()
    newer = client.post("/v1/maps", json=other).json()["map"]
    assert newer != room
    assert client.get("/v1/maps/room").json()["map"] == newer
    assert client.post("/v1/maps?name=hall", json=ROOM).json()["name"] == "hall"
    assert client.get("/v1/maps/hall").json()["map"] == room


def test_landmarks_and_picture(client, room):
    found = client.get(f"/v1/maps/{room}/landmarks").json()
    answers.Landmarks.model_validate(found)
    assert [m["id"] for m in found["landmarks"]] == ["A", "B", "C", "D"]
    assert found["landmarks"][1] == {
        "id": "B",
        "x_m": 8.0,
        "y_m": 0.0,
        "facing_rad": None,
        "half_angle_rad": pytest.approx(3.14159265),
        "sigma_m": 0.0,
    }
    picture = Image.open(io.BytesIO(client.get(f"/v1/maps/{room}/image.png").content))
    assert picture.width / picture.height == pytest.approx(8 / 6, rel=0.01)


@pytest.mark.parametrize("part", ["", "/image.png", "/landmarks", "/world.geojson"])
def test_what_the_client_holds_is_not_sent_again(client, room, part):
    first = client.get(f"/v1/maps/{room}{part}")
    again = client.get(f"/v1/maps/{room}{part}", headers={"if-none-match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    named = client.get(f"/v1/maps/room{part}")
    assert named.content == first.content
    assert "immutable" not in named.headers["cache-control"]


def test_delete(client, room):
    assert client.delete(f"/v1/maps/{room}").status_code == 204
    problem_of(client.get(f"/v1/maps/{room}"), 404, "not_found")
    problem_of(client.delete(f"/v1/maps/{room}"), 404, "not_found")


def test_a_map_with_a_field_stays(client, field):
    problem_of(client.delete(f"/v1/maps/{field.map}"), 409, "in_use")
    assert client.delete(field.path).status_code == 204
    assert client.delete(f"/v1/maps/{field.map}").status_code == 204


def _with(**changes):
    document = copy.deepcopy(ROOM)
    document["features"][-1].update(changes)
    return document


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        (b"", 400, "malformed_body"),
        (b"{", 400, "malformed_body"),
        (b"\xff", 400, "malformed_body"),
        (b"[" * 10_000, 400, "malformed_body"),
        (b'{"type": NaN}', 400, "malformed_body"),
        ([], 422, "invalid_map"),
        ({}, 422, "invalid_map"),
        ({**ROOM, "colour": 1}, 422, "invalid_map"),
        (_with(geometry=None), 422, "invalid_map"),
        (_with(properties={"kind": "landmark", "id": "A"}), 422, "duplicate_landmark"),
        (_with(geometry={"type": "Point", "coordinates": [0, 0]}), 422, "duplicate_landmark"),
        (_with(geometry={"type": "Point", "coordinates": [99, 0]}), 422, "landmark_outside_map"),
        (_with(properties={"kind": "landmark", "id": "\ud800"}), 422, "invalid_map"),
    ],
)
def test_wrong_maps_change_nothing(client, body, status, code):
    if isinstance(body, bytes):
        answer = client.post("/v1/maps", content=body, headers={"content-type": "application/json"})
    else:
        import json

        answer = client.post(
            "/v1/maps", content=json.dumps(body), headers={"content-type": "application/json"}
        )
    problem_of(answer, status, code)
    assert client.get("/v1/maps").json() == {"maps": []}


@pytest.mark.parametrize(
    ("files", "data", "where"),
    [
        ({"meta": b"x"}, {}, "#/image"),
        ({"image": b"x"}, {}, "#/meta"),
        ({"image": b"x", "meta": b"\xff"}, {}, "#/meta"),
        ({"image": b"x", "meta": b"x"}, {"unknown_is_free": "perhaps"}, "#/unknown_is_free"),
        ({"image": b"x", "meta": b"x"}, {"name": "m_1"}, "name"),
        ({"image": b"x", "meta": b"x"}, {"name": "a\nb"}, "name"),
        ({"image": b"x", "meta": b"x", "colour": b"x"}, {}, None),
    ],
)
def test_wrong_forms_name_the_part(client, files, data, where):
    files = {key: (key, io.BytesIO(value)) for key, value in files.items()}
    problem = problem_of(client.post("/v1/maps", files=files, data=data), 422, "invalid_request")
    if where is not None:
        assert where in problem["errors"][0].values()


def test_a_broken_form_is_malformed(client):
    answer = client.post(
        "/v1/maps", content=b"--x\r\nrubbish", headers={"content-type": "multipart/form-data"}
    )
    problem_of(answer, 400, "malformed_body")
    answer = client.post(
        "/v1/maps", content=b"--x\r\nrubbish", headers={"content-type": "multipart/form-data; boundary=x"}
    )
    problem_of(answer, 422, "invalid_request")


def test_other_media_are_refused(client):
    answer = client.post("/v1/maps", content=b"x", headers={"content-type": "image/png"})
    problem_of(answer, 415, "unsupported_media")
