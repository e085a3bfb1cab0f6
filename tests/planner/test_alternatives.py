"""Routes that differ: around blocks on each side, none where there is one way only, wrong input."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from planner.alternatives import find_alternatives
from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from tests.fields import synthetic_field
from tests.planner.test_plan import G, S, check, ring
from tests.worlds import place_in_ascii, world_from_ascii

# Three ways from s to g, the middle one the shortest.
LADDER = """
########################
#......................#
#......................#
#....##############....#
#....##############....#
#......................#
#s....................g#
#......................#
#....##############....#
#....##############....#
#......................#
#......................#
########################
"""
HALL = """
########################
#......................#
#......................#
#s....................g#
#......................#
#......................#
########################
"""


def ask(drawing, *, sigma=lambda x, y: 0.02 + 0 * x, options=None, **values):
    context = PlanningContext(synthetic_field(world_from_ascii(drawing), 0.25, sigma))
    start, goal = place_in_ascii(drawing, "s"), place_in_ascii(drawing, "g")
    problem = PlanningProblem(start, goal, 0.2, deadline=20.0, refine=0, **values)
    return find_alternatives(problem, context, **(options or {})), problem, context


def height(route):
    """Where a route passes the middle."""
    p = route.trajectory.points
    return float(np.interp(6.0, p[:, 0], p[:, 1]))


def test_three_ways_through_a_ladder():
    found, problem, context = ask(LADDER, weight=0.0, options={"count": 4, "max_cost_factor": 1.6})
    assert found.best.status is PlanStatus.EXACT
    assert len(found.routes) == 3
    assert sorted(round(height(r)) for r in found.routes) in ([1, 3, 5], [1, 3, 6], [0, 3, 5])
    costs = [r.summary.cost for r in found.routes]
    assert costs == sorted(costs)
    assert max(costs) <= 1.6 * costs[0]
    assert found.shares[0] == 0.0
    assert max(found.shares) <= 0.6
    for route in found.routes:
        check(replace_route(found.best, route), problem, context)
    lines = [shapely.LineString(r.trajectory.points) for r in found.routes]
    for k in (1, 2):
        near = shapely.union_all([line.buffer(0.4) for line in lines[:k]])
        assert found.shares[k] == pytest.approx(lines[k].intersection(near).length / lines[k].length)


def replace_route(result, route):
    return replace(result, route=route, shortest=None, grid_cost=None)


def test_fewer_where_others_cost_too_much():
    found, *_ = ask(LADDER, weight=0.0, options={"count": 4, "max_cost_factor": 1.05})
    assert len(found.routes) == 1


def test_an_open_hall_has_one_way():
    found, *_ = ask(HALL, weight=0.0, options={"count": 3, "max_cost_factor": 1.5})
    assert len(found.routes) == 1
    assert found.routes[0] is found.best.route


def test_around_an_uncertain_place_on_either_side():
    hall = "\n".join(["#" * 24, *["#" + "." * 22 + "#"] * 5, "#s" + "." * 20 + "g#"])
    hall = "\n".join([hall, *["#" + "." * 22 + "#"] * 6, "#" * 24])

    def sigma(x, y):
        return np.where((x > 4) & (x < 8) & (y > 2.5) & (y < 4.5), 1.0, 0.01)

    found, *_ = ask(hall, sigma=sigma, weight=4.0, options={"count": 3, "max_cost_factor": 1.3})
    assert len(found.routes) == 2
    assert (height(found.routes[0]) > 3.5) != (height(found.routes[1]) > 3.5)


def test_the_other_way_round_a_ring_keeps_the_bound():
    context = ring(low=0.05, high=0.02)
    problem = PlanningProblem(S, G, 0.3, weight=0.0, max_r95=0.2, deadline=20.0, refine=0)
    found = find_alternatives(problem, context, count=2, max_cost_factor=2.0)
    assert len(found.routes) == 2
    assert found.routes[1].summary.max_r95 <= 0.2
    assert found.routes[1].path.points[:, 1].max() > 3.0
    strict = PlanningProblem(S, G, 0.3, weight=0.0, max_r95=0.1, deadline=20.0, refine=0)
    alone = find_alternatives(strict, context, count=2, max_cost_factor=2.0)
    assert len(alone.routes) == 1


def test_no_way_and_no_distance():
    found, *_ = ask(
        HALL.replace("#......................#", "#.........#............#").replace(
            "s...........", "s........#.."
        )
    )
    assert found.best.status is PlanStatus.NO_PATH
    assert found.routes == ()
    context = ring()
    same = find_alternatives(PlanningProblem(S, S, 0.3), context)
    assert len(same.routes) == 1


@pytest.mark.parametrize("values", [{"covariance": "fused"}, {"max_blind_distance": 3.0}, {"via": (G,)}])
def test_questions_that_have_no_alternatives(values):
    with pytest.raises(InvalidProblem, match="Alternatives"):
        find_alternatives(PlanningProblem(S, G, 0.3, **values), ring())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 0}, "0 routes"),
        ({"count": 11}, "from 1 to 10"),
        ({"max_cost_factor": 0.9}, "max_cost_factor"),
        ({"max_cost_factor": math.nan}, "max_cost_factor"),
        ({"max_share": 1.0}, "max_share"),
    ],
)
def test_impossible_questions(options, words):
    with pytest.raises(InvalidProblem, match=words):
        find_alternatives(PlanningProblem(S, G, 0.3), ring(), **options)


def test_when_the_time_is_over():
    context = ring(resolution=0.05)
    found = find_alternatives(
        PlanningProblem(S, G, 0.3, deadline=0.06), context, count=5, max_cost_factor=3.0
    )
    assert found.best.stats["total_s"] < 2.0
    assert len(found.routes) == len(found.shares) <= 5


def test_what_is_found_is_told_at_once():
    told = []
    found, *_ = ask(LADDER, weight=0.0, options={"count": 3, "max_cost_factor": 1.6, "report": told.append})
    counts = [len(t.routes) for t in told]
    assert counts == sorted(counts)
    assert counts[-1] == len(found.routes) == 3
    assert all(len(t.shares) == len(t.routes) for t in told)
    assert [r.summary.cost for r in told[-1].routes] == [r.summary.cost for r in found.routes]


@pytest.mark.parametrize(
    "values",
    [
        {"kinematics": "dubins", "min_turn_radius": 0.5},
        {"start_heading": 0.0},
        {"footprint": ((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2))},
    ],
)
def test_robots_with_headings_have_no_alternatives(values):
    with pytest.raises(InvalidProblem, match="leave out kinematics"):
        ask(LADDER, **values)
