"""The model against real logs: calibration, fixes, filter; the numbers behind ``docs/validation.md``.

Everything is measured out of sample: a fix is judged with the calibration of the other parts of its log, a
filter runs over one half with the models of the other half.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from localization.belief import PoseBelief
from localization.calibration import BearingCalibration, calibrate_bearings
from localization.consistency import MeanNees, coverage, mean_nees, nees
from localization.fix_study import FixSummary, ScanFixes, own_share, scan_fixes, summarise
from localization.log_filter import FilterRun, ScanOutcome, run_filter
from localization.logs import BearingLog, Sighting, between, delayed, interpolated, residuals, scans
from localization.odometry_calibration import OdometryCalibration, calibrate_odometry, sighting_lag
from maps.arrays import FloatArray, IntArray
from maps.se2 import wrap

N_FOLDS = 5
#: A filter's gate passes a good bearing with this probability.
GATE = 0.999
#: Errors of real odometry are not white; stretches as long as the waits between fixes count them right.
ODOMETRY_WINDOW_S = 5.0
#: White noise would have the same sigmas over stretches of any length.
WINDOWS_S = (1.0, ODOMETRY_WINDOW_S, 10.0)
_SEED = 20261125
# Of the reference pose at the start of a filter, m and rad.
_START_SIGMA = 0.02
_NO_BEARINGS = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class LogCase:
    """A log and how it is looked at.

    Attributes
    ----------
    log
        With reference poses.
    source
        Where it comes from, in a few words.
    filtered
        Whether the filter is run along it; needs odometry and a reference throughout.
    per_landmark
        Whether each landmark has a bias of its own from here to there, as beacons have; else one for all.
    """

    log: BearingLog
    source: str
    filtered: bool = False
    per_landmark: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FixStudy:
    """Fixes of one log under five views, and three choices of landmarks.

    Attributes
    ----------
    raw, common, own, gated, scatter
        Best triplet with bearings as logged; without the bias of all; without the bias of each landmark;
        without the bias that the case asks for and without outliers; that with the sigma of the scatter
        within a scan.
    best, random, every
        Scans of four or more landmarks, biases and outliers removed: best triplet, any, all landmarks.
    own_share
        Share of the bearings' variance that is not common to a scan.
    distinct_scans
        Scans of three or more whose readings are not those of the scan before.
    """

    raw: FixSummary
    common: FixSummary
    own: FixSummary
    gated: FixSummary
    scatter: FixSummary
    best: FixSummary
    random: FixSummary
    every: FixSummary
    own_share: float
    distinct_scans: int


@dataclass(frozen=True, slots=True, eq=False)
class FilterStudy:
    """One run of the filter over half a log.

    Attributes
    ----------
    view
        What was done to the bearings.
    n
        Scans with a reference.
    nees, nees_median
        Of the pose, three degrees of freedom.
    share
        Positions inside the 95 % ellipse.
    predicted_median, actual_median, actual_p95
        Position error, m.
    rejected
        Share of bearings outside the gate.
    restarted
        How often the filter started again from a fix: motion unknown, or lost.
    """

    view: str
    n: int
    nees: MeanNees
    nees_median: float
    share: float
    predicted_median: float
    actual_median: float
    actual_p95: float
    rejected: float
    restarted: int


@dataclass(frozen=True, slots=True, eq=False)
class LogStudy:
    """Everything measured on one log; odometry over stretches of each of ``WINDOWS_S``, or none."""

    case: LogCase
    counts: dict[Sighting, int]
    calibration: BearingCalibration
    lag: float
    fixes: FixStudy
    odometry: tuple[OdometryCalibration, ...]
    filters: tuple[tuple[str, tuple[FilterStudy, ...]], ...]


def study(case: LogCase) -> LogStudy:
    """Measure one log; the same numbers each time.

    Raises
    ------
    CalibrationError
        If the log is too short to calibrate from.
    """
    log = case.log
    rng = np.random.default_rng(_SEED)
    calibration = calibrate_bearings(log, rng=rng)
    counts = {outcome: log.count(outcome) for outcome in Sighting}
    lag = sighting_lag(log) if len(log.odometry) else math.nan
    fixes = study_fixes(log, rng=rng, per_landmark=case.per_landmark)
    odometry = tuple(calibrate_odometry(log, window=w) for w in WINDOWS_S) if case.filtered else ()
    filters = study_filter(log) if case.filtered else ()
    return LogStudy(case, counts, calibration, lag, fixes, odometry, filters)


def study_fixes(log: BearingLog, *, rng: np.random.Generator, per_landmark: bool) -> FixStudy:
    """Fixes from the scans of a log, each judged with the calibration of the other folds.

    Parameters
    ----------
    log
        At least ``N_FOLDS`` blocks.
    rng
        For random triplets, predicted errors and bootstraps.
    per_landmark
        Which bias to take off where one is taken off: each landmark's, or one for all.
    """
    log = log.only(log.usable)
    fold = _folds(log)
    groups = [g for g in scans(log) if len(g) >= 2]
    corrected = {own: log.bearing.copy() for own in (False, True)}
    variances = np.full(len(log.time), np.nan)
    outlier = np.zeros(len(log.time), dtype=np.bool_)
    _, distance = residuals(log)
    for k in np.unique(fold):
        mine = fold == k
        others = log.only(np.asarray(~mine))
        for own, bearings in corrected.items():
            model = calibrate_bearings(others, rng=rng, per_landmark=own, n_bootstrap=1)
            bearings[mine] = model.corrected(log)[mine]
            if own == per_landmark:
                variances[mine] = model.variances(distance[mine], log.bearing[mine])
                outlier[mine] = model.is_outlier(log)[mine]
    unbiased = corrected[per_landmark]
    clean = [g[~outlier[g]] for g in groups]
    share = own_share(log, clean, unbiased, variances)
    many = [g for g in clean if len(g) >= 4]

    def of(chosen: Sequence[IntArray], z: FloatArray, v: FloatArray) -> FixSummary:
        return summarise(scan_fixes(log, chosen, z, v, choice="best", rng=rng), rng=rng)

    def compared(kind: str) -> FixSummary:
        fixes: ScanFixes = scan_fixes(log, many, unbiased, share * variances, choice=kind, rng=rng)  # type: ignore[arg-type]
        return summarise(fixes, rng=rng)

    triples = [g for g in groups if len(g) >= 3]
    readings = [(tuple(log.landmark[g]), tuple(log.bearing[g])) for g in triples]
    return FixStudy(
        of(groups, log.bearing, variances),
        of(groups, corrected[False], variances),
        of(groups, corrected[True], variances),
        of(clean, unbiased, variances),
        of(clean, unbiased, share * variances),
        compared("best"),
        compared("random"),
        compared("all"),
        share,
        sum(k == 0 or readings[k] != readings[k - 1] for k in range(len(readings))),
    )


def study_filter(log: BearingLog) -> tuple[tuple[str, tuple[FilterStudy, ...]], ...]:
    """The filter along each half of a log, with the models of the other half: (name, views) each."""
    used = log.time[log.usable]
    middle = 0.5 * (used[0] + used[-1])
    halves = (between(log, -math.inf, middle), between(log, middle, math.inf))
    out = []
    for name, run_on, learn_from in (
        ("first half", halves[0], halves[1]),
        ("second half", halves[1], halves[0]),
    ):
        lag = sighting_lag(learn_from)
        odometry = calibrate_odometry(learn_from, window=ODOMETRY_WINDOW_S)
        views = []
        for view in ("odometry alone", "as logged", "bias removed", "gated", "gated, earlier stamps"):
            early = view == "gated, earlier stamps"
            target = delayed(run_on, lag) if early else run_on
            source = delayed(learn_from, lag) if early else learn_from
            rng = np.random.default_rng(_SEED)
            model = calibrate_bearings(source, rng=rng, n_bootstrap=1)
            views.append(_filtered(view, target, model, odometry))
        out.append((name, tuple(views)))
    return tuple(out)


def _filtered(
    view: str, log: BearingLog, model: BearingCalibration, odometry: OdometryCalibration
) -> FilterStudy:
    first = int(np.flatnonzero(log.usable)[0])
    run = run_filter(
        log,
        log.bearing if view == "as logged" else model.corrected(log),
        PoseBelief.from_sigmas(log.reference[first], position=_START_SIGMA, heading=_START_SIGMA),
        float(log.time[first]),
        odometry=odometry.model,
        bearing_sigma=_NO_BEARINGS if view == "odometry alone" else model.constant_sigma,
        survey_sigma=model.range_sigma.value,
        distance_scale=odometry.distance_scale,
        turn_scale=odometry.turn_scale,
        gate=GATE if view.startswith("gated") else None,
    )
    return _judged(view, run, log)


def _judged(view: str, run: FilterRun, log: BearingLog) -> FilterStudy:
    error = run.mean - interpolated(log.track, run.time)
    error[:, 2] = wrap(error[:, 2])
    pose = nees(error, run.covariance)
    position = nees(error[:, :2], run.covariance[:, :2, :2])
    distance = np.hypot(error[:, 0], error[:, 1])
    rng = np.random.default_rng(_SEED)
    P = run.covariance
    a = np.sqrt(P[:, 0, 0])
    b = P[:, 0, 1] / a
    c = np.sqrt(np.maximum(P[:, 1, 1] - b * b, 0.0))
    z = rng.standard_normal((20, len(a), 2))
    predicted = np.hypot(a * z[..., 0], b * z[..., 0] + c * z[..., 1])
    counted = ~np.isnan(run.normalised)
    return FilterStudy(
        view,
        int(np.sum(~np.isnan(pose))),
        mean_nees(pose, 3),
        float(np.nanmedian(pose)),
        coverage(position, 2).share,
        float(np.median(predicted)),
        float(np.nanmedian(distance)),
        float(np.nanpercentile(distance, 95)),
        float(1.0 - np.mean(run.accepted[counted])),
        run.count(ScanOutcome.REINITIALISED) + run.count(ScanOutcome.RECOVERED),
    )


def _folds(log: BearingLog) -> IntArray:
    """Fold (S,) of each sighting: blocks in order, ``N_FOLDS`` folds of about equally many sightings."""
    blocks, inverse, count = np.unique(log.block, return_inverse=True, return_counts=True)
    if len(blocks) <= N_FOLDS:
        return np.asarray(inverse.reshape(-1), dtype=np.int64)
    before = np.cumsum(count) - count
    return np.asarray((before * N_FOLDS // len(log.time))[inverse.reshape(-1)], dtype=np.int64)
