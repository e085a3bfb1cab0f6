"""Builds uncertainty fields: visibility, then the best triplet of every free cell, tile by tile."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice

import numpy as np
import shapely

from localization.errors import Cancelled, FieldTooLarge, LocalizationError
from localization.heading_field import HeadingField, heading_bins
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import LASER, Sensor
from localization.tiles import FieldTile, compute_tile, tile_windows
from localization.triplets import rank_triplets
from localization.uncertainty_field import LAYERS, UncertaintyField
from maps.arrays import BoolArray, FloatArray
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.se2 import wrap
from maps.visibility import VisibilityMap, compute_visibility
from maps.world import World

#: A field takes about 50 bytes per cell.
MAX_CELLS_DEFAULT = 200_000_000


def build_field(
    world: World,
    sensor: Sensor,
    *,
    resolution: float = 0.1,
    heading: float = 0.0,
    method: FieldMethod = BEST_AREA,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    max_cells: int = MAX_CELLS_DEFAULT,
) -> UncertaintyField:
    """Uncertainty field of a world under a sensor.

    For every cell whose centre is free: the landmark triplet, among all visible ones that the sensor can
    see together, whose fix is best, exactly (or all landmarks in view together); its covariance, heading
    sigma, pan and validity.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    resolution
        Side of a cell, m.
    heading
        Heading of the robot, rad; matters only to sensors that depend on it.
    method
        Estimator and criterion; by default the triplet with the smallest 95 % ellipse.
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
    LocalizationError
        If the heading is not finite.
    Cancelled
        If ``cancelled()`` said so.

    Notes
    -----
    A landmark within a millimetre of the sensor has no bearing there and does not count.
    """
    world.require_triangulation()
    if not math.isfinite(heading):
        raise LocalizationError(f"Heading is {heading}; it must be finite, rad.")
    frame = _checked_frame(world, resolution, max_cells)
    turned = float(wrap(heading)) if sensor.depends_on_heading else 0.0
    return _built(world, sensor, frame, [turned], method, _Run(threads, progress, cancelled))[0]


def build_heading_field(
    world: World,
    sensor: Sensor,
    *,
    resolution: float = 0.1,
    headings: int = 36,
    method: FieldMethod = BEST_AREA,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    max_cells: int = MAX_CELLS_DEFAULT,
) -> HeadingField:
    """Uncertainty field over (x, y, heading) of a sensor that depends on the heading.

    Parameters
    ----------
    world, sensor, resolution, method, threads, progress, cancelled, max_cells
        As for :func:`build_field`; the limit is for cells times headings.
    headings
        Number of evenly spaced headings, the first 0 rad.

    Raises
    ------
    LocalizationError
        If the sensor does not depend on the heading, or the number is out of range.
    TooFewLandmarks, FieldTooLarge, InvalidGeometry, Cancelled
        As for :func:`build_field`.
    """
    world.require_triangulation()
    bins = heading_bins(headings)
    if not sensor.depends_on_heading:
        raise LocalizationError(
            f"This sensor ('{sensor.kind}') sees the same at every heading; build a field without headings."
        )
    frame = _checked_frame(world, resolution, max_cells // headings)
    turned = [float(h) for h in bins]
    return HeadingField(
        tuple(_built(world, sensor, frame, turned, method, _Run(threads, progress, cancelled)))
    )


def _built(
    world: World, sensor: Sensor, frame: GridFrame, headings: list[float], method: FieldMethod, run: _Run
) -> list[UncertaintyField]:
    """One field per heading; what does not depend on the heading is computed once."""
    windows = tile_windows(frame.shape)
    n_landmarks = len(world.landmarks)
    # A sensor off the robot's centre is elsewhere at every heading and sees other landmarks.
    groups = [[h] for h in headings] if sensor.mount.lever > 0 else [headings]
    steps = _Steps(n_landmarks * len(groups) + len(windows) * len(headings), run.progress, run.cancelled)
    steps.advance(0)
    is_free = _free_lookup(world, frame)
    free = np.zeros(frame.shape, dtype=np.bool_)
    tiles = {h: FieldTile.blank(frame.shape) for h in headings}
    with ThreadPoolExecutor(run.workers) as pool:
        for group in groups:
            begun = steps.done
            visibility = compute_visibility(
                world,
                frame,
                min_range=sensor.min_range,
                max_range=sensor.max_range,
                offset=sensor.mount.offset(group[0]),
                threads=run.workers,
                tick=lambda n, _, begun=begun: steps.advance(begun + n),  # type: ignore[misc]
            )
            begun += n_landmarks
            steps.advance(begun)

            def work(
                window: tuple[slice, slice], group: list[float] = group, seen: VisibilityMap = visibility
            ) -> None:
                centres = frame.centres(*window)
                free[window] = is_free(window, centres)
                masks = seen.masks(*window)
                for heading in group:
                    tile = compute_tile(
                        world, sensor, centres, free[window], masks, heading=heading, method=method
                    )
                    for name in LAYERS:
                        getattr(tiles[heading], name)[window] = getattr(tile, name)

            for finished in _in_turn(pool, work, windows, run.workers):
                steps.advance(begun + finished * len(group))
    free.flags.writeable = False  # handed over without a copy
    fields = []
    for heading in headings:
        layers = {name: getattr(tiles[heading], name) for name in LAYERS}
        for array in layers.values():
            array.flags.writeable = False
        fields.append(UncertaintyField(world, sensor, frame, heading, free, **layers, method=method))
    return fields


def warm_up() -> None:
    """Compile, or load from the cache, what fields and triplets need: well below a second when cached."""
    ring = np.array([[0.5, 0.5], [2.5, 0.5], [1.5, 2.5], [0.5, 2.5]])
    landmarks = LandmarkSet(tuple("abcd"), ring)
    frame = GridFrame(0.0, 0.0, 0.0, 1.0, 3, 3)
    grid = OccupancyGrid(frame, np.ones((3, 3), dtype=np.bool_), np.zeros((3, 3), dtype=np.bool_))
    plan = FloorPlan((shapely.box(0.0, 0.0, 3.0, 3.0),))
    for floor in (grid, plan):
        world = World("warm-up", floor, landmarks)
        build_field(world, LASER, resolution=1.0, threads=1)
        rank_triplets(world, LASER, (1.25, 1.25))


@dataclass(frozen=True, slots=True)
class _Run:
    """How to work: threads, whom to tell, whom to ask."""

    threads: int | None
    progress: Callable[[int, int], None] | None
    cancelled: Callable[[], bool] | None

    @property
    def workers(self) -> int:
        return max(1, self.threads or os.cpu_count() or 1)


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
        self.done = -1

    def advance(self, done: int) -> None:
        if self._cancelled is not None and self._cancelled():
            raise Cancelled(f"The field was cancelled after {max(self.done, 0)} of {self._total} steps.")
        if done > self.done:
            self.done = done
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
            # Largest 1/resolution with (width/resolution + 1)(height/resolution + 1) ≤ max_cells.
            half, area = 0.5 * (width + height), width * height
            enough = area / max(math.sqrt(half**2 + area * (max_cells - 1)) - half, 1e-9)
            raise FieldTooLarge(
                f"At {resolution:g} m the field of '{world.name}' has {cells} cells, the limit is "
                f"{max_cells}; use a resolution of {enough * 1.01:.3g} m or more."
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
