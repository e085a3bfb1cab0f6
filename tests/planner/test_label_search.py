"""Paths with a bound on the metres without a fix: scenes, ends anywhere, what cannot be kept."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.cost_to_go import GridGraph
from planner.errors import InvalidProblem
from planner.label_search import blind_path, smallest_blind_distance
from tests.oracles import cheapest_with_stretches
from tests.paths import space_of
from tests.worlds import place_in_ascii, world_from_ascii

# Straight on there is no fix between x = 4 and x = 10; the way around sees landmarks.
HALL = """
################
#..............#
#.############.#
#.############.#
#s............g#
################
"""
RESOLUTION = 0.25


@pytest.fixture(scope="module")
def hall():
    world = world_from_ascii(HALL, resolution=1.0)

    def r95(x, y):
        return np.where((x > 4.0) & (x < 10.0) & (y < 3.0), np.nan, 0.05)

    space = space_of(world, r95, resolution=RESOLUTION, radius=0.2, weight=1.0, blind_rate=1.5)
    has_fix = np.isfinite(space.rate) & (space.rate != 1.5)
    return (
        GridGraph.from_cost_space(space),
        has_fix,
        place_in_ascii(HALL, "s", 1.0),
        place_in_ascii(HALL, "g", 1.0),
    )


def test_a_bound_sends_the_path_around(hall):
    graph, has_fix, start, goal = hall
    straight = blind_path(graph, has_fix, start, goal, max_blind_distance=6.5)
    around = blind_path(graph, has_fix, start, goal, max_blind_distance=2.0)
    assert straight.status == around.status == "found"
    assert straight.is_complete
    assert straight.longest_blind == pytest.approx(6.0)
    assert straight.cost == pytest.approx(graph.costs_to(goal).path_from(start)[0])
    assert around.longest_blind == 0.0
    assert around.cost > straight.cost
    assert around.points[:, 1].max() > 4.0
    for path in (straight, around):
        assert path.blind.shape == (len(path.points),)
        assert path.blind.max() <= path.longest_blind + 1e-9
        assert np.allclose(path.points[[0, -1]], [start, goal])
        assert path.cost == pytest.approx(graph.cost_space.line_cost(path.points))
    assert np.isnan(straight.covariance).all()


def test_without_a_way_around_the_smallest_distance_is_named(hall):
    graph, has_fix, start, _ = hall
    goal = (7.1, 1.6)  # within the stretch
    assert smallest_blind_distance(graph, has_fix, start, goal) == pytest.approx(2.9, abs=0.15)
    path = blind_path(graph, has_fix, start, goal, max_blind_distance=1.0)
    assert path.status == "bound_unmet"
    assert path.is_complete
    assert path.longest_blind == pytest.approx(path.excess * 1.0)
    assert path.longest_blind == pytest.approx(smallest_blind_distance(graph, has_fix, start, goal))
    assert np.allclose(path.points[-1], goal)


def test_no_bound_is_the_plain_search_and_no_way_is_no_path(hall):
    graph, has_fix, start, goal = hall
    to_go = graph.costs_to(goal)
    free = blind_path(graph, has_fix, start, goal, max_blind_distance=math.inf, to_go=to_go)
    assert free.cost == pytest.approx(to_go.path_from(start)[0])
    nowhere = blind_path(graph, has_fix, start, (3.5, 3.5), max_blind_distance=1.0)
    assert nowhere.status == "no_path"
    assert not nowhere.has_path
    assert nowhere.is_complete


def test_a_bound_of_nothing_allows_only_places_with_a_fix(hall):
    graph, has_fix, start, goal = hall
    path = blind_path(graph, has_fix, start, goal, max_blind_distance=0.0)
    assert path.status == "found"
    assert path.longest_blind == 0.0


def test_a_stopped_search_says_so(hall):
    graph, has_fix, start, goal = hall
    stop = np.ones(1, dtype=np.uint8)
    path = blind_path(graph, has_fix, start, goal, max_blind_distance=2.0, stop=stop)
    assert path.status == "stopped"
    assert not path.is_complete


@pytest.mark.parametrize("bound", [-1.0, math.nan])
def test_impossible_bounds_are_refused(hall, bound):
    graph, has_fix, start, goal = hall
    with pytest.raises(InvalidProblem, match="without a fix"):
        blind_path(graph, has_fix, start, goal, max_blind_distance=bound)


def test_random_fields_cost_what_every_label_costs(rng):
    world = world_from_ascii("\n".join(["." * 8] * 6), resolution=1.0)
    for _ in range(15):
        known = rng.random((6, 8)) < 0.4

        def r95(x, y, known=known):
            return np.where(known[y.astype(int), x.astype(int)], 0.1, np.nan)

        space = space_of(world, r95, resolution=1.0, radius=0.2, weight=2.0, blind_rate=1.7)
        graph = GridGraph.from_cost_space(space)
        cells = np.argwhere(space.passable)
        a, b = (tuple(int(v) for v in cells[k]) for k in rng.choice(len(cells), size=2, replace=False))
        limit = float(rng.choice([1.0, 2.0, 3.5]))
        expected = cheapest_with_stretches(
            space.rate, space.passable, known, a, b, resolution=1.0, limit=limit
        )
        places = [tuple(float(v) for v in space.centre(*cell)) for cell in (a, b)]
        path = blind_path(graph, known, *places, max_blind_distance=limit)
        if expected < math.inf:
            assert path.status == "found"
            assert path.cost == pytest.approx(expected)
        else:
            assert path.status == "bound_unmet"
            assert path.excess > 1.0
