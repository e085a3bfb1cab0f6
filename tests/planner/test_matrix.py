"""Matrices: obvious ones, random ones against a search per pair, places that cannot be used, wrong input."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
import shapely

from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.matrix import cost_matrix, trapezoid_duration
from planner.plan import plan
from planner.problem import PlanningProblem
from planner.timing import time_polyline
from planner.travel import PlaceStatus, Travel
from tests.fields import synthetic_field
from tests.oracles import grid_dijkstra
from tests.planner.test_cost_to_go import random_world
from tests.worlds import place_in_ascii, world_from_ascii

ROOMS = """
####################
#.a....#...........#
#......#...........#
#............b.....#
#......#...........#
#......#...........#
#########..#########
#.c................#
#......d...........#
####################
"""
CLOSED = """
############
#.a..#..b..#
#....#.....#
#.c..#.....#
############
"""


def places(drawing, letters):
    return [place_in_ascii(drawing, letter) for letter in letters]


def context_of(drawing, sigma=lambda x, y: 0.02 + 0.0 * x, resolution=0.25):
    return PlanningContext(synthetic_field(world_from_ascii(drawing), resolution, sigma))


def test_obvious_figures_in_an_open_room():
    context = context_of(ROOMS, lambda x, y: np.where(x < 5.0, 0.02, 0.04))
    c, d = places(ROOMS, "cd")
    a, b = (c[0], c[1]), (c[0] + 6.0, c[1])
    found = cost_matrix(context, [a], [b, a], travel=Travel(0.2))
    k = math.sqrt(-2 * math.log(0.05))
    split = 5.0 - a[0]
    integral = k * (0.02 * split + 0.04 * (6.0 - split))
    assert found.length[0, 0] == pytest.approx(6.0)
    assert found.cost[0, 0] == pytest.approx(6.0 + 4 * integral)
    assert found.mean_r95[0, 0] == pytest.approx(integral / 6)
    assert found.worst_r95[0, 0] == pytest.approx(0.04 * k)
    assert found.duration[0, 0] == pytest.approx(6 / 1.2 + 1.2 / 0.8)
    for name in ("cost", "length", "duration", "blind"):
        assert getattr(found, name)[0, 1] == 0.0
    assert found.worst_r95[0, 1] == pytest.approx(0.02 * k)
    assert found.stats["searches"] == 1
    assert not found.warnings
    assert found.is_complete
    assert d != c


def test_against_a_search_per_pair(rng, monkeypatch):
    monkeypatch.setattr("planner.matrix.refined", lambda _: None)
    for n, m in ((5, 3), (3, 6)):
        context = PlanningContext(
            synthetic_field(random_world(rng, (12, 14), 0.9), 0.5, lambda x, y: 0.05 + 0.04 * np.sin(x + y))
        )
        travel = Travel(0.2, weight=6.0)
        space = travel.graph(context).cost_space
        rows, cols = np.nonzero(space.passable)
        pick = rng.integers(len(rows), size=n + m)
        cells = list(zip(rows[pick].tolist(), cols[pick].tolist(), strict=True))
        centres = space.centre(rows[pick], cols[pick])
        found = cost_matrix(context, centres[:n], centres[n:], travel=travel)
        assert found.cost.shape == (n, m)
        assert found.stats["searches"] <= min(n, m)
        for i in range(n):
            reached = grid_dijkstra(space.rate, space.passable, cells[i], 0.5)
            for j in range(m):
                straight = space.line_cost(centres[[i, n + j]])
                least = min(reached.get(cells[n + j], math.inf), straight)
                assert found.cost[i, j] == pytest.approx(least) or (
                    math.isnan(found.cost[i, j]) and least == math.inf
                )


def test_figures_belong_to_one_path_and_are_symmetric(rng):
    context = context_of(ROOMS, lambda x, y: 0.02 + 0.02 * np.sin(x) ** 2)
    four = places(ROOMS, "abcd")
    travel = Travel(0.2, weight=3.0)
    found = cost_matrix(context, four, travel=travel)
    again = cost_matrix(context, four, four, travel=travel)
    for name in ("cost", "length", "duration", "mean_r95", "worst_r95", "blind"):
        layer = getattr(found, name)
        np.testing.assert_array_equal(layer, layer.T)
        np.testing.assert_allclose(getattr(again, name), layer, atol=0.02)
    np.testing.assert_allclose(found.cost, found.length * (1 + 3 * found.mean_r95))
    assert (found.worst_r95 >= found.mean_r95 - 1e-12).all()
    assert np.isfinite(found.cost).all()  # the door is too narrow for the cells, but not for finer ones
    assert found.stats["searches"] == 3 + 1


def test_blind_stretches_are_counted_or_forbidden():
    def sigma(x, y):
        return np.where((x > 4) & (x < 5), np.nan, 0.02)

    context = context_of(ROOMS, sigma)
    c, _ = places(ROOMS, "cd")
    ends = [c], [(c[0] + 6.0, c[1])]
    assert math.isnan(cost_matrix(context, *ends, travel=Travel(0.2)).cost[0, 0])
    found = cost_matrix(context, *ends, travel=Travel(0.2, blind_r95=0.5))
    assert found.blind[0, 0] == pytest.approx(1.0)
    assert found.length[0, 0] == pytest.approx(6.0)
    k = math.sqrt(-2 * math.log(0.05))
    assert found.mean_r95[0, 0] == pytest.approx(0.02 * k)
    assert found.cost[0, 0] == pytest.approx(6 + 4 * (5 * 0.02 * k + 0.5))


def test_one_bad_place_does_not_spoil_the_rest():
    context = context_of(CLOSED)
    a, b, c = places(CLOSED, "abc")
    wall, off = (2.75, 1.25), (-3.0, 1.0)
    found = cost_matrix(context, [a, wall, b, off, c], travel=Travel(0.2, avoid=()))
    assert [s.value for s in found.source_status] == ["ok", "occupied", "ok", "outside_map", "ok"]
    assert found.target_status == found.source_status
    assert np.isnan(found.cost[[1, 3]]).all()
    assert np.isnan(found.cost[:, [1, 3]]).all()
    assert math.isfinite(found.cost[0, 4])
    assert math.isnan(found.cost[0, 2])
    said = "\n".join(found.warnings)
    assert "Place 2 at (2.75, 1.25) m is too close" in said
    assert "Place 4 at (-3, 1) m is outside" in said
    assert "4 of 9 pairs have no way" in said
    shut = cost_matrix(context, [a, c], travel=Travel(0.2, avoid=(shapely.Point(a).buffer(0.4),)))
    assert shut.source_status == (PlaceStatus.FORBIDDEN, PlaceStatus.OK)


def test_deadline_and_stop():
    context = context_of(ROOMS)
    before = threading.active_count()  # other plans may still be made ready in the background
    stop = np.ones(1, dtype=np.uint8)
    found = cost_matrix(context, places(ROOMS, "ab"), places(ROOMS, "cd"), travel=Travel(0.2), stop=stop)
    assert not found.is_complete
    assert np.isnan(found.cost).all()
    assert found.source_status == (PlaceStatus.NOT_SEARCHED,) * 2
    assert "time was over" in found.warnings[0]
    late = cost_matrix(context, places(ROOMS, "abcd"), travel=Travel(0.2), deadline=1e-9)
    assert not late.is_complete
    assert threading.active_count() <= before + 2


def test_durations_are_those_of_a_straight_motion():
    for length in (0.0, 0.5, 3.0, 20.0):
        timed = time_polyline([(0.0, 0.0), (length, 0.0)], max_speed=1.2, max_accel=0.8)
        assert trapezoid_duration(np.array(length), 1.2, 0.8) == pytest.approx(timed.duration)


def test_a_plan_is_never_dearer():
    context = context_of(ROOMS, lambda x, y: 0.02 + 0.02 * np.sin(x) ** 2)
    a, d = places(ROOMS, "ad")
    travel = Travel(0.2)
    found = cost_matrix(context, [a], [d], travel=travel)
    result = plan(PlanningProblem(a, d, 0.2, deadline=10.0, refine=0), context)
    assert result.route.summary.cost <= found.cost[0, 0] * (1 + 1e-9)
    assert result.grid_cost == pytest.approx(found.cost[0, 0])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"sources": [(math.nan, 1.0)]}, "Place 1 of the sources"),
        ({"sources": []}, "shape"),
        ({"sources": [(1.0, 2.0, 3.0)]}, "shape"),
        ({"targets": [(1.0, 1.0), (math.inf, 1.0)]}, "Place 2 of the targets"),
        ({"sources": np.ones((2001, 2))}, "limit is 2000"),
        ({"sources": np.ones((600, 2)), "targets": np.ones((600, 2))}, "limit is 250000"),
        ({"deadline": 0.0}, "deadline"),
        ({"workers": 0}, "workers"),
    ],
)
def test_impossible_questions(values, words):
    asked = {"sources": [(1.25, 1.25)], "targets": None} | values
    with pytest.raises(InvalidProblem, match=words):
        cost_matrix(
            context_of(CLOSED), asked.pop("sources"), asked.pop("targets"), travel=Travel(0.2), **asked
        )
    with pytest.raises(InvalidProblem, match="radius"):
        Travel(-1.0)
