"""What came of many simulated runs: collisions, deviations, and whether the ellipses kept their word."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from localization import covariance as cov
from localization.consistency import Coverage, MeanNees, mean_nees, share_bounds
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from planner.kernels import simulation as kernel
from planner.reference import Reference

#: Level of all confidence bounds.
LEVEL = 0.95
# 95 % quantiles of χ² with two and three degrees of freedom.
_CHI2 = {2: cov.CHI2_95, 3: 7.814727903251179}
_DEVIATIONS = (0.5, 0.95, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Stations:
    """Statistics over the runs that reach each of S places along the path.

    Attributes
    ----------
    s, times
        Shape (S,): way, m, and time, s, from the start.
    poses
        Shape (S, 3): where the robot should be, x, y (m), heading (rad).
    n
        Shape (S,): runs that get there without a collision; everything below is NaN where there are none.
    deviation
        Shape (S, 3): median, 95 % quantile and largest distance of the true place from the path, m.
    error
        Shape (S, 2): median and 95 % quantile of the distance from the believed to the true place, m.
    predicted
        Shape (S, 3): xx, xy, yy predicted for the belief before anything is driven, m².
    sample
        Shape (S, 3): second moments of believed minus true place, m².
    coverage, predicted_coverage
        Shape (S,): share of runs whose error lies inside the 95 % ellipse that the robot claims at that
        moment, and inside the predicted one.
    nees
        Shape (S,): mean normalised square of the pose's error under what the robot claims; 3 if consistent.
    displaced
        Shape (S,): share of runs in which the robot would touch something here if it believed to be exactly
        on its path: the probability that a bound per pose promises.
    """

    s: FloatArray
    times: FloatArray
    poses: FloatArray
    n: IntArray
    deviation: FloatArray
    error: FloatArray
    predicted: FloatArray
    sample: FloatArray
    coverage: FloatArray
    predicted_coverage: FloatArray
    nees: FloatArray
    displaced: FloatArray

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            object.__setattr__(self, name, frozen(value, np.int64) if name == "n" else frozen(value))

    @property
    def predicted_r95(self) -> FloatArray:
        """Shape (S,): radius of the circle with the area of the predicted 95 % ellipse, m."""
        return cov.r95(self.predicted)

    @property
    def sample_r95(self) -> FloatArray:
        """Shape (S,): the same of the errors' second moments, m."""
        return cov.r95(self.sample)

    def displaced_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Shape (S,) each: bounds of Clopper and Pearson for the share ``displaced``."""
        pairs = [
            share_bounds(round(share * n), n, level=LEVEL) if n else (0.0, 1.0)
            for share, n in zip(self.displaced.tolist(), self.n.tolist(), strict=True)
        ]
        low, high = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
        return low, high


@dataclass(frozen=True, slots=True, eq=False)
class SimulationReport:
    """Many closed-loop runs of one trajectory.

    Attributes
    ----------
    runs
        How many.
    collision
        Share of runs that touch something, with bounds of Clopper and Pearson.
    collision_places
        Shape (C, 2): true centre at the moment, W, m.
    collision_s
        Shape (C,): way along the path then, m.
    stations
        Along the path.
    coverage, predicted_coverage
        Share of errors inside the robot's own and the predicted 95 % ellipse, over all stations and runs.
        Errors of one run hang together: the bounds count runs, not errors.
    nees
        Mean normalised square of the pose's error (three numbers); bounds as for one error per run.
    worst_deviation
        Shape (R,): largest distance of each run from the path at a station, m.
    goal_error
        Shape (R,): distance from the goal at the end, m; NaN after a collision.
    blind_share
        Share of the driving time in which a fix was due and none came.
    max_blind
        Shape (R,): longest way without a fix, m.
    reference
        The poses to be driven, every step.
    tracks
        Shape (T, K, 4): true x, y and believed x, y of the first runs, m; NaN after a collision.
    """

    runs: int
    collision: Coverage
    collision_places: FloatArray
    collision_s: FloatArray
    stations: Stations
    coverage: Coverage
    predicted_coverage: Coverage
    nees: MeanNees
    worst_deviation: FloatArray
    goal_error: FloatArray
    blind_share: float
    max_blind: FloatArray
    reference: Reference
    tracks: FloatArray

    def __post_init__(self) -> None:
        arrays = ("collision_places", "collision_s", "worst_deviation", "goal_error", "max_blind", "tracks")
        for name in arrays:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def collisions(self) -> int:
        """How many runs touch something."""
        return self.collision.inside

    @property
    def mean_error(self) -> float:
        """Root of the mean squared error of the believed place over stations and runs, m."""
        weights = self.stations.n / max(1, int(self.stations.n.sum()))
        squares = np.nan_to_num(self.stations.sample[:, 0] + self.stations.sample[:, 2])
        return float(np.sqrt(weights @ squares))


def report_of(
    reference: Reference,
    stops: IntArray,
    predicted: FloatArray,
    runs: FloatArray,
    stations: FloatArray,
    tracks: FloatArray,
) -> SimulationReport:
    """Report from what the kernel wrote.

    Parameters
    ----------
    reference
        K poses.
    stops
        Shape (S,): steps of the stations.
    predicted
        Shape (S, 3): xx, xy, yy, m².
    runs, stations, tracks
        Shapes (R, 8), (R, S, 7) and (T, K, 4), see :mod:`planner.kernels.simulation`.
    """
    hit = runs[:, kernel.HIT_STEP] >= 0
    collided = int(hit.sum())
    low, high = share_bounds(collided, len(runs), level=LEVEL)
    e = stations[:, :, [kernel.ERROR_X, kernel.ERROR_Y]].astype(np.float64)
    off = stations[:, :, kernel.OFF_PATH].astype(np.float64)
    alive = ~np.isnan(off)
    own = np.where(alive, stations[:, :, kernel.NEES_PLACE] <= _CHI2[2], np.nan)
    claimed = _squared(e, predicted)
    planned = np.where(alive, claimed <= _CHI2[2], np.nan)
    pose = stations[:, :, kernel.NEES_POSE].astype(np.float64)
    with warnings.catch_warnings():
        # Where no run arrives there is nothing to average.
        warnings.simplefilter("ignore", RuntimeWarning)
        at = Stations(
            s=reference.s[stops],
            times=reference.times[stops],
            poses=reference.poses[stops],
            n=alive.sum(axis=0),
            deviation=np.nanquantile(off, _DEVIATIONS, axis=0).T,
            error=np.nanquantile(np.hypot(e[..., 0], e[..., 1]), [0.5, 0.95], axis=0).T,
            predicted=predicted,
            sample=np.nanmean(e[..., [0, 0, 1]] * e[..., [0, 1, 1]], axis=0),
            coverage=np.nanmean(own, axis=0),
            predicted_coverage=np.nanmean(planned, axis=0),
            nees=np.nanmean(pose, axis=0),
            displaced=np.nanmean(stations[:, :, kernel.DISPLACED], axis=0),
        )
        worst = np.nanmax(off, axis=1)
        per_run = np.nanmean(pose, axis=1)
    due, missed = runs[:, kernel.FIXES].sum(), runs[:, kernel.MISSED].sum()
    return SimulationReport(
        runs=len(runs),
        collision=Coverage(collided, len(runs), low, high, LEVEL),
        collision_places=runs[hit][:, [kernel.HIT_X, kernel.HIT_Y]],
        collision_s=reference.s[runs[hit, kernel.HIT_STEP].astype(np.int64)],
        stations=at,
        coverage=_coverage(own, alive),
        predicted_coverage=_coverage(planned, alive),
        nees=mean_nees(per_run, 3, level=LEVEL),
        worst_deviation=worst,
        goal_error=runs[:, kernel.GOAL_ERROR],
        blind_share=float(missed / due) if due else 1.0,
        max_blind=runs[:, kernel.BLIND],
        reference=reference,
        tracks=tracks,
    )


def _squared(errors: FloatArray, covariances: FloatArray) -> FloatArray:
    """``eᵀ P⁻¹ e`` of errors (R, S, 2) under covariances (S, 3)."""
    xx, xy, yy = covariances.T
    ex, ey = errors[..., 0], errors[..., 1]
    return np.asarray((yy * ex * ex - 2 * xy * ex * ey + xx * ey * ey) / (xx * yy - xy * xy))


def _coverage(inside: FloatArray, alive: BoolArray) -> Coverage:
    """Share over stations and runs; bounds as if each run had one error."""
    n = int(alive.sum())
    share = float(np.nansum(inside)) / n if n else 0.0
    runs = int(alive.any(axis=1).sum())
    low, high = share_bounds(round(share * runs), runs, level=LEVEL)
    return Coverage(int(np.nansum(inside)), n, low, high, LEVEL)
