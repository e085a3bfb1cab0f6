"""Plans over (place, uncertainty): by the filter's belief, or with a bound on the way without a fix."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from localization import covariance as cov
from localization.propagation import PathBelief
from maps.arrays import FloatArray
from planner.annotate import annotate
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_to_go import GridGraph
from planner.fused_belief import FilterModel, FusedField
from planner.fused_route import with_belief
from planner.fused_search import FusedQuestion
from planner.fused_verify import VerifiedPath, straight_lines, verified_path
from planner.label_search import LabelPath, Stop, blind_path, line_stretches
from planner.motion import move_along
from planner.problem import PlanningProblem
from planner.result import PlanResult, PlanStatus, Route, Trajectory, Unmet
from planner.risk import collision_risk
from planner.timing import time_polyline
from planner.unmet import round_up

# Where crossing blind cells is bounded but not priced they cost as a place with this r95, m.
_BLIND_R95 = 1.0
_ROUNDING = 1e-6

Baseline = Callable[[], Route | None]


def plan_by_belief(
    problem: PlanningProblem, context: PlanningContext, clock: Clock, *, baseline: Baseline
) -> PlanResult:
    """Answer a question with ``covariance="fused"`` or a bound on the distance without a fix.

    Parameters
    ----------
    problem, context
        The question and the field.
    clock
        Of the plan.
    baseline
        Makes the shortest route for the same robot.

    Returns
    -------
    result
        ``EXACT`` when the label search ended by itself and its bounds hold on the path that is driven;
        ``RISK_UNMET`` with the smallest bounds possible otherwise.

    Raises
    ------
    InvalidProblem
        If the belief at the start is neither given nor that of a fix there.
    """
    kind = _FusedWork if problem.covariance == "fused" else _BlindWork
    work = kind(problem, context, clock)
    with clock.stage("labels"), clock.stop_flag() as stop:
        found = work.search(stop)
    if not found.has_path:
        return _nothing(problem, found, clock)
    with clock.stage("smoothing"):
        route, stages = work.route()
    clock.seconds["to_final_path"] = clock.elapsed
    with clock.stage("shortest"):
        shortest = baseline()
        if shortest is not None:
            shortest = work.told(shortest)
    unmet = work.unmet(route)
    status = PlanStatus.EXACT if found.is_complete else PlanStatus.APPROXIMATE
    warnings = []
    if not found.is_complete:
        warnings.append(f"The deadline of {problem.deadline:g} s came before the search over beliefs ended.")
    return PlanResult(
        status=PlanStatus.RISK_UNMET if unmet else status,
        route=route,
        shortest=shortest,
        grid_cost=None,
        planner="+".join(["label_search", *stages]),
        unmet=unmet,
        warnings=tuple(warnings),
        stats={f"{k}_s": v for k, v in clock.seconds.items()} | {"total_s": clock.elapsed},
    )


@dataclass(slots=True)
class _Work:
    """What both kinds share: from a path of the search to a route that keeps its bounds."""

    problem: PlanningProblem
    context: PlanningContext
    clock: Clock

    def smoothed(self, points: FloatArray, graph: GridGraph) -> Trajectory | None:
        """The path as a smooth trajectory, if smoothing succeeds."""
        space = graph.cost_space
        motion = move_along(
            points,
            space,
            max_speed=self.problem.max_speed,
            max_accel=self.problem.max_accel,
            cost_limit=1.03 * space.line_cost(points),
            deadline_at=self.clock.at(0.85),
            other_way=lambda: None,
        )
        return motion.trajectory if motion.is_smooth else None

    def timed(self, points: FloatArray) -> Trajectory:
        """The path driven with stops at its corners."""
        return time_polyline(points, max_speed=self.problem.max_speed, max_accel=self.problem.max_accel)


class _FusedWork(_Work):
    """By the filter's belief."""

    graph: GridGraph
    fused: FusedField
    found: VerifiedPath
    belief: PathBelief

    def search(self, stop: Stop) -> LabelPath:
        p, context = self.problem, self.context
        self.graph = context.graph(
            radius=p.radius, weight=0.0, blind_rate=1.0, extras=p.extras.without_bounds()
        )
        self.fused = context.fused()
        self.model = FilterModel(p.odometry, p.fix_rate, p.max_speed, p.turn_rate)
        self.question = FusedQuestion(
            p.start,
            p.goal,
            covariance=p.start_matrix,
            objective=p.objective,
            weight=p.effective_weight,
            max_r95=p.max_r95,
            max_ellipse95=p.max_ellipse95,
            max_collision_probability=p.max_collision_probability,
            max_blind_distance=p.max_blind_distance,
        )
        given = p.start_matrix
        self.start: FloatArray = self.fused.fix_covariance(p.start) if given is None else given
        to_go = context.costs_to(self.graph, p.goal, stop=stop)
        self.found = verified_path(self.graph, self.fused, self.model, self.question, to_go=to_go, stop=stop)
        return self.found.path

    def route(self) -> tuple[Route, list[str]]:
        points = self.found.points
        trajectory, stages = self.timed(points), ["straight_lines"]
        belief = self.found.belief
        smooth = self.smoothed(points, self.graph)
        if smooth is not None:
            other = self.fused.along(smooth.points, self.start, self.model)
            if self._excess(other) <= max(1.0, self.found.excess) * (1 + _ROUNDING):
                trajectory, belief = smooth, other
                stages.append("casadi")
        self.belief = belief if belief is not None else self.fused.along(points, self.start, self.model)
        return self._told(trajectory, self.belief), stages

    def told(self, route: Route) -> Route:
        """A route made otherwise, told by the filter."""
        belief = self.fused.along(route.trajectory.points, self.start, self.model)
        return with_belief(route, belief, self.context, self.problem.radius)

    def _told(self, trajectory: Trajectory, belief: PathBelief) -> Route:
        r95 = belief.r95
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(belief.drive.poses[:, :2], axis=0).T))])
        weight = self.problem.effective_weight
        cost = float(along[-1] + weight * (0.5 * (r95[1:] + r95[:-1]) @ np.diff(along)))
        route = annotate(trajectory, self.context, self.graph.cost_space, cost=cost)
        return with_belief(route, belief, self.context, self.problem.radius)

    def _excess(self, belief: PathBelief) -> float:
        """Largest ratio of what the filter says to a bound, as of ``VerifiedPath``."""
        return max((value for _, value, _, _ in self._ratios(belief)), default=0.0)

    def _ratios(self, belief: PathBelief) -> list[tuple[str, float, float, float]]:
        """Constraint, ratio, asked, reached."""
        p, out = self.problem, []
        if p.max_r95 is not None:
            worst = float(belief.r95.max())
            out.append(("max_r95_m", worst / p.max_r95, p.max_r95, worst))
        if p.max_ellipse95 is not None:
            worst = float(cov.ellipse95(belief.position_covariance)[:, 0].max())
            out.append(("max_ellipse95_m", worst / p.max_ellipse95, p.max_ellipse95, worst))
        if p.max_collision_probability is not None:
            risk = collision_risk(
                self.context.clearance, belief.drive.poses[:, :2], belief.position_covariance, p.radius
            )
            worst = float(risk.tight.max())
            ratio = 0.0 if worst <= 0 else math.inf
            if 0 < worst < 1:
                ratio = math.sqrt(math.log(p.max_collision_probability) / math.log(worst))
            out.append(("max_collision_probability", ratio, p.max_collision_probability, worst))
        if p.max_blind_distance is not None:
            longest = self.found.longest_blind
            ratio = 0.0 if longest <= 0 else math.inf
            if p.max_blind_distance > 0:
                ratio = longest / p.max_blind_distance
            out.append(("max_blind_distance_m", ratio, p.max_blind_distance, longest))
        return out

    def unmet(self, route: Route) -> tuple[Unmet, ...]:
        """Bounds that the route does not keep by the filter."""
        out = []
        place = _place_at(route, route.summary.worst_at or 0.0)
        for name, ratio, asked, reached in self._ratios(self.belief):
            if ratio <= 1 + _ROUNDING:
                continue
            message = (
                f"By the filter's belief no path keeps {name} at or below {asked:g}; the route returned "
                f"reaches {round_up(reached)} and is least certain at ({place[0]:.2f}, {place[1]:.2f}) m. "
                f"Bounds on lengths would have to be {round_up(max(1.0, ratio))} times as large."
            )
            out.append(Unmet(name, asked, reached, place, reached, message))
        return tuple(out)


class _BlindWork(_Work):
    """By single fixes, with a bound on the way without one."""

    def search(self, stop: Stop) -> LabelPath:
        p, context = self.problem, self.context
        blind = _BLIND_R95 if p.blind_r95 is None else p.blind_r95
        self.graph = context.graph(
            radius=p.radius,
            weight=p.effective_weight,
            max_r95=p.max_r95,
            blind_rate=1.0 + p.effective_weight * blind,
            extras=p.extras,
        )
        self.has_fix = context.field.has_fix
        limit = p.max_blind_distance if p.max_blind_distance is not None else math.inf
        to_go = context.costs_to(self.graph, p.goal, stop=stop)
        self.found = blind_path(
            self.graph, self.has_fix, p.start, p.goal, max_blind_distance=limit, to_go=to_go, stop=stop
        )
        return self.found

    def route(self) -> tuple[Route, list[str]]:
        space = self.graph.cost_space
        limit = max(self.problem.max_blind_distance or 0.0, self.found.longest_blind)
        points = straight_lines(self.found.points, space)
        stages = ["straight_lines"]
        if self._longest(points) > limit * (1 + _ROUNDING):
            points, stages = np.asarray(self.found.points), []
        trajectory = self.timed(points)
        smooth = self.smoothed(points, self.graph)
        if smooth is not None and self._longest(np.asarray(smooth.points)) <= limit * (1 + _ROUNDING):
            trajectory = smooth
            stages.append("casadi")
        return annotate(trajectory, self.context, space), stages

    def told(self, route: Route) -> Route:
        """Single fixes need no telling."""
        return route

    def _longest(self, points: FloatArray) -> float:
        return line_stretches(self.graph.cost_space.frame, self.has_fix, points).longest

    def unmet(self, route: Route) -> tuple[Unmet, ...]:
        """The bound, where even the best path drives further without a fix."""
        asked = self.problem.max_blind_distance
        longest = self._longest(np.asarray(route.trajectory.points))
        if asked is None or longest <= asked * (1 + _ROUNDING) + _ROUNDING:
            return ()
        blind = np.flatnonzero(~np.isfinite(route.path.r95))
        x, y = route.path.points[int(blind[0]) if len(blind) else 0]
        message = (
            f"No path keeps stretches without a fix at or below {asked:g} m; the smallest bound that has a "
            f"path is {round_up(self.found.longest_blind)} m. The route returned first loses its fix at "
            f"({x:.2f}, {y:.2f}) m. Place landmarks there, or raise max_blind_distance_m."
        )
        place = (float(x), float(y))
        return (Unmet("max_blind_distance_m", asked, longest, place, self.found.longest_blind, message),)


def _place_at(route: Route, s: float) -> tuple[float, float]:
    points, arc = route.path.points, route.path.s
    return (float(np.interp(s, arc, points[:, 0])), float(np.interp(s, arc, points[:, 1])))


def _nothing(problem: PlanningProblem, found: LabelPath, clock: Clock) -> PlanResult:
    if found.is_complete:
        status = PlanStatus.NO_PATH
        said = (
            f"Start and goal are not connected for a robot of radius {problem.radius:g} m under these "
            "bounds, however far it drives without a fix."
        )
    else:
        status = PlanStatus.TIMEOUT
        said = f"The deadline of {problem.deadline:g} s came before any path was found; allow more time."
    stats = {f"{k}_s": v for k, v in clock.seconds.items()} | {"total_s": clock.elapsed}
    return PlanResult(status, None, None, None, "label_search", warnings=(said,), stats=stats)
