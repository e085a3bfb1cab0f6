"""The container of runs: what it refuses, and windows of masks."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from maps.errors import InvalidGeometry
from maps.runs import Runs
from tests.oracles import masks_of_runs

ROWS = [
    np.array([[3, 0, 2], [1, 2, 5]]),  # lines in any order
    np.empty((0, 3)),
    np.array([[0, 0, 5], [1, 0, 5]]),
]
COLS = [np.array([[4, 0, 4]]), np.array([[2, 1, 2]]), np.array([[0, 1, 3]])]


def runs():
    return Runs.from_lists((4, 5), ROWS, COLS)


def test_lists_are_sorted_and_joined():
    r = runs()
    assert (r.n_landmarks, r.n_words, r.shape) == (3, 1, (4, 5))
    assert r.row_runs.tolist() == [[1, 2, 5], [3, 0, 2], [0, 0, 5], [1, 0, 5]]
    assert r.row_offsets.tolist() == [0, 2, 2, 4]
    assert r.counts().tolist() == [9, 1, 12]
    assert r.nbytes == 7 * 12
    assert not r.row_runs.flags.writeable


def test_masks_of_windows_are_cut_from_the_whole():
    r = runs()
    whole = masks_of_runs(r.row_runs, r.row_offsets, r.col_runs, r.col_offsets, r.shape)
    assert (r.masks() == whole).all()
    for rows in (slice(0, 2), slice(1, 4), slice(-1, None), slice(2, 2)):
        for cols in (slice(0, 5), slice(2, 3), slice(-2, 99)):
            assert (r.masks(rows, cols) == whole[rows, cols]).all()


def test_row_runs_alone_suffice():
    r = Runs.from_lists((4, 5), ROWS)
    assert len(r.col_runs) == 0
    assert (r.masks()[..., 0] & np.uint64(2) == 0).all()
    assert r.masks().astype(bool).sum() == 5 + 5 + 2


def test_no_landmarks_still_have_a_word():
    r = Runs.from_lists((2, 3), [])
    assert r.masks().shape == (2, 3, 1)
    assert not r.masks().any()


def test_pickle_keeps_everything_read_only():
    a, b = runs(), pickle.loads(pickle.dumps(runs()))
    assert (a.masks() == b.masks()).all()
    assert not b.col_runs.flags.writeable


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ([[4, 0, 1]], "leaves the grid"),
        ([[0, -1, 1]], "leaves the grid"),
        ([[0, 4, 6]], "leaves the grid"),
        ([[0, 2, 2]], "empty"),
    ],
)
def test_wrong_runs_are_refused(bad, words):
    with pytest.raises(InvalidGeometry, match=words):
        Runs.from_lists((4, 5), [np.array(bad)])


def test_wrong_offsets_shapes_orders_and_steps_are_refused():
    none, zero = np.empty((0, 3), dtype=np.int32), np.zeros(2, dtype=np.int64)
    with pytest.raises(InvalidGeometry, match="rise from 0"):
        Runs(none, np.array([0, 1]), none, zero, 1, (2, 2))
    with pytest.raises(InvalidGeometry, match="shape"):
        Runs(none, np.zeros(3, dtype=np.int64), none, zero, 1, (2, 2))
    with pytest.raises(InvalidGeometry, match="sorted by column"):
        Runs(none, zero, np.array([[1, 0, 1], [0, 0, 1]]), np.array([0, 2]), 1, (2, 2))
    with pytest.raises(InvalidGeometry, match="steps"):
        runs().masks(slice(None, None, 2))
