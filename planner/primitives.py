"""Motion primitives: the moves of a robot between poses of a lattice, and the cells that they sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from maps.arrays import FloatArray, IntArray, frozen
from maps.se2 import wrap
from planner.errors import InvalidProblem
from planner.kernels.line_cost import polyline_pieces
from planner.kernels.steering import advance, chords_of, heading_bin
from planner.steering import Steering

#: Numbers of headings that a lattice can have.
HEADING_COUNTS = (8, 16, 32)
# Largest step in cells of the headings' vectors.
_VECTOR_CELLS = {8: 1, 16: 2, 32: 4}
# Arcs between two headings: so many, the shortest ones; over two steps of the headings only one.
_ARCS = {1: 3, 2: 1}
# No arc is searched that ends further away, in cells and in radii of the smallest circle.
_REACH_CELLS = 12
_REACH_RADII = 3.0


# First move of every heading (K + 1,); heads (P, 5): heading before and after, rows, columns, gear; price
# (P,); then pieces and chords of all moves, as planner.kernels.lattice takes them.
MoveArrays = tuple[IntArray, IntArray, FloatArray, IntArray, IntArray, FloatArray, IntArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Primitives:
    """All moves of a robot on a lattice, sorted by the heading at which they begin.

    Attributes
    ----------
    headings
        Shape (K,): directions of the lattice, rad in the grid's frame, ascending from 0 in [0, 2π). Not
        evenly spaced: along each of them cells' centres follow each other within a few cells.
    parts
        Per move shape (N, 3): signed way, m, curvature, 1/m, turn, rad (see ``planner.kernels.steering``).
    arrays
        What the kernels take: see ``planner.kernels.lattice``.
    """

    headings: FloatArray
    parts: tuple[FloatArray, ...]
    arrays: MoveArrays

    @property
    def n_moves(self) -> int:
        """Number of moves."""
        return len(self.parts)


def lattice_vectors(count: int) -> IntArray:
    """Steps (K, 2) in cells (columns, rows) along the K headings, counter-clockwise from (1, 0).

    Raises
    ------
    InvalidProblem
        If the count is not one of ``HEADING_COUNTS``.
    """
    if count not in HEADING_COUNTS:
        raise InvalidProblem(f"The number of headings is {count}; use one of {HEADING_COUNTS}.")
    n = _VECTOR_CELLS[count]
    steps = [
        (dx, dy)
        for dx in range(-n, n + 1)
        for dy in range(-n, n + 1)
        if math.gcd(dx, dy) == 1 and (count < 32 or (abs(dx), abs(dy)) in _STEPS_OF_32)
    ]
    steps.sort(key=lambda v: math.atan2(v[1], v[0]) % (2 * math.pi))
    return frozen(steps, np.int64)


# Nearest to even spacing with at most three cells: 0°, 18.4° or 14°, 26.6°, 33.7° or 36.9°, 45°.
_STEPS_OF_32 = frozenset({(1, 0), (4, 1), (2, 1), (4, 3), (1, 1), (0, 1), (1, 4), (1, 2), (3, 4)})


@lru_cache(maxsize=32)
def primitives_for(steering: Steering, resolution: float, yaw: float, count: int, n_bins: int) -> Primitives:
    """Moves for a robot and a grid.

    Parameters
    ----------
    steering
        How the robot moves.
    resolution, yaw
        Side of a cell, m, and direction of the grid's x-axis in W, rad.
    count
        Headings of the lattice, one of ``HEADING_COUNTS``.
    n_bins
        Headings of the rates.

    Notes
    -----
    Moves lead from centre to centre of cells [PKK09]: one step straight along every heading; for cars,
    straight lines joined by one arc of at least the smallest radius, for neighbouring headings the three
    shortest, for those after them the shortest, that do not begin or end with a whole straight step; in
    reverse the same backwards; for the others turns in place to the neighbouring headings.
    """
    vectors = lattice_vectors(count)
    moves: list[tuple[int, int, int, int, FloatArray]] = []
    for i, v in enumerate(vectors):
        step = float(np.hypot(*v)) * resolution
        moves.append((i, i, int(v[0]), int(v[1]), np.array([[step, 0.0, 0.0]])))
        for side in (1, -1):
            if not steering.is_car:
                j = (i + side) % count
                turn = float(wrap(_angle(vectors[j]) - _angle(v)))
                moves.append((i, j, 0, 0, np.array([[0.0, 0.0, turn]])))
                continue
            for steps, most in _ARCS.items():
                j = (i + side * steps) % count
                moves += [
                    (i, j, *end, parts)
                    for end, parts in _arcs(v, vectors[j], steering.min_turn_radius, resolution, most)
                ]
    if steering.has_reverse:
        moves += [(j, i, -dx, -dy, _reversed(parts)) for i, j, dx, dy, parts in moves]
    moves.sort(key=lambda m: m[0])
    headings = frozen([_angle(v) % (2 * math.pi) for v in vectors])
    built = [_move(m, headings, steering, resolution, yaw, n_bins) for m in moves]
    return Primitives(headings, tuple(frozen(m[4]) for m in moves), _joined(built, count))


def _angle(vector: IntArray) -> float:
    return math.atan2(vector[1], vector[0])


def _reversed(parts: FloatArray) -> FloatArray:
    return np.column_stack([-parts[::-1, 0], parts[::-1, 1:]])


def _arcs(
    first: IntArray, last: IntArray, radius: float, resolution: float, most: int
) -> list[tuple[tuple[int, int], FloatArray]]:
    # Ends (dx, dy) in cells with the parts that lead there, the shortest first.
    turn = float(wrap(_angle(last) - _angle(first)))
    tangent = math.tan(0.5 * abs(turn))
    a, b = (v / np.hypot(*v) for v in (first, last))
    steps = np.hypot(*first) * resolution, np.hypot(*last) * resolution
    reach = math.ceil(_REACH_CELLS + _REACH_RADII * radius / resolution)
    grid = np.arange(-reach, reach + 1)
    ends = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)
    # Ways along both headings to the end.
    ways = np.linalg.solve(np.column_stack([a, b]), ends.T * resolution).T
    least = ways.min(axis=1)
    spare = ways - least[:, None]
    slack = 1e-9
    ok = (
        (least >= radius * tangent - slack)
        & (spare[:, 0] < steps[0] - slack)
        & (spare[:, 1] < steps[1] - slack)
    )
    ends, least, spare = ends[ok], least[ok], spare[ok]
    length = spare.sum(axis=1) + abs(turn) * least / tangent
    out = []
    # The same whichever way the curve is driven: equals stay together.
    rank = np.column_stack([np.round(length, 9), np.round(np.abs(ends @ (a - b)), 9)])
    order = np.lexsort((rank[:, 1], rank[:, 0]))
    cut = rank[order[min(most, len(order)) - 1]]
    for k in order[: most + int((rank[order[most:]] == cut).all(axis=1).sum())]:
        arc = max(float(least[k]) / tangent, radius)
        parts = [(spare[k, 0], 0.0, 0.0), (abs(turn) * arc, math.copysign(1.0 / arc, turn), 0.0)]
        parts.append((spare[k, 1], 0.0, 0.0))
        end = (int(ends[k, 0]), int(ends[k, 1]))
        out.append((end, np.array([p for p in parts if p[0] > slack])))
    return out


@dataclass(frozen=True, slots=True, eq=False)
class _Built:
    """One move for the kernels."""

    head: tuple[int, int, int, int, int]
    extra: float
    cells: IntArray
    lengths: FloatArray
    chords: FloatArray


def _move(
    move: tuple[int, int, int, int, FloatArray],
    headings: FloatArray,
    steering: Steering,
    resolution: float,
    yaw: float,
    n_bins: int,
) -> _Built:
    i, j, dx, dy, parts = move
    ways = parts[parts[:, 0] != 0, 0]
    gear = int(np.sign(ways[0])) if len(ways) else 0
    extra = steering.turn_price * float(np.abs(parts[:, 2]).sum())
    cells, lengths, chords = [], [], []
    pose = (0.0, 0.0, float(headings[i]))
    for way, kappa, turn in parts:
        n = chords_of(way, kappa) if way else 0
        step = way / n if n else 0.0
        half = 0.5 * step * kappa
        stretch = half / math.sin(half) if half else 1.0
        sag = 0.125 * abs(kappa) * step**2
        for _ in range(n):
            end = advance(*pose, step, kappa)
            which = heading_bin(pose[2] + half + yaw, n_bins)
            chord = np.array([pose[:2], end[:2]])
            chords.append([*chord.ravel(), sag])
            for col, row, length, far, near in _swept(chord / resolution):
                cells.append((row, col, which))
                lengths.append(
                    (length * resolution * stretch, far * resolution + sag, near * resolution - sag)
                )
            pose = end
        if turn and steering.turn_price > 0:
            # The cell must be allowed at the headings of the turn, though nothing is driven.
            steps = max(1, math.ceil(abs(turn) * n_bins / (2 * math.pi)))
            col, row = (round(v / resolution) for v in pose[:2])
            for k in range(steps + 1):
                cells.append((row, col, heading_bin(pose[2] + turn * k / steps + yaw, n_bins)))
                lengths.append((0.0, 0.0, 0.0))
        pose = (pose[0], pose[1], pose[2] + turn)
    return _Built(
        (i, j, dy, dx, gear),
        extra,
        np.array(cells, dtype=np.int64).reshape(-1, 3),
        np.array(lengths).reshape(-1, 3),
        np.array(chords).reshape(-1, 5),
    )


def _swept(chord: FloatArray) -> list[tuple[int, int, float, float, float]]:
    """Cells of a chord (2, 2) in cells from the middle of cell (0, 0).

    Column, row, length inside, largest and smallest distance of that piece from the cell's centre.
    """
    shift = int(np.ceil(np.abs(chord).max())) + 2
    ones = np.ones((2 * shift + 1, 2 * shift + 1))
    moved = chord + (shift + 0.5)
    out = []
    done = 0.0
    total = float(np.hypot(*(chord[1] - chord[0])))
    for row, col, row2, col2, length, _ in polyline_pieces(moved, ones):
        a, b = (moved[0] + (moved[1] - moved[0]) * (min(v, total) / total) for v in (done, done + length))
        done += length
        # On a border of two cells both count half: their rates are nearly always the same.
        both = {(row, col), (row2, col2)}
        for r, c in both:
            centre = np.array([c + 0.5, r + 0.5])
            far = max(np.hypot(*(a - centre)), np.hypot(*(b - centre)))
            share = np.clip(np.dot(centre - a, b - a) / max(length**2, 1e-18), 0.0, 1.0)
            near = float(np.hypot(*(a + share * (b - a) - centre)))
            out.append((int(c) - shift, int(r) - shift, length / len(both), float(far), near))
    return out


def _joined(built: list[_Built], count: int) -> MoveArrays:
    heads = np.array([b.head for b in built], dtype=np.int64)
    first = np.searchsorted(heads[:, 0], np.arange(count + 1)).astype(np.int64)
    piece_start = np.concatenate([[0], np.cumsum([len(b.cells) for b in built])]).astype(np.int64)
    chord_start = np.concatenate([[0], np.cumsum([len(b.chords) for b in built])]).astype(np.int64)
    return (
        frozen(first, np.int64),
        frozen(heads, np.int64),
        frozen([b.extra for b in built]),
        frozen(piece_start, np.int64),
        frozen(np.concatenate([b.cells for b in built]), np.int64),
        frozen(np.concatenate([b.lengths for b in built])),
        frozen(chord_start, np.int64),
        frozen(np.concatenate([b.chords for b in built])),
    )
