"""Simulations as JSON, and the trajectory of a plan's answer as a value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from api.codec import DocumentError
from api.codec_plan import engine_version, number
from localization.consistency import Coverage
from localization.covariance import ellipse95
from maps.arrays import FloatArray
from planner.result import Trajectory

if TYPE_CHECKING:
    from planner.simulation import SimulatedRobot
    from planner.simulation_report import SimulationReport, Stations

_KEYS = ("t_s", "x_m", "y_m", "vx_m_s", "vy_m_s", "ax_m_s2", "ay_m_s2")


def trajectory_of_answer(answer: dict[str, Any]) -> Trajectory:
    """Trajectory of the first route of an answer of ``POST /v1/plans``.

    Raises
    ------
    DocumentError
        If there is none, or it is not made of finite numbers.
    """
    routes = answer.get("routes")
    if not isinstance(routes, list):
        raise DocumentError("The plan has no 'routes'; give what 'surepath plan -o' writes.")
    if not routes:
        raise DocumentError("The plan has no route: there is nothing to drive.")
    samples = routes[0].get("trajectory") if isinstance(routes[0], dict) else None
    if not isinstance(samples, list) or not samples:
        raise DocumentError("The plan's route has no 'trajectory'; give what 'surepath plan -o' writes.")
    rows = np.array([[_number(sample, k, key) for key in _KEYS] for k, sample in enumerate(samples)])
    heading = headings_of([sample.get("theta_rad") for sample in samples])
    return Trajectory(rows[:, 0], rows[:, 1:3], rows[:, 3:5], rows[:, 5:7], heading)


def headings_of(values: Sequence[Any]) -> FloatArray | None:
    """Headings (K,) of the samples of a trajectory, rad; None where not all of them have one."""
    if any(isinstance(v, bool) or not isinstance(v, (int, float)) or not math.isfinite(v) for v in values):
        return None
    return np.array(values, dtype=np.float64)


def footprint_of_answer(answer: dict[str, Any]) -> FloatArray | None:
    """Corners (K, 2) of the outline that a plan was made for, m; None: a disc.

    Raises
    ------
    DocumentError
        If they are not made of finite numbers.
    """
    request = answer.get("request")
    robot = request.get("robot") if isinstance(request, dict) else None
    corners = robot.get("footprint") if isinstance(robot, dict) else None
    if corners is None:
        return None
    try:
        outline = np.array([[c["x_m"], c["y_m"]] for c in corners], dtype=np.float64)
    except (TypeError, KeyError, ValueError):
        outline = np.empty((0, 2))
    if not len(outline) or not np.isfinite(outline).all():
        raise DocumentError("The plan's footprint is no list of corners, x_m and y_m; give --radius.")
    return outline


def radius_of_answer(answer: dict[str, Any]) -> float:
    """Radius of the robot that a plan was made for, m.

    Raises
    ------
    DocumentError
        If the plan does not say.
    """
    request = answer.get("request")
    robot = request.get("robot") if isinstance(request, dict) else None
    radius = robot.get("radius_m") if isinstance(robot, dict) else None
    if isinstance(radius, bool) or not isinstance(radius, (int, float)) or not math.isfinite(radius):
        raise DocumentError("The plan does not say the robot's radius; give --radius.")
    return float(radius)


def simulation_to_json(
    report: SimulationReport, robot: SimulatedRobot, *, world: str, plan: str | None, seed: int
) -> dict[str, Any]:
    """A simulation in figures; null where a number is not defined.

    Parameters
    ----------
    report, robot
        What came of it, and what was driven.
    world, plan
        Their names.
    seed
        Of the noise.
    """
    return {
        "world": world,
        "plan": plan,
        "engine": engine_version(),
        "runs": report.runs,
        "seed": seed,
        "robot": _robot(robot),
        "length_m": number(float(report.reference.s[-1])),
        "duration_s": number(float(report.reference.times[-1])),
        "collisions": {
            "count": report.collisions,
            **_share(report.collision),
            "places": [
                {"x_m": x, "y_m": y, "s_m": s}
                for (x, y), s in zip(
                    report.collision_places.tolist(), report.collision_s.tolist(), strict=True
                )
            ],
        },
        "worst_deviation": _quantiles(report.worst_deviation),
        "goal_error": _quantiles(report.goal_error),
        "rms_error_m": number(report.mean_error),
        "ellipse95": {"claimed": _share(report.coverage), "predicted": _share(report.predicted_coverage)},
        "nees": {
            "mean": number(report.nees.value),
            "low": number(report.nees.low),
            "high": number(report.nees.high),
            "dof": report.nees.dof,
        },
        "blind": {"time_share": number(report.blind_share), "longest": _quantiles(report.max_blind)},
        "stations": _stations(report.stations),
    }


def _number(sample: Any, index: int, key: str) -> float:
    value = sample.get(key) if isinstance(sample, dict) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise DocumentError(f"Sample {index} of the plan's trajectory has no finite '{key}'.")
    return float(value)


def _robot(robot: SimulatedRobot) -> dict[str, Any]:
    noise = robot.odometry
    return {
        "radius_m": robot.radius if robot.footprint is None else None,
        "footprint_m": None if robot.footprint is None else robot.footprint.tolist(),
        "steering": robot.steering,
        "min_turn_radius_m": robot.min_turn_radius,
        "mode": robot.mode,
        "policy": robot.policy,
        "view_margin_rad": robot.view_margin,
        "fix_rate_hz": robot.fix_rate,
        "step_s": robot.step,
        "odometry": {
            "distance_sigma": noise.distance_sigma,
            "turn_sigma": noise.turn_sigma,
            "drift_sigma": noise.drift_sigma,
            "slip_sigma": noise.slip_sigma,
        },
    }


def _share(share: Coverage) -> dict[str, Any]:
    return {
        "share": number(share.share),
        "low": number(share.low),
        "high": number(share.high),
        "level": share.level,
    }


def _quantiles(values: FloatArray) -> dict[str, float | None]:
    known = values[np.isfinite(values)]
    if not len(known):
        return {"median_m": None, "q95_m": None, "max_m": None}
    median, high, largest = (float(v) for v in np.quantile(known, [0.5, 0.95, 1.0]))
    return {"median_m": median, "q95_m": high, "max_m": largest}


def _stations(at: Stations) -> list[dict[str, Any]]:
    low, high = at.displaced_bounds()
    columns: dict[str, npt.ArrayLike] = {
        "s_m": at.s,
        "t_s": at.times,
        "x_m": at.poses[:, 0],
        "y_m": at.poses[:, 1],
        "theta_rad": at.poses[:, 2],
        "deviation_median_m": at.deviation[:, 0],
        "deviation_q95_m": at.deviation[:, 1],
        "deviation_max_m": at.deviation[:, 2],
        "error_median_m": at.error[:, 0],
        "error_q95_m": at.error[:, 1],
        "predicted_r95_m": at.predicted_r95,
        "sample_r95_m": at.sample_r95,
        "inside_claimed": at.coverage,
        "inside_predicted": at.predicted_coverage,
        "nees": at.nees,
        "displaced_collision": at.displaced,
        "displaced_collision_low": low,
        "displaced_collision_high": high,
    }
    rows = np.column_stack(list(columns.values())).tolist()
    ellipses = ellipse95(at.predicted).tolist()
    out = []
    for row, n, (a, b, azimuth) in zip(rows, at.n.tolist(), ellipses, strict=True):
        named: dict[str, Any] = {key: number(value) for key, value in zip(columns, row, strict=True)}
        out.append({**named, "runs": n, "predicted_ellipse95": {"a_m": a, "b_m": b, "theta_rad": azimuth}})
    return out
