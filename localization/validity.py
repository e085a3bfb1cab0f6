"""How true the 95 % ellipses of a field are: predicted shares of fixes beside simulated ones (MAS97 §5.2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from localization.covariance import CHI2_95
from localization.errors import LocalizationError
from localization.field_builder import build_field
from localization.kernels.coverage import NOMINAL_SHARE, VALID_TOLERANCE
from localization.sensors import Sensor
from localization.simulation import FixCloud, simulate_fixes
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.world import World

#: A cell marked valid must hold 95 % of the simulated fixes, give or take this.
MAX_DEVIATION = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class CoverageStudy:
    """Cells of a field, each with n simulated fixes of its triplet.

    Attributes
    ----------
    fixes
        Number n of fixes per cell.
    cells_with_fix, cells_valid
        Of the whole field.
    points
        Shape (N, 2): centres of the cells studied, W, m.
    at_random
        Shape (N,): drawn from all cells with a fix. The others were sought out: valid ones furthest from the
        nominal share, and invalid ones.
    predicted, simulated
        Shape (N,): share of the fixes inside the 95 % ellipse.
    failed
        Shape (N,): share of the measurements without a fix; they count as outside.
    area_factor
        Shape (N,): area of the ellipse of the predicted shape that holds 95 % of the fixes, over the
        predicted area; infinity where more than 5 % failed.
    ellipse95
        Shape (N,): semi-major axis of the predicted 95 % ellipse, m.
    """

    fixes: int
    cells_with_fix: int
    cells_valid: int
    points: FloatArray
    at_random: BoolArray
    predicted: FloatArray
    simulated: FloatArray
    failed: FloatArray
    area_factor: FloatArray
    ellipse95: FloatArray

    def __post_init__(self) -> None:
        for name in ("points", "predicted", "simulated", "failed", "area_factor", "ellipse95"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "at_random", frozen(self.at_random, np.bool_))

    def __len__(self) -> int:
        return len(self.predicted)

    @property
    def invalid_share(self) -> float:
        """Share of the field's cells with a fix that are not marked valid; NaN without a fix."""
        return 1.0 - self.cells_valid / self.cells_with_fix if self.cells_with_fix else math.nan

    @property
    def valid(self) -> BoolArray:
        """Shape (N,): which cells are marked valid."""
        return np.asarray(np.abs(self.predicted - NOMINAL_SHARE) <= VALID_TOLERANCE)

    @property
    def deviation(self) -> FloatArray:
        """Shape (N,): simulated share minus 0.95."""
        return np.asarray(self.simulated - NOMINAL_SHARE)

    @property
    def prediction_error(self) -> FloatArray:
        """Shape (N,): predicted minus simulated share; its noise has √(s (1 - s) / n)."""
        return np.asarray(self.predicted - self.simulated)

    @property
    def worst_valid(self) -> float:
        """Largest deviation, either way, of a cell marked valid; 0 when there is none."""
        return float(np.max(np.abs(self.deviation[self.valid]), initial=0.0))

    @property
    def missed(self) -> int:
        """Cells marked valid that deviate by more than :data:`MAX_DEVIATION`."""
        return int(np.count_nonzero(np.abs(self.deviation[self.valid]) > MAX_DEVIATION))

    @property
    def harmless(self) -> int:
        """Cells not marked valid that do not deviate by more than :data:`MAX_DEVIATION`."""
        return int(np.count_nonzero(np.abs(self.deviation[~self.valid]) <= MAX_DEVIATION))


def coverage_study(
    world: World,
    sensor: Sensor,
    *,
    cells: int = 1000,
    n: int = 10_000,
    resolution: float = 0.1,
    heading: float = 0.0,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
) -> CoverageStudy:
    """Simulate fixes at cells of a field and compare the share in the ellipse with the predicted one.

    Half of the cells are drawn from all that have a fix, a quarter are the valid ones whose predicted share
    is furthest from 0.95, the harshest test of the limit, and a quarter are drawn from the invalid ones.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    cells
        How many cells to study, at most; there are fewer when the field has fewer.
    n
        Fixes per cell.
    resolution
        Side of a cell, m.
    heading
        Of the robot, rad; matters only to sensors that depend on it.
    rng
        Chooses cells and makes the noise.
    progress
        Called with (cells done, all).

    Returns
    -------
    study
        One entry per cell; empty when the field has no fix.

    Raises
    ------
    LocalizationError
        If ``cells`` is below 1, or ``n`` impossible; what :func:`build_field` raises.
    """
    if cells < 1:
        raise LocalizationError(f"Number of cells is {cells}; it must be 1 or more.")
    field = build_field(world, sensor, resolution=resolution, heading=heading)
    rows, cols, at_random = _chosen_cells(field, cells, rng)
    points = field.frame.centres()[rows, cols]
    simulated, failed, factor = (np.empty(len(rows)) for _ in range(3))
    for k in range(len(rows)):
        first, second, third = (int(t) for t in field.triplet[rows[k], cols[k]])
        cloud = simulate_fixes(
            world, sensor, points[k], heading=field.heading, triplet=(first, second, third), n=n, rng=rng
        )
        simulated[k] = cloud.share_inside
        failed[k] = cloud.failures / n
        factor[k] = _area_factor(cloud)
        if progress is not None:
            progress(k + 1, len(rows))
    return CoverageStudy(
        fixes=n,
        cells_with_fix=int(np.count_nonzero(field.has_fix)),
        cells_valid=int(np.count_nonzero(field.is_valid)),
        points=points,
        at_random=at_random,
        predicted=field.validity[rows, cols].astype(np.float64),
        simulated=simulated,
        failed=failed,
        area_factor=factor,
        ellipse95=field.metric("ellipse95_m", at=(rows, cols)),
    )


def _chosen_cells(
    field: UncertaintyField, cells: int, rng: np.random.Generator
) -> tuple[IntArray, IntArray, BoolArray]:
    """Rows, columns and whether drawn from all, without repetition."""
    share = field.validity.ravel()
    fix = np.flatnonzero(np.isfinite(share))
    valid = field.is_valid.ravel()[fix]
    drawn = rng.choice(fix, min(len(fix), -(-cells // 2)), replace=False)
    rest = ~np.isin(fix, drawn)
    doubtful = fix[valid & rest]
    doubtful = doubtful[np.argsort(-np.abs(share[doubtful] - NOMINAL_SHARE), kind="stable")][: cells // 4]
    invalid = fix[~valid & rest]
    invalid = rng.choice(invalid, min(len(invalid), cells // 4), replace=False)
    flat = np.concatenate([drawn, doubtful, invalid])
    rows, cols = np.unravel_index(flat, field.free.shape)
    return rows, cols, np.arange(len(flat)) < len(drawn)


def _area_factor(cloud: FixCloud) -> float:
    """By how much the ellipse must grow to hold 95 % of the fixes, failures being infinitely far."""
    e = cloud.errors[:, :2]
    (xx, xy), (_, yy) = cloud.predicted[:2, :2]
    distance2 = np.full(len(cloud.fixes), np.inf)
    distance2[cloud.fixes.ok] = (yy * e[:, 0] ** 2 - 2 * xy * e[:, 0] * e[:, 1] + xx * e[:, 1] ** 2) / (
        xx * yy - xy**2
    )
    rank = math.ceil(NOMINAL_SHARE * len(distance2)) - 1
    return float(np.partition(distance2, rank)[rank] / CHI2_95)
