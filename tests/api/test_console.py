"""Tables of plans: rows for what was bounded, and for collisions where they are not unlikely."""

from __future__ import annotations

from dataclasses import replace

import pytest
from rich.console import Console

from api.codec_plan import plan_to_json
from api.console import comparison_table, routes_table
from api.finding import find
from api.questions import NOTHING_MORE, AlternativesAsked, More
from planner.context import PlanningContext
from planner.problem import PlanningProblem
from tests.api.answers_by_hand import plan_by_hand
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
############
#..........#
#....##....#
#..........#
############
"""
A, B = (1.5, 1.2), (4.5, 1.2)


def text(table):
    console = Console(width=80)
    with console.capture() as got:
        console.print(table)
    return got.get()


def answer(*, risk=None, **bounds):
    result = plan_by_hand(A, B)
    figures = replace(
        result.route.summary,
        max_ellipse95=0.2345,
        longest_blind=1.25 if "max_blind_distance" in bounds else 0.0,
        max_collision_probability=risk,
        max_collision_bound=0.02,
    )
    route = replace(result.route, summary=figures)
    field = synthetic_field(
        world_from_ascii(ROOM.replace(".", "A", 1).replace(".", "B", 1).replace(".", "C", 1))
    )
    problem = PlanningProblem(A, B, 0.2, **bounds)
    return plan_to_json(replace(result, route=route, shortest=route), field, problem=problem)


@pytest.mark.parametrize(
    ("bounds", "risk", "shown"),
    [
        ({}, 1e-9, set()),
        ({}, None, set()),
        ({}, 2e-6, {"collision probability"}),
        ({"max_ellipse95": 0.3}, 1e-9, {"worst ellipse axis"}),
        ({"max_blind_distance": 3.0}, 1e-9, {"longest without a fix"}),
        ({"max_collision_probability": 0.1}, 1e-9, {"collision probability", "its coarse bound"}),
    ],
)
def test_what_is_bounded_has_a_row(bounds, risk, shown):
    said = text(comparison_table(answer(risk=risk, **bounds)))
    rows = {"collision probability", "its coarse bound", "worst ellipse axis", "longest without a fix"}
    assert {row for row in rows if row in said} == shown
    assert "this plan" in said
    figures = {"worst ellipse axis": "0.2345", "longest without a fix": "1.25", "its coarse bound": "0.02"}
    for row in shown & set(figures):
        assert figures[row] in said


def test_several_routes_fit_a_terminal_with_all_bounds():
    found = answer(risk=0.03, max_ellipse95=0.3, max_collision_probability=0.1)
    found["routes"] *= 2
    said = text(routes_table(found))
    assert "…" not in said
    assert "shortest" in said
    assert said.count("0.2345") == 3
    assert said.count("0.03") >= 3


def test_a_risky_route_is_said_with_place_room_and_option():
    sigma = lambda x, y: 0.15 + 0.0 * x  # noqa: E731
    context = PlanningContext(synthetic_field(world_from_ascii(ROOM, resolution=0.5), 0.1, sigma))
    problem = PlanningProblem(A, B, 0.2, deadline=10.0, refine=0)
    for more in (NOTHING_MORE, More(AlternativesAsked(2))):
        found = find(problem, context, more)
        path = found.routes[0].route.path
        k = path.collision_probability.argmax()
        (said,) = [w for w in found.result.warnings if "touches" in w]
        assert f"({path.points[k, 0]:.2f}, {path.points[k, 1]:.2f}) m" in said
        assert "max_collision_probability" in said
        assert "of room" in said
    bounded = find(replace(problem, max_collision_probability=0.9), context, NOTHING_MORE)
    assert not any("touches" in w for w in bounded.result.warnings)
    sure = PlanningContext(
        synthetic_field(world_from_ascii(ROOM, resolution=0.5), 0.1, lambda x, y: 1e-4 + 0 * x)
    )
    centre = PlanningProblem((1.0, 1.3), (1.0, 1.2), 0.2, deadline=10.0, refine=0)
    assert not any("touches" in w for w in find(centre, sure, NOTHING_MORE).result.warnings)
