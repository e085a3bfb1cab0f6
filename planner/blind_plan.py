"""Plans by single fixes with a bound on the way without one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.annotate import annotate
from planner.any_angle import shorten
from planner.belief_words import bounds_of_cells_missed, unmet_blind_distance
from planner.belief_work import SHAPE_SHARE, BeliefWork
from planner.cost_space import CostSpace
from planner.dead_reckoning import with_dead_reckoning
from planner.fused_verify import straight_lines
from planner.label_search import LabelPath, Stop, Stretches, blind_path, line_stretches
from planner.result import Route, Unmet

# Where crossing blind cells is bounded but not priced they cost as a place with this r95, m.
_BLIND_R95 = 1.0
_ROUNDING = 1e-6


class BlindWork(BeliefWork):
    """A question with ``max_blind_distance`` whose uncertainty is that of single fixes."""

    def search(self, stop: Stop) -> LabelPath:
        """Labels of (cell, metres since the last fix)."""
        p, context = self.problem, self.context
        self.graph = context.graph(
            radius=p.radius,
            weight=p.effective_weight,
            max_r95=p.max_r95,
            blind_rate=self._blind_rate,
            extras=p.extras,
        )
        to_go = context.costs_to(self.graph, p.goal, stop=stop)
        self.found = blind_path(
            self.graph, self.has_fix, p.start, p.goal, max_blind_distance=self._asked, to_go=to_go, stop=stop
        )
        return self.found

    def route(self) -> tuple[Route, list[str]]:
        """The cheapest lines that keep the bound, smoothed where that keeps it, too."""
        space = self.graph.cost_space
        lines, stages = self._lines()
        trajectory = self.timed(lines)
        for allowed in self.spaces(lines):
            smooth = self.smoothed(lines, allowed)
            if smooth is None:
                break
            if self._is_kept(smooth.points):
                trajectory = smooth
                stages.append("casadi")
                break
        return self.told(annotate(trajectory, self.context, space)), stages

    def _lines(self) -> tuple[FloatArray, list[str]]:
        """The search's path pulled taut, or drawn straight, or as it is: the first that keeps the bound."""
        own = np.asarray(self.found.points)
        space = self.graph.cost_space
        taut, _ = shorten(own, space, deadline_at=self.clock.at(SHAPE_SHARE))
        if self._is_kept(taut):
            return taut, ["any_angle"]
        lines = straight_lines(own, space)
        return (lines, ["straight_lines"]) if self._is_kept(lines) else (own, [])

    def of_plain(self, points: FloatArray) -> Route:
        """The shortest way, as single fixes see it."""
        route = annotate(self.timed(points), self.context, self.free_graph.cost_space)
        return self.told(route)

    @property
    def is_ready(self) -> bool:
        """Single fixes are always at hand."""
        return True

    def told(self, route: Route) -> Route:
        """A route made otherwise, with this question's cost, and dead reckoning where there is no fix."""
        cost = self._cost_space.line_cost(route.trajectory.points)
        route = replace(route, summary=replace(route.summary, cost=cost))
        return with_dead_reckoning(route, self.context, self.problem.odometry, self.problem.start_matrix)

    def prefers(self, other: Route, route: Route) -> bool:
        """Whether another route keeps the bounds as well and costs less."""
        space = self.graph.cost_space
        cost = space.line_cost(other.trajectory.points)
        return cost < space.line_cost(route.trajectory.points) and self._is_kept(other.trajectory.points)

    def unmet(self, route: Route, *, searched: bool = True) -> tuple[Unmet, ...]:
        """Bounds that the route does not keep: where even the best path drives further without a fix."""
        out = bounds_of_cells_missed(route, self.problem)
        lines = self._stretches(route.trajectory.points)
        if lines.longest <= self._asked * (1 + _ROUNDING) + _ROUNDING:
            return out
        possible = self.found.longest_blind if searched else None
        return (*out, unmet_blind_distance(route, lines, self._asked, possible))

    @property
    def _cost_space(self) -> CostSpace:
        """Where lines cost what was asked for, bounds left aside."""
        p = self.problem
        return self.context.graph(
            radius=p.radius,
            weight=p.effective_weight,
            blind_rate=self._blind_rate,
            extras=p.extras.without_bounds(),
        ).cost_space

    @property
    def _blind_rate(self) -> float:
        blind = self.problem.blind_r95
        return 1.0 + self.problem.effective_weight * (_BLIND_R95 if blind is None else blind)

    @property
    def _asked(self) -> float:
        asked = self.problem.max_blind_distance
        return math.inf if asked is None else asked

    def _is_kept(self, points: npt.ArrayLike) -> bool:
        """Whether lines keep the bound, or where none does, are as good as the search's path."""
        limit = max(self._asked if math.isfinite(self._asked) else 0.0, self.found.longest_blind)
        return self._stretches(points).longest <= limit * (1 + _ROUNDING) + _ROUNDING

    def _stretches(self, points: npt.ArrayLike) -> Stretches:
        return line_stretches(self.context.field.frame, self.has_fix, points)
