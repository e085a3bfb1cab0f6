"""Odometry models from logs with reference poses: scales, noise, and how late the sightings are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from localization.calibration import MIN_SIGHTINGS, CalibrationError
from localization.logs import BearingLog, driven_between, interpolated, residuals
from localization.motion import OdometryModel, increments_between
from localization.robust import robust_scale, shares_of_variance


@dataclass(frozen=True, slots=True, eq=False)
class OdometryCalibration:
    """Odometry against reference poses.

    Attributes
    ----------
    distance_scale, turn_scale
        Driven over reported; what the odometry says is multiplied by them.
    model
        Noise after the scales.
    window
        Length of the stretches compared, s.
    n
        How many of them.
    """

    distance_scale: float
    turn_scale: float
    model: OdometryModel
    window: float
    n: int


def calibrate_odometry(log: BearingLog, *, window: float = 2.0) -> OdometryCalibration:
    """Scales and noise of a log's odometry, over stretches of ``window`` seconds between reference poses.

    Raises
    ------
    CalibrationError
        If there are fewer than ``MIN_SIGHTINGS`` stretches with motion and a reference at both ends.
    """
    if len(log.odometry) < 2 or len(log.track) < 2:
        raise CalibrationError(f"Log '{log.name}' has no odometry with reference poses.")
    start = max(log.odometry[0, 0], log.track[0, 0])
    stop = min(log.odometry[-1, 0], log.track[-1, 0])
    times = np.arange(start, stop, window)
    poses = interpolated(log.track, times)
    distance, turn = (np.diff(v) for v in driven_between(log.odometry, times))
    both = np.isfinite(poses[1:, 0]) & np.isfinite(poses[:-1, 0])
    both &= (np.abs(distance) > 0.02) | (np.abs(turn) > 0.02)
    if int(np.sum(both)) < MIN_SIGHTINGS:
        raise CalibrationError(
            f"Log '{log.name}' has {int(np.sum(both))} stretches of {window:g} s in motion between reference "
            f"poses; calibration needs {MIN_SIGHTINGS}."
        )
    real_distance, real_turn = increments_between(np.nan_to_num(poses))
    step = np.diff(np.nan_to_num(poses), axis=0)
    phi = np.nan_to_num(poses)[:-1, 2] + 0.5 * real_turn
    side = -step[:, 0] * np.sin(phi) + step[:, 1] * np.cos(phi)
    d, w = distance[both], turn[both]
    d_real, w_real, side = real_distance[both], real_turn[both], side[both]
    d_scale, d_good = robust_scale(d, d_real)
    w_scale, w_good = robust_scale(w, w_real)
    d_noise = shares_of_variance([np.abs(d[d_good])], (d_real - d_scale * d)[d_good] ** 2)
    w_noise = shares_of_variance([np.abs(w[w_good]), np.abs(d[w_good])], (w_real - w_scale * w)[w_good] ** 2)
    slip = shares_of_variance([np.abs(d[d_good])], side[d_good] ** 2)
    model = OdometryModel(*np.sqrt([d_noise[0], w_noise[0], w_noise[1], slip[0]]).tolist())
    return OdometryCalibration(d_scale, w_scale, model, window, len(d))


def sighting_lag(log: BearingLog) -> float:
    """Seconds by which the time stamps of sightings come after the exposure.

    While the robot turns at the rate ω, a bearing stamped too late by ``lag`` is off by ``lag ω``; the slope
    of the residuals over the turn rate of the odometry, without outliers. To be given to ``delayed``.

    Raises
    ------
    CalibrationError
        If fewer than ``MIN_SIGHTINGS`` usable sightings were made while turning.
    """
    e, _ = residuals(log)
    used = log.usable
    if len(log.odometry):
        at = np.clip(np.searchsorted(log.odometry[:, 0], log.time, side="right") - 1, 0, None)
        rate = log.odometry[at, 2]
    else:
        rate = np.zeros(len(log.time))
    used &= np.abs(rate) > 0.02
    if int(np.sum(used)) < MIN_SIGHTINGS:
        raise CalibrationError(
            f"Log '{log.name}' has {int(np.sum(used))} usable sightings made while turning; "
            f"their lag needs {MIN_SIGHTINGS}."
        )
    return robust_scale(rate[used], e[used] - np.median(e[used]))[0]
