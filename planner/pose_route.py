"""The route of a robot with a heading: what is known along its motion, at the poses that it drives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from localization import covariance as cov
from localization.at_poses import fixes_at
from maps.arrays import FloatArray, IntArray
from planner.annotate import annotate, longest_run
from planner.context import PlanningContext
from planner.cost_space import CostSpace
from planner.extras import cost_factors
from planner.footprint import Footprint
from planner.pose_plan import PosePath
from planner.pose_timing import PoseTrajectory
from planner.problem import PlanningProblem, blind_rate_of
from planner.result import Route
from planner.risk import CollisionRisk, collision_risk
from planner.steering import PoseSpace

# Poses at which fixes are computed lie no further apart than this along the way and in heading.
_STEP_M, _STEP_RAD = 0.05, 0.05


def route_of_poses(
    motion: PoseTrajectory,
    path: PosePath,
    space: PoseSpace,
    *,
    problem: PlanningProblem,
    context: PlanningContext,
    footprint: Footprint | None,
    blind_rate: float,
) -> Route:
    """Route with the robot's own headings.

    Parameters
    ----------
    motion
        As it is driven.
    path, space
        What it was made from.
    problem, context
        The question and its field; over headings covariances are those of the poses themselves, and so is
        the cost.
    footprint
        The outline: clearance and risk are those of the discs that cover it.
    blind_rate
        Cost per metre without a fix.
    """
    route = annotate(motion.to_trajectory(), context, space.cost_space, cost=path.cost)
    route = with_headings(route, motion)
    if footprint is not None:
        _, at = stations(route, motion)
        clearance = footprint.clearance(context.clearance, motion.poses)
        route = replace(
            route,
            path=replace(route.path, clearance=clearance[at]),
            summary=replace(route.summary, min_clearance=float(clearance.min())),
        )
    if context.headings is not None:
        assert path.curve is not None
        steering = space.steering
        prices = steering.turn_price * path.curve.turned + steering.gear_price * path.curve.gear_changes
        arc, _ = stations(route, motion)
        poses = np.asarray(motion.poses)
        route = _at_poses(route, poses, arc, problem, context, blind_rate=blind_rate, prices=prices)
    if footprint is not None or context.headings is not None:
        route = _with_risk(route, context, footprint, space.cost_space)
    return route


def with_headings(route: Route, motion: PoseTrajectory) -> Route:
    """The route with the robot's own headings."""
    _, at = stations(route, motion)
    return replace(route, path=replace(route.path, heading=motion.poses[at, 2]))


def stations(route: Route, motion: PoseTrajectory) -> tuple[FloatArray, IntArray]:
    """Arc lengths of the motion's samples, and the sample at each waypoint of the route."""
    steps = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.clip(np.searchsorted(arc, route.path.s - 1e-9), 0, len(arc) - 1)
    at[-1] = len(arc) - 1  # after the last turn in place
    return arc, at


def facing_its_way(route: Route, problem: PlanningProblem, context: PlanningContext) -> Route:
    """A route of a disc on a field over headings as it is for a robot that faces the way it drives."""
    assert context.headings is not None
    points = np.asarray(route.trajectory.points)
    if len(points) < 2:
        return route
    steps = np.diff(points, axis=0)
    ways = np.hypot(*steps.T)
    moves = np.flatnonzero(ways > 0)
    leg = moves[np.clip(np.searchsorted(moves, np.arange(len(points))), 0, len(moves) - 1)]
    poses = np.column_stack([points, np.arctan2(steps[leg, 1], steps[leg, 0])])
    arc = np.concatenate([[0.0], np.cumsum(ways)])
    blind = blind_rate_of(problem.effective_weight, problem.blind_r95) or np.inf
    return _at_poses(route, poses, arc, problem, context, blind_rate=blind)


def _at_poses(
    route: Route,
    poses: FloatArray,
    arc: FloatArray,
    problem: PlanningProblem,
    context: PlanningContext,
    *,
    blind_rate: float,
    prices: float = 0.0,
) -> Route:
    """Covariances of the poses (K, 3) at arc lengths (K,) themselves; figures and cost of them."""
    field = context.headings
    assert field is not None
    told = route.path
    at_path = np.column_stack([told.points, told.heading])
    fixes = fixes_at(field.world, field.sensor, at_path, method=field.method)
    told = replace(
        told,
        covariance=fixes.covariance,
        r95=cov.r95(fixes.covariance),
        triplet=fixes.triplet,
        pan=fixes.pan,
        has_fix=None,
    )
    kept = _spaced(arc, poses[:, 2])
    poses, s = poses[kept], arc[kept]
    every = fixes_at(field.world, field.sensor, poses, method=field.method).covariance
    r95 = cov.r95(every)
    # Each pose stands for the way half to its neighbours.
    share = 0.5 * (np.diff(s, prepend=s[0]) + np.diff(s, append=s[-1]))
    known = np.isfinite(r95)
    rate = np.where(known, 1.0 + problem.effective_weight * r95, blind_rate)
    driven = share > 0
    cost = float((rate * _area_factor(poses, problem, context))[driven] @ share[driven]) + prices
    summary = replace(
        route.summary,
        blind=float(share[~known].sum()),
        longest_blind=longest_run(~known, share),
        cost=cost,
        **_NO_FIGURES,
    )
    if known.any():
        length = float(share[known].sum())
        worst = int(np.argmax(np.where(known, r95, -1.0)))
        summary = replace(
            summary,
            mean_r95=float(r95[known] @ share[known]) / length if length > 0 else float(r95[worst]),
            max_r95=float(r95[worst]),
            max_area95=float(cov.area95(every[known]).max()),
            max_ellipse95=float(cov.ellipse95(every[known])[:, 0].max()),
            worst_at=float(s[worst]),
        )
    return replace(route, path=told, summary=summary)


_NO_FIGURES: Any = dict.fromkeys(("mean_r95", "max_r95", "max_area95", "max_ellipse95", "worst_at"))


def _area_factor(poses: FloatArray, problem: PlanningProblem, context: PlanningContext) -> FloatArray:
    factors = cost_factors(problem.extras, context.field.frame)
    if factors is None:
        return np.ones(len(poses))
    cells = np.clip(context.field.frame.cell_at(poses[:, :2]), 0, np.array(factors.shape) - 1)
    return np.asarray(factors[cells[:, 0], cells[:, 1]])


def _spaced(arc: FloatArray, heading: FloatArray) -> IntArray:
    """Samples about as far apart as a step in way or heading; first and last are among them."""
    moved = np.abs(np.diff(arc)) / _STEP_M + np.abs(np.diff(np.unwrap(heading))) / _STEP_RAD
    count = np.concatenate([[0.0], np.cumsum(moved)])
    first = np.flatnonzero(np.diff(np.floor(count), prepend=-1.0) > 0)
    return np.unique(np.concatenate([first, [len(arc) - 1]]))


def _with_risk(
    route: Route, context: PlanningContext, footprint: Footprint | None, space: CostSpace
) -> Route:
    """Bounds on the collision probability at the waypoints: of the outline's discs, or of the disc."""
    path = route.path
    risk = (
        collision_risk(context.clearance, path.points, path.covariance, space.radius)
        if footprint is None
        else outline_risk(context, footprint, np.column_stack([path.points, path.heading]), path.covariance)
    )
    judged = bool(np.isfinite(risk.rigorous).any())
    return replace(
        route,
        path=replace(path, collision_probability=risk.tight, collision_bound=risk.rigorous),
        summary=replace(
            route.summary,
            max_collision_probability=float(np.nanmax(risk.tight)) if judged else None,
            max_collision_bound=float(np.nanmax(risk.rigorous)) if judged else None,
        ),
    )


def outline_risk(
    context: PlanningContext, footprint: Footprint, poses: FloatArray, covariance: FloatArray
) -> CollisionRisk:
    """Bounds for an outline at poses (N, 3): it moves with the error of its place, the heading being known.

    It touches something when it is displaced to where one of its covering discs does. The rigorous bound is
    that of the least clearance, ``exp(-c² / (2 λ_max))``; the direction-aware one the sum over discs of which
    none is nearer than all others, at most the rigorous one.
    """
    centres = footprint.disc_centres(poses)
    rigorous, tight = np.full(len(poses), np.nan), np.full(len(poses), np.nan)
    known = np.isfinite(covariance[:, 0])
    if not known.any():
        return CollisionRisk(rigorous, tight)
    bounds = np.array(
        [
            [risk.rigorous, risk.tight]
            for risk in (
                collision_risk(context.clearance, centres[known, k], covariance[known], float(disc[2]))
                for k, disc in enumerate(footprint.discs)
            )
        ]
    )
    rigorous[known] = bounds[:, 0].max(axis=0)
    tight[known] = np.minimum(bounds[:, 1].sum(axis=0), rigorous[known])
    return CollisionRisk(rigorous, tight)
