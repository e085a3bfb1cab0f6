"""Numbers in messages are enough when they are typed in again."""

from __future__ import annotations

import pytest

from planner.unmet import round_up


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
