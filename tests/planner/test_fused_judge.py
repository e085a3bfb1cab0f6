"""The filter's word on ways: bounds with their places, costs, and which of two ways is better."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import box

from localization import covariance as cov
from planner.extras import Extras
from planner.fused_judge import Judge, probability_ratio
from planner.fused_search import FusedQuestion
from planner.risk import collision_risk
from tests.planner.test_fused_search import DOOR, LOST, MODEL, RADIUS, Scene

# From the start straight through the door: a fix at first, then none.
STRAIGHT = np.array([[3.5, 6.5], [12.5, 6.5]])


@pytest.fixture(scope="module")
def door():
    return Scene(DOOR, 0.25)


def judge(door, space=None, **options):
    question = FusedQuestion(door.start, door.goal, LOST, **options)
    return Judge(space or door.graph.cost_space, door.fused, MODEL, question)


def test_bounds_are_read_off_the_belief(door):
    judged = judge(
        door, max_r95=0.3, max_ellipse95=0.3, max_collision_probability=0.01, max_blind_distance=1.0
    )(STRAIGHT)
    belief = judged.belief
    r95, ellipse, risk, blind = judged.reached
    assert r95.value == belief.r95.max()
    assert ellipse.value == cov.ellipse95(belief.position_covariance)[:, 0].max()
    places = belief.drive.poses[:, :2]
    expected = collision_risk(
        door.graph.cost_space.clearance, places, belief.position_covariance, RADIUS
    ).tight.max()
    assert risk.value == expected
    assert r95.ratio == pytest.approx(r95.value / 0.3)
    assert risk.ratio == pytest.approx(math.sqrt(math.log(0.01) / math.log(expected)))
    assert judged.excess == max(r.ratio for r in judged.reached)
    assert not judged.is_kept
    # The stretch without a fix by tiny steps.
    steps = np.linspace(STRAIGHT[0], STRAIGHT[1], 9001)
    known = door.fused.has_fix[tuple(door.context.field.frame.cell_at(steps).T)]
    lost = np.flatnonzero(~known)
    assert blind.value == pytest.approx((lost[-1] - lost[0]) * 1e-3, abs=2e-3)
    assert (np.diff(lost) == 1).all()
    assert blind.at == pytest.approx(lost[0] * 1e-3, abs=2e-3)
    assert blind.place == pytest.approx(steps[lost[0]], abs=2e-3)


def test_places_of_the_worst(door):
    judged = judge(door, max_r95=0.3)(STRAIGHT)
    (r95,) = judged.reached
    k = int(np.argmax(judged.belief.r95))
    assert r95.place == pytest.approx(judged.belief.drive.poses[k, :2])
    assert r95.at == pytest.approx(judged.along[k])


def test_costs_count_areas_and_uncertainty(door):
    plain = judge(door)(STRAIGHT)
    assert plain.cost == pytest.approx(9.0)
    weighted = judge(door, objective="weighted", weight=2.0)(STRAIGHT)
    r95, steps = weighted.belief.r95, np.diff(weighted.along)
    assert weighted.cost == pytest.approx(9.0 + 2.0 * float(0.5 * (r95[1:] + r95[:-1]) @ steps))
    extras = Extras(areas=((box(4.0, 4.0, 6.0, 8.0), 3.0),))
    slow = door.context.graph(radius=RADIUS, weight=0.0, blind_rate=1.0, extras=extras).cost_space
    assert judge(door, slow)(STRAIGHT).cost == pytest.approx(13.0)


def test_bounds_come_before_the_objective(door):
    detour = np.array([[3.5, 6.5], [3.5, 3.0], [12.5, 6.5]])
    shortest = judge(door)
    assert shortest(STRAIGHT).is_better_than(shortest(detour))
    limit = 0.5 * (shortest(STRAIGHT).worst_r95 + shortest(detour).worst_r95)
    bounded = judge(door, max_r95=limit)
    assert bounded(detour).is_better_than(bounded(STRAIGHT))
    surest = judge(door, objective="minimax")
    assert surest(detour).is_better_than(surest(STRAIGHT))
    assert not surest(detour).is_better_than(surest(detour))


def test_probabilities_as_factors_of_lengths():
    # exp(-c²/2λ): with twice the standard deviation the logarithm is a quarter.
    assert probability_ratio(math.exp(-1.0), math.exp(-4.0)) == pytest.approx(2.0)
    assert probability_ratio(0.0, 0.1) == 0.0
    assert probability_ratio(1.0, 0.1) == math.inf
