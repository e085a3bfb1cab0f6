"""What becomes of wrong odometry, measurements and logs: every case has a named outcome."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.belief import PoseBelief
from localization.calibration import MIN_SIGHTINGS, calibrate_bearings
from localization.ekf import predict, update_with_bearings, update_with_fix
from localization.errors import CalibrationError, LocalizationError, LogFormatError, NotPositiveDefinite
from localization.io.mrclam import read_mrclam_run, table
from localization.logs import BearingLog, Sighting, interpolated, residuals
from localization.motion import OdometryModel, increments_between, move, wheel_increments
from localization.odometry_calibration import calibrate_odometry
from tests.localization.logs_made import LANDMARKS, standing_log
from tests.localization.test_wrong_input import BELIEF, CORNER, WORSE, seen_from


class TestMotionAndFilter:
    @pytest.mark.parametrize("bad", WORSE)
    def test_odometry_that_is_none(self, bad):
        for call in (
            lambda: predict(BELIEF, OdometryModel(), distance=bad, turn=0.0),
            lambda: predict(BELIEF, OdometryModel(), distance=0.0, turn=bad),
            lambda: move([0.0, 0.0, bad], distance=1.0, turn=0.0),
            lambda: wheel_increments([1.0, bad], [1.0, 1.0], track=0.5),
            lambda: wheel_increments([1.0], [1.0], track=bad),
            lambda: increments_between([[0.0, 0.0, 0.0], [1.0, bad, 0.0]]),
            lambda: OdometryModel(distance_sigma=bad),
            lambda: PoseBelief([0.0, bad, 0.0], np.eye(3)),
        ):
            with pytest.raises(LocalizationError):
                call()
        with pytest.raises(LocalizationError, match="as many"):
            wheel_increments([1.0], [1.0, 2.0], track=0.5)
        with pytest.raises(LocalizationError, match="shape"):
            increments_between([0.0, 0.0, 0.0])

    def test_odometry_beyond_all_numbers(self):
        with pytest.raises(NotPositiveDefinite, match="finite"):
            predict(BELIEF, OdometryModel(), distance=1e200, turn=0.0)

    @pytest.mark.parametrize("sigma", [0.0, -1.0, 1e200, *WORSE])
    def test_sigmas_that_are_none(self, sigma):
        with pytest.raises(LocalizationError, match="Sigma"):
            update_with_bearings(BELIEF, [0.1], [[3.0, 1.0]], sigma=sigma)
        if sigma != 0.0:
            with pytest.raises(LocalizationError, match="Survey sigma"):
                update_with_bearings(BELIEF, [0.1], [[3.0, 1.0]], sigma=0.1, survey_sigma=sigma)

    def test_measurements_that_are_none(self):
        missing = update_with_bearings(BELIEF, [math.nan], [[3.0, 1.0]], sigma=0.1)
        assert missing.accepted.tolist() == [False]
        np.testing.assert_array_equal(missing.posterior.covariance, BELIEF.covariance)
        with pytest.raises(LocalizationError, match="finite"):
            update_with_bearings(BELIEF, [math.inf], [[3.0, 1.0]], sigma=0.1)
        with pytest.raises(LocalizationError, match="No fix, no update"):
            update_with_fix(BELIEF, [math.nan, 0.0, 0.0], np.eye(3))

    def test_misread_ids_and_outliers_are_gated(self, rng):
        landmarks = CORNER + np.array([3.0, 1.0])
        sure = PoseBelief(np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]))
        good = seen_from(landmarks, (0.0, 0.0)) + rng.normal(0, 0.01, 3)
        swapped = good[[1, 0, 2]]
        update = update_with_bearings(sure, swapped, landmarks, sigma=0.01, gate=0.999)
        assert not update.accepted[:2].any()
        assert update.accepted[2]
        assert (update.normalised[:2] > 10).all()
        far = update_with_fix(BELIEF, [9.0, 9.0], 1e-4 * np.eye(2), gate=0.999)
        assert not far.accepted[0]
        np.testing.assert_array_equal(far.posterior.mean, BELIEF.mean)


class TestLogs:
    def log(self, **changes):
        n = 4
        columns = {
            "time": np.arange(n, dtype=float),
            "landmark": np.array([0, 1, -1, 2]),
            "bearing": np.zeros(n),
            "reference": np.zeros((n, 3)),
            "outcome": np.array([0, 0, Sighting.MISREAD, 0]),
            "block": np.zeros(n),
        }
        return BearingLog("log", LANDMARKS, **columns | changes)

    def test_gaps_of_the_reference_are_not_bridged(self):
        track = np.array([[0.0, 0, 0, 0], [0.1, 1, 0, 0], [5.0, 2, 0, 0], [5.1, 3, 0, 0]])
        poses = interpolated(track, np.array([-0.1, 0.05, 2.0, 5.05, 6.0]))
        np.testing.assert_allclose(poses[:, 0], [np.nan, 0.5, np.nan, 2.5, np.nan])
        assert np.isnan(interpolated(track[:1], np.array([0.0]))).all()

    @pytest.mark.parametrize(
        "changes",
        [
            {"time": np.array([0.0, 2.0, 1.0, 3.0])},
            {"time": np.array([0.0, 1.0, math.nan, 3.0])},
            {"landmark": np.array([0, 1, -1, 99])},
            {"landmark": np.array([0, -1, -1, 2])},
            {"bearing": np.array([0.0, math.nan, 0.0, 0.0])},
            {"reference": np.full((4, 3), math.nan)},
            {"reference": np.zeros((4, 2))},
            {"block": np.zeros(3)},
            {"odometry": np.array([[0.0, math.nan, 0.0]])},
            {"odometry": np.zeros((3, 2))},
            {"odometry": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])},
            {"track": np.array([[0.0, 0.0, math.inf, 0.0]])},
            {"track": np.zeros(4)},
        ],
    )
    def test_logs_that_are_none(self, changes):
        self.log()
        with pytest.raises(LogFormatError, match="'log'"):
            self.log(**changes)

    def test_residuals_are_nan_exactly_where_a_sighting_is_not_usable(self):
        e, r = residuals(self.log(landmark=np.array([0, 1, 0, 2])))
        assert np.isnan(e).tolist() == np.isnan(r).tolist() == [False, False, True, False]

    def test_files(self, tmp_path):
        with pytest.raises(LogFormatError, match=r"no Barcodes\.dat"):
            read_mrclam_run(tmp_path, 1)
        path = tmp_path / "log.dat"
        for text, words in (
            ("1 2\n3 nan\n", "line 2"),
            ("1 2\n3\n", "line 2"),
            ("1 x\n", "line 1"),
            ("", "no numbers"),
        ):
            path.write_text(text)
            with pytest.raises(LogFormatError, match=words):
                table(path, 2)

    def test_too_little_calibrates_nothing(self, rng):
        few = standing_log(rng, n=2)
        assert few.usable.sum() < MIN_SIGHTINGS
        with pytest.raises(CalibrationError, match="usable sightings"):
            calibrate_bearings(few, rng=rng)
        with pytest.raises(CalibrationError, match="no odometry"):
            calibrate_odometry(few)

    def test_outliers_and_misread_ids_do_not_move_a_calibration(self, rng):
        log = standing_log(rng, n=200, sigma=0.01, outliers=0.1)
        landmark, outcome = np.array(log.landmark), np.array(log.outcome)
        misread = rng.random(len(landmark)) < 0.05
        landmark[misread] = rng.integers(0, len(LANDMARKS), int(misread.sum()))
        unknown = rng.random(len(landmark)) < 0.05
        landmark[unknown], outcome[unknown] = -1, Sighting.MISREAD
        worse = BearingLog(
            "worse", LANDMARKS, log.time, landmark, log.bearing, log.reference, outcome, log.block
        )
        found = calibrate_bearings(worse, rng=rng, n_bootstrap=20)
        assert found.sigma.value == pytest.approx(0.01, rel=0.1)
        assert abs(found.bias.value) < 0.001
        assert found.outlier_share == pytest.approx(0.1 + 0.9 * 0.05 * 6 / 7, abs=0.03)
        assert found.n_used + found.n_outliers == (~unknown).sum()
