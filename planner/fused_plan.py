"""Plans by the filter's belief: bounds and objective hold for what it says on the route itself."""

from __future__ import annotations

import math
from dataclasses import replace

from localization import covariance as cov
from maps.arrays import FloatArray
from planner.annotate import annotate
from planner.belief_words import unmet_by_filter
from planner.belief_work import SHAPE_SHARE, BeliefWork
from planner.clock import Clock
from planner.context import PlanningContext
from planner.fused_belief import FilterModel, as_packed
from planner.fused_judge import ROUNDING, Judge, Judged, Reached
from planner.fused_route import with_belief
from planner.fused_search import FusedQuestion
from planner.fused_verify import verified_path
from planner.label_search import LabelPath, Stop, without_path
from planner.problem import PlanningProblem
from planner.result import Route, Trajectory, Unmet
from planner.smoothing import COST_SLACK

# A start that breaks a bound may grow by this factor until the first fix, and counts as the start still.
_FIRST_METRES = 1.02


class FusedWork(BeliefWork):
    """A question with ``covariance="fused"``."""

    _judge: Judge
    _lines: Judged

    def __init__(self, problem: PlanningProblem, context: PlanningContext, clock: Clock) -> None:
        super().__init__(problem, context, clock)
        self._known: list[tuple[Trajectory, Judged]] = []
        #: Bounds that the start itself breaks: as asked for, and as searched.
        self._raised: dict[str, tuple[float, float]] = {}

    def search(self, stop: Stop) -> LabelPath:
        """Labels of (cell, covariance), then the filter on the lines."""
        p, context = self.problem, self.context
        self.graph = self.free_graph
        fused = context.fused(stop=stop)
        if fused is None:
            self.found = without_path(is_complete=False)
            return self.found
        given = p.start_matrix
        start = fused.fix_covariance(p.start) if given is None else given
        # What the start itself breaks no path keeps; it must not loosen the other bounds.
        at_start = {"max_r95": cov.r95(_position(start)), "max_ellipse95": cov.ellipse95(_position(start))[0]}
        asked = {name: getattr(p, name) for name in at_start}
        self._raised = {
            name: (asked[name], _FIRST_METRES * float(least))
            for name, least in at_start.items()
            if asked[name] and least > asked[name]
        }
        kept = asked | {name: raised for name, (_, raised) in self._raised.items()}
        question = FusedQuestion(
            p.start,
            p.goal,
            covariance=start,
            objective=p.objective,
            weight=p.effective_weight,
            max_collision_probability=p.max_collision_probability,
            max_blind_distance=p.max_blind_distance,
            **kept,
        )
        model = FilterModel(p.odometry, p.fix_rate, p.max_speed, p.turn_rate)
        self._judge = Judge(self.graph.cost_space, fused, model, question)
        to_go = context.costs_to(self.graph, p.goal, stop=stop)
        found = verified_path(
            self.graph, fused, model, question, to_go=to_go, stop=stop, deadline_at=self.clock.at(SHAPE_SHARE)
        )
        if found.judged is not None:
            self._lines = found.judged
        self.found = found.path
        return found.path

    def route(self) -> tuple[Route, list[str]]:
        """The best lines, smoothed where the filter agrees."""
        lines, stages = self._lines, ["any_angle"]
        if self.plain is not None and not self.clock.is_over(SHAPE_SHARE):
            direct = self._judge(self.plain)
            lines = direct if direct.is_better_than(lines) else lines
        trajectory = self.timed(lines.points)
        self._known.append((trajectory, lines))
        for space in self.spaces(lines.points):
            smooth = self.smoothed(lines.points, space)
            if smooth is None:
                break
            if self._is_as_good(self._judged(smooth), lines):
                trajectory = smooth
                stages.append("casadi")
                break
        return self._told(trajectory), stages

    def of_plain(self, points: FloatArray) -> Route:
        """The shortest way, told by the filter where there was time to make it ready."""
        trajectory = self.timed(points)
        if not self.is_ready:
            return annotate(trajectory, self.context, self.free_graph.cost_space, cost=math.nan)
        self._known.append((trajectory, self._judge(points)))
        return self._told(trajectory)

    @property
    def is_ready(self) -> bool:
        """Whether the filter can be asked."""
        return hasattr(self, "_judge")

    def told(self, route: Route) -> Route:
        """A route made otherwise, told by the filter."""
        return self._told(route.trajectory)

    def prefers(self, other: Route, route: Route) -> bool:
        """Whether another route is better by the filter."""
        return self._judged(other.trajectory).is_better_than(self._judged(route.trajectory))

    def unmet(self, route: Route, *, searched: bool = True) -> tuple[Unmet, ...]:
        """Bounds that the route does not keep by the filter."""
        if not self.is_ready:
            return ()
        judged = self._judged(route.trajectory)
        reached = tuple(self._as_asked(r) for r in judged.reached)
        return unmet_by_filter(replace(judged, reached=reached), self.problem, searched=searched)

    def _as_asked(self, reached: Reached) -> Reached:
        """Against the bound that was asked for, where the start itself breaks it."""
        name = reached.bound.removesuffix("_m")
        if name not in self._raised:
            return reached
        asked, raised = self._raised[name]
        against = replace(reached, asked=asked, ratio=reached.value / asked)
        return against if reached.value > raised else replace(against, place=self.problem.start, at=0.0)

    def _judged(self, trajectory: Trajectory) -> Judged:
        for known, judged in self._known:
            if known is trajectory:
                return judged
        self._known.append((trajectory, self._judge(trajectory.points)))
        return self._known[-1][1]

    def _is_as_good(self, smooth: Judged, lines: Judged) -> bool:
        """Whether a smooth way may stand for lines: bounds kept as well, little dearer, as certain."""
        if smooth.excess > max(1.0, lines.excess) * (1 + ROUNDING):
            return False
        if self.problem.objective == "minimax":
            search = self.found.worst_r95 if self.found.status == "found" else 0.0
            if smooth.worst_r95 > max(lines.worst_r95, search) * (1 + ROUNDING):
                return False
        # Never dearer than the search's own path, unless the lines are.
        return smooth.cost <= max(lines.cost, min((1.0 + COST_SLACK) * lines.cost, self.found.cost))

    def _told(self, trajectory: Trajectory) -> Route:
        judged = self._judged(trajectory)
        route = annotate(trajectory, self.context, self.graph.cost_space, cost=judged.cost)
        return with_belief(route, judged.belief, self.context, self.problem.radius)


def _position(covariance: FloatArray) -> FloatArray:
    """xx, xy, yy of a covariance (3, 3)."""
    return as_packed(covariance)[:3]
