"""Monte Carlo of fixes at a pose, as JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from api.codec_plan import number
from api.localizing import indices_of
from api.place_orders import FixesOrder
from localization.covariance import area95, ellipse95
from localization.errors import DegenerateGeometry
from localization.kernels.coverage import is_valid
from localization.ranking import one_triplet
from localization.simulation import FixCloud, simulate_fixes
from localization.triangulation import FixStatus
from maps.arrays import FloatArray
from maps.world import World


def simulated(world: World, order: FixesOrder) -> dict[str, Any]:
    """Simulated fixes in figures and points, or why there are none; the answer of ``POST /v1/fixes``.

    Raises
    ------
    InvalidRequest
        If a landmark is not on the map.
    LocalizationError
        If the three landmarks are not three.
    """
    three = None
    if order.triplet is not None:
        a, b, c = indices_of(world, order.triplet, "#/triplet").tolist()
        three = (a, b, c)
    head = {"estimator": order.estimator, "n": order.count, "seed": order.seed}
    if not bool(world.floor.free_at(order.place)):
        return _nothing(order, head, "A robot cannot stand here: the place is not free floor.")
    try:
        cloud = simulate_fixes(
            world,
            order.sensor,
            order.place,
            heading=order.heading,
            triplet=three,
            estimator=order.estimator,
            n=order.count,
            rng=np.random.default_rng(order.seed),
        )
    except DegenerateGeometry as error:
        return _nothing(order, head, str(error))
    predicted = math.nan
    if order.estimator == "best_triplet":
        i, j, k = cloud.triplet
        choice = one_triplet(world, order.sensor, order.place, (i, j, k), heading=order.heading)
        predicted = math.nan if choice is None else choice.validity
    return _figures(world, order, head, cloud, predicted)


def _figures(
    world: World, order: FixesOrder, head: dict[str, Any], cloud: FixCloud, predicted: float
) -> dict[str, Any]:
    share, known = cloud.share_inside, not math.isnan(predicted)
    reason = None
    if cloud.failures == len(cloud.fixes):
        reason = "No measurement gave a fix."
    elif known and not is_valid(predicted):
        share_words = f"About {100 * predicted:.0f} % of fixes lie inside the 95 % ellipse"
        reason = f"{share_words}: first order does not hold here."
    x, y, theta = cloud.pose.tolist()
    failures = {s.name.lower(): cloud.fixes.count(s) for s in FixStatus if s is not FixStatus.OK}
    bias = [number(v) for v in cloud.bias.tolist()]
    return {
        "status": "ok",
        "reason": reason,
        "pose": {"x_m": x, "y_m": y, "theta_rad": theta},
        **head,
        "landmarks": [world.landmarks.ids[i] for i in cloud.triplet],
        "pan_rad": number(cloud.pan),
        "failures": {name: count for name, count in failures.items() if count},
        "share_inside": share,
        "predicted_share": number(predicted),
        "valid": bool(is_valid(predicted)) if known else None,
        "predicted": _spread(cloud.predicted),
        "sample": _spread(cloud.sample_covariance),
        "bias": dict(zip(("x_m", "y_m", "theta_rad"), bias, strict=True)),
        "cloud": _points(cloud, order.points),
    }


def _points(cloud: FixCloud, most: int) -> dict[str, list[Any]]:
    """The first fixes, as columns: they are drawn at random, so that the first are as good as any."""
    ok = np.flatnonzero(cloud.fixes.ok)[:most]
    pose = cloud.fixes.pose[ok]
    return {
        "x_m": pose[:, 0].tolist(),
        "y_m": pose[:, 1].tolist(),
        "theta_rad": pose[:, 2].tolist(),
        "inside": cloud.inside[ok].tolist(),
    }


def _spread(covariance: FloatArray) -> dict[str, Any] | None:
    if np.isnan(covariance).any():
        return None
    position = covariance[[0, 0, 1], [0, 1, 1]]
    a, b, azimuth = (float(v) for v in ellipse95(position))
    return {
        "covariance": covariance[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]].tolist(),
        "area95_m2": float(area95(position)),
        "ellipse95": {"a_m": a, "b_m": b, "theta_rad": azimuth},
        "sigma_theta_rad": math.sqrt(float(covariance[2, 2])),
    }


def _nothing(order: FixesOrder, head: dict[str, Any], reason: str) -> dict[str, Any]:
    names = ("pan_rad", "share_inside", "predicted_share", "valid", "predicted", "sample", "bias", "cloud")
    x, y = order.place
    return {
        "status": "no_fix",
        "reason": reason,
        "pose": {"x_m": x, "y_m": y, "theta_rad": order.heading},
        **head,
        "landmarks": list(order.triplet or ()),
        "failures": {},
        **dict.fromkeys(names),
    }
