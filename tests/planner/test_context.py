"""What a context keeps, and what it forgets."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from planner.context import PlanningContext
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
############
#..........#
#...##.....#
#..........#
############
"""


def context(**options):
    return PlanningContext(synthetic_field(world_from_ascii(ROOM), 0.25), **options)


def test_the_same_question_is_answered_from_memory():
    c = context()
    graph = c.graph(radius=0.2, weight=4.0)
    assert c.graph(radius=0.2, weight=4.0) is graph
    assert c.graph(radius=0.2, weight=4.0, max_r95=1.0) is not graph
    assert c.graph(radius=0.3, weight=4.0) is not graph
    to_go = c.costs_to(graph, (1.0, 1.0))
    assert c.costs_to(graph, (1.0, 1.0)) is to_go
    assert c.costs_to(graph, (1.0, 1.25)) is not to_go
    assert c.costs_to(c.graph(radius=0.3, weight=4.0), (1.0, 1.0)).graph.cost_space.radius == 0.3


def test_a_search_that_was_stopped_is_not_kept():
    c = context()
    graph = c.graph(radius=0.2, weight=4.0)
    cut = c.costs_to(graph, (1.0, 1.0), stop=np.ones(1, dtype=np.uint8))
    assert not cut.is_complete
    assert c.costs_to(graph, (1.0, 1.0)).is_complete


def test_memory_is_bounded_and_the_oldest_goes_first():
    c = context(cache_bytes=20_000)
    graph = c.graph(radius=0.2, weight=4.0)
    first = c.costs_to(graph, (1.0, 1.0))
    for k in range(40):
        c.costs_to(graph, (1.0 + 0.01 * k, 1.0))
    assert len(c._costs) * first.nbytes <= 20_000
    assert c.costs_to(graph, (1.0, 1.0)) is not first


def test_threads_share_one_context():
    c = context()

    def cost(k):
        graph = c.graph(radius=0.2, weight=float(k % 3))
        return c.costs_to(graph, (1.0 + 0.5 * (k % 2), 1.0)).path_from((4.0, 1.0))[0]

    with ThreadPoolExecutor(4) as pool:
        got = list(pool.map(cost, range(24)))
    assert got[:6] * 4 == got
