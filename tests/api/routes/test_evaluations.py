"""Batches of plans and given paths over HTTP."""

from __future__ import annotations

import time

import pytest

from api import answers_evaluations
from tests.api.conftest import problem_of

ROBOT = {"radius_m": 0.3}
GOOD = {"map": "room", "robot": ROBOT, "start": {"x_m": 1, "y_m": 2}, "goal": {"x_m": 2, "y_m": 5}}


def batch(client, *plans, **more):
    answer = client.post("/v1/plans/batch", json={"plans": list(plans), **more})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    answers_evaluations.Batch.model_validate(found)
    return found


def test_a_batch_has_a_plan_or_a_problem_for_each(client, field):
    blocked = {**GOOD, "goal": {"x_m": 4.0, "y_m": 3.0}}
    nowhere = {**GOOD, "map": "hall"}
    found = batch(client, GOOD, blocked, {**GOOD, "client_ref": "third"}, nowhere)
    assert (found["planned"], found["failed"]) == (2, 2)
    first, second, third, fourth = found["items"]
    assert first["plan"] == client.post("/v1/plans", json=GOOD).json(), "as if it was asked alone"
    assert third["plan"]["client_ref"] == "third"
    assert client.get(f"/v1/plans/{third['plan']['plan']}").json() == third["plan"]
    assert (second["plan"], second["problem"]["code"]) == (None, "goal_occupied")
    assert second["problem"]["errors"][0]["pointer"] == "#/plans/1/goal"
    assert second["problem"]["hint"] == {"nearest_free": {"x_m": 2.0, "y_m": 3.0}}
    assert second["problem"]["instance"] == "/v1/plans/batch"
    assert (fourth["problem"]["code"], fourth["problem"]["status"]) == ("not_found", 404)


def test_a_batch_ends_in_time(client, field, monkeypatch):
    pool = client.app.state.service.pool
    plan = pool.plan
    deadlines = []

    def slow(path, problem, **more):
        deadlines.append(problem.deadline)
        time.sleep(min(0.4, problem.deadline))
        return plan(path, problem, **more)

    monkeypatch.setattr(pool, "plan", slow)
    workers = client.app.state.service.settings.workers
    began = time.monotonic()
    found = batch(client, *[{**GOOD, "seed": k} for k in range(20 * workers)], deadline_s=1.0)
    assert time.monotonic() - began < 3.0
    late = [item["problem"] for item in found["items"] if item["problem"]]
    assert {p["code"] for p in late} == {"deadline_exceeded"}
    assert 0 < len(late) < 20 * workers
    assert max(deadlines) <= 1.0, "no plan may take longer than what is left"
    assert any("batch's time" in w for w in found["items"][0]["plan"]["warnings"])


def test_a_bug_in_one_item_is_its_own(client, field, monkeypatch):
    pool = client.app.state.service.pool
    plan = pool.plan

    def broken(path, problem, **more):
        if problem.seed == 7:
            raise ZeroDivisionError
        return plan(path, problem, **more)

    monkeypatch.setattr(pool, "plan", broken)
    found = batch(client, GOOD, {**GOOD, "seed": 7})
    assert [i["problem"] and i["problem"]["code"] for i in found["items"]] == [None, "internal"]


@pytest.mark.parametrize(
    ("plans", "code", "pointer"),
    [
        ([], "invalid_request", "#/plans"),
        ([GOOD] * 101, "limit_exceeded", "#/plans"),
        ([GOOD, {**GOOD, "robot": {"radius_m": -1}}], "invalid_request", "#/plans/1/robot/radius_m"),
    ],
)
def test_wrong_batches(client, plans, code, pointer):
    problem = problem_of(client.post("/v1/plans/batch", json={"plans": plans}), 422, code)
    assert problem["errors"][0]["pointer"] == pointer


# --- given paths ----------------------------------------------------------------------------------

LEFT = {"name": "left", "points": [{"x_m": 1, "y_m": 1.6}, {"x_m": 1, "y_m": 5.5}]}
RIGHT = {"name": "right", "points": [{"x_m": 7, "y_m": 1.6}, {"x_m": 7, "y_m": 5.5}]}


def scored(client, *paths, **more):
    body = {"map": "room", "robot": ROBOT, "paths": list(paths), **more}
    answer = client.post("/v1/evaluations", json=body)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    answers_evaluations.Evaluation.model_validate(found)
    return found


def test_two_paths_side_by_side(gallery):
    found = scored(gallery.client, LEFT, RIGHT)
    left, right = found["paths"]
    assert [p["status"] for p in found["paths"]] == ["ok", "ok"]
    assert left["length_m"] == right["length_m"] == pytest.approx(3.9)
    # Standard deviation 0.02 + 0.01 x at the cells' centres; on the border of two, the worse one.
    sigma = 0.02 + 0.01 * 1.25
    assert left["uncertainty"]["max_r95_m"] == pytest.approx(2.4477 * sigma, rel=1e-4)
    assert left["min_clearance_m"] == pytest.approx(0.2)
    (difference,) = found["differences"]
    assert (difference["name"], difference["against"]) == ("right", "left")
    worse = right["uncertainty"]["mean_r95_m"] - left["uncertainty"]["mean_r95_m"]
    assert worse > 0
    assert difference["mean_r95_m"] == pytest.approx(worse)
    assert right["cost"] > left["cost"]
    assert difference["cost"] == pytest.approx(right["cost"] - left["cost"])
    assert difference["length_m"] == pytest.approx(0)


def test_the_cost_is_that_of_plans(gallery):
    weight = {"objective": {"kind": "weighted", "uncertainty_weight_per_m": 10.0}}
    left = scored(gallery.client, LEFT, **weight)["paths"][0]
    assert left["cost"] == pytest.approx(left["length_m"] * (1 + 10 * left["uncertainty"]["mean_r95_m"]))
    shortest = scored(gallery.client, LEFT, objective={"kind": "shortest"})["paths"][0]
    assert shortest["cost"] == pytest.approx(3.9)


def test_what_a_path_does_not_keep(gallery):
    bounds = {"max_r95_m": 0.1, "max_ellipse95_m": 0.01}
    (right,) = scored(gallery.client, RIGHT, constraints=bounds)["paths"]
    assert right["status"] == "risk_unmet"
    assert [u["bound"] for u in right["unmet"]] == ["max_r95_m", "max_ellipse95_m"]
    assert right["unmet"][0]["value"] > 0.1
    assert right["unmet"][0]["place"]["x_m"] == 7
    square = {"type": "Polygon", "coordinates": [[[6, 3], [6.8, 3], [6.8, 4], [6, 4], [6, 3]]]}
    (right,) = scored(gallery.client, RIGHT, avoid=[square])["paths"]
    assert [u["bound"] for u in right["unmet"]] == ["avoid"]
    (right,) = scored(gallery.client, RIGHT, avoid=[square], robot={"radius_m": 0.1})["paths"]
    assert right["unmet"] == []


def test_a_path_through_the_block_does_not_fit(gallery):
    through = {"points": [{"x_m": 1, "y_m": 3}, {"x_m": 7, "y_m": 3}]}
    (found,) = scored(gallery.client, through)["paths"]
    assert (found["name"], found["status"], found["cost"]) == ("0", "occupied", None)
    first = found["unmet"][0]
    assert first["bound"] == "clearance"
    assert 3 <= first["place"]["x_m"] <= 5
    assert found["min_clearance_m"] == pytest.approx(-1.3, abs=0.15)
    (found,) = scored(gallery.client, through, robot={"radius_m": 0.0})["paths"]
    assert found["status"] == "occupied", "a point does not fit either"


def test_a_path_without_a_fix_has_a_price_only_where_one_is_given(gallery):
    low = {"points": [{"x_m": 1, "y_m": 0.5}, {"x_m": 7, "y_m": 0.5}]}
    (found,) = scored(gallery.client, low)["paths"]
    assert (found["status"], found["cost"]) == ("risk_unmet", None)
    assert found["uncertainty"]["blind_m"] == pytest.approx(6.0)
    assert [u["bound"] for u in found["unmet"]] == ["blind"]
    (priced,) = scored(gallery.client, low, constraints={"blind_r95_m": 0.5})["paths"]
    assert (priced["status"], priced["cost"]) == ("ok", pytest.approx(6 * (1 + 4 * 0.5)))


def test_a_plan_is_scored_as_it_was_planned(client, field):
    planned = client.post("/v1/plans", json=GOOD).json()
    found = scored(client, {"plan": planned["plan"]}, LEFT)
    ends = [planned["routes"][0]["trajectory"][k] for k in (0, -1)]
    path = found["paths"][0]["path"]
    assert (path[0]["x_m"], path[-1]["x_m"]) == (ends[0]["x_m"], ends[1]["x_m"])
    assert found["paths"][0]["duration_s"] == pytest.approx(planned["routes"][0]["duration_s"])


def test_times_of_a_trajectory_count(gallery):
    motion = [{"t_s": 0, "x_m": 1, "y_m": 2}, {"t_s": 30, "x_m": 1, "y_m": 5}]
    (found,) = scored(gallery.client, {"trajectory": motion})["paths"]
    assert found["duration_s"] == 30
    assert found["path"][-1]["t_s"] == 30


@pytest.mark.parametrize(
    ("paths", "status", "code", "pointer"),
    [
        ([], 422, "invalid_request", "#/paths"),
        ([{}], 422, "invalid_request", "#/paths/0"),
        ([{**LEFT, "plan": "p_1"}], 422, "invalid_request", "#/paths/0"),
        ([{**LEFT, "route": 1}], 422, "invalid_request", "#/paths/0"),
        ([{"plan": "p_1"}], 404, "not_found", None),
        ([{"points": [{"x_m": 1, "y_m": 1}, {"x_m": 99, "y_m": 1}]}], 422, "invalid_request", None),
        ([{"points": [{"x_m": 1e308, "y_m": -1e308}]}], 422, "invalid_request", None),
        ([LEFT, {"trajectory": [{"t_s": 1, "x_m": 1, "y_m": 1}]}], 422, "invalid_request", "#/paths/1/trajectory/0/t_s"),
        ([LEFT] * 11, 422, "invalid_request", "#/paths"),
    ],
)  # fmt: skip
def test_wrong_paths(gallery, paths, status, code, pointer):
    body = {"map": "room", "robot": ROBOT, "paths": paths}
    problem = problem_of(gallery.client.post("/v1/evaluations", json=body), status, code)
    if pointer is not None:
        assert problem["errors"][0]["pointer"] == pointer


def test_one_place_is_a_path(gallery):
    (found,) = scored(gallery.client, {"points": [{"x_m": 1.2, "y_m": 3}]})["paths"]
    assert (found["length_m"], found["status"]) == (0, "ok")
