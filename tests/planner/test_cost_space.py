"""Cost spaces: which cells, what a line costs, how much room it has."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.clearance import ClearanceIndex
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.cost_space import cost_space_for, passable_clearance
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
##########
#A.......#
#........#
#...##...#
#B......C#
##########
"""


def space(world, field, *, radius=0.2, weight=4.0, **bounds):
    index = ClearanceIndex.from_world(world)
    centre = index.at_centres(field.frame)
    return cost_space_for(
        field.frame, field.free, field.r95, index, centre, radius=radius, weight=weight, **bounds
    )


def test_rates_and_bounds_cell_by_cell():
    world = world_from_ascii(ROOM)
    field = synthetic_field(world, 0.25, lambda x, y: np.where(x > 4, np.nan, 0.01 * x))
    r95 = field.r95
    plain = space(world, field)
    np.testing.assert_allclose(plain.rate[field.has_fix], 1 + 4 * r95[field.has_fix])
    assert np.isinf(plain.rate[~field.has_fix]).all()
    bounded = space(world, field, max_r95=0.05, blind_rate=3.0)
    blind = field.free & ~field.has_fix
    assert (bounded.rate[blind] == 3.0).all()
    assert np.isinf(bounded.rate[~field.free]).all()
    np.testing.assert_array_equal(np.isinf(bounded.rate), ~field.free | (np.nan_to_num(r95) > 0.05))
    assert (space(world, field, weight=0.0).rate[field.has_fix] == 1).all()


def test_moves_between_passable_neighbours_are_valid_and_cost_the_mean(rng):
    mask = np.pad(rng.random((30, 40)) < 0.93, 1)
    frame = GridFrame(3.0, -7.0, 0.6, 0.5, *mask.shape)
    world = World("w", OccupancyGrid(frame, mask, ~mask), LandmarkSet((), np.empty((0, 2))))
    field = synthetic_field(world, 0.25, lambda x, y: 0.05 + 0.02 * np.sin(3 * x) * np.cos(2 * y))
    for radius in (0.0, 0.3, 0.55):
        cs = space(world, field, radius=radius)
        rows, cols = np.nonzero(cs.passable)
        assert len(rows) > 20
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            inside = (rows + dr < frame.n_rows * 2) & (cols + dc >= 0) & (cols + dc < frame.n_cols * 2)
            r, c = rows[inside], cols[inside]
            both = cs.passable[r + dr, c + dc]
            r, c = r[both], c[both]
            cost = cs.motion_costs(cs.centre(r, c), cs.centre(r + dr, c + dc))
            want = math.hypot(dr, dc) * 0.25 * 0.5 * (cs.rate[r, c] + cs.rate[r + dr, c + dc])
            np.testing.assert_allclose(cost, want, rtol=1e-12)


def test_the_radius_itself_is_allowed_and_not_less():
    world = world_from_ascii(ROOM)
    field = synthetic_field(world, 0.25)
    cs = space(world, field, radius=0.3)
    rate = cs.rate[field.has_fix][0]
    # The lower wall ends at y = 0.5.
    assert cs.line_cost([[1.0, 0.8], [1.5, 0.8]]) == pytest.approx(0.5 * rate)
    assert cs.line_cost([[1.0, 0.79], [1.5, 0.8]]) == math.inf
    assert cs.line_cost([[1.0, 0.8], [1.0, 0.8]]) == 0.0
    assert cs.line_cost([[1.0, 0.8]]) == 0.0
    assert cs.line_cost([[1.0, 0.7]]) == math.inf
    through = [[2.5, 0.9], [2.5, 2.0]]
    assert cs.line_cost(through) == math.inf


def test_a_point_robot_may_not_touch():
    world = world_from_ascii(ROOM)
    cs = space(world, synthetic_field(world, 0.25), radius=0.0)
    assert cs.line_cost([[1.0, 0.5], [4.0, 0.5]]) == math.inf
    assert cs.line_cost([[1.0, 0.51], [4.0, 0.51]]) < math.inf


def test_passable_margin():
    assert passable_clearance(0.35, 0.1) - 0.35 == pytest.approx(0.1**2 / 4 / 0.35, rel=0.02)
