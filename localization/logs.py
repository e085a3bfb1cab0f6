"""Logs of bearings to known landmarks, with reference poses: what was seen, and what became of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from localization.errors import LogFormatError
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.landmarks import LandmarkSet
from maps.se2 import wrap

#: Reference poses further apart than this are not interpolated, s.
MAX_GAP_S = 0.1
#: A speed that the odometry reported holds until the next line, but not for longer than this, s. Drivers that
#: log changes alone repeat the last command about every second.
MAX_ODOMETRY_GAP_S = 2.0
# Times of a log are sums or counts since an epoch.
_ROUNDING_S = 1e-6


class Sighting(IntEnum):
    """What a line of a log is good for."""

    USABLE = 0
    #: The id is in no table: misread.
    MISREAD = 1
    #: Another robot, which moves.
    ROBOT = 2
    #: No reference pose within ``MAX_GAP_S`` on both sides.
    NO_REFERENCE = 3


@dataclass(frozen=True, slots=True, eq=False)
class BearingLog:
    """Bearings of landmarks, with the reference pose at each.

    Attributes
    ----------
    name
        Of the run.
    landmarks
        N landmarks, with the survey's sigmas.
    time
        Shape (S,): s, ascending.
    landmark
        Shape (S,): index of the landmark; -1 if it is none.
    bearing
        Shape (S,): rad, robot frame, counter-clockwise, as logged.
    reference
        Shape (S, 3): where the robot was (x, y, heading in W; m, rad), NaN without a reference.
    outcome
        Shape (S,): a :class:`Sighting` each.
    block
        Shape (S,): stretch of the log; sightings of one block may share errors, blocks are taken as
        independent.
    odometry
        Shape (T, 3): time (s), forward speed (m/s), turn rate (rad/s); empty if there is none.
    track
        Shape (U, 4): time, x, y, heading of the reference, as logged; empty if there is none.

    Raises
    ------
    LogFormatError
        If shapes disagree, times go back, or odometry, track or a usable sighting lacks a number.
    """

    name: str
    landmarks: LandmarkSet
    time: FloatArray
    landmark: IntArray
    bearing: FloatArray
    reference: FloatArray
    outcome: IntArray
    block: IntArray
    odometry: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    track: FloatArray = field(default_factory=lambda: np.empty((0, 4)))

    def __post_init__(self) -> None:
        for name in ("time", "bearing", "reference", "odometry", "track"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("landmark", "outcome", "block"):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype=np.int64))
        n = len(self.time)
        for name in ("time", "landmark", "bearing", "outcome", "block"):
            if getattr(self, name).shape != (n,):
                raise LogFormatError(
                    f"Log '{self.name}': {name} has shape {getattr(self, name).shape}, not ({n},)."
                )
        if self.reference.shape != (n, 3):
            raise LogFormatError(
                f"Log '{self.name}': reference has shape {self.reference.shape}, not ({n}, 3)."
            )
        for name, columns in (("odometry", 3), ("track", 4)):
            rows = getattr(self, name)
            if rows.ndim != 2 or rows.shape[1] != columns or not np.isfinite(rows).all():
                raise LogFormatError(
                    f"Log '{self.name}': its {name} has shape {rows.shape}; "
                    f"it must be {columns} finite numbers a line."
                )
        for name, array in (
            ("sightings", self.time),
            ("odometry", self.odometry[:, 0]),
            ("track", self.track[:, 0]),
        ):
            if not np.isfinite(array).all() or (np.diff(array) < 0).any():
                raise LogFormatError(f"Log '{self.name}': the times of its {name} are not ascending.")
        used = self.usable
        if ((self.landmark[used] < 0) | (self.landmark[used] >= len(self.landmarks))).any():
            raise LogFormatError(f"Log '{self.name}': a usable sighting has no landmark.")
        if not (np.isfinite(self.bearing[used]).all() and np.isfinite(self.reference[used]).all()):
            raise LogFormatError(f"Log '{self.name}': a usable sighting has a number that is not finite.")

    @property
    def usable(self) -> BoolArray:
        """Shape (S,): landmark known and reference at hand."""
        return np.asarray(self.outcome == Sighting.USABLE)

    def count(self, outcome: Sighting) -> int:
        """How many sightings ended so."""
        return int(np.sum(self.outcome == outcome))

    def only(self, keep: BoolArray) -> BearingLog:
        """The log with some of its sightings, shape (S,)."""
        return BearingLog(
            self.name,
            self.landmarks,
            self.time[keep],
            self.landmark[keep],
            self.bearing[keep],
            self.reference[keep],
            self.outcome[keep],
            self.block[keep],
            self.odometry,
            self.track,
        )


def expected_bearings(poses: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bearings (S,) rad and ranges (S,) m of places (S, 2) from poses (S, 3)."""
    dx, dy = places[:, 0] - poses[:, 0], places[:, 1] - poses[:, 1]
    return wrap(np.arctan2(dy, dx) - poses[:, 2]), np.hypot(dx, dy)


def residuals(log: BearingLog) -> tuple[FloatArray, FloatArray]:
    """Measured minus expected bearings (S,) rad and ranges (S,) m; NaN where a sighting is not usable."""
    places = log.landmarks.positions[np.maximum(log.landmark, 0)]
    expected, distance = expected_bearings(log.reference, places)
    used = log.usable
    return np.where(used, wrap(log.bearing - expected), np.nan), np.where(used, distance, np.nan)


def interpolated(track: FloatArray, times: FloatArray, max_gap: float = MAX_GAP_S) -> FloatArray:
    """Poses (S, 3) at ``times`` (S,) between those of a ``track`` (U, 4): time, x, y, heading.

    NaN before the first, after the last, and inside gaps longer than ``max_gap`` seconds. Headings turn the
    short way.
    """
    out = np.full((len(times), 3), np.nan)
    if len(track) < 2:
        return out
    right = np.clip(np.searchsorted(track[:, 0], times, side="right"), 1, len(track) - 1)
    a, b = track[right - 1], track[right]
    span = b[:, 0] - a[:, 0]
    inside = (times >= a[:, 0]) & (times <= b[:, 0]) & (span <= max_gap + _ROUNDING_S)
    share = np.divide(times - a[:, 0], span, out=np.zeros(len(times)), where=span > 0)
    pose = a[:, 1:] + share[:, None] * (b[:, 1:] - a[:, 1:])
    pose[:, 2] = wrap(a[:, 3] + share * wrap(b[:, 3] - a[:, 3]))
    out[inside] = pose[inside]
    return out


def driven_between(
    odometry: FloatArray, times: FloatArray, *, max_gap: float = MAX_ODOMETRY_GAP_S
) -> tuple[FloatArray, FloatArray]:
    """Distance (m) and turn (rad) that the odometry (T, 3) reports up to each of ``times`` (S,), summed.

    A speed holds until the next line; distances count backwards as negative. Over gaps longer than
    ``max_gap`` seconds nothing is counted: :func:`unknown_between` tells them from standing still.

    Parameters
    ----------
    odometry
        Time (s), speed (m/s), turn rate (rad/s) a line.
    times
        Ascending, s.
    max_gap
        s.
    """
    if len(odometry) == 0 or len(times) == 0:
        return np.zeros(len(times)), np.zeros(len(times))
    line = odometry[:, 0]
    length = np.diff(line, append=max(line[-1], times[-1]))
    speed = np.where((length <= max_gap + _ROUNDING_S)[:, None], odometry[:, 1:], 0.0)
    sums = np.zeros((len(odometry), 2))
    sums[1:] = np.cumsum(speed[:-1] * length[:-1, None], axis=0)
    at = np.clip(np.searchsorted(line, times, side="right") - 1, 0, None)
    rest = np.maximum(times - line[at], 0.0)
    total = sums[at] + speed[at] * rest[:, None]
    return np.asarray(total[:, 0]), np.asarray(total[:, 1])


def unknown_between(
    odometry: FloatArray, times: FloatArray, *, max_gap: float = MAX_ODOMETRY_GAP_S
) -> FloatArray:
    """Seconds in gaps of the odometry (T, 3) up to each of ``times`` (S,), summed: motion is unknown there.

    Gaps lie between lines more than ``max_gap`` seconds apart, and where more than that lies before the first
    or after the last line. A gap is unknown from its first moment on: its line may be the last true one.

    Parameters
    ----------
    odometry, times, max_gap
        As for :func:`driven_between`.
    """
    if len(times) == 0:
        return np.zeros(0)
    line = odometry[:, 0]
    outer = times[[0, -1]] if len(line) == 0 else [min(times[0], line[0]), max(times[-1], line[-1])]
    knots = np.unique(np.concatenate([outer, line]))
    length = np.diff(knots)
    sums = np.concatenate([[0.0], np.cumsum(np.where(length > max_gap + _ROUNDING_S, length, 0.0))])
    return np.asarray(np.interp(times, knots, sums))


def scans(
    log: BearingLog, *, window: float = 0.5, still_m: float = 0.01, still_rad: float = 0.005
) -> list[IntArray]:
    """Usable sightings taken from one place: indices of each scan, every landmark once.

    A scan starts with a sighting and takes in those of the next ``window`` seconds while the odometry has no
    gap and reports no more than ``still_m`` and ``still_rad``. Sightings with one time stamp are always
    together. A landmark seen again in a scan counts with its first sighting.

    Parameters
    ----------
    log
        With odometry; without, only equal time stamps make a scan.
    window
        s.
    still_m, still_rad
        What counts as standing still, m and rad.
    """
    used = np.flatnonzero(log.usable)
    t = log.time[used]
    distance, turn = driven_between(log.odometry, t)
    unknown = unknown_between(log.odometry, t)
    reach = window if len(log.odometry) else 0.0
    out: list[IntArray] = []
    start = 0
    for end in range(1, len(used) + 1):
        if end < len(used) and (
            t[end] == t[start]
            or t[end] == t[end - 1]
            or (
                t[end] - t[start] <= reach
                and unknown[end] == unknown[start]
                and abs(distance[end] - distance[start]) <= still_m
                and abs(turn[end] - turn[start]) <= still_rad
            )
        ):
            continue
        members = used[start:end]
        _, first = np.unique(log.landmark[members], return_index=True)
        out.append(np.sort(members[first]))
        start = end
    return out


def blocks_of(time: FloatArray, length: float) -> IntArray:
    """Number (S,) of the stretch of ``length`` seconds that a time lies in, from the first on."""
    if len(time) == 0:
        return np.empty(0, dtype=np.int64)
    return np.asarray(np.floor((time - time[0]) / length), dtype=np.int64)


def blocks_at_jumps(poses: FloatArray, jump: float) -> IntArray:
    """Number (S,) of the stretch of poses (S, 3) without a step of ``jump`` metres or more."""
    if len(poses) == 0:
        return np.empty(0, dtype=np.int64)
    step = np.hypot(np.diff(poses[:, 0]), np.diff(poses[:, 1]))
    return np.concatenate([[0], np.cumsum(~(step < jump))]).astype(np.int64)


def delayed(log: BearingLog, lag: float) -> BearingLog:
    """The log with its sightings ``lag`` seconds earlier: references looked up again, outcomes renewed.

    For a sensor whose time stamps come after the exposure.
    """
    time = log.time - lag
    reference = interpolated(log.track, time)
    outcome = log.outcome.copy()
    known = (outcome == Sighting.USABLE) | (outcome == Sighting.NO_REFERENCE)
    outcome[known] = np.where(np.isnan(reference[known, 0]), Sighting.NO_REFERENCE, Sighting.USABLE)
    return BearingLog(
        log.name,
        log.landmarks,
        time,
        log.landmark,
        log.bearing,
        reference,
        outcome,
        log.block,
        log.odometry,
        log.track,
    )


def between(log: BearingLog, first: float, last: float) -> BearingLog:
    """The part of a log from ``first`` to ``last`` s: sightings, odometry and reference."""
    inside = (log.time >= first) & (log.time <= last)
    part = log.only(np.asarray(inside))
    driven = (log.odometry[:, 0] >= first) & (log.odometry[:, 0] <= last)
    known = (log.track[:, 0] >= first) & (log.track[:, 0] <= last)
    return BearingLog(
        log.name,
        log.landmarks,
        part.time,
        part.landmark,
        part.bearing,
        part.reference,
        part.outcome,
        part.block,
        log.odometry[driven],
        log.track[known],
    )
