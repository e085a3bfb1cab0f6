"""Warnings of schedules: what the route's figures do not show, and what would help."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from api.schedule_notes import schedule_notes
from localization.sensors import MAS97_CAMERA
from maps.io.site import bundled_site
from planner.landmark_schedule import schedule_landmarks
from planner.timing import time_polyline

RATE = math.radians(30)


@pytest.fixture(scope="module")
def at_rate():
    world = bundled_site("mas97_room")
    points = np.array([[5.0, 1.0], [4.7, 3.0], [7.0, 5.5], [10.0, 8.0], [11.8, 11.0], [11.0, 14.0]])

    def schedule(rate, speed=1.0):
        # Accelerations go with the square of the speed: the same motion, only slower.
        line = time_polyline(points, max_speed=speed, max_accel=0.8 * speed**2)
        return schedule_landmarks(world, MAS97_CAMERA, line, pan_rate=rate)

    return schedule


def test_no_note_without_a_contradiction(at_rate):
    quick = at_rate(math.inf)
    assert schedule_notes(quick, 1, blind=quick.blind) == []
    slow = at_rate(RATE)
    assert schedule_notes(slow, 1, blind=slow.blind) == []
    assert schedule_notes(slow, 1, blind=slow.blind, max_r95=slow.max_r95, max_blind=9.0) == []


def test_where_how_long_and_what_helps(at_rate):
    slow = at_rate(RATE)
    [note] = schedule_notes(slow, 2, blind=0.2, faster=lambda factor: at_rate(factor * RATE))
    assert note.startswith("On route 2 a camera that pans at 30°/s is without a fix for ")
    assert f"for {slow.blind:.1f} m ({slow.blind_seconds:.1f} s)" in note
    assert f"{slow.turning:.1f} m ({slow.turning_seconds:.1f} s) while its pan head turns" in note
    longest = max(slow.gaps, key=lambda gap: gap.metres)
    assert f"from {longest.start:.1f} to {longest.end:.1f} m" in note
    rate, speed, left = (
        float(v) for v in re.search(r"At (\S+)°/s, or at (\S+) % of the speed, (\S+) m", note).groups()
    )
    assert rate * speed == pytest.approx(30 * 100, rel=0.02)
    assert left - slow.unavoidable <= 0.5 * (slow.blind - slow.unavoidable) + 0.05
    assert at_rate(math.radians(rate)).blind == pytest.approx(left, abs=0.051)


def test_slower_by_a_factor_is_a_head_faster_by_it(at_rate):
    faster, slower = at_rate(2 * RATE), at_rate(RATE, speed=0.5)
    assert [x.triplet for x in slower.stretches] == [x.triplet for x in faster.stretches]
    assert slower.blind == pytest.approx(faster.blind, abs=0.02)


def test_bounds_that_the_schedule_does_not_keep(at_rate):
    slow = at_rate(RATE)
    notes = schedule_notes(slow, 1, blind=0.0, max_r95=0.9 * slow.max_r95, max_blind=0.5)
    assert "more than the bound of 0.5 m" in notes[0]
    assert f"r95 up to {slow.max_r95:.3f} m" in notes[1]
    quick = at_rate(math.inf)
    [note] = schedule_notes(quick, 1, blind=quick.blind, max_blind=0.0, faster=at_rate)
    assert note.startswith("On route 1 the robot is without a fix for ")
    assert "at once" not in note
    never = schedule_notes(slow, 1, blind=0.0, faster=lambda _: slow)
    assert never[0].endswith("would not do either.")
