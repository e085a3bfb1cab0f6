"""What is said where there is no path: the place, the numbers, the areas, the robot that was asked for."""

from __future__ import annotations

import pytest
from shapely import box

from planner.clock import Clock
from planner.context import PlanningContext
from planner.errors import StartOccupied
from planner.no_way import explained
from planner.plan import plan
from planner.problem import PlanningProblem
from planner.result import PlanResult, PlanStatus
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

# Doors of 1 m and of 0.5 m.
DOORS = """
####################
#........#.........#
#..................#
#........#.........#
#........#.........#
#........#.........#
#..................#
#..................#
#........#.........#
####################
"""
START, GOAL = (2.0, 3.4), (8.0, 3.4)
SQUARE = ((0.6, 0.6), (-0.6, 0.6), (-0.6, -0.6), (0.6, -0.6))


@pytest.fixture(scope="module")
def context():
    return PlanningContext(synthetic_field(world_from_ascii(DOORS, resolution=0.5), 0.1))


def ask(context, radius=0.7, **options):
    return plan(PlanningProblem(START, GOAL, radius, deadline=10.0, refine=0, **options), context)


def test_a_door_that_is_too_narrow(context):
    result = ask(context)
    assert result.status is PlanStatus.NO_PATH
    assert result.blocked.largest_radius == pytest.approx(0.5, abs=1e-5)
    assert result.blocked.radius == 0.7
    assert result.blocked.place[1] == pytest.approx(1.5, abs=1e-3)
    assert result.blocked.areas == ()
    (said,) = result.warnings
    assert "radius 0.7 m" in said
    assert "leaves 1 m between two walls at (" in said
    assert "1.50) m" in said
    assert "needs 1.4 m" in said
    assert "up to 0.5 m passes" in said
    assert "missed" not in said  # proven


def test_areas_that_close_the_way_are_named_and_nothing_else_is_searched(context):
    across = (box(50, 50, 51, 51), box(6.0, -1.0, 6.3, 9.0), box(5.2, 2.0, 5.4, 2.2), box(3.5, -1, 3.6, 9))
    result = ask(context, 0.2, avoid=across)
    assert result.status is PlanStatus.NO_PATH
    assert result.blocked.areas == (2, 4)
    assert result.blocked.radius_without_areas == pytest.approx(0.5, abs=1e-5)
    (said,) = result.warnings
    assert "avoid areas 2 and 4 close every way. Without avoid areas 2 and 4 a radius of up to 0.5 m" in said
    assert "missed" not in said
    assert context.finer is None


def test_an_area_that_narrows_the_door(context):
    result = ask(context, 0.4, avoid=(box(4.6, 0.9, 4.9, 1.3),))
    assert result.status is PlanStatus.NO_PATH
    assert result.blocked.areas == (1,)
    assert result.blocked.largest_radius == pytest.approx(0.35, abs=1e-4)
    assert "between" in result.warnings[0]
    assert "avoid area 1" in result.warnings[0]
    too_narrow_anyway = ask(context, 0.7, avoid=(box(4.6, 0.9, 4.9, 1.3),))
    assert "too little as well" in too_narrow_anyway.warnings[0]


def test_an_outline_is_called_one(context):
    result = ask(context, 0.1, footprint=SQUARE)
    assert result.status is PlanStatus.NO_PATH
    (said,) = result.warnings
    assert "a robot with an outline of 1.2 m × 1.2 m" in said
    assert "radius" not in said
    assert "needs at least 1.2 m" in said
    assert result.blocked.radius == pytest.approx(0.6)
    with pytest.raises(StartOccupied, match=r"outline of 1.2 m × 1.2 m needs 0.6 m"):
        plan(PlanningProblem((2.0, 4.0), GOAL, 0.1, footprint=SQUARE), context)
    # The radius does not count where there is an outline.
    small = tuple((0.2 * x, 0.2 * y) for x, y in SQUARE)
    assert plan(PlanningProblem((2.0, 4.2), GOAL, 0.9, footprint=small, refine=0), context).route is not None


def test_beliefs_and_via_points_say_it_too(context):
    for options in ({"covariance": "fused"}, {"max_blind_distance": 1.0}, {"via": ((2.0, 2.0),)}):
        result = ask(context, **options)
        assert result.status is PlanStatus.NO_PATH
        assert result.blocked.largest_radius == pytest.approx(0.5, abs=1e-5)
        assert "up to 0.5 m passes" in result.warnings[0]


def test_a_passage_that_cells_cannot_show(context):
    tight = ask(context, 0.499)
    if tight.route is None:
        assert "leaves it 0.001 m on both sides" in tight.warnings[0]


def test_walls_that_close_every_way():
    closed = DOORS.replace("..................", "........#.........")
    result = ask(PlanningContext(synthetic_field(world_from_ascii(closed, resolution=0.5), 0.1)), 0.2)
    assert result.status is PlanStatus.NO_PATH
    assert result.blocked.largest_radius == 0.0
    assert "thinnest at (4." in result.warnings[0]


def test_a_search_that_was_late_names_the_deadline_that_was_given(context):
    problem = PlanningProblem(START, GOAL, 0.2, deadline=1.5)
    late = PlanResult(
        PlanStatus.TIMEOUT, None, None, None, "lattice", warnings=("The deadline came 1.8 s after",)
    )
    (said,) = explained(late, problem, context, Clock(1.5)).warnings
    assert said.startswith("The deadline of 1.5 s came before")
    # Where the disc would pass, the other search's own reason stays, in the words of the robot asked for.
    square = PlanningProblem(
        (2.0, 3.4), GOAL, 0.1, footprint=((0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, -0.3))
    )
    other = PlanResult(
        PlanStatus.NO_PATH, None, None, None, "lattice", warnings=("No way for a robot of radius 0.3 m.",)
    )
    assert explained(other, square, context, Clock(9.0)).warnings == (
        "No way for a robot with an outline of 0.6 m × 0.6 m.",
    )
