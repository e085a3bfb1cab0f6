"""Paths by fused belief in scenes: a fix before the door, bounds that cannot be kept, the real filter after."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.belief import NotPositiveDefinite
from localization.field_builder import build_field
from localization.motion import OdometryModel
from localization.sensors import OmnidirectionalSensor
from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.fused_belief import FilterModel, FusedField
from planner.fused_search import OPTIMISTIC_PLAY, FusedQuestion, SearchSettings, fused_path
from planner.label_search import blind_path
from tests.worlds import place_in_ascii, world_from_ascii

# Landmarks are seen in the lower left corner only; the way to the goal leads through a door of 1 m.
DOOR = """
##################
#.......#........#
#.......#........#
#..s........g....#
#.......#........#
#.......#........#
#.......#........#
#.......#........#
#A..B..C#........#
##################
"""
SENSOR = OmnidirectionalSensor(bearing_sigma=0.005, max_range=5.0)
MODEL = FilterModel(OdometryModel(), fix_rate=5.0, speed=0.5)
RADIUS = 0.25


class Scene:
    def __init__(self, drawing, resolution, sensor=SENSOR):
        self.world = world_from_ascii(drawing, resolution=1.0)
        self.context = PlanningContext(build_field(self.world, sensor, resolution=resolution))
        self.graph = self.context.graph(radius=RADIUS, weight=0.0, blind_rate=1.0)
        self.fused = FusedField.from_field(self.context.field)
        self.start, self.goal = (place_in_ascii(drawing, letter, 1.0) for letter in "sg")

    def path(self, model=MODEL, **options):
        question = {"start": self.start, "goal": self.goal, **options}
        return fused_path(self.graph, self.fused, model, FusedQuestion(**question))


@pytest.fixture(scope="module")
def door():
    return Scene(DOOR, 0.25)


LOST = np.diag([0.12**2, 0.12**2, 0.02**2])


def test_a_path_fetches_a_fix_before_the_door(door):
    straight = door.path(covariance=LOST)
    safe = door.path(covariance=LOST, max_collision_probability=0.08)
    assert straight.status == safe.status == "found"
    # The plain way passes the door as lost as it began; the safe one goes down to the landmarks first.
    assert straight.longest_blind == pytest.approx(straight.cost)
    assert safe.cost > straight.cost + 1.0
    before = safe.points[:, 0] < 8.0
    assert safe.points[before, 1].min() < straight.points[:, 1].min() - 1.0
    seen = door.fused.has_fix[tuple(door.graph.cost_space.frame.cell_at(safe.points).T)]
    assert seen[before].any()
    assert not seen[~before].any()
    at_door = np.abs(safe.points[:, 0] - 8.5) < 0.5
    assert safe.r95[at_door].max() < 0.5 * straight.r95[np.abs(straight.points[:, 0] - 8.5) < 0.5].min()
    space = door.graph.cost_space
    room = space.clearance.distance(safe.points) - RADIUS
    largest = np.linalg.eigvalsh(safe.covariance[:, :2, :2]).max(axis=1)
    assert np.exp(-(room**2) / (2 * largest))[at_door].max() <= 0.08 * (1 + 1e-6)
    # A path that needs a fix everywhere does not exist.
    plain = door.context.graph(radius=RADIUS, weight=0.0, blind_rate=None)
    assert plain.costs_to(door.goal).path_from(door.start)[1] is None


def test_the_real_filter_is_hardly_less_certain_than_the_search_says(door):
    # With every corner of the grid driven, nothing is left out; with play, zigzags of the grid are.
    for play, factor in ((0.0, 1.02), (OPTIMISTIC_PLAY, 1.25)):
        for options in ({}, {"max_collision_probability": 0.08}, {"objective": "weighted", "weight": 20.0}):
            question = FusedQuestion(door.start, door.goal, LOST, **options)
            settings = SearchSettings(play=play)
            path = fused_path(door.graph, door.fused, MODEL, question, settings=settings)
            real = door.fused.along(path.points, LOST, MODEL)
            assert real.r95.max() <= factor * path.worst_r95
            assert real.max_blind_distance == pytest.approx(path.longest_blind, abs=0.3)


def test_weight_buys_certainty(door):
    light, heavy = (door.path(covariance=LOST, objective="weighted", weight=w) for w in (0.5, 20.0))
    assert heavy.r95.mean() < light.r95.mean()
    assert heavy.points[:, 1].min() < light.points[:, 1].min()
    steps = np.hypot(*np.diff(heavy.points, axis=0).T)
    integral = np.sum(steps * (1 + 20.0 * 0.5 * (heavy.r95[1:] + heavy.r95[:-1])))
    assert heavy.cost == pytest.approx(integral, rel=1e-3)


def test_minimax_is_the_smallest_bound_that_can_be_kept(door):
    certain = np.diag([0.02**2, 0.02**2, 0.01**2])
    best = door.path(covariance=certain, objective="minimax")
    assert best.status == "found"
    assert door.path(covariance=certain, max_r95=1.001 * best.worst_r95).status == "found"
    tight = door.path(covariance=certain, max_r95=0.9 * best.worst_r95)
    assert tight.status == "bound_unmet"
    assert tight.excess == pytest.approx(1 / 0.9, rel=0.01)
    assert tight.worst_r95 == pytest.approx(best.worst_r95, rel=0.01)
    assert tight.has_path


def test_bounds_on_ellipse_and_blind_distance(door):
    free = door.path(covariance=LOST, objective="weighted", weight=20.0)
    unmet = door.path(covariance=LOST, max_blind_distance=5.0)
    known = door.fused.has_fix
    alone = blind_path(door.graph, known, door.start, door.goal, max_blind_distance=5.0)
    assert unmet.status == alone.status == "bound_unmet"
    assert unmet.excess == pytest.approx(alone.excess, rel=1e-6)
    assert unmet.longest_blind == pytest.approx(alone.longest_blind, rel=1e-6)
    assert unmet.longest_blind < free.longest_blind + 1e-9
    kept = door.path(covariance=LOST, max_ellipse95=0.45)
    assert kept.status == "found"
    assert kept.ellipse95.max() <= 0.45
    assert door.path(covariance=LOST).ellipse95.max() > 0.45
    assert door.path(covariance=LOST, max_ellipse95=0.3).status == "bound_unmet"


def test_a_start_beyond_the_bound_is_named(door):
    path = door.path(covariance=LOST, max_r95=0.25)
    assert path.status == "bound_unmet"
    assert path.excess >= path.r95[0] / 0.25 - 1e-9


def test_the_start_may_be_a_fix_and_must_be_something(door):
    begin = (4.6, 2.6)
    path = door.path(start=begin)
    assert path.covariance[0] == pytest.approx(door.fused.fix_covariance(begin))
    assert np.allclose(path.points[[0, -1]], [begin, door.goal])
    with pytest.raises(InvalidProblem, match="no fix"):
        door.path()
    with pytest.raises(NotPositiveDefinite):
        door.path(covariance=-LOST)


def test_a_heading_at_the_start_costs_its_turn(door):
    noisy = replace(MODEL, odometry=OdometryModel(turn_sigma=0.3))
    ahead, back = (door.path(noisy, covariance=LOST, heading=h) for h in (0.0, math.pi))
    assert door.path(noisy, covariance=LOST).worst_r95 < ahead.worst_r95 < back.worst_r95


def test_no_way_and_no_time(door):
    nowhere = door.path(covariance=LOST, goal=(8.5, 8.5))
    assert nowhere.status == "no_path"
    stop = np.ones(1, dtype=np.uint8)
    question = FusedQuestion(door.start, door.goal, LOST)
    for to_go in (None, door.graph.costs_to(door.goal)):
        path = fused_path(door.graph, door.fused, MODEL, question, to_go=to_go, stop=stop)
        assert path.status == "stopped"
        assert not path.is_complete
    few = SearchSettings(max_labels=10)
    assert fused_path(door.graph, door.fused, MODEL, question, settings=few).status == "stopped"


@pytest.mark.parametrize(
    "wrong",
    [
        {"objective": "best"},
        {"weight": -1.0},
        {"weight": math.nan},
        {"max_r95": 0.0},
        {"max_ellipse95": math.nan},
        {"max_collision_probability": 1.0},
        {"max_blind_distance": -1.0},
    ],
)
def test_impossible_numbers_are_refused(wrong):
    with pytest.raises(InvalidProblem):
        FusedQuestion((0.0, 0.0), (1.0, 1.0), **wrong)


def test_other_cells_are_refused(door):
    other = Scene(DOOR, 0.5)
    with pytest.raises(InvalidProblem, match="different cells"):
        fused_path(door.graph, other.fused, MODEL, FusedQuestion(door.start, door.goal, LOST))
