"""The real filter on what fused searches find: lines instead of zigzags, bounds that hold for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from localization import covariance as cov
from localization.motion import OdometryModel
from planner.fused_search import FusedQuestion, SearchSettings, fused_path
from planner.fused_verify import straight_lines, verified_path
from planner.kernels.any_angle import subdivide
from planner.risk import collision_risk
from tests.planner.test_fused_search import DOOR, LOST, MODEL, RADIUS, Scene


@pytest.fixture(scope="module")
def door():
    return Scene(DOOR, 0.25)


def verified(door, **options):
    question = FusedQuestion(door.start, options.pop("goal", door.goal), LOST, **options)
    return verified_path(door.graph, door.fused, MODEL, question)


def test_lines_stand_for_zigzags(door):
    path = door.path(covariance=LOST, max_collision_probability=0.08)
    lines = straight_lines(path.points, door.graph.cost_space)
    assert len(lines) < 0.5 * len(path.points)
    assert np.allclose(lines[[0, -1]], path.points[[0, -1]])
    assert math.isfinite(door.graph.cost_space.line_cost(lines))
    for point in path.points:
        ways = np.diff(lines, axis=0)
        share = np.sum((point - lines[:-1]) * ways, axis=1) / np.sum(ways * ways, axis=1)
        near = lines[:-1] + np.clip(share, 0, 1)[:, None] * ways
        assert np.hypot(*(point - near).T).min() <= 0.25 + 1e-9
    exact = straight_lines(path.points, door.graph.cost_space, within=0.0)
    assert np.hypot(*np.diff(exact, axis=0).T).sum() == pytest.approx(
        np.hypot(*np.diff(path.points, axis=0).T).sum()
    )


def test_lines_do_not_leave_what_the_path_went_for(door):
    path = door.path(covariance=LOST, objective="weighted", weight=20.0)
    space = door.graph.cost_space
    careless = straight_lines(path.points, space, within=5.0)
    careful = straight_lines(path.points, space, within=5.0, harms=door.fused.harms)

    def blind(points):
        return np.sum(~door.fused.has_fix[tuple(space.frame.cell_at(subdivide(points, 0.01)).T)]) * 0.01

    def share(points):
        return blind(points) / np.hypot(*np.diff(points, axis=0).T).sum()

    assert share(careful) <= 1.03 * share(path.points) < share(careless)


def test_what_is_reported_is_the_filters(door):
    answer = verified(door, max_collision_probability=0.08)
    assert answer.path.status == "found"
    assert answer.is_kept
    risk = collision_risk(
        door.graph.cost_space.clearance,
        answer.belief.drive.poses[:, :2],
        answer.belief.position_covariance,
        RADIUS,
    )
    assert risk.rigorous.max() <= 0.08
    assert np.allclose(answer.belief.covariance[0], LOST)
    assert risk.tight.max() == pytest.approx(answer.judged.reached[0].value)


def test_bounds_hold_for_the_filter(door):
    limit = door.path(covariance=LOST, objective="minimax").worst_r95 * 1.05
    answer = verified(door, max_r95=limit)
    assert answer.is_kept
    assert answer.belief.r95.max() <= limit
    ellipse = verified(door, max_ellipse95=0.45)
    assert ellipse.is_kept
    assert cov.ellipse95(ellipse.belief.position_covariance)[:, 0].max() <= 0.45
    blind = verified(door, max_blind_distance=8.5)
    assert blind.is_kept
    (reached,) = blind.judged.reached
    assert reached.bound == "max_blind_distance_m"
    assert reached.value <= 8.5
    assert reached.value == pytest.approx(blind.belief.max_blind_distance, abs=0.3)


def test_turns_of_the_grid_do_not_rule_out_a_line(door):
    # On the grid the way has corners; without them the filter stays within a bound that the search refuses.
    turning = replace(MODEL, odometry=OdometryModel(turn_sigma=0.3))
    question = FusedQuestion(door.start, (11.5, 7.5), LOST)
    grid = fused_path(door.graph, door.fused, turning, question)
    line = verified_path(door.graph, door.fused, turning, question)
    limit = 1.01 * line.belief.r95.max()
    bound = replace(question, max_r95=limit)
    assert grid.worst_r95 > limit
    assert fused_path(door.graph, door.fused, turning, bound).status == "bound_unmet"
    answer = verified_path(door.graph, door.fused, turning, bound)
    assert answer.is_kept


def test_what_cannot_be_kept_is_said(door):
    answer = verified(door, max_r95=0.1)
    assert answer.path.status == "bound_unmet"
    assert answer.excess > 1.0
    assert not answer.is_kept
    nowhere = verified(door, goal=(8.5, 8.5))
    assert nowhere.path.status == "no_path"
    assert nowhere.belief is None
    assert len(nowhere.points) == 0
    assert verified(door).excess == 0.0
    question = FusedQuestion(door.start, door.goal, LOST)
    few = verified_path(door.graph, door.fused, MODEL, question, settings=SearchSettings(max_labels=5))
    assert few.path.status == "stopped"
