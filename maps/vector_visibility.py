"""Which landmarks are in line of sight on a floor of polygons: a sweep per landmark, or exact tests.

The boundary of what can be seen through is rounded to a lattice of 2⁻²⁰ m (coarser for floors above some
500 m), so are landmarks and places; all comparisons are exact there. A landmark is hidden from a place when
the open segment between them enters something opaque, or touches opaque corners on its left and on its
right; grazing a wall or a corner on one side hides nothing. What lies outside the floor is opaque.

A landmark on a wall, or at most 0.1 m inside one, is moved along its facing normal, or else to the nearest
see-through side, and eight lattice units beyond; a deeper one is seen from nowhere. Ranges are measured from
where it was surveyed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import shapely

from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame
from maps.kernels.vector_scan import scan_landmark
from maps.kernels.vector_visibility import see_points, stand_clear
from maps.landmarks import LandmarkSet
from maps.runs import RunArray, Runs
from maps.sweeps import Tick, all_runs

#: How deep in a wall a landmark may stand, m.
WALL_TOLERANCE_M = 0.1
#: Ranges are inclusive up to this, m.
RANGE_TOLERANCE_M = 1e-9
_FINEST_SHIFT = 20
_LATTICE_LIMIT = 1 << 29
# Beyond a wall, in lattice units: more than rounding can take back.
_CLEAR_UNITS = 8.0
# Unit of the directions that bound a viewing cone, and how much wider it is made so that its rim stays in.
_CONE_SCALE = 1 << 30
_CONE_SLACK_RAD = 2e-9


@dataclass(frozen=True, slots=True, eq=False)
class _Lattice:
    """Boundary of what can be seen through, on the lattice."""

    edges: IntArray  # (M, 4)
    extent: IntArray  # (2,): size of the floor's bounds, lattice units
    corner: FloatArray  # (2,): W, m, of lattice point (0, 0)
    per_metre: float

    def exactly(self, points: npt.ArrayLike) -> FloatArray:
        """World points (N, 2) in lattice units, not rounded."""
        return (np.asarray(points, dtype=np.float64) - self.corner) * self.per_metre

    def rounded(self, points: FloatArray) -> IntArray:
        """World points (N, 2) on the lattice."""
        return np.ascontiguousarray(np.rint(self.exactly(points)).astype(np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """A floor and its landmarks on the lattice, ready for the kernels."""

    lattice: _Lattice
    places: IntArray  # (N, 2), moved out of walls
    places_m: FloatArray  # (N, 2), W, as surveyed
    hidden: BoolArray  # (N,)
    cones: IntArray  # (N, 4): start and end direction
    spans: FloatArray  # (N,), rad

    @classmethod
    def of(cls, plan: FloorPlan, landmarks: LandmarkSet) -> _Scene:
        lattice = _lattice(plan)
        n = len(landmarks)
        normals = np.column_stack([np.cos(landmarks.facing), np.sin(landmarks.facing)])
        normals[~landmarks.has_facing] = 0.0
        places, hidden = np.zeros((n, 2), dtype=np.int64), np.zeros(n, dtype=np.bool_)
        exact = np.ascontiguousarray(lattice.exactly(landmarks.positions))
        reach = WALL_TOLERANCE_M * lattice.per_metre + 1.0
        stand_clear(lattice.edges, exact, normals, reach, _CLEAR_UNITS, places, hidden)
        cones, spans = _cones(landmarks)
        return cls(lattice, places, landmarks.positions, hidden, cones, spans)


@dataclass(frozen=True, slots=True, eq=False)
class VectorSweep:
    """Sweeps over one grid of cells, landmark by landmark: see :class:`maps.sweeps.Sweep`."""

    shape: tuple[int, int]
    _scene: _Scene
    _grid: FloatArray  # (5,), as the kernel takes it
    _unit: FloatArray  # (3,)
    _ranges: tuple[float, float]  # m

    @classmethod
    def of(
        cls,
        plan: FloorPlan,
        landmarks: LandmarkSet,
        frame: GridFrame,
        *,
        min_range: float = 0.0,
        max_range: float = math.inf,
    ) -> VectorSweep:
        """Made ready; parameters as of :func:`vector_runs`, ``min_range`` in m, inclusive."""
        scene = _Scene.of(plan, landmarks)
        grid = [frame.origin_x, frame.origin_y, math.cos(frame.yaw), math.sin(frame.yaw), frame.resolution]
        unit = np.array([*scene.lattice.corner, scene.lattice.per_metre])
        return cls(frame.shape, scene, np.array(grid), unit, (float(min_range), float(max_range)))

    @property
    def n_landmarks(self) -> int:
        """Number of landmarks."""
        return len(self._scene.places)

    def runs_of(self, i: int, first: int, stop: int) -> tuple[RunArray, RunArray]:
        """Row runs of landmark i, and no column runs."""
        scene, none = self._scene, np.empty((0, 3), dtype=np.int32)
        if scene.hidden[i]:
            return none, none
        (x, y), (x_m, y_m) = scene.places[i], scene.places_m[i]
        low, high = self._ranges
        runs: RunArray = scan_landmark(
            scene.lattice.edges,
            scene.lattice.extent,
            x,
            y,
            scene.cones[i],
            scene.spans[i],
            x_m,
            y_m,
            high,
            (high + RANGE_TOLERANCE_M) ** 2,
            self._grid,
            self._unit,
            first,
            stop,
            self.shape[1],
        )
        return (runs if low == 0.0 else self._without_disc(runs, i)), none

    def _without_disc(self, runs: RunArray, i: int) -> RunArray:
        """Runs without the cells whose centres are nearer to landmark i than the smallest range."""
        x0, y0, c, s, resolution = self._grid
        dx, dy = self._scene.places_m[i] - (x0, y0)
        col, row = (c * dx + s * dy) / resolution - 0.5, (c * dy - s * dx) / resolution - 0.5
        reach = (self._ranges[0] - RANGE_TOLERANCE_M) / resolution
        half = np.sqrt(np.maximum(reach**2 - (runs[:, 0] - row) ** 2, 0.0))
        # Strictly inside the disc: first … last.
        first, last = np.floor(col - half) + 1, np.ceil(col + half) - 1
        outside = (half == 0.0) | (first > last)
        before, after = runs.copy(), runs[~outside]
        before[~outside, 2] = np.minimum(runs[~outside, 2], first[~outside])
        after[:, 1] = np.maximum(after[:, 1], last[~outside] + 1)
        kept = np.concatenate([before, after])
        return np.asarray(kept[kept[:, 1] < kept[:, 2]])


def vector_runs(
    plan: FloorPlan,
    landmarks: LandmarkSet,
    frame: GridFrame,
    *,
    max_range: float = math.inf,
    threads: int | None = None,
    tick: Tick | None = None,
) -> Runs:
    """Cells of a grid from whose centres each landmark is visible.

    Parameters
    ----------
    plan
        Floor and opaque obstacles, W, m.
    landmarks
        N landmarks in W.
    frame
        The cells to judge, at their centres: any position, yaw and resolution.
    max_range
        m, inclusive.
    threads
        Default: one per core. The result does not depend on it.
    tick
        Called with (landmarks done, N) after each landmark, from the calling thread; it may raise to stop.

    Returns
    -------
    runs
        Row runs only.
    """
    return all_runs(VectorSweep.of(plan, landmarks, frame, max_range=max_range), threads=threads, tick=tick)


def vector_visible(
    plan: FloorPlan, landmarks: LandmarkSet, points: npt.ArrayLike, *, max_range: float = math.inf
) -> BoolArray:
    """Which landmarks are visible from single points, by one exact test per pair and edge.

    Parameters
    ----------
    plan, landmarks, max_range
        As for :func:`vector_runs`.
    points
        Shape (P, 2), W, m, finite.

    Returns
    -------
    visible
        Shape (P, N).
    """
    scene = _Scene.of(plan, landmarks)
    lattice = scene.lattice
    p = np.array(points, dtype=np.float64).reshape(-1, 2)
    exact = lattice.exactly(p)
    near = ((exact >= -1.0) & (exact <= lattice.extent + 1.0)).all(axis=1)
    out = np.zeros((len(p), len(landmarks)), dtype=np.bool_)
    seen = np.empty((int(near.sum()), len(landmarks)), dtype=np.bool_)
    see_points(
        lattice.edges,
        scene.places,
        scene.places_m,
        scene.hidden,
        scene.cones,
        scene.spans,
        lattice.rounded(p[near]),
        p[near],
        (max_range + RANGE_TOLERANCE_M) ** 2,
        seen,
    )
    out[near] = seen
    return out


def scene_arrays(
    plan: FloorPlan, landmarks: LandmarkSet
) -> tuple[IntArray, IntArray, FloatArray, BoolArray, IntArray, FloatArray, FloatArray, float, IntArray]:
    """What ``see_points`` takes of a plan and its landmarks; corner, unit and extent of the lattice."""
    s = _Scene.of(plan, landmarks)
    grid = s.lattice
    return (
        grid.edges,
        s.places,
        s.places_m,
        s.hidden,
        s.cones,
        s.spans,
        grid.corner,
        grid.per_metre,
        grid.extent,
    )


def buried_landmarks(plan: FloorPlan, landmarks: LandmarkSet) -> BoolArray:
    """Shape (N,): landmarks deeper than 0.1 m inside walls or outside the floor: seen from nowhere."""
    return _Scene.of(plan, landmarks).hidden


@lru_cache(maxsize=8)
def _lattice(plan: FloorPlan) -> _Lattice:
    """Plans are immutable and told apart by identity."""
    x0, y0, x1, y1 = plan.bounds
    corner = np.floor([x0, y0])
    size = max(x1 - corner[0], y1 - corner[1])
    shift = min(_FINEST_SHIFT, math.floor(math.log2((_LATTICE_LIMIT - 16) / size)))
    per_metre = math.ldexp(1.0, shift)
    area = shapely.transform(plan.see_through(), lambda c: (c - corner) * per_metre)
    area = shapely.set_precision(area, 1.0)
    rings = shapely.get_rings(shapely.get_parts(area)) if not area.is_empty else []
    parts = [np.rint(shapely.get_coordinates(ring)).astype(np.int64) for ring in rings]
    edges = [np.concatenate([c[:-1], c[1:]], axis=1) for c in parts]
    extent = np.ceil((np.array([x1, y1]) - corner) * per_metre).astype(np.int64)
    return _Lattice(
        frozen(np.concatenate([np.empty((0, 4), dtype=np.int64), *edges]), np.int64),
        frozen(extent, np.int64),
        frozen(corner),
        per_metre,
    )


def _cones(landmarks: LandmarkSet) -> tuple[IntArray, FloatArray]:
    """Start and end directions (N, 4) of the viewing cones in whole numbers, and their spans (N,), rad."""
    half = landmarks.half_angle + _CONE_SLACK_RAD
    all_around = ~landmarks.has_facing | (half >= math.pi - _CONE_SLACK_RAD)
    facing = np.where(all_around, 0.0, landmarks.facing)
    first, last = facing - half, facing + half
    ends = np.column_stack([np.cos(first), np.sin(first), np.cos(last), np.sin(last)]) * _CONE_SCALE
    cones = np.rint(ends).astype(np.int64).reshape(-1, 4)
    cones[all_around] = (1, 0, 1, 0)
    sx, sy, ex, ey = cones.astype(np.float64).T
    spans = np.arctan2(sx * ey - sy * ex, sx * ex + sy * ey)
    spans = np.where(spans <= 0.0, spans + 2.0 * math.pi, spans)
    return cones, np.where(all_around, 2.0 * math.pi, spans)
