"""Runs: which cells of a grid each landmark can be seen from, as stretches of rows and columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.arrays import frozen
from maps.errors import InvalidGeometry
from maps.kernels.runs import paint_runs

RunArray = npt.NDArray[np.int32]
MaskArray = npt.NDArray[np.uint64]


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Cells of a grid per landmark: far smaller than bit masks, and painted into masks on demand.

    The cells of landmark i are those of its row runs and those of its column runs. Its row runs do not
    overlap each other and are sorted by row; likewise its column runs. Build it with :meth:`from_lists`.

    Attributes
    ----------
    row_runs
        Shape (K, 3), int32: row, first column, column after the last.
    row_offsets
        Shape (N + 1,), int64: the row runs of landmark i are ``row_offsets[i] … row_offsets[i + 1]``.
    col_runs
        Shape (K', 3), int32: column, first row, row after the last.
    col_offsets
        Shape (N + 1,), int64.
    n_landmarks
        N.
    shape
        ``(n_rows, n_cols)`` of the grid.

    Raises
    ------
    InvalidGeometry
        If shapes disagree, a run leaves the grid, or the runs of a landmark are not sorted.
    """

    row_runs: RunArray
    row_offsets: npt.NDArray[np.int64]
    col_runs: RunArray
    col_offsets: npt.NDArray[np.int64]
    n_landmarks: int
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        for name, dtype in (
            ("row_runs", np.int32),
            ("row_offsets", np.int64),
            ("col_runs", np.int32),
            ("col_offsets", np.int64),
        ):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype))
        n_rows, n_cols = self.shape
        _check("row", self.row_runs, self.row_offsets, self.n_landmarks, (n_rows, n_cols))
        _check("column", self.col_runs, self.col_offsets, self.n_landmarks, (n_cols, n_rows))

    def __reduce__(self) -> tuple[type[Runs], tuple[object, ...]]:
        arrays = (self.row_runs, self.row_offsets, self.col_runs, self.col_offsets)
        return (Runs, (*arrays, self.n_landmarks, self.shape))

    @classmethod
    def from_lists(
        cls, shape: tuple[int, int], row_runs: Sequence[RunArray], col_runs: Sequence[RunArray] = ()
    ) -> Runs:
        """Runs of N landmarks, given landmark by landmark in any order of lines.

        Parameters
        ----------
        shape
            ``(n_rows, n_cols)``.
        row_runs
            N arrays of shape (·, 3): row, first column, column after the last; not overlapping.
        col_runs
            N arrays of shape (·, 3): column, first row, row after the last; or nothing.
        """
        n = len(row_runs)
        columns = col_runs or [np.empty((0, 3), dtype=np.int32)] * n
        return cls(*_joined(row_runs), *_joined(columns), n, shape)

    @property
    def n_words(self) -> int:
        """64-bit words that a mask has per cell: at least 1."""
        return max(1, (self.n_landmarks + 63) // 64)

    @property
    def nbytes(self) -> int:
        """Memory of the runs, bytes."""
        return self.row_runs.nbytes + self.col_runs.nbytes

    def masks(self, rows: slice = slice(None), cols: slice = slice(None)) -> MaskArray:
        """Masks of a window of cells.

        Parameters
        ----------
        rows, cols
            The window; steps other than 1 are refused. Windows of about 256 × 256 are painted fastest.

        Returns
        -------
        masks
            Shape (h, w, n_words), uint64: bit ``i % 64`` of word ``i // 64`` says whether the cell belongs to
            landmark i. The painting holds no lock, so threads may paint at the same time.
        """
        r0, r1, r_step = rows.indices(self.shape[0])
        c0, c1, c_step = cols.indices(self.shape[1])
        if r_step != 1 or c_step != 1:
            raise InvalidGeometry(f"Window steps are {r_step} and {c_step}; both must be 1.")
        height, width = max(0, r1 - r0), max(0, c1 - c0)
        out = np.zeros((height, width, self.n_words), dtype=np.uint64)
        planes = np.empty((2, height, width), dtype=np.uint64)
        paint_runs(self.row_runs, self.row_offsets, self.col_runs, self.col_offsets, r0, c0, planes, out)
        return out

    def counts(self) -> npt.NDArray[np.int64]:
        """Shape (N,): cells per landmark, those in a row run and a column run counted twice."""
        out = np.zeros(self.n_landmarks, dtype=np.int64)
        for runs, offsets in ((self.row_runs, self.row_offsets), (self.col_runs, self.col_offsets)):
            total = np.concatenate([[0], np.cumsum(runs[:, 2] - runs[:, 1], dtype=np.int64)])
            out += total[offsets[1:]] - total[offsets[:-1]]
        return out


def _joined(parts: Sequence[RunArray]) -> tuple[RunArray, npt.NDArray[np.int64]]:
    offsets = np.concatenate([[0], np.cumsum([len(p) for p in parts], dtype=np.int64)]).astype(np.int64)
    out = np.empty((int(offsets[-1]), 3), dtype=np.int32)
    for part, start, stop in zip(parts, offsets[:-1], offsets[1:], strict=True):
        piece = np.asarray(part, dtype=np.int32).reshape(-1, 3)
        out[start:stop] = piece[np.argsort(piece[:, 0], kind="stable")]
    out.flags.writeable = False  # handed over without a copy
    return out, offsets


def _check(what: str, runs: RunArray, offsets: npt.NDArray[np.int64], n: int, size: tuple[int, int]) -> None:
    if runs.ndim != 2 or runs.shape[1] != 3 or offsets.shape != (n + 1,):
        raise InvalidGeometry(
            f"The {what} runs have shape {runs.shape} and offsets {offsets.shape}; "
            f"give (K, 3) and ({n + 1},) for {n} landmarks."
        )
    if offsets[0] != 0 or offsets[-1] != len(runs) or (np.diff(offsets) < 0).any():
        raise InvalidGeometry(f"Offsets of the {what} runs must rise from 0 to {len(runs)}.")
    if len(runs) == 0:
        return
    line, first, stop = runs[:, 0], runs[:, 1], runs[:, 2]
    if line.min() < 0 or line.max() >= size[0] or first.min() < 0 or stop.max() > size[1]:
        raise InvalidGeometry(f"A {what} run leaves the grid of {size[0]} lines of {size[1]} cells.")
    if (first >= stop).any():
        raise InvalidGeometry(f"A {what} run is empty or ends before it starts.")
    falls = np.flatnonzero(np.diff(line) < 0) + 1
    if not np.isin(falls, offsets).all():
        raise InvalidGeometry(f"The {what} runs of a landmark must be sorted by {what}.")
