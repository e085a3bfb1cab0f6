"""Belief along a path: covariances only, before anything is driven (the ``fused`` covariance of a plan).

Odometry makes the belief grow from station to station; at the sensor's rate the scheduled landmarks make it
shrink. Where fewer than three are scheduled the robot drives by dead reckoning, and the result says how far.
Nothing is drawn at random: linearised at the path, the covariances do not depend on the measurements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from localization.belief import PoseBelief
from localization.errors import LocalizationError
from localization.kernels.propagation import covariances_along
from localization.motion import OdometryModel, increments_between
from localization.schedule import Drive, LandmarkSchedule
from maps.arrays import BoolArray, FloatArray, IntArray, frozen


@dataclass(frozen=True, slots=True, eq=False)
class PathBelief:
    """Belief at each station of a drive.

    Attributes
    ----------
    drive
        The stations.
    covariance
        Shape (K, 3, 3): of x, y and heading; m², m rad, rad².
    n_used
        Shape (K,): bearings that updated the belief there; 0 where it is a prediction.
    blind_distance
        Shape (K,): metres driven since the last fix or the start.
    """

    drive: Drive
    covariance: FloatArray
    n_used: IntArray
    blind_distance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))
        object.__setattr__(self, "n_used", frozen(self.n_used, dtype=np.int64))
        object.__setattr__(self, "blind_distance", frozen(self.blind_distance))

    @property
    def position_covariance(self) -> FloatArray:
        """Shape (K, 3): xx, xy, yy, m²."""
        P = self.covariance
        return np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], axis=-1)

    @property
    def r95(self) -> FloatArray:
        """Shape (K,): radius of the circle with the area of the 95 % ellipse, m."""
        return cov.r95(self.position_covariance)

    @property
    def max_blind_distance(self) -> float:
        """Longest way without a fix, m."""
        return float(self.blind_distance.max())

    def at(self, station: int) -> PoseBelief:
        """The belief at one station: posterior if something was measured there, else prediction."""
        kind = "posterior" if self.n_used[station] > 0 else "prediction"
        return PoseBelief(self.drive.poses[station], self.covariance[station], kind)  # type: ignore[arg-type]


def fix_stations(times: FloatArray, rate: float) -> BoolArray:
    """Shape (K,): the first station at or after each multiple of ``1 / rate`` s, the start left out.

    Raises
    ------
    LocalizationError
        If the rate (Hz) is not positive; infinity is a fix at every station.
    """
    if not rate > 0:
        raise LocalizationError(f"Fix rate is {rate} Hz; it must be positive (infinity: at every station).")
    if math.isinf(rate):
        out = np.ones(len(times), dtype=np.bool_)
        out[:1] = False
        return out
    # Times are sums; a station a rounding early is in time.
    count = np.floor((times - times[0]) * rate + 1e-9)
    return np.asarray(np.diff(count, prepend=count[:1]) > 0)


def propagate(
    drive: Drive,
    schedule: LandmarkSchedule,
    start: npt.ArrayLike,
    *,
    odometry: OdometryModel,
    fix_rate: float = math.inf,
) -> PathBelief:
    """Covariances along a drive: ``F P Fᵀ + Q`` between stations, Joseph updates at fixes.

    Parameters
    ----------
    drive
        Stations, close enough to be driven as arcs.
    schedule
        What is measured at each of them; fewer than three bearings are no fix and change nothing.
    start
        Covariance (3, 3) at the first station.
    odometry
        Noise of the motion.
    fix_rate
        Fixes per second; infinity for one at every station after the first.

    Raises
    ------
    LocalizationError
        If the schedule is for another number of stations, or the rate not positive.
    NotPositiveDefinite
        If ``start`` is no covariance.
    """
    n = len(drive.times)
    if len(schedule.landmarks) != n:
        raise LocalizationError(f"The schedule has {len(schedule.landmarks)} stations, the drive {n}.")
    belief = PoseBelief(drive.poses[0], np.asarray(start, dtype=np.float64))
    distances, turns = increments_between(drive.poses)
    out_P, out_used, out_blind = np.empty((n, 3, 3)), np.zeros(n, dtype=np.int64), np.zeros(n)
    covariances_along(
        drive.poses,
        distances,
        turns,
        odometry.kernel_args,
        schedule.mount.as_array(),
        schedule.places,
        schedule.variances,
        fix_stations(drive.times, fix_rate),
        belief.covariance.copy(),
        out_P,
        out_used,
        out_blind,
    )
    return PathBelief(drive, out_P, out_used, out_blind)
