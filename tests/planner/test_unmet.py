"""Numbers in messages are enough when they are typed in again."""

from __future__ import annotations

import pytest

from planner.context import PlanningContext
from planner.plan import plan
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from planner.unmet import round_down, round_up
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
############
#..........#
#..........#
#..........#
############
"""


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0812, "0.0812"),
        (0.08121, "0.0813"),
        (0.24477, "0.245"),
        (1.0, "1"),
        (12.345, "12.4"),
        (1234.5, "1240"),
        (0.0, "0"),
    ],
)
def test_round_up(value, text):
    assert round_up(value) == text


def test_rounded_up_is_never_less(rng):
    for value in 10 ** rng.uniform(-4, 4, 500):
        assert value <= float(round_up(value)) <= 1.011 * value


def test_rounded_down_is_never_more(rng):
    for value in rng.uniform(0, 5, 300):
        assert value - 1e-3 <= float(round_down(value)) <= value + 1e-9
    assert round_down(-0.1) == "0"
    assert round_down(0.35) == "0.35"


def asked(goal, limit, **options):
    context = PlanningContext(synthetic_field(world_from_ascii(ROOM, resolution=0.5), 0.1))
    problem = PlanningProblem(
        (1.5, 1.2), goal, 0.2, max_collision_probability=limit, refine=0, **{"deadline": 10.0, **options}
    )
    return plan(problem, context)


def test_an_end_that_breaks_the_bound_is_named():
    result = asked((4.5, 0.73), 1e-3)
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert "The goal itself breaks it, whatever way is taken" in unmet.message
    assert "0.03 m of room" in unmet.message
    assert "smaller cells" not in unmet.message
    assert (
        f"raise max_collision_probability to {round_up(max(unmet.value, unmet.smallest_possible))}"
        in unmet.message
    )
    assert asked((4.5, 1.2), 1e-3).status is PlanStatus.EXACT
    assert "The start itself" not in unmet.message


def test_cells_that_are_not_judged_in_time(monkeypatch):
    monkeypatch.setattr("planner.grid_search._JUDGING_SHARE", -1.0)
    kept = asked((4.5, 1.2), 1e-3)
    assert kept.status is PlanStatus.APPROXIMATE
    assert "searched without that bound" in kept.warnings[0]
    missed = asked((4.5, 0.73), 1e-3)
    assert missed.status is PlanStatus.TIMEOUT
    assert missed.route is not None
    assert "deadline of 10 s" in missed.warnings[0]
    (unmet,) = missed.unmet
    assert unmet.bound == "max_collision_probability"
