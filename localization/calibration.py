"""Sensor models from logs with reference poses: bias, sigma, floor, confidence intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from localization.errors import CalibrationError
from localization.logs import BearingLog, residuals
from localization.numbers import is_number
from localization.residual_bins import ResidualBin, ResidualBins
from localization.robust import (
    GATE_SIGMAS,
    KEPT_VARIANCE,
    MAD_TO_SIGMA,
    ROUNDS,
    SIGMA_MIN,
    block_bootstrap,
    shares_of_variance,
    weighted_median,
)
from localization.sensors import (
    CENTRE,
    Mount,
    OmnidirectionalSensor,
    PinholeFixedSensor,
    PinholePanSensor,
)
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.landmarks import LandmarkSet

#: Fewer usable sightings calibrate nothing.
MIN_SIGHTINGS = 30
#: Fewer sightings of one landmark give it no bias of its own.
MIN_PER_LANDMARK = 10
_RANGE_EDGES = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, math.inf)
_BEARING_STEP = math.radians(10.0)


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and its confidence interval, by bootstrap over the blocks of a log."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class BearingCalibration:
    """Errors of bearings: ``bias + N(0, (column_sigma cos²ψ)² + floor² + (range_sigma / r)²)``.

    Attributes
    ----------
    bias
        Mean of the residuals without outliers, rad.
    landmark_bias
        Shape (N,): bias of each landmark, rad; all equal for a global bias.
    sigma
        Standard deviation without outliers, over everything, rad.
    column_sigma
        Share that shrinks with cos² of the bearing as a camera's columns do, rad; 0 unless asked for.
    floor
        Share that nothing reduces, rad.
    range_sigma
        Share of places that are wrong (landmark, sensor or reference), m.
    slope
        Change of the residual per radian of bearing: scale of the angles or the lens.
    n_used, n_outliers
        Sightings.
    min_range, max_range
        Of the sightings used, m.
    by_range, by_bearing
        Residuals after removal of the bias, in bins of range (m) and bearing (rad), each with intervals.
    """

    bias: Interval
    landmark_bias: FloatArray
    sigma: Interval
    column_sigma: Interval
    floor: Interval
    range_sigma: Interval
    slope: Interval
    n_used: int
    n_outliers: int
    min_range: float
    max_range: float
    by_range: tuple[ResidualBin, ...]
    by_bearing: tuple[ResidualBin, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "landmark_bias", frozen(self.landmark_bias))

    @property
    def outlier_share(self) -> float:
        """Outliers among all usable sightings."""
        return self.n_outliers / (self.n_used + self.n_outliers)

    def variances(self, ranges: FloatArray, bearings: FloatArray) -> FloatArray:
        """Variance (S,) of bearings (S,) rad at ranges (S,) m, rad²."""
        on_axis = self.column_sigma.value**2 * np.cos(bearings) ** 4
        return np.asarray(on_axis + self.floor.value**2 + (self.range_sigma.value / ranges) ** 2)

    def corrected(self, log: BearingLog) -> FloatArray:
        """Bearings (S,) of a log without the bias of their landmarks, rad."""
        bias = self.landmark_bias[np.maximum(log.landmark, 0)]
        return np.asarray(log.bearing - np.where(log.landmark >= 0, bias, 0.0))

    def is_outlier(self, log: BearingLog) -> BoolArray:
        """Shape (S,): usable sightings beyond ``GATE_SIGMAS``, judged by the reference poses."""
        e, r = residuals(log)
        x = e - self.landmark_bias[np.maximum(log.landmark, 0)]
        variance = self.variances(np.where(log.usable, r, 1.0), log.bearing)
        return np.asarray(log.usable & (x * x > GATE_SIGMAS**2 * variance))

    @property
    def constant_sigma(self) -> float:
        """Standard deviation of a bearing without the share of wrong places, on the axis, rad."""
        return max(math.hypot(self.floor.value, self.column_sigma.value), SIGMA_MIN)

    def scanner(self, *, mount: Mount = CENTRE) -> OmnidirectionalSensor:
        """The omnidirectional sensor that the field takes.

        The share that nothing reduces is its floor; what is left for its sigma is the column share, as if the
        bearing were on the axis, and a millionth of a radian if there is none.
        """
        return OmnidirectionalSensor(
            max(self.column_sigma.value, SIGMA_MIN),
            self.min_range,
            self.max_range,
            bearing_floor=self.floor.value,
            mount=mount,
        )

    def camera(
        self,
        *,
        field_of_view: float,
        focal_px: float,
        kind: Literal["pinhole_pan", "pinhole_fixed"] = "pinhole_pan",
        mount: Mount = CENTRE,
    ) -> PinholePanSensor | PinholeFixedSensor:
        """The camera that the field takes: columns and floor apart, as calibrated with ``camera=True``.

        Parameters
        ----------
        field_of_view
            rad.
        focal_px
            Focal length, px.
        kind
            On a pan head that turns all around, or fixed.
        mount
            Where it sits on the robot.

        Raises
        ------
        InvalidSensor
            If a number is impossible.
        CalibrationError
            If the kind is unknown.
        """
        if kind not in {"pinhole_pan", "pinhole_fixed"}:
            raise CalibrationError(f"Camera kind is {kind!r}; use 'pinhole_pan' or 'pinhole_fixed'.")
        make = PinholePanSensor if kind == "pinhole_pan" else PinholeFixedSensor
        return make(
            field_of_view,
            focal_px,
            max(self.column_sigma.value, SIGMA_MIN) * focal_px,
            min_range=self.min_range,
            max_range=self.max_range,
            bearing_floor=self.floor.value,
            mount=mount,
        )

    def landmarks(self, surveyed: LandmarkSet) -> LandmarkSet:
        """The landmarks with ``range_sigma`` added to their survey: the noise that grows near by."""
        sigma = np.hypot(surveyed.sigma, self.range_sigma.value)
        return LandmarkSet(surveyed.ids, surveyed.positions, surveyed.facing, surveyed.half_angle, sigma)


def calibrate_bearings(
    log: BearingLog,
    *,
    rng: np.random.Generator,
    per_landmark: bool = False,
    camera: bool = False,
    n_bootstrap: int = 200,
    level: float = 0.95,
) -> BearingCalibration:
    """Noise and bias of the bearings of a log, robust to outliers and misread ids.

    Median and median absolute deviation start; then, in turn, residuals beyond ``GATE_SIGMAS`` are left out,
    biases are means and the variances a non-negative weighted regression of the squared residuals.

    Parameters
    ----------
    log
        With reference poses; sightings that are not usable are left out.
    rng
        For the bootstrap: whole blocks of the log are drawn.
    per_landmark
        A bias for every landmark seen ``MIN_PER_LANDMARK`` times; the others keep the global one.
    camera
        Fit a share of variance that falls with cos⁴ of the bearing too.
    n_bootstrap, level
        Number of draws, level of the intervals.

    Raises
    ------
    CalibrationError
        If fewer than ``MIN_SIGHTINGS`` sightings are usable, a landmark is touched, or the number of draws or
        the level is impossible.
    """
    if not is_number(n_bootstrap) or n_bootstrap < 1:
        raise CalibrationError(f"Number of bootstrap draws is {n_bootstrap!r}; it must be at least 1.")
    if not is_number(level) or not 0 < level < 1:
        raise CalibrationError(f"Level is {level!r}; give a probability between 0 and 1, like 0.95.")
    e, r = residuals(log)
    used = log.usable
    if int(np.sum(used)) < MIN_SIGHTINGS:
        raise CalibrationError(
            f"Log '{log.name}' has {int(np.sum(used))} usable sightings; calibration needs {MIN_SIGHTINGS}."
        )
    if float(r[used].min()) < 1e-3:
        raise CalibrationError(f"Log '{log.name}': the reference stands on a landmark; leave that place out.")
    data = _Data(
        e[used], r[used], log.bearing[used], log.landmark[used], len(log.landmarks), per_landmark, camera
    )
    whole = _fit(data, np.ones(len(data.e)))
    x = data.e - whole.biases[data.landmark]
    block = log.block[used]
    edges = np.arange(-math.pi, math.pi + 1e-9, _BEARING_STEP)
    by_range = ResidualBins(data.r, x, _RANGE_EDGES, block=block)
    by_bearing = ResidualBins(data.bearing, x, edges.tolist(), block=block)
    n_range = len(by_range.statistics(np.ones(len(x))))

    def drawn(weights: FloatArray) -> FloatArray:
        bins = (by_range.statistics(weights), by_bearing.statistics(weights))
        return np.concatenate([_fit(data, weights).numbers, *bins])

    draws = block_bootstrap(block, drawn, rng=rng, n=n_bootstrap)
    tail = 100 * (0.5 - level / 2)
    n_numbers = len(whole.numbers)
    low, high = np.percentile(draws[:, :n_numbers], [tail, 100 - tail], axis=0)
    values = [Interval(*map(float, v)) for v in zip(whole.numbers, low, high, strict=True)]
    inlier = whole.inlier
    return BearingCalibration(
        values[0],
        whole.biases,
        values[1],
        values[2],
        values[3],
        values[4],
        values[5],
        int(np.sum(inlier)),
        int(np.sum(~inlier)),
        float(data.r[inlier].min()),
        float(data.r[inlier].max()),
        by_range.summary(draws[:, n_numbers : n_numbers + n_range], level=level),
        by_bearing.summary(draws[:, n_numbers + n_range :], level=level),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Data:
    e: FloatArray
    r: FloatArray
    bearing: FloatArray
    landmark: IntArray
    n_landmarks: int
    per_landmark: bool
    camera: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    biases: FloatArray
    inlier: BoolArray
    numbers: FloatArray


def _fit(data: _Data, weights: FloatArray) -> _Fit:
    """Bias, sigma, column share, floor, range share and slope of weighted residuals."""
    biases = np.full(data.n_landmarks, weighted_median(data.e, weights))
    groups = _groups(data, weights)
    for k in groups:
        mine = data.landmark == k
        biases[k] = weighted_median(data.e[mine], weights[mine])
    x = data.e - biases[data.landmark]
    sigma = MAD_TO_SIGMA * weighted_median(np.abs(x), weights)
    columns = [1.0 / data.r**2, np.ones(len(x))]
    if data.camera:
        columns.append(np.cos(data.bearing) ** 4)
    variance = np.full(len(x), max(sigma, SIGMA_MIN) ** 2)
    inlier = np.ones(len(x), dtype=np.bool_)
    shares = np.zeros(3)
    for _ in range(ROUNDS):
        inlier = x * x <= GATE_SIGMAS**2 * variance
        counted = weights * inlier
        biases[:] = np.sum(counted * data.e) / np.sum(counted)
        if groups:
            share = np.bincount(data.landmark, counted, data.n_landmarks)
            sums = np.bincount(data.landmark, counted * data.e, data.n_landmarks)
            for k in groups:
                biases[k] = sums[k] / share[k] if share[k] > 0 else biases[k]
        x = data.e - biases[data.landmark]
        shares[: len(columns)] = shares_of_variance(columns, x * x, counted / variance**2)
        # Squares cut off at the gate are smaller than those of the whole Gaussian.
        shares /= KEPT_VARIANCE
        variance = np.maximum(np.stack(columns, axis=1) @ shares[: len(columns)], SIGMA_MIN**2)
    counted = weights * (x * x <= GATE_SIGMAS**2 * variance)
    total = float(np.sum(counted))
    bias = float(np.sum(counted * data.e)) / total
    middle = float(np.sum(counted * data.bearing)) / total
    spread = float(np.sum(counted * (data.bearing - middle) ** 2))
    slope = float(np.sum(counted * (data.bearing - middle) * x)) / spread if spread > 0 else 0.0
    sigma = math.sqrt(float(np.sum(counted * x * x)) / total / KEPT_VARIANCE)
    range_sigma, floor, column = np.sqrt(shares)
    return _Fit(biases, counted > 0, np.array([bias, sigma, column, floor, range_sigma, slope]))


def _groups(data: _Data, weights: FloatArray) -> list[int]:
    if not data.per_landmark:
        return []
    count = np.bincount(data.landmark, weights, data.n_landmarks)
    return [int(k) for k in np.flatnonzero(count >= MIN_PER_LANDMARK)]
