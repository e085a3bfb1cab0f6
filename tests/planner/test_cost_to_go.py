"""Grid search between continuous places: connections, paths, smallest bounds, what is cached."""

from __future__ import annotations

import math

import numpy as np
import pytest
from skimage.graph import MCP_Geometric

from maps.clearance import ClearanceIndex
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.cost_space import cost_space_for
from planner.cost_to_go import GridGraph, smallest_bound
from tests.fields import synthetic_field
from tests.oracles import grid_smallest_worst
from tests.worlds import place_in_ascii, world_from_ascii

ROOMS = """
##############
#s....#......#
#.....#......#
#............#
#.....#......#
#.....#.....g#
##############
"""


def graph_of(world, resolution=0.25, *, radius=0.2, weight=4.0, sigma=None, **bounds):
    field = synthetic_field(world, resolution, sigma or (lambda x, y: 0.02 + 0.03 * np.sin(2 * x) ** 2))
    index = ClearanceIndex.from_world(world)
    centre = index.at_centres(field.frame)
    space = cost_space_for(
        field.frame, field.free, field.r95, index, centre, radius=radius, weight=weight, **bounds
    )
    return GridGraph.from_cost_space(space), field


def random_world(rng, shape=(30, 40), share=0.85, yaw=0.4):
    mask = np.pad(rng.random(shape) < share, 1)
    frame = GridFrame(-2.0, 5.0, yaw, 0.5, *mask.shape)
    return World("w", OccupancyGrid(frame, mask, ~mask), LandmarkSet((), np.empty((0, 2))))


def test_between_cell_centres_the_cost_is_that_of_mcp_geometric(rng):
    for _ in range(3):
        graph, _ = graph_of(random_world(rng), radius=0.25)
        space = graph.cost_space
        rows, cols = np.nonzero(space.passable)
        k = rng.integers(len(rows), size=6)
        to_go = graph.costs_to(tuple(space.centre(rows[k[0]], cols[k[0]])))
        mcp = MCP_Geometric(np.where(space.passable, 0.25 * space.rate, -1.0))
        theirs, _ = mcp.find_costs([(rows[k[0]], cols[k[0]])])
        np.testing.assert_allclose(to_go.cost[space.passable], theirs[space.passable], rtol=1e-9)
        for i in k[1:]:
            cost, points = to_go.path_from(tuple(space.centre(rows[i], cols[i])))
            assert cost == pytest.approx(theirs[rows[i], cols[i]], rel=1e-9)
            if points is not None:
                assert space.line_cost(points) == pytest.approx(cost, rel=1e-9)


def test_paths_begin_and_end_exactly_and_cost_what_they_say(rng):
    graph, _ = graph_of(random_world(rng, share=0.95), radius=0.25)
    space = graph.cost_space
    found = 0
    while found < 10:
        start, goal = (tuple(p) for p in space.frame.to_world(rng.random((2, 2)) * [84, 64]))
        if min(space.line_cost([start]), space.line_cost([goal])) == math.inf:
            continue
        cost, points = graph.costs_to(goal).path_from(start)
        if points is None:
            continue
        found += 1
        assert tuple(points[0]) == start
        assert tuple(points[-1]) == goal
        assert space.line_cost(points) == pytest.approx(cost, rel=1e-9)


def test_a_place_in_a_cell_that_is_too_close_to_a_wall_is_connected():
    graph, _ = graph_of(world_from_ascii(ROOMS), radius=0.35)
    space = graph.cost_space
    goal = (6.15, 0.85)  # 0.35 m from two walls
    assert not space.passable[tuple(space.frame.cell_at(goal))]
    cells, costs = graph.connect(goal)
    assert len(cells) > 1
    for cell, cost in zip(graph.centres(cells), costs, strict=True):
        assert space.line_cost([goal, cell]) == pytest.approx(cost)
    cost, points = graph.costs_to(goal).path_from((5.0, 2.5))
    assert math.isfinite(cost)
    assert tuple(points[-1]) == goal


def test_no_way_no_place():
    world = world_from_ascii(ROOMS.replace("#............#", "#.....#......#"))
    graph, _ = graph_of(world)
    s, g = place_in_ascii(ROOMS, "s"), place_in_ascii(ROOMS, "g")
    assert graph.costs_to(g).path_from(s) == (math.inf, None)
    assert graph.costs_to(s).path_from(s)[0] == pytest.approx(2 * graph.connect(s)[1].min())
    assert graph.costs_to((-5.0, -5.0)).path_from(s) == (math.inf, None)
    assert graph.costs_to(s).path_from((100.0, 0.0)) == (math.inf, None)
    assert smallest_bound(graph, np.zeros(graph.cost_space.frame.shape), s, g) == math.inf


def test_smallest_bound_has_a_path_and_less_has_none(rng):
    for _ in range(5):
        noise = rng.random((200, 200))

        def sigma(x, y, noise=noise):
            return 0.01 + 0.1 * noise[: x.shape[0], : x.shape[1]]

        world = random_world(rng, shape=(8, 8), share=0.9, yaw=0.0)
        graph, field = graph_of(world, radius=0.2, sigma=sigma)
        space = graph.cost_space
        rows, cols = np.nonzero(space.passable)
        i, j = rng.integers(len(rows), size=2)
        a, b = (rows[i], cols[i]), (rows[j], cols[j])
        bound = smallest_bound(graph, field.r95, tuple(space.centre(*a)), tuple(space.centre(*b)))
        assert bound == grid_smallest_worst(np.nan_to_num(field.r95), space.passable, a, b)
        if not math.isfinite(bound):
            continue
        for limit, possible in ((bound, True), (np.nextafter(bound, 0), False)):
            bounded, _ = graph_of(world, radius=0.2, sigma=sigma, max_r95=limit)
            cost, _ = bounded.costs_to(tuple(space.centre(*b))).path_from(tuple(space.centre(*a)))
            assert math.isfinite(cost) is possible
