"""Plans with several routes, and with schedules of landmarks."""

from __future__ import annotations

import io
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from api import answers_plan, questions
from api.answers_schedule import ScheduleFigures, Stretch
from api.schemas import PlanIn
from planner import alternatives, pareto
from tests.api.conftest import problem_of, ready_field

PLAN = {
    "start": {"x_m": 1.0, "y_m": 3.0},
    "goal": {"x_m": 7.0, "y_m": 3.0},
    "robot": {"radius_m": 0.2},
    "deadline_s": 10.0,
}
FRONT = {"kind": "pareto", "against": "mean", "count": 5}


def ask(gallery, **change):
    answer = gallery.client.post("/v1/plans", json={**PLAN, "field": gallery.id, **change})
    assert answer.status_code == 200, answer.text
    plan = answer.json()
    answers_plan.Plan.model_validate(plan)
    return plan


def again(gallery, plan):
    """The same question in the words of its answer."""
    question = {**plan["request"], "field": gallery.id}
    PlanIn.model_validate(question)
    return ask(gallery, **question)


def test_the_limits_are_those_of_the_planner():
    assert questions.MAX_ROUTES == alternatives.MAX_ALTERNATIVES
    assert questions.MAX_FRONT == pareto.MAX_POINTS


def test_alternatives_are_further_routes(gallery):
    plan = ask(gallery, alternatives={"count": 3, "max_cost_factor": 2.0, "max_share": 0.7})
    first, second = plan["routes"]
    assert plan["status"] == "exact"
    assert (first["share"], plan["shortest_baseline"] is None) == (0.0, False)
    assert 0.0 < second["share"] <= 0.7
    assert 0.99 * first["cost"] < second["cost"] <= 2.0 * first["cost"]
    middle = [min(r["path"], key=lambda w: abs(w["x_m"] - 4.0))["y_m"] > 3.0 for r in plan["routes"]]
    assert sorted(middle) == [False, True], "one on each side of the block"
    assert any("2 of 3 routes" in warning for warning in plan["warnings"])
    assert plan["request"]["alternatives"] == {"count": 3, "max_cost_factor": 2.0, "max_share": 0.7}
    assert again(gallery, plan)["plan"] == plan["plan"]


@pytest.fixture
def hall(client, room):
    """The short way around the block is uncertain, the long one is not."""
    field = ready_field(client, room, lambda x, y: np.where(y < 2.0, 0.3, 0.02) + 0.0 * x)
    return SimpleNamespace(client=client, **vars(field))


@pytest.mark.parametrize("against", ["worst", "mean"])
def test_a_front_is_a_list_of_routes(hall, against):
    ends = {"start": {"x_m": 1.0, "y_m": 2.6}, "goal": {"x_m": 7.0, "y_m": 2.6}}
    plan = ask(hall, **ends, objective={**FRONT, "against": against})
    routes = plan["routes"]
    assert plan["status"] == "exact"
    assert len(routes) >= 2
    assert [r["length_m"] for r in routes] == sorted(r["length_m"] for r in routes)
    values = [r["front"]["r95_m"] for r in routes]
    assert values == sorted(values, reverse=True)
    bound, weight = routes[-1]["front"]["max_r95_m"], routes[-1]["front"]["uncertainty_weight_per_m"]
    assert (bound is None, weight is None) == (against == "mean", against == "worst")
    assert plan["request"]["objective"]["against"] == against
    assert again(hall, plan)["plan"] == plan["plan"]
    if against == "worst":
        bounded = {"objective": {"kind": "shortest"}, "constraints": {"max_r95_m": bound}}
        alone = ask(hall, **ends, **bounded, include=["schedule"])
        assert alone["routes"][0]["length_m"] == pytest.approx(routes[-1]["length_m"], rel=0.02)


def test_a_front_has_its_defaults_and_says_what_it_leaves_aside(gallery):
    square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    area = {"polygon": {"type": "Polygon", "coordinates": [square]}, "factor": 3.0}
    plan = ask(gallery, objective={"kind": "pareto"}, areas=[area])
    front = plan["request"]["objective"]
    assert (front["against"], front["count"]) == ("worst", 8)
    assert "factors of areas" in plan["warnings"][0]


def test_a_front_under_a_bound_that_cannot_be_kept(gallery):
    plan = ask(gallery, objective={"kind": "pareto"}, constraints={"max_r95_m": 0.01})
    assert (plan["status"], len(plan["routes"])) == ("risk_unmet", 1)
    assert plan["unmet"][0]["bound"] == "max_r95_m"


def test_schedules_of_all_routes(gallery):
    plan = ask(
        gallery,
        include=["schedule", "shortest_baseline"],
        alternatives={"count": 2, "max_cost_factor": 2.0},
        robot={"radius_m": 0.2, "pan_rate_deg_s": 45.0},
    )
    assert len(plan["routes"]) == 2
    for route in plan["routes"]:
        schedule = route["schedule"]
        assert schedule[0]["s_start_m"] == 0.0
        assert schedule[-1]["s_end_m"] == pytest.approx(route["length_m"], rel=0.01)
        assert all(a["s_end_m"] == b["s_start_m"] for a, b in pairwise(schedule))
        with_fix = [stretch for stretch in schedule if stretch["triplet"]]
        assert with_fix, "blind only where the block hides two corners"
        assert set(with_fix[0]["triplet"]) <= {"A", "B", "C", "D"}
        figures = route["schedule_figures"]
        without = [stretch for stretch in schedule if stretch["kind"] != "fix"]
        metres = sum(stretch["s_end_m"] - stretch["s_start_m"] for stretch in without)
        assert figures["blind_m"] == pytest.approx(metres, abs=1e-6)
        assert figures["max_r95_m"] == max(stretch["max_r95_m"] for stretch in with_fix)
        for stretch in schedule:
            Stretch.model_validate(stretch)
            ScheduleFigures.model_validate(figures)
            assert (stretch["triplet"] is None) == (stretch["kind"] != "fix")
    assert plan["request"]["include"] == ["schedule"]
    assert plan["request"]["robot"]["pan_rate_rad_s"] == pytest.approx(0.785, abs=1e-3)
    assert again(gallery, plan)["plan"] == plan["plan"]
    alone = ask(gallery)
    assert alone["routes"][0]["schedule"] is None
    assert alone["routes"][0]["schedule_figures"] is None


def test_the_picture_shows_all_routes(gallery):
    plan = ask(gallery, objective=FRONT)
    picture = gallery.client.get(f"/v1/plans/{plan['plan']}/picture.png?width=700")
    with Image.open(io.BytesIO(picture.content)) as image:
        assert image.width == 700
        assert len(image.convert("RGB").getcolors(maxcolors=2**20)) > 100


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"alternatives": {"count": 11}}, "less than or equal to 10"),
        ({"alternatives": {"count": 0}}, "greater than or equal to 1"),
        ({"alternatives": {"max_share": 1.0}}, "less than 1"),
        ({"alternatives": {"max_cost_factor": 0.5}}, "greater than or equal to 1"),
        ({"alternatives": {}, "via": [{"x_m": 2.0, "y_m": 5.0}]}, "have no via points"),
        ({"alternatives": {}, "objective": {"covariance": "fused"}}, "count on single fixes"),
        ({"alternatives": {}, "constraints": {"max_blind_distance_m": 2.0}}, "count on single fixes"),
        ({"alternatives": {}, "objective": FRONT}, "several routes already"),
        ({"objective": {"kind": "weighted", "count": 5}}, "belong to kind pareto"),
        ({"objective": {**FRONT, "count": 51}}, "less than or equal to 50"),
        ({"objective": {**FRONT, "against": "best"}}, "'worst' or 'mean'"),
        ({"objective": FRONT, "via": [{"x_m": 2.0, "y_m": 5.0}]}, "no via points"),
        ({"objective": {**FRONT, "covariance": "fused"}}, "count on single fixes"),
        (
            {
                "alternatives": {},
                "robot": {"radius_m": 0.2, "kinematics": "dubins", "min_turn_radius_m": 0.5},
            },
            "leave out kinematics",
        ),
        ({"objective": FRONT, "start": {"x_m": 1.0, "y_m": 3.0, "theta_deg": 90.0}}, "leave out kinematics"),
        ({"include": ["weather"]}, "'schedule'"),
        ({"robot": {"radius_m": 0.2, "pan_rate_deg_s": 9.0, "pan_rate_rad_s": 0.1}}, "not both"),
        ({"robot": {"radius_m": 0.2, "pan_rate_deg_s": 0.0}}, "greater than"),
    ],
)
def test_what_does_not_go_together(gallery, change, words):
    answer = gallery.client.post("/v1/plans", json={**PLAN, "field": gallery.id, **change})
    assert words in problem_of(answer, 422, "invalid_request")["detail"]
