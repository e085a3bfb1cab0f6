"""Logs: what is refused, references between samples, scans."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.logs import (
    BearingLog,
    LogFormatError,
    Sighting,
    between,
    blocks_at_jumps,
    blocks_of,
    delayed,
    driven_between,
    interpolated,
    residuals,
    scans,
    unknown_between,
)
from tests.localization.logs_made import LANDMARKS, driven_log, standing_log


def small_log(time, landmark, outcome=None, odometry=None):
    n = len(time)
    return BearingLog(
        "small",
        LANDMARKS,
        np.asarray(time, dtype=float),
        np.asarray(landmark),
        np.zeros(n),
        np.tile([3.0, 3.0, 0.0], (n, 1)),
        np.full(n, Sighting.USABLE) if outcome is None else np.asarray(outcome),
        np.zeros(n, dtype=int),
        np.empty((0, 3)) if odometry is None else np.asarray(odometry, dtype=float),
    )


def test_references_are_interpolated_but_not_across_gaps():
    track = np.array([[0.0, 0, 0, 3.0], [0.1, 1, 2, -3.0], [0.5, 5, 5, 0.0], [0.6, 6, 5, 0.2]])
    out = interpolated(track, np.array([-0.01, 0.0, 0.05, 0.3, 0.55, 0.6, 0.61]))
    np.testing.assert_array_equal(np.isnan(out[:, 0]), [True, False, False, True, False, False, True])
    np.testing.assert_allclose(out[2, :2], [0.5, 1.0])
    # The short way from 3.0 to -3.0 rad is across the seam.
    assert abs(out[2, 2]) == pytest.approx(math.pi)
    np.testing.assert_allclose(out[4], [5.5, 5.0, 0.1])
    assert np.isnan(interpolated(track[:1], np.zeros(2))).all()


def test_odometry_is_summed_as_steps():
    odometry = np.array([[0.0, 1.0, 0.5], [1.0, -2.0, 0.0], [3.0, 0.0, 1.0]])
    distance, turn = driven_between(odometry, np.array([-1.0, 0.5, 1.0, 2.0, 3.0, 4.0]))
    np.testing.assert_allclose(distance, [0.0, 0.5, 1.0, -1.0, -3.0, -3.0])
    np.testing.assert_allclose(turn, [0.0, 0.25, 0.5, 0.5, 0.5, 1.5])
    assert not driven_between(np.empty((0, 3)), np.ones(3))[0].any()


def test_motion_over_gaps_of_the_odometry_is_unknown_and_not_counted():
    odometry = np.array([[0.0, 1.0, 0.5], [1.0, 1.0, 0.5], [9.0, 2.0, 0.0], [10.0, 2.0, 0.0]])
    times = np.array([-5.0, 0.0, 1.0, 2.0, 5.0, 9.0, 9.5, 10.0, 20.0])
    distance, turn = driven_between(odometry, times)
    np.testing.assert_allclose(distance, [0, 0, 1, 1, 1, 1, 2, 3, 3])
    np.testing.assert_allclose(turn, [0, 0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(unknown_between(odometry, times), [0, 5, 5, 6, 9, 13, 13, 13, 23])
    np.testing.assert_allclose(driven_between(odometry, times, max_gap=20.0)[0][-1], 9 + 2 + 20)
    assert not unknown_between(odometry, times, max_gap=20.0).any()
    assert len(unknown_between(odometry, np.empty(0))) == len(driven_between(odometry, np.empty(0))[0]) == 0
    # A robot whose odometry is silent may be anywhere: its scans are not pooled.
    silent = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]]
    time, landmark = [1.0, 1.0, 1.2, 1.4], [0, 1, 2, 0]
    assert [list(s) for s in scans(small_log(time, landmark, odometry=silent))] == [[0, 1], [2], [3]]


def test_scans_hold_what_was_seen_from_one_place():
    still, driving = ([[float(t), speed, 0.0] for t in range(10)] for speed in (0.0, 1.0))
    time, landmark = [1.0, 1.0, 1.2, 1.4, 1.6, 3.0], [0, 1, 2, 0, 3, 4]
    assert [list(s) for s in scans(small_log(time, landmark, odometry=still))] == [[0, 1, 2], [4], [5]]
    assert [list(s) for s in scans(small_log(time, landmark, odometry=driving))] == [
        [0, 1],
        [2],
        [3],
        [4],
        [5],
    ]
    assert [list(s) for s in scans(small_log(time, landmark))] == [[0, 1], [2], [3], [4], [5]]
    misread = [0, 1, 0, 0, 0, 0]
    assert list(next(iter(scans(small_log(time, landmark, misread))))) == [0]
    assert scans(small_log([], [])) == []


def test_blocks():
    np.testing.assert_array_equal(blocks_of(np.array([5.0, 6.0, 15.1, 40.0]), 10.0), [0, 0, 1, 3])
    poses = np.array([[0, 0, 0], [0.01, 0, 0], [1, 0, 0], [math.nan, 0, 0]])
    np.testing.assert_array_equal(blocks_at_jumps(poses, 0.05), [0, 0, 1, 2])
    assert len(blocks_of(np.empty(0), 1.0)) == len(blocks_at_jumps(np.empty((0, 3)), 1.0)) == 0


def test_residuals_of_a_perfect_log_are_zero(rng):
    log = standing_log(rng, n=20, sigma=0.0)
    e, r = residuals(log)
    np.testing.assert_allclose(e, 0, atol=1e-12)
    assert r.min() > 0


def test_earlier_stamps_look_up_references_again(rng):
    log = driven_log(rng, n=600)
    early = delayed(log, 0.1)
    np.testing.assert_allclose(early.time, log.time - 0.1)
    np.testing.assert_allclose(early.reference, interpolated(log.track, log.time - 0.1))
    # Before the first reference there is none.
    assert delayed(log, 1.0).outcome[0] == Sighting.NO_REFERENCE


def test_a_part_of_a_log(rng):
    log = driven_log(rng, n=600)
    part = between(log, 3.0, 6.0)
    for times in (part.time, part.odometry[:, 0], part.track[:, 0]):
        assert 3.0 <= times.min() <= times.max() <= 6.0
    assert part.count(Sighting.USABLE) == len(part.time)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"time": [1.0, 0.0]}, "ascending"),
        ({"time": [1.0, math.nan]}, "ascending"),
        ({"landmark": [0, 7]}, "no landmark"),
        ({"landmark": [0, -1]}, "no landmark"),
        ({"bearing": [0.0, math.nan]}, "not finite"),
        ({"reference": np.full((2, 3), math.nan)}, "not finite"),
        ({"reference": np.zeros((2, 2))}, "shape"),
        ({"block": [0]}, "shape"),
    ],
)
def test_impossible_logs_are_refused(change, match):
    values = {
        "time": [0.0, 1.0],
        "landmark": [0, 1],
        "bearing": [0.0, 0.0],
        "reference": np.zeros((2, 3)),
        "outcome": [0, 0],
        "block": [0, 0],
    }
    values = {k: np.asarray(v) for k, v in (values | change).items()}
    with pytest.raises(LogFormatError, match=match):
        BearingLog("bad", LANDMARKS, **values)
