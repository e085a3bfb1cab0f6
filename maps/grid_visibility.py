"""Which landmarks are in line of sight on a floor of cells: one shadow sweep per landmark, or exact rays.

Positions are rounded to a lattice of 2⁻¹⁶ cell (coarser on grids above some 8,000 cells a side) and all
comparisons are exact there. A landmark is hidden from a place when the open segment between them enters an
opaque cell, or touches opaque cells on its left and on its right; nothing leaks between cells that meet at a
corner. A place in or on an opaque cell sees nothing; beyond the grid nothing is opaque.

A landmark in or on a wall: opaque cells within 1.2 cells of it are transparent for this landmark, and cells
nearby that lie behind the wall as seen from its own side are opaque, so that it shines into one room only.
The tolerance is no distance between lattice corners, so that a shift by a micrometre changes nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.errors import InvalidGeometry
from maps.grid import GridFrame, OccupancyGrid
from maps.kernels.grid_sweep import opaque_lines, sweep_landmark
from maps.kernels.grid_visibility import BURIED, FAR, POCKET, make_pockets, see_points
from maps.landmarks import LandmarkSet
from maps.runs import RunArray, Runs
from maps.sweeps import Tick, all_runs

#: How far into a wall a landmark may stand, in cells.
WALL_TOLERANCE_CELLS = 1.2
#: Ranges are inclusive up to this, m.
RANGE_TOLERANCE_M = 1e-9
_WINDOW_CELLS = 9
_LATTICE_LIMIT = 1 << 30
_FINEST_SHIFT = 16
# Unit of the facing forms: an angle is rounded to about 1e-9 rad.
_FORM_SCALE = 1 << 30


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """A floor and its landmarks on the lattice, ready for the kernels."""

    floor: OccupancyGrid
    shift: int
    places: IntArray  # (N, 2), lattice units in G: column and row axis
    places_m: FloatArray  # (N, 2), m in G
    modes: IntArray  # (N,): 0 seen from all around, 1 both facing forms hold, 2 one of them
    forms: IntArray  # (N, 4)
    windows: BoolArray  # (N, w, w)
    states: IntArray  # (N,)

    @classmethod
    def of(cls, floor: OccupancyGrid, landmarks: LandmarkSet) -> _Scene:
        cells = floor.frame.to_grid(landmarks.positions)
        extent = max(*floor.frame.shape, float(np.abs(cells).max(initial=1.0)))
        shift = min(_FINEST_SHIFT, max(0, math.floor(math.log2(_LATTICE_LIMIT / (2.0 * extent)))))
        places = _snapped(cells, shift)
        n = len(landmarks)
        azimuth = landmarks.facing - floor.frame.yaw
        modes, forms = _facing_forms(azimuth, landmarks.half_angle)
        normals = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        normals[~landmarks.has_facing] = 0.0
        windows = np.zeros((n, _WINDOW_CELLS, _WINDOW_CELLS), dtype=np.bool_)
        states = np.zeros(n, dtype=np.int64)
        tolerance = int(WALL_TOLERANCE_CELLS * (1 << shift))
        make_pockets(floor.opaque, floor.free, shift, places, normals, tolerance, windows, states)
        return cls(floor, shift, places, cells * floor.frame.resolution, modes, forms, windows, states)

    def corner(self, i: int) -> tuple[int, int]:
        """Row and column of the first cell of landmark i's window; far away without one."""
        if self.states[i] != POCKET:
            return (FAR, FAR)
        col, row = (int(v) >> self.shift for v in self.places[i])
        return (row - _WINDOW_CELLS // 2, col - _WINDOW_CELLS // 2)


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """What a sweep over rows needs, or over columns, on the transposed grid."""

    lines: RunArray
    offsets: IntArray
    opaque: BoolArray
    across: IntArray  # lattice places of the targets along a line
    along: IntArray  # and of the lines
    across_m: FloatArray
    along_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class GridSweep:
    """Sweeps over one grid of cells, landmark by landmark: see :class:`maps.sweeps.Sweep`."""

    shape: tuple[int, int]
    _scene: _Scene
    _level: _Side
    _upright: _Side
    _ranges2: tuple[float, float]

    @classmethod
    def of(
        cls,
        floor: OccupancyGrid,
        landmarks: LandmarkSet,
        frame: GridFrame,
        *,
        min_range: float = 0.0,
        max_range: float = math.inf,
    ) -> GridSweep:
        """Made ready; parameters and errors as of :func:`grid_runs`."""
        scene = _Scene.of(floor, landmarks)
        cols_m, rows_m, cols, rows = _targets(scene, frame)
        level = _Side(*_opaque_runs(floor.opaque), cols, rows, cols_m, rows_m)
        upright = _Side(*_opaque_runs(frozen(floor.opaque.T, np.bool_)), rows, cols, rows_m, cols_m)
        return cls(frame.shape, scene, level, upright, _squared_ranges(min_range, max_range))

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks."""
        return len(self._scene.places)

    def runs_of(self, i: int, first: int, stop: int) -> tuple[RunArray, RunArray]:
        """Row runs of the sectors above and below landmark i and column runs of those left and right."""
        scene = self._scene
        rows_m = self._level.along_m
        beside = max(rows_m[first] - scene.places_m[i, 1], scene.places_m[i, 1] - rows_m[stop - 1], 0.0)
        if scene.states[i] == BURIED or beside * beside > self._ranges2[1]:
            return (np.empty((0, 3), dtype=np.int32), np.empty((0, 3), dtype=np.int32))
        (row, col), mode, (a1, b1, a2, b2) = scene.corner(i), scene.modes[i], scene.forms[i]
        (x, y), (x_m, y_m) = scene.places[i], scene.places_m[i]
        window, turned = scene.windows[i], np.ascontiguousarray(scene.windows[i].T)
        part = slice(first, stop)
        level = replace(self._level, along=self._level.along[part], along_m=rows_m[part])
        upright = replace(self._upright, across=self._upright.across[part], across_m=rows_m[part])
        level_pocket, upright_pocket = (window, row, col), (turned, col, row)
        across = _sweep(
            level, scene.shift, level_pocket, (x, y, x_m, y_m), self._ranges2, (mode, a1, b1, a2, b2), 0
        )
        along = _sweep(
            upright, scene.shift, upright_pocket, (y, x, y_m, x_m), self._ranges2, (mode, b1, a1, b2, a2), 1
        )
        across[:, 0] += first
        along[:, 1:] += first
        return across, along


def grid_runs(
    floor: OccupancyGrid,
    landmarks: LandmarkSet,
    frame: GridFrame,
    *,
    min_range: float = 0.0,
    max_range: float = math.inf,
    threads: int | None = None,
    tick: Tick | None = None,
) -> Runs:
    """Cells of a grid from whose centres each landmark is visible.

    Parameters
    ----------
    floor
        Cells that stop lines of sight.
    landmarks
        N landmarks in W, on the grid or beside it.
    frame
        The cells to judge, at their centres: any corner and resolution, the yaw of the floor's own grid.
    min_range, max_range
        m, inclusive.
    threads
        Default: one per core. The result does not depend on it.
    tick
        Called with (landmarks done, N) after each landmark, from the calling thread.

    Returns
    -------
    runs
        Row runs of the sectors above and below each landmark, column runs of those left and right.

    Raises
    ------
    InvalidGeometry
        If the frame is turned against the floor or far too large for its lattice.
    """
    sweep = GridSweep.of(floor, landmarks, frame, min_range=min_range, max_range=max_range)
    return all_runs(sweep, threads=threads, tick=tick)


def grid_visible(
    floor: OccupancyGrid,
    landmarks: LandmarkSet,
    points: npt.ArrayLike,
    *,
    min_range: float = 0.0,
    max_range: float = math.inf,
) -> BoolArray:
    """Which landmarks are visible from single points, by one exact ray per pair.

    Parameters
    ----------
    floor, landmarks, min_range, max_range
        As for :func:`grid_runs`.
    points
        Shape (P, 2), W, m.

    Returns
    -------
    visible
        Shape (P, N).
    """
    scene = _Scene.of(floor, landmarks)
    cells = floor.frame.to_grid(points).reshape(-1, 2)
    near = (np.abs(cells) * (1 << scene.shift) < _LATTICE_LIMIT).all(axis=1)
    out = np.zeros((len(cells), len(landmarks)), dtype=np.bool_)
    seen = np.empty((int(near.sum()), len(landmarks)), dtype=np.bool_)
    see_points(
        floor.opaque,
        scene.windows,
        scene.states,
        scene.shift,
        scene.places,
        scene.places_m,
        scene.modes,
        scene.forms,
        _snapped(cells[near], scene.shift),
        cells[near] * floor.frame.resolution,
        *_squared_ranges(min_range, max_range),
        seen,
    )
    out[near] = seen
    return out


def scene_arrays(
    floor: OccupancyGrid, landmarks: LandmarkSet
) -> tuple[BoolArray, BoolArray, IntArray, int, IntArray, FloatArray, IntArray, IntArray, float]:
    """What ``see_points`` takes of a floor and its landmarks, and the largest lattice coordinate."""
    s = _Scene.of(floor, landmarks)
    limit = float(_LATTICE_LIMIT)
    return floor.opaque, s.windows, s.states, s.shift, s.places, s.places_m, s.modes, s.forms, limit


def buried_landmarks(floor: OccupancyGrid, landmarks: LandmarkSet) -> BoolArray:
    """Shape (N,): landmarks deeper than 1.2 cells inside opaque cells, which can be seen from nowhere."""
    return np.asarray(_Scene.of(floor, landmarks).states == BURIED)


def _snapped(cells: FloatArray, shift: int) -> IntArray:
    return np.ascontiguousarray(np.rint(cells * float(1 << shift)).astype(np.int64))


def _squared_ranges(min_range: float, max_range: float) -> tuple[float, float]:
    low = max(min_range - RANGE_TOLERANCE_M, 0.0)
    high = max_range + RANGE_TOLERANCE_M
    return (low * low, high * high if high >= 0 else -1.0)


def _facing_forms(azimuth: FloatArray, half_angle: FloatArray) -> tuple[IntArray, IntArray]:
    """Modes (N,) and forms (N, 4) a·dx + b·dy ≥ 0 that bound the viewing cones, in whole numbers."""
    n = len(azimuth)
    all_around = np.isnan(azimuth) | (half_angle >= math.pi - 1e-9)
    centre = np.where(all_around, 0.0, azimuth)
    first, last = centre - half_angle, centre + half_angle
    # Left of the first edge and right of the last one; both for cones up to a half-plane.
    forms = np.column_stack([-np.sin(first), np.cos(first), np.sin(last), -np.cos(last)]).reshape(n, 4)
    modes = np.where(all_around, 0, np.where(half_angle <= math.pi / 2, 1, 2)).astype(np.int64)
    return modes, np.rint(forms * _FORM_SCALE).astype(np.int64)


def _targets(scene: _Scene, frame: GridFrame) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Centres of a frame's columns and rows in the floor's G: m, m, and both on the lattice."""
    own = scene.floor.frame
    turn = math.remainder(frame.yaw - own.yaw, 2.0 * math.pi)
    if abs(turn) > 1e-12:
        raise InvalidGeometry(
            f"The field's grid is turned by {turn:g} rad against the floor's; use floor.grid_frame()."
        )
    corner = own.to_grid([frame.origin_x, frame.origin_y])
    corner = np.where(np.abs(corner - np.rint(corner)) < 1e-9, np.rint(corner), corner)
    ratio = frame.resolution / own.resolution
    cols = corner[0] + (np.arange(frame.n_cols) + 0.5) * ratio
    rows = corner[1] + (np.arange(frame.n_rows) + 0.5) * ratio
    largest = max(float(np.abs(cols).max()), float(np.abs(rows).max()))
    if largest * (1 << scene.shift) >= _LATTICE_LIMIT:
        raise InvalidGeometry(
            f"The field's grid reaches {largest * own.resolution:g} m from the floor's corner; "
            "keep it within the floor."
        )
    return (
        cols * own.resolution,
        rows * own.resolution,
        _snapped(cols, scene.shift),
        _snapped(rows, scene.shift),
    )


def _opaque_runs(opaque: BoolArray) -> tuple[RunArray, IntArray, BoolArray]:
    offsets = np.empty(opaque.shape[0] + 1, dtype=np.int64)
    lines = np.empty((opaque_lines(opaque, offsets, np.empty((0, 2), dtype=np.int32)), 2), dtype=np.int32)
    opaque_lines(opaque, offsets, lines)
    return lines, offsets, opaque


def _sweep(
    side: _Side,
    shift: int,
    window: tuple[BoolArray, int, int],
    place: tuple[int, int, float, float],
    ranges: tuple[float, float],
    cone: tuple[int, int, int, int, int],
    strict: int,
) -> RunArray:
    x, y, x_m, y_m = place
    runs: RunArray = sweep_landmark(
        side.lines,
        side.offsets,
        side.opaque,
        *window,
        shift,
        int(x),
        int(y),
        float(x_m),
        float(y_m),
        side.across,
        side.along,
        side.across_m,
        side.along_m,
        *ranges,
        *(int(c) for c in cone),
        strict,
    )
    return runs
