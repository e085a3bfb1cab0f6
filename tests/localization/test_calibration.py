"""Calibration gets back the noise that simulated logs were made with."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.belief import PoseBelief
from localization.calibration import CalibrationError, calibrate_bearings
from localization.consistency import coverage, nees
from localization.errors import LocalizationError
from localization.fix_study import own_share, scan_fixes, summarise
from localization.log_filter import run_filter
from localization.logs import delayed, interpolated, residuals, scans
from localization.odometry_calibration import calibrate_odometry, sighting_lag
from localization.robust import shares_of_variance, weighted_median
from localization.sensors import Mount, PinholeFixedSensor, PinholePanSensor
from maps.se2 import wrap
from tests.localization.logs_made import LANDMARKS, driven_log, standing_log


def test_bias_and_sigma_come_back(rng):
    calibration = calibrate_bearings(standing_log(rng, sigma=0.01, bias=0.004), rng=rng)
    assert calibration.bias.value == pytest.approx(0.004, abs=0.0008)
    assert calibration.floor.value == pytest.approx(0.01, rel=0.05)
    assert calibration.sigma.value == pytest.approx(0.01, rel=0.05)
    assert calibration.range_sigma.value < 0.012
    assert calibration.outlier_share < 0.01
    for name, truth in (("bias", 0.004), ("sigma", 0.01), ("slope", 0.0)):
        interval = getattr(calibration, name)
        assert interval.low <= interval.value <= interval.high
        assert interval.low - 5e-4 <= truth <= interval.high + 5e-4


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(60):
        bias = calibrate_bearings(standing_log(rng, n=60, bias=0.01), rng=rng, n_bootstrap=100).bias
        held += bias.low <= 0.01 <= bias.high
    assert held >= 51


def test_outliers_change_little(rng):
    calibration = calibrate_bearings(standing_log(rng, sigma=0.01, bias=-0.005, outliers=0.05), rng=rng)
    assert calibration.bias.value == pytest.approx(-0.005, abs=0.001)
    assert calibration.sigma.value == pytest.approx(0.01, rel=0.06)
    assert calibration.outlier_share == pytest.approx(0.05, abs=0.015)


def test_share_of_wrong_places_comes_back(rng):
    calibration = calibrate_bearings(standing_log(rng, n=1500, sigma=0.005, range_sigma=0.03), rng=rng)
    assert calibration.range_sigma.value == pytest.approx(0.03, rel=0.1)
    assert calibration.floor.value == pytest.approx(0.005, rel=0.15)
    assert calibration.range_sigma.low <= 0.03 <= calibration.range_sigma.high
    sigmas = [b.sigma for b in calibration.by_range]
    assert sigmas[0] > 1.5 * sigmas[-1]
    world = calibration.landmarks(LANDMARKS)
    np.testing.assert_allclose(world.sigma, calibration.range_sigma.value)
    sensor = calibration.scanner()
    assert sensor.bearing_floor == calibration.floor.value
    assert math.hypot(sensor.bearing_sigma, sensor.bearing_floor) == pytest.approx(calibration.constant_sigma)
    assert (sensor.min_range, sensor.max_range) == (calibration.min_range, calibration.max_range)
    assert calibration.scanner(mount=Mount(0.3)).mount == Mount(0.3)


def test_columns_of_a_camera_come_back(rng):
    log = standing_log(rng, n=3000, sigma=0.002, column_sigma=0.01)
    front = log.only(np.abs(log.bearing) < 1.2)
    calibration = calibrate_bearings(front, rng=rng, camera=True, n_bootstrap=50)
    assert calibration.column_sigma.value == pytest.approx(0.01, rel=0.05)
    assert calibration.floor.value == pytest.approx(0.002, abs=0.001)
    middle = max(calibration.by_bearing, key=lambda b: b.sigma)
    assert abs(0.5 * (middle.low + middle.high)) < 0.4
    camera = calibration.camera(field_of_view=2.0, focal_px=500.0)
    assert isinstance(camera, PinholePanSensor)
    assert camera.column_sigma_px == pytest.approx(500 * 0.01, rel=0.05)
    assert camera.bearing_floor == calibration.floor.value
    assert (camera.min_range, camera.max_range) == (calibration.min_range, calibration.max_range)
    fixed = calibration.camera(
        field_of_view=2.0, focal_px=500.0, kind="pinhole_fixed", mount=Mount(0.2, theta=1.0)
    )
    assert isinstance(fixed, PinholeFixedSensor)
    assert fixed.mount == Mount(0.2, theta=1.0)
    assert fixed.column_sigma_px == camera.column_sigma_px
    with pytest.raises(CalibrationError, match="kind"):
        calibration.camera(field_of_view=2.0, focal_px=500.0, kind="omnidirectional")


def test_bins_have_intervals_that_hold_the_truth(rng):
    log = standing_log(rng, n=600, sigma=0.005, range_sigma=0.03)
    calibration = calibrate_bearings(log, rng=rng)
    for b in (*calibration.by_range, *calibration.by_bearing):
        assert b.bias_low <= b.bias <= b.bias_high
        assert b.sigma_low <= b.sigma <= b.sigma_high
    held = [b.bias_low <= 0.0 <= b.bias_high for b in calibration.by_bearing]
    assert np.mean(held) > 0.8
    first, last = calibration.by_range[0], calibration.by_range[-1]
    assert first.sigma_low > last.sigma_high
    # All of one block: nothing to draw from.
    one = replace(log, block=np.zeros(len(log.time), dtype=int))
    assert all(math.isnan(b.sigma_low) for b in calibrate_bearings(one, rng=rng, n_bootstrap=5).by_range)


def test_biases_of_landmarks_come_back(rng):
    own = np.array([0.02, -0.03, 0.0, 0.05, -0.01, 0.04, 0.0])
    log = standing_log(rng, landmark_bias=own)
    calibration = calibrate_bearings(log, rng=rng, per_landmark=True, n_bootstrap=20)
    np.testing.assert_allclose(calibration.landmark_bias, own, atol=0.002)
    assert calibration.sigma.value == pytest.approx(0.01, rel=0.05)
    e, _ = residuals(log)
    np.testing.assert_allclose(
        wrap(calibration.corrected(log) - log.bearing), -calibration.landmark_bias[log.landmark], atol=1e-12
    )
    assert np.abs(e - calibration.landmark_bias[log.landmark])[~calibration.is_outlier(log)].max() < 0.04


def test_results_do_not_vary(rng):
    log = standing_log(rng, n=60)
    a, b = (calibrate_bearings(log, rng=np.random.default_rng(3)) for _ in range(2))
    assert a.bias == b.bias
    assert a.floor == b.floor


def test_too_little_is_refused(rng):
    with pytest.raises(CalibrationError, match="21 usable"):
        calibrate_bearings(standing_log(rng, n=3), rng=rng)
    log = standing_log(rng, n=30)
    reference = log.reference.copy()
    reference[3, :2] = LANDMARKS.positions[3]
    on_top = type(log)(
        log.name, log.landmarks, log.time, log.landmark, log.bearing, reference, log.outcome, log.block
    )
    with pytest.raises(CalibrationError, match="stands on a landmark"):
        calibrate_bearings(on_top, rng=rng)
    for wrong in ({"n_bootstrap": 0}, {"n_bootstrap": "x"}, {"level": 1.0}, {"level": None}):
        with pytest.raises(CalibrationError, match=r"bootstrap|Level"):
            calibrate_bearings(log, rng=rng, **wrong)
    with pytest.raises(CalibrationError, match="no odometry"):
        calibrate_odometry(log)
    with pytest.raises(CalibrationError, match="while turning"):
        sighting_lag(log)
    with pytest.raises(CalibrationError, match="in motion"):
        calibrate_odometry(driven_log(rng, n=1500, still=True))


def test_odometry_comes_back():
    rng = np.random.default_rng(2)
    log = driven_log(rng, n=40_000, scales=(0.9, 1.1), noise=(0.03, 0.04, 0.02, 0.01))
    found = calibrate_odometry(log, window=2.0)
    assert found.distance_scale == pytest.approx(0.9, abs=0.01)
    assert found.turn_scale == pytest.approx(1.1, abs=0.01)
    assert found.model.distance_sigma == pytest.approx(0.03, rel=0.25)
    assert found.model.slip_sigma == pytest.approx(0.01, rel=0.25)
    assert math.hypot(found.model.turn_sigma, found.model.drift_sigma) == pytest.approx(0.045, rel=0.25)


def test_lag_of_the_stamps_comes_back(rng):
    log = driven_log(rng, lag=0.08)
    assert sighting_lag(log) == pytest.approx(0.08, abs=0.01)
    assert sighting_lag(delayed(log, 0.08)) == pytest.approx(0.0, abs=0.01)


def test_filter_with_calibrated_models_is_consistent():
    """The whole chain on simulated drives: calibrate, filter, NEES and coverage as they should be."""
    rng = np.random.default_rng(4)
    inside, values = [], []
    for _ in range(3):
        log = driven_log(rng, n=6000, sigma=0.02, noise=(0.05, 0.05, 0.03, 0.01))
        model, odometry = calibrate_bearings(log, rng=rng, n_bootstrap=1), calibrate_odometry(log)
        run = run_filter(
            log,
            model.corrected(log),
            PoseBelief.from_sigmas(log.reference[0], position=0.01, heading=0.01),
            float(log.time[0]),
            odometry=odometry.model,
            bearing_sigma=model.constant_sigma,
            distance_scale=odometry.distance_scale,
            turn_scale=odometry.turn_scale,
            gate=0.9999,
        )
        error = run.mean - interpolated(log.track, run.time)
        error[:, 2] = wrap(error[:, 2])
        values.append(nees(error, run.covariance))
        inside.append(coverage(nees(error[:, :2], run.covariance[:, :2, :2]), 2).share)
        assert run.accepted.mean() > 0.99
    assert np.mean(values) == pytest.approx(3.0, abs=0.5)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


def test_a_filter_needs_odometry(rng):
    start = PoseBelief.from_sigmas([0, 0, 0], position=1, heading=1)
    log = standing_log(rng, n=5)
    with pytest.raises(LocalizationError, match="a filter needs both"):
        run_filter(
            log,
            log.bearing,
            start,
            0.0,
            odometry=calibrate_odometry(driven_log(rng)).model,
            bearing_sigma=0.1,
        )


@pytest.mark.parametrize("choice", ["best", "random", "all"])
def test_predicted_ellipses_hold_on_simulated_scans(choice):
    rng = np.random.default_rng(8)
    log = standing_log(rng, n=1500, sigma=0.005)
    groups = scans(log)
    variances = np.full(len(log.time), 0.005**2)
    fixes = scan_fixes(log, groups, log.bearing, variances, choice=choice, rng=rng)
    found = summarise(fixes, rng=rng)
    assert found.n + found.n_failed == 1500
    # A random triplet may be near its danger circle, where first order fails.
    assert found.share == pytest.approx(0.95, abs=0.02 if choice != "random" else 0.06)
    assert found.actual_median == pytest.approx(found.predicted_median, rel=0.08)
    assert own_share(log, groups, log.bearing, variances) == pytest.approx(1.0, abs=0.04)


def test_more_landmarks_are_better(rng):
    log = standing_log(rng, n=800)
    variances = np.full(len(log.time), 1e-4)
    median = {}
    for choice in ("best", "random", "all"):
        fixes = scan_fixes(log, scans(log), log.bearing, variances, choice=choice, rng=rng)
        median[choice] = summarise(fixes, rng=rng).actual_median
    assert median["all"] < median["best"] < median["random"]


def test_common_errors_do_not_move_fixes(rng):
    log = standing_log(rng, n=300, sigma=0.004)
    turned = np.repeat(rng.normal(size=300) * 0.05, 7)
    variances = np.full(len(log.time), 0.05**2)
    own = own_share(log, scans(log), log.bearing + turned, variances)
    assert math.sqrt(own) * 0.05 == pytest.approx(0.004, rel=0.1)
    a, b = (
        scan_fixes(log, scans(log), log.bearing + turn, variances, choice="best", rng=rng).error
        for turn in (0.0, turned)
    )
    np.testing.assert_allclose(a, b, atol=1e-9)


def test_summary_of_nothing(rng):
    log = standing_log(rng, n=3)
    fixes = scan_fixes(log, [], log.bearing, np.ones(len(log.time)), choice="best", rng=rng)
    assert summarise(fixes, rng=rng).n == 0
    assert math.isnan(own_share(log, [], log.bearing, np.ones(len(log.time))))


def test_shares_are_never_negative(rng):
    x = rng.uniform(1, 2, 100)
    np.testing.assert_allclose(shares_of_variance([x, x**2], 3 * x + 2 * x**2), [3, 2])
    a, b = shares_of_variance([x, x**2], 3 * x - 0.5 * x**2)
    assert a > 0
    assert b == 0
    assert not shares_of_variance([np.zeros(3)], np.ones(3)).any()


def test_weighted_median():
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.ones(3)) == 2.0
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([5.0, 1.0, 1.0])) == 3.0
