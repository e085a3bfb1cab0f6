"""OMPL refinement: never worse, the same for the same seed, ends in time, says nothing."""

from __future__ import annotations

import math
import subprocess
import sys
import time

import numpy as np
import pytest

from planner.any_angle import shorten
from planner.errors import InvalidProblem
from planner.pair_search import InformedCells
from planner.sampling import OCTILE_EXCESS, refine_with_ompl, warm_up
from tests.paths import cost_from, grid_path, pulled, space_of
from tests.worlds import world_from_ascii

HALL = world_from_ascii(
    """
    ################################
    #..............................#
    #..............................#
    #.........######...............#
    #.........######......#####....#
    #.....................#####....#
    #.....................#####....#
    ################################
    """
)
ENDS = ((1.05, 1.05), (14.75, 1.05))


def hills(x, y):
    return 0.15 + 0.1 * np.sin(x) * np.sin(1.5 * y)


@pytest.fixture(scope="module")
def hall():
    space = space_of(HALL, hills, radius=0.3, weight=10.0)
    start, goal = (tuple(space.centre(*space.frame.cell_at([p])[0])) for p in ENDS)
    return space, start, goal, cost_from(space, goal)[0], cost_from(space, start)[0]


def cells_between(hall, warm):
    """Cells through which a grid path as dear as the warm path leads, with what that costs."""
    space, _, _, to_go, so_far = hall
    through = to_go + so_far
    rows, cols = np.nonzero(through <= OCTILE_EXCESS * space.line_cost(warm))
    return InformedCells(rows, cols, through[rows, cols])


def refine(hall, warm, *, samples=600, seed=0, seconds=60.0, patience=None):
    space, start, goal, *_ = hall
    return refine_with_ompl(
        space,
        start,
        goal,
        warm,
        cells=cells_between(hall, warm),
        samples=samples,
        deadline_at=time.monotonic() + seconds,
        seed=seed,
        patience=patience,
    )


def test_a_grid_path_gets_cheaper_by_percents(hall):
    space, start, goal, *_ = hall
    warm = grid_path(space, start, goal)
    path, stats = refine(hall, warm, samples=1500)
    cost = space.line_cost(path)
    assert cost < 0.985 * space.line_cost(warm)
    assert stats["cost"] == cost
    assert stats["warm_cost"] == space.line_cost(warm)
    assert stats["samples"] == 1500
    assert 0 < stats["cells"] < space.passable.sum()
    np.testing.assert_allclose(path[[0, -1]], warm[[0, -1]])


def test_a_straight_path_in_an_even_room_stays(hall):
    space = space_of(HALL, lambda x, y: 0.1 + 0.0 * x, radius=0.3)
    a, b = (tuple(space.centre(*space.frame.cell_at([p])[0])) for p in ((1.0, 1.0), (8.5, 1.0)))
    warm = np.array([a, b])
    path, stats = refine((space, a, b, cost_from(space, b)[0], cost_from(space, a)[0]), warm)
    assert stats["cost"] == pytest.approx(stats["warm_cost"], rel=1e-9)
    assert np.abs(path[:, 1] - a[1]).max() < 1e-6


@pytest.mark.parametrize("seed", range(6))
def test_never_worse(hall, seed):
    space, start, goal, *_ = hall
    for warm in (grid_path(space, start, goal), pulled(space, grid_path(space, start, goal))):
        path, stats = refine(hall, warm, samples=150, seed=seed)
        assert space.line_cost(path) <= space.line_cost(warm)
        assert stats["cost"] <= stats["warm_cost"]


def test_a_detour_is_left(hall):
    space, start, goal, *_ = hall
    warm = np.array([start, (1.05, 2.95), (14.75, 2.95), goal])
    assert math.isfinite(space.line_cost(warm))
    path, _ = refine(hall, warm)
    assert space.line_cost(path) < 0.95 * space.line_cost(warm)


def test_same_seed_same_path_and_another_seed_another(hall):
    space, start, goal, *_ = hall
    warm = grid_path(space, start, goal)
    first, second, other = (refine(hall, warm, seed=s)[0] for s in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_the_answer_does_not_depend_on_ompls_own_seed():
    code = (
        "import sys; from ompl import util; util.RNG.setSeed(int(sys.argv[1]));"
        "import hashlib, math, numpy as np; from planner.example_space import example_space as e;"
        "from planner.pair_search import InformedCells as I; from planner.sampling import refine_with_ompl as r;"
        "c = I(*np.nonzero(e().passable), np.full(e().passable.sum(), 6.0));"
        "p, s = r(e(), (.5, .5), (2.5, 2.5), [[.5, .5], [2.5, .5], [2.5, 2.5]], cells=c,"
        "samples=300, deadline_at=math.inf, seed=5); print(hashlib.sha256(p.tobytes()).hexdigest(), len(p))"
    )
    runs = [
        subprocess.run([sys.executable, "-c", code, seed], capture_output=True, text=True, check=True)
        for seed in ("1", "77")
    ]
    assert runs[0].stdout == runs[1].stdout
    # One line of our own: OMPL neither logs nor reports leaks.
    assert len(runs[0].stdout.splitlines()) == 1
    assert not runs[0].stderr


def test_ends_at_the_deadline(hall):
    space, start, goal, *_ = hall
    warm = grid_path(space, start, goal)
    refine(hall, warm, samples=10)
    began = time.monotonic()
    path, stats = refine(hall, warm, samples=10_000_000, seconds=0.2)
    assert time.monotonic() - began < 0.25 + 0.1
    assert 0 < stats["samples"] < 10_000_000
    assert space.line_cost(path) <= space.line_cost(warm)


def test_nothing_to_do_returns_the_warm_path(hall):
    space, start, goal, *_ = hall
    warm = grid_path(space, start, goal)
    for options in ({"samples": 0}, {"seconds": -1.0}):
        path, stats = refine(hall, warm, **options)
        np.testing.assert_array_equal(path, warm)
        assert stats["samples"] == 0
    path, _ = refine((space, start, start, hall[3], hall[4]), [start, start])
    np.testing.assert_array_equal(path, [start])
    nowhere = np.full(space.frame.shape, np.inf)
    path, _ = refine((space, start, goal, nowhere, nowhere), warm)
    np.testing.assert_array_equal(path, warm)


def test_no_points():
    with pytest.raises(InvalidProblem):
        refine_with_ompl(None, (0, 0), (1, 1), [], cells=None, samples=1, deadline_at=math.inf, seed=0)


def test_forbidden_cells_and_walls_are_kept_out(hall):
    def spot(x, y):
        return np.where((np.abs(x - 9.0) < 0.7) & (y < 2.5), 0.9, 0.1)

    space = space_of(HALL, spot, radius=0.3, max_r95=0.5)
    start, goal = (tuple(space.centre(*space.frame.cell_at([p])[0])) for p in ENDS)
    warm = grid_path(space, start, goal)
    path, _ = refine((space, start, goal, cost_from(space, goal)[0], cost_from(space, start)[0]), warm)
    assert math.isfinite(space.line_cost(path))
    assert space.line_cost(path) < space.line_cost(warm)


def test_without_gains_it_soon_gives_up(hall):
    space, start, goal, *_ = hall
    taut, _ = shorten(grid_path(space, start, goal), space)
    _, impatient = refine(hall, taut, samples=3000, patience=64)
    assert 64 <= impatient["samples"] < 1000
    _, patient = refine(hall, taut, samples=600, patience=None)
    assert patient["samples"] == 600
    grid = grid_path(space, start, goal)
    long, _ = refine(hall, grid, samples=3000, patience=64)
    assert space.line_cost(long) < 0.99 * space.line_cost(grid)
    again, _ = refine(hall, grid, samples=3000, patience=64)
    np.testing.assert_array_equal(long, again)


def test_warm_up_is_quick_the_second_time():
    warm_up()
    began = time.perf_counter()
    warm_up()
    assert time.perf_counter() - began < 0.5
