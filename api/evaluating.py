"""Paths that somebody else made, scored as plans are: figures, waypoints, bounds that they do not keep."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely

from api.codec_plan import FieldLabel, engine_version, route_to_json
from api.worker_orders import EvaluationOrder, GivenPath
from localization import covariance as cov
from maps.arrays import FloatArray
from maps.clearance import TOUCH_M
from planner.annotate import annotate
from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.problem import PlanningProblem
from planner.result import Route, Trajectory
from planner.timing import time_polyline
from planner.travel import Travel

#: What driving without a fix costs where the question does not say; the cost is left out then.
_BLIND_R95_M = 1.0
_ROUNDING = 1 + 1e-9
_COMPARED = ("cost", "length_m", "duration_s", "min_clearance_m")
_COMPARED_UNCERTAINTY = ("mean_r95_m", "max_r95_m", "max_area95_m2", "max_ellipse95_m", "blind_m")


def evaluated(context: PlanningContext, label: FieldLabel, order: EvaluationOrder) -> dict[str, Any]:
    """The answer of ``POST /v1/evaluations``: every path with its figures, and against the first one.

    Raises
    ------
    InvalidProblem
        If a path leaves the map, or its numbers make no sense.
    """
    scored = [_scored(path, k, context, label, order) for k, path in enumerate(order.paths)]
    return {
        "map": label.map_id,
        "field": label.field_id,
        "engine": engine_version(),
        "client_ref": order.client_ref,
        "paths": scored,
        "differences": [_difference(scored[0], other) for other in scored[1:]],
        "warnings": list(order.warnings),
    }


def _scored(
    given: GivenPath, k: int, context: PlanningContext, label: FieldLabel, order: EvaluationOrder
) -> dict[str, Any]:
    problem = order.problem
    trajectory = given.trajectory
    points = np.array(given.points) if trajectory is None else np.asarray(trajectory.points)
    x0, y0, x1, y1 = context.field.frame.bounds()
    # The bounds first: far away is outside, whatever rounding makes of it.
    inside = np.asarray(((points >= (x0, y0)) & (points <= (x1, y1))).all(axis=1))
    inside[inside] = context.field.frame.contains(points[inside])
    if not inside.all():
        x, y = points[int(np.argmin(inside))].tolist()
        raise InvalidProblem(f"Path {k} leaves the map at ({x:g}, {y:g}) m.")
    if trajectory is None:
        trajectory = time_polyline(points, max_speed=problem.max_speed, max_accel=problem.max_accel)
    known = problem.blind_r95 is not None
    travel = Travel(
        problem.radius,
        weight=problem.weight,
        blind_r95=problem.blind_r95 if known else _BLIND_R95_M,
        areas=problem.areas,
    )
    route = annotate(trajectory, context, travel.graph(context).cost_space)
    unmet = _unmet(route, trajectory, problem)
    answer = route_to_json(route, label.landmarks, with_trajectory=False)
    answer["min_clearance_m"] = _room(route)
    if not known and route.summary.blind > 0:
        answer["cost"] = None
    hit = any(u["bound"] == "clearance" for u in unmet)
    return {
        "name": given.name,
        "status": "occupied" if hit else "risk_unmet" if unmet else "ok",
        **answer,
        "unmet": unmet,
    }


def _unmet(route: Route, trajectory: Trajectory, problem: PlanningProblem) -> list[dict[str, Any]]:
    """What the path does not keep: first that the robot fits, then every bound of the question."""
    summary, path = route.summary, route.path
    out = []
    room = _room(route)
    if room + problem.radius < max(problem.radius - TOUCH_M, TOUCH_M):
        at = path.points[int(np.argmin(path.clearance))]
        words = f"The robot does not fit: it would need {max(0.0, -room):.3g} m more room."
        out.append(_missed("clearance", 0.0, room, at, words))
    if (at_area := _entered(trajectory, problem)) is not None:
        out.append(_missed("avoid", None, None, at_area, "The robot's body enters an area to avoid."))
    bounds = (
        ("max_r95_m", problem.max_r95, summary.max_r95, path.r95),
        (
            "max_ellipse95_m",
            problem.max_ellipse95,
            summary.max_ellipse95,
            cov.ellipse95(path.covariance)[:, 0],
        ),
        (
            "max_collision_probability",
            problem.max_collision_probability,
            summary.max_collision_probability,
            path.collision_probability,
        ),
    )
    for name, limit, value, along in bounds:
        if limit is not None and value is not None and value > limit * _ROUNDING:
            at = path.points[int(np.argmax(np.nan_to_num(along, nan=-1.0)))]
            out.append(_missed(name, limit, value, at, f"The worst is {value:.3g}, the bound {limit:g}."))
    if summary.blind > 0 and problem.blind_r95 is None:
        blind = np.isnan(path.r95)
        at = path.points[int(np.argmax(blind))]
        words = f"It drives {summary.blind:.3g} m without a fix; give blind_r95_m to accept that at a cost."
        out.append(_missed("blind", 0.0, summary.blind, at, words))
    return out


def _room(route: Route) -> float:
    """Smallest clearance, m; below 0 inside obstacles too, where that along motions ends."""
    return min(route.summary.min_clearance, float(route.path.clearance.min()))


def _entered(trajectory: Trajectory, problem: PlanningProblem) -> FloatArray | None:
    """Where the robot's disc is in an area to avoid."""
    points = np.asarray(trajectory.points)
    line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
    for area in problem.avoid:
        if shapely.distance(line, area) < max(problem.radius - TOUCH_M, TOUCH_M):
            nearest = int(np.argmin(shapely.distance(shapely.points(points), area)))
            return np.asarray(points[nearest])
    return None


def _missed(
    bound: str, limit: float | None, value: float | None, at: FloatArray, message: str
) -> dict[str, Any]:
    x, y = at.tolist()
    place = {"x_m": x, "y_m": y}
    return {
        "bound": bound,
        "limit": limit,
        "value": value,
        "place": place,
        "smallest_possible": None,
        "message": message,
    }


def _difference(first: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """A path's figures minus those of the first; null where one of them has none."""
    out: dict[str, Any] = {"name": other["name"], "against": first["name"]}
    for name in _COMPARED:
        out[name] = _minus(other[name], first[name])
    for name in _COMPARED_UNCERTAINTY:
        out[name] = _minus(other["uncertainty"][name], first["uncertainty"][name])
    return out


def _minus(value: float | None, other: float | None) -> float | None:
    if value is None or other is None or not (math.isfinite(value) and math.isfinite(other)):
        return None
    return value - other
