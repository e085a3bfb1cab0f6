"""The best landmark triplet at a place, and the ranking behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from localization.errors import LocalizationError
from localization.kernels.field import in_view, ranked_at
from localization.kernels.fix import triplet_fix
from localization.kernels.share import triplet_share
from localization.method import FieldMethod
from localization.numbers import as_heading, as_place, is_number
from localization.sensors import Criterion, Sensor, kernel_args
from localization.tiles import compute_tile
from maps.arrays import FloatArray, frozen
from maps.se2 import wrap
from maps.visibility import visible_landmarks
from maps.world import World

MAX_RANKED = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class TripletChoice:
    """A triplet at a place and the fix that it gives.

    Attributes
    ----------
    triplet
        Ascending indices into ``world.landmarks``.
    covariance
        Shape (3,): xx, xy, yy in W, m².
    sigma_theta
        Standard deviation of the heading, rad.
    pan
        Optical axis relative to the pan head's zero, rad; NaN without a pan head.
    n_visible
        Landmarks that can be measured: in range, facing, line of sight, not muted, in a fixed camera's view.
    validity
        Predicted share of fixes inside the 95 % ellipse, 0.95 where first order holds.
    """

    triplet: tuple[int, int, int]
    covariance: FloatArray
    sigma_theta: float
    pan: float
    n_visible: int
    validity: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance))

    @property
    def area95(self) -> float:
        """Area of the 95 % ellipse, m²."""
        return float(cov.area95(self.covariance))

    @property
    def r95(self) -> float:
        """Radius of the circle with that area, m."""
        return float(cov.r95(self.covariance))


def pack_masks(visible: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint64]:
    """Bit masks (P, n_words) of visibilities (P, N): bit ``i % 64`` of word ``i // 64`` for landmark i."""
    n_words = max(1, -(-visible.shape[1] // 64))
    padded = np.zeros((visible.shape[0], n_words * 64), dtype=np.bool_)
    padded[:, : visible.shape[1]] = visible
    packed = np.packbits(padded, axis=1, bitorder="little")
    return np.ascontiguousarray(packed).view("<u8").astype(np.uint64, copy=False)


def best_triplet(
    world: World,
    sensor: Sensor,
    point: npt.ArrayLike,
    *,
    heading: float = 0.0,
    criterion: Criterion = "area",
) -> TripletChoice | None:
    """The triplet whose fix is best, by default with the smallest 95 % ellipse, as in a field's cell there.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    point
        Shape (2,): where the robot is, W, m.
    heading
        Of the robot, rad; matters to sensors that depend on it.
    criterion
        What is smallest: the ellipse's ``area`` or major axis (``max_axis``), or the covariance's ``trace``.

    Returns
    -------
    choice
        None where no triplet gives a fix, or the place is not free.

    Raises
    ------
    LocalizationError
        If the point is not two finite numbers.
    """
    place, seen = _seen_at(world, sensor, point, heading)
    free = np.array([[bool(world.floor.free_at(place))]])
    masks = pack_masks(seen[None, :])[None, :, :]
    centre = place.reshape(1, 1, 2)
    method = FieldMethod(criterion=criterion)
    tile = compute_tile(world, sensor, centre, free, masks, heading=float(wrap(heading)), method=method)
    if tile.triplet[0, 0, 0] < 0:
        return None
    i, j, k = (int(t) for t in tile.triplet[0, 0])
    return TripletChoice(
        (i, j, k),
        tile.covariance[0, 0],
        float(tile.sigma_theta[0, 0]),
        float(tile.pan[0, 0]),
        int(tile.n_visible[0, 0]),
        float(tile.validity[0, 0]),
    )


def rank_triplets(
    world: World,
    sensor: Sensor,
    point: npt.ArrayLike,
    *,
    heading: float = 0.0,
    count: int = 10,
    criterion: Criterion = "area",
) -> list[TripletChoice]:
    """The best triplets at a place, best first; equal ones by ascending indices.

    Parameters
    ----------
    world, sensor, point, heading, criterion
        As for :func:`best_triplet`.
    count
        How many at most, 1 to 10,000.

    Returns
    -------
    choices
        Empty where no triplet gives a fix, or the place is not free.

    Raises
    ------
    LocalizationError
        If the point is not two finite numbers or the count is out of range.
    """
    if not is_number(count) or not 1 <= count <= MAX_RANKED:
        raise LocalizationError(f"Count of triplets is {count}; it must be from 1 to {MAX_RANKED}.")
    place, visible = _seen_at(world, sensor, point, heading)
    if not bool(world.floor.free_at(place)):
        return []
    return ranked_of(world, sensor, place, heading, np.flatnonzero(visible), count=count, criterion=criterion)


def ranked_of(
    world: World,
    sensor: Sensor,
    place: FloatArray,
    heading: float,
    indices: npt.NDArray[np.int64],
    *,
    count: int,
    criterion: Criterion,
) -> list[TripletChoice]:
    """The best triplets of the landmarks ``indices`` (n,) at a place (2,), W, m, as if nothing hid them."""
    positions, survey = world.landmarks.positions, world.landmarks.sigma**2
    args = kernel_args(sensor, float(wrap(heading)), criterion)
    x, y = (float(v) for v in place + sensor.mount.offset(heading))
    kept = indices.copy()
    kept = kept[: in_view(x, y, len(kept), kept, positions, args)]
    if len(kept) < 3:
        return []
    values = np.empty(min(count, math.comb(len(kept), 3)))
    triplets = np.empty((len(values), 3), dtype=np.int64)
    found = ranked_at(x, y, kept, positions, survey, args, values, triplets)
    choices = []
    for i, j, k in triplets[:found].tolist():
        xx, xy, yy, variance, pan = triplet_fix(x, y, i, j, k, positions, survey, args)
        if not math.isnan(xx):
            share = float(triplet_share(x, y, i, j, k, pan, positions, survey, args))
            covariance = np.array([xx, xy, yy])
            choices.append(TripletChoice((i, j, k), covariance, math.sqrt(variance), pan, len(kept), share))
    return choices


def _seen_at(
    world: World, sensor: Sensor, point: npt.ArrayLike, heading: float
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """The point, and the landmarks that are visible from where the sensor is then."""
    place, heading = as_place(point), as_heading(heading)
    sensor_at = place + sensor.mount.offset(heading)
    ranges = {"min_range": sensor.min_range, "max_range": sensor.max_range}
    return place, visible_landmarks(world, sensor_at[None, :], **ranges)[0]
