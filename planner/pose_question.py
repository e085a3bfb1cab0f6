"""Plans for robots with a heading: kinematics, outlines, poses at the ends, fields over headings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from localization import covariance as cov
from localization.heading_field import HeadingField
from maps.arrays import FloatArray, IntArray
from planner.annotate import annotate, longest_run
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_space import CostSpace
from planner.extras import Extras
from planner.facing import faced
from planner.footprint import Footprint, fitting_headings
from planner.lattice import Outcome
from planner.pose_plan import PosePath, plan_poses
from planner.pose_timing import MotionLimits, PoseTrajectory, drive
from planner.problem import PlanningProblem
from planner.result import PlanResult, PlanStatus, Route, Unmet
from planner.risk import collision_risk
from planner.steering import PoseSpace, Steering, heading_rates
from planner.unmet import round_up

N_HEADINGS = 16
# Cost per metre without a fix where that is forbidden and cannot be avoided.
_BLIND_RATE = 1e4
_ROUNDING = 1e-6
# Price of a turn that costs nothing, m/rad.
_LEAST_TURN = 1e-6

Baseline = Callable[[], Route | None]


def plan_with_poses(
    problem: PlanningProblem,
    context: PlanningContext,
    clock: Clock,
    *,
    headings: HeadingField | None,
    baseline: Baseline,
) -> PlanResult:
    """Answer a question in which the robot's heading matters.

    Parameters
    ----------
    problem, context
        The question and the field; its cells are the planning grid.
    clock
        Of the plan.
    headings
        The field over headings, where the sensor depends on them: the cost then is that of the heading in
        which the robot drives.
    baseline
        Makes the shortest route of a holonomic disc, to compare with.

    Returns
    -------
    result
        ``EXACT``: the cheapest on the lattice of poses, then improved. Bounds that leave no way are dropped
        all together, and the route is ``RISK_UNMET``. ``NO_PATH`` says in words what is too narrow.
    """
    work = _Work(problem, context, clock, headings)
    relaxed: tuple[str, ...] = ()
    with clock.stage("lattice"):
        path, space = work.search()
        if path.outcome is Outcome.NO_WAY and work.bounds and not clock.is_over():
            relaxed = work.bounds
            path, space = work.search(bounded=False)
    if path.curve is None:
        return _nothing(path, clock)
    with clock.stage("timing"):
        motion, _ = drive(path.curve, space, work.limits)
    with clock.stage("annotate"):
        route = work.route(motion, path, space)
    clock.seconds["to_final_path"] = clock.elapsed
    with clock.stage("shortest"):
        shortest = baseline()
    unmet = work.unmet(route, relaxed)
    status = PlanStatus.EXACT if path.is_exact else PlanStatus.APPROXIMATE
    return PlanResult(
        status=PlanStatus.RISK_UNMET if unmet else status,
        route=route,
        shortest=shortest,
        grid_cost=path.lattice_cost,
        planner=path.planner,
        unmet=unmet,
        warnings=tuple(work.warnings),
        stats={f"{k}_s": v for k, v in clock.seconds.items()} | {"total_s": clock.elapsed},
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
    work = _Work(problem, context, Clock(problem.deadline), None)
    weight = problem.effective_weight
    space = context.graph(radius=problem.radius, weight=weight, blind_rate=1.0 + weight).cost_space
    motion = faced(
        base.route.trajectory,
        space,
        work.limits,
        start_heading=problem.start_heading,
        goal_heading=problem.goal_heading,
    )
    if motion is None:
        return None
    route = annotate(motion.to_trajectory(), context, space, cost=base.route.summary.cost)
    return replace(base, route=work.with_headings(route, motion), planner=f"{base.planner}+facing")


class _Work:
    """One question: its space of poses, and the way from a curve to a route."""

    def __init__(
        self, problem: PlanningProblem, context: PlanningContext, clock: Clock, headings: HeadingField | None
    ) -> None:
        self.problem, self.context, self.clock, self.headings = problem, context, clock, headings
        self.footprint = None if problem.footprint is None else Footprint.of(problem.footprint)
        self.radius = problem.radius if self.footprint is None else self.footprint.inscribed_radius
        self.warnings: list[str] = []
        self.limits = MotionLimits(
            problem.max_speed, problem.max_accel, problem.turn_rate, problem.max_turn_accel
        )
        turns = 0.0 if problem.kinematics == "holonomic" else problem.max_speed / problem.turn_rate
        if self.footprint is not None:
            turns = max(turns, _LEAST_TURN)  # turns with a price are checked at the headings between
        stop = problem.max_speed**2 / problem.max_accel
        self.steering = Steering(problem.kinematics, problem.min_turn_radius, turns, stop)

    @property
    def bounds(self) -> tuple[str, ...]:
        """Names of the bounds that are given."""
        p = self.problem
        named = {
            "max_r95_m": p.max_r95,
            "max_ellipse95_m": p.max_ellipse95,
            "max_collision_probability": p.max_collision_probability,
        }
        given = [name for name, value in named.items() if value is not None]
        return tuple(given if p.blind_r95 is not None else [*given, "blind"])

    def search(self, *, bounded: bool = True) -> tuple[PosePath, PoseSpace]:
        """The way, under the bounds or without them; with an outline, first with room for half a cell."""
        p = self.problem
        graph_space, rates = self._rates(bounded=bounded)
        margins: tuple[float, ...] = (0.0,)
        if self.footprint is not None:
            margins = (0.5 * math.sqrt(2.0) * graph_space.frame.resolution, 0.0)
        for margin in margins:
            stack = rates if self.footprint is None else self._fitting(rates, margin)
            path = plan_poses(
                graph_space,
                (*p.start, p.start_heading),
                (*p.goal, p.goal_heading),
                steering=self.steering,
                heading_rates=stack if len(stack) > 1 else None,
                n_headings=N_HEADINGS,
                deadline_at=self.clock.at(0.7),
                seed=p.seed,
                refine=p.refine,
            )
            if path.curve is not None or self.clock.is_over():
                break
        return path, PoseSpace(graph_space, stack, self.steering)

    def _rates(self, *, bounded: bool) -> tuple[CostSpace, FloatArray]:
        p, weight = self.problem, self.problem.effective_weight
        blind = None if p.blind_r95 is None else 1.0 + weight * p.blind_r95
        extras: Extras = p.extras
        max_r95 = p.max_r95
        if not bounded:
            max_r95, extras, blind = None, extras.without_bounds(), _BLIND_RATE if blind is None else blind
        if self.headings is None:
            graph = self.context.graph(
                radius=self.radius, weight=weight, max_r95=max_r95, blind_rate=blind, extras=extras
            )
            return graph.cost_space, graph.cost_space.rate[None]
        if extras.max_ellipse95 is not None or extras.max_probability is not None:
            self.warnings.append(
                "On a field over headings, bounds on the ellipse and on collisions are judged at the best "
                "heading of each cell."
            )
        free = self.context.graph(radius=self.radius, weight=0.0, blind_rate=1.0, extras=extras).cost_space
        stack = np.array(heading_rates(self.headings, weight=weight, max_r95=max_r95, blind_rate=blind))
        stack[:, ~np.isfinite(free.rate)] = np.inf
        stack *= np.where(np.isfinite(free.rate), free.rate, 1.0)
        least = stack.min(axis=0)
        passable = free.passable & np.isfinite(least)
        return replace(free, rate=least, passable=passable, weight=weight), stack

    def _fitting(self, rates: FloatArray, margin: float) -> FloatArray:
        """The rates, inf where the outline does not fit a cell at a heading."""
        assert self.footprint is not None
        discs = self.footprint.discs + np.array([0.0, 0.0, margin])
        grown = Footprint(self.footprint.corners, discs)
        count = max(len(rates), N_HEADINGS)
        angles = 2 * math.pi / count * np.arange(count)
        frame = self.context.field.frame
        fits = fitting_headings(
            grown, self.context.clearance, frame, self.context.centre_clearance - margin, angles
        )
        stack = rates if len(rates) == count else np.repeat(rates, count, axis=0)
        return np.where(fits, stack, np.inf)

    def route(self, motion: PoseTrajectory, path: PosePath, space: PoseSpace) -> Route:
        """The motion with what is known along it; headings are the robot's own."""
        trajectory = motion.to_trajectory()
        route = annotate(trajectory, self.context, space.cost_space, cost=path.cost)
        route = self.with_headings(route, motion)
        arc, at = _stations(route, motion)
        if self.footprint is not None:
            clearance = self.footprint.clearance(self.context.clearance, motion.poses)
            least = float(clearance.min())
            if least < 0:
                place = motion.poses[int(np.argmin(clearance))]
                self.warnings.append(
                    f"The outline's covering discs come {round_up(-least)} m too close to an obstacle at "
                    f"({place[0]:.2f}, {place[1]:.2f}) m; a field on smaller cells finds a way with room."
                )
            told = replace(route.path, clearance=clearance[at])
            summary = replace(route.summary, min_clearance=least)
            route = replace(route, path=told, summary=summary)
        return route if self.headings is None else self._at_headings(route, motion, arc)

    def with_headings(self, route: Route, motion: PoseTrajectory) -> Route:
        """The route with the robot's own headings."""
        _, at = _stations(route, motion)
        return replace(route, path=replace(route.path, heading=motion.poses[at, 2]))

    def _at_headings(self, route: Route, motion: PoseTrajectory, arc: FloatArray) -> Route:
        """Covariances of the robot's heading at each place, and figures of them."""
        assert self.headings is not None
        fields = [one.trusted() for one in self.headings.slices]
        frame, count = self.headings.frame, len(fields)

        def which(headings: FloatArray) -> IntArray:
            return np.asarray(np.round(headings / (2 * math.pi) * count).astype(np.int64) % count)

        def at(poses: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
            cells = frame.cell_at(poses[:, :2])
            rows = np.clip(cells[:, 0], 0, frame.n_rows - 1)
            cols = np.clip(cells[:, 1], 0, frame.n_cols - 1)
            k = which(poses[:, 2])
            covariance = np.array([fields[i].covariance[r, c] for i, r, c in zip(k, rows, cols, strict=True)])
            triplet = np.array([fields[i].triplet[r, c] for i, r, c in zip(k, rows, cols, strict=True)])
            pan = np.array([fields[i].pan[r, c] for i, r, c in zip(k, rows, cols, strict=True)])
            return covariance.reshape(-1, 3), triplet.reshape(-1, 3), pan

        path = route.path
        poses = np.column_stack([path.points, path.heading])
        covariance, triplet, pan = at(poses)
        risk = collision_risk(self.context.clearance, path.points, covariance, self.radius)
        told = replace(
            path,
            covariance=covariance,
            r95=cov.r95(covariance),
            triplet=triplet,
            pan=pan,
            collision_probability=risk.tight,
            collision_bound=risk.rigorous,
            has_fix=None,
        )
        every, _, _ = at(np.asarray(motion.poses))
        r95 = cov.r95(every)
        share = np.diff(arc, prepend=0.0)
        known = np.isfinite(r95)
        driven = float(share[known].sum())
        worst = int(np.argmax(np.where(known, r95, -1.0)))
        some = bool(known.any())
        mean = None
        if some:
            mean = float(r95[known] @ share[known]) / driven if driven > 0 else float(r95[worst])
        summary = replace(
            route.summary,
            mean_r95=mean,
            max_r95=float(r95[worst]) if some else None,
            max_area95=float(cov.area95(every[known]).max()) if some else None,
            max_ellipse95=float(cov.ellipse95(every[known])[:, 0].max()) if some else None,
            worst_at=float(arc[worst]) if some else None,
            blind=float(share[~known].sum()),
            longest_blind=longest_run(~known, share),
            max_collision_probability=float(np.nanmax(risk.tight)) if np.isfinite(risk.tight).any() else None,
            max_collision_bound=float(np.nanmax(risk.rigorous)) if np.isfinite(risk.rigorous).any() else None,
        )
        return replace(route, path=told, summary=summary)

    def unmet(self, route: Route, relaxed: tuple[str, ...]) -> tuple[Unmet, ...]:
        """Bounds that had to be dropped and that the route does not keep."""
        p, s = self.problem, route.summary
        reached = {
            "max_r95_m": (p.max_r95, s.max_r95),
            "max_ellipse95_m": (p.max_ellipse95, s.max_ellipse95),
            "max_collision_probability": (p.max_collision_probability, s.max_collision_probability),
            "blind": (0.0, s.blind),
        }
        places, out = route.path, []
        for name in self.bounds:
            limit, value = reached[name]
            if limit is None or value is None or value <= limit * (1 + _ROUNDING) + _ROUNDING:
                continue
            if name == "blind" and not relaxed:
                continue
            measure = np.isnan(places.r95) if name == "blind" else np.nan_to_num(places.r95, nan=-1.0)
            x, y = places.points[int(np.argmax(measure))]
            message = (
                f"No way for this robot keeps {name} at {limit:g}; the route returned, the cheapest without "
                f"bounds, reaches {round_up(value)}, worst at ({x:.2f}, {y:.2f}) m."
            )
            if name == "blind":
                message = (
                    "No way for this robot has a fix everywhere; the route returned, the cheapest without "
                    f"bounds, drives {round_up(value)} m without one, first at ({x:.2f}, {y:.2f}) m. Give "
                    "blind_r95_m to accept such stretches at a cost, or place landmarks there."
                )
            out.append(Unmet(name, limit, value, (float(x), float(y)), None, message))
        return tuple(out)


def _stations(route: Route, motion: PoseTrajectory) -> tuple[FloatArray, IntArray]:
    """Arc lengths of the motion's samples, and the sample at each waypoint of the route."""
    steps = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.clip(np.searchsorted(arc, route.path.s - 1e-9), 0, len(arc) - 1)
    at[-1] = len(arc) - 1  # after the last turn in place
    return arc, at


def _nothing(path: PosePath, clock: Clock) -> PlanResult:
    status = PlanStatus.TIMEOUT if path.outcome is Outcome.STOPPED else PlanStatus.NO_PATH
    stats = {f"{k}_s": v for k, v in clock.seconds.items()} | {"total_s": clock.elapsed}
    said = path.reason or "There is no way for this robot."
    return PlanResult(status, None, None, None, path.planner, warnings=(said,), stats=stats)
