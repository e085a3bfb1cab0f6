"""Stations along a path, and which landmarks are measured at each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from localization.errors import LocalizationError
from localization.kernels.field import in_view
from localization.kernels.schedule import triplet_variances
from localization.sensors import (
    CENTRE,
    Mount,
    OmnidirectionalSensor,
    PinholeFixedSensor,
    Sensor,
    kernel_args,
)
from localization.tiles import compute_tile
from localization.triplets import pack_masks
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.landmarks import LandmarkSet
from maps.se2 import wrap
from maps.visibility import visible_landmarks
from maps.world import World

MAX_STATIONS = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Stations along a path.

    Attributes
    ----------
    poses
        Shape (K, 3): x, y (m), heading (rad).
    times
        Shape (K,): s, ascending from 0.
    """

    poses: FloatArray
    times: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "poses", frozen(self.poses))
        object.__setattr__(self, "times", frozen(self.times))
        k = len(self.times)
        if self.poses.shape != (k, 3) or k == 0 or self.times.shape != (k,):
            raise LocalizationError(
                f"Poses {self.poses.shape}, times {self.times.shape}; give (K, 3) and (K,)."
            )
        if not (np.isfinite(self.poses).all() and np.isfinite(self.times).all()):
            raise LocalizationError("Poses and times of a drive must be finite.")
        if (np.diff(self.times) < 0).any():
            raise LocalizationError("The times of a drive must ascend.")


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkSchedule:
    """Which landmarks are measured at each station, and how well.

    Attributes
    ----------
    landmarks
        Shape (K, M): indices, -1 for none.
    places
        Shape (K, M, 2): where they stand, W, m.
    variances
        Shape (K, M): of their bearings with the survey's share, rad²; NaN for none.
    mount
        Where the sensor sits on the robot.
    """

    landmarks: IntArray
    places: FloatArray
    variances: FloatArray
    mount: Mount = CENTRE

    def __post_init__(self) -> None:
        object.__setattr__(self, "landmarks", frozen(self.landmarks, dtype=np.int64))
        object.__setattr__(self, "places", frozen(self.places))
        object.__setattr__(self, "variances", frozen(self.variances))
        shape = self.landmarks.shape
        if len(shape) != 2 or self.places.shape != (*shape, 2) or self.variances.shape != shape:
            raise LocalizationError(
                f"A schedule has landmarks {shape}, places {self.places.shape} and variances "
                f"{self.variances.shape}; give (K, M), (K, M, 2) and (K, M)."
            )


def drive_along(
    points: npt.ArrayLike,
    *,
    speed: float,
    turn_rate: float = 1.0,
    spacing: float = 0.1,
    spacing_rad: float = 0.1,
) -> Drive:
    """Stations of a robot that follows a polyline, turning on the spot at its corners.

    Parameters
    ----------
    points
        Shape (K, 2): W, m; the robot starts with the heading of the first leg.
    speed, turn_rate
        m/s and rad/s.
    spacing, spacing_rad
        Largest distance (m) and turn (rad) from station to station.

    Raises
    ------
    LocalizationError
        If a number is impossible, or there would be more than a million stations.
    """
    p = np.asarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 2 or len(p) == 0 or not np.isfinite(p).all():
        raise LocalizationError(f"A path has points (K, 2), finite; these have shape {p.shape}.")
    for name, value in (
        ("speed", speed),
        ("turn_rate", turn_rate),
        ("spacing", spacing),
        ("spacing_rad", spacing_rad),
    ):
        if not (math.isfinite(value) and value > 0):
            raise LocalizationError(f"Drive {name} is {value}; it must be positive and finite.")
    legs = np.diff(p, axis=0)
    length = np.hypot(legs[:, 0], legs[:, 1])
    if np.sum(np.ceil(length / spacing)) + math.pi / spacing_rad * len(p) > MAX_STATIONS:
        raise LocalizationError(
            f"A path of {np.sum(length):.0f} m has too many stations; the limit is {MAX_STATIONS}."
        )
    moving = np.flatnonzero(length > 0)
    azimuths = np.arctan2(legs[moving, 1], legs[moving, 0])
    heading = float(azimuths[0]) if len(moving) else 0.0
    turns = np.asarray(wrap(np.diff(azimuths, prepend=heading)))
    # Every leg is a turn on the spot, which may be none, and a straight way.
    counts = np.ceil(np.column_stack([np.abs(turns) / spacing_rad, length[moving] / spacing])).astype(int)
    seconds = np.column_stack([np.abs(turns) / turn_rate, length[moving] / speed])
    part = np.repeat(np.arange(2 * len(moving)), counts.ravel())
    leg, is_way = part // 2, part % 2 == 1
    before = np.cumsum(counts.ravel()) - counts.ravel()
    share = (np.arange(len(part)) - before[part] + 1) / counts.ravel()[part]
    begun = np.concatenate([[0.0], np.cumsum(seconds.ravel())])
    places = p[moving][leg] + np.where(is_way, share, 0.0)[:, None] * legs[moving][leg]
    came_from = np.concatenate([[heading], azimuths[:-1]])
    headings = np.where(is_way, azimuths[leg], wrap(came_from[leg] + share * turns[leg]))
    poses = np.column_stack([places, headings])
    times = begun[part] + share * seconds.ravel()[part]
    return Drive(np.concatenate([[[p[0, 0], p[0, 1], heading]], poses]), np.concatenate([np.zeros(1), times]))


def schedule_of_triplets(
    drive: Drive, triplets: npt.ArrayLike, landmarks: LandmarkSet, sensor: Sensor
) -> LandmarkSchedule:
    """Schedule with the triplet (K, 3) of each station, -1 for none, as a field or plan names them.

    A pan head looks where it would for that triplet; a triplet that gives no fix there is left out.
    """
    t = np.asarray(triplets, dtype=np.int64)
    if t.shape != (len(drive.times), 3) or (t >= len(landmarks)).any():
        raise LocalizationError(
            f"Triplets have shape {t.shape} for {len(drive.times)} stations and {len(landmarks)} landmarks."
        )
    known: BoolArray = np.asarray((t >= 0).all(axis=1))
    index = np.where(known[:, None], t, -1)
    places = np.where(known[:, None, None], landmarks.positions[np.maximum(index, 0)], np.nan)
    variances = np.full(t.shape, np.nan)
    triplet_variances(
        drive.poses,
        index,
        landmarks.positions,
        landmarks.sigma**2,
        sensor.mount.as_array(),
        kernel_args(sensor),
        variances,
    )
    index = np.where(np.isnan(variances), -1, index)
    return LandmarkSchedule(index, places, variances, sensor.mount)


def best_triplet_schedule(world: World, sensor: Sensor, drive: Drive) -> LandmarkSchedule:
    """Schedule with the best triplet at each station, that of :func:`localization.triplets.best_triplet`."""
    points = drive.poses[:, :2]
    masks = pack_masks(_seen_along(world, sensor, drive))[:, None, :]
    free = np.asarray(world.floor.free_at(points)).reshape(-1, 1)
    centres = points[:, None, :]
    triplets = np.full((len(points), 3), -1, dtype=np.int64)
    if not sensor.depends_on_heading:
        triplets[:] = compute_tile(world, sensor, centres, free, masks).triplet[:, 0]
    else:
        for k in range(len(points)):
            one = slice(k, k + 1)
            heading = float(drive.poses[k, 2])
            tile = compute_tile(world, sensor, centres[one], free[one], masks[one], heading=heading)
            triplets[k] = tile.triplet[0, 0]
    return schedule_of_triplets(drive, triplets, world.landmarks, sensor)


def all_visible_schedule(
    world: World, sensor: OmnidirectionalSensor | PinholeFixedSensor, drive: Drive
) -> LandmarkSchedule:
    """Schedule with every landmark in view at each station, for a sensor that has nothing to choose."""
    seen = _seen_along(world, sensor, drive)
    landmarks = world.landmarks
    positions, survey, n = landmarks.positions, landmarks.sigma**2, len(landmarks)
    variances = np.full(seen.shape, np.nan)
    indices = np.arange(n)
    for k, (x, y, heading) in enumerate(drive.poses.tolist()):
        at = np.array([x, y]) + sensor.mount.offset(heading)
        kept = indices[seen[k]]
        kept = kept[: in_view(at[0], at[1], len(kept), kept, positions, kernel_args(sensor, heading))]
        axis = heading + sensor.mount.theta
        variances[k, kept] = _bearing_variances(sensor, positions[kept] - at, axis, survey[kept])
    index = np.where(np.isnan(variances), -1, indices[None, :])
    places = np.broadcast_to(positions, (len(drive.times), n, 2))
    return LandmarkSchedule(index, places, variances, sensor.mount)


def _seen_along(world: World, sensor: Sensor, drive: Drive) -> BoolArray:
    """Shape (K, N): landmarks visible from where the sensor is at each station."""
    x, y, theta = drive.poses.T
    m = sensor.mount
    at = np.column_stack(
        [x + np.cos(theta) * m.x - np.sin(theta) * m.y, y + np.sin(theta) * m.x + np.cos(theta) * m.y]
    )
    return visible_landmarks(world, at, min_range=sensor.min_range, max_range=sensor.max_range)


def _bearing_variances(sensor: Sensor, to: FloatArray, axis: float, survey: FloatArray) -> FloatArray:
    """Variances (M,) of bearings along ``to`` (M, 2) with the optical axis at an azimuth, survey included."""
    share = survey / np.sum(to * to, axis=1) + sensor.bearing_floor**2
    if isinstance(sensor, OmnidirectionalSensor):
        return np.asarray(sensor.bearing_sigma**2 + share)
    off_axis = np.arctan2(to[:, 1], to[:, 0]) - axis
    on_axis = (sensor.column_sigma_px / sensor.focal_px) ** 2
    return np.asarray(on_axis * np.cos(off_axis) ** 4 + share)
