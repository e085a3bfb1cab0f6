"""Costs to a few far places, known for every cell: bounds that make searches between two places quick."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label

from maps.arrays import FloatArray, IntArray, frozen
from planner.cost_to_go import GridGraph
from planner.kernels.cost_to_go import one_to_all
from planner.kernels.pair_search import UNREACHED, best_pivots, quantised, spans_of_ends

#: Pivots per graph, and how many of them a search uses.
COUNT, CHOSEN = 16, 8
# Largest entry that stands for a cost.
_TOP = UNREACHED - 1


@dataclass(frozen=True, slots=True, eq=False)
class Pivots:
    """Differential heuristics of a graph [GH05]; made by :meth:`build`.

    Attributes
    ----------
    table
        Shape (n, K): cost from every padded cell to pivot k in ``units[k]``, rounded down.
    units
        Shape (K,).
    """

    table: npt.NDArray[np.uint16]
    units: FloatArray

    def __post_init__(self) -> None:
        self.table.flags.writeable = False
        object.__setattr__(self, "units", frozen(self.units))

    @classmethod
    def none(cls) -> Pivots:
        """No pivots: searches rely on distance alone."""
        return cls(np.zeros((1, 0), dtype=np.uint16), np.empty(0))

    @classmethod
    def build(
        cls, graph: GridGraph, *, count: int = COUNT, stop: npt.NDArray[np.uint8] | None = None
    ) -> Pivots | None:
        """Pivots in the largest connected part of a graph, each as far from the others as can be.

        Parameters
        ----------
        graph
            The passable cells.
        count
            Number of pivots; each takes one search of the whole graph and two bytes per cell.
        stop
            Shape (1,); another thread sets it to end the work early.

        Returns
        -------
        pivots
            None when it was stopped.
        """
        cells = _largest_part(graph)
        if len(cells) == 0:
            return cls.none()
        flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
        cost = np.empty(len(graph.half))

        def reach(cell: np.int64) -> bool:
            seeds, zero = frozen([cell], np.int64), frozen([0.0])
            return bool(
                one_to_all(graph.half, graph.width, seeds, zero, graph.smallest, math.inf, flag, cost)
            )

        count = min(count, len(cells))
        table = np.empty((len(graph.half), count), dtype=np.uint16)
        units = np.empty(count)
        nearest = np.full(len(cells), np.inf)
        if not reach(cells[0]):
            return None
        at = cells[np.argmax(cost[cells])]
        for k in range(count):
            if not reach(at):
                return None
            from_pivot = cost[cells]
            units[k] = max(float(from_pivot.max()) / _TOP * (1 + 1e-12), 1e-300)
            quantised(cost, units[k], k, table)
            np.minimum(nearest, from_pivot, out=nearest)
            at = cells[np.argmax(nearest)]
        return cls(table, units)

    @property
    def nbytes(self) -> int:
        """Memory of the table, bytes."""
        return int(self.table.nbytes)

    def towards(self, seed: int, ends: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """What a search from a cell to some ends needs.

        Parameters
        ----------
        seed, ends
            Padded flat index, and shape (E,).

        Returns
        -------
        chosen, low, high
            Shape (C,): the pivots that bound the way best; shape (K,): least and largest entries of the ends.
        """
        low = np.zeros(len(self.units), dtype=np.int64)
        high = np.zeros(len(self.units), dtype=np.int64)
        spans_of_ends(ends, self.table, self.units, low, high)
        return best_pivots(seed, CHOSEN, self.table, self.units, low, high), low, high


def _largest_part(graph: GridGraph) -> IntArray:
    """Cells (M,) of the largest connected part."""
    ny, nx = graph.cost_space.frame.shape
    passable = np.isfinite(graph.half).reshape(ny + 2, nx + 2)
    labels, n = label(passable, structure=np.ones((3, 3)))
    if n == 0:
        return np.empty(0, dtype=np.int64)
    sizes = np.bincount(labels.ravel(), minlength=n + 1)
    sizes[0] = 0
    return np.flatnonzero(labels.ravel() == np.argmax(sizes))
