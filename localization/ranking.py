"""Why a place is good or bad: its triplets ranked, and what keeps the other landmarks and triplets out."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from localization.errors import LocalizationError
from localization.kernels.census import DEGENERATE_TRIPLET, FIX, NOT_IN_ONE_VIEW, count_outcomes, outcome
from localization.kernels.field import TOUCH_M, inverted
from localization.kernels.fix import is_muted
from localization.sensors import Criterion, OmnidirectionalSensor, PinholePanSensor, Sensor, kernel_args
from localization.triplets import TripletChoice, rank_triplets, ranked_of
from maps.arrays import FloatArray, frozen
from maps.se2 import wrap
from maps.visibility import visible_landmarks
from maps.world import World

# Beyond it triplets are not counted one by one: 5 million take a tenth of a second.
_MAX_COUNTED = 5_000_000
_ANGLE_TOLERANCE = 1e-9


class LandmarkStatus(StrEnum):
    """Whether a landmark can be measured from a place, and if not, why."""

    MEASURABLE = "measurable"
    TOO_NEAR = "too_near"
    TOO_FAR = "too_far"
    TURNED_AWAY = "turned_away"
    HIDDEN = "hidden"
    MUTED = "muted"
    OUTSIDE_VIEW = "outside_view"


class TripletStatus(StrEnum):
    """Whether a triplet gives a fix at a place, and if not, why."""

    FIX = "fix"
    NOT_VISIBLE = "not_visible"
    NOT_IN_ONE_VIEW = "not_in_one_view"
    DEGENERATE = "degenerate"


_OUTCOMES = {
    FIX: TripletStatus.FIX,
    NOT_IN_ONE_VIEW: TripletStatus.NOT_IN_ONE_VIEW,
    DEGENERATE_TRIPLET: TripletStatus.DEGENERATE,
}


@dataclass(frozen=True, slots=True, eq=False)
class PlaceReport:
    """What a place offers.

    Attributes
    ----------
    point
        Shape (2,): the robot's centre, W, m.
    heading
        Of the robot, rad.
    is_free
        Whether the robot's centre may be there at all; if not, nothing is ranked.
    landmarks
        Status of each of the N landmarks of the world. ``OUTSIDE_VIEW`` is one that a fixed camera, or a pan
        head within its limits, cannot turn to.
    distance
        Shape (N,): from the sensor, m.
    ranked
        The triplets that give a fix, best first.
    counts
        How many of all triplets of the N landmarks have which status; None when there are too many to count.
    missed
        Triplets that would rank with the best if every landmark in range could be seen, best first, without
        those in ``ranked``: what a better place for a landmark, or for an obstacle, could bring.
    """

    point: FloatArray
    heading: float
    is_free: bool
    landmarks: tuple[LandmarkStatus, ...]
    distance: FloatArray
    ranked: tuple[TripletChoice, ...]
    counts: dict[TripletStatus, int] | None
    missed: tuple[TripletChoice, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen(self.point))
        object.__setattr__(self, "distance", frozen(self.distance))

    def blocking(self, triplet: tuple[int, int, int]) -> dict[int, LandmarkStatus]:
        """Those of a triplet's landmarks that cannot be measured, and why."""
        return {i: self.landmarks[i] for i in triplet if self.landmarks[i] is not LandmarkStatus.MEASURABLE}


def explain_place(
    world: World,
    sensor: Sensor,
    point: npt.ArrayLike,
    *,
    heading: float = 0.0,
    count: int = 10,
    criterion: Criterion = "area",
) -> PlaceReport:
    """Rank the triplets at a place and say what keeps the others out.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    point
        Shape (2,): the robot's centre, W, m.
    heading
        Of the robot, rad; matters to sensors that depend on it.
    count
        How many ranked, and how many missed triplets at most, 1 to 10,000.
    criterion
        What makes a triplet better.

    Returns
    -------
    report
        See there.

    Raises
    ------
    LocalizationError
        If the point or heading is not finite or the count is out of range.
    """
    ranked = rank_triplets(world, sensor, point, heading=heading, count=count, criterion=criterion)
    place = np.asarray(point, dtype=np.float64)
    at = place + sensor.mount.offset(heading)
    turned = float(wrap(heading))
    landmarks = landmark_statuses(world, sensor, at, turned)
    distance = np.hypot(*(world.landmarks.positions - at).T)
    is_free = bool(world.floor.free_at(place))
    in_range = np.array(
        [
            i
            for i, s in enumerate(landmarks)
            if s not in {LandmarkStatus.TOO_NEAR, LandmarkStatus.TOO_FAR, LandmarkStatus.MUTED}
        ],
        dtype=np.int64,
    )
    taken = {c.triplet for c in ranked}
    missed: list[TripletChoice] = []
    if is_free:
        every = ranked_of(world, sensor, place, heading, in_range, count=2 * count, criterion=criterion)
        missed = [c for c in every if c.triplet not in taken and _is_out(c.triplet, landmarks)]
    return PlaceReport(
        place,
        turned,
        is_free,
        landmarks,
        distance,
        tuple(ranked),
        _counted(world, sensor, at, turned, landmarks) if is_free else None,
        tuple(missed[:count]),
    )


def triplet_status(
    world: World,
    sensor: Sensor,
    point: npt.ArrayLike,
    triplet: Sequence[int],
    *,
    heading: float = 0.0,
) -> TripletStatus:
    """Whether one triplet (indices into ``world.landmarks``) gives a fix at a place, and if not, why.

    Raises
    ------
    LocalizationError
        If a landmark's measurement cannot even be spoken of: the point or heading is not finite, or the
        indices are not three different ones of the world's landmarks.
    """
    indices = checked_triplet(world, triplet)
    rank_triplets(world, sensor, point, heading=heading, count=1)  # refuses what is not a place
    place = np.asarray(point, dtype=np.float64)
    at = place + sensor.mount.offset(heading)
    turned = float(wrap(heading))
    if _is_out(indices, landmark_statuses(world, sensor, at, turned)):
        return TripletStatus.NOT_VISIBLE
    arrays = _arrays(world, sensor, at, turned, np.array(sorted(indices), dtype=np.int64))
    return _OUTCOMES[int(outcome(0, 1, 2, *arrays, kernel_args(sensor, turned)))]


def checked_triplet(world: World, triplet: Sequence[int]) -> tuple[int, int, int]:
    """Three different indices into ``world.landmarks``, as plain numbers.

    Raises
    ------
    LocalizationError
        If they are not.
    """
    count = len(world.landmarks)
    try:
        indices = [operator.index(i) for i in triplet]
    except TypeError:
        indices = []
    if len(indices) != 3 or len(set(indices)) != 3 or not all(0 <= i < count for i in indices):
        raise LocalizationError(
            f"Triplet is {triplet!r}; give three different numbers from 0 to {count - 1}."
        )
    return indices[0], indices[1], indices[2]


def one_triplet(
    world: World,
    sensor: Sensor,
    point: npt.ArrayLike,
    triplet: Sequence[int],
    *,
    heading: float = 0.0,
) -> TripletChoice | None:
    """What one triplet gives at a place as if nothing hid its landmarks; None where it gives no fix.

    Raises
    ------
    LocalizationError
        As of :func:`triplet_status`.
    """
    triplet_status(world, sensor, point, triplet, heading=heading)  # refuses what makes no sense
    place = np.asarray(point, dtype=np.float64)
    indices = np.array(sorted(triplet), dtype=np.int64)
    found = ranked_of(world, sensor, place, heading, indices, count=1, criterion="area")
    return found[0] if found else None


def landmark_statuses(
    world: World, sensor: Sensor, at: FloatArray, heading: float
) -> tuple[LandmarkStatus, ...]:
    """Status of each landmark for a sensor at ``at`` (2,), W, m, on a robot with this heading, rad."""
    positions, facing, half = world.landmarks.positions, world.landmarks.facing, world.landmarks.half_angle
    seen = visible_landmarks(world, at[None, :], min_range=sensor.min_range, max_range=sensor.max_range)[0]
    args = kernel_args(sensor, heading)
    out = []
    for i, (x, y) in enumerate(positions):
        dx, dy = float(x - at[0]), float(y - at[1])
        r = math.hypot(dx, dy)
        back = abs(float(wrap(math.atan2(-dy, -dx) - facing[i]))) if not math.isnan(facing[i]) else 0.0
        if r < TOUCH_M or (not seen[i] and r < sensor.min_range):
            status = LandmarkStatus.TOO_NEAR
        elif not seen[i] and r > sensor.max_range:
            status = LandmarkStatus.TOO_FAR
        elif not seen[i] and back > half[i]:
            status = LandmarkStatus.TURNED_AWAY
        elif not seen[i]:
            status = LandmarkStatus.HIDDEN
        elif isinstance(sensor, OmnidirectionalSensor):
            status = LandmarkStatus.MUTED if is_muted(dx, dy, args) else LandmarkStatus.MEASURABLE
        else:
            reachable = _can_turn_to(sensor, math.atan2(dy, dx) - heading - sensor.mount.theta)
            status = LandmarkStatus.MEASURABLE if reachable else LandmarkStatus.OUTSIDE_VIEW
        out.append(status)
    return tuple(out)


def _can_turn_to(sensor: Sensor, bearing: float) -> bool:
    """Whether a camera can have a bearing, rad from its zero, in its view."""
    half = 0.5 * sensor.field_of_view + _ANGLE_TOLERANCE  # type: ignore[union-attr]
    if not isinstance(sensor, PinholePanSensor):
        return abs(float(wrap(bearing))) <= half
    if sensor.has_free_pan:
        return True
    middle, reach = 0.5 * (sensor.pan_min + sensor.pan_max), 0.5 * (sensor.pan_max - sensor.pan_min)
    return abs(float(wrap(bearing - middle))) <= reach + half


def _is_out(triplet: Sequence[int], landmarks: tuple[LandmarkStatus, ...]) -> bool:
    return any(landmarks[i] is not LandmarkStatus.MEASURABLE for i in triplet)


def _arrays(
    world: World, sensor: Sensor, at: FloatArray, heading: float, indices: npt.NDArray[np.int64]
) -> list[FloatArray]:
    """What the triplet kernels take for some landmarks."""
    arrays = [np.empty(len(indices)) for _ in range(5)]
    survey, args = world.landmarks.sigma**2, kernel_args(sensor, heading)
    x, y = (float(v) for v in at)
    inverted(x, y, len(indices), indices, world.landmarks.positions, survey, args, True, *arrays)
    return arrays


def _counted(
    world: World, sensor: Sensor, at: FloatArray, heading: float, landmarks: tuple[LandmarkStatus, ...]
) -> dict[TripletStatus, int] | None:
    ok = np.flatnonzero([s is LandmarkStatus.MEASURABLE for s in landmarks])
    if math.comb(len(ok), 3) > _MAX_COUNTED:
        return None
    counts = count_outcomes(len(ok), *_arrays(world, sensor, at, heading, ok), kernel_args(sensor, heading))
    out = {status: int(counts[code]) for code, status in _OUTCOMES.items()}
    out[TripletStatus.NOT_VISIBLE] = math.comb(len(landmarks), 3) - math.comb(len(ok), 3)
    return out
