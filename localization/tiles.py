"""Windows of cells: the fix at every free place of one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from localization.kernels.all_visible import all_visible_tile
from localization.kernels.field import field_tile
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import Sensor, kernel_args
from maps.arrays import BoolArray, FloatArray, IntArray
from maps.world import World

TILE = 128


@dataclass(frozen=True, slots=True, eq=False)
class FieldTile:
    """The field of a window of cells; arrays as in an uncertainty field."""

    covariance: FloatArray
    sigma_theta: FloatArray
    triplet: IntArray
    pan: FloatArray
    n_visible: IntArray
    validity: npt.NDArray[np.float32]

    @classmethod
    def blank(cls, shape: tuple[int, ...]) -> FieldTile:
        """A window of a shape, e.g. (h, w), without a fix."""
        return cls(
            np.full((*shape, 3), np.nan),
            np.full(shape, np.nan),
            np.full((*shape, 3), -1, dtype=np.int16),
            np.full(shape, np.nan),
            np.zeros(shape, dtype=np.int16),
            np.full(shape, np.nan, dtype=np.float32),
        )


def tile_windows(shape: tuple[int, int], tile: int = TILE) -> list[tuple[slice, slice]]:
    """Windows (rows, cols) that cover a grid of ``shape`` once, row by row."""
    return [
        (slice(r, min(r + tile, shape[0])), slice(c, min(c + tile, shape[1])))
        for r in range(0, shape[0], tile)
        for c in range(0, shape[1], tile)
    ]


def compute_tile(
    world: World,
    sensor: Sensor,
    centres: FloatArray,
    free: BoolArray,
    masks: npt.NDArray[np.uint64],
    *,
    heading: float = 0.0,
    method: FieldMethod = BEST_AREA,
) -> FieldTile:
    """The fix at every free point of a window, by the best triplet or by all landmarks in view.

    The result of a cell depends on nothing but its own position, mask, world, sensor, heading and method.

    Parameters
    ----------
    world, sensor
        Landmarks (with their survey sigmas) and what measures them.
    centres
        Shape (h, w, 2), W, m: the robot's centre.
    free
        Shape (h, w): cells to compute; the others stay NaN, -1 and 0.
    masks
        Shape (h, w, n_words): bit ``i % 64`` of word ``i // 64`` says that landmark i is visible from
        where the sensor is when the robot's centre is there.
    heading
        Of the robot, rad.
    method
        Estimator and criterion. For ``all_visible`` triplets stay -1 and validity NaN.
    """
    tile = FieldTile.blank((free.shape[0], free.shape[1]))
    sigma = world.landmarks.sigma
    places = (np.ascontiguousarray(centres), np.ascontiguousarray(free), np.ascontiguousarray(masks))
    args = kernel_args(sensor, heading, method.criterion)
    if method.estimator == "all_visible":
        all_visible_tile(
            *places,
            world.landmarks.positions,
            sigma**2,
            args,
            tile.covariance,
            tile.sigma_theta,
            tile.pan,
            tile.n_visible,
        )
        return tile
    field_tile(
        *places,
        world.landmarks.positions,
        sigma**2,
        bool(np.any(sigma > 0)),
        args,
        tile.covariance,
        tile.sigma_theta,
        tile.triplet,
        tile.pan,
        tile.n_visible,
        tile.validity,
    )
    return tile
