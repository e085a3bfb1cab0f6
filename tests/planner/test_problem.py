"""Problems refuse numbers that make no sense."""

from __future__ import annotations

import math

import pytest

from planner.errors import InvalidProblem
from planner.problem import PlanningProblem


def problem(**values):
    return PlanningProblem(**({"start": (0, 0), "goal": (1, 1), "radius": 0.3} | values))


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("start", (math.nan, 0.0), "start"),
        ("goal", (0.0, math.inf), "goal"),
        ("radius", -0.1, "at least 0"),
        ("radius", math.nan, "radius"),
        ("radius", 51.0, "at most 50"),
        ("weight", -1.0, "weight"),
        ("max_r95", 0.0, "above 0"),
        ("max_r95", math.inf, "max_r95"),
        ("blind_r95", -0.5, "blind_r95"),
        ("max_speed", 0.0, "above 0"),
        ("max_accel", -1.0, "max_accel"),
        ("deadline", 0.0, "deadline"),
        ("deadline", 31.0, "at most 30"),
        ("seed", -1, "seed"),
        ("seed", 2**31, "seed"),
        ("refine", -1, "refine"),
        ("objective", "fastest", "'fastest'"),
    ],
)
def test_impossible_numbers_are_named(name, value, said):
    with pytest.raises(InvalidProblem, match=said) as caught:
        problem(**{name: value})
    assert name in str(caught.value)


def test_places_become_floats_and_the_weight_follows_the_objective():
    p = problem(start=(1, 2))
    assert p.start == (1.0, 2.0)
    assert isinstance(p.start[0], float)
    assert p.effective_weight == 4.0
    assert problem(objective="shortest").effective_weight == 0.0
