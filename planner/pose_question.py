"""Plans for robots with a heading: kinematics, outlines, poses at the ends, fields over headings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from planner.annotate import annotate
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_to_go import known_or, smallest_bound
from planner.facing import faced
from planner.footprint import Footprint
from planner.grid_search import Bounds
from planner.lattice import End, Outcome
from planner.pose_plan import PosePath, plan_poses
from planner.pose_rates import BLIND_RATE, N_HEADINGS, Limits, PoseRates
from planner.pose_reason import why_no_way
from planner.pose_route import route_of_poses, with_headings
from planner.pose_timing import MotionLimits, PoseTrajectory, drive
from planner.pose_unmet import measured, unmet_at_poses
from planner.problem import PlanningProblem, blind_rate_of
from planner.result import PlanResult, PlanStatus, Route
from planner.steering import PoseSpace, Steering
from planner.unmet import round_up

# Price of a turn that costs nothing, m/rad.
_LEAST_TURN = 1e-6
# Shares of the deadline at which searches end: the first, those for smaller bounds, those that look twice.
_SEARCH_SHARE, _BOUND_SHARE = 0.85, 0.5
# A smallest bound is known when it lies within this share.
_CLOSE = 0.02
# Exact figures that are worse than a search's by this share are looked at twice.
_DEARER = 1.02

Baseline = Callable[[], Route | None]


def plan_with_poses(
    problem: PlanningProblem, context: PlanningContext, clock: Clock, *, baseline: Baseline
) -> PlanResult:
    """Answer a question in which the robot's heading matters.

    Parameters
    ----------
    problem, context
        The question and the field; its cells are the planning grid. On a field over headings what a motion
        costs and keeps is that of the heading in which the robot drives.
    clock
        Of the plan.
    baseline
        Makes the shortest route of a holonomic disc, to compare with.

    Returns
    -------
    result
        ``EXACT``: the cheapest on the lattice of poses, then improved. Where bounds leave no way they are
        raised by the smallest factor that does, and the route is ``RISK_UNMET``. ``minimax`` searches the
        shortest way under the smallest bound on r95. ``NO_PATH`` says in words what is too narrow.
    """
    work = _Work(problem, context, clock)
    with clock.stage("lattice"):
        found = work.answer()
    if found.route is None:
        return work.nothing(found)
    clock.seconds["to_final_path"] = clock.elapsed
    with clock.stage("shortest"):
        shortest = baseline()
    unmet = unmet_at_poses(problem, found.route, is_relaxed=found.is_relaxed, least=found.least)
    status = PlanStatus.EXACT if found.path.is_exact and not found.is_open else PlanStatus.APPROXIMATE
    return PlanResult(
        status=PlanStatus.RISK_UNMET if unmet else status,
        route=found.route,
        shortest=shortest,
        grid_cost=found.path.lattice_cost,
        planner=found.path.planner,
        unmet=unmet,
        warnings=tuple(work.said(found)),
        stats=clock.stats,
    )


def plan_facing(problem: PlanningProblem, context: PlanningContext, base: PlanResult) -> PlanResult | None:
    """The plan of a robot that turns in place and faces its way, from that of one that needs no heading.

    Returns
    -------
    result
        None where its motion cannot be driven so; then the lattice of poses must be searched.
    """
    if base.route is None:
        return base
    weight = problem.effective_weight
    space = context.graph(radius=problem.radius, weight=weight, blind_rate=1.0 + weight).cost_space
    motion = faced(
        base.route.trajectory,
        space,
        _limits(problem),
        start_heading=problem.start_heading,
        goal_heading=problem.goal_heading,
    )
    if motion is None:
        return None
    route = annotate(motion.to_trajectory(), context, space, cost=base.route.summary.cost)
    return replace(base, route=with_headings(route, motion), planner=f"{base.planner}+facing")


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What a search under limits gave: its path, and the route of it, None without one."""

    path: PosePath
    limits: Limits
    space: PoseSpace | None = None
    route: Route | None = None
    motion: PoseTrajectory | None = None
    is_relaxed: bool = False
    #: Factor of the bounds below which it is known that there is no way; 1: as asked.
    least: float = 1.0
    #: Whether the time ended before the smallest bound was known.
    is_open: bool = False

    @property
    def is_no_way(self) -> bool:
        return self.path.outcome is Outcome.NO_WAY


class _Work:
    """One question: its searches, and the way from a curve to a route."""

    def __init__(self, problem: PlanningProblem, context: PlanningContext, clock: Clock) -> None:
        self.problem, self.context, self.clock = problem, context, clock
        self.headings = context.headings
        self.footprint = None if problem.footprint is None else Footprint.of(problem.footprint)
        radius = problem.radius if self.footprint is None else self.footprint.inscribed_radius
        self.rates = PoseRates(problem, context, self.headings, self.footprint, radius)
        turns = 0.0 if problem.kinematics == "holonomic" else problem.max_speed / problem.turn_rate
        if self.footprint is not None:
            turns = max(turns, _LEAST_TURN)  # turns with a price are checked at the headings between
        stop = problem.max_speed**2 / problem.max_accel
        self.steering = Steering(problem.kinematics, problem.min_turn_radius, turns, stop)
        self.asked = Bounds(problem.max_r95, problem.max_ellipse95, problem.max_collision_probability)

    def answer(self) -> _Found:
        """The route, under the bounds or as near to them as can be."""
        found = self._minimax() if self.problem.objective == "minimax" else self._search(Limits(self.asked))
        if not found.is_no_way or not (self.asked.given() or self.problem.blind_r95 is None):
            return found
        if self.clock.is_over(_SEARCH_SHARE):
            return replace(found, path=_STOPPED)
        return self._relaxed(found)

    def said(self, found: _Found) -> list[str]:
        """What there is to say about a route."""
        assert found.route is not None
        out, least = [], found.route.summary.min_clearance
        if self.footprint is not None and least < 0:
            assert found.motion is not None
            clearance = self.footprint.clearance(self.context.clearance, found.motion.poses)
            place = found.motion.poses[int(clearance.argmin())]
            out.append(
                f"The outline's covering discs come {round_up(-least)} m too close to an obstacle at "
                f"({place[0]:.2f}, {place[1]:.2f}) m; a field on smaller cells finds a way with room."
            )
        if found.is_open:
            out.append(
                f"The deadline of {self.problem.deadline:g} s came before the smallest possible bound was "
                "known; allow more time."
            )
        return out

    def nothing(self, found: _Found) -> PlanResult:
        """The answer where there is no route."""
        p, late = self.problem, not found.is_no_way
        if late or found.space is None:
            said = f"The deadline of {p.deadline:g} s came before any way was found; allow more time."
        else:
            ends = End(*p.start, p.start_heading), End(*p.goal, p.goal_heading)
            with self.clock.stop_flag() as stop:
                said = why_no_way(found.space, *ends, stop=stop)
        status = PlanStatus.TIMEOUT if late else PlanStatus.NO_PATH
        return PlanResult(status, None, None, None, "lattice", warnings=(said,), stats=self.clock.stats)

    def _search(self, limits: Limits) -> _Found:
        """The way under limits; on a field over headings a second, more careful one where it pays."""
        found = self._attempt(limits, is_careful=False)
        if self.headings is None or found.route is None or self.clock.is_over(_BOUND_SHARE):
            return found
        summary = found.route.summary
        closed = limits.blind_rate(self.problem) is None
        breaks = (closed and summary.blind > 0) or measured(found.route, limits.bounds) > 1.0
        if not breaks and summary.cost <= _DEARER * found.path.cost:
            return found
        other = self._attempt(limits, is_careful=True)
        if other.route is None:
            return found

        def badness(one: _Found) -> tuple[float, float, float]:
            assert one.route is not None
            blind = one.route.summary.blind if closed else 0.0
            return blind, max(measured(one.route, limits.bounds), 1.0), one.route.summary.cost

        return min((found, other), key=badness)

    def _attempt(self, limits: Limits, *, is_careful: bool) -> _Found:
        """One search on the lattice, with an outline first with room for half a cell."""
        p = self.problem
        margins: tuple[float, ...] = (0.0,)
        if self.footprint is not None:
            margins = (0.5 * math.sqrt(2.0) * self.context.field.frame.resolution, 0.0)
        path = _STOPPED
        for margin in margins:
            with self.clock.stop_flag() as stop:
                made = self.rates.under(limits, margin=margin, is_careful=is_careful, stop=stop)
            if made is None:
                return _Found(_STOPPED, limits)
            space, stack = made
            path = plan_poses(
                space,
                (*p.start, p.start_heading),
                (*p.goal, p.goal_heading),
                steering=self.steering,
                heading_rates=stack if len(stack) > 1 else None,
                n_headings=N_HEADINGS,
                deadline_at=self.clock.at(_SEARCH_SHARE),
                seed=p.seed,
                refine=p.refine,
                is_explained=False,
            )
            of_poses = PoseSpace(space, stack, self.steering)
            if path.curve is not None:
                return self._routed(path, of_poses, limits)
            if self.clock.is_over(_SEARCH_SHARE):
                break
        return _Found(path, limits, of_poses)

    def _routed(self, path: PosePath, space: PoseSpace, limits: Limits) -> _Found:
        assert path.curve is not None
        motion, _ = drive(path.curve, space, _limits(self.problem))
        route = route_of_poses(
            motion,
            path,
            space,
            problem=self.problem,
            context=self.context,
            footprint=self.footprint,
            blind_rate=limits.blind_rate(self.problem) or BLIND_RATE,
        )
        return _Found(path, limits, space, route, motion)

    def _minimax(self) -> _Found:
        """Shortest under the smallest worst r95 that the other bounds leave."""
        p, others = self.problem, replace(self.asked, max_r95_m=None)
        found = self._search(Limits(others))
        if found.route is None:
            return found

        def under(bound: float) -> _Found:
            return self._search(Limits(replace(others, max_r95_m=bound)))

        def value(one: _Found) -> float:
            assert one.route is not None
            worst = one.route.summary.max_r95 or 0.0
            return max(worst, p.blind_r95 or 0.0) if one.route.summary.blind > 0 else worst

        low = self._least_of_cells(others)
        if not low < value(found):
            return found
        best = under(low)
        if best.route is None:
            best = self._narrowed(under, value, low, found)
        missed = p.max_r95 is not None and value(best) > p.max_r95
        return replace(best, is_relaxed=missed)

    def _least_of_cells(self, others: Bounds) -> float:
        """A worst r95 below which no way of any robot leads, m."""
        p, context = self.problem, self.context
        graph = context.graph(
            radius=self.rates.radius,
            weight=0.0,
            blind_rate=blind_rate_of(0.0, p.blind_r95, others.max_ellipse95_m),
            extras=p.extras.without_bounds(),
        )
        return smallest_bound(graph, known_or(context.r95, p.blind_r95), p.start, p.goal)

    def _narrowed(
        self,
        search: Callable[[float], _Found],
        value: Callable[[_Found], float],
        low: float,
        found: _Found,
    ) -> _Found:
        """The route of the smallest parameter of a search; ``found`` is one of a larger one."""
        high, best = value(found), found
        while high > low * (1 + _CLOSE):
            if self.clock.is_over(_BOUND_SHARE):
                return replace(best, is_open=True, least=low)
            middle = math.sqrt(low * high)
            other = search(middle)
            if other.route is not None:
                best, high = other, min(middle, value(other))
            elif other.is_no_way:
                low = middle
            else:
                return replace(best, is_open=True, least=low)
        return replace(best, least=low)

    def _relaxed(self, nothing: _Found) -> _Found:
        """With bounds raised by the smallest common factor; without a fix only where that is no help."""
        last = nothing
        for forced in (False, True) if self.problem.blind_r95 is None else (False,):
            if forced:
                last = self._search(Limits(self.asked, is_blind_forced=True))
            if last.route is None and last.is_no_way and self.asked.given():
                last = self._raised(is_blind_forced=forced)
            if last.route is not None or not last.is_no_way:
                break
        return replace(last, is_relaxed=last.route is not None)

    def _raised(self, *, is_blind_forced: bool) -> _Found:
        """With bounds raised as little as can be; without a way where none is left without bounds."""
        loose = self._search(Limits(Bounds(None, None, None), is_blind_forced=is_blind_forced))
        if loose.route is None:
            return loose

        def under(factor: float) -> _Found:
            return self._search(Limits(_scaled(self.asked, factor), is_blind_forced=is_blind_forced))

        def value(one: _Found) -> float:
            assert one.route is not None
            return max(measured(one.route, self.asked), 1.0)

        return self._narrowed(under, value, 1.0, loose)


def _scaled(bounds: Bounds, factor: float) -> Bounds:
    def times(value: float | None, most: float = math.inf) -> float | None:
        return None if value is None else min(factor * value, most)

    return Bounds(
        times(bounds.max_r95_m),
        times(bounds.max_ellipse95_m),
        times(bounds.max_collision_probability, 1.0 - 1e-9),
    )


def _limits(problem: PlanningProblem) -> MotionLimits:
    return MotionLimits(problem.max_speed, problem.max_accel, problem.turn_rate, problem.max_turn_accel)


_STOPPED = PosePath(Outcome.STOPPED, None, None, math.inf, math.inf, False, "lattice")
