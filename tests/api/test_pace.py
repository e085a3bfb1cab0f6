"""Seconds left."""

from __future__ import annotations

import pytest

from api.pace import Pace


def test_nothing_is_known_at_first():
    pace = Pace()
    assert pace.left(0.0) is None
    pace.note(0, 10, 0.0)
    assert pace.left(3.0) is None
    pace.note(1, 10, 0.1)
    assert pace.left(0.2) is None, "too short a time to say anything"


def test_what_counts_is_the_pace_lately():
    pace = Pace()
    for second in range(61):  # a tile in ten seconds, then two per second
        pace.note(second // 10 if second < 30 else 3 + 2 * (second - 30), 123, float(second))
    assert pace.left(60.0) == pytest.approx(60 / 2, rel=0.05), "not that of the slow start"


def test_when_only_the_writing_is_left_nothing_is_said():
    pace = Pace()
    for second in range(5):
        pace.note(second, 4, float(second))
    assert pace.left(5.0) is None


def test_an_hour_of_notes_is_not_kept():
    pace = Pace()
    for k in range(20_000):
        pace.note(k, 10**6, 0.25 * k)
    assert len(pace._notes) < 0.31 * 20_000
