"""Candidates: the fastest among the cheap ones, else the cheapest."""

from __future__ import annotations

import math

import numpy as np

from planner.candidates import CandidateSearch
from planner.smoothing import _solve_box
from planner.timing import time_polyline
from tests.paths import space_of
from tests.worlds import world_from_ascii

ROOM = world_from_ascii("\n".join(["#" * 24, *["#" + "." * 22 + "#"] * 10, "#" * 24]))
PATH = np.array([[1.0, 1.0], [5.5, 4.0], [11.0, 1.0]])


def search(space, *, close, limit, deadline=math.inf):
    cost = space.line_cost(PATH)
    limits = (close * cost, limit * cost)
    out = CandidateSearch(space, 1.2, 0.8, limits=limits, deadline=deadline, solver=_solve_box)
    out.run(PATH)
    return out, cost


def test_more_room_in_the_cost_is_used_for_speed():
    # A valley bent like the path: cutting its corner costs.
    space = space_of(ROOM, lambda x, y: 0.05 + 0.4 * np.abs(y - 4.0 + 0.6 * np.abs(x - 5.5)), radius=0.3)
    tight, cost = search(space, close=1.001, limit=1.2)
    loose, _ = search(space, close=1.2, limit=1.2)
    assert tight.best.cost <= 1.2 * cost
    assert loose.best.trajectory.duration <= tight.best.trajectory.duration
    slow = time_polyline(PATH, max_speed=1.2, max_accel=0.8)
    assert tight.best.trajectory.duration < slow.duration
    assert tight.programmes > 0


def test_nothing_fits_below_the_least_possible_cost():
    space = space_of(ROOM, lambda x, y: 0.1 + 0.0 * x, radius=0.3)
    none, _ = search(space, close=0.5, limit=0.5)
    assert none.best is None
    assert "allowed is" in none.reason


def test_late_from_the_start():
    space = space_of(ROOM, lambda x, y: 0.1 + 0.0 * x, radius=0.3)
    none, _ = search(space, close=1.0, limit=1.0, deadline=-math.inf)
    assert none.best is None
    assert "deadline" in none.reason
