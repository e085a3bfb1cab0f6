"""The filter along logs with gaps and lies: named outcomes, and covariances that keep their word after."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from localization.belief import PoseBelief
from localization.consistency import nees
from localization.errors import LocalizationError
from localization.log_filter import Recovery, ScanOutcome, run_filter
from localization.logs import interpolated
from localization.motion import OdometryModel
from maps.se2 import wrap
from tests.localization.logs_made import driven_log

MODEL = OdometryModel(0.02, 0.03, 0.01, 0.005)


def filtered(log, *, gate=0.999, **options):
    start = PoseBelief.from_sigmas(log.reference[0], position=0.01, heading=0.01)
    run = run_filter(
        log, log.bearing, start, float(log.time[0]), odometry=MODEL, bearing_sigma=0.01, gate=gate, **options
    )
    error = run.mean - interpolated(log.track, run.time)
    error[:, 2] = wrap(error[:, 2])
    return run, error, nees(error, run.covariance)


def without_odometry(log, first, last):
    o = log.odometry
    return replace(log, odometry=o[(o[:, 0] < first) | (o[:, 0] > last)])


def without_sightings(log, first, last, *, but=0):
    """Between two times only the first ``but`` landmarks are seen."""
    return log.only((log.time < first) | (log.time > last) | (log.landmark < but))


def test_a_whole_log_is_filtered_without_incident(rng):
    run, _, values = filtered(driven_log(rng))
    assert run.unknown_s == 0
    assert run.count(ScanOutcome.UPDATED) == len(run.time)
    assert np.mean(values) == pytest.approx(3.0, abs=0.6)


@pytest.mark.parametrize("gate", [0.999, None])
def test_silent_odometry_inflates_and_scans_carry_on(gate):
    log = without_odometry(driven_log(np.random.default_rng(1)), 30.0, 45.0)
    run, error, values = filtered(log, gate=gate)
    gap = (run.time > 30.0) & (run.time < 45.0)
    assert run.unknown_s == pytest.approx(15.0, abs=0.1)
    assert set(run.outcome[gap]) == {ScanOutcome.AFTER_GAP}
    assert set(run.outcome[run.time > 45.3]) == {ScanOutcome.UPDATED}
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.2
    assert np.mean(values[gap]) < 3.5
    assert np.mean(values[run.time > 45.3]) == pytest.approx(3.0, abs=1.0)


def test_after_a_silence_without_sightings_a_fix_starts_again():
    whole = driven_log(np.random.default_rng(2))
    log = without_sightings(without_odometry(whole, 30.0, 45.0), 30.0, 44.9)
    run, _, values = filtered(log)
    after = run.time > 44.9
    assert run.outcome[after][0] == ScanOutcome.REINITIALISED
    assert run.count(ScanOutcome.REINITIALISED) == 1
    assert np.mean(values[after]) == pytest.approx(3.0, abs=1.0)


def test_without_a_fix_the_belief_stays_inflated():
    whole = driven_log(np.random.default_rng(3))
    log = without_sightings(without_odometry(whole, 30.0, 45.0), 30.0, 60.0, but=2)
    log = without_sightings(log, 30.0, 44.0)
    run, error, values = filtered(log)
    waiting = (run.time > 44.0) & (run.time < 60.0)
    assert set(run.outcome[waiting]) == {ScanOutcome.NO_FIX}
    assert not np.isnan(error).any()
    # Bounds stand for standard deviations: the errors are well inside.
    assert values[waiting].max() < 3.0
    assert run.outcome[run.time > 60.0][0] == ScanOutcome.REINITIALISED
    assert np.mean(values[run.time > 60.0]) == pytest.approx(3.0, abs=1.2)


def test_odometry_that_ends_is_a_gap():
    log = without_odometry(driven_log(np.random.default_rng(4)), 100.0, 1e9)
    run, _, values = filtered(log)
    assert run.unknown_s == pytest.approx(20.0, abs=0.3)
    assert set(run.outcome[run.time > 100.0]) == {ScanOutcome.AFTER_GAP}
    assert np.mean(values[run.time > 100.0]) < 5.0


def test_a_lost_filter_says_so_and_recovers():
    # The robot is lifted and put down elsewhere: nothing in the log says so.
    log = driven_log(np.random.default_rng(5))
    moved = log.time > 60.0
    shift = np.where(moved, 2.0, 0.0)
    reference = log.reference + shift[:, None] * [1.0, 1.0, 0.0]
    track = log.track + np.where(log.track[:, 0] > 60.0, 2.0, 0.0)[:, None] * [0.0, 1.0, 1.0, 0.0]
    places = log.landmarks.positions[log.landmark]
    d = places - reference[:, :2]
    noise = np.random.default_rng(6).normal(size=len(d)) * 0.01
    bearing = np.where(moved, wrap(np.arctan2(d[:, 1], d[:, 0]) - reference[:, 2] + noise), log.bearing)
    log = replace(log, reference=reference, bearing=bearing, track=track)
    run, _, values = filtered(log)
    assert run.count(ScanOutcome.RECOVERED) >= 1
    at = np.flatnonzero(run.outcome == ScanOutcome.RECOVERED)
    assert run.time[at[0]] < 63.0
    assert set(run.outcome[(run.time > 60.0) & (run.time < run.time[at[0]])]) <= {
        ScanOutcome.REJECTED,
        ScanOutcome.UPDATED,
    }
    assert np.median(values[run.time > 65.0]) < 4.0
    never, _, wrong = filtered(log, recovery=Recovery(lost_after=0))
    assert never.count(ScanOutcome.RECOVERED) == never.count(ScanOutcome.LOST) == 0
    assert np.median(wrong[never.time > 65.0]) > 10 * np.median(values[run.time > 65.0])
    # Two landmarks, both mistaken for others: nothing to recover by.
    wrong = replace(log, bearing=np.where(moved, log.bearing + 1.5, log.bearing))
    pair, _, _ = filtered(without_sightings(wrong, 60.0, 1e9, but=2))
    assert pair.count(ScanOutcome.LOST) > 100


def test_a_given_largest_speed_is_used():
    log = without_odometry(driven_log(np.random.default_rng(7)), 30.0, 45.0)
    slow, fast = (
        filtered(log, recovery=Recovery(max_speed=v, max_turn_rate=0.5))[0].covariance for v in (0.3, 3.0)
    )
    during = slice(160, 210)
    assert fast[during, 0, 0].mean() > slow[during, 0, 0].mean()


@pytest.mark.parametrize(
    "values",
    [
        {"max_gap": -1.0},
        {"max_speed": float("nan")},
        {"lost_after": -1},
        {"max_gap": "x"},
        {"lost_after": None},
    ],
)
def test_impossible_rules_are_refused(values):
    with pytest.raises(LocalizationError, match="Recovery"):
        Recovery(**values)


def test_missing_bearings_are_left_out(rng):
    log = driven_log(rng, n=1500)
    missing = np.where(rng.random(len(log.bearing)) < 0.3, np.nan, log.bearing)
    start = PoseBelief.from_sigmas(log.reference[0], position=0.01, heading=0.01)
    run = run_filter(log, missing, start, float(log.time[0]), odometry=MODEL, bearing_sigma=0.01, gate=0.999)
    assert np.isnan(run.normalised).tolist() == np.isnan(missing).tolist()
    assert np.isfinite(run.mean).all()
    # One missing bearing of a scan does not keep the others from a fix.
    gap = without_sightings(without_odometry(driven_log(np.random.default_rng(2)), 30.0, 45.0), 30.0, 44.9)
    z = np.where(gap.landmark == 3, np.nan, gap.bearing)
    run = run_filter(gap, z, start, float(gap.time[0]), odometry=MODEL, bearing_sigma=0.01, gate=0.999)
    assert run.count(ScanOutcome.REINITIALISED) == 1


@pytest.mark.parametrize(
    "values",
    [
        {"bearing_sigma": 0.0},
        {"bearing_sigma": float("nan")},
        {"survey_sigma": -1.0},
        {"distance_scale": float("inf")},
        {"turn_scale": "x"},
        {"gate": 1.5},
    ],
)
def test_impossible_numbers_are_refused(values, rng):
    log = driven_log(rng, n=200)
    start = PoseBelief.from_sigmas(log.reference[0], position=0.01, heading=0.01)
    with pytest.raises(LocalizationError):
        run_filter(
            log,
            log.bearing,
            start,
            float(log.time[0]),
            **{"odometry": MODEL, "bearing_sigma": 0.01, **values},
        )
    for wrong in (log.bearing[:-1], np.full(len(log.time), np.inf), "abc"):
        with pytest.raises(LocalizationError):
            run_filter(log, wrong, start, float(log.time[0]), odometry=MODEL, bearing_sigma=0.01)
