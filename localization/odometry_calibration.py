"""Odometry models from logs with reference poses: scales, noise, and how late the sightings are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from localization.calibration import MIN_SIGHTINGS
from localization.errors import CalibrationError
from localization.logs import (
    MAX_ODOMETRY_GAP_S,
    BearingLog,
    driven_between,
    interpolated,
    residuals,
    unknown_between,
)
from localization.motion import OdometryModel
from localization.robust import robust_scale, shares_of_variance
from maps.arrays import BoolArray, FloatArray
from maps.se2 import wrap

# Stretches with less motion than this (m, rad) say nothing.
_LEAST = 0.02


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

    Stretches with a gap of the odometry are left out.

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
    _, turn = driven_between(log.odometry, times)
    w = np.diff(turn)
    whole = np.diff(unknown_between(log.odometry, times)) == 0
    expected, length, known = _displacements(log, times)
    reach = np.hypot(expected[:, 0], expected[:, 1])
    both = np.isfinite(poses[1:, 0]) & np.isfinite(poses[:-1, 0]) & known & whole
    both &= (length > _LEAST) | (np.abs(w) > _LEAST)
    if int(np.sum(both)) < MIN_SIGHTINGS:
        raise CalibrationError(
            f"Log '{log.name}' has {int(np.sum(both))} stretches of {window:g} s in motion between reference "
            f"poses; calibration needs {MIN_SIGHTINGS}."
        )
    step = np.diff(poses, axis=0)
    w_real = w + wrap(step[:, 2] - w)
    d_scale, model_d = 1.0, np.zeros(2)
    moving = both & (reach > 0.5 * length) & (length > _LEAST)
    if int(np.sum(moving)) >= MIN_SIGHTINGS:
        p, a = expected[moving], step[moving, :2]
        unit = p / reach[moving, None]
        along, across = np.sum(a * unit, axis=1), unit[:, 0] * a[:, 1] - unit[:, 1] * a[:, 0]
        d_scale, good = robust_scale(reach[moving], along)
        driven = [length[moving][good]]
        rest = (along - d_scale * reach[moving])[good]
        model_d = np.array([shares_of_variance(driven, e**2)[0] for e in (rest, across[good])])
    w_scale, good = robust_scale(w[both], w_real[both])
    grown = [np.abs(w[both])[good], length[both][good]]
    model_w = shares_of_variance(grown, (w_real - w_scale * w)[both][good] ** 2)
    sigmas = np.sqrt([model_d[0], *model_w, model_d[1]]).tolist()
    return OdometryCalibration(d_scale, w_scale, OdometryModel(*sigmas), window, int(np.sum(both)))


def _displacements(log: BearingLog, times: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """What the odometry's distances amount to from each of ``times`` (S,) to the next, with true headings.

    Displacements (S-1, 2), distances driven (S-1,), and whether the heading was known throughout (S-1,).
    """
    t = log.odometry[:, 0]
    distance = log.odometry[:-1, 1] * np.diff(t)
    heading = interpolated(log.track, 0.5 * (t[1:] + t[:-1]))[:, 2]
    unknown = np.isnan(heading) & (distance != 0)
    heading = np.nan_to_num(heading)
    steps = (distance * np.cos(heading), distance * np.sin(heading), np.abs(distance), unknown.astype(float))
    sums = [np.interp(times, t, np.concatenate([[0.0], np.cumsum(v)])) for v in steps]
    x, y, length, gaps = (np.diff(v) for v in sums)
    return np.stack([x, y], axis=1), np.asarray(length), np.asarray(gaps == 0)


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
        known = np.abs(log.time - log.odometry[at, 0]) <= MAX_ODOMETRY_GAP_S
        rate = np.where(known, log.odometry[at, 2], 0.0)
    else:
        rate = np.zeros(len(log.time))
    used &= np.abs(rate) > 0.02
    if int(np.sum(used)) < MIN_SIGHTINGS:
        raise CalibrationError(
            f"Log '{log.name}' has {int(np.sum(used))} usable sightings made while turning; "
            f"their lag needs {MIN_SIGHTINGS}."
        )
    return robust_scale(rate[used], e[used] - np.median(e[used]))[0]
