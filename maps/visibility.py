"""Which landmarks are visible from where, on any floor.

A landmark is visible from a point when the point is within the ranges (inclusive), within the landmark's
viewing cone (inclusive), and the open segment between them passes no opaque place; from the landmark's own
place it is not visible, for it has no bearing there. Cells are judged at their centres, or at one constant
offset from them: where a sensor beside the robot's centre stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray
from maps.errors import InvalidGeometry
from maps.grid import MAX_COORDINATE_M, GridFrame, OccupancyGrid
from maps.grid_visibility import GridSweep, grid_visible
from maps.grid_visibility import buried_landmarks as buried_on_grid
from maps.runs import MaskArray, Runs
from maps.sweeps import MAX_RUN_BYTES, BandedRuns, Sweep, bounded_runs
from maps.vector_visibility import RANGE_TOLERANCE_M, VectorSweep, vector_visible
from maps.vector_visibility import buried_landmarks as buried_in_plan
from maps.world import World


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityMap:
    """Which landmarks each cell of a grid sees, kept as runs of cells and painted on demand.

    Attributes
    ----------
    runs
        Cells per landmark.
    """

    runs: Runs | BandedRuns

    def __reduce__(self) -> tuple[type[VisibilityMap], tuple[Runs | BandedRuns]]:
        return (VisibilityMap, (self.runs,))

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks."""
        return self.runs.n_landmarks

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_rows, n_cols)`` of the grid."""
        return self.runs.shape

    @property
    def n_words(self) -> int:
        """64-bit words per cell."""
        return self.runs.n_words

    def masks(self, rows: slice = slice(None), cols: slice = slice(None)) -> MaskArray:
        """Masks of a window of cells.

        Parameters
        ----------
        rows, cols
            The window; tiles of about 256 × 256 cells are painted fastest. Threads may paint at once.

        Returns
        -------
        masks
            Shape (h, w, n_words), uint64: bit ``i % 64`` of word ``i // 64`` says whether landmark i is
            visible from the cell's centre (plus the offset), by the rule of :func:`visible_landmarks` also
            where that place is not free.
        """
        return self.runs.masks(rows, cols)


def compute_visibility(
    world: World,
    frame: GridFrame,
    *,
    min_range: float = 0.0,
    max_range: float = math.inf,
    offset: tuple[float, float] = (0.0, 0.0),
    threads: int | None = None,
    tick: Callable[[int, int], None] | None = None,
    max_run_bytes: int = MAX_RUN_BYTES,
) -> VisibilityMap:
    """Visibility of all landmarks of a world from all cells of a grid.

    Parameters
    ----------
    world
        Floor and N landmarks.
    frame
        The cells, usually ``world.grid_frame(resolution)``.
    min_range, max_range
        Distances at which the sensor sees, m, inclusive.
    offset
        (x, y) in W, m: cells are judged at their centres plus this. Ranges, viewing cones and lines of sight
        all hold from there.
    threads
        Default: one per core. The result does not depend on it.
    tick
        Called with (landmarks done, N) as the work goes on, from the calling thread; it may raise to stop.
    max_run_bytes
        What runs may take. More of them are made band by band, when masks are asked for: slower, and the same
        masks.

    Raises
    ------
    InvalidGeometry
        If a range is impossible, the offset not finite, or the frame does not suit the floor.
    """
    _check_ranges(min_range, max_range)
    frame = _moved(frame, offset)
    floor, landmarks = world.floor, world.landmarks
    sweep: Sweep
    if isinstance(floor, OccupancyGrid):
        sweep = GridSweep.of(floor, landmarks, frame, min_range=min_range, max_range=max_range)
    else:
        sweep = VectorSweep.of(floor, landmarks, frame, min_range=min_range, max_range=max_range)
    return VisibilityMap(bounded_runs(sweep, limit=max_run_bytes, threads=threads, tick=tick))


def visible_landmarks(
    world: World,
    points: npt.ArrayLike,
    *,
    min_range: float = 0.0,
    max_range: float = math.inf,
) -> BoolArray:
    """Which landmarks are visible from single points, by the same rule as :func:`compute_visibility`.

    Parameters
    ----------
    world
        Floor and N landmarks.
    points
        Shape (P, 2), W, m.
    min_range, max_range
        m, inclusive.

    Returns
    -------
    visible
        Shape (P, N), bool.

    Raises
    ------
    InvalidGeometry
        If a range is impossible, a coordinate not finite or the shape wrong.
    """
    _check_ranges(min_range, max_range)
    p = np.array(points, dtype=np.float64).reshape(-1, 2) if np.size(points) == 0 else np.array(points, float)
    if p.ndim != 2 or p.shape[1] != 2:
        raise InvalidGeometry(f"Points have shape {p.shape}; give (P, 2).")
    if not np.isfinite(p).all():
        raise InvalidGeometry("A point has a coordinate that is not finite.")
    floor, landmarks = world.floor, world.landmarks
    if isinstance(floor, OccupancyGrid):
        return grid_visible(floor, landmarks, p, min_range=min_range, max_range=max_range)
    visible = vector_visible(floor, landmarks, p, max_range=max_range)
    if min_range > 0:
        away = p[:, None, :] - landmarks.positions[None, :, :]
        visible &= np.hypot(away[..., 0], away[..., 1]) >= min_range - RANGE_TOLERANCE_M
    return visible


def buried_landmarks(world: World) -> BoolArray:
    """Shape (N,): landmarks so deep in walls that they can be seen from nowhere."""
    if isinstance(world.floor, OccupancyGrid):
        return buried_on_grid(world.floor, world.landmarks)
    return buried_in_plan(world.floor, world.landmarks)


def _check_ranges(min_range: float, max_range: float) -> None:
    if not (min_range >= 0 and math.isfinite(min_range)):
        raise InvalidGeometry(f"Smallest range is {min_range} m; it must be finite and ≥ 0.")
    if not max_range > min_range:
        raise InvalidGeometry(f"Largest range is {max_range} m; it must exceed the smallest, {min_range} m.")


def _moved(frame: GridFrame, offset: tuple[float, float]) -> GridFrame:
    """The frame, moved in W. Both sweeps take frames at any place, so that an offset costs nothing."""
    x, y = (float(v) for v in offset)
    if not (abs(x) <= MAX_COORDINATE_M and abs(y) <= MAX_COORDINATE_M):
        raise InvalidGeometry(f"The offset is ({x}, {y}) m; both must be finite.")
    return replace(frame, origin_x=frame.origin_x + x, origin_y=frame.origin_y + y)
