"""Plans as JSON: the answer of ``POST /v1/plans``."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import numpy.typing as npt
from shapely import Polygon

from api.codec_schedule import schedule_figures, schedule_to_json
from api.questions import NOTHING_MORE, Found, FrontPlace, ListedRoute, More
from localization import covariance as cov
from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray, IntArray
from planner.problem import PlanningProblem
from planner.result import Blockage, Path, PlanResult, Route, RouteSummary, Trajectory, Unmet


def engine_version() -> str:
    """Version of the installed distribution, or ``0`` in a bare checkout."""
    try:
        return version("surepath")
    except PackageNotFoundError:
        return "0"


@dataclass(frozen=True, slots=True)
class FieldLabel:
    """What an answer says of the field that it was planned on: ids, and names of its landmarks."""

    map_id: str
    field_id: str
    landmarks: tuple[str, ...]

    @classmethod
    def of(cls, field: UncertaintyField | HeadingField) -> FieldLabel:
        """The label of a field."""
        return cls("m_" + field.world.content_hash(), "f_" + field.content_hash(), field.world.landmarks.ids)


def plan_to_json(
    result: PlanResult | Found,
    field: UncertaintyField | HeadingField | FieldLabel,
    *,
    problem: PlanningProblem,
    more: More = NOTHING_MORE,
    client_ref: str | None = None,
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """Answer of ``POST /v1/plans``. Holds no time of computation: same result, same bytes.

    Parameters
    ----------
    result, field, problem
        What was found, on what (or its label), for which question.
    more
        What was asked for beside one route.
    client_ref
        Comes back as given.
    warnings
        Set before the planner's own.

    Returns
    -------
    answer
        JSON-able; ``plan`` is ``p_`` and a hash of everything else; unknown numbers are None.
    """
    label = field if isinstance(field, FieldLabel) else FieldLabel.of(field)
    names = label.landmarks
    found = result if isinstance(result, Found) else Found.of(result)
    result = found.result
    answer: dict[str, Any] = {
        "status": result.status.value,
        "map": label.map_id,
        "field": label.field_id,
        "planner": result.planner,
        "engine": engine_version(),
        "client_ref": client_ref,
        "request": problem_to_json(problem, more),
        "routes": [_listed(route, names) for route in found.routes],
        "shortest_baseline": None
        if result.shortest is None
        else route_to_json(result.shortest, names, with_trajectory=False),
        "grid_cost": number(result.grid_cost),
        "gap": number(result.gap),
        "unmet": [_unmet(u) for u in result.unmet],
        "blocked": None if result.blocked is None else _blocked(result.blocked),
        "warnings": [*warnings, *result.warnings],
    }
    return seal(answer)


def seal(answer: dict[str, Any]) -> dict[str, Any]:
    """The answer with its id: a hash of everything else in it, hence of question, version and result."""
    bare = {key: value for key, value in answer.items() if key != "plan"}
    text = json.dumps(bare, sort_keys=True, allow_nan=False, separators=(",", ":"))
    return {"plan": "p_" + hashlib.sha256(text.encode()).hexdigest(), **bare}


def problem_to_json(problem: PlanningProblem, more: More = NOTHING_MORE) -> dict[str, Any]:
    """The question in the words of ``POST /v1/plans``, every default filled in."""
    odometry = problem.odometry
    front = more.front
    of_front = {} if front is None else {"against": front.against, "count": front.count}
    return {
        "start": {
            "x_m": problem.start[0],
            "y_m": problem.start[1],
            "theta_rad": problem.start_heading,
            "covariance": None if problem.start_covariance is None else list(problem.start_covariance),
        },
        "goal": {"x_m": problem.goal[0], "y_m": problem.goal[1], "theta_rad": problem.goal_heading},
        "robot": {
            "radius_m": problem.radius,
            "footprint": None
            if problem.footprint is None
            else [{"x_m": x, "y_m": y} for x, y in problem.footprint],
            "kinematics": problem.kinematics,
            "min_turn_radius_m": problem.min_turn_radius,
            "max_turn_accel_rad_s2": number(problem.max_turn_accel),
            "max_speed_m_s": problem.max_speed,
            "max_accel_m_s2": problem.max_accel,
            "max_turn_rate_rad_s": problem.turn_rate,
            "fix_rate_hz": problem.fix_rate,
            "odometry": {
                "distance_sigma_m": odometry.distance_sigma,
                "turn_sigma_rad": odometry.turn_sigma,
                "drift_sigma_rad": odometry.drift_sigma,
                "slip_sigma_m": odometry.slip_sigma,
            },
            "pan_rate_rad_s": number(more.pan_rate),
        },
        "objective": {
            "kind": problem.objective if front is None else "pareto",
            "uncertainty_weight_per_m": problem.weight,
            "covariance": problem.covariance,
            **of_front,
        },
        "constraints": {
            "max_r95_m": problem.max_r95,
            "max_ellipse95_m": problem.max_ellipse95,
            "max_collision_probability": problem.max_collision_probability,
            "max_blind_distance_m": problem.max_blind_distance,
            "blind_r95_m": problem.blind_r95,
        },
        "via": [{"x_m": x, "y_m": y} for x, y in problem.via],
        "avoid": [_polygon(polygon) for polygon in problem.avoid],
        "areas": [{"polygon": _polygon(p), "factor": factor} for p, factor in problem.areas],
        "alternatives": None if more.alternatives is None else asdict(more.alternatives),
        "include": ["schedule"] if more.schedule else [],
        "deadline_s": problem.deadline,
        "seed": problem.seed,
    }


def _polygon(polygon: Polygon) -> dict[str, Any]:
    rings = [polygon.exterior, *polygon.interiors]
    return {"type": "Polygon", "coordinates": [[[x, y] for x, y in ring.coords] for ring in rings]}


def number(value: float | None) -> float | None:
    """The number, or None where it is none."""
    return None if value is None or not math.isfinite(value) else float(value)


def numbers(values: npt.ArrayLike) -> list[float | None]:
    """Array (N,) as a list with None for what is not finite."""
    return [v if math.isfinite(v) else None for v in np.asarray(values, dtype=np.float64).tolist()]


def triplet_names(triplet: Sequence[int] | IntArray, names: Sequence[str]) -> list[str] | None:
    """Ids of a triplet's landmarks; None where there is none: no fix, or one of every landmark in view."""
    return None if triplet[0] < 0 else [names[int(i)] for i in triplet]


def route_to_json(route: Route, names: Sequence[str], *, with_trajectory: bool = True) -> dict[str, Any]:
    """Figures, waypoints and motion of one route; places in nanometres, times in nanoseconds."""
    motion = {"trajectory": _trajectory(route.trajectory)} if with_trajectory else {}
    return {
        "covariance": route.path.kind,
        **_figures(route.summary),
        "path": _path(route.path, route.trajectory, names),
        **motion,
    }


def _listed(listed: ListedRoute, names: Sequence[str]) -> dict[str, Any]:
    schedule = listed.schedule
    return {
        **route_to_json(listed.route, names),
        "share": number(listed.share),
        "front": None if listed.front is None else _front_place(listed.front),
        "schedule": None if schedule is None else schedule_to_json(schedule, names),
        "schedule_figures": None if schedule is None else schedule_figures(schedule),
    }


def _front_place(place: FrontPlace) -> dict[str, Any]:
    is_worst = place.against == "worst"
    return {
        "against": place.against,
        "r95_m": number(place.r95),
        "max_r95_m": place.setting if is_worst else None,
        "uncertainty_weight_per_m": None if is_worst else place.setting,
    }


def _rounded(values: npt.ArrayLike, digits: int = 9) -> FloatArray:
    # Nobody measures a nanometre; shorter numbers make answers half as long.
    return np.asarray(np.round(np.asarray(values, dtype=np.float64), digits))


def _figures(summary: RouteSummary) -> dict[str, Any]:
    return {
        "cost": number(summary.cost),
        "length_m": number(summary.length),
        "duration_s": number(summary.duration),
        "min_clearance_m": number(summary.min_clearance),
        "uncertainty": {
            "mean_r95_m": number(summary.mean_r95),
            "max_r95_m": number(summary.max_r95),
            "max_area95_m2": number(summary.max_area95),
            "max_ellipse95_m": number(summary.max_ellipse95),
            "blind_m": number(summary.blind),
            "longest_blind_m": number(summary.longest_blind),
            "worst_at_m": number(summary.worst_at),
        },
        "risk": {
            "max_collision_probability": number(summary.max_collision_probability),
            "max_collision_bound": number(summary.max_collision_bound),
        },
    }


def _path(path: Path, trajectory: Trajectory, names: Sequence[str]) -> list[dict[str, Any]]:
    columns = zip(
        _rounded(path.points).tolist(),
        numbers(_rounded(path.s)),
        numbers(_rounded(path.heading)),
        _rounded(path.covariance, 15).tolist(),
        numbers(_rounded(path.r95)),
        numbers(_rounded(np.sqrt(cov.max_eigenvalue(path.covariance)))),
        _rounded(cov.ellipse95(path.covariance)).tolist(),
        path.triplet.tolist(),
        numbers(_rounded(path.pan)),
        numbers(_rounded(path.clearance)),
        numbers(_rounded(path.collision_probability, 12)),
        numbers(_rounded(_times_at(path.s, trajectory))),
        [path.kind if known else "dead_reckoning" for known in np.asarray(path.has_fix).tolist()],
        strict=True,
    )
    out = []
    for (x, y), s, theta, c, r95, sigma, (a, b, azimuth), triplet, pan, clearance, risk, t, of in columns:
        blind = not math.isfinite(c[0])
        out.append(
            {
                "x_m": x,
                "y_m": y,
                "theta_rad": theta,
                "s_m": s,
                "t_s": t,
                "covariance": None if blind else c,
                "covariance_of": None if blind else of,
                "r95_m": None if blind else r95,
                "sigma_max_m": None if blind else sigma,
                "ellipse95": None if blind else {"a_m": a, "b_m": b, "theta_rad": azimuth},
                "triplet": triplet_names(triplet, names),
                "pan_rad": pan,
                "clearance_m": clearance,
                "collision_probability": risk,
            }
        )
    return out


def _times_at(s: FloatArray, trajectory: Trajectory) -> FloatArray:
    """Time at each waypoint, by arc length; waypoints and trajectory follow the same curve."""
    steps = np.hypot(*np.diff(trajectory.points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    if along[-1] <= 0 or s[-1] <= 0:
        return np.zeros_like(s)
    return np.asarray(np.interp(s / s[-1], along / along[-1], trajectory.t))


def _trajectory(trajectory: Trajectory) -> list[dict[str, float | None]]:
    rows = _rounded(
        np.column_stack([trajectory.t, trajectory.points, trajectory.velocity, trajectory.acceleration])
    ).tolist()
    headings: list[float | None] = [None] * len(rows)
    if trajectory.heading is not None:
        headings = numbers(_rounded(trajectory.heading))
    keys = ("t_s", "x_m", "y_m", "vx_m_s", "vy_m_s", "ax_m_s2", "ay_m_s2")
    return [
        {**dict(zip(keys, row, strict=True)), "theta_rad": heading}
        for row, heading in zip(rows, headings, strict=True)
    ]


def _unmet(item: Unmet) -> dict[str, Any]:
    return {
        "bound": item.bound,
        "limit": number(item.limit),
        "value": number(item.value),
        "place": {"x_m": item.place[0], "y_m": item.place[1]},
        "smallest_possible": number(item.smallest_possible),
        "message": item.message,
    }


def _blocked(blocked: Blockage) -> dict[str, Any]:
    return {
        "place": {"x_m": number(blocked.place[0]), "y_m": number(blocked.place[1])},
        "radius_m": blocked.radius,
        "largest_radius_m": number(blocked.largest_radius),
        "between": [f"avoid/{k - 1}" if k else "wall" for k in blocked.between],
        "avoid": [k - 1 for k in blocked.areas],
        "largest_radius_without_avoid_m": number(blocked.radius_without_areas),
    }
