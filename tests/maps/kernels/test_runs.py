"""Painting runs against setting one bit after the other."""

from __future__ import annotations

import numpy as np
import pytest

from maps.kernels.runs import first_run, paint_runs
from tests.oracles import masks_of_runs


def random_runs(rng, n_landmarks, n_lines, length):
    """Runs of each landmark, none overlapping on a line, sorted by line."""
    runs, offsets = [], [0]
    for _ in range(n_landmarks):
        for line in range(n_lines):
            if rng.random() < 0.6:
                cuts = np.unique(rng.integers(0, length + 1, 2 * rng.integers(1, 4)))
                cuts = cuts[: len(cuts) // 2 * 2].reshape(-1, 2)
                runs += [[line, a, b] for a, b in cuts]
        offsets.append(len(runs))
    return np.array(runs, dtype=np.int32).reshape(-1, 3), np.array(offsets)


def test_first_run_is_found():
    runs = np.array([[0, 0, 1], [2, 0, 1], [2, 3, 4], [5, 0, 1]], dtype=np.int32)
    assert [first_run(runs, 0, 4, line) for line in range(7)] == [0, 1, 1, 3, 3, 3, 4]
    assert first_run(runs, 2, 3, 9) == 3


@pytest.mark.parametrize("n_landmarks", [1, 5, 64, 70])
def test_window_is_painted_bit_by_bit(rng, n_landmarks):
    n_rows, n_cols = 9, 13
    rows, row_offsets = random_runs(rng, n_landmarks, n_rows, n_cols)
    cols, col_offsets = random_runs(rng, n_landmarks, n_cols, n_rows)
    expected = masks_of_runs(rows, row_offsets, cols, col_offsets, (n_rows, n_cols))
    for r0, r1, c0, c1 in [(0, 9, 0, 13), (2, 7, 3, 9), (8, 9, 12, 13), (0, 1, 0, 13), (4, 4, 2, 5)]:
        out = np.zeros((r1 - r0, c1 - c0, expected.shape[2]), dtype=np.uint64)
        planes = np.full((2, r1 - r0, c1 - c0), 7, dtype=np.uint64)
        paint_runs(rows, row_offsets, cols, col_offsets, r0, c0, planes, out)
        assert (out == expected[r0:r1, c0:c1]).all()


def test_no_landmark_leaves_the_mask_empty():
    none, offsets = np.empty((0, 3), dtype=np.int32), np.zeros(1, dtype=np.int64)
    out = np.zeros((2, 2, 1), dtype=np.uint64)
    paint_runs(none, offsets, none, offsets, 0, 0, np.zeros((2, 2, 2), dtype=np.uint64), out)
    assert not out.any()
