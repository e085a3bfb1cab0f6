"""Builds uncertainty fields: visibility, then the best triplet of every free cell, tile by tile."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice

import numpy as np
import numpy.typing as npt
import shapely
from maps.visibility import compute_visibility

from localization.errors import Cancelled, FieldTooLarge
from localization.kernels.field import field_tile
from localization.sensors import LASER, Sensor, kernel_args
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, IntArray
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.se2 import wrap
from maps.world import World

#: A field takes about 50 bytes per cell.
MAX_CELLS_DEFAULT = 200_000_000
TILE = 128


@dataclass(frozen=True, slots=True, eq=False)
class FieldTile:
    """The field of a window of cells; arrays as in an uncertainty field."""

    covariance: FloatArray
    sigma_theta: FloatArray
    triplet: IntArray
    pan: FloatArray
    n_visible: IntArray


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
) -> FieldTile:
    """Best triplet and fix at every free point of a window.

    The result of a cell depends on nothing but its own position, mask, world, sensor and heading.

    Parameters
    ----------
    world, sensor
        Landmarks (with their survey sigmas) and what measures them.
    centres
        Shape (h, w, 2), W, m.
    free
        Shape (h, w): cells to compute; the others stay NaN, -1 and 0.
    masks
        Shape (h, w, n_words): bit ``i % 64`` of word ``i // 64`` says that landmark i is visible.
    heading
        Heading of the robot, rad, to which pan limits and pan angles refer.
    """
    shape = free.shape
    tile = FieldTile(
        np.full((*shape, 3), np.nan),
        np.full(shape, np.nan),
        np.full((*shape, 3), -1, dtype=np.int16),
        np.full(shape, np.nan),
        np.zeros(shape, dtype=np.int16),
    )
    sigma = world.landmarks.sigma
    field_tile(
        np.ascontiguousarray(centres),
        np.ascontiguousarray(free),
        np.ascontiguousarray(masks),
        world.landmarks.positions,
        sigma**2,
        bool(np.any(sigma > 0)),
        kernel_args(sensor, heading),
        tile.covariance,
        tile.sigma_theta,
        tile.triplet,
        tile.pan,
        tile.n_visible,
    )
    return tile


def build_field(
    world: World,
    sensor: Sensor,
    *,
    resolution: float = 0.1,
    heading: float = 0.0,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    max_cells: int = MAX_CELLS_DEFAULT,
) -> UncertaintyField:
    """Uncertainty field of a world under a sensor.

    For every cell whose centre is free: the landmark triplet, among all visible ones that the sensor can
    see together, whose fix has the smallest 95 % ellipse, exactly; its covariance, heading sigma and pan.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    resolution
        Side of a cell, m.
    heading
        Heading of the robot, rad; matters only to a pan head with limits.
    threads
        Default: one per core. The result does not depend on it.
    progress
        Called with (done, total), from this thread, in rising order; total does not change.
    cancelled
        Asked between steps, from this thread; True stops the work.
    max_cells
        Limit for the size of the grid.

    Raises
    ------
    TooFewLandmarks
        If the world has fewer than three.
    FieldTooLarge
        If the grid would have more cells than ``max_cells``.
    InvalidGeometry
        If the resolution is not positive.
    Cancelled
        If ``cancelled()`` said so.

    Notes
    -----
    A landmark within a millimetre of a cell's centre has no bearing there and does not count.
    """
    world.require_triangulation()
    frame = _checked_frame(world, resolution, max_cells)
    heading = float(wrap(heading)) if sensor.depends_on_heading else 0.0
    workers = max(1, threads or os.cpu_count() or 1)
    windows = tile_windows(frame.shape)
    n_landmarks = len(world.landmarks)
    steps = _Steps(n_landmarks + len(windows), progress, cancelled)

    steps.advance(0)
    visibility = compute_visibility(
        world,
        frame,
        min_range=sensor.min_range,
        max_range=sensor.max_range,
        threads=workers,
        tick=lambda done, _: steps.advance(done),
    )
    steps.advance(n_landmarks)

    shape = frame.shape
    free = np.zeros(shape, dtype=np.bool_)
    out = FieldTile(
        np.empty((*shape, 3)),
        np.empty(shape),
        np.empty((*shape, 3), dtype=np.int16),
        np.empty(shape),
        np.empty(shape, dtype=np.int16),
    )
    is_free = _free_lookup(world, frame)

    def work(window: tuple[slice, slice]) -> None:
        centres = frame.centres(*window)
        free[window] = is_free(window, centres)
        tile = compute_tile(world, sensor, centres, free[window], visibility.masks(*window), heading=heading)
        for name in ("covariance", "sigma_theta", "triplet", "pan", "n_visible"):
            getattr(out, name)[window] = getattr(tile, name)

    with ThreadPoolExecutor(workers) as pool:
        for done in _in_turn(pool, work, windows, workers):
            steps.advance(n_landmarks + done)
    arrays = (free, out.covariance, out.sigma_theta, out.triplet, out.pan, out.n_visible)
    for array in arrays:
        array.flags.writeable = False  # handed over without a copy
    return UncertaintyField(world, sensor, frame, heading, *arrays)


def warm_up() -> None:
    """Compile, or load from the cache, what :func:`build_field` needs: about a second when cached."""
    ring = np.array([[0.5, 0.5], [2.5, 0.5], [1.5, 2.5], [0.5, 2.5]])
    landmarks = LandmarkSet(tuple("abcd"), ring)
    frame = GridFrame(0.0, 0.0, 0.0, 1.0, 3, 3)
    grid = OccupancyGrid(frame, np.ones((3, 3), dtype=np.bool_), np.zeros((3, 3), dtype=np.bool_))
    plan = FloorPlan((shapely.box(0.0, 0.0, 3.0, 3.0),))
    for floor in (grid, plan):
        build_field(World("warm-up", floor, landmarks), LASER, resolution=1.0, threads=1)


class _Steps:
    """Progress that only rises, and the question whether to go on."""

    def __init__(
        self,
        total: int,
        progress: Callable[[int, int], None] | None,
        cancelled: Callable[[], bool] | None,
    ) -> None:
        self._total = total
        self._progress = progress
        self._cancelled = cancelled
        self._done = -1

    def advance(self, done: int) -> None:
        if self._cancelled is not None and self._cancelled():
            raise Cancelled(f"The field was cancelled after {max(self._done, 0)} of {self._total} steps.")
        if done > self._done:
            self._done = done
            if self._progress is not None:
                self._progress(done, self._total)


def _in_turn(
    pool: ThreadPoolExecutor,
    work: Callable[[tuple[slice, slice]], None],
    windows: list[tuple[slice, slice]],
    workers: int,
) -> Iterator[int]:
    """Run ``work`` over the windows, few at a time; yields how many are done. Stops when closed."""
    waiting = iter(windows)
    running: set[Future[None]] = set()
    done = 0
    try:
        while True:
            for window in islice(waiting, 2 * workers - len(running)):
                running.add(pool.submit(work, window))
            if not running:
                return
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                future.result()
            done += len(finished)
            yield done
    finally:
        for future in running:
            future.cancel()


def _checked_frame(world: World, resolution: float, max_cells: int) -> GridFrame:
    floor = world.floor
    if math.isfinite(resolution) and resolution > 0:
        x0, y0, x1, y1 = floor.bounds
        width, height = x1 - x0, y1 - y0
        if isinstance(floor, OccupancyGrid):
            width, height = floor.frame.width_m, floor.frame.height_m
        cells = math.ceil(width / resolution - 1e-6) * math.ceil(height / resolution - 1e-6)
        if cells > max_cells:
            enough = resolution * math.sqrt(cells / max_cells)
            raise FieldTooLarge(
                f"At {resolution:g} m the field of '{world.name}' has {cells} cells, the limit is "
                f"{max_cells}; use a resolution of {enough * 1.01:.2g} m or more."
            )
    return world.grid_frame(resolution)


def _free_lookup(world: World, frame: GridFrame) -> Callable[[tuple[slice, slice], FloatArray], BoolArray]:
    """Function that says which centres of a window are free; may be called from several threads."""
    floor = world.floor
    if isinstance(floor, OccupancyGrid):
        if floor.frame == frame:
            return lambda window, _: floor.free[window]
        return lambda _, centres: floor.free_at(centres)
    area = floor.free_space()
    shapely.prepare(area)
    # The prepared geometry builds its index at the first question: ask it before threads do.
    inside = area.representative_point()
    shapely.contains_xy(area, inside.x, inside.y)
    return lambda _, centres: np.asarray(shapely.contains_xy(area, centres[..., 0], centres[..., 1]))
