"""Routes told by the filter's belief instead of single fixes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from localization import covariance as cov
from localization.propagation import PathBelief
from maps.arrays import FloatArray, IntArray
from planner.context import PlanningContext
from planner.result import Route
from planner.risk import collision_risk


def with_belief(route: Route, belief: PathBelief, context: PlanningContext, radius: float) -> Route:
    """The route with the filter's covariance at every waypoint, and figures of it.

    A waypoint has the least certain belief half way to its neighbours; means are over the length driven. How
    far it drives without a fix stays that of the field's cells.

    Parameters
    ----------
    route
        As annotated from single fixes.
    belief
        The filter along the same path.
    context
        For clearance.
    radius
        Of the robot, m.
    """
    poses = belief.drive.poses
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    path = route.path
    scale = path.s[-1] / along[-1] if along[-1] > 0 else 1.0
    along = along * scale
    r95 = belief.r95
    worst = _worst_between(path.s, along, r95)
    covariance = belief.position_covariance[worst]
    risk = collision_risk(context.clearance, path.points, covariance, radius)
    told = replace(
        path,
        covariance=covariance,
        r95=r95[worst],
        collision_probability=risk.tight,
        collision_bound=risk.rigorous,
        kind="fused",
    )
    k = int(np.argmax(r95))
    lengths = np.diff(along)
    mean = float(0.5 * (r95[1:] + r95[:-1]) @ lengths / along[-1]) if along[-1] > 0 else float(r95.max())
    every = belief.position_covariance
    summary = replace(
        route.summary,
        mean_r95=mean,
        max_r95=float(r95[k]),
        max_area95=float(cov.area95(every).max()),
        max_ellipse95=float(cov.ellipse95(every)[:, 0].max()),
        worst_at=float(along[k]),
        max_collision_probability=float(risk.tight.max()),
        max_collision_bound=float(risk.rigorous.max()),
    )
    return replace(route, path=told, summary=summary)


def _worst_between(s: FloatArray, along: FloatArray, r95: FloatArray) -> IntArray:
    """For each waypoint at s (N,), the station with the largest r95 half way to its neighbours."""
    middle = 0.5 * (s[1:] + s[:-1])
    low = np.searchsorted(along, np.concatenate([[-np.inf], middle]), side="left")
    high = np.searchsorted(along, np.concatenate([middle, [np.inf]]), side="right")
    nearest = np.clip(np.searchsorted(along, s), 0, len(along) - 1)
    out = nearest.astype(np.int64)
    for k, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        if b > a:
            out[k] = a + int(np.argmax(r95[a:b]))
    return out
