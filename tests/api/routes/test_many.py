"""Matrices, areas within reach and simulations over HTTP, by the real engine."""

from __future__ import annotations

import math

import pytest
import shapely

from api import answers_many
from api.codec_matrix import LAYERS
from api.schemas_many import METRICS
from planner.plan import warm_up
from tests.api.conftest import problem_of

ROBOT = {"radius_m": 0.2}
LEFT, RIGHT, INSIDE, BLIND = ({"x_m": x, "y_m": y} for x, y in ((1, 3), (7, 3), (4, 3), (6, 0.5)))
MATRIX = {"robot": ROBOT, "sources": [LEFT], "targets": [LEFT, RIGHT]}
REACH = {"robot": ROBOT, "start": LEFT}
DRIVE = {
    "trajectory": [{"t_s": t, "x_m": 1.0 + t, "y_m": 5.0} for t in (0.0, 2.0, 4.0)],
    "robot": ROBOT,
    "runs": 20,
}
PLAN = {
    "start": {"x_m": 1.0, "y_m": 5.0},
    "goal": {"x_m": 7.0, "y_m": 5.0},
    "robot": ROBOT,
    "deadline_s": 10.0,
}


def post(gallery, what, body, **change):
    return gallery.client.post(f"/v1/{what}", json={"field": gallery.id, **body, **change})


def answer_to(gallery, what, model, body, **change):
    answer = post(gallery, what, body, **change)
    assert answer.status_code == 200, answer.text
    assert answer.headers["cache-control"] == "no-store"
    model.model_validate(answer.json())
    return answer.json()


def matrix(gallery, **change):
    return answer_to(gallery, "matrix", answers_many.Matrix, MATRIX, **change)


def reach(gallery, **change):
    return answer_to(gallery, "reachability", answers_many.Region, REACH, **change)


def simulation(gallery, **change):
    return answer_to(gallery, "simulations", answers_many.Simulation, DRIVE, **change)


def test_the_figures_have_the_engines_names():
    assert tuple(LAYERS) == METRICS


def test_a_matrix(gallery):
    found = matrix(gallery, client_ref="fleet")
    assert (found["status"], found["client_ref"], found["field"]) == ("complete", "fleet", gallery.id)
    assert found["length_m"][0][0] == 0.0
    assert 6.0 < found["length_m"][0][1] < 8.5
    assert found["cost"][0][1] > found["length_m"][0][1]
    assert (found["unreachable"], found["warnings"]) == ([], [])
    assert matrix(gallery, client_ref="fleet") == found, "same question, same answer"
    lengths = matrix(gallery, objective={"kind": "shortest"}, metrics=["cost", "length_m"])
    assert lengths["cost"] == lengths["length_m"]
    assert lengths["duration_s"] is None


def test_a_matrix_among_the_same_places(gallery):
    found = matrix(gallery, sources=[LEFT, RIGHT], targets=None)
    assert found["cost"][0][1] == found["cost"][1][0]


def test_places_that_cannot_be_used_are_said(gallery):
    outside = {"x_m": 99.0, "y_m": 3.0}
    found = matrix(gallery, targets=[INSIDE, BLIND, outside, RIGHT])
    assert found["status"] == "partial"
    assert [t["status"] for t in found["targets"]] == ["occupied", "forbidden", "outside_map", "ok"]
    assert found["cost"][0][:3] == [None] * 3
    assert found["unreachable"] == [
        {"source": 0, "target": k, "status": s}
        for k, s in enumerate(("occupied", "forbidden", "outside_map"))
    ]
    wall = {"type": "Polygon", "coordinates": [[[3.9, 0.0], [4.1, 0.0], [4.1, 6.0], [3.9, 6.0]]]}
    found = matrix(gallery, avoid=[wall])
    assert found["unreachable"] == [{"source": 0, "target": 1, "status": "no_path"}]


def test_the_limit_of_a_matrix_is_visible(gallery):
    limit = gallery.client.get("/v1/status").json()["limits"]["max_matrix_pairs"]
    problem = problem_of(
        post(gallery, "matrix", MATRIX, sources=[LEFT] * 51, targets=[RIGHT] * 50), 422, "limit_exceeded"
    )
    assert (problem["limit"], problem["requested"]) == (limit["value"], 2550) == (2500, 2550)
    assert problem["setting"] == limit["setting"] == "SUREPATH_MAX_MATRIX_PAIRS"
    assert problem["errors"][0]["pointer"] == "#/sources"


def test_the_area_within_reach(gallery):
    found = reach(gallery, max_length_m=2.0)
    assert (found["status"], found["field"]) == ("complete", gallery.id)
    (feature,) = found["features"]
    shape = shapely.geometry.shape(feature["geometry"])
    assert shape.covers(shapely.Point(1, 3))
    assert shape.bounds[2] == pytest.approx(3.0, abs=0.5)
    assert shape.area == pytest.approx(feature["properties"]["area_m2"], rel=0.1)
    whole = reach(gallery)["features"][0]["properties"]
    assert (whole["limit"], whole["measure"]) == (None, "cost")
    assert whole["area_m2"] > feature["properties"]["area_m2"]
    slow = reach(gallery, max_time_s=2.0, robot={**ROBOT, "max_speed_m_s": 1.0})
    assert slow["features"][0]["geometry"] == feature["geometry"]
    sure = reach(gallery, constraints={"max_r95_m": 0.12})["features"][0]["properties"]["area_m2"]
    assert 0 < sure < whole["area_m2"]


def test_a_simulation_of_a_trajectory(gallery):
    found = simulation(gallery)
    assert (found["status"], found["runs"], found["plan"]) == ("complete", 20, None)
    assert found["robot"]["fix_rate_hz"] == 10.0
    assert found["length_m"] == pytest.approx(4.0)
    assert 0 <= found["collisions"]["count"] <= 20
    assert simulation(gallery) == found
    other = simulation(gallery, seed=5, mode="fix", robot={**ROBOT, "fix_rate_hz": 2.0})
    assert (other["robot"]["mode"], other["robot"]["fix_rate_hz"]) == ("fix", 2.0)
    assert other["rms_error_m"] != found["rms_error_m"]
    start = [0.25, 0.0, 0.25, 0.0, 0.0, 0.1]
    unsure = simulation(gallery, start_covariance=start)
    assert unsure["stations"][0]["error_q95_m"] > found["stations"][0]["error_q95_m"]


def test_a_simulation_of_a_plan(gallery):
    robot = {**ROBOT, "fix_rate_hz": 4.0, "odometry": {"distance_sigma_m": 0.05}}
    more = {"alternatives": {"count": 2, "max_cost_factor": 3.0}, "robot": robot}
    plan = gallery.client.post("/v1/plans", json={**PLAN, **more, "field": gallery.id}).json()
    body = {"plan": plan["plan"], "runs": 10}
    first = gallery.client.post("/v1/simulations", json=body).json()
    answers_many.Simulation.model_validate(first)
    assert (first["plan"], first["field"]) == (plan["plan"], gallery.id)
    assert first["robot"]["radius_m"] == 0.2
    assert first["robot"]["fix_rate_hz"] == 4.0
    assert first["robot"]["odometry"]["distance_sigma"] == 0.05
    assert first["length_m"] == pytest.approx(plan["routes"][0]["length_m"], rel=0.02)
    second = gallery.client.post("/v1/simulations", json={**body, "route": 1}).json()
    assert second["length_m"] == pytest.approx(plan["routes"][1]["length_m"], rel=0.02)
    problem = problem_of(
        gallery.client.post("/v1/simulations", json={**body, "route": 2}), 422, "invalid_request"
    )
    assert (problem["errors"][0]["pointer"], "2 routes" in problem["detail"]) == ("#/route", True)


def test_an_outline_is_simulated_as_one(gallery):
    warm_up()  # workers have compiled everything before they answer
    corners = [{"x_m": x, "y_m": y} for x, y in ((0.4, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.4, -0.2))]
    question = {**PLAN, "robot": {"footprint": corners}, "include": ["schedule"], "field": gallery.id}
    question["deadline_s"] = 20
    plan = gallery.client.post("/v1/plans", json=question).json()
    assert plan["status"] in {"exact", "approximate"}
    body = {"plan": plan["plan"], "runs": 10}
    found = gallery.client.post("/v1/simulations", json=body).json()
    answers_many.Simulation.model_validate(found)
    assert found["robot"]["footprint_m"] == [[c["x_m"], c["y_m"]] for c in corners]
    disc = gallery.client.post("/v1/simulations", json={**body, "robot": {"radius_m": 0.1}}).json()
    assert (disc["robot"]["footprint_m"], disc["robot"]["radius_m"]) == (None, 0.1)
    driven = plan["routes"][0]["trajectory"]
    again = simulation(gallery, trajectory=driven)
    assert again["length_m"] == pytest.approx(found["length_m"], rel=1e-6)
    back = [{"t_s": t, "x_m": 5.0 - t, "y_m": 5.0, "vx_m_s": -1.0, "theta_rad": 0.0} for t in (0.0, 1.0, 2.0)]
    assert simulation(gallery, trajectory=back)["robot"]["steering"] == "differential"
    aside = [{**moment, "theta_rad": 1.5} for moment in back]
    assert simulation(gallery, trajectory=aside)["robot"]["steering"] == "holonomic"
    problem = problem_of(
        post(gallery, "simulations", DRIVE, trajectory=aside, steering="differential"), 422, "invalid_request"
    )
    assert "sideways" in problem["detail"]
    car = simulation(gallery, trajectory=back, robot={"radius_m": 0.2, "min_turn_radius_m": 0.5})
    assert car["robot"]["min_turn_radius_m"] == 0.5


def test_the_limit_of_runs_is_visible(gallery):
    problem = problem_of(post(gallery, "simulations", DRIVE, runs=1001), 422, "limit_exceeded")
    assert (problem["limit"], problem["requested"]) == (1000, 1001)
    assert problem["setting"] == "SUREPATH_MAX_SIMULATION_RUNS"
    assert gallery.client.get("/v1/status").json()["limits"]["max_simulation_runs"]["value"] == 1000


def test_deadlines_are_clamped_and_leave_a_part(gallery):
    found = matrix(gallery, deadline_s=99.0)
    assert "deadline_s was 99" in found["warnings"][0]
    short = simulation(gallery, runs=1000, deadline_s=1e-3)
    assert short["status"] == "timeout"
    assert 0 < short["runs"] < short["runs_asked"] == 1000
    assert f"after {short['runs']} of 1000 runs" in short["warnings"][-1]


@pytest.mark.parametrize("what", ["matrix", "reachability"])
@pytest.mark.parametrize(
    ("change", "status", "code", "words"),
    [
        ({"field": "f_1"}, 404, "not_found", "f_1"),
        ({"field": None, "map": "hall"}, 404, "not_found", "hall"),
        ({"field": None}, 422, "invalid_request", "exactly one"),
        ({"robot": {}}, 422, "invalid_request", "radius_m"),
        ({"robot": {"radius_m": 60.0}}, 422, "invalid_request", "radius"),
        ({"objective": {"kind": "minimax"}}, 422, "invalid_request", "shortest and weighted"),
        ({"objective": {"covariance": "fused"}}, 422, "invalid_request", "single fixes"),
        ({"constraints": {"max_blind_distance_m": 1.0}}, 422, "invalid_request", "single fixes"),
        ({"constraints": {"max_r95_m": -1.0}}, 422, "invalid_request", "greater than 0"),
        ({"robot": {"radius_m": 0.2, "kinematics": "dubins"}}, 422, "invalid_request", "turn in place"),
        ({"robot": {"footprint": [LEFT, RIGHT, BLIND]}}, 422, "invalid_request", "turn in place"),
        ({"deadline_s": 0.0}, 422, "invalid_request", "greater than 0"),
        ({"colour": "red"}, 422, "invalid_request", "colour"),
    ],
)
def test_mistakes_in_questions_about_many_places(gallery, what, change, status, code, words):
    body = MATRIX if what == "matrix" else REACH
    assert words in problem_of(post(gallery, what, body, **change), status, code)["detail"]


@pytest.mark.parametrize(
    ("what", "change", "code", "words"),
    [
        ("matrix", {"sources": []}, "invalid_request", "at least 1"),
        ("matrix", {"sources": [[1, 2]]}, "invalid_request", "object"),
        ("matrix", {"sources": [{"x_m": 1.0}]}, "invalid_request", "y_m"),
        ("matrix", {"metrics": ["beauty"]}, "invalid_request", "'cost'"),
        ("matrix", {"targets": [LEFT] * 2001}, "invalid_request", "2000"),
        ("reachability", {"start": {"x_m": 99.0, "y_m": 1.0}}, "start_outside_map", "outside"),
        ("reachability", {"start": INSIDE}, "start_occupied", "not in free space"),
        ("reachability", {"max_cost": 1.0, "max_time_s": 2.0}, "invalid_request", "at most one"),
        ("reachability", {"max_cost": 0.0}, "invalid_request", "greater than 0"),
    ],
)
def test_mistakes_in_one_of_them(gallery, what, change, code, words):
    body = MATRIX if what == "matrix" else REACH
    problem = problem_of(post(gallery, what, body, **change), 422, code)
    assert words in problem["detail"]


def moved(*rows):
    return {"trajectory": [dict(zip(("t_s", "x_m", "y_m"), row, strict=True)) for row in rows]}


@pytest.mark.parametrize(
    ("change", "status", "code", "words"),
    [
        ({"plan": "p_1"}, 422, "invalid_request", "not both"),
        ({"plan": "p_1", "field": None, "trajectory": None}, 404, "not_found", "p_1"),
        ({"trajectory": None}, 422, "invalid_request", "exactly one"),
        ({"robot": {}}, 422, "invalid_request", "radius_m"),
        ({"runs": 0}, 422, "invalid_request", "greater than or equal to 1"),
        ({"seed": -1}, 422, "invalid_request", "greater than or equal to 0"),
        ({"policy": "luck"}, 422, "invalid_request", "best_triplet"),
        ({"policy": "forced_forward"}, 422, "invalid_request", "camera"),
        ({"start_covariance": [1.0, 2.0, 1.0, 0.0, 0.0, 1.0]}, 422, "invalid_request", "covariance"),
        (moved((0.0, 1.0, 5.0), (1.0, 99.0, 5.0)), 422, "invalid_request", "outside the map"),
        (moved((0.0, 1.0, 5.0), (1.0, 1.0, 5.0)), 422, "invalid_request", "stays where it is"),
        (moved((0.5, 1.0, 5.0), (1.0, 2.0, 5.0)), 422, "invalid_request", "ascend from 0"),
        (moved((0.0, 1.0, 5.0), (2.0, 2.0, 5.0), (1.0, 3.0, 5.0)), 422, "invalid_request", "Sample 2"),
        (moved((0.0, 1.0, 5.0)), 422, "invalid_request", "at least 2"),
        (moved((0.0, 1.0, 5.0), (1e6, 2.0, 5.0)), 422, "invalid_request", "the limit is"),
        (moved((0.0, 1.0, 0.2), (1.0, 2.0, 0.2)), 422, "invalid_request", ""),
    ],
)
def test_mistakes_in_simulations(gallery, change, status, code, words):
    answer = post(gallery, "simulations", DRIVE, **change)
    if not words:
        assert answer.status_code in {200, 422}
        return
    assert words in problem_of(answer, status, code)["detail"]


def test_numbers_that_are_none(gallery):
    for what, body in (("matrix", MATRIX), ("reachability", REACH), ("simulations", DRIVE)):
        text = str({"field": gallery.id, **body, "seed": math.nan}).replace("'", '"').replace("nan", "NaN")
        answer = gallery.client.post(
            f"/v1/{what}", content=text, headers={"content-type": "application/json"}
        )
        assert answer.status_code in {400, 422}, answer.text
