"""Motions in parts: what cannot be smoothed as a whole is smoothed piece by piece, with few stops."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from planner import smoothing
from planner.context import PlanningContext
from planner.motion import least_limit, move_along, stops_in_words
from planner.timing import time_polyline
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

HALL = """
########################################
#......................................#
#......................................#
#......................................#
#......................................#
#......................................#
########################################
"""
ZIGZAG = np.array([[1.0, 1.0], [4.0, 2.5], [7.0, 1.0], [10.0, 2.5], [13.0, 1.0], [16.0, 2.5], [19.0, 1.0]])


@pytest.fixture(scope="module")
def space():
    return (
        PlanningContext(synthetic_field(world_from_ascii(HALL), 0.25))
        .graph(radius=0.3, weight=0.0)
        .cost_space
    )


def move(space, points=ZIGZAG, limit=None, deadline=30.0):
    limit = least_limit(space.line_cost(points), None) if limit is None else limit
    at = time.monotonic() + deadline
    return move_along(points, space, max_speed=1.2, max_accel=0.8, cost_limit=limit, deadline_at=at)


def check(motion, space, limit, points=ZIGZAG):
    t = motion.trajectory
    assert (np.diff(t.t) > 0).all()
    np.testing.assert_array_equal(t.points[[0, -1]], points[[0, -1]])
    np.testing.assert_array_equal(t.velocity[[0, -1]], np.zeros((2, 2)))
    assert space.line_cost(t.points) <= limit * (1 + 1e-9)
    assert np.hypot(*t.velocity.T).max() <= 1.2 * 1.001


def test_a_path_that_can_be_smoothed_does_not_stop(space):
    motion = move(space)
    assert motion.is_smooth
    assert motion.n_stops == 0
    assert stops_in_words(motion, "route") is None
    check(motion, space, least_limit(space.line_cost(ZIGZAG), None))
    stopping = time_polyline(ZIGZAG, max_speed=1.2, max_accel=0.8)
    assert motion.trajectory.duration < 0.95 * stopping.duration


def test_where_the_middle_fails_the_halves_are_smoothed(space, monkeypatch):
    real = smoothing.smooth

    def only_short(points, *args, **kwargs):
        if len(points) > 4:
            p = time_polyline(points, max_speed=1.2, max_accel=0.8)
            return smoothing.SmoothResult(ok=False, trajectory=p, reason="too long for a test")
        return real(points, *args, **kwargs)

    monkeypatch.setattr(smoothing, "smooth", only_short)
    monkeypatch.setattr("planner.motion.with_fewer_corners", lambda points, *_: points)
    motion = move(space)
    assert motion.is_smooth
    assert motion.n_stops == 1
    assert "one place" in stops_in_words(motion, "route")
    assert "too long for a test" in stops_in_words(motion, "route")
    check(motion, space, least_limit(space.line_cost(ZIGZAG), None))


def test_nothing_can_be_smoothed_or_there_is_no_time(space, monkeypatch):
    stopping = time_polyline(ZIGZAG, max_speed=1.2, max_accel=0.8)
    late = move(space, deadline=-1.0)
    assert not late.is_smooth
    # Straight is cheaper here, and nothing is in the way.
    assert late.n_stops == 0
    assert late.trajectory.duration < stopping.duration
    monkeypatch.setattr("planner.motion.with_fewer_corners", lambda points, *_: points)
    late = move(space, deadline=-1.0)
    assert late.n_stops == 5
    assert "deadline" in late.reason
    np.testing.assert_array_equal(late.trajectory.points, stopping.points)

    def never(points, *_, **__):
        p = time_polyline(points, max_speed=1.2, max_accel=0.8)
        return smoothing.SmoothResult(ok=False, trajectory=p, reason="no")

    monkeypatch.setattr(smoothing, "smooth", never)
    motion = move(space, limit=space.line_cost(ZIGZAG))
    assert motion.n_stops == 5
    assert motion.trajectory.duration == pytest.approx(stopping.duration)
    check(motion, space, space.line_cost(ZIGZAG))


def test_the_limit_is_the_grid_path_but_never_below_the_polyline():
    assert least_limit(10.0, 10.1) == 10.1
    assert least_limit(10.0, 9.9) == 10.0
    assert least_limit(10.0, math.inf) == least_limit(10.0, None) > 10.0
