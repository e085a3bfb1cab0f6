"""Grids: the frame that ties cells to the world, and occupancy grids."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray, FloatArray, IntArray, digest, frozen
from maps.errors import InvalidGeometry

MAX_CELLS = 400_000_000
MAX_COORDINATE_M = 1e7


@dataclass(frozen=True, slots=True)
class GridFrame:
    """A grid of square cells in the world: row 0 is the lowest y of the grid frame G.

    Attributes
    ----------
    origin_x, origin_y
        Position of the outer lower-left corner of cell (0, 0) in W, m.
    yaw
        Rotation of G in W, rad, counter-clockwise (ROS ``map.yaml``'s third origin value).
    resolution
        Side of a cell, m.
    n_rows, n_cols
        Size; a grid array has shape ``(n_rows, n_cols)``.

    Raises
    ------
    InvalidGeometry
        If a number is not finite, the resolution not positive, or the size empty or too large.
    """

    origin_x: float
    origin_y: float
    yaw: float
    resolution: float
    n_rows: int
    n_cols: int

    def __post_init__(self) -> None:
        for name in ("origin_x", "origin_y", "yaw", "resolution"):
            value = float(getattr(self, name))
            if not math.isfinite(value) or abs(value) > MAX_COORDINATE_M:
                raise InvalidGeometry(
                    f"Grid {name} is {value}; it must be finite and below {MAX_COORDINATE_M:g}."
                )
            object.__setattr__(self, name, value)
        if self.resolution <= 0:
            raise InvalidGeometry(f"Grid resolution is {self.resolution} m; it must be positive.")
        if self.n_rows < 1 or self.n_cols < 1:
            raise InvalidGeometry(f"Grid has {self.n_rows} rows and {self.n_cols} columns; both must be ≥ 1.")
        if self.n_rows * self.n_cols > MAX_CELLS:
            raise InvalidGeometry(
                f"Grid has {self.n_rows * self.n_cols} cells, the limit is {MAX_CELLS}; "
                "use a coarser resolution."
            )

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_rows, n_cols)``."""
        return (self.n_rows, self.n_cols)

    @property
    def width_m(self) -> float:
        """Extent along the columns, m."""
        return self.n_cols * self.resolution

    @property
    def height_m(self) -> float:
        """Extent along the rows, m."""
        return self.n_rows * self.resolution

    def to_grid(self, points: npt.ArrayLike) -> FloatArray:
        """World points as continuous (column, row) coordinates in cells; shape (..., 2).

        The centre of cell (row, col) is (col + 0.5, row + 0.5).
        """
        p = np.asarray(points, dtype=np.float64)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        dx, dy = p[..., 0] - self.origin_x, p[..., 1] - self.origin_y
        return np.stack([(c * dx + s * dy), (c * dy - s * dx)], axis=-1) / self.resolution

    def to_world(self, grid_points: npt.ArrayLike) -> FloatArray:
        """Inverse of :meth:`to_grid`: (column, row) coordinates in cells to world points, m."""
        g = np.asarray(grid_points, dtype=np.float64) * self.resolution
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        x = self.origin_x + c * g[..., 0] - s * g[..., 1]
        y = self.origin_y + s * g[..., 0] + c * g[..., 1]
        return np.stack([x, y], axis=-1)

    def cell_at(self, points: npt.ArrayLike) -> IntArray:
        """Cells (row, col) that hold world points; shape (..., 2); may lie outside the grid."""
        g = np.floor(self.to_grid(points)).astype(np.int64)
        return g[..., ::-1]

    def centres(self, rows: slice = slice(None), cols: slice = slice(None)) -> FloatArray:
        """World positions of cell centres of a window; shape (rows, cols, 2), m."""
        r = np.arange(self.n_rows)[rows] + 0.5
        c = np.arange(self.n_cols)[cols] + 0.5
        gx, gy = np.meshgrid(c, r)
        return self.to_world(np.stack([gx, gy], axis=-1))

    def contains(self, points: npt.ArrayLike) -> BoolArray:
        """Whether world points lie on the grid; shape (...)."""
        g = self.to_grid(points)
        return np.asarray(
            (g[..., 0] >= 0) & (g[..., 0] < self.n_cols) & (g[..., 1] >= 0) & (g[..., 1] < self.n_rows)
        )

    def bounds(self) -> tuple[float, float, float, float]:
        """``(x_min, y_min, x_max, y_max)`` of the grid in W, m."""
        corners = self.to_world([[0, 0], [self.n_cols, 0], [0, self.n_rows], [self.n_cols, self.n_rows]])
        lo, hi = corners.min(axis=0), corners.max(axis=0)
        return (float(lo[0]), float(lo[1]), float(hi[0]), float(hi[1]))

    def resampled(self, resolution: float) -> GridFrame:
        """The frame with the same corner and yaw and other cells; covers at least the same area."""
        if not (math.isfinite(resolution) and resolution > 0):
            raise InvalidGeometry(f"Grid resolution is {resolution} m; it must be positive and finite.")
        ratio = self.resolution / resolution
        n_rows = max(1, math.ceil(self.n_rows * ratio - 1e-6))
        n_cols = max(1, math.ceil(self.n_cols * ratio - 1e-6))
        return GridFrame(self.origin_x, self.origin_y, self.yaw, float(resolution), n_rows, n_cols)

    def as_tuple(self) -> tuple[float, float, float, float, int, int]:
        """All six numbers, in the order of the constructor."""
        return (self.origin_x, self.origin_y, self.yaw, self.resolution, self.n_rows, self.n_cols)


def _boundary_edges(mask: BoolArray) -> FloatArray:
    """Maximal straight edges between True and not-True cells, outside counted as not True.

    Shape (M, 4): x0, y0, x1, y1 in cells.
    """
    padded = np.pad(mask, 1)
    edges = []
    # Horizontal edges lie between rows r-1 and r; vertical ones on the transposed grid.
    for transposed in (False, True):
        m = padded.T if transposed else padded
        change = m[1:, :] != m[:-1, :]
        wide = np.zeros((change.shape[0], change.shape[1] + 2), dtype=np.int8)
        wide[:, 1:-1] = change
        step = np.diff(wide, axis=1)
        line, start = np.nonzero(step == 1)
        _, stop = np.nonzero(step == -1)
        a, b, at = start - 1.0, stop - 1.0, line.astype(np.float64)
        edges.append(np.column_stack([at, a, at, b] if transposed else [a, at, b, at]))
    return np.concatenate(edges).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """Floor as cells: which are free to drive, which stop a line of sight, which are unknown.

    Attributes
    ----------
    frame
        Where the cells are.
    free
        Shape (n_rows, n_cols), bool: a robot may be here.
    opaque
        Shape (n_rows, n_cols), bool: no line of sight passes. Beyond the grid nothing is opaque and
        nothing is free.
    unknown
        Shape (n_rows, n_cols), bool: the map says nothing (for display only; the importer has already
        decided whether such cells are free or opaque).
    """

    frame: GridFrame
    free: BoolArray
    opaque: BoolArray
    unknown: BoolArray = field(default=None)  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        if self.unknown is None:
            object.__setattr__(self, "unknown", np.zeros(self.frame.shape, dtype=np.bool_))
        for name in ("free", "opaque", "unknown"):
            array = frozen(getattr(self, name), np.bool_)
            if array.shape != self.frame.shape:
                raise InvalidGeometry(f"Grid {name} has shape {array.shape}, its frame {self.frame.shape}.")
            object.__setattr__(self, name, array)

    def __reduce__(self) -> tuple[type[OccupancyGrid], tuple[object, ...]]:
        return (OccupancyGrid, (self.frame, self.free, self.opaque, self.unknown))

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(x_min, y_min, x_max, y_max)`` in W, m."""
        return self.frame.bounds()

    @property
    def free_area_m2(self) -> float:
        """Area a point robot may stand on, m²."""
        return float(np.count_nonzero(self.free)) * self.frame.resolution**2

    def grid_frame(self, resolution: float) -> GridFrame:
        """Frame of a field over this floor."""
        return self.frame.resampled(resolution)

    def _touches(self, mask: BoolArray, points: npt.ArrayLike, *, every: bool) -> BoolArray:
        # A point on a cell border belongs to all the cells that meet there.
        g = self.frame.to_grid(points)
        near = np.rint(g)
        g = np.where(np.abs(g - near) < 1e-9, near, g)
        low = np.ceil(g).astype(np.int64) - 1
        high = np.floor(g).astype(np.int64)
        out = np.full(g.shape[:-1], every)
        for cols in (low[..., 0], high[..., 0]):
            for rows in (low[..., 1], high[..., 1]):
                ok = (rows >= 0) & (cols >= 0) & (rows < self.frame.n_rows) & (cols < self.frame.n_cols)
                value = np.zeros(out.shape, dtype=np.bool_)
                value[ok] = mask[rows[ok], cols[ok]]
                out = out & value if every else out | value
        return np.asarray(out)

    def free_at(self, points: npt.ArrayLike) -> BoolArray:
        """Whether points (..., 2) in W lie in free space; a point on a border needs all its cells free."""
        return self._touches(self.free, points, every=True)

    def opaque_at(self, points: npt.ArrayLike) -> BoolArray:
        """Whether points (..., 2) in W lie in or on an opaque cell."""
        return self._touches(self.opaque, points, every=False)

    def free_edges(self) -> FloatArray:
        """Boundary of free space as segments; shape (M, 4): x0, y0, x1, y1 in W, m."""
        return self._edges(self.free)

    def opaque_edges(self) -> FloatArray:
        """Boundary of the opaque cells as segments; shape (M, 4): x0, y0, x1, y1 in W, m."""
        return self._edges(self.opaque)

    def _edges(self, mask: BoolArray) -> FloatArray:
        cells = _boundary_edges(mask)
        a, b = self.frame.to_world(cells[:, :2]), self.frame.to_world(cells[:, 2:])
        return np.concatenate([a, b], axis=1)

    def content_hash(self) -> str:
        """SHA-256 (hex) of frame and cells."""
        return digest("grid", *self.frame.as_tuple(), self.free, self.opaque, self.unknown)
