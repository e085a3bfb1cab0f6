"""Routes that differ: the best one, and others that cost a little more and go elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt

from maps.arrays import BoolArray, FloatArray
from planner.any_angle import shorten
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_space import CostSpace
from planner.cost_to_go import REACH_CELLS, GridGraph
from planner.crop import cells_of, cropped, window_around
from planner.errors import InvalidProblem
from planner.grid_search import Way
from planner.kernels.any_angle import relax, subdivide
from planner.kernels.line_cost import polyline_pieces
from planner.narrow import first_way
from planner.plan import finished, plan
from planner.problem import PlanningProblem
from planner.result import PlanResult, Route
from planner.unmet import keeps_risk

MAX_ALTERNATIVES = 10
# How much dearer cells on earlier routes are made, from as little as possible.
_PENALTIES = (0.3, 1.0, 3.0, 10.0)
# Searches for one alternative.
_MAX_TRIES = 12
# Part of the deadline for the best route.
_BEST_SHARE = 0.5
# A smooth curve may look for room this far from its path, m, or four radii.
_ROOM_M = 2.0
# How a path is let go: distances of its points, in cells.
_SPACINGS_CELLS = (24, 12, 6)
_MAX_SWEEPS = 60
_LATE = "The deadline came before other routes were searched."


@dataclass(frozen=True, slots=True, eq=False)
class Alternatives:
    """The best route and others, cheapest first.

    Attributes
    ----------
    best
        Answer to the question itself; its route is the first of ``routes``.
    routes
        Empty when there is no path.
    shares
        Part of each route's length that runs within the robot's width of those before it; 0 for the first.
    warnings
        What the caller should know beside the warnings of ``best``.
    """

    best: PlanResult
    routes: tuple[Route, ...]
    shares: tuple[float, ...]
    warnings: tuple[str, ...] = ()


def find_alternatives(
    problem: PlanningProblem,
    context: PlanningContext,
    *,
    count: int = 3,
    max_cost_factor: float = 1.4,
    max_share: float = 0.6,
    report: Callable[[Alternatives], None] | None = None,
) -> Alternatives:
    """Up to ``count`` routes that differ, the best one among them.

    Cells within the robot's width of the routes so far are made dearer, by as little as gives a path that
    shares few enough of them; only cells through which a cheap enough path leads are used (cost so far +
    cost to go). A path that only runs beside an earlier one, and goes back to it by small moves that each
    lower its cost, counts as the same. All routes keep the bounds of the first.

    Parameters
    ----------
    problem
        The question; its deadline is for all routes.
    context
        The field.
    count
        Routes at most, the best one included.
    max_cost_factor
        A route costs at most this times the best one, on the grid and when finished.
    max_share
        Part of a route's length that may run within the robot's width (twice the radius) of routes before.
    report
        Called in this thread with what there is so far, whenever it is more or better.

    Returns
    -------
    alternatives
        Fewer where no others were found: the penalties are a heuristic, not a proof that there are none.

    Raises
    ------
    InvalidProblem
        If count, factor or share make no sense, or there are via points, or a belief or a bound on the
        metres without a fix is asked for, or headings matter.
    StartOutsideMap, GoalOutsideMap, StartOccupied, GoalOccupied
        If the robot cannot stand at an end.
    """
    if problem.covariance != "fix" or problem.max_blind_distance is not None:
        raise InvalidProblem(
            "Alternatives count on single fixes and have no max_blind_distance; leave both out, or plan."
        )
    if problem.has_pose or context.headings is not None:
        raise InvalidProblem(
            "Alternatives are those of a disc that drives in every direction, on a field of one heading; "
            "leave out kinematics, headings and footprint, or plan."
        )
    if not 1 <= count <= MAX_ALTERNATIVES:
        raise InvalidProblem(f"{count} routes are asked for; it must be from 1 to {MAX_ALTERNATIVES}.")
    if not 1.0 <= max_cost_factor <= 100.0:
        raise InvalidProblem(f"The max_cost_factor is {max_cost_factor}; it must be from 1 to 100.")
    if not 0.0 <= max_share < 1.0:
        raise InvalidProblem(f"The max_share is {max_share}; it must be at least 0 and below 1.")
    if problem.via:
        raise InvalidProblem("Alternatives have no via points; ask for some from each to the next.")
    clock = Clock(problem.deadline)
    alone = replace(problem, deadline=max(0.05, problem.deadline * (_BEST_SHARE if count > 1 else 1.0)))
    first = None if report is None else lambda r: report(_alone(r))
    best = plan(alone, context, report=first)
    if best.route is None or count == 1 or problem.start == problem.goal:
        return _alone(best)
    way, context, _ = first_way(problem, context, clock)
    if way is None:
        return _alone(best, _LATE)
    found = _Search(way, problem, context, clock, max_cost_factor, max_share)

    def tell() -> None:
        if report is not None:
            report(Alternatives(best, *found.in_order()))

    warnings = found.run(best.route, count, tell)
    return Alternatives(best, *found.in_order(), tuple(warnings))


def _alone(best: PlanResult, *warnings: str) -> Alternatives:
    routes = () if best.route is None else (best.route,)
    return Alternatives(best, routes, (0.0,) * len(routes), warnings)


class _Search:
    """Routes so far, and the search for the next one."""

    def __init__(
        self,
        way: Way,
        problem: PlanningProblem,
        context: PlanningContext,
        clock: Clock,
        max_cost_factor: float,
        max_share: float,
    ) -> None:
        # Sampling would lead back to the best route.
        self.problem = replace(problem, refine=0)
        self.way, self.context, self.clock = way, context, clock
        self.factor, self.max_share = max_cost_factor, max_share
        self.width = max(2.0 * problem.radius, context.field.frame.resolution)
        self.room = max(_ROOM_M, 4.0 * problem.radius)
        self.routes: list[Route] = []

    def run(self, best: Route, count: int, tell: Callable[[], None]) -> list[str]:
        """Fill ``routes``, telling of each that is new; returns warnings."""
        self.routes = [best]
        space = self.way.graph.cost_space
        with self.clock.stop_flag() as stop:
            ends = [self.way.graph.costs_to(p, stop=stop) for p in (self.problem.start, self.problem.goal)]
        if not all(end.is_complete for end in ends):
            return [_LATE]
        on_grid = ends[1].path_from(self.problem.start)[0]
        self.limit = self.factor * min(on_grid, space.line_cost(self.way.points))
        through = ends[0].cost + ends[1].cost
        self.best_cost = space.line_cost(best.trajectory.points)
        usable = space.passable & (through <= self.limit * (1 + 1e-9))
        window = window_around(usable, cells_of(self.room, space) + REACH_CELLS)
        self.usable = usable[window]
        self.way = replace(self.way, graph=GridGraph.from_cost_space(cropped(space, window)))
        warnings: list[str] = []
        while len(self.routes) < count:
            route = self._next(warnings)
            if route is None:
                break
            self.routes.append(route)
            tell()
        if self.clock.is_over():
            warnings.append(f"The deadline of {self.problem.deadline:g} s ended the search for other routes.")
        return warnings

    def in_order(self) -> tuple[tuple[Route, ...], tuple[float, ...]]:
        """The best route and the others, cheapest first, and their shares."""
        costs = [self.cost_of(r) for r in self.routes[1:]]
        order = [0, *(1 + int(k) for k in np.argsort(costs, kind="stable"))]
        routes = [self.routes[k] for k in order]
        shares = [_share(r, routes[:k], self.width) for k, r in enumerate(routes) if k > 0]
        return tuple(routes), (0.0, *shares)

    def cost_of(self, route: Route) -> float:
        """Under the objective and bounds of the first way."""
        return self.way.graph.cost_space.line_cost(route.trajectory.points)

    def _next(self, warnings: list[str]) -> Route | None:
        """Another route that costs and shares little enough."""
        space = self.way.graph.cost_space
        used = _near(space, [r.trajectory.points for r in self.routes], self.width)
        limit = self.factor * self.best_cost
        for points, fenced in self._candidates(space, used):
            name = f"alternative {len(self.routes) + 1}"
            way = self._beside(points, fenced)
            now = self.clock.elapsed / self.clock.deadline
            end = now + 0.5 * (1.0 - now)
            route, said = finished(
                way, self.problem, self.context, self.clock, name=name, shares=(0.5 * (now + end), end)
            )
            asked = self.problem.max_collision_probability
            safe = asked is None or bool(self.way.relaxed) or keeps_risk(route, asked)
            if safe and self.cost_of(route) <= limit and self._is_new(route.trajectory.points):
                warnings.extend(said)
                return route
            used |= _near(space, [np.asarray(route.trajectory.points)], self.width)
        return None

    def _candidates(self, space: CostSpace, used: BoolArray) -> Iterator[tuple[FloatArray, CostSpace]]:
        """Grid paths that may become the next route, and spaces in which no shortcut leads back to others.

        ``used`` grows by what was tried.
        """
        level = 0
        for _ in range(_MAX_TRIES):
            if level == len(_PENALTIES) or self.clock.is_over():
                return
            rate = np.where(used, 1.0 + _PENALTIES[level], 1.0) * space.rate
            dearer = GridGraph.from_cost_space(replace(space, rate=rate, passable=self.usable))
            with self.clock.stop_flag() as stop:
                found = dearer.costs_to(self.problem.goal, stop=stop)
            if not found.is_complete:
                return
            _, points = found.path_from(self.problem.start)
            if points is None:
                return
            cost = space.line_cost(points)
            if not cost <= self.limit * (1 + 1e-9):
                return  # a higher penalty gives a dearer path
            if _share_of_cells(points, used, space) > self.max_share:
                level += 1
                continue
            fence = used & ~_near(space, [points], self.width)
            fenced = replace(space, rate=np.where(fence, np.inf, space.rate))
            tight, _ = shorten(points, fenced, deadline_at=self.clock.at())
            if self._is_new(_let_go(tight, space)):
                yield points, fenced
            used |= _near(space, [points], 2.0 * self.width)

    def _is_new(self, points: FloatArray) -> bool:
        lines = [r.trajectory.points for r in self.routes]
        return _share_of_line(points, lines, self.width) <= self.max_share

    def _beside(self, points: FloatArray, fenced: CostSpace) -> Way:
        """A way whose grid searches stay near it."""
        near = _near(fenced, [points], self.room)
        graph = GridGraph.from_cost_space(replace(fenced, passable=fenced.passable & near))
        return replace(self.way, graph=graph, points=points, grid_cost=fenced.line_cost(points))


def _let_go(points: FloatArray, space: CostSpace) -> FloatArray:
    """A polyline after small moves downhill: what is not held by obstacles or dearer cells goes back."""
    cell = space.frame.resolution
    for spacing in _SPACINGS_CELLS:
        points = subdivide(points, spacing * cell)
        relax(points, 0.25 * spacing * cell, cell / 8.0, _MAX_SWEEPS, *space.kernel_args)
    return points


def _near(space: CostSpace, lines: list[FloatArray], distance: float) -> BoolArray:
    """Cells whose centre is within a distance, m, of the centre of a cell that a polyline crosses."""
    frame = space.frame
    off = np.ones(frame.shape, dtype=np.bool_)
    for points in lines:
        pieces = polyline_pieces(frame.to_grid(points), space.rate)
        rows, cols = pieces[:, :2].astype(np.int64).T
        off[np.clip(rows, 0, frame.n_rows - 1), np.clip(cols, 0, frame.n_cols - 1)] = False
    if off.all():
        return np.zeros(frame.shape, dtype=np.bool_)
    return np.asarray(distance_transform_edt(off, sampling=frame.resolution) <= distance)


def _share_of_cells(points: FloatArray, used: BoolArray, space: CostSpace) -> float:
    """Part of a path's length in some cells."""
    pieces = polyline_pieces(space.frame.to_grid(points), space.rate)
    rows, cols = pieces[:, :2].astype(np.int64).T
    total = float(pieces[:, 4].sum())
    return float(pieces[used[rows, cols], 4].sum()) / total if total > 0 else 1.0


def _share(route: Route, others: list[Route], width: float) -> float:
    return _share_of_line(route.trajectory.points, [r.trajectory.points for r in others], width)


def _share_of_line(points: FloatArray, lines: list[FloatArray], width: float) -> float:
    """Part of a polyline's length within a distance, m, of others."""
    if len(points) < 2 or not math.isfinite(width):
        return 1.0
    line = shapely.LineString(points)
    near = shapely.union_all([shapely.LineString(p).buffer(width) for p in lines if len(p) > 1])
    return float(line.intersection(near).length / line.length) if line.length > 0 else 1.0
