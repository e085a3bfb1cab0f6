"""Routes told by single fixes, with dead reckoning where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from localization import covariance as cov
from localization.motion import OdometryModel
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray
from planner.context import PlanningContext
from planner.fused_belief import as_packed, fix_covariance_in
from planner.kernels.belief import reckoned
from planner.result import Route


def with_dead_reckoning(
    route: Route, context: PlanningContext, odometry: OdometryModel, start: FloatArray | None
) -> Route:
    """The route with a covariance at waypoints without a fix, too: that of the last fix, grown since.

    Figures of the route and collision probabilities stay those of single fixes.

    Parameters
    ----------
    route
        As annotated from single fixes.
    context
        The field.
    odometry
        By which the covariance grows.
    start
        Covariance (3, 3) at the start for a stretch that begins there; None: it stays unknown.
    """
    path = route.path
    assert path.has_fix is not None
    known = np.asarray(path.has_fix)
    if known.all() or len(known) < 2:
        return route
    fixes = np.full((len(known), 6), np.nan)
    # Position alone is enough where the next waypoint has a fix again.
    fixes[known, :3], fixes[known, 3:] = path.covariance[known], 0.0
    for k in np.flatnonzero(known[:-1] & ~known[1:]):
        row, col = _cell_of(context.field, path.points[k], path.covariance[k])
        fixes[k] = as_packed(fix_covariance_in(context.field, row, col))
    if not known[0] and start is not None:
        fixes[0] = as_packed(start)
    ways = np.diff(path.points, axis=0)
    out = np.empty_like(fixes)
    directions = np.arctan2(ways[:, 1], ways[:, 0])
    reckoned(fixes, np.hypot(ways[:, 0], ways[:, 1]), directions, odometry.kernel_args, out)
    covariance = np.where(known[:, None], path.covariance, out[:, :3])
    told = replace(path, covariance=covariance, r95=np.where(known, path.r95, cov.r95(covariance)))
    return replace(route, path=told)


def _cell_of(field: UncertaintyField, point: FloatArray, covariance: FloatArray) -> tuple[int, int]:
    """The cell that a waypoint's covariance was read from: its own, or on a border the one beside it."""
    row, col = (int(v) for v in field.frame.cell_at(point))
    ny, nx = field.frame.shape
    near = [(r, c) for r in (row, row - 1, row + 1) for c in (col, col - 1, col + 1)]
    inside = [(r, c) for r, c in near if 0 <= r < ny and 0 <= c < nx]
    return min(inside, key=lambda cell: not np.array_equal(field.covariance[cell], covariance))
