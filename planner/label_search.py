"""Cheapest grid path whose longest stretch without a fix is bounded, exact; else with the shortest possible.

Where there is no fix the robot drives by dead reckoning. The searches here follow how far it has driven
since the last fix: a label is a cell with the metres since then (augmented states, MATH §7). Without a way
within the bound the smallest bound with which there is one comes out of a spanning tree of the places with a
fix (Mehlhorn 1988), and the cheapest path that keeps it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.grid import GridFrame
from planner.cost_to_go import CostToGo, GridGraph, Place
from planner.errors import InvalidProblem
from planner.kernels.cost_to_go import one_to_all
from planner.kernels.labels import FOUND, blind_gaps, least_blind, reach_within
from planner.kernels.line_cost import polyline_pieces

Stop = npt.NDArray[np.uint8]

#: ``found`` keeps the bounds; ``bound_unmet`` keeps the smallest possible; ``no_path`` is proven; ``stopped``
#: was ended early, its path, if any, is the best so far.
LabelStatus = Literal["found", "bound_unmet", "no_path", "stopped"]

# Rounding of sums along a path, share of a bound and m.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LabelPath:
    """A path on the grid with what is known of the belief at its points.

    Attributes
    ----------
    status
        See :data:`LabelStatus`.
    is_complete
        Whether the search ended by itself: the answer is final.
    points
        Shape (K, 2), W, m: start, cell centres, goal; K = 0 without a path.
    cost
        Of the path in the search's own measure; inf without a path.
    blind
        Shape (K,): metres driven since the last fix, or since the start before the first.
    longest_blind
        Longest stretch without a fix, m: exact along the path, where the points are only its centres.
    excess
        Factor by which the bounds had to be widened, at least 1; with ``bound_unmet`` the smallest possible.
    covariance
        Shape (K, 3, 3): of the fused belief in x, y and heading; NaN when only distances were searched.
    worst_r95
        Largest r95 of the fused belief along the path, m, just before a fix rather than after it as at the
        points; NaN when only distances were searched.
    """

    status: LabelStatus
    is_complete: bool
    points: FloatArray
    cost: float
    blind: FloatArray
    longest_blind: float
    excess: float
    covariance: FloatArray
    worst_r95: float = math.nan

    def __post_init__(self) -> None:
        for name in ("points", "blind", "covariance"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def has_path(self) -> bool:
        """Whether there is a path."""
        return len(self.points) > 0

    @property
    def position_covariance(self) -> FloatArray:
        """Shape (K, 3): xx, xy, yy of the fused belief, m²."""
        P = self.covariance
        return np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], axis=-1)

    @property
    def r95(self) -> FloatArray:
        """Shape (K,): radius of the circle with the area of the fused 95 % ellipse, m."""
        return cov.r95(self.position_covariance)

    @property
    def ellipse95(self) -> FloatArray:
        """Shape (K,): semi-major axis of the fused 95 % ellipse, m."""
        return cov.ellipse95(self.position_covariance)[:, 0]


def without_path(*, is_complete: bool) -> LabelPath:
    """What a search answers that found nothing."""
    status: LabelStatus = "no_path" if is_complete else "stopped"
    none = np.empty(0)
    return LabelPath(
        status, is_complete, np.empty((0, 2)), math.inf, none, math.inf, math.inf, np.empty((0, 3, 3))
    )


@dataclass(frozen=True, slots=True)
class Stretches:
    """Metres without a fix on a line: from its begin, up to its end, and at most in one stretch.

    ``longest_from``: metres from the begin at which the longest one begins.
    """

    first: float
    last: float
    longest: float
    longest_from: float = 0.0


def line_stretches(frame: GridFrame, has_fix: BoolArray, points: npt.ArrayLike) -> Stretches:
    """Metres without a fix along a polyline (K, 2), W, m; on a border of two cells both must have one."""
    blind = np.where(has_fix, 0.0, 1.0)
    return _stretches(polyline_pieces(frame.to_grid(points), blind), has_fix, frame.resolution)


def blind_lines(graph: GridGraph, has_fix: BoolArray, place: Place, cells: IntArray) -> list[Stretches]:
    """Metres without a fix on the straight lines from a place to cells (padded flat indices)."""
    frame = graph.cost_space.frame
    return [line_stretches(frame, has_fix, [place, c]) for c in graph.centres(cells)]


class _Ends:
    """Start and goal on the grid: cells, costs of the straight lines there, metres without a fix."""

    def __init__(self, graph: GridGraph, has_fix: BoolArray, start: Place, goal: Place) -> None:
        self.starts, self.start_costs = graph.connect(start)
        self.goals, self.goal_costs = graph.connect(goal)
        self.start_lines = blind_lines(graph, has_fix, start, self.starts)
        self.goal_lines = blind_lines(graph, has_fix, goal, self.goals)


def _stretches(pieces: FloatArray, has_fix: BoolArray, resolution: float) -> Stretches:
    ny, nx = has_fix.shape
    rows, cols = np.clip(pieces[:, (0, 2)].astype(int), 0, ny - 1), pieces[:, (1, 3)].astype(int)
    seen = has_fix[rows, np.clip(cols, 0, nx - 1)].all(axis=1)
    run, longest, longest_from, driven = 0.0, 0.0, 0.0, 0.0
    first: float | None = None
    for ok, length in zip(seen.tolist(), (pieces[:, 4] * resolution).tolist(), strict=True):
        driven += length
        if ok:
            first = run if first is None else first
            run = 0.0
            continue
        run += length
        if run > longest:
            longest, longest_from = run, driven - run
    return Stretches(run if first is None else first, run, longest, longest_from)


def blind_path(
    graph: GridGraph,
    has_fix: BoolArray,
    start: Place,
    goal: Place,
    *,
    max_blind_distance: float,
    to_go: CostToGo | None = None,
    tolerance: float = 0.0,
    stop: Stop | None = None,
) -> LabelPath:
    """Cheapest 8-connected path whose longest stretch without a fix is at most a bound.

    A stretch is measured along the path where its cells have no fix; at the start it begins with 0 m, at
    the goal it ends. Where no path keeps the bound, the path with the smallest possible one.

    Parameters
    ----------
    graph
        Of a cost space in which cells without a fix are passable at a rate of their own.
    has_fix
        Shape (ny, nx): cells with a fix.
    start, goal
        (x, y) in W, m.
    max_blind_distance
        m, ≥ 0.
    to_go
        Cost to go of the graph, where it is at hand; used when no cell is ruled out by the bound alone.
    tolerance
        A label counts only if it is better by more than this share of the bound; 0: exact.
    stop
        Shape (1,); another thread sets it to end the search early.

    Raises
    ------
    InvalidProblem
        If the bound is negative or NaN.
    """
    if not max_blind_distance >= 0.0:
        raise InvalidProblem(
            f"The longest distance without a fix is {max_blind_distance} m; it must be at least 0."
        )
    flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
    search = _BlindSearch(graph, has_fix, start, goal, flag)
    # No walk without repetition is longer, and sums stay finite.
    asked = min(max_blind_distance, 2.0 * graph.cost_space.frame.resolution * len(graph.half))
    possible = search.smallest_bound(asked)
    if not math.isfinite(possible):
        return without_path(is_complete=flag[0] == 0)
    found = search.path(max(possible, asked), to_go, tolerance)
    if found.status == "found" and possible > asked:
        excess = possible / asked if asked > 0 else math.inf
        return LabelPath(
            "bound_unmet",
            is_complete=True,
            points=found.points,
            cost=found.cost,
            blind=found.blind,
            longest_blind=found.longest_blind,
            excess=excess,
            covariance=found.covariance,
        )
    return found


def smallest_blind_distance(graph: GridGraph, has_fix: BoolArray, start: Place, goal: Place) -> float:
    """Smallest bound on the metres without a fix with which the goal can be reached, m; inf without a path.

    Parameters are those of :func:`blind_path`.
    """
    return _BlindSearch(graph, has_fix, start, goal, np.zeros(1, dtype=np.uint8)).smallest_bound(0.0)


class _BlindSearch:
    """One pair of places on one graph."""

    def __init__(self, graph: GridGraph, has_fix: BoolArray, start: Place, goal: Place, stop: Stop) -> None:
        self.graph, self.stop = graph, stop
        self.start, self.goal = start, goal
        space = graph.cost_space
        ny, nx = space.frame.shape
        padded = np.zeros((ny + 2, nx + 2), dtype=np.uint8)
        padded[1:-1, 1:-1] = ~has_fix
        self.blind = padded.ravel()
        self.length = 0.5 * space.frame.resolution
        ends = self.ends = _Ends(graph, has_fix, start, goal)
        n = len(graph.half)
        self.gap, self.owner = np.empty(n), np.empty(n, dtype=np.int64)
        blind_gaps(
            graph.half,
            self.blind,
            graph.width,
            self.length,
            np.concatenate([ends.starts, ends.goals]),
            np.array([*(v.last for v in ends.start_lines), *(v.first for v in ends.goal_lines)]),
            np.repeat([n, n + 1], [len(ends.starts), len(ends.goals)]),
            self.gap,
            self.owner,
            stop,
        )

    def smallest_bound(self, bound: float) -> float:
        """Smallest possible bound, m, or ``bound`` itself where that is enough; inf without one in time."""
        ends, n = self.ends, len(self.graph.half)

        def joined(cell: int, line: Stretches, owner: int, metres: float) -> float:
            own = self.owner[cell] == owner
            return max(line.longest, 0.0 if own else metres + float(self.gap[cell]))

        if len(ends.starts) == 0 or len(ends.goals) == 0:
            return math.inf
        begin = [joined(c, v, n, v.last) for c, v in zip(ends.starts, ends.start_lines, strict=True)]
        end = [joined(c, v, n + 1, v.first) for c, v in zip(ends.goals, ends.goal_lines, strict=True)]
        worst = np.empty(n)
        reach_within(
            self.graph.half, self.blind, self.graph.width, self.length, self.gap, self.owner,
            ends.starts, np.array(begin), bound, worst, self.stop,
        )  # fmt: skip
        if self.stop[0] != 0:
            return math.inf
        return float(np.maximum(worst[ends.goals], end).min())

    def path(self, bound: float, to_go: CostToGo | None, tolerance: float) -> LabelPath:
        """Cheapest path within a bound, m."""
        graph, ends = self.graph, self.ends
        limit = bound * (1.0 + _ROUNDING) + _ROUNDING
        # To such a cell and on to the next end is too far even by the nearest ones.
        ruled_out = (self.blind != 0) & (2.0 * self.gap > limit) & np.isfinite(graph.half)
        costs = None if to_go is None or ruled_out.any() else to_go.padded
        if costs is None:
            half = frozen(np.where(ruled_out, np.inf, graph.half))
            costs = np.empty(len(half))
            seeds, seed_costs = ends.goals, ends.goal_costs
            one_to_all(half, graph.width, seeds, seed_costs, graph.smallest, math.inf, self.stop, costs)
            costs.flags.writeable = False  # as costs to go are: one kind of argument, one compilation
        starts = _rows(ends.starts, ends.start_costs, ends.start_lines, limit, "last")
        goals = _rows(ends.goals, ends.goal_costs, ends.goal_lines, limit, "first")
        outcome, cost, walked, since = least_blind(
            graph.half, self.blind, graph.width, self.length, costs, self.gap,
            starts, goals, limit, tolerance * bound, self.stop,
        )  # fmt: skip
        complete = outcome == FOUND
        if len(walked) == 0:
            return without_path(is_complete=self.stop[0] == 0)
        goal_line = self._goal_line(int(walked[-1]), float(since[-1]), limit)
        start_line = ends.start_lines[int(np.flatnonzero(ends.starts == walked[0])[0])]
        points = np.concatenate([[self.start], graph.centres(walked), [self.goal]])
        metres = np.concatenate([[0.0], since, [goal_line.last]])
        keep = kept_points(points)
        return LabelPath(
            "found" if complete else "stopped",
            is_complete=complete,
            points=points[keep],
            cost=float(cost),
            blind=metres[keep],
            longest_blind=max(
                start_line.longest, goal_line.longest, longest_stretch(graph, self.blind, walked, since)
            ),
            excess=1.0,
            covariance=np.full((int(keep.sum()), 3, 3), np.nan),
        )

    def _goal_line(self, cell: int, since: float, limit: float) -> Stretches:
        """The way from the last cell to the goal, with the metres before it; the cheapest that is allowed."""
        ends = self.ends
        able = [
            (float(ends.goal_costs[k]), v)
            for k, v in enumerate(ends.goal_lines)
            if ends.goals[k] == cell and since + v.first <= limit and v.longest <= limit
        ]
        line = min(able, key=lambda a: a[0])[1]
        first = since + line.first
        # Without a fix on the line its whole length is one stretch with what came before.
        unbroken = line.first == line.last == line.longest
        return Stretches(first, first if unbroken else line.last, max(first, line.longest))


def longest_stretch(
    graph: GridGraph, blind: npt.NDArray[np.uint8], walked: IntArray, since: FloatArray
) -> float:
    """Longest stretch without a fix on the moves between cells (K,) with metres since the last (K,), m."""
    rows, cols = walked // graph.width, walked % graph.width
    moves = 0.5 * graph.cost_space.frame.resolution * np.hypot(np.diff(rows), np.diff(cols))
    leaving = since[:-1] + np.where(blind[walked[:-1]] != 0, moves, 0.0)
    return float(max(leaving.max(initial=0.0), since.max(initial=0.0)))


def _rows(
    cells: IntArray, costs: FloatArray, lines: list[Stretches], limit: float, side: Literal["first", "last"]
) -> FloatArray:
    """Shape (S, 3) for the kernel: cell, cost, metres; without the lines that break the limit themselves."""
    rows = [
        (float(c), float(cost), getattr(line, side))
        for c, cost, line in zip(cells, costs, lines, strict=True)
        if line.longest <= limit
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def kept_points(points: FloatArray) -> BoolArray:
    """Shape (K,): points (K, 2) of a walk without those that repeat the one before; both ends stay."""
    moved = np.hypot(*np.diff(points, axis=0).T) > 1e-12
    keep = np.concatenate([[True], moved])
    keep[-1] = True
    if len(points) > 2 and not moved[-1]:
        keep[-2] = False  # the goal itself rather than the centre that it equals
    keep[0] = True
    return np.asarray(keep)
