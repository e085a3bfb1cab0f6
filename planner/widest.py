"""The widest way between two places: where it is narrowest, and the largest disc that passes there.

The way maximises its least clearance. On cells it is found by joining them, the roomiest first, until start
and goal connect; the cell that connects them is its narrowest. There the exact clearance is searched on ever
smaller cells. A disc with clearance c lies in a cell whose centre has at least ``c − resolution/√2``, and who
crosses the line between the two obstacles of a narrow place has at most half its length: with these bounds in
place of what the cells say the search is repeated until no other way can be wider, and this one is narrower
nowhere else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely
from scipy.ndimage import distance_transform_edt

from maps.arrays import BoolArray, FloatArray, IntArray
from maps.grid import GridFrame
from maps.kernels.clearance import points_distance
from planner.cost_to_go import Place
from planner.kernels.widest import joining_cell, sides
from planner.obstacles import Obstacles

Stop = npt.NDArray[np.uint8]

# Steps of room that are told apart: more would not fit the sort of 16 bits.
_STEPS = 60_000
_SURE = 65_535
# A narrow place is looked at within this many cells, on cells smaller by this factor, this often.
_REACH, _FACTOR, _LEVELS = 4, 8, 3
# Narrow places that are looked at, at most.
_MAX_PLACES = 24
# Another place of the same way counts as narrower by more than this, m.
_TOLERANCE_M = 1e-3
# The obstacles of a narrow place lie on opposite sides: the cosine between them is below this.
_OPPOSITE = -0.5


@dataclass(frozen=True, slots=True)
class Narrowest:
    """The narrowest place of the widest way.

    Attributes
    ----------
    place
        (x, y) in W, m, midway between the obstacles; where nothing passes, where what lies between is
        thinnest.
    largest_radius
        Of a disc, m: none that is larger leads from start to goal; 0 where walls or areas close every way.
    between
        What is on its two sides: 0 a wall, or the number, from 1, of an area to avoid.
    is_proven
        Whether it was proven that no way is wider; else the time did not suffice for it.
    """

    place: Place
    largest_radius: float
    between: tuple[int, int]
    is_proven: bool = True

    @property
    def areas(self) -> tuple[int, ...]:
        """Numbers of the areas to avoid beside the place, ascending."""
        return tuple(sorted({k for k in self.between if k > 0}))


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Cells with values, and which of them belong to start (1) or goal (2)."""

    frame: GridFrame
    values: FloatArray
    source: npt.NDArray[np.int8]


def narrowest_of_widest(
    obstacles: Obstacles, frame: GridFrame, start: Place, goal: Place, *, stop: Stop
) -> Narrowest | None:
    """Where the widest way between two places is narrowest.

    Parameters
    ----------
    obstacles
        Walls, and areas to avoid.
    frame
        Of their cells.
    start, goal
        (x, y) in W, m, in free space.
    stop
        Shape (1,); another thread sets it to end the search early.

    Returns
    -------
    narrowest
        None when both places lie in one cell or in neighbours, or when it was stopped too early.
    """
    room = obstacles.centre_clearance
    source = np.zeros(frame.shape, dtype=np.int8)
    (row, col), (row2, col2) = frame.cell_at([start, goal])
    if max(abs(row - row2), abs(col - col2)) <= 1:
        return None
    source[row, col], source[row2, col2] = 1, 2
    slack = frame.resolution / math.sqrt(2.0)
    # The ends' own clearance is the most that any way can have.
    at_ends = _clearance(obstacles, np.array([start, goal]))
    most = float(at_ends.min())
    possible = np.where(room > 0, np.minimum(room + slack, most), -1.0)
    certain = np.where(room > 0, np.minimum(room, most), -1.0)
    seen: dict[int, Narrowest] = {}
    best: Narrowest | None = None
    for _ in range(_MAX_PLACES):
        cell, side = _join(_Cells(frame, possible, source), stop)
        if cell == -1:
            return _closed(obstacles, _Cells(frame, room, source), stop)
        if cell >= 0 and cell not in seen and possible.flat[cell] >= most:
            return _at_end(obstacles, start if at_ends[0] == most else goal, most)
        if cell in seen:
            # No way is wider. Is this one as wide all along, or are there narrower places before or behind?
            best = seen[cell]
            cell, side = _join(_Cells(frame, certain, source), stop)
            if cell >= 0 and certain.flat[cell] >= best.largest_radius - _TOLERANCE_M:
                return best
        if cell < 0:
            break
        found, line = _looked_at(obstacles, _Cells(frame, room, source), cell, side)
        if best is None:
            best = replace(found, is_proven=False)
        closed = np.append(_crossed(frame, line), cell)
        closed = closed[possible.flat[closed] >= found.largest_radius]
        possible.flat[closed] = found.largest_radius
        seen |= dict.fromkeys(closed.tolist(), found)
        near = _window(frame, cell)
        passed = possible[near] >= found.largest_radius
        certain[near][passed] = np.maximum(certain[near][passed], found.largest_radius)
        certain.flat[closed] = found.largest_radius
    return best


def _join(cells: _Cells, stop: Stop) -> tuple[int, npt.NDArray[np.int8]]:
    """Flat index of the cell that connects start and goal (as of ``joining_cell``), and what it connects."""
    values = cells.values.ravel()
    low, high = 0.0, max(float(values.max()), 1e-9)
    steps = np.clip(values * (_STEPS / (high - low)), 0, _STEPS).astype(np.uint16)
    steps[cells.source.ravel() > 0] = _SURE
    order = np.argsort(_SURE - steps, kind="stable")
    order = order[values[order] >= 0] if (values < 0).any() else order
    parent = np.empty(len(values) + 2, dtype=np.int32)
    cell = int(joining_cell(order, cells.frame.n_cols, cells.source.ravel(), stop, parent))
    side = np.zeros(len(values), dtype=np.int8)
    if cell >= 0:
        sides(parent, side)
    return cell, side.reshape(cells.values.shape)


def _looked_at(
    obstacles: Obstacles, cells: _Cells, cell: int, side: npt.NDArray[np.int8]
) -> tuple[Narrowest, FloatArray]:
    """The narrow place at a cell, exactly, and the line (2, 2), W, m, that closes it."""
    never = np.zeros(1, dtype=np.uint8)
    for _ in range(_LEVELS):
        cells = _smaller(obstacles, cells, cell, side)
        again, other = _join(cells, never)
        if again < 0:
            break
        cell, side = again, other
    row, col = divmod(cell, cells.frame.n_cols)
    p = cells.frame.to_world(np.array([col + 0.5, row + 0.5]))
    return _between(obstacles, p, cells.frame.resolution)


def _at_end(obstacles: Obstacles, end: Place, clearance: float) -> Narrowest:
    """An end of the way as its narrowest place."""
    nearest = _nearest_points(np.array(end), obstacles.clearance.segments)
    k = int(np.argmin(np.hypot(*(nearest - end).T)))
    beside = _area_at(obstacles, nearest[k])
    return Narrowest(end, clearance, (beside, beside))


def _smaller(obstacles: Obstacles, cells: _Cells, cell: int, side: npt.NDArray[np.int8]) -> _Cells:
    """Smaller cells around one of which start's and goal's sides enter at the edge, or stand inside."""
    frame = cells.frame
    row, col = divmod(cell, frame.n_cols)
    r0, r1 = max(row - _REACH, 0), min(row + _REACH + 1, frame.n_rows)
    c0, c1 = max(col - _REACH, 0), min(col + _REACH + 1, frame.n_cols)
    x, y = frame.to_world(np.array([float(c0), float(r0)]))
    small = GridFrame(x, y, frame.yaw, frame.resolution / _FACTOR, _FACTOR * (r1 - r0), _FACTOR * (c1 - c0))
    here = side[r0:r1, c0:c1].copy()
    here[1:-1, 1:-1] = 0
    own = cells.source[r0:r1, c0:c1]
    here = np.where(own > 0, own, here)
    source = np.repeat(np.repeat(here, _FACTOR, axis=0), _FACTOR, axis=1)
    values = _clearance(obstacles, small.centres().reshape(-1, 2)).reshape(small.shape)
    return _Cells(small, values, source)


def _window(frame: GridFrame, cell: int) -> tuple[slice, slice]:
    """Rows and columns around a cell."""
    row, col = divmod(cell, frame.n_cols)
    return (
        slice(max(row - _REACH, 0), min(row + _REACH + 1, frame.n_rows)),
        slice(max(col - _REACH, 0), min(col + _REACH + 1, frame.n_cols)),
    )


def _between(obstacles: Obstacles, p: FloatArray, accuracy: float) -> tuple[Narrowest, FloatArray]:
    """The narrow place at a point known up to an accuracy, m: midway between the obstacles on its sides."""
    nearest = _nearest_points(p, obstacles.clearance.segments)
    to = nearest - p
    away = np.hypot(*to.T)
    first = int(np.argmin(away))
    across = to @ to[first] <= _OPPOSITE * away * away[first]
    second = int(np.argmin(np.where(across, away, np.inf)))
    line = nearest[[first, second]]
    if not across[second] or away[second] > away[first] + 4.0 * accuracy:
        second, line = first, np.array([p, p])
    width = float(np.hypot(*(line[1] - line[0])))
    radius = 0.5 * width if second != first else float(away[first])
    x, y = line.mean(axis=0)
    beside = (_area_at(obstacles, nearest[first]), _area_at(obstacles, nearest[second]))
    return Narrowest((float(x), float(y)), radius, beside), line


def _nearest_points(p: FloatArray, segments: FloatArray) -> FloatArray:
    """Nearest point (M, 2) to p (2,) of each segment (M, 4)."""
    a, d = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length2 = np.maximum((d * d).sum(axis=1), 1e-300)
    t = np.clip(((p - a) * d).sum(axis=1) / length2, 0.0, 1.0)
    return np.asarray(a + t[:, None] * d)


def _area_at(obstacles: Obstacles, q: FloatArray) -> int:
    """Number of the area to avoid that a place is on; 0: a wall."""
    areas = obstacles.areas_at(float(q[0]), float(q[1]))
    return areas[0] if areas else 0


def _clearance(obstacles: Obstacles, points: FloatArray) -> FloatArray:
    """Clearance (N,) of points (N, 2), W, m; 0 in walls and areas."""
    p = np.array(points, dtype=np.float64, order="C")
    out = np.empty(len(p))
    points_distance(p, math.inf, out, *obstacles.clearance.arrays)
    out[~obstacles.clearance.floor.free_at(p)] = 0.0
    for polygon in obstacles.avoid:
        out[shapely.intersects_xy(polygon, p[:, 0], p[:, 1])] = 0.0
    return out


def _crossed(frame: GridFrame, line: FloatArray) -> IntArray:
    """Flat indices of the cells that a line (2, 2), W, m, touches."""
    ends = frame.to_grid(line)
    (c0, r0), (c1, r1) = np.floor(ends.min(axis=0)).astype(int), np.floor(ends.max(axis=0)).astype(int)
    rows, cols = np.mgrid[
        max(r0 - 1, 0) : min(r1 + 2, frame.n_rows), max(c0 - 1, 0) : min(c1 + 2, frame.n_cols)
    ]
    boxes = shapely.box(cols, rows, cols + 1, rows + 1)
    touched: BoolArray = np.asarray(shapely.intersects(boxes, shapely.linestrings(ends)))
    return np.asarray((rows * frame.n_cols + cols)[touched], dtype=np.int64)


def _closed(obstacles: Obstacles, cells: _Cells, stop: Stop) -> Narrowest | None:
    """Where what closes every way is thinnest."""
    depth = np.asarray(distance_transform_edt(cells.values <= 0), dtype=np.float64)
    values = depth.max() - depth
    cell, _ = _join(_Cells(cells.frame, values, cells.source), stop)
    if cell < 0:
        return None
    row, col = divmod(cell, cells.frame.n_cols)
    x, y = (float(v) for v in cells.frame.to_world(np.array([col + 0.5, row + 0.5])))
    areas = obstacles.areas_at(x, y)
    if not areas and obstacles.avoid:
        # A cell is closed by what touches its centre: the area may begin beside it.
        near = shapely.distance(np.array(obstacles.avoid, dtype=object), shapely.Point(x, y))
        areas = tuple(k for k, d in enumerate(near, 1) if d <= cells.frame.resolution)
    number = areas[0] if areas else 0
    return Narrowest((x, y), 0.0, (number, number))
