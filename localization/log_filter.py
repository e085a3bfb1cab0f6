"""The filter run along a log: odometry between the sightings, bearings at each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from localization.belief import PoseBelief
from localization.ekf import gate_quantile
from localization.errors import LocalizationError
from localization.kernels.ekf import filter_log
from localization.logs import BearingLog, driven_between
from localization.motion import OdometryModel
from maps.arrays import BoolArray, FloatArray, frozen


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
        Shape (B,): innovation² over its predicted variance, one per bearing.
    accepted
        Shape (B,): whether the bearing passed the gate.
    """

    time: FloatArray
    mean: FloatArray
    covariance: FloatArray
    normalised: FloatArray
    accepted: BoolArray

    def __post_init__(self) -> None:
        for name in ("time", "mean", "covariance", "normalised"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "accepted", frozen(self.accepted, dtype=np.bool_))


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
) -> FilterRun:
    """Filter a log from a belief on: prediction by odometry, update with every landmark's bearing.

    Reference poses are not looked at. Misread ids and other robots do not count.

    Parameters
    ----------
    log
        With odometry.
    bearings
        Shape (S,): to be used instead of the logged ones, biases taken off, rad.
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

    Raises
    ------
    LocalizationError
        If the log has no odometry or no sightings of landmarks from ``start_time`` on.
    """
    used = np.flatnonzero((log.landmark >= 0) & (log.time >= start_time))
    if len(log.odometry) < 2 or len(used) == 0:
        raise LocalizationError(
            f"Log '{log.name}' has {len(log.odometry)} lines of odometry and {len(used)} sightings of "
            f"landmarks from {start_time:.3f} s on; a filter needs both."
        )
    times, first = np.unique(log.time[used], return_index=True)
    # Every change of speed and every scan ends a step.
    changes = log.odometry[:, 0]
    inside = (changes > start_time) & (changes < times[-1])
    ends = np.unique(np.concatenate([changes[inside], times]))
    distance, turn = driven_between(log.odometry, np.concatenate([[start_time], ends]))
    n, places = len(used), log.landmarks.positions[log.landmark[used]]
    out_mean, out_P = np.empty((len(times), 3)), np.empty((len(times), 3, 3))
    normalised, accepted = np.empty(n), np.empty(n, dtype=np.bool_)
    filter_log(
        start.mean.copy(),
        start.covariance.copy(),
        np.diff(distance) * distance_scale,
        np.diff(turn) * turn_scale,
        odometry.kernel_args,
        np.searchsorted(ends, times) + 1,
        np.concatenate([first, [n]]),
        bearings[used],
        places,
        np.full(n, bearing_sigma**2),
        np.full(n, survey_sigma**2),
        gate_quantile(gate, 1),
        out_mean,
        out_P,
        normalised,
        accepted,
    )
    return FilterRun(times, out_mean, out_P, normalised, accepted)
