"""Exact grid search: what every cell costs to the goal, the cheapest path from any start, smallest bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray, IntArray, frozen
from planner.cost_space import CostSpace
from planner.kernels.cost_to_go import one_to_all, padded_half_costs, smallest_worst, walk_back
from planner.kernels.line_cost import polyline_pieces

#: Where a place's own cell cannot be used, all usable cells within this many rows and columns are tried.
REACH_CELLS = 5

Place = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class GridGraph:
    """The passable cells of a cost space as a graph: 8 neighbours, a move costs length × mean rate.

    Build it with :meth:`from_cost_space`.

    Attributes
    ----------
    cost_space
        What it was built from.
    half
        Shape ((ny + 2)(nx + 2),): half the cost of crossing a cell straight, inf where not passable;
        padded by one row and column on every side.
    smallest
        Smallest of them.
    """

    cost_space: CostSpace
    half: FloatArray
    smallest: float

    @classmethod
    def from_cost_space(cls, cost_space: CostSpace) -> GridGraph:
        """Graph of a cost space."""
        ny, nx = cost_space.frame.shape
        half = np.empty((ny + 2) * (nx + 2))
        resolution = cost_space.frame.resolution
        smallest = padded_half_costs(cost_space.rate, cost_space.passable, resolution, half)
        half.flags.writeable = False
        return cls(cost_space, half, float(smallest))

    @property
    def width(self) -> int:
        """Columns of the padded grid."""
        return self.cost_space.frame.n_cols + 2

    def index(self, rows: IntArray, cols: IntArray) -> IntArray:
        """Indices of cells in the padded flat grid."""
        return np.asarray((rows + 1) * self.width + cols + 1, dtype=np.int64)

    def centres(self, index: IntArray) -> FloatArray:
        """Centres of cells, W, m; shape (K, 2)."""
        return self.cost_space.centre(index // self.width - 1, index % self.width - 1)

    def connect(self, place: Place) -> tuple[IntArray, FloatArray]:
        """Cells that a place reaches in a straight line, and what that costs.

        The place's own cell alone when it is passable and reached, so that searches between cell centres
        are those of the plain grid; else all passable cells within ``REACH_CELLS``.

        Returns
        -------
        cells, costs
            Shape (S,): padded flat indices, and exact costs of the straight lines. Empty when there is none.
        """
        space = self.cost_space
        row, col = (int(v) for v in space.frame.cell_at(place))
        ny, nx = space.frame.shape
        inside = 0 <= row < ny and 0 <= col < nx
        if inside and space.passable[row, col]:
            cost = space.motion_costs(place, space.centre(row, col))
            if math.isfinite(cost[0]):
                return self.index(np.array([row]), np.array([col])), cost
        r0, c0 = max(row - REACH_CELLS, 0), max(col - REACH_CELLS, 0)
        near = space.passable[r0 : max(row + REACH_CELLS + 1, 0), c0 : max(col + REACH_CELLS + 1, 0)]
        rows, cols = np.nonzero(near)
        rows, cols = rows + r0, cols + c0
        costs = space.motion_costs(place, space.centre(rows, cols)) if len(rows) else np.empty(0)
        ok = np.isfinite(costs)
        return self.index(rows[ok], cols[ok]), costs[ok]

    def trace(
        self,
        padded: FloatArray,
        start: tuple[Place, IntArray, FloatArray],
        goal: tuple[Place, IntArray, FloatArray],
    ) -> tuple[float, FloatArray | None]:
        """Cheapest path from a place down costs to a goal.

        Parameters
        ----------
        padded
            Shape ((ny + 2)(nx + 2),): exact costs to the goal wherever a cheapest path may lead.
        start, goal
            (x, y) in W, m, and what :meth:`connect` gave for it.

        Returns
        -------
        cost, points
            Exact cost, and shape (K, 2), W, m: the start, cell centres, the goal; inf and None when there
            is no path.
        """
        place, cells, costs = start
        totals = costs + padded[cells]
        if len(cells) == 0 or not math.isfinite(totals.min()):
            return math.inf, None
        best = int(np.argmin(totals))
        seeds, seed_costs = frozen(goal[1], np.int64), frozen(goal[2])
        walked = walk_back(self.half, self.width, padded, int(cells[best]), seeds, seed_costs)
        points = np.concatenate([[place], self.centres(walked), [goal[0]]])
        moved = np.hypot(*np.diff(points, axis=0).T) > 1e-12
        keep = np.concatenate([[True], moved])
        keep[-1] = True
        if len(points) > 2 and not moved[-1]:
            keep[-2] = False  # the goal itself rather than the centre that it equals
        keep[0] = True
        return float(totals[best]), points[keep]

    def costs_to(
        self, goal: Place, *, limit: float = math.inf, stop: npt.NDArray[np.uint8] | None = None
    ) -> CostToGo:
        """Cost of the cheapest grid path from every cell to a place (or from it: moves are symmetric).

        Parameters
        ----------
        goal
            (x, y) in W, m.
        limit
            Cells dearer than this need not be finished.
        stop
            Shape (1,); another thread sets it to end the search early.
        """
        seeds, seed_costs = self.connect(goal)
        cost = np.empty(len(self.half))
        flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
        complete = one_to_all(self.half, self.width, seeds, seed_costs, self.smallest, limit, flag, cost)
        cost.flags.writeable = False
        return CostToGo(self, goal, frozen(seeds, np.int64), frozen(seed_costs), cost, limit, bool(complete))


@dataclass(frozen=True, slots=True, eq=False)
class CostToGo:
    """Exact cost from every cell to one goal; made by :meth:`GridGraph.costs_to`.

    Attributes
    ----------
    graph, goal
        Where, and to which place (x, y) in W, m.
    seeds, seed_costs
        Shape (S,): cells that reach the goal in a straight line, and what that costs.
    padded
        Shape ((ny + 2)(nx + 2),): costs, inf where the goal is not reached.
    limit, is_complete
        Costs above the limit, or any when the search was stopped, may be too high, never too low.
    """

    graph: GridGraph
    goal: Place
    seeds: IntArray
    seed_costs: FloatArray
    padded: FloatArray
    limit: float
    is_complete: bool

    @property
    def cost(self) -> FloatArray:
        """Shape (ny, nx): cost from the cell's centre to the goal, inf where there is no way; a copy."""
        ny, nx = self.graph.cost_space.frame.shape
        return frozen(self.padded.reshape(ny + 2, nx + 2)[1:-1, 1:-1])

    @property
    def nbytes(self) -> int:
        """Memory of the costs, bytes."""
        return int(self.padded.nbytes)

    def path_from(self, start: Place) -> tuple[float, FloatArray | None]:
        """Cheapest grid path from a place to the goal.

        Parameters
        ----------
        start
            (x, y) in W, m.

        Returns
        -------
        cost, points
            Exact cost, and shape (K, 2), W, m: the start, cell centres, the goal; inf and None when there
            is no path.
        """
        cells, costs = self.graph.connect(start)
        return self.graph.trace(self.padded, (start, cells, costs), (self.goal, self.seeds, self.seed_costs))


def known_or(values: FloatArray, blind: float | None) -> FloatArray:
    """Values with what counts in places without one; as they are where nothing is said."""
    return values if blind is None else np.where(np.isnan(values), blind, values)


def smallest_bound(graph: GridGraph, r95: FloatArray, start: Place, goal: Place) -> float:
    """Smallest worst r95 with which the goal can be reached on the grid.

    Parameters
    ----------
    graph
        Of a cost space without a bound on r95.
    r95
        Shape (ny, nx), m; NaN counts as no uncertainty (whether such cells are used is the graph's matter).
    start, goal
        (x, y) in W, m.

    Returns
    -------
    bound
        m; with ``max_r95`` equal to it a path exists, with less there is none. inf when there is no path
        at all.
    """
    space = graph.cost_space
    ny, nx = space.frame.shape
    values = np.full((ny + 2, nx + 2), np.inf)
    known = frozen(np.nan_to_num(r95, nan=0.0))
    values[1:-1, 1:-1] = np.where(space.passable, known, np.inf)
    flat = values.ravel()

    def worst_of_lines(place: Place, cells: IntArray) -> FloatArray:
        out = np.empty(len(cells))
        for k, centre in enumerate(graph.centres(cells)):
            pieces = polyline_pieces(space.frame.to_grid([place, centre]), known)
            rows, cols, rows2, cols2 = pieces[:, :4].astype(np.int64).T
            out[k] = np.maximum(known[rows, cols], known[rows2, cols2]).max(initial=0.0)
        return out

    goal_cells, _ = graph.connect(goal)
    start_cells, _ = graph.connect(start)
    if len(goal_cells) == 0 or len(start_cells) == 0:
        return math.inf
    worst = np.empty(len(flat))
    smallest_worst(flat, graph.width, goal_cells, worst_of_lines(goal, goal_cells), worst)
    return float(np.maximum(worst[start_cells], worst_of_lines(start, start_cells)).min())
