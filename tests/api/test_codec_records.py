"""What a field says about a place."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from api import answers, answers_plan
from api.canvas import InvalidPicture
from api.codec_records import _to_circle, point_to_json
from api.plan_picture import plan_png
from api.render import heatmap_png
from localization.field_builder import build_field
from localization.method import FieldMethod
from localization.sensors import LASER, MAS97_CAMERA, PRESETS
from tests.api.test_codec import plan_on
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
    ##########
    #A.......#
    #........#
    #........#
    #B......C#
    ##########
"""
PLACE = (2.2, 1.7)


def asked(field, place=PLACE):
    value = point_to_json(field, *place)
    json.dumps(value, allow_nan=False)
    answers.PointValue.model_validate({"field": "f_1", **value}, strict=True)
    return value


def field_with(share, n_visible=3):
    field = synthetic_field(world_from_ascii(ROOM))
    validity = np.where(field.has_fix, share, np.nan).astype(np.float32)
    return replace(field, validity=validity, n_visible=np.where(field.free, n_visible, 0).astype(np.int16))


def test_a_valid_fix_needs_no_reason():
    value = asked(field_with(0.951))
    assert (value["state"], value["valid"], value["reason"]) == ("fix", True, None)
    assert value["validity"] == value["metrics"]["validity"] == pytest.approx(0.951)
    assert value["triplet"] == ["A", "B", "C"]


@pytest.mark.parametrize(
    ("share", "words", "plans"),
    [
        (0.9, "but only about 90 % of fixes", "on a larger ellipse"),
        (0.4, "but only about 40 % of fixes", "as a place without a fix"),
        (0.99, "but about 99 % of fixes", "on a larger ellipse"),
    ],
)
def test_a_fix_that_is_not_valid_says_so_in_words(share, words, plans):
    value = asked(field_with(share))
    assert (value["state"], value["valid"]) == ("fix", False)
    assert words in value["reason"]
    assert plans in value["reason"]
    assert "circle through A, B, C" in value["reason"]
    assert value["covariance"] is not None, "the numbers stay those of the field"


def test_real_doubtful_cells_are_near_the_circle_that_is_named():
    field = build_field(world_from_ascii(ROOM), MAS97_CAMERA, resolution=0.1)
    rows, cols = np.nonzero(field.has_fix & ~field.is_valid)
    assert len(rows)
    centres = field.frame.centres()
    for row, col in list(zip(rows, cols, strict=True))[::50]:
        value = asked(field, centres[row, col])
        assert value["valid"] is False
        assert f"about {100 * field.validity[row, col]:.0f} %" in value["reason"]


def test_the_distance_to_a_circle():
    three = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    for place, wanted in (((0.0, 0.0), 1.0), ((0.0, -1.0), 0.0), ((3.0, 4.0), 4.0)):
        assert _to_circle(np.array(place), three) == pytest.approx(wanted, abs=1e-12)
    assert math.isnan(_to_circle(np.zeros(2), np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])))


@pytest.mark.parametrize(
    ("n_visible", "words"),
    [(0, "No landmark is in view"), (1, "Only 1 landmark"), (2, "Only 2"), (5, "no three")],
)
def test_a_place_without_a_fix_counts_its_landmarks(n_visible, words):
    field = field_with(0.95, n_visible)
    blind = replace(
        field, covariance=np.full_like(field.covariance, np.nan), triplet=np.full_like(field.triplet, -1)
    )
    value = asked(blind)
    assert (value["state"], value["valid"], value["validity"]) == ("no_fix", None, None)
    assert words in value["reason"]
    assert value["covariance"] is value["triplet"] is None


@pytest.mark.parametrize("name", ["laser", "mas97"])
def test_all_landmarks_together_have_no_triplet_and_no_validity(name):
    method = FieldMethod("all_visible")
    field = build_field(world_from_ascii(ROOM), PRESETS[name], resolution=0.25, method=method)
    assert field.has_fix.any()
    row, col = np.argwhere(field.has_fix)[0]
    value = asked(field, field.frame.centres()[row, col])
    assert (value["state"], value["reason"]) == ("fix", None)
    assert value["triplet"] is value["validity"] is value["valid"] is None
    assert value["covariance"] == list(field.covariance[row, col])
    assert heatmap_png(field, width=300)
    with pytest.raises(InvalidPicture, match="not known for fixes of all landmarks"):
        heatmap_png(field, metric="validity", width=300)  # all hatched, it would say that there is no fix


def test_a_plan_without_triplets_is_not_blind():
    result, field, problem = plan_on(field_with(0.95), all_visible=True)
    from api.codec import plan_to_json

    answer = plan_to_json(result, field, problem=problem)
    answers_plan.Plan.model_validate(answer, strict=True)
    for waypoint in answer["routes"][0]["path"]:
        assert waypoint["triplet"] is None
        assert waypoint["covariance"] == [0.01, 0.002, 0.02]
        assert waypoint["r95_m"] == 0.3
        assert waypoint["ellipse95"] is not None
    assert plan_png(field, answer, width=400)


def test_planning_goes_through_a_field_of_all_landmarks():
    from api.codec import plan_to_json
    from planner.context import PlanningContext
    from planner.plan import plan
    from planner.problem import PlanningProblem

    field = build_field(world_from_ascii(ROOM), LASER, resolution=0.25, method=FieldMethod("all_visible"))
    problem = PlanningProblem((1.5, 1.5), (3.4, 1.5), 0.2, refine=0)
    answer = plan_to_json(plan(problem, PlanningContext(field)), field, problem=problem)
    assert answer["status"] in {"exact", "approximate"}
    route = answer["routes"][0]
    assert route["uncertainty"]["blind_m"] == 0
    assert all(p["covariance"] and p["triplet"] is None for p in route["path"])
