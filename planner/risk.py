"""Collision probability of a disc from the covariance of its place and the exact clearance around it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray, FloatArray, frozen
from maps.clearance import TOUCH_M, ClearanceIndex
from maps.grid import GridFrame
from planner.clock import Stopped
from planner.errors import InvalidProblem
from planner.kernels.risk import bounds_at, likely, too_risky

#: Sectors of the direction-aware bound where it is reported, and where cells are sorted out.
REPORTED_SECTORS = 128
_MASK_SECTORS = 64
_ROWS_PER_TASK = 1024
# Rounding must not take a cell for far.
_SURELY = 1.0 + 1e-9

Stop = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class CollisionRisk:
    """Bounds on the probability that the robot touches something, per place.

    Attributes
    ----------
    rigorous
        Shape (N,): ``exp(-c² / (2 λ_max))`` with c the clearance beyond the robot's radius (MATH §8); holds
        whatever the direction of the error. NaN without a covariance.
    tight
        Shape (N,): the smaller of that and the direction-aware bound (see ``planner.kernels.risk``), which
        is as rigorous.
    """

    rigorous: FloatArray
    tight: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "rigorous", frozen(self.rigorous))
        object.__setattr__(self, "tight", frozen(self.tight))


def collision_risk(
    clearance: ClearanceIndex, points: npt.ArrayLike, covariances: npt.ArrayLike, radius: float
) -> CollisionRisk:
    """Bounds on the collision probability of a disc at each of some places.

    Parameters
    ----------
    clearance
        Of the floor.
    points
        Shape (N, 2): expected places of the centre, W, m.
    covariances
        Shape (N, 3): xx, xy, yy of its error, m²; NaN where unknown.
    radius
        Of the disc, m.

    Raises
    ------
    InvalidProblem
        If the shapes do not fit.
    """
    # Copies may be written, so that the kernel is compiled for one kind of array.
    p = np.array(points, dtype=np.float64, order="C")
    c = np.array(covariances, dtype=np.float64, order="C")
    if p.ndim != 2 or p.shape[1] != 2 or c.shape != (len(p), 3):
        raise InvalidProblem(f"Points {p.shape} and covariances {c.shape}; give (N, 2) and (N, 3).")
    rigorous, sector = np.empty(len(p)), np.empty(len(p))
    inside = np.asarray(clearance.distance(p)) > 0
    bounds_at(p, c, max(radius, TOUCH_M), REPORTED_SECTORS, rigorous, sector, *clearance.arrays)
    for bound in (rigorous, sector):
        bound[~inside & ~np.isnan(bound)] = 1.0
    return CollisionRisk(rigorous, np.minimum(rigorous, sector))


def risky_cells(
    clearance: ClearanceIndex,
    frame: GridFrame,
    centre_clearance: FloatArray,
    covariances: FloatArray,
    *,
    radius: float,
    limit: float,
    among: BoolArray | None = None,
    stop: Stop | None = None,
    threads: int | None = None,
) -> BoolArray:
    """Cells at whose centre the collision probability may exceed a limit.

    Parameters
    ----------
    clearance
        Of the floor.
    frame
        Of the cells.
    centre_clearance
        Shape (ny, nx): clearance of the centres, m; 0 where they are not free.
    covariances
        Shape (ny, nx, 3): xx, xy, yy, m²; NaN where unknown, there nothing is said (False).
    radius
        Of the robot's disc, m.
    limit
        Probability per pose.
    among
        Shape (ny, nx): cells to judge, the others are False; None: all.
    stop
        Shape (1,); another thread sets it to end early.
    threads
        Default: one per core. The result does not depend on it.

    Raises
    ------
    InvalidProblem
        If the limit is not between 0 and 1.
    Stopped
        If the flag was set before the end.
    """
    if not 0 < limit < 1:
        raise InvalidProblem(f"The collision probability is limited to {limit}; it must be between 0 and 1.")
    need = max(radius, TOUCH_M)
    variance = covariances[..., 0] + covariances[..., 2]
    judged = (centre_clearance > 0) & ~np.isnan(variance)
    if among is not None:
        judged &= among
    # The trace is above the largest variance: with this much room the coarse bound is below the limit.
    with np.errstate(invalid="ignore"):
        far = (centre_clearance - need) ** 2 > -2.0 * math.log(limit) * _SURELY * variance
    near = centre_clearance <= need
    out = judged & near

    def judge(points: FloatArray, known: FloatArray, c: FloatArray, out: BoolArray) -> None:
        too_risky(points, known, c, need, limit, _MASK_SECTORS, out, *clearance.arrays)

    _over_cells(judge, judged & ~near & ~far, frame, centre_clearance, covariances, out, stop, threads)
    return out


def cell_probabilities(
    clearance: ClearanceIndex,
    frame: GridFrame,
    centre_clearance: FloatArray,
    covariances: FloatArray,
    *,
    radius: float,
    among: BoolArray | None = None,
    stop: Stop | None = None,
    threads: int | None = None,
) -> FloatArray:
    """Shape (ny, nx): bound on the collision probability at the centre of each free cell; else NaN.

    Arguments as of :func:`risky_cells`, which closes the cells whose number here is above its limit.
    """

    def judge(points: FloatArray, known: FloatArray, c: FloatArray, out: FloatArray) -> None:
        likely(points, known, c, max(radius, TOUCH_M), _MASK_SECTORS, out, *clearance.arrays)

    out = np.full(centre_clearance.shape, np.nan)
    free = centre_clearance > 0
    _over_cells(
        judge,
        free if among is None else free & among,
        frame,
        centre_clearance,
        covariances,
        out,
        stop,
        threads,
    )
    return out


def _over_cells(
    judge: Callable[..., None],
    cells: BoolArray,
    frame: GridFrame,
    centre_clearance: FloatArray,
    covariances: FloatArray,
    out: npt.NDArray[Any],
    stop: Stop | None,
    threads: int | None,
) -> None:
    """Fill ``out`` at some cells, in several threads."""
    index = np.flatnonzero(cells)
    points = frame.to_world(np.stack([index % frame.n_cols, index // frame.n_cols], axis=-1) + 0.5)
    known = np.ascontiguousarray(centre_clearance.ravel()[index])
    c = np.ascontiguousarray(covariances.reshape(-1, 3)[index])
    found = np.empty(len(index), dtype=out.dtype)

    def work(first: int) -> None:
        if stop is None or stop[0] == 0:
            at = slice(first, first + _ROWS_PER_TASK)
            judge(points[at], known[at], c[at], found[at])

    with ThreadPoolExecutor(max(1, threads or os.cpu_count() or 1)) as pool:
        list(pool.map(work, range(0, len(index), _ROWS_PER_TASK)))
    if stop is not None and stop[0] != 0:
        raise Stopped
    out.ravel()[index] = found


def warm_up(clearance: ClearanceIndex, frame: GridFrame, centre_clearance: FloatArray) -> None:
    """Compile or load the kernels: cells of a floor are judged as if fixes were off by a decimetre."""
    covariances = np.tile([0.01, 0.0, 0.01], (*frame.shape, 1))
    args = (clearance, frame, centre_clearance, covariances)
    risky_cells(*args, radius=0.1, limit=0.05)
    cell_probabilities(*args, radius=0.1)
    collision_risk(clearance, np.zeros((1, 2)), np.zeros((1, 3)), 0.1)
