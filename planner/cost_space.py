"""What a motion costs and where it may go: the one measure that all stages of the planner share."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray, FloatArray, frozen
from maps.clearance import TOUCH_M, ClearanceIndex
from maps.grid import GridFrame
from planner.kernels.line_cost import motions_cost, polyline_cost

CostArrays = tuple[
    FloatArray,
    FloatArray,
    float,
    FloatArray,
    npt.NDArray[np.int64],
    npt.NDArray[np.int32],
    npt.NDArray[np.int32],
    FloatArray,
]


@dataclass(frozen=True, slots=True, eq=False)
class CostSpace:
    """Cost per metre in every cell, and the room that a disc has.

    A motion is valid when its exact clearance is at least the radius and every cell that it enters has a
    finite rate. Its cost is the exact integral of the rate; along a border of two cells the larger rate
    counts, a corner is in the cells that are entered only.

    Attributes
    ----------
    frame
        The cells.
    rate
        Shape (ny, nx), 1/m: cost per metre, ``1 + weight · r95``; inf where the robot must not be.
    passable
        Shape (ny, nx): cells that the grid search uses: finite rate and centre clearance of at least
        ``√(radius² + resolution²/2)``, so that every 8-connected move between two of them is valid.
    centre_clearance
        Shape (ny, nx), m: exact clearance of the cell centres, 0 where they are not free.
    clearance
        For exact clearance of points and motions.
    radius
        Of the robot, m.
    weight
        Of r95 in the rate, 1/m.
    transform
        Shape (5,): corner of cell (0, 0) in W, cosine and sine of the yaw, side of a cell, m.
    """

    frame: GridFrame
    rate: FloatArray
    passable: BoolArray
    centre_clearance: FloatArray
    clearance: ClearanceIndex
    radius: float
    weight: float
    transform: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        for name, dtype in (("rate", np.float64), ("passable", np.bool_), ("centre_clearance", np.float64)):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype))
        f = self.frame
        values = (f.origin_x, f.origin_y, math.cos(f.yaw), math.sin(f.yaw), f.resolution)
        object.__setattr__(self, "transform", frozen(values))

    @property
    def need(self) -> float:
        """Clearance that the robot's centre must keep, m: the radius up to rounding (1 nm), never 0."""
        return max(self.radius - TOUCH_M, TOUCH_M)

    @property
    def kernel_args(self) -> CostArrays:
        """What the kernels of ``planner.kernels.line_cost`` take after the motion: rate, transform, …."""
        return (self.rate, self.transform, self.need, *self.clearance.arrays)

    def line_cost(self, points: npt.ArrayLike) -> float:
        """Cost of a polyline.

        Parameters
        ----------
        points
            Shape (K, 2), W, m, K ≥ 1.

        Returns
        -------
        cost
            ``∫ rate ds``; inf when a motion is not valid. One point, or motions without length, cost 0
            where the robot may stand.
        """
        p = np.array(points, dtype=np.float64, order="C").reshape(-1, 2)
        return float(polyline_cost(p, *self.kernel_args)) if len(p) else 0.0

    def motion_costs(self, start: npt.ArrayLike, end: npt.ArrayLike) -> FloatArray:
        """Costs of straight motions; ``start`` and ``end`` broadcast to shape (N, 2), W, m."""
        a, b = np.broadcast_arrays(np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64))
        queries = np.concatenate([a, b], axis=-1).reshape(-1, 4)
        out = np.empty(len(queries))
        motions_cost(queries, out, *self.kernel_args)
        return out

    def centre(self, rows: npt.ArrayLike, cols: npt.ArrayLike) -> FloatArray:
        """Centres of cells, W, m; shape (..., 2)."""
        c = np.asarray(cols, dtype=np.float64) + 0.5
        r = np.asarray(rows, dtype=np.float64) + 0.5
        return self.frame.to_world(np.stack([c, r], axis=-1))


def passable_clearance(radius: float, resolution: float) -> float:
    """Clearance of a cell's centre from which all 8 moves to such neighbours keep ``radius``, m.

    An obstacle point at least that far from both ends of a move of length ``d ≤ √2 · resolution`` is at
    least ``√(radius² + resolution²/2 − d²/4) ≥ radius`` from every point between.
    """
    return math.sqrt(radius**2 + 0.5 * resolution**2)


def cost_space_for(
    frame: GridFrame,
    free: BoolArray,
    r95: FloatArray,
    clearance: ClearanceIndex,
    centre_clearance: FloatArray,
    *,
    radius: float,
    weight: float,
    max_r95: float | None = None,
    blind_rate: float | None = None,
    forbidden: BoolArray | None = None,
    factor: FloatArray | None = None,
) -> CostSpace:
    """Cost space of a field for one robot and one question.

    Parameters
    ----------
    frame, free, r95
        Cells of the field, whether their centres are free, and r95, m, NaN where there is no fix.
    clearance, centre_clearance
        Of the field's world, and at the cell centres.
    radius
        Of the robot, m.
    weight
        Of r95 in the cost per metre, 1/m; 0 counts length only.
    max_r95
        Cells with a fix worse than this are forbidden, m; None: no bound.
    blind_rate
        Cost per metre where there is no fix, ≥ 1; None forbids such cells.
    forbidden, factor
        Shape (ny, nx): further cells to keep out of, and factors of the cost per metre; None: none.

    Returns
    -------
    cost_space
        Cells whose centre is not free are forbidden.
    """
    rate = 1.0 + weight * r95
    if max_r95 is not None:
        with np.errstate(invalid="ignore"):
            rate[r95 > max_r95] = np.inf
    rate[np.isnan(r95)] = np.inf if blind_rate is None else blind_rate
    if factor is not None:
        rate *= factor
    if forbidden is not None:
        rate[forbidden] = np.inf
    rate[~free] = np.inf
    passable = np.isfinite(rate) & (centre_clearance >= passable_clearance(radius, frame.resolution))
    for array in (rate, passable):
        array.flags.writeable = False
    return CostSpace(frame, rate, passable, centre_clearance, clearance, radius, weight)
