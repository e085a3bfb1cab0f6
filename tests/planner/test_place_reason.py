"""Bounds that a place itself breaks, with the values there."""

from __future__ import annotations

import numpy as np
import pytest

from planner.context import PlanningContext
from planner.place_reason import bounds_broken_at
from planner.plan import plan
from planner.problem import PlanningProblem
from planner.reachability import reachable_region
from planner.travel import Travel
from planner.unmet import round_up
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
##############
#............#
#............#
#............#
#............#
##############
"""


@pytest.fixture(scope="module")
def context():
    sigma = lambda x, y: np.where(x < 2, np.nan, 0.02 * x)  # noqa: E731
    return PlanningContext(synthetic_field(world_from_ascii(ROOM, resolution=0.5), 0.1, sigma))


def problem(**bounds):
    return PlanningProblem((0.0, 0.0), (0.0, 0.0), 0.2, **bounds)


def test_each_bound_with_its_value(context):
    place = (4.03, 1.52)
    assert bounds_broken_at(place, problem(), context) == ()
    r95 = float(context.r95[tuple(context.field.frame.cell_at(place))])
    (said,) = bounds_broken_at(place, problem(max_r95=0.1), context)
    assert said == f"r95 is {round_up(r95)} m and max_r95 0.1 m"
    assert bounds_broken_at(place, problem(max_r95=1.01 * r95), context) == ()
    (said,) = bounds_broken_at(place, problem(max_ellipse95=0.1), context)
    assert "semi-major axis is 0.199 m" in said
    near = (4.03, 0.75)
    (said,) = bounds_broken_at(near, problem(max_collision_probability=0.01), context)
    assert "with 0.05 m of room" in said
    assert len(bounds_broken_at(near, problem(max_collision_probability=0.01, max_r95=0.1), context)) == 2


def test_a_place_without_a_fix(context):
    (said,) = bounds_broken_at((1.0, 1.5), problem(), context)
    assert said == "there is no fix: no landmark is in view there, and a fix needs three"
    assert bounds_broken_at((1.0, 1.5), problem(blind_r95=1.0), context) == ()


def test_a_region_of_nothing_says_why(context):
    region = reachable_region(context, (4.03, 1.52), travel=Travel(0.2, max_r95=0.01))
    assert region.area == 0.0
    assert "No way can begin at (4.03, 1.52) m itself: r95 is" in region.warnings[0]
    assert reachable_region(context, (4.03, 1.52), travel=Travel(0.2)).warnings == ()


def test_a_plan_names_the_end_without_a_fix(context):
    there = plan(PlanningProblem((1.0, 1.5), (5.0, 1.5), 0.2, deadline=10.0, refine=0), context)
    (unmet,) = there.unmet
    assert "The start itself has none: no landmark is in view there" in unmet.message
    assert "The goal itself" not in unmet.message
