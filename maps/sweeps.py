"""Runs of many landmarks: all at once while they are few, else band by band of rows, when asked for.

Far sight over a cluttered floor can take more memory as runs than as masks. Then only the runs of one band
are kept; painting windows from the first row to the last computes each band once.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from maps.runs import MaskArray, RunArray, Runs

#: Runs that are kept at once, bytes. Making them takes about twice this for a moment.
MAX_RUN_BYTES = 160 * 2**20
# Heights of bands are multiples of this: not much lower than the tiles of a field.
_BAND_ROWS = 64

Tick = Callable[[int, int], None]


class Sweep(Protocol):
    """Sight of single landmarks over a grid."""

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks."""

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_rows, n_cols)`` of the grid."""

    def runs_of(self, i: int, first: int, stop: int) -> tuple[RunArray, RunArray]:
        """Row runs and column runs of landmark i within the rows ``first … stop - 1`` of the grid."""


class TooManyRuns(Exception):
    """Runs of the first ``done`` landmarks take more than the limit."""

    def __init__(self, done: int, n_bytes: int) -> None:
        super().__init__(f"The runs of {done} landmarks take {n_bytes} bytes.")
        self.done = done
        self.n_bytes = n_bytes


def all_runs(
    sweep: Sweep,
    *,
    rows: tuple[int, int] | None = None,
    limit: float = float("inf"),
    threads: int | None = None,
    tick: Tick | None = None,
) -> Runs:
    """Runs of all landmarks within some rows, in the coordinates of the whole grid.

    Parameters
    ----------
    sweep
        N landmarks.
    rows
        First row and the row after the last; default: all.
    limit
        Bytes at which the work stops.
    threads
        Default: one per core. The result does not depend on it.
    tick
        Called with (landmarks done, N) after each landmark, from the calling thread; it may raise to stop.

    Raises
    ------
    TooManyRuns
        If the runs exceed the limit.
    """
    first, stop = rows or (0, sweep.shape[0])
    n = sweep.n_landmarks
    across: list[RunArray] = []
    along: list[RunArray] = []
    n_bytes = 0
    pool = ThreadPoolExecutor(max_workers=threads or os.cpu_count() or 1)
    try:
        for done, (a, b) in enumerate(pool.map(lambda i: sweep.runs_of(i, first, stop), range(n)), 1):
            across.append(a)
            along.append(b)
            n_bytes += a.nbytes + b.nbytes
            if n_bytes > limit:
                raise TooManyRuns(done, n_bytes)
            if tick is not None:
                tick(done, n)
    finally:
        # A tick may raise to stop the work.
        pool.shutdown(cancel_futures=True)
    return Runs.from_lists(sweep.shape, across, along)


def bounded_runs(
    sweep: Sweep, *, limit: float = MAX_RUN_BYTES, threads: int | None = None, tick: Tick | None = None
) -> Runs | BandedRuns:
    """Runs of all landmarks if they fit into ``limit`` bytes, else a maker of bands that do.

    Parameters
    ----------
    sweep, threads, tick
        As for :func:`all_runs`.
    limit
        Bytes of runs kept at once. A single band of 64 rows is made whatever it takes.
    """
    try:
        return all_runs(sweep, limit=limit, threads=threads, tick=tick)
    except TooManyRuns as found:
        expected = found.n_bytes / found.done * sweep.n_landmarks
        if tick is not None:
            tick(sweep.n_landmarks, sweep.n_landmarks)
        return BandedRuns(sweep, limit, int(0.8 * limit / expected * sweep.shape[0]), threads)


@dataclass(frozen=True, slots=True)
class _Band:
    first: int
    stop: int
    runs: Runs


class BandedRuns:
    """Runs of one band of rows at a time, with the interface of :class:`~maps.runs.Runs`.

    Threads may paint at once; they wait while a band is made.

    Parameters
    ----------
    sweep
        What makes them.
    limit
        Bytes per band; one that takes more is halved, down to 64 rows.
    height
        Rows of a band to begin with.
    threads
        For making a band.
    """

    def __init__(self, sweep: Sweep, limit: float, height: int, threads: int | None = None) -> None:
        self._sweep = sweep
        self._limit = limit
        self._height = max(_BAND_ROWS, height // _BAND_ROWS * _BAND_ROWS)
        self._threads = threads
        self._lock = threading.Lock()
        self._kept: list[_Band] = []

    def __reduce__(self) -> tuple[type[BandedRuns], tuple[object, ...]]:
        return (BandedRuns, (self._sweep, self._limit, self._height, self._threads))

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks."""
        return self._sweep.n_landmarks

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_rows, n_cols)`` of the grid."""
        return self._sweep.shape

    @property
    def n_words(self) -> int:
        """64-bit words that a mask has per cell: at least 1."""
        return max(1, (self.n_landmarks + 63) // 64)

    def masks(self, rows: slice = slice(None), cols: slice = slice(None)) -> MaskArray:
        """Masks of a window of cells, as of :meth:`maps.runs.Runs.masks`."""
        r0, r1, _ = rows.indices(self.shape[0])
        parts = []
        row = r0
        while row < r1:
            band = self._band(row)
            parts.append(band.runs.masks(slice(row, min(r1, band.stop)), cols))
            row = band.stop
        if len(parts) == 1:
            return parts[0]
        width = len(range(*cols.indices(self.shape[1])))
        return np.concatenate([np.empty((0, width, self.n_words), dtype=np.uint64), *parts])

    def counts(self) -> npt.NDArray[np.int64]:
        """Shape (N,): cells per landmark; makes all bands."""
        out = np.zeros(self.n_landmarks, dtype=np.int64)
        row = 0
        while row < self.shape[0]:
            band = self._band(row)
            out += band.runs.counts()
            row = band.stop
        return out

    def _band(self, row: int) -> _Band:
        with self._lock:
            for band in self._kept:
                if band.first <= row < band.stop:
                    return band
            # Windows before the last may still be painted when one beyond it is begun: two are kept.
            del self._kept[:-1]
            while True:
                first = row // self._height * self._height
                stop = min(first + self._height, self.shape[0])
                try:
                    runs = all_runs(
                        self._sweep,
                        rows=(first, stop),
                        limit=self._limit if self._height > _BAND_ROWS else float("inf"),
                        threads=self._threads,
                    )
                except TooManyRuns:
                    self._height = max(_BAND_ROWS, self._height // 2 // _BAND_ROWS * _BAND_ROWS)
                    continue
                self._kept.append(_Band(first, stop, runs))
                return self._kept[-1]
