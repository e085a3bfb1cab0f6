"""The filter run along a log: odometry between the sightings, bearings at each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from localization.belief import PoseBelief
from localization.ekf import gate_quantile
from localization.errors import LocalizationError
from localization.kernels import ekf as kernel
from localization.logs import MAX_ODOMETRY_GAP_S, BearingLog, driven_between, unknown_between
from localization.motion import OdometryModel
from localization.numbers import as_numbers, is_number
from localization.triangulation import PoseFix, locate
from maps.arrays import BoolArray, FloatArray, IntArray, frozen

#: Of the variance of a heading that may be any: uniform over a full turn, rad².
FULL_TURN_VARIANCE = math.pi**2 / 3.0
#: With more uncertain headings bearings are no longer linear enough for the filter, rad.
MAX_HEADING_SIGMA = 0.5
#: Squares of smaller sigmas (rad) would leave the range of numbers.
SMALLEST_SIGMA = 1e-12
# A fix that the filter starts from again must agree with its scan at this level, where there is no gate.
_FIX_LEVEL = 0.999


class ScanOutcome(IntEnum):
    """What the filter did at a scan."""

    #: Bearings were folded in.
    UPDATED = 0
    #: More than half of the bearings lay outside the gate.
    REJECTED = 1
    #: The motion before it is unknown: the belief was inflated, then bearings were folded in.
    AFTER_GAP = 2
    #: The motion before it is unknown for too long: the belief is a fix of this scan.
    REINITIALISED = 3
    #: As before, but the scan admits no fix: nothing is known but the inflated belief.
    NO_FIX = 4
    #: Too many scans in a row were rejected, and this one admits no fix: the belief is not to be trusted.
    LOST = 5
    #: Too many scans in a row were rejected: the belief is a fix of this scan.
    RECOVERED = 6


@dataclass(frozen=True, slots=True)
class Recovery:
    """What the filter does where the odometry is silent, or contradicted.

    Attributes
    ----------
    max_gap
        Motion is unknown between lines of odometry further apart than this, s.
    max_speed, max_turn_rate
        Of the robot, m/s and rad/s; None: the largest that the log reports. Over t seconds of a gap, the
        position's standard deviation grows by ``max_speed t`` per axis, the heading's by ``max_turn_rate t``.
    lost_after
        So many scans in a row, each with more than half of its bearings outside the gate, and the filter is
        lost; 0: never. Without a gate nothing is rejected.

    Raises
    ------
    LocalizationError
        If a number is negative or not finite.
    """

    max_gap: float = MAX_ODOMETRY_GAP_S
    max_speed: float | None = None
    max_turn_rate: float | None = None
    lost_after: int = 5

    def __post_init__(self) -> None:
        for name in ("max_gap", "max_speed", "max_turn_rate", "lost_after"):
            value = getattr(self, name)
            if value is None and name in {"max_speed", "max_turn_rate"}:
                continue
            if not is_number(value) or not 0 <= value < math.inf:
                raise LocalizationError(f"Recovery {name} is {value!r}; it must be ≥ 0 and finite.")


@dataclass(frozen=True, slots=True, eq=False)
class FilterRun:
    """Beliefs along a log, one after each scan.

    Attributes
    ----------
    time
        Shape (S,): of the scans, s; sightings with one time stamp are one scan.
    mean
        Shape (S, 3): x, y (m), heading (rad).
    covariance
        Shape (S, 3, 3).
    normalised
        Shape (B,): innovation² over its predicted variance, one per bearing; NaN where the belief became a
        fix, or none.
    accepted
        Shape (B,): whether the bearing passed the gate, or is part of a fix.
    outcome
        Shape (S,): a :class:`ScanOutcome` each.
    unknown_s
        Seconds of the drive in gaps of the odometry.
    """

    time: FloatArray
    mean: FloatArray
    covariance: FloatArray
    normalised: FloatArray
    accepted: BoolArray
    outcome: IntArray
    unknown_s: float

    def __post_init__(self) -> None:
        for name in ("time", "mean", "covariance", "normalised"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "accepted", frozen(self.accepted, dtype=np.bool_))
        object.__setattr__(self, "outcome", frozen(self.outcome, dtype=np.int64))

    def count(self, outcome: ScanOutcome) -> int:
        """How many scans ended so."""
        return int(np.sum(self.outcome == outcome))


def run_filter(
    log: BearingLog,
    bearings: FloatArray,
    start: PoseBelief,
    start_time: float,
    *,
    odometry: OdometryModel,
    bearing_sigma: float,
    survey_sigma: float = 0.0,
    distance_scale: float = 1.0,
    turn_scale: float = 1.0,
    gate: float | None = None,
    recovery: Recovery | None = None,
) -> FilterRun:
    """Filter a log from a belief on: prediction by odometry, update with every landmark's bearing.

    Reference poses are not looked at. Misread ids and other robots do not count. Where the odometry is silent
    the belief is inflated. Once the motion was unknown for longer than ``recovery.max_gap`` without an
    update, or the heading is unknown by more than ``MAX_HEADING_SIGMA``, the filter waits for a scan of
    three landmarks and starts again from its fix. It does so too when it is lost.

    Parameters
    ----------
    log
        With odometry.
    bearings
        Shape (S,): to be used instead of the logged ones, biases taken off, rad; NaN is a missing one.
    start, start_time
        Belief and when it holds, s; earlier sightings are left out.
    odometry
        Noise, after the scales.
    bearing_sigma, survey_sigma
        Noise of bearings (rad) and of the landmarks' places (m).
    distance_scale, turn_scale
        What the odometry says is multiplied by them.
    gate
        Probability with which a good bearing passes; ``None``: all count.
    recovery
        What to do in gaps and when lost; None for the defaults.

    Raises
    ------
    LocalizationError
        If the log has no odometry or no sightings of landmarks from ``start_time`` on, or a number is
        impossible.
    """
    z = as_numbers(bearings, "bearings", LocalizationError)
    if z.shape != log.time.shape or np.isinf(z).any():
        raise LocalizationError(f"Bearings have shape {z.shape}; give {log.time.shape}, finite or NaN.")
    for name, value, least in (
        ("start_time", start_time, -math.inf),
        ("bearing_sigma", bearing_sigma, SMALLEST_SIGMA),
        ("survey_sigma", survey_sigma, 0.0),
        ("distance_scale", distance_scale, -math.inf),
        ("turn_scale", turn_scale, -math.inf),
    ):
        if not is_number(value) or not (math.isfinite(value) and value >= least):
            raise LocalizationError(f"Filter {name} is {value!r}; it must be finite and at least {least:g}.")
    used = np.flatnonzero((log.landmark >= 0) & (log.time >= start_time))
    if len(log.odometry) < 2 or len(used) == 0:
        raise LocalizationError(
            f"Log '{log.name}' has {len(log.odometry)} lines of odometry and {len(used)} sightings of "
            f"landmarks from {start_time:.3f} s on; a filter needs both."
        )
    rule = Recovery() if recovery is None else recovery
    times, first = np.unique(log.time[used], return_index=True)
    # Every change of speed and every scan ends a step.
    changes = log.odometry[:, 0]
    inside = (changes > start_time) & (changes < times[-1])
    ends = np.unique(np.concatenate([changes[inside], times]))
    knots = np.concatenate([[start_time], ends])
    distance, turn = driven_between(log.odometry, knots, max_gap=rule.max_gap)
    unknown = np.diff(unknown_between(log.odometry, knots, max_gap=rule.max_gap))
    n = len(used)
    top = np.abs(log.odometry[:, 1:]).max(axis=0) * np.abs([distance_scale, turn_scale])
    drive = _Drive(
        start.mean.copy(),
        start.covariance.copy(),
        np.diff(distance) * distance_scale,
        np.diff(turn) * turn_scale,
        unknown,
        odometry.kernel_args,
        np.searchsorted(ends, times) + 1,
        np.concatenate([first, [n]]),
        z[used],
        log.landmarks.positions[log.landmark[used]],
        np.full(n, bearing_sigma**2),
        np.full(n, survey_sigma**2),
        gate_quantile(gate, 1),
        rule,
        float(top[0]) if rule.max_speed is None else rule.max_speed,
        float(top[1]) if rule.max_turn_rate is None else rule.max_turn_rate,
        _FIX_LEVEL if gate is None else gate,
    )
    drive.run()
    return FilterRun(
        times,
        drive.out_mean,
        drive.out_P,
        drive.normalised,
        drive.accepted,
        drive.outcome,
        float(unknown.sum()),
    )


@dataclass(slots=True, eq=False)
class _Drive:
    """State of a filter along T steps and S scans; the kernel runs it where nothing special happens."""

    mean: FloatArray
    P: FloatArray
    distances: FloatArray
    turns: FloatArray
    unknown: FloatArray
    noise: FloatArray
    scan_step: IntArray
    offsets: IntArray
    bearings: FloatArray
    places: FloatArray
    variances: FloatArray
    survey: FloatArray
    gate: float
    rule: Recovery
    max_speed: float
    max_turn_rate: float
    level: float
    out_mean: FloatArray = field(init=False)
    out_P: FloatArray = field(init=False)
    normalised: FloatArray = field(init=False)
    accepted: BoolArray = field(init=False)
    outcome: IntArray = field(init=False)
    in_a_row: int = 0
    # Seconds of unknown motion since bearings were last folded in.
    blind: float = 0.0
    homeless: bool = False

    def __post_init__(self) -> None:
        s, b = len(self.scan_step), len(self.bearings)
        self.out_mean, self.out_P = np.empty((s, 3)), np.empty((s, 3, 3))
        self.normalised, self.accepted = np.empty(b), np.empty(b, dtype=np.bool_)
        self.outcome = np.full(s, ScanOutcome.UPDATED, dtype=np.int64)

    def run(self) -> None:
        """All scans."""
        n = len(self.scan_step)
        before = np.concatenate([[0], self.scan_step])
        sums = np.concatenate([[0.0], np.cumsum(self.unknown)])
        stop = np.diff(sums[before]) > 0
        s = 0
        while s < n:
            s, self.in_a_row = kernel.filter_log(
                self.mean, self.P, self.distances, self.turns, self.noise, self.scan_step, self.offsets,
                self.bearings, self.places, self.variances, self.survey, self.gate,
                s, stop, self.in_a_row, self.rule.lost_after,
                self.out_mean, self.out_P, self.normalised, self.accepted,
            )  # fmt: skip
            if s == n:
                break
            if stop[s]:
                self._scan_after_gap(s)
                if self.homeless and s + 1 < n:
                    stop[s + 1] = True
            else:
                self._lost(s)
            self.out_mean[s], self.out_P[s] = self.mean, self.P
            s += 1
        for k in np.flatnonzero(self.outcome == ScanOutcome.UPDATED):
            a, b = self.offsets[k : k + 2]
            if kernel.is_refused(self.normalised[a:b], self.accepted[a:b]):
                self.outcome[k] = ScanOutcome.REJECTED

    def _scan_after_gap(self, s: int) -> None:
        for t in range(self.scan_step[s - 1] if s else 0, self.scan_step[s]):
            if self.unknown[t] > 0:
                self._inflate(self.unknown[t])
            else:
                kernel.predict(self.mean, self.P, self.distances[t], self.turns[t], self.noise)
        if self.blind > self.rule.max_gap or self.P[2, 2] > MAX_HEADING_SIGMA**2:
            self.homeless = True
        if self.homeless:
            # Any heading, tied to nothing.
            self.P[2, :] = self.P[:, 2] = 0.0
            self.P[2, 2] = FULL_TURN_VARIANCE
            found = self._start_from_fix(s)
            self.outcome[s] = ScanOutcome.REINITIALISED if found else ScanOutcome.NO_FIX
            return
        part = slice(self.offsets[s], self.offsets[s + 1])
        kernel.update_bearings(
            self.mean, self.P, np.zeros(3), self.bearings[part], self.places[part], self.variances[part],
            self.survey[part], self.gate, np.empty(part.stop - part.start),
            self.normalised[part], self.accepted[part],
        )  # fmt: skip
        if self.accepted[part].any():
            self.blind = 0.0
        self.outcome[s] = ScanOutcome.AFTER_GAP
        refused = kernel.is_refused(self.normalised[part], self.accepted[part])
        self.in_a_row = self.in_a_row + 1 if refused else 0
        if refused:
            self.outcome[s] = ScanOutcome.REJECTED
            if 0 < self.rule.lost_after <= self.in_a_row:
                self._lost(s)

    def _inflate(self, seconds: float) -> None:
        """A bound of what may have happened counts as a standard deviation; it grows with the time itself."""
        grown = (self.blind + seconds) ** 2 - self.blind**2
        self.blind += seconds
        self.P[0, 0] += self.max_speed**2 * grown
        self.P[1, 1] += self.max_speed**2 * grown
        self.P[2, 2] += self.max_turn_rate**2 * grown

    def _lost(self, s: int) -> None:
        found = self._start_from_fix(s)
        self.outcome[s] = ScanOutcome.RECOVERED if found else ScanOutcome.LOST

    def _start_from_fix(self, s: int) -> bool:
        """Make the belief a fix of a scan, if it has one that its own bearings agree with."""
        part = slice(self.offsets[s], self.offsets[s + 1])
        fix = self._fix(part)
        usable = (
            fix is not None and fix.is_consistent(self.level) and fix.covariance[2, 2] < MAX_HEADING_SIGMA**2
        )
        if fix is not None and usable:
            self.mean[:], self.P[:] = fix.pose, fix.covariance
            self.homeless, self.blind, self.in_a_row = False, 0.0, 0
        if usable or self.homeless:
            self.normalised[part] = np.nan
            self.accepted[part] = usable
        return bool(usable)

    def _fix(self, part: slice) -> PoseFix | None:
        there = np.isfinite(self.bearings[part])
        bearings, places = self.bearings[part][there], self.places[part][there]
        variances, survey = self.variances[part][there], self.survey[part][there]
        if len(np.unique(places, axis=0)) < 3:
            return None
        fix = locate(bearings, places, np.sqrt(variances))
        if fix.converged and survey.any():
            ranges2 = np.sum((places - fix.pose[:2]) ** 2, axis=1)
            fix = locate(bearings, places, np.sqrt(variances + survey / ranges2))
        return fix if fix.converged else None
