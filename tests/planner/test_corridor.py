"""Reference lines and corridors."""

from __future__ import annotations

import numpy as np

from planner.corridor import corridor_around, reference_along, resample
from tests.paths import random_pairs, space_of
from tests.worlds import world_from_ascii

WORLD = world_from_ascii(
    """
    ####################
    #..................#
    #.....###..........#
    #.....###....###...#
    #............###...#
    #..................#
    ####################
    """
)


def test_resampling_keeps_the_ends_and_the_spacing():
    points = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]])
    out = resample(points, 8)
    np.testing.assert_allclose(out[[0, 6, 8]], [[0, 0], [3, 0], [3, 1]])
    np.testing.assert_allclose(np.abs(np.diff(out, axis=0)).sum(axis=1), 0.5)


def test_reference_knows_where_the_path_lies():
    path = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]])
    reference = reference_along(path, spacing=0.25, sigma=0.4)
    np.testing.assert_array_equal(reference.centre[[0, -1]], path[[0, -1]])
    assert np.hypot(*(reference.centre - [3.0, 0.0]).T).min() > 0.15
    on_path = reference.centre + reference.beside[:, None] * reference.normal
    off = np.minimum(np.abs(on_path[:, 1]), np.abs(on_path[:, 0] - 3.0))
    assert off.max() < 0.02
    np.testing.assert_allclose(np.hypot(*reference.normal.T), 1.0)


def test_a_very_short_path_has_a_reference():
    reference = reference_along(np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01]]), spacing=0.25, sigma=0.4)
    assert len(reference.beside) == 9
    assert np.isfinite(reference.centre).all()


def test_corridors_are_ordered_closed_at_the_ends_and_do_not_cross(rng):
    space = space_of(WORLD, lambda x, y: 0.1 + 0.0 * x, radius=0.3)
    for path in random_pairs(space, rng, 15):
        reference = reference_along(path, spacing=0.25, sigma=0.4)
        n = (len(reference.beside) + 1) // 2
        c = corridor_around(reference, space, np.full(n, 0.005))
        assert (c.low <= c.anchor + 1e-12).all()
        assert (c.anchor <= c.high + 1e-12).all()
        for array in (c.low, c.anchor, c.high):
            assert array[0] == array[-1] == 0
        tangent = np.diff(c.centre, axis=0)
        for bound in (c.low, c.high):
            line = c.centre + bound[:, None] * c.normal
            assert ((np.diff(line, axis=0) * tangent).sum(axis=1) > -1e-9).all()
        inside = c.centre + c.anchor[:, None] * c.normal
        assert (space.clearance.distance(inside) >= space.need - 0.02).all()
