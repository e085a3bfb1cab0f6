"""From what a robot measured to its pose, and how far that can be trusted; as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from api.codec_plan import number
from api.errors import InvalidRequest
from api.place_orders import LocalizeOrder
from localization.camera import Camera
from localization.covariance import area95, ellipse95, r95
from localization.errors import DegenerateGeometry
from localization.fixes import FixStatus, PoseFix
from localization.sensors import OmnidirectionalSensor
from localization.triangulation import locate
from maps.arrays import FloatArray, IntArray
from maps.se2 import wrap
from maps.world import World

#: Good bearings disagree so much once in a thousand times.
CONSISTENT = 0.999
#: Of more bearings none is left out on trial.
_MOST_TRIALS = 100
_WORDS = {
    FixStatus.DEGENERATE: "Landmarks and robot lie on one circle or line: they give no fix.",
    FixStatus.NO_POSE: "No pose sees these landmarks under these bearings; is a landmark misread?",
    FixStatus.SINGULAR: "The bearings do not fix the pose: landmarks and robot lie near one circle.",
    FixStatus.NO_CONVERGENCE: "No pose explains the bearings; is a landmark misread?",
}


def localize(world: World, order: LocalizeOrder) -> dict[str, Any]:
    """Pose and covariance of measured landmarks; the answer of ``POST /v1/localize``.

    Raises
    ------
    InvalidRequest
        If a landmark is not on the map, or a bearing needs a sigma.
    InvalidMeasurement, ColumnOutsideImage
        If a number is impossible.
    """
    marks = indices_of(world, order.landmarks)
    places, survey = world.landmarks.positions[marks], world.landmarks.sigma[marks]
    bearings, sigma = _measured(order)
    try:
        fix, weights = _fix(bearings, places, survey, sigma, order)
    except DegenerateGeometry as error:
        return _answer(world, order, None, str(error))
    if not fix.converged:
        return _answer(world, order, None, _WORDS[fix.status])
    found = _answer(world, order, fix, None)
    rest = _residuals(fix, bearings, places, order)
    found["residuals"] = [
        {"landmark": name, "residual_rad": float(r), "sigma_rad": float(s), "ratio": float(r / s)}
        for name, r, s in zip(order.landmarks, rest, weights, strict=True)
    ]
    if not fix.is_consistent(CONSISTENT):
        suspects = _suspects(bearings, places, weights, order)
        found["status"], found["suspects"] = "ambiguous", suspects
        found["reason"] = (
            f"The bearings contradict one another: good ones do so much with probability {fix.p_value:.1g}."
            + (f" Without {' or '.join(suspects)} the others agree." if suspects else "")
        )
    return found


def indices_of(world: World, names: Sequence[str], place: str = "#") -> IntArray:
    """Indices of landmarks by their ids.

    Raises
    ------
    InvalidRequest
        If one is not there.
    """
    known = {name: i for i, name in enumerate(world.landmarks.ids)}
    for name in names:
        if name not in known:
            raise InvalidRequest(f"There is no landmark '{name[:40]}' on this map.", place=place)
    return np.array([known[name] for name in names], dtype=np.int64)


def _measured(order: LocalizeOrder) -> tuple[FloatArray, FloatArray]:
    """Bearings from the sensor's zero direction, and their standard deviations without the survey's; rad."""
    given = np.array(order.sigma, dtype=np.float64)
    if order.columns is not None:
        sensor = order.sensor
        assert not isinstance(sensor, OmnidirectionalSensor)  # checked where the order is made
        camera = Camera.from_sensor(sensor, principal_px=order.principal_px)
        columns = np.array(order.columns)
        bearings = camera.bearings(columns) + order.pan
        own = np.hypot(camera.bearing_sigma(columns, sensor.column_sigma_px), sensor.bearing_floor)
    else:
        bearings = np.array(order.bearings)
        if isinstance(order.sensor, OmnidirectionalSensor):
            own = np.full(len(bearings), math.hypot(order.sensor.bearing_sigma, order.sensor.bearing_floor))
        elif np.isnan(given).any():
            raise InvalidRequest(
                "A camera measures columns, whose bearings differ in sigma; send columns, or a sigma each.",
                place="#/bearings",
            )
        else:
            own = given
    return bearings, np.where(np.isnan(given), own, given)


def _fix(
    bearings: FloatArray, places: FloatArray, survey: FloatArray, sigma: FloatArray, order: LocalizeOrder
) -> tuple[PoseFix, FloatArray]:
    """The fix, and the standard deviations that weighed the bearings."""
    mount = order.sensor.mount
    fix = locate(bearings, places, sigma, mount=mount)
    if not fix.converged or not survey.any():
        return fix, sigma
    # How much a landmark's survey counts depends on its distance, which is known only now.
    at = fix.pose[:2] + mount.offset(float(fix.pose[2]))
    distance = np.maximum(np.hypot(*(places - at).T), 1e-6)
    weights = np.hypot(sigma, survey / distance)
    return locate(bearings, places, weights, mount=mount), weights


def _residuals(fix: PoseFix, bearings: FloatArray, places: FloatArray, order: LocalizeOrder) -> FloatArray:
    theta = float(fix.pose[2])
    d = places - fix.pose[:2] - order.sensor.mount.offset(theta)
    return wrap(bearings - (np.arctan2(d[:, 1], d[:, 0]) - theta - order.sensor.mount.theta))


def _suspects(
    bearings: FloatArray, places: FloatArray, weights: FloatArray, order: LocalizeOrder
) -> list[str]:
    """Landmarks without which the others agree."""
    if not 5 <= len(bearings) <= _MOST_TRIALS:
        return []  # four without one are three, which always agree
    out = []
    for i, name in enumerate(order.landmarks):
        others = np.arange(len(bearings)) != i
        try:
            fix = locate(bearings[others], places[others], weights[others], mount=order.sensor.mount)
        except DegenerateGeometry:
            continue
        if fix.is_consistent(CONSISTENT):
            out.append(name)
    return out


def _answer(world: World, order: LocalizeOrder, fix: PoseFix | None, reason: str | None) -> dict[str, Any]:
    answer: dict[str, Any] = {
        "status": "degenerate" if fix is None else "ok",
        "reason": reason,
        "measured": len(order.landmarks),
        **dict.fromkeys(
            ("pose", "covariance", "r95_m", "area95_m2", "ellipse95", "sigma_theta_rad", "free", "chi2")
        ),
        "dof": len(order.landmarks) - 3,
        "p_value": None,
        "residuals": [],
        "suspects": [],
    }
    if fix is None:
        return answer
    x, y, theta = fix.pose.tolist()
    P = fix.covariance
    position = P[[0, 0, 1], [0, 1, 1]]
    a, b, azimuth = (float(v) for v in ellipse95(position))
    return answer | {
        "pose": {"x_m": x, "y_m": y, "theta_rad": theta},
        "covariance": P[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]].tolist(),
        "r95_m": float(r95(position)),
        "area95_m2": float(area95(position)),
        "ellipse95": {"a_m": a, "b_m": b, "theta_rad": azimuth},
        "sigma_theta_rad": math.sqrt(float(P[2, 2])),
        "free": bool(world.floor.free_at((x, y))),
        "chi2": number(fix.chi2),
        "p_value": number(fix.p_value),
    }
