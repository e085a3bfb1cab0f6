"""Exact rays and pockets against their slow twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.kernels.grid_visibility import (
    BURIED,
    FAR,
    NO_WALL,
    POCKET,
    clear_sight,
    in_cone,
    is_opaque,
    make_pocket,
    make_pockets,
    see_points,
    touches_opaque,
)
from tests.oracles import pocket_on_grid, sight_on_grid

SHIFT = 3  # a coarse lattice makes corners, edges and diagonals frequent
UNIT = 1 << SHIFT
NO_WINDOW = np.zeros((9, 9), dtype=bool)
NAMES = {"clear": NO_WALL, "pocket": POCKET, "buried": BURIED}


def lattice_point(rng, shape, beyond=1):
    """On a corner, an edge, a middle or anywhere, up to a cell beyond the grid."""
    n_rows, n_cols = shape
    x, y = rng.integers(-beyond * UNIT, [(n_cols + beyond) * UNIT + 1, (n_rows + beyond) * UNIT + 1])
    kind = rng.integers(4)
    if kind in (0, 1):
        x = x // UNIT * UNIT
    if kind == 0:
        y = y // UNIT * UNIT
    if kind == 2:
        x, y = x // UNIT * UNIT + UNIT // 2, y // UNIT * UNIT + UNIT // 2
    return int(x), int(y)


def test_sight_equals_a_walk_over_all_cells(rng):
    seen = 0
    for _ in range(2000):
        shape = tuple(rng.integers(1, 7, 2))
        opaque = rng.random(shape) < rng.choice([0.1, 0.3, 0.5])
        cells = np.argwhere(opaque).tolist()
        landmark, place = lattice_point(rng, shape), lattice_point(rng, shape)
        got = clear_sight(opaque, NO_WINDOW, FAR, FAR, SHIFT, *landmark, *place)
        assert got == sight_on_grid(lambda r, c: True, cells, UNIT, landmark, place), (
            opaque,
            landmark,
            place,
        )
        seen += got
    assert 400 < seen < 1600


def test_sight_goes_both_ways(rng):
    for _ in range(500):
        opaque = rng.random((6, 6)) < 0.25
        a, b = lattice_point(rng, (6, 6)), lattice_point(rng, (6, 6))
        if any(touches_opaque(opaque, NO_WINDOW, FAR, FAR, SHIFT, *p) for p in (a, b)):
            continue
        there = clear_sight(opaque, NO_WINDOW, FAR, FAR, SHIFT, *a, *b)
        assert there == clear_sight(opaque, NO_WINDOW, FAR, FAR, SHIFT, *b, *a)


def test_window_replaces_the_cells_under_it(rng):
    for _ in range(100):
        opaque = rng.random((7, 7)) < 0.3
        window = rng.random((3, 3)) < 0.3
        row, col = rng.integers(-2, 8, 2)
        patched = np.zeros((13, 13), dtype=bool)
        patched[3:10, 3:10] = opaque
        patched[row + 3 : row + 6, col + 3 : col + 6] = window
        a, b = lattice_point(rng, (7, 7)), lattice_point(rng, (7, 7))
        moved = [v + 3 * UNIT for v in (*a, *b)]
        assert clear_sight(opaque, window, row, col, SHIFT, *a, *b) == clear_sight(
            patched, NO_WINDOW, FAR, FAR, SHIFT, *moved
        )
        assert is_opaque(opaque, window, row, col, 2, 3) == patched[5, 6]


def test_one_sided_graze_is_seen_and_a_pinch_is_not():
    opaque = np.array([[0, 1, 0], [0, 0, 0], [0, 0, 0]], dtype=bool)
    ray = (0, UNIT, 3 * UNIT, UNIT)  # along the upper edge of the opaque cell
    assert clear_sight(opaque, NO_WINDOW, FAR, FAR, SHIFT, *ray)
    opaque[1, 2] = True  # now another cell touches from above, elsewhere; its own corner is not the end
    assert not clear_sight(opaque, NO_WINDOW, FAR, FAR, SHIFT, 0, UNIT, 4 * UNIT, UNIT)
    diagonal = np.array([[0, 1], [1, 0]], dtype=bool)
    assert not clear_sight(diagonal, NO_WINDOW, FAR, FAR, SHIFT, 4, 4, UNIT + 4, UNIT + 4)
    half = np.array([[0, 0], [1, 0]], dtype=bool)
    assert clear_sight(half, NO_WINDOW, FAR, FAR, SHIFT, 4, 4, UNIT + 4, UNIT + 4)


def test_nothing_is_seen_from_its_own_place_or_from_a_wall():
    opaque = np.array([[0, 1]], dtype=bool)
    assert not clear_sight(opaque, NO_WINDOW, FAR, FAR, SHIFT, 4, 4, 4, 4)
    assert not clear_sight(opaque, NO_WINDOW, FAR, FAR, SHIFT, 2, 4, UNIT, 4)
    assert touches_opaque(opaque, NO_WINDOW, FAR, FAR, SHIFT, UNIT, 4)
    assert not touches_opaque(opaque, NO_WINDOW, FAR, FAR, SHIFT, UNIT - 1, 4)


def test_cones():
    east_45 = np.array([724, 724, 724, -724])  # both: |dy| ≤ dx
    assert in_cone(1, east_45, 5, 5)
    assert in_cone(1, east_45, 5, -5)
    assert not in_cone(1, east_45, 5, 6)
    assert in_cone(2, east_45, 0, 1)
    assert not in_cone(2, east_45, -5, 1)
    assert in_cone(0, east_45, -5, 1)


@pytest.mark.parametrize("with_normal", [False, True])
def test_pockets_equal_their_twin(rng, with_normal):
    states = []
    for _ in range(400):
        shape = tuple(rng.integers(2, 12, 2))
        opaque = rng.random(shape) < rng.choice([0.2, 0.5, 0.9])
        free = ~opaque & (rng.random(shape) < 0.7)
        landmark = lattice_point(rng, shape)
        angle = rng.choice(8) * math.pi / 4
        normal = (round(math.cos(angle)), round(math.sin(angle))) if with_normal else (0.0, 0.0)
        window = np.zeros((9, 9), dtype=bool)
        tolerance = int(1.2 * UNIT)
        state = make_pocket(opaque, free, SHIFT, *landmark, *(float(v) for v in normal), tolerance, window)
        name, cells = pocket_on_grid(opaque, free, UNIT, landmark, normal, tolerance / UNIT, 9)
        assert NAMES[name] == state
        for (row, col), value in cells.items():
            got = window[row - (landmark[1] // UNIT - 4), col - (landmark[0] // UNIT - 4)]
            assert got == value, (row, col)
        states.append(name)
    assert {"clear", "pocket", "buried"} == set(states)


def test_points_and_landmarks_in_bulk(rng):
    opaque = rng.random((8, 8)) < 0.3
    landmarks = np.array([lattice_point(rng, (8, 8)) for _ in range(5)])
    points = np.array([lattice_point(rng, (8, 8)) for _ in range(60)])
    windows, states = np.zeros((5, 9, 9), dtype=bool), np.zeros(5, dtype=np.int64)
    make_pockets(opaque, ~opaque, SHIFT, landmarks, np.zeros((5, 2)), int(1.2 * UNIT), windows, states)
    modes, forms = np.zeros(5, dtype=np.int64), np.zeros((5, 4), dtype=np.int64)
    modes[3], forms[3] = 1, (1, 0, 1, 0)  # only to the right
    out = np.empty((60, 5), dtype=bool)
    low2, high2 = 1.0, 25.0
    see_points(
        opaque,
        windows,
        states,
        SHIFT,
        landmarks,
        landmarks / UNIT,
        modes,
        forms,
        points,
        points / UNIT,
        low2,
        high2,
        out,
    )
    for p, place in enumerate(points):
        for i, landmark in enumerate(landmarks):
            d2 = ((place - landmark) ** 2).sum() / UNIT**2
            name, pocket = pocket_on_grid(
                opaque, ~opaque, UNIT, tuple(landmark.tolist()), (0, 0), 9 / UNIT, 9
            )
            cells = {(r, c): opaque[r, c] for r in range(8) for c in range(8)} | pocket
            expected = (
                low2 <= d2 <= high2
                and name != "buried"
                and (i != 3 or place[0] >= landmark[0])
                and sight_on_grid(
                    lambda r, c, cells=cells: cells[r, c],
                    cells,
                    UNIT,
                    tuple(landmark.tolist()),
                    tuple(place.tolist()),
                )
            )
            assert out[p, i] == expected
    assert out.any()
