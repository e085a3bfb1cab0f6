"""The smallest collision probability with a way: against the exact probability of every cell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.clock import Stopped
from planner.context import PlanningContext
from planner.cost_to_go import smallest_bound
from planner.extras import judged_covariance
from planner.risk import cell_probabilities
from planner.smallest_risk import smallest_risk
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

HALL = """
##############
#............#
#....##..#...#
#....##..#...#
#........#...#
#....#.......#
######.###.###
#............#
##############
"""
A, B = (0.9, 3.2), (5.8, 0.9)


def made(scale, blind=False):
    def sigma(x, y):
        known = scale * (0.3 + np.abs(np.sin(3 * x + y)))
        return np.where((x > 3) & (x < 4) & blind, np.nan, known)

    return PlanningContext(synthetic_field(world_from_ascii(HALL, resolution=0.5), 0.1, sigma))


@pytest.mark.parametrize("scale", [0.03, 0.08, 0.2])
@pytest.mark.parametrize("blind_r95", [None, 0.4])
def test_against_the_probabilities_of_all_cells(scale, blind_r95):
    context = made(scale, blind=blind_r95 is not None)
    graph = context.graph(radius=0.1, weight=1.0, blind_rate=2.0)
    values = cell_probabilities(
        context.clearance,
        context.field.frame,
        context.centre_clearance,
        judged_covariance(context.field, blind_r95),
        radius=0.1,
    )
    theirs = smallest_bound(graph, values, A, B)
    for share in (0.9, 0.1, 1e-3):
        above = share * theirs
        found = smallest_risk(context, graph, A, B, above=above, blind_r95=blind_r95)
        assert found == theirs
    if theirs < 1:
        # What is kept for the plan under that bound lets it pass, and nothing less certain.
        kept = context.risky(theirs, radius=0.1, blind_r95=blind_r95)
        np.testing.assert_array_equal(kept, np.nan_to_num(values) > theirs)


def test_no_way_at_all_and_a_stop():
    context = made(0.05)
    closed = context.graph(radius=0.6, weight=1.0, blind_rate=2.0)
    assert smallest_risk(context, closed, A, B, above=0.01, blind_r95=None) == math.inf
    graph = context.graph(radius=0.1, weight=1.0, blind_rate=2.0)
    with pytest.raises(Stopped):
        smallest_risk(context, graph, A, B, above=1e-5, blind_r95=None, stop=np.ones(1, dtype=np.uint8))
