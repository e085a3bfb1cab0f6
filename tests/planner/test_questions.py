"""Bounds beside that on r95, areas, and the smallest worst r95: whole plans in a ring with two ways."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import Polygon

from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.extras import Extras, cost_factors, forbidden_cells
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from tests.fields import synthetic_field
from tests.planner.test_plan import RING, G, S, ask, ring
from tests.worlds import world_from_ascii

SHORT = shapely.box(4.5, 0.5, 6.5, 2.4)


def goes_above(route):
    return bool(route.path.points[:, 1].max() > 3.0)


def test_a_bound_on_the_ellipse_holds_on_the_long_way_only():
    context = ring(low=0.2, high=0.02)
    assert not goes_above(ask(context, weight=0.0).route)
    result = ask(context, weight=0.0, max_ellipse95=0.1)
    assert result.status is PlanStatus.EXACT
    assert goes_above(result.route)
    assert result.route.summary.max_ellipse95 <= 0.1


def test_an_ellipse_that_cannot_be_kept_gives_the_smallest_that_can():
    result = ask(ring(low=0.2, high=0.1), max_ellipse95=0.05)
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert unmet.bound == "max_ellipse95_m"
    assert unmet.smallest_possible == pytest.approx(0.1 * math.sqrt(5.991464547))
    assert "semi-major axis" in unmet.message
    assert goes_above(result.route)


def test_a_risky_passage_is_left_aside():
    # Below the block the corridor is 1 m wide, above it 1.5 m.
    context = ring(low=0.3, high=0.3)
    free = ask(context, weight=0.0)
    assert not goes_above(free.route)
    risk = free.route.summary.max_collision_probability
    assert 0.001 < risk <= free.route.summary.max_collision_bound
    safe = ask(context, weight=0.0, max_collision_probability=0.5 * risk)
    assert safe.status is PlanStatus.EXACT
    assert goes_above(safe.route)
    assert safe.route.summary.max_collision_probability <= 0.5 * risk * 1.001
    unmet = ask(context, weight=0.0, max_collision_probability=1e-9)
    assert unmet.status is PlanStatus.RISK_UNMET
    assert unmet.unmet[0].bound == "max_collision_probability"
    assert "m of room" in unmet.unmet[0].message
    assert 1e-9 < unmet.unmet[0].smallest_possible < risk


def test_what_must_be_avoided_is():
    context = ring()
    result = ask(context, avoid=(SHORT,))
    assert result.status is PlanStatus.EXACT
    assert goes_above(result.route)
    line = shapely.LineString(result.route.trajectory.points)
    assert line.distance(SHORT) >= 0.3 - 1e-6
    assert goes_above(result.shortest)
    both = ask(context, avoid=(shapely.box(4.5, 0.0, 6.5, 5.0),))
    assert both.status is PlanStatus.NO_PATH


def test_areas_cost_what_they_are_said_to():
    context = ring()
    cheap = ask(context, areas=((SHORT, 1.5),), objective="shortest")
    assert not goes_above(cheap.route)
    dear = ask(context, areas=((SHORT, 10.0),), objective="shortest")
    assert goes_above(dear.route)
    assert not goes_above(dear.shortest)
    field = context.field
    factors = cost_factors(Extras(areas=((SHORT, 2.0), (shapely.box(0, 0, 5, 5), 3.0))), field.frame)
    assert factors[field.frame.cell_at((4.8, 1.1))[0], field.frame.cell_at((4.8, 1.1))[1]] == 6.0
    assert set(np.unique(factors)) == {1.0, 2.0, 3.0, 6.0}


def test_closed_cells_are_those_the_body_could_touch(rng):
    context = ring()
    frame = context.field.frame
    polygon = Polygon([(2.1, 1.0), (3.3, 1.9), (2.2, 3.0)])
    closed = forbidden_cells(Extras(avoid=(polygon,)), context, 0.3)
    for row, col in np.ndindex(frame.shape):
        corners = frame.to_world(
            np.array([[col, row], [col + 1, row], [col + 1, row + 1], [col, row + 1]], float)
        )
        assert closed[row, col] == (Polygon(corners).distance(polygon) <= 0.3)
    assert forbidden_cells(Extras(), context, 0.3) is None


def test_minimax_takes_the_smallest_worst_then_the_shortest():
    context = ring(low=0.2, high=0.05)
    result = ask(context, objective="minimax")
    assert result.status is PlanStatus.EXACT
    assert goes_above(result.route)
    worst = result.route.summary.max_r95
    assert worst == pytest.approx(0.05 * math.sqrt(5.991464547))
    kept = ask(context, objective="minimax", max_r95=0.5)
    assert kept.status is PlanStatus.EXACT
    assert kept.route.summary.length == result.route.summary.length
    unmet = ask(context, objective="minimax", max_r95=0.01)
    assert unmet.status is PlanStatus.RISK_UNMET
    assert unmet.unmet[0].smallest_possible == pytest.approx(worst)
    # Where both ways are as good, the shorter one.
    assert not goes_above(ask(ring(low=0.05, high=0.05), objective="minimax").route)


def test_two_bounds_of_which_none_can_be_kept_alone():
    context = ring(low=0.3, high=0.3)
    result = ask(context, max_r95=0.1, max_ellipse95=0.1)
    assert result.status is PlanStatus.RISK_UNMET
    assert {u.bound for u in result.unmet} == {"max_r95_m", "max_ellipse95_m"}
    for unmet in result.unmet:
        assert unmet.smallest_possible == pytest.approx(0.3 * math.sqrt(5.991464547))


def test_blind_places_are_judged_by_what_stands_for_them():
    world = world_from_ascii(RING)
    blind = PlanningContext(
        synthetic_field(world, 0.25, lambda x, y: np.where((x > 4) & (x < 7) & (y < 2), np.nan, 0.01))
    )
    crossed = ask(blind, weight=0.0, blind_r95=0.5, max_collision_probability=0.6)
    assert not goes_above(crossed.route)
    careful = ask(blind, weight=0.0, blind_r95=2.0, max_collision_probability=0.01)
    assert goes_above(careful.route)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"objective": "fastest"}, "'minimax'"),
        ({"max_ellipse95": 0.0}, "max_ellipse95 is 0.0"),
        ({"max_collision_probability": 1.5}, "between 0 and 1"),
        ({"max_collision_probability": math.nan}, "between 0 and 1"),
        (
            {"avoid": (Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]),)},
            "avoid area 1 is no simple polygon: Self-inter",
        ),
        ({"avoid": (Polygon(),)}, "it is empty"),
        ({"areas": ((SHORT, 0.0),)}, "factor of area 1 is 0.0"),
        ({"areas": ((Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), 2.0),)}, "area 1 is no simple"),
        ({"via": ((math.inf, 1.0),)}, "Via point 1"),
        ({"via": ((1.0, 1.0),) * 51}, "limit is 50"),
        ({"avoid": (SHORT,) * 201}, "limit is 200"),
    ],
)
def test_impossible_questions(values, words):
    with pytest.raises(InvalidProblem, match=words):
        PlanningProblem(S, G, 0.3, **values)


def test_questions_are_values():
    a = PlanningProblem(S, G, 0.3, avoid=(SHORT,), areas=((SHORT, 2.0),))
    b = replace(a)
    assert a == b
    assert hash(a.extras) == hash(b.extras)
