"""Searches between two places give what the search of the whole grid gives, to the last bit."""

from __future__ import annotations

import gc
import math
import time

import numpy as np
import pytest
from skimage.graph import MCP_Geometric

from planner.background import Background
from planner.context import PlanningContext
from planner.pair_search import PairSearch
from planner.pivots import Pivots
from tests.fields import synthetic_field
from tests.oracles import grid_dijkstra
from tests.planner.test_cost_to_go import graph_of, random_world
from tests.worlds import world_from_ascii


def places(graph, rng, n):
    """Pairs of places anywhere in passable cells, a third of them cell centres."""
    rows, cols = np.nonzero(graph.cost_space.passable)
    for k in range(n):
        i = rng.integers(len(rows), size=2)
        offsets = 0.0 if k % 3 == 0 else rng.uniform(-0.1, 0.1, (2, 2))
        a, b = graph.cost_space.centre(rows[i], cols[i]) + offsets
        yield tuple(a), tuple(b)


def assert_same(found, expected):
    cost, points = expected
    assert found.cost == cost
    assert found.is_complete
    assert (points is None) == (found.points is None)
    if points is not None:
        np.testing.assert_array_equal(found.points, points)


# An even field, where many paths are equal; one of small and one of large differences.
@pytest.mark.parametrize("weight", [0.0, 4.0, 1e4])
@pytest.mark.parametrize("share", [0.75, 0.9])
def test_the_same_path_as_from_costs_of_all_cells(rng, weight, share):
    for _ in range(3):
        graph, _ = graph_of(random_world(rng, share=share), radius=0.2, weight=weight)
        pairs = PairSearch()
        some = [None, Pivots.none(), Pivots.build(graph, count=1), Pivots.build(graph)]
        for start, goal in places(graph, rng, 12):
            expected = graph.costs_to(goal).path_from(start)
            for pivots in some:
                assert_same(pairs.path(graph, start, goal, pivots=pivots), expected)


def test_costs_are_those_of_mcp_geometric_and_of_plain_dijkstra(rng):
    graph, _ = graph_of(random_world(rng), radius=0.2)
    space = graph.cost_space
    rows, cols = np.nonzero(space.passable)
    pivots, pairs = Pivots.build(graph), PairSearch()
    for _ in range(6):
        i, j = rng.integers(len(rows), size=2)
        start, goal = (tuple(space.centre(rows[k], cols[k])) for k in (i, j))
        found = pairs.path(graph, start, goal, pivots=pivots).cost
        source, target = (int(rows[j]), int(cols[j])), (int(rows[i]), int(cols[i]))
        twin = grid_dijkstra(space.rate, space.passable, source, 0.25).get(target, math.inf)
        assert found == pytest.approx(twin, rel=1e-12)
        theirs, _ = MCP_Geometric(np.where(space.passable, 0.25 * space.rate, -1.0)).find_costs([source])
        assert found == pytest.approx(theirs[target], rel=1e-9)


def test_informed_cells_are_all_those_below_the_limit(rng):
    for weight in (0.0, 6.0):
        graph, _ = graph_of(random_world(rng), radius=0.2, weight=weight)
        pairs, pivots = PairSearch(), Pivots.build(graph)
        for start, goal in places(graph, rng, 6):
            to_go, so_far = graph.costs_to(goal), graph.costs_to(start)
            cost = to_go.path_from(start)[0]
            if not math.isfinite(cost):
                assert len(pairs.informed_cells(graph, start, goal, 1e3).through) == 0
                continue
            for factor in (0.9, 1.0 + 1e-9, 1.05, 1.5):
                through = to_go.cost + so_far.cost
                expected = through <= factor * cost
                for known, some in ((None, None), (None, pivots), (to_go, None)):
                    cells = pairs.informed_cells(graph, start, goal, factor * cost, to_go=known, pivots=some)
                    mask = np.zeros_like(expected)
                    mask[cells.rows, cells.cols] = True
                    # At the limit itself rounding decides.
                    clear = np.abs(through / (factor * cost) - 1) > 1e-12
                    np.testing.assert_array_equal(mask[clear], expected[clear])
                    np.testing.assert_allclose(cells.through, through[cells.rows, cells.cols], rtol=1e-12)


def test_cells_beside_the_path_are_the_informed_ones(rng):
    graph, _ = graph_of(random_world(rng), radius=0.2)
    pairs, pivots = PairSearch(), Pivots.build(graph)
    for start, goal in places(graph, rng, 8):
        expected = graph.costs_to(goal).path_from(start)
        found = pairs.path(graph, start, goal, margin=0.02, pivots=pivots)
        assert_same(found, expected)
        if found.points is not None:
            cells = pairs.informed_cells(graph, start, goal, found.cost * 1.02)
            for name in ("rows", "cols", "through"):
                np.testing.assert_array_equal(getattr(found.cells, name), getattr(cells, name))


def test_places_without_a_way(rng):
    graph, _ = graph_of(world_from_ascii("#########\n#...#...#\n#########"))
    pairs, pivots = PairSearch(), Pivots.build(graph)
    left, right, outside = (2.0, 1.5), (6.0, 1.5), (-9.0, 0.0)
    for some in (None, pivots):
        for a, b in ((left, right), (right, left), (left, outside), (outside, left)):
            assert pairs.path(graph, a, b, pivots=some).points is None
            assert len(pairs.informed_cells(graph, a, b, 100.0, pivots=some).through) == 0
        # What was searched in vain leaves no traces.
        assert_same(
            pairs.path(graph, left, (1.6, 1.4), pivots=some), graph.costs_to((1.6, 1.4)).path_from(left)
        )


def test_a_search_that_is_stopped_says_so(rng):
    graph, _ = graph_of(random_world(rng), radius=0.2)
    flag = np.ones(1, dtype=np.uint8)
    (start, goal), *_ = places(graph, rng, 1)
    assert not PairSearch().path(graph, start, goal, stop=flag).is_complete
    assert PairSearch().informed_cells(graph, start, goal, 100.0, stop=flag) is None
    assert Pivots.build(graph, stop=flag) is None


def test_pivots_bound_from_below(rng):
    graph, _ = graph_of(random_world(rng), radius=0.2)
    pivots = Pivots.build(graph, count=5)
    assert pivots.table.shape == (len(graph.half), 5)
    cells = np.flatnonzero(np.isfinite(graph.half))
    for goal in rng.choice(cells, 5):
        cost = graph.costs_to(tuple(graph.centres(np.array([goal]))[0])).padded
        for k in range(5):
            known = (pivots.table[cells, k] < 65535) & (pivots.table[goal, k] < 65535)
            entries = pivots.table[cells[known], k].astype(float)
            bound = (np.abs(entries - float(pivots.table[goal, k])) - 1) * pivots.units[k]
            assert (bound <= cost[cells[known]] + 1e-9).all()


def test_a_context_prepares_what_is_asked_again_and_answers_stay():
    room = "\n".join(["#" * 30, *["#" + "." * 28 + "#"] * 12, "#" * 30])
    context = PlanningContext(
        synthetic_field(world_from_ascii(room), 0.25, lambda x, y: 0.05 + 0.02 * np.sin(x))
    )
    graph = context.graph(radius=0.3, weight=8.0)
    start, goal = (2.0, 2.0), (25.0, 9.0)
    first = context.path(graph, start, goal)
    assert context.background.wait(10.0)
    assert context._known_pivots(graph) is None
    second = context.path(graph, start, goal)
    assert context.background.wait(10.0)
    assert context._known_pivots(graph) is not None
    assert context._known_costs(graph, goal) is not None
    third = context.path(graph, start, goal)
    for other in (second, third, context.path(graph, start, goal)):
        assert_same(other, (first.cost, first.points))


def test_work_in_the_background_ends_with_its_owner():
    class Owner:
        pass

    owner, seen = Owner(), []

    def make(flag):
        until = time.monotonic() + 10.0
        while not flag[0] and time.monotonic() < until:
            time.sleep(0.005)
        return bool(flag[0])

    background = Background(owner)
    background.add("a", make, lambda *_: seen.append("kept"))
    background.add("a", make, lambda *_: seen.append("kept"))
    background.add("b", make, lambda *_: seen.append("kept"))
    del owner
    gc.collect()
    assert background.wait(5.0)
    assert seen == []
    assert not background.is_again("q")
    assert background.is_again("q")
