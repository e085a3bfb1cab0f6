"""The first path: optimal on the grid under the bounds, or the best effort where they cannot be kept."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.clock import Clock, Stopped, flag_at
from planner.context import PlanningContext
from planner.cost_to_go import GridGraph, known_or, smallest_bound
from planner.pair_search import InformedCells
from planner.problem import PlanningProblem, blind_rate_of
from planner.smallest_risk import smallest_risk

# Cost per metre without a fix where that is forbidden and cannot be avoided: as little of it as possible.
_BLIND_RATE = 1e4
#: Samples are drawn from cells with a grid path of at most this share above the cheapest.
NEAR = 0.001
# Share of the deadline in which cells may be judged by their collision probability.
_JUDGING_SHARE = 0.7
# A path on which they are not may come this much later than the deadline, s.
_GRACE_S = 0.5

Stop = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A path on the grid and the space in which it is valid.

    Attributes
    ----------
    graph
        Where it was searched.
    points
        Shape (K, 2), W, m, from start to goal.
    grid_cost
        Cost of the optimal grid path; None when only the straight line from start to goal is valid.
    relaxed
        Bounds that cannot be kept: name of the constraint and the smallest value for which there is a path.
    is_blind_forced
        Whether it goes without a fix although that was forbidden.
    is_complete
        Whether the search was finished, so that no path is cheaper.
    cells
        Cells with a grid path that costs at most ``1 + NEAR`` times as much, if they are known.
    is_unjudged
        Whether the bound on collisions was left aside, because the time did not suffice to judge the cells.
    """

    graph: GridGraph
    points: FloatArray
    grid_cost: float | None
    relaxed: tuple[tuple[str, float], ...] = ()
    is_blind_forced: bool = False
    is_complete: bool = True
    cells: InformedCells | None = None
    is_unjudged: bool = False

    @property
    def bound(self) -> float | None:
        """Smallest possible ``max_r95``, m, where the one asked for cannot be kept; else None."""
        return dict(self.relaxed).get("max_r95_m")


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a search must keep: the names are those of the constraints in a plan's answer."""

    max_r95_m: float | None
    max_ellipse95_m: float | None
    max_collision_probability: float | None

    def given(self) -> list[str]:
        """Names of those that are set."""
        return [f.name for f in fields(self) if getattr(self, f.name) is not None]


def find_way(problem: PlanningProblem, context: PlanningContext, clock: Clock) -> Way | None:
    """Best path on the grid.

    When the bounds cannot be kept, one of them is raised to the smallest value for which there is a path, the
    others kept; if that is not enough, all are raised, one after the other; then cells without a fix are
    entered, as few as possible, and bounds raised as before. ``minimax`` searches the shortest path under the
    smallest possible bound on r95.

    Where there is no time to judge the cells by their collision probability, that bound is left aside.

    Returns
    -------
    way
        None when there is no path at all, or the deadline came first.
    """
    search = _Search(problem, context)
    way = None
    try:
        with clock.stop_flag() as stop, flag_at(clock.at(_JUDGING_SHARE)) as judging:
            search.stop, search.judging = stop, judging
            way = _within_or_forced(search)
            is_late = bool(stop[0])
    except Stopped:
        is_late = True
    if way is not None or not is_late or problem.max_collision_probability is None:
        return way
    # What is left of the time, and a little more, is for the way on which collisions are not judged.
    search = _Search(replace(problem, max_collision_probability=None), context)
    with flag_at(max(clock.at(), time.monotonic() + _GRACE_S)) as stop:
        search.stop = stop
        way = _within_or_forced(search)
    return None if way is None else replace(way, is_unjudged=True)


def _within_or_forced(search: _Search) -> Way | None:
    """Under the bounds as far as they can be kept; then through cells without a fix, as few as possible."""
    for forced in (False, True) if search.blind_rate(search.bounds) is None else (False,):
        if forced:
            search.forced_rate = _BLIND_RATE
        way = search.within()
        if way is None and len(search.bounds.given()) > 1 and search.stop[0] == 0:
            way = search.with_all_raised()
        if way is not None:
            return replace(way, is_blind_forced=forced)
        if search.stop[0] != 0:
            break
    return None


def find_shortest(problem: PlanningProblem, context: PlanningContext, clock: Clock) -> Way | None:
    """Shortest path on the grid, whatever its uncertainty."""
    search = _Search(problem, context)
    search.weight, search.forced_rate, search.margin = 0.0, 1.0, 0.0
    search.extras = problem.extras.without_bounds().without_areas()
    with clock.stop_flag() as stop:
        search.stop = stop
        return search.under(_NO_BOUNDS)


_NO_BOUNDS = Bounds(None, None, None)


class _Search:
    """Searches of one question under changing bounds."""

    def __init__(self, problem: PlanningProblem, context: PlanningContext) -> None:
        self.problem = problem
        self.context = context
        self.stop: Stop = np.zeros(1, dtype=np.uint8)
        self.judging: Stop = np.zeros(1, dtype=np.uint8)
        self.weight = problem.effective_weight
        #: Cost per metre in cells without a fix, whatever is asked.
        self.forced_rate: float | None = None
        self.extras = problem.extras
        self.margin = NEAR if problem.refine > 0 else 0.0
        self.bounds = Bounds(problem.max_r95, problem.max_ellipse95, problem.max_collision_probability)

    def within(self) -> Way | None:
        """Under all bounds, or with one of them raised as little as possible."""
        if self.problem.objective == "minimax":
            return self._minimax()
        way = self.under(self.bounds)
        for name in self.bounds.given():
            if way is not None or self.stop[0] != 0:
                break
            way = self._with_smallest(name, self.bounds)
        return way

    def _minimax(self) -> Way | None:
        """Shortest under the smallest worst r95 that the other bounds leave."""
        others = replace(self.bounds, max_r95_m=None)
        asked = self.problem.max_r95
        found = self._with_smallest("max_r95_m", others)
        if found is None:
            return None
        (_, least), *_ = found.relaxed
        return replace(found, relaxed=() if asked is None or least <= asked else (("max_r95_m", least),))

    def with_all_raised(self) -> Way | None:
        """Every bound that is given raised to the smallest possible, one after the other."""
        relaxed: list[tuple[str, float]] = []
        bounds = _NO_BOUNDS
        way = self.under(bounds)
        for name in self.bounds.given():
            if way is None or self.stop[0] != 0:
                break
            asked = getattr(self.bounds, name)
            kept = self.under(replace(bounds, **{name: asked}))
            if kept is not None:
                bounds, way = replace(bounds, **{name: asked}), kept
                continue
            raised = self._with_smallest(name, bounds)
            if raised is None:
                break
            relaxed += raised.relaxed
            bounds, way = replace(bounds, **dict(raised.relaxed)), raised
        return None if way is None else replace(way, relaxed=tuple(relaxed))

    def under(self, bounds: Bounds) -> Way | None:
        """Optimal path on the grid under bounds."""
        problem, context = self.problem, self.context
        graph = self._graph(bounds)
        found = context.path(graph, problem.start, problem.goal, margin=self.margin, stop=self.stop)
        cost, points = found.cost, found.points
        line = np.array([problem.start, problem.goal])
        straight = graph.cost_space.line_cost(line)
        grid_cost = cost if math.isfinite(cost) else None
        if math.isfinite(straight) and straight <= cost:
            points = line
        if points is None:
            return None
        return Way(graph, points, grid_cost, is_complete=found.is_complete, cells=found.cells)

    def blind_rate(self, bounds: Bounds) -> float | None:
        """Cost per metre in cells without a fix; None where they are closed."""
        if self.forced_rate is not None:
            return self.forced_rate
        limits = bounds.max_r95_m, bounds.max_ellipse95_m
        return blind_rate_of(self.weight, self.problem.blind_r95, *limits)

    def _graph(self, bounds: Bounds) -> GridGraph:
        context, radius = self.context, self.problem.radius
        extras = replace(
            self.extras,
            max_ellipse95=bounds.max_ellipse95_m,
            max_probability=bounds.max_collision_probability,
        )
        if extras.max_probability is not None:
            # The one step that may take long, done in time or not at all; the graph then finds it at hand.
            context.risky(
                extras.max_probability, radius=radius, blind_r95=extras.blind_r95, stop=self.judging
            )
        return context.graph(
            radius=radius,
            weight=self.weight,
            max_r95=bounds.max_r95_m,
            blind_rate=self.blind_rate(bounds),
            extras=extras,
        )

    def _with_smallest(self, name: str, bounds: Bounds) -> Way | None:
        """Under bounds of which the named one is replaced by the smallest for which there is a path."""
        free = self._graph(replace(bounds, **{name: None}))
        start, goal = self.problem.start, self.problem.goal
        if name == "max_collision_probability":
            asked, blind = getattr(self.bounds, name), self.extras.blind_r95
            least = smallest_risk(
                self.context, free, start, goal, above=asked, blind_r95=blind, stop=self.judging
            )
            if least >= 1:
                return None
        else:
            values = self.context.values_of(name)
            if self.forced_rate is None:
                values = known_or(values, self.problem.blind_r95)
            least = smallest_bound(free, values, start, goal)
        if not math.isfinite(least):
            return None
        way = self.under(replace(bounds, **{name: least}))
        return None if way is None else replace(way, relaxed=((name, least),))
