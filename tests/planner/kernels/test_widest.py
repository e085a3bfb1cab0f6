"""The cell that joins two places, against every threshold tried."""

from __future__ import annotations

import numpy as np

from planner.kernels.widest import joining_cell, sides
from tests.oracles import widest_on_cells

NEVER = np.zeros(1, dtype=np.uint8)


def joined(values, a, b, stop=NEVER):
    source = np.zeros(values.shape, dtype=np.int8)
    source[a], source[b] = 1, 2
    order = np.argsort(-values.ravel(), kind="stable")
    parent = np.empty(values.size + 2, dtype=np.int32)
    cell = joining_cell(order, values.shape[1], source.ravel(), stop, parent)
    out = np.empty(values.size, dtype=np.int8)
    sides(parent, out)
    return cell, out.reshape(values.shape)


def test_against_all_thresholds(rng):
    for _ in range(60):
        values = rng.integers(0, 30, (7, 9)).astype(np.float64)
        a, b = (1, 1), (5, 7)
        values[a] = values[b] = 99.0
        cell, side = joined(values, a, b)
        assert values.ravel()[cell] == widest_on_cells(values, a, b)
        assert side[a] == 1
        assert side[b] == 2
        assert side.ravel()[cell] == 0
        # No cell of one side touches one of the other: the cell that joins them was missing.
        rows, cols = np.nonzero(side == 1)
        for row, col in zip(rows, cols, strict=True):
            assert not (side[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] == 2).any()


def test_cells_that_are_not_listed_join_nothing():
    values = np.ones((3, 5))
    source = np.zeros((3, 5), dtype=np.int8)
    source[1, 0], source[1, 4] = 1, 2
    order = np.flatnonzero(np.arange(15) % 5 != 2)
    parent = np.empty(17, dtype=np.int32)
    assert joining_cell(order, 5, source.ravel(), NEVER, parent) == -1
    assert joined(values, (1, 0), (1, 4), np.ones(1, dtype=np.uint8))[0] == -2
