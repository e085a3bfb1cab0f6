"""Exact distance to the boundary of free space, for points and straight motions."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_cdt

from maps.arrays import FloatArray, frozen
from maps.errors import InvalidGeometry
from maps.grid import GridFrame
from maps.kernels.clearance import bucket_segments, points_distance, segments_distance
from maps.world import Floor, World

#: Closer than this to the boundary is on the boundary, m.
TOUCH_M = 1e-9
_MAX_BUCKETS = 4_000_000
_SMALLEST_BUCKET_M = 0.05
_BAND_ROWS = 32
_HINT_CELLS = 250_000

ClearanceArrays = tuple[
    npt.NDArray[np.float64],
    npt.NDArray[np.int64],
    npt.NDArray[np.int32],
    npt.NDArray[np.int32],
    npt.NDArray[np.float64],
]


@dataclass(frozen=True, slots=True, eq=False)
class ClearanceIndex:
    """Boundary segments of free space, sorted into buckets for exact nearest-segment search.

    Build it with :meth:`from_world`. It is made of plain arrays and the floor, so it can be pickled.

    Attributes
    ----------
    floor
        Says which side of the boundary is free.
    segments
        Shape (M, 4): x0, y0, x1, y1 in W, m.
    bucket_start
        Shape (ny, nx + 1): where the items of bucket (row, col) start; they end where those of
        (row, col + 1) start.
    bucket_items
        Shape (K,): indices into ``segments``; a segment stands in every bucket that it touches.
    bucket_gap
        Shape (ny, nx): number of rings of buckets around each one, itself being ring 0, that hold nothing.
    grid
        Shape (3,): corner of bucket (0, 0) in W and side of a bucket, m.
    """

    floor: Floor
    segments: npt.NDArray[np.float64]
    bucket_start: npt.NDArray[np.int64]
    bucket_items: npt.NDArray[np.int32]
    bucket_gap: npt.NDArray[np.int32]
    grid: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, dtype in (
            ("segments", np.float64),
            ("bucket_start", np.int64),
            ("bucket_items", np.int32),
            ("bucket_gap", np.int32),
            ("grid", np.float64),
        ):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype))

    def __reduce__(self) -> tuple[type[ClearanceIndex], tuple[object, ...]]:
        return (ClearanceIndex, (self.floor, *self.arrays))

    @classmethod
    def from_world(cls, world: World, cell_m: float | None = None) -> ClearanceIndex:
        """Index the boundary of a world's free space.

        Parameters
        ----------
        world
            Grid or polygon floor; landmarks play no part.
        cell_m
            Side of a bucket, m; affects speed only. Default: about one bucket per boundary segment.

        Raises
        ------
        InvalidGeometry
            If ``cell_m`` is not positive and finite.
        """
        if cell_m is not None and not (math.isfinite(cell_m) and cell_m > 0):
            raise InvalidGeometry(f"Bucket side is {cell_m} m; it must be positive and finite.")
        return cls.from_edges(world.floor, world.floor.free_edges(), cell_m)

    def with_edges(self, edges: npt.ArrayLike) -> ClearanceIndex:
        """The same boundary with further segments (K, 4): x0, y0, x1, y1 in W, m; the floor stays.

        Distances are then to the nearest of both; which side of the further segments is free, the index does
        not know.
        """
        return self.from_edges(self.floor, np.concatenate([self.segments, np.asarray(edges).reshape(-1, 4)]))

    @classmethod
    def from_edges(cls, floor: Floor, edges: FloatArray, cell_m: float | None = None) -> ClearanceIndex:
        """Index any segments (M, 4): x0, y0, x1, y1 in W, m; arguments as of :meth:`from_world`."""
        if len(edges) == 0:
            empty = np.zeros((1, 2), dtype=np.int64)
            nothing = np.empty(0, dtype=np.int32)
            gap = np.ones((1, 1), dtype=np.int32)
            return cls(floor, edges, empty, nothing, gap, np.array([0.0, 0.0, 1.0]))
        low = np.minimum(edges[:, :2], edges[:, 2:]).min(axis=0)
        high = np.maximum(edges[:, :2], edges[:, 2:]).max(axis=0)
        width, height = np.maximum(high - low, 1e-6)
        cell = cell_m or max(math.sqrt(width * height / len(edges)), _SMALLEST_BUCKET_M)
        cell = max(cell, math.sqrt(width * height / _MAX_BUCKETS), max(width, height) / _MAX_BUCKETS)
        grid = np.array([low[0], low[1], cell])
        shape = (int(height // cell) + 1, int(width // cell) + 1)

        counts = np.zeros(shape, dtype=np.int64)
        bucket_segments(edges, grid, counts, np.empty(0, dtype=np.int32))
        flat = np.concatenate([[0], np.cumsum(counts)])
        start = np.empty((shape[0], shape[1] + 1), dtype=np.int64)
        start[:, :-1] = flat[:-1].reshape(shape)
        start[:, -1] = flat[shape[1] :: shape[1]]
        items = np.empty(int(flat[-1]), dtype=np.int32)
        bucket_segments(edges, grid, start[:, :-1].copy(), items)
        gap = distance_transform_cdt(counts == 0, metric="chessboard").astype(np.int32)
        return cls(floor, edges, start, items, gap, grid)

    @property
    def arrays(self) -> ClearanceArrays:
        """The arrays that the kernels of ``maps.kernels.clearance`` take, in their order."""
        return (self.segments, self.bucket_start, self.bucket_items, self.bucket_gap, self.grid)

    def distance(self, points: npt.ArrayLike) -> FloatArray:
        """Clearance of points.

        Parameters
        ----------
        points
            Shape (N, 2), W, m.

        Returns
        -------
        clearance
            Shape (N,), m: distance to the nearest point that is not free where the point is free; minus
            the distance to the boundary of free space elsewhere. Closer than a nanometre counts as 0.

        Raises
        ------
        InvalidGeometry
            If a coordinate is not finite or the shape is wrong.
        """
        p = _points(points)
        out = np.empty(len(p))
        points_distance(p, math.inf, out, *self.arrays)
        return self._signed(out, p)

    def segment_distance(self, start: npt.ArrayLike, stop: npt.ArrayLike) -> FloatArray:
        """Smallest clearance along straight segments.

        Parameters
        ----------
        start, stop
            Shape (N, 2), ends of the segments in W, m.

        Returns
        -------
        clearance
            Shape (N,), m: ≤ 0 when the segment touches or crosses the boundary or runs outside free space.

        Raises
        ------
        InvalidGeometry
            If a coordinate is not finite or the shapes differ.
        """
        a, b = _points(start), _points(stop)
        if a.shape != b.shape:
            raise InvalidGeometry(f"{len(a)} segment starts but {len(b)} ends; give one end per start.")
        out = np.empty(len(a))
        segments_distance(np.concatenate([a, b], axis=1), math.inf, out, *self.arrays)
        return self._signed(out, a)

    def _signed(self, unsigned: FloatArray, points: FloatArray) -> FloatArray:
        unsigned[unsigned < TOUCH_M] = 0.0
        return np.asarray(np.where(self.floor.free_at(points), unsigned, 0.0 - unsigned))

    def at_centres(self, frame: GridFrame, threads: int | None = None) -> FloatArray:
        """Clearance at all cell centres of a grid.

        Parameters
        ----------
        frame
            The grid; any position, yaw and resolution.
        threads
            Default: one per core. The result does not depend on it.

        Returns
        -------
        clearance
            Shape (n_rows, n_cols), m; 0 where the centre is not free.
        """
        out = np.zeros(frame.shape)

        def band(first: int) -> None:
            rows = slice(first, min(first + _BAND_ROWS, frame.n_rows))
            centres = frame.centres(rows)
            free = self.floor.free_at(centres)
            inside = centres[free]
            values = np.empty(len(inside))
            points_distance(inside, math.inf, values, *self.arrays)
            out[rows][free] = values

        n = threads or os.cpu_count() or 1
        with ThreadPoolExecutor(max_workers=n) as pool:
            list(pool.map(band, range(0, frame.n_rows, _BAND_ROWS)))
        return out

    def nearest_free(
        self,
        points: npt.ArrayLike,
        clearance: float,
        *,
        frame: GridFrame | None = None,
        centre_clearance: FloatArray | None = None,
    ) -> FloatArray | None:
        """Nearest places with at least a given clearance, for hints to the caller.

        The nearest such cell centre is found first and then moved towards the point as far as the exact
        clearance allows; a nearer place smaller than a cell can be missed, a returned place never fails.

        Parameters
        ----------
        points
            Shape (N, 2), W, m. Points with enough clearance are returned as they are.
        clearance
            m, ≥ 0; at 0 the place is still strictly inside free space.
        frame, centre_clearance
            A grid and what :meth:`at_centres` gave for it, if at hand; else a grid of about 250,000 cells.

        Returns
        -------
        places
            Shape (N, 2), W, m; None when no cell centre has that clearance.

        Raises
        ------
        InvalidGeometry
            If a number is not finite or the clearance is negative.
        """
        p = _points(points)
        if not (math.isfinite(clearance) and clearance >= 0):
            raise InvalidGeometry(f"Clearance is {clearance} m; it must be finite and ≥ 0.")
        need = max(clearance, TOUCH_M)
        if frame is None or centre_clearance is None:
            x0, y0, x1, y1 = self.floor.bounds
            frame = self.floor.grid_frame(max(math.sqrt((x1 - x0) * (y1 - y0) / _HINT_CELLS), 1e-3))
            centre_clearance = self.at_centres(frame)
        rows, cols = np.nonzero(centre_clearance >= need)
        enough = self.distance(p) >= need
        if len(rows) == 0:
            return p if enough.all() else None
        candidates = frame.to_world(np.column_stack([cols + 0.5, rows + 0.5]))
        good = np.array([candidates[np.argmin(((candidates - q) ** 2).sum(axis=1))] for q in p]).reshape(
            -1, 2
        )
        bad = p.copy()
        for _ in range(30):
            middle = 0.5 * (good + bad)
            ok = self.distance(middle) >= need
            good[ok], bad[~ok] = middle[ok], middle[~ok]
        good[enough] = p[enough]
        return good


def _points(points: npt.ArrayLike) -> FloatArray:
    # A fresh writable array: read-only input would compile the kernels a second time.
    p = np.array(points, dtype=np.float64, order="C")
    if p.ndim != 2 or p.shape[1] != 2:
        raise InvalidGeometry(f"Points have shape {p.shape}; give (N, 2).")
    if not np.isfinite(p).all():
        raise InvalidGeometry("A point has a coordinate that is not finite.")
    return p
