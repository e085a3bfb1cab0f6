"""Exact grid searches between two places: the cheapest path, and the cells where a cheaper one may lead."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray, IntArray, frozen
from planner.cost_to_go import CostToGo, GridGraph, Place
from planner.kernels.pair_search import clear, search, search_back
from planner.pivots import Pivots

Stop = npt.NDArray[np.uint8]

# Sets of work arrays that are kept for the next search.
_SPARE = 2
# Cells up to this share above the cheapest path are searched: all paths that are equal up to rounding.
_TIE = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class GridPath:
    """Outcome of a search between two places.

    Attributes
    ----------
    cost
        Of the cheapest grid path; inf when there is none.
    points
        Shape (K, 2), W, m: start, cell centres, goal; None when there is no path.
    is_complete
        False when the search was stopped: the path may not be the cheapest, or a path may have been missed.
    cells
        Cells through which a path leads that is not much dearer, if they were asked for.
    """

    cost: float
    points: FloatArray | None
    is_complete: bool = True
    cells: InformedCells | None = None


@dataclass(frozen=True, slots=True, eq=False)
class InformedCells:
    """Cells through which a grid path of a limited cost leads.

    Attributes
    ----------
    rows, cols
        Shape (M,), in the order of the grid.
    through
        Shape (M,): cost of the cheapest grid path from start to goal through each.
    """

    rows: IntArray
    cols: IntArray
    through: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Arrays:
    """Work arrays of the kernels for n cells, clean between searches."""

    cost: FloatArray
    back: FloatArray
    least: npt.NDArray[np.float32]
    state: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, n: int) -> _Arrays:
        return cls(
            np.full(n, np.inf),
            np.full(n, np.inf),
            np.full(n, np.nan, dtype=np.float32),
            np.zeros(n, np.uint8),
        )


class PairSearch:
    """Searches between pairs of places on graphs of one size; keeps its work arrays.

    May be used by several threads at a time.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._spare: list[_Arrays] = []

    @contextmanager
    def _arrays(self, n: int) -> Iterator[_Arrays]:
        with self._lock:
            self._spare = [a for a in self._spare if len(a.cost) == n]
            arrays = self._spare.pop() if self._spare else None
        arrays = arrays or _Arrays.of(n)
        yield arrays
        # After an exception the arrays are not clean: they are dropped.
        with self._lock:
            if len(self._spare) < _SPARE:
                self._spare.append(arrays)

    def path(
        self,
        graph: GridGraph,
        start: Place,
        goal: Place,
        *,
        margin: float = 0.0,
        pivots: Pivots | None = None,
        stop: Stop | None = None,
    ) -> GridPath:
        """Cheapest grid path: the same, to the last bit, as ``graph.costs_to(goal).path_from(start)``.

        Parameters
        ----------
        graph
            Where to search.
        start, goal
            (x, y) in W, m.
        margin
            Where it is above 0: also the cells with a path that is dearer by at most this share.
        pivots
            Of the graph; they affect speed only.
        stop
            Shape (1,); another thread sets it to end the search early.

        Notes
        -----
        A* [HNR68] from the goal with octile and differential heuristics [GH05]. All cells that may lie on a
        cheapest path are searched, so that the choice among equal ones does not depend on the pivots.
        """
        seeds, seed_costs = graph.connect(goal)
        ends, end_costs = graph.connect(start)
        if len(seeds) == 0 or len(ends) == 0:
            return GridPath(math.inf, None)
        with self._arrays(len(graph.half)) as work:
            flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
            slack = 1.0 + max(margin, _TIE)
            touched, complete = _towards(
                graph, (seeds, seed_costs), (ends, end_costs), pivots, math.inf, work, flag, slack=slack
            )
            known = _seen(work.cost)
            cost, points = graph.trace(known, (start, ends, end_costs), (goal, seeds, seed_costs))
            cells = None
            if margin > 0.0 and points is not None:
                cells = _through(graph, (ends, end_costs), known, slack * cost, work, flag)
            clear(touched, work.cost, work.least, work.state)
        return GridPath(cost, points, bool(complete), cells)

    def informed_cells(
        self,
        graph: GridGraph,
        start: Place,
        goal: Place,
        limit: float,
        *,
        to_go: CostToGo | None = None,
        pivots: Pivots | None = None,
        stop: Stop | None = None,
    ) -> InformedCells | None:
        """Cells through which a grid path of at most ``limit`` leads, and its cost.

        Parameters
        ----------
        graph, start, goal, pivots, stop
            As for :meth:`path`.
        limit
            Largest cost that counts, finite.
        to_go
            Costs to the goal, if they are known; they affect speed only.

        Returns
        -------
        cells
            None when the search was stopped.
        """
        seeds, seed_costs = graph.connect(goal)
        ends, end_costs = graph.connect(start)
        if len(seeds) == 0 or len(ends) == 0:
            return _cells(graph, np.empty(0, dtype=np.int64), np.empty(0))
        flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
        with self._arrays(len(graph.half)) as work:
            if to_go is not None:
                return _through(graph, (ends, end_costs), to_go.padded, limit, work, flag)
            touched, complete = _towards(
                graph, (seeds, seed_costs), (ends, end_costs), pivots, limit, work, flag, slack=math.inf
            )
            cells = _through(graph, (ends, end_costs), _seen(work.cost), limit, work, flag)
            clear(touched, work.cost, work.least, work.state)
        return cells if complete else None


def _through(
    graph: GridGraph,
    begins: tuple[IntArray, FloatArray],
    to_go: FloatArray,
    limit: float,
    work: _Arrays,
    stop: Stop,
) -> InformedCells | None:
    found, complete = search_back(
        graph.half, graph.width, *begins, to_go, limit, graph.smallest, stop, work.back, work.state
    )
    found = np.sort(found)
    through = work.back[found] + to_go[found]
    clear(found, work.back, work.least, work.state)
    return _cells(graph, found.astype(np.int64), through) if complete else None


def _towards(
    graph: GridGraph,
    begins: tuple[IntArray, FloatArray],
    ends: tuple[IntArray, FloatArray],
    pivots: Pivots | None,
    limit: float,
    work: _Arrays,
    stop: Stop,
    *,
    slack: float,
) -> tuple[npt.NDArray[np.int32], bool]:
    pivots = pivots or Pivots.none()
    chosen, low, high = pivots.towards(int(begins[0][0]), ends[0])
    touched, complete = search(
        graph.half,
        graph.width,
        *begins,
        *ends,
        graph.smallest,
        pivots.table,
        chosen,
        pivots.units,
        low,
        high,
        limit,
        slack,
        stop,
        work.cost,
        work.least,
        work.state,
    )
    return touched, bool(complete)


def _seen(array: FloatArray) -> FloatArray:
    # Compiled once for arrays that may be written and once for those that may not: always the latter.
    view = array.view()
    view.flags.writeable = False
    return view


def _cells(graph: GridGraph, found: IntArray, through: FloatArray) -> InformedCells:
    rows, cols = found // graph.width - 1, found % graph.width - 1
    return InformedCells(frozen(rows, np.int64), frozen(cols, np.int64), frozen(through))
