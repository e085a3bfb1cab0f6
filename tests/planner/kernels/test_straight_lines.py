"""Straight lines along paths on the grid against the obvious way to draw them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.context import PlanningContext
from planner.kernels.line_cost import motion_rate_cost
from planner.kernels.straight_lines import is_close, line_ends
from tests.fields import synthetic_field
from tests.oracles import ends_of_lines
from tests.worlds import world_from_ascii

ROOM = """
##############
#............#
#....##......#
#....##...#..#
#............#
#..#.........#
#............#
##############
"""


@pytest.mark.parametrize("within", [0.0, 0.5, 1.0, 3.0])
def test_lines_are_those_of_the_oracle(within):
    rng = np.random.default_rng(7)
    context = PlanningContext(synthetic_field(world_from_ascii(ROOM), 0.25, lambda x, y: 0.01 + 0 * x))
    graph = context.graph(radius=0.2, weight=0.0)
    space = graph.cost_space
    harms = rng.random((2, *space.frame.shape))
    rows, cols = np.nonzero(space.passable)

    def mean(harm):
        return lambda a, b: motion_rate_cost(*a, *b, harm, space.transform)

    some_line = 0
    for _ in range(12):
        a, b = rng.choice(len(rows), size=2, replace=False)
        ends = [tuple(space.centre(rows[k], cols[k]).tolist()) for k in (a, b)]
        points = graph.costs_to(ends[1]).path_from(ends[0])[1]
        if points is None or len(points) < 3:
            continue
        kept = np.empty(len(points), dtype=np.int64)
        count = line_ends(points, within * 0.25, harms, kept, *space.kernel_args)
        expected = ends_of_lines(
            points,
            within * 0.25,
            [mean(h) for h in harms],
            lambda a, b: math.isfinite(space.line_cost([a, b])),
        )
        assert kept[:count].tolist() == expected
        some_line += count < len(points)
    assert some_line > 3


def test_points_that_turn_back_are_not_close():
    back = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]])
    assert not is_close(back, 0, 2, 0.5)
    assert is_close(back, 0, 2, 1.0)
    assert not is_close(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]), 0, 2, 5.0)
