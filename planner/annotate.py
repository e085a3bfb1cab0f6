"""Everything that is known along a path, recomputed from the path itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from localization import covariance as cov
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, IntArray
from maps.kernels.clearance import segments_distance
from maps.se2 import wrap
from planner.context import PlanningContext
from planner.cost_space import CostArrays, CostSpace
from planner.kernels.line_cost import motion_cost, polyline_pieces
from planner.result import Path, Route, RouteSummary, Trajectory
from planner.risk import collision_risk

#: Waypoints are at most this far apart, m, or one cell where cells are larger.
SPACING_M = 0.25
# A waypoint's chord leaves the path by at most this, m.
_CHORD_M = 1e-3


def annotate(
    trajectory: Trajectory,
    context: PlanningContext,
    cost_space: CostSpace,
    *,
    cost: float | None = None,
    stops: Sequence[int] = (),
) -> Route:
    """Route of a trajectory: waypoints with covariance, triplet, pan and clearance, and its figures.

    Parameters
    ----------
    trajectory
        The motion; the path is the polyline of its samples.
    context
        Field and clearance.
    cost_space
        Robot and rates; the path must be valid in it.
    cost
        Cost to report; None: the exact cost in ``cost_space``.
    stops
        Samples that are waypoints in any case, ascending.

    Returns
    -------
    route
        Waypoints are at most ``max(SPACING_M, cell)`` apart; their values are those of the cell that the
        path leaves or enters there, on a border of two cells those of the worse one. Means are exact
        integrals over the cells that the path crosses, worst values the largest of these cells. ``pan`` is
        relative to the direction of travel, or, for a sensor whose field depends on the heading, to the
        heading for which the field was computed.
    """
    field = context.field
    points = np.array(trajectory.points, dtype=np.float64, order="C")
    steps = np.hypot(*np.diff(points, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    rows, cols, lengths, begins = _cells_along(points, field, context.r95, arc)
    at = _waypoints(points, arc, cost_space, stops)
    s = arc[at]
    cell = np.clip(np.searchsorted(begins, s, side="right") - 1, 0, len(begins) - 1)
    path = _path(points[at], s, rows[cell], cols[cell], context, cost_space.radius)

    kept = _smallest_clearance(points, cost_space)
    probability, bound = path.collision_probability, path.collision_bound
    judged = bool(np.isfinite(bound).any())
    exact = cost_space.line_cost(points) if cost is None else cost
    summary = RouteSummary(
        cost=exact,
        length=float(arc[-1]),
        duration=trajectory.duration,
        min_clearance=kept - cost_space.radius,
        max_collision_probability=float(np.nanmax(probability)) if judged else None,
        max_collision_bound=float(np.nanmax(bound)) if judged else None,
        **_uncertainty(field, rows, cols, lengths, begins),
    )
    return Route(path, trajectory, summary)


def _cells_along(
    points: FloatArray, field: UncertaintyField, r95: FloatArray, arc: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Cells that the path crosses in order: row, column, length, m, and arc length where it enters, m."""
    cells = field.frame.to_grid(points)
    if arc[-1] == 0.0:
        row, col = np.clip(field.frame.cell_at(points[0]), 0, np.array(field.frame.shape) - 1)
        zero = np.zeros(1)
        return np.array([row]), np.array([col]), zero, zero
    pieces = polyline_pieces(cells, r95)
    rows, cols, rows2, cols2 = pieces[:, :4].astype(np.int64).T
    ny, nx = field.frame.shape
    rows, cols, rows2, cols2 = (
        np.clip(v, 0, n - 1) for v, n in ((rows, ny), (cols, nx), (rows2, ny), (cols2, nx))
    )
    here, beside = r95[rows, cols], r95[rows2, cols2]
    swap = np.isnan(beside) | (beside > here)
    rows, cols = np.where(swap, rows2, rows), np.where(swap, cols2, cols)
    lengths = pieces[:, 4] * field.frame.resolution
    begins = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    return rows, cols, lengths, begins * (arc[-1] / lengths.sum())


def _waypoints(
    points: FloatArray, arc: FloatArray, cost_space: CostSpace, stops: Sequence[int] = ()
) -> IntArray:
    """Indices of samples: as far apart as spacing, a chord within 1 mm of the path and validity allow."""
    spacing = max(SPACING_M, cost_space.frame.resolution)
    out = [0]
    last = len(points) - 1
    ahead = [*stops, last]
    args = cost_space.kernel_args
    while out[-1] < last:
        i = out[-1]
        while ahead[0] <= i:
            ahead.pop(0)
        j = int(np.searchsorted(arc, arc[i] + spacing * (1 + 1e-9), side="right")) - 1
        j = min(max(j, i + 1), ahead[0])
        while j > i + 1 and not _is_chord(points, i, j, args):
            j = i + 1 + (j - i - 1) // 2
        out.append(j)
    return np.array(out)


def _is_chord(points: FloatArray, i: int, j: int, args: CostArrays) -> bool:
    (ax, ay), (bx, by) = points[i], points[j]
    length = math.hypot(bx - ax, by - ay)
    if length <= _CHORD_M:
        return False
    between = points[i + 1 : j]
    across = (between[:, 0] - ax) * (by - ay) - (between[:, 1] - ay) * (bx - ax)
    if len(across) and max(across.max(), -across.min()) > _CHORD_M * length:
        return False
    return bool(motion_cost(ax, ay, bx, by, *args) < math.inf)


def _path(
    points: FloatArray, s: FloatArray, rows: IntArray, cols: IntArray, context: PlanningContext, radius: float
) -> Path:
    field = context.field
    if len(points) > 1:
        d = np.diff(points, axis=0)
        heading = np.arctan2(d[:, 1], d[:, 0])
        heading = np.asarray(wrap(np.concatenate([heading, heading[-1:]])))
    else:
        heading = np.zeros(1)
    pan = field.pan[rows, cols]
    if not field.sensor.depends_on_heading:
        pan = np.asarray(wrap(field.heading + pan - heading))
    covariance = field.covariance[rows, cols]
    risk = collision_risk(context.clearance, points, covariance, radius)
    return Path(
        points=points,
        s=s,
        heading=heading,
        covariance=covariance,
        r95=context.r95[rows, cols],
        triplet=field.triplet[rows, cols],
        pan=pan,
        clearance=context.clearance.distance(points) - radius,
        collision_probability=risk.tight,
        collision_bound=risk.rigorous,
    )


def _smallest_clearance(points: FloatArray, cost_space: CostSpace) -> float:
    if len(points) == 1:
        return float(cost_space.clearance.distance(points)[0])
    queries = np.concatenate([points[:-1], points[1:]], axis=1)
    out = np.empty(len(queries))
    segments_distance(queries, math.inf, out, *cost_space.clearance.arrays)
    return float(out.min())


class _Uncertainty(TypedDict):
    mean_r95: float | None
    max_r95: float | None
    max_area95: float | None
    max_ellipse95: float | None
    worst_at: float | None
    blind: float
    longest_blind: float


def _uncertainty(
    field: UncertaintyField, rows: IntArray, cols: IntArray, lengths: FloatArray, begins: FloatArray
) -> _Uncertainty:
    covariance = field.covariance[rows, cols]
    r95 = cov.r95(covariance)
    fix = np.isfinite(r95)
    blind = float(lengths[~fix].sum())
    longest = _longest_run(lengths, ~fix)
    if not fix.any():
        return _Uncertainty(
            mean_r95=None,
            max_r95=None,
            max_area95=None,
            max_ellipse95=None,
            worst_at=None,
            blind=blind,
            longest_blind=longest,
        )
    known, covariance, lengths = r95[fix], covariance[fix], lengths[fix]
    worst = int(np.argmax(known))
    driven = float(lengths.sum())
    return _Uncertainty(
        mean_r95=float(known @ lengths) / driven if driven > 0 else float(known[worst]),
        max_r95=float(known[worst]),
        max_area95=float(cov.area95(covariance).max()),
        max_ellipse95=float(cov.ellipse95(covariance)[:, 0].max()),
        worst_at=float(begins[fix][worst] + 0.5 * lengths[worst]),
        blind=blind,
        longest_blind=longest,
    )


def _longest_run(lengths: FloatArray, counted: BoolArray) -> float:
    """Largest sum of lengths (N,) that follow each other without one that is not counted."""
    so_far = np.cumsum(np.where(counted, lengths, 0.0))
    at_gaps = np.maximum.accumulate(np.where(counted, 0.0, so_far))
    return float((so_far - at_gaps).max(initial=0.0))
