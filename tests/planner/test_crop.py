"""Windows of cost spaces cost what the whole does, inside."""

from __future__ import annotations

import math

import numpy as np

from planner.crop import cells_of, cropped, window_around
from tests.planner.test_cost_to_go import graph_of, random_world


def test_inside_costs_are_the_same_and_outside_is_forbidden(rng):
    graph, _ = graph_of(random_world(rng), radius=0.25)
    space = graph.cost_space
    part = cropped(space, (slice(10, 40), slice(5, 60)))
    assert part.frame.shape == (30, 55)
    np.testing.assert_allclose(part.centre(0, 0), space.centre(10, 5))
    rows, cols = np.nonzero(part.passable[2:-2, 2:-2])
    starts = part.centre(rows + 2, cols + 2)
    ends = starts + rng.uniform(-0.4, 0.4, size=starts.shape)
    np.testing.assert_allclose(part.motion_costs(starts, ends), space.motion_costs(starts, ends), rtol=1e-9)
    assert part.line_cost(space.centre([9], [5])) == math.inf


def test_windows():
    cells = np.zeros((10, 20), dtype=bool)
    assert window_around(cells, 2) == (slice(0, 10), slice(0, 20))
    cells[3, 4] = cells[5, 19] = True
    assert window_around(cells, 2) == (slice(1, 8), slice(2, 20))


def test_cells_of_a_length(rng):
    graph, _ = graph_of(random_world(rng))
    assert cells_of(1.0, graph.cost_space) == 4
    assert cells_of(1.01, graph.cost_space) == 5
