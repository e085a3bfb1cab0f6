"""The front of length against uncertainty: no route is both longer and less certain than another."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

from planner.clock import Clock
from planner.context import PlanningContext
from planner.ends import check_ends
from planner.errors import InvalidProblem
from planner.example_context import example_context
from planner.grid_search import Way
from planner.kernels.matrix import way_figures
from planner.narrow import first_way
from planner.no_way import nothing_found
from planner.pareto_grid import GridFront, GridPoint, not_dominated, spread
from planner.plan import finished
from planner.problem import PlanningProblem
from planner.result import Blockage, PlanStatus, Route, Unmet
from planner.unmet import keeps_risk, unmet_bounds

Against = Literal["worst", "mean"]
MAX_POINTS = 50
# The grid is asked for more points than are finished: some are dominated afterwards.
_SPARE = 2
# Routes that differ by no more than these shares are one point of a front.
_SAME_LENGTH = 2e-3
_SAME_R95 = 1e-2
# Part of the deadline for the grid.
_GRID_SHARE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ParetoPoint:
    """One route of a front.

    Attributes
    ----------
    route
        Its figures are in its summary.
    length
        Of the route, m.
    r95
        Worst or mean r95 of the route, m; stretches without a fix count as ``blind_r95``.
    setting
        Bound on r95, m, (``worst``) or weight, 1/m, (``mean``) under which its grid path is optimal: for a
        plan of its own. None: without a bound.
    grid_length, grid_r95
        The same figures of the grid path.
    """

    route: Route
    length: float
    r95: float
    setting: float | None
    grid_length: float
    grid_r95: float


@dataclass(frozen=True, slots=True, eq=False)
class ParetoFront:
    """Routes from the shortest to the surest.

    Attributes
    ----------
    against
        ``worst`` or ``mean``.
    points
        Ascending in length, descending in r95; empty when there is no path.
    status
        ``EXACT``: each is optimal on the grid under its setting, then improved. ``APPROXIMATE``: the deadline
        came before the front was complete. ``RISK_UNMET``: no path keeps the bounds of the question, the one
        point is the best effort. ``NO_PATH``, ``TIMEOUT``: no points.
    warnings
        What the caller should know.
    unmet
        With ``RISK_UNMET``: what the best effort misses.
    stats
        Points on the grid and seconds.
    blocked
        With ``NO_PATH``: what blocks the way, if it is known.
    """

    against: Against
    points: tuple[ParetoPoint, ...]
    status: PlanStatus
    warnings: tuple[str, ...] = ()
    unmet: tuple[Unmet, ...] = ()
    stats: dict[str, float] = field(default_factory=dict)
    blocked: Blockage | None = None


def pareto_front(
    problem: PlanningProblem,
    context: PlanningContext,
    *,
    against: Against = "worst",
    count: int = 8,
    report: Callable[[ParetoFront], None] | None = None,
) -> ParetoFront:
    """Front of length against worst or mean r95.

    The grid is searched first, exactly: against ``worst`` the shortest path under bounds between the
    smallest that is possible and the worst r95 of the shortest path, always in the widest gap that is left;
    against ``mean`` the cheapest path under the weights at which the costs of neighbours on the front are
    equal (so only points of the convex hull of length and ``∫ r95 ds`` are found). Then up to ``count``
    paths, as far apart as possible, are shortened and smoothed, and what is dominated, or differs by less
    than 0.2 % in length and 1 % in r95 from another, is left out.

    Parameters
    ----------
    problem
        Robot, ends, bounds, deadline; objective, weight, factors of areas and via points are left aside.
    context
        The field.
    against
        What length is held against.
    count
        Points at most.
    report
        Called in this thread with the front so far, after every point that is finished.

    Returns
    -------
    front
        At the deadline the points that are ready.

    Raises
    ------
    InvalidProblem
        If ``against`` is unknown, the count makes no sense, there are via points, a belief or a bound on
        the metres without a fix is asked for, or headings matter.
    StartOutsideMap, GoalOutsideMap, StartOccupied, GoalOccupied
        If the robot cannot stand at an end.
    """
    if against not in {"worst", "mean"}:
        raise InvalidProblem(f"The front is asked against '{against}'; use 'worst' or 'mean'.")
    if problem.covariance != "fix" or problem.max_blind_distance is not None:
        raise InvalidProblem(
            "Fronts count on single fixes and have no max_blind_distance; leave both out, or plan."
        )
    if problem.has_pose or context.headings is not None:
        raise InvalidProblem(
            "Fronts are those of a disc that drives in every direction, on a field of one heading; leave out "
            "kinematics, headings and footprint, or plan."
        )
    if not 2 <= count <= MAX_POINTS:
        raise InvalidProblem(f"{count} points are asked for; it must be from 2 to {MAX_POINTS}.")
    if problem.via:
        raise InvalidProblem("A front has no via points; ask for one from each to the next.")
    clock = Clock(problem.deadline)
    check_ends(problem, context)
    # Sampling gains a percent and would take the time of all the other points.
    plain = replace(problem, objective="shortest", areas=(), refine=0)
    way, context, proven = first_way(plain, context, clock)
    if way is None:
        none = nothing_found(plain, context, clock, proven=proven)
        return ParetoFront(against, (), none.status, none.warnings, stats=none.stats, blocked=none.blocked)
    if way.relaxed or way.is_blind_forced:
        return _best_effort(way, plain, context, clock, against)
    with clock.stage("front"), Clock(problem.deadline * _GRID_SHARE).stop_flag() as stop:
        front = GridFront(plain, context, stop)
        wanted = _SPARE * count
        front.against_worst(wanted) if against == "worst" else front.against_mean(wanted)
        stopped = bool(stop[0])
    work = _Finishing(plain, context, clock, front, way, against)
    work.run(count, report)
    if stopped and len(front.points) < wanted:
        work.warnings.append("The deadline came before all gaps of the front were searched.")
    status = PlanStatus.APPROXIMATE if stopped or work.is_late else PlanStatus.EXACT
    if not work.done:
        status = PlanStatus.TIMEOUT
    stats = {f"{k}_s": v for k, v in clock.seconds.items()}
    stats |= {"grid_points": float(len(front.points)), "total_s": clock.elapsed}
    return ParetoFront(against, work.front(), status, tuple(dict.fromkeys(work.warnings)), stats=stats)


class _Finishing:
    """Routes from the points of the grid."""

    def __init__(
        self,
        problem: PlanningProblem,
        context: PlanningContext,
        clock: Clock,
        grid: GridFront,
        way: Way,
        against: Against,
    ) -> None:
        self.problem, self.context, self.clock = problem, context, clock
        self.grid, self.way, self.against = grid, way, against
        self.done: list[ParetoPoint] = []
        self.warnings: list[str] = []
        self.is_late = False

    def run(self, count: int, report: Callable[[ParetoFront], None] | None) -> None:
        """Finish up to ``count`` points, others instead of those that turn out to be dominated."""
        points = self.grid.points
        values = [self._grid_r95(p) for p in points]
        # On the grid none is dominated against worst; against mean some may be.
        kept = not_dominated([(p.length, v) for p, v in zip(points, values, strict=True)])
        points, values = [points[k] for k in kept], [values[k] for k in kept]
        if not points:
            return
        order = spread(points, values, len(points))
        for n, k in enumerate(order):
            left = max(1, min(count, len(order)) - n)
            if self.done and self.clock.is_over():
                self.is_late = True
                said = f"The deadline of {self.problem.deadline:g} s came after {n} points were finished."
                self.warnings.append(said)
                return
            if len(self.front()) >= count:
                return
            self.done.append(self._finished(points[k], values[k], left))
            if report is not None:
                report(ParetoFront(self.against, self.front(), PlanStatus.APPROXIMATE, tuple(self.warnings)))

    def front(self) -> tuple[ParetoPoint, ...]:
        """Those done that are not dominated, and of those that are all but the same one."""
        kept = [self.done[k] for k in not_dominated([(p.length, p.r95) for p in self.done])]
        out: list[ParetoPoint] = []
        for point in kept:
            if not out or not _all_but_same(out[-1], point):
                out.append(point)
            elif point is kept[-1] and len(out) > 1:
                out[-1] = point
        return tuple(out)

    def _finished(self, point: GridPoint, value: float, left: int) -> ParetoPoint:
        setting = point.setting
        problem = self.problem
        if self.against == "mean":
            problem = replace(problem, objective="weighted", weight=min(setting, 1e6))
        now = self.clock.elapsed / self.clock.deadline
        end = now + max(0.0, 1.0 - now) / left
        name = f"point of {point.length:.2f} m"
        way = replace(self.way, graph=self.grid.graph(point), points=point.points, grid_cost=point.grid_cost)
        route, said = finished(
            way,
            problem,
            self.context,
            self.clock,
            name=name,
            shares=(0.5 * (now + end), end),
        )
        self.warnings += said
        asked = problem.max_collision_probability
        if asked is not None and not keeps_risk(route, asked):
            self.warnings.append(
                f"The {name} passes closer than the collision probability of {asked:g} allows."
            )
        bound = None if setting == math.inf else setting
        return ParetoPoint(route, route.summary.length, self._r95(route), bound, point.length, value)

    def _grid_r95(self, point: GridPoint) -> float:
        if self.against == "worst":
            return point.worst
        return point.integral / point.length if point.length > 0 else point.worst

    def _r95(self, route: Route) -> float:
        figures, blind = route.summary, self.problem.blind_r95 or 0.0
        if self.against == "worst":
            return max(figures.max_r95 or 0.0, blind if figures.blind > 0 else 0.0)
        if figures.length == 0.0 or figures.mean_r95 is None:
            return figures.mean_r95 if figures.mean_r95 is not None else blind
        seen = figures.length - figures.blind
        return (figures.mean_r95 * seen + blind * figures.blind) / figures.length


def _all_but_same(a: ParetoPoint, b: ParetoPoint) -> bool:
    """Whether nobody would choose between two points."""
    lengths = abs(a.length - b.length) <= _SAME_LENGTH * b.length
    return lengths and abs(a.r95 - b.r95) <= _SAME_R95 * max(a.r95, b.r95)


def _best_effort(
    way: Way, problem: PlanningProblem, context: PlanningContext, clock: Clock, against: Against
) -> ParetoFront:
    route, said = finished(way, problem, context, clock, name="route")
    figures = route.summary
    value = figures.max_r95 if against == "worst" else figures.mean_r95
    cell = context.field.frame.resolution
    length, integral, blind, worst = way_figures(context.field.frame.to_grid(way.points), context.r95)
    on_grid = worst if against == "worst" or length == blind else integral / (length - blind)
    r95 = value if value is not None else math.nan
    point = ParetoPoint(route, figures.length, r95, None, length * cell, on_grid)
    words = "No path keeps the bounds; the one route is the best effort."
    return ParetoFront(
        against,
        (point,),
        PlanStatus.RISK_UNMET,
        (words, *said),
        unmet_bounds(problem, way, route, context),
        {"total_s": clock.elapsed},
    )


def warm_up() -> None:
    """Compile or load what a front needs, by small ones in a made-up room."""
    problem = PlanningProblem((1.0, 1.0), (5.0, 5.0), 0.2, deadline=30.0)
    for against in ("worst", "mean"):
        pareto_front(problem, example_context(), against=against, count=2)
