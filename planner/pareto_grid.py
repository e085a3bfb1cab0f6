"""Fronts on the grid: length against worst or mean r95, the widest gap first, each of its points exact."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, replace
from itertools import count as count_up
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray, frozen
from planner.context import PlanningContext
from planner.cost_space import CostSpace
from planner.cost_to_go import REACH_CELLS, CostToGo, GridGraph, smallest_bound
from planner.crop import cells_of, cropped, window_around
from planner.kernels.matrix import way_figures
from planner.kernels.pareto import least_worst_of_cheapest
from planner.problem import PlanningProblem, blind_rate_of

# Lengths and integrals closer than this share are equal.
_EQUAL = 1e-9
# Weight that stands for r95 alone, 1/m.
_MOST_WEIGHT = 1e4
# Room around what paths pass, m, for smoothing.
_MARGIN_M = 2.0


@dataclass(slots=True, eq=False)
class GridPoint:
    """One path of a front.

    Attributes
    ----------
    points, grid_cost
        Shape (K, 2), W, m; and the cost of the optimal 8-connected path, None where only a line is valid.
    length
        m.
    worst, integral
        Largest r95, m, and ``∫ r95 ds``, m², of the cells that it crosses; cells without a fix count as
        ``blind_r95``.
    setting
        Bound on r95, m, or weight, 1/m, under which it is optimal.
    known_to
        Largest bound for which it is known to be the shortest.
    """

    points: FloatArray
    grid_cost: float | None
    length: float
    worst: float
    integral: float
    setting: float
    known_to: float = math.nan


class GridFront:
    """The points found so far, and the gaps between them.

    Parameters
    ----------
    problem, context
        The question and its field; objective and factors of areas are left aside.
    stop
        Shape (1,): another thread sets it to end a search early.
    """

    def __init__(
        self, problem: PlanningProblem, context: PlanningContext, stop: npt.NDArray[np.uint8]
    ) -> None:
        self.problem, self.context, self.stop = problem, context, stop
        blind = problem.blind_r95
        self.values: FloatArray = context.r95
        if blind is not None:
            self.values = frozen(np.where(np.isnan(context.r95), blind, context.r95))
        self.base = context.graph(
            radius=problem.radius,
            weight=0.0,
            max_r95=problem.max_r95,
            blind_rate=blind_rate_of(0.0, blind, problem.max_r95, problem.max_ellipse95),
            extras=problem.extras.without_areas(),
        )
        self.points: list[GridPoint] = []
        self.is_weighted = False
        self._last_search: CostToGo | None = None

    def against_worst(self, count: int) -> None:
        """Fill ``points``, shortest first, with up to ``count`` lengths against worst r95.

        With enough of them, all that there are: between two points the shortest path is searched under
        the bound in the middle of those that are not decided yet.
        """
        problem = self.problem
        first = self._shortest(math.inf)
        if first is None:
            return
        to_go = self._last_search
        self.points = [first]
        least = smallest_bound(self.base, self.values, problem.start, problem.goal)
        last = self._shortest(least) if least < first.worst else None
        if last is None or last.length <= first.length * (1 + _EQUAL):
            self.points = [first if last is None else last]
            return
        self.points = [last, first]
        self._crop(last.length, to_go)
        levels = np.unique(self.values[self.base.cost_space.passable])
        scale = (last.length - first.length, max(first.worst - last.worst, 1e-300))
        gaps: list[tuple[float, int, GridPoint, GridPoint, bool]] = []
        order = count_up()

        def add(surer: GridPoint, shorter: GridPoint, *, is_steep: bool = False) -> None:
            wide = (surer.length - shorter.length) / scale[0]
            high = (shorter.worst - surer.known_to) / scale[1]
            heapq.heappush(gaps, (-wide * high, next(order), surer, shorter, is_steep))

        add(last, first)
        while gaps and len(self.points) < count and self.stop[0] == 0:
            _, _, surer, shorter, is_steep = heapq.heappop(gaps)
            bound = _middle(levels, surer.known_to, shorter.worst)
            found = None if bound is None else self._shortest(bound)
            if bound is not None and found is not None and _is_as_long(found, surer):
                surer.known_to = bound
                # Nothing in the middle: perhaps nothing at all. Once, the highest level says so.
                bound = None if is_steep else _middle(levels, surer.known_to, shorter.worst, at_top=True)
                if is_steep:
                    add(surer, shorter, is_steep=True)
                found = None if bound is None else self._shortest(bound)
                is_steep = True
            if found is None or _is_as_long(found, surer):
                continue
            self.points.append(found)
            add(surer, found, is_steep=is_steep)
            add(found, shorter)
        self.points.sort(key=lambda p: p.length)

    def against_mean(self, count: int) -> None:
        """Fill ``points``, shortest first, with up to ``count`` lengths against ``∫ r95 ds``.

        Those that are optimal under some weight: between two of them the weight is searched under which both
        cost the same.
        """
        self.is_weighted = True
        ends = [self._weighted(0.0)]
        to_go = self._last_search
        ends.append(self._weighted(_MOST_WEIGHT))
        self.points = [p for p in ends if p is not None]
        if len(self.points) < 2 or _same(*self.points):
            self.points = self.points[:1]
            return
        a, b = self.points
        scale = (b.length - a.length, a.integral - b.integral)
        if min(scale) <= 0:
            self.points = [min(self.points, key=lambda p: (p.length, p.integral))]
            return
        self._crop(b.length, to_go)
        order = count_up()
        gaps = [(-1.0, next(order), a, b)]
        while gaps and len(self.points) < count and self.stop[0] == 0:
            _, _, a, b = heapq.heappop(gaps)
            weight = (b.length - a.length) / (a.integral - b.integral)
            found = self._weighted(weight)
            cost = a.length + weight * a.integral
            if found is None or found.length + weight * found.integral >= cost * (1 - _EQUAL):
                continue
            self.points.append(found)
            for p, q in ((a, found), (found, b)):
                wide, high = q.length - p.length, p.integral - q.integral
                if wide > scale[0] * _EQUAL and high > scale[1] * _EQUAL:
                    area = wide * high / (scale[0] * scale[1])
                    heapq.heappush(gaps, (-area, next(order), p, q))
        self.points.sort(key=lambda p: p.length)

    def graph(self, point: GridPoint) -> GridGraph:
        """The planning grid on which the path of a point is optimal."""
        space = self._weighted_space(point.setting) if self.is_weighted else self._space_under(point.setting)
        return GridGraph.from_cost_space(space)

    def _crop(self, length: float, to_go: CostToGo | None) -> None:
        """Forget what no path up to a length passes; ``to_go`` holds lengths to the goal."""
        so_far = self.base.costs_to(self.problem.start, limit=length * (1 + _EQUAL), stop=self.stop)
        if to_go is None or not so_far.is_complete:
            return
        space = self.base.cost_space
        through = so_far.cost + to_go.cost <= length * (1 + _EQUAL)
        if not through.any():
            return
        window = window_around(through, cells_of(_MARGIN_M, space) + REACH_CELLS)
        self.base = GridGraph.from_cost_space(cropped(space, window))
        self.values = frozen(self.values[window])

    def _shortest(self, bound: float) -> GridPoint | None:
        """Shortest path under a bound, of those as short the one whose worst r95 is smallest."""
        found = self._search(self._space_under(bound), bound)
        if found is None:
            return None
        point, to_go = found
        cells, costs = to_go.graph.connect(self.problem.start)
        if len(cells):
            padded = np.full((self.values.shape[0] + 2, self.values.shape[1] + 2), np.inf)
            padded[1:-1, 1:-1] = self.values
            graph = to_go.graph
            at = int(cells[np.argmin(costs + to_go.padded[cells])])
            least = least_worst_of_cheapest(
                graph.half, graph.width, to_go.padded, padded.ravel(), at, to_go.seeds, to_go.seed_costs
            )
            again = self._search(self._space_under(least), least) if least < point.worst else None
            self._last_search = to_go
            if again is not None and again[0].length <= point.length * (1 + _EQUAL):
                point = again[0]
        point.known_to = bound if math.isfinite(bound) else point.worst
        return point

    def _weighted(self, weight: float) -> GridPoint | None:
        found = self._search(self._weighted_space(weight), weight)
        return None if found is None else found[0]

    def _space_under(self, bound: float) -> CostSpace:
        space = self.base.cost_space
        if not math.isfinite(bound):
            return space
        with np.errstate(invalid="ignore"):
            over = self.values > bound
        return replace(space, rate=np.where(over, np.inf, space.rate), passable=space.passable & ~over)

    def _weighted_space(self, weight: float) -> CostSpace:
        space = self.base.cost_space
        rate = np.where(np.isfinite(space.rate), 1.0 + weight * self.values, np.inf)
        return replace(space, rate=rate, weight=weight)

    def _search(self, space: CostSpace, setting: float) -> tuple[GridPoint, CostToGo] | None:
        problem = self.problem
        graph = GridGraph.from_cost_space(space)
        to_go = graph.costs_to(problem.goal, stop=self.stop)
        self._last_search = to_go
        if not to_go.is_complete:
            return None
        cost, points = to_go.path_from(problem.start)
        line = np.array([problem.start, problem.goal])
        straight = space.line_cost(line)
        if math.isfinite(straight) and straight <= cost:
            points = line
        if points is None:
            return None
        length, integral, _, worst = way_figures(space.frame.to_grid(points), self.values)
        if length == 0.0:
            worst = float(self.values[tuple(space.frame.cell_at(problem.start))])
        cell = space.frame.resolution
        grid_cost = cost if math.isfinite(cost) else None
        return GridPoint(points, grid_cost, length * cell, worst, integral * cell, setting), to_go


def spread(points: list[GridPoint], values: list[float], count: int) -> list[int]:
    """Numbers of up to ``count`` points, ends first, then always the one in the middle of the widest gap.

    Parameters
    ----------
    points
        By length.
    values
        What they are good for: r95, m.
    count
        How many.
    """
    n = len(points)
    if n <= 2 or count <= 2:
        return list(dict.fromkeys([0, n - 1]))[:count]
    lengths = np.array([p.length for p in points])
    scaled = np.stack(
        [lengths / max(np.ptp(lengths), 1e-300), np.array(values) / max(np.ptp(values), 1e-300)]
    )
    kept = [0, n - 1]
    while len(kept) < min(count, n):
        far = [
            min(float(np.abs(scaled[:, k] - scaled[:, i]).sum()) for i in kept) if k not in kept else -1.0
            for k in range(n)
        ]
        kept.append(int(np.argmax(far)))
    return kept


def not_dominated(pairs: list[tuple[float, float]]) -> list[int]:
    """Numbers of the pairs that no other is below in one and not above in the other, by the first number."""
    order = sorted(range(len(pairs)), key=lambda k: pairs[k])
    out: list[int] = []
    for k in order:
        if not out or pairs[k][1] < pairs[out[-1]][1]:
            out.append(k)
    assert all(pairs[i] != pairs[j] for i, j in pairwise(out))
    return out


def _is_as_long(found: GridPoint, surer: GridPoint) -> bool:
    return found.length >= surer.length * (1 - _EQUAL)


def _middle(levels: FloatArray, low: float, high: float, *, at_top: bool = False) -> float | None:
    """A level between two, near their middle or the highest; None where there is none."""
    i = int(np.searchsorted(levels, low, side="right"))
    j = int(np.searchsorted(levels, high, side="left"))
    if i >= j:
        return None
    k = int(np.clip(np.searchsorted(levels, 0.5 * (low + high), side="right") - 1, i, j - 1))
    return float(levels[j - 1 if at_top else k])


def _same(a: GridPoint, b: GridPoint) -> bool:
    return math.isclose(a.length, b.length, rel_tol=_EQUAL) and math.isclose(
        a.integral, b.integral, rel_tol=_EQUAL
    )
