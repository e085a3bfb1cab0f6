"""Offsets: steps never raise the cost, and the optimum is where it must be."""

from __future__ import annotations

import numpy as np

from planner.offsets import OffsetModel
from tests.oracles import least_in_box
from tests.paths import space_of
from tests.worlds import world_from_ascii

ROOM = world_from_ascii("\n".join(["#" * 24, *["#" + "." * 22 + "#"] * 10, "#" * 24]))


def model_of(path, space, solver=least_in_box, spacing=0.3):
    return OffsetModel(space, np.asarray(path, dtype=float), spacing=spacing, sigma=0.3, solver=solver)


def test_a_bent_path_in_a_uniform_room_becomes_straight():
    space = space_of(ROOM, lambda x, y: 0.1 + 0.0 * x, radius=0.3)
    model = model_of([[1.0, 2.0], [5.0, 2.8], [9.0, 2.0]], space)
    points = model.optimise(0.01)
    assert np.abs(points[:, 1] - 2.0).max() < 0.02
    assert model.n_solved >= 1
    assert model.n_stations == len(points)


def test_the_path_leans_towards_low_rates_and_bending_holds_it():
    def valley(x, y):
        return 0.1 + 0.5 * (y - 3.0) ** 2

    space = space_of(ROOM, valley, radius=0.3)
    path = [[1.0, 2.0], [6.0, 2.1], [10.0, 2.0]]
    loose = model_of(path, space).optimise(1e-3)
    stiff = model_of(path, space).optimise(1e3)
    assert loose[len(loose) // 2, 1] > 2.4
    assert stiff[len(stiff) // 2, 1] < 2.1


def test_stops_when_it_is_late():
    space = space_of(ROOM, lambda x, y: 0.1 + 0.0 * x, radius=0.3)
    model = model_of([[1.0, 2.0], [5.0, 3.8], [9.0, 2.0]], space)
    before = model.offset.copy()
    model.optimise(0.01, lambda: True)
    np.testing.assert_array_equal(model.offset, before)
    assert model.n_solved == 0


def test_more_margin_moves_away_from_the_wall():
    space = space_of(ROOM, lambda x, y: 0.1 + 0.0 * x, radius=0.3)
    model = model_of([[1.0, 0.81], [3.0, 0.805], [5.0, 0.81]], space)
    near = model.optimise(0.01)[6, 1]
    model.widen(np.linspace(0.2, 0.8, 20), np.full(20, 0.05))
    far = model.optimise(0.01)[6, 1]
    assert far > near + 0.03


def test_polishing_lowers_the_exact_cost_in_uneven_cells(rng):
    cells = rng.uniform(0.05, 0.5, (70, 130))
    space = space_of(ROOM, lambda x, y: cells[(y / 0.1).astype(int), (x / 0.1).astype(int)], radius=0.3)
    model = model_of([[1.0, 2.0], [5.0, 2.8], [9.0, 2.0]], space)
    before = space.line_cost(model.optimise(0.01))
    after = space.line_cost(model.polish(0.01))
    assert after < 0.97 * before
    np.testing.assert_array_equal(model.polish(0.01, lambda: True), model.polish(0.01, lambda: True))
