"""Proofs that there is no way, and finer grids for where there may be one."""

from __future__ import annotations

import numpy as np

from planner.context import PlanningContext
from planner.narrow import is_disconnected, refined
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

DOOR = """
############
#....#.....#
#....#.....#
#..........#
#....#.....#
############
"""
A, B = (1.5, 1.5), (4.5, 1.5)


def context(drawing=DOOR, resolution=0.25):
    sigma = lambda x, y: np.where(x > 4, np.nan, 0.01 * (1 + x))  # noqa: E731
    return PlanningContext(synthetic_field(world_from_ascii(drawing), resolution, sigma))


def test_a_door_of_half_a_metre():
    c = context()
    for radius, proven in ((0.2, False), (0.24, False), (0.45, True)):
        assert is_disconnected(c, radius, A, B) is proven
    assert is_disconnected(context(resolution=0.05), 0.3, A, B)
    assert not is_disconnected(context(resolution=0.05), 0.25, A, B)


def test_finer_cells_have_the_values_of_the_coarse_ones():
    c = context()
    fine = refined(c)
    assert refined(c) is fine
    frame = fine.field.frame
    assert frame.resolution == 0.25 / 4
    centres = frame.centres()
    rows, cols = np.moveaxis(c.field.frame.cell_at(centres), -1, 0)
    np.testing.assert_array_equal(fine.r95, c.r95[rows, cols])
    np.testing.assert_array_equal(fine.field.triplet, c.field.triplet[rows, cols])
    free = fine.field.world.floor.free_at(centres)
    np.testing.assert_array_equal(fine.centre_clearance > 0, free)


def test_too_many_cells_are_not_made(monkeypatch):
    monkeypatch.setattr("planner.narrow._MAX_CELLS", 1500)
    assert refined(context()).field.frame.resolution == 0.125
    monkeypatch.setattr("planner.narrow._MAX_CELLS", 300)
    assert refined(context()) is None
