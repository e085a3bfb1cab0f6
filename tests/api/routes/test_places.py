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


# --- simulated fixes ------------------------------------------------------------------------------

MANY = {**AT, "n": 4000, "points": 50, "seed": 3}


def test_simulated_fixes_at_a_pose(gallery):
    answer = gallery.client.post("/v1/fixes", json=MANY)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    answers_places.Fixes.model_validate(found)
    assert (found["status"], sorted(found["landmarks"]), found["failures"]) == ("ok", ["A", "C", "D"], {})
    assert found["share_inside"] == pytest.approx(0.95, abs=0.015)
    assert found["predicted_share"] == pytest.approx(0.95, abs=0.01)
    assert found["sample"]["area95_m2"] == pytest.approx(found["predicted"]["area95_m2"], rel=0.1)
    cloud = found["cloud"]
    assert {len(column) for column in cloud.values()} == {50}
    assert np.mean(cloud["x_m"]) == pytest.approx(1.25, abs=0.01)
    best = gallery.client.post("/v1/triplets", json=AT).json()["triplets"][0]
    assert found["predicted"]["area95_m2"] == pytest.approx(best["area95_m2"])
    assert gallery.client.post("/v1/fixes", json=MANY).content == answer.content, "same seed, same bytes"
    assert gallery.client.post("/v1/fixes", json={**MANY, "seed": 4}).content != answer.content


def test_all_landmarks_in_view_are_better_than_three(client, hall):
    three = client.post("/v1/fixes", json={**MANY, "map": hall, "n": 500}).json()
    every = client.post("/v1/fixes", json={**MANY, "map": hall, "n": 500, "estimator": "all_visible"}).json()
    answers_places.Fixes.model_validate(every)
    assert len(every["landmarks"]) > 3
    assert every["predicted"]["area95_m2"] < three["predicted"]["area95_m2"]
    assert every["predicted_share"] is every["valid"] is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pose": {"x_m": 4.0, "y_m": 3.0}}, "not free"),
        ({"pose": {"x_m": 4.0, "y_m": 4.2}}, "No triplet"),
        ({"triplet": ["A", "B", "C"]}, "B (hidden)"),
    ],
)
def test_where_there_is_no_fix_it_is_said(gallery, change, words):
    found = gallery.client.post("/v1/fixes", json={**MANY, **change}).json()
    answers_places.Fixes.model_validate(found)
    assert (found["status"], found["cloud"]) == ("no_fix", None)
    assert words in found["reason"]


@pytest.mark.parametrize(
    ("change", "code", "pointer"),
    [
        ({"n": 100_001}, "limit_exceeded", "#/n"),
        ({"points": 10_001}, "limit_exceeded", "#/points"),
        ({"n": 0}, "invalid_request", "#/n"),
        ({"triplet": ["A", "C", "Z"]}, "invalid_request", "#/triplet"),
        ({"triplet": ["A", "C", "D"], "estimator": "all_visible"}, "invalid_request", "#"),
        ({"pose": {"x_m": -9.0, "y_m": 0.0}}, "invalid_request", "#/pose"),
    ],
)
def test_wrong_questions_about_fixes(gallery, change, code, pointer):
    problem = problem_of(gallery.client.post("/v1/fixes", json={**MANY, **change}), 422, code)
    assert [e["pointer"] for e in problem["errors"]] == [pointer]


# --- localization ---------------------------------------------------------------------------------

POSE = np.array([1.5, 4.5, 0.4])
CORNERS = {"A": (0, 0), "B": (8, 0), "C": (8, 6), "D": (0, 6), "E": (2, 6), "F": (0, 4)}


def bearings(names, pose=POSE):
    return [
        {
            "landmark": n,
            "bearing_rad": math.atan2(CORNERS[n][1] - pose[1], CORNERS[n][0] - pose[0]) - pose[2],
        }
        for n in names
    ]


def located(client, body, status="ok"):
    answer = client.post("/v1/localize", json={"map": "room", "sensor": LASER, **body})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    answers_places.Localized.model_validate(found)
    assert found["status"] == status, found
    return found


def test_a_robot_that_sees_three_landmarks_knows_where_it_is(gallery):
    found = located(gallery.client, {"bearings": bearings("ACD")})
    pose = found["pose"]
    assert (pose["x_m"], pose["y_m"], pose["theta_rad"]) == pytest.approx(POSE)
    assert (found["dof"], found["p_value"], found["free"]) == (0, 1.0, True)
    at = {**AT, "pose": {"x_m": 1.5, "y_m": 4.5}, "triplet": ["A", "C", "D"]}
    fix = gallery.client.post("/v1/triplets", json=at).json()["asked"]["fix"]
    assert found["covariance"][:3] == pytest.approx(fix["covariance"]), "what the field would say there"
    assert found["sigma_theta_rad"] == pytest.approx(fix["sigma_theta_rad"])


def test_degrees_and_mounts(gallery):
    turned = {**LASER, "mount": {"x_m": 0.3, "y_m": 0.1, "theta_deg": 90.0}}
    c, s = math.cos(POSE[2]), math.sin(POSE[2])
    sensor = np.array([POSE[0] + 0.3 * c - 0.1 * s, POSE[1] + 0.3 * s + 0.1 * c, POSE[2] + math.pi / 2])
    seen = [
        {"landmark": b["landmark"], "bearing_deg": math.degrees(b["bearing_rad"])}
        for b in bearings("ACD", sensor)
    ]
    pose = located(gallery.client, {"sensor": turned, "bearings": seen})["pose"]
    assert (pose["x_m"], pose["y_m"], pose["theta_rad"]) == pytest.approx(POSE)


def test_a_misread_landmark_is_suspected(client, hall):
    seen = bearings("ACDEF")
    seen[2]["bearing_rad"] += 0.1
    found = located(client, {"map": hall, "bearings": seen}, "ambiguous")
    assert found["suspects"] == ["D"]
    assert found["p_value"] < 1e-3
    assert "Without D the others agree" in found["reason"]
    assert located(client, {"map": hall, "bearings": bearings("ACDEF")})["suspects"] == []


@pytest.mark.parametrize("names", ["AAC", "ABD"])
def test_what_gives_no_fix_is_said(gallery, names):
    # The corners of a rectangle and a robot on their circle.
    r = math.hypot(4, 3)
    on_circle = np.array([4 + r * math.cos(2.0), 3 + r * math.sin(2.0), 0.0])
    found = located(gallery.client, {"bearings": bearings(names, on_circle)}, "degenerate")
    assert found["pose"] is found["covariance"] is None
    assert found["reason"]


def test_columns_of_a_camera(client, hall):
    pan = math.radians(138.0)
    marks = ("D", "E", "F")
    pose = np.array([2.0, 4.3, 0.0])
    focal, middle = 512.0, 256.0
    columns = []
    for n in marks:
        off = math.atan2(CORNERS[n][1] - pose[1], CORNERS[n][0] - pose[0]) - pan
        columns.append({"landmark": n, "column_px": middle - focal * math.tan(off)})
    wide = {"kind": "pinhole_pan", "fov_deg": 120.0, "focal_px": 512.0, "column_sigma_px": 1.0}
    body = {"map": hall, "sensor": wide, "pan_deg": 138.0}
    width = 2 * focal * math.tan(math.radians(60.0))
    shifted = [{**c, "column_px": c["column_px"] - middle + width / 2} for c in columns]
    found = located(client, {**body, "columns": shifted, "principal_px": None})
    assert (found["pose"]["x_m"], found["pose"]["y_m"]) == pytest.approx((2.0, 4.3))
    same = located(client, {**body, "columns": shifted, "principal_px": width / 2})
    assert same == found, "the axis is in the middle unless it is said otherwise"


def test_sigmas_may_differ(gallery):
    rough = [{**b, "sigma_deg": 1.0} for b in bearings("ACD")]
    ten = (
        located(gallery.client, {"bearings": rough})["r95_m"]
        / located(gallery.client, {"bearings": bearings("ACD")})["r95_m"]
    )
    assert ten == pytest.approx(10.0)
    forward = {"sensor": "forward", "bearings": bearings("ACD")}
    problem = problem_of(
        gallery.client.post("/v1/localize", json={"map": "room", **forward}), 422, "invalid_request"
    )
    assert problem["errors"][0]["pointer"] == "#/bearings"
    located(gallery.client, {"sensor": "forward", "bearings": rough})


def test_a_survey_sigma_counts_by_distance(client, room):
    held = client.get("/v1/maps/room/landmarks")
    body = held.json()
    before = located(client, {"bearings": bearings("ACD")})
    body["landmarks"][3]["sigma_m"] = 0.05
    client.put("/v1/maps/room/landmarks", json=body, headers={"if-match": held.headers["etag"]})
    after = located(client, {"bearings": bearings("ACD")})
    assert after["r95_m"] > before["r95_m"]
    distance = math.hypot(CORNERS["D"][0] - POSE[0], CORNERS["D"][1] - POSE[1])
    assert after["residuals"][2]["sigma_rad"] == pytest.approx(math.hypot(math.radians(0.1), 0.05 / distance))


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({}, "invalid_request"),
        ({"bearings": bearings("AC")}, "invalid_request"),
        ({"bearings": [*bearings("AC"), {"landmark": "Z", "bearing_rad": 0.0}]}, "invalid_request"),
        ({"bearings": [*bearings("AC"), {"landmark": "D"}]}, "invalid_request"),
        (
            {"bearings": [*bearings("AC"), {"landmark": "D", "bearing_rad": 1.0, "bearing_deg": 1.0}]},
            "invalid_request",
        ),
        ({"bearings": bearings("ACD"), "pan_deg": 1.0}, "invalid_request"),
        ({"columns": [{"landmark": n, "column_px": 1.0} for n in "ACD"]}, "invalid_request"),
        (
            {"sensor": "mas97", "columns": [{"landmark": n, "column_px": 9999.0} for n in "ACD"]},
            "invalid_request",
        ),
        ({"bearings": bearings("A") * 1001}, "limit_exceeded"),
    ],
)
def test_wrong_measurements(gallery, body, code):
    problem_of(gallery.client.post("/v1/localize", json={"map": "room", "sensor": LASER, **body}), 422, code)
