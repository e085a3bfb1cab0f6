"""Corridors and chords against the exact clearance and the cells themselves."""

from __future__ import annotations

import math

import numpy as np

from planner.kernels.corridor import cell_rate, chord_costs, corridor
from tests.paths import space_of
from tests.worlds import world_from_ascii

WORLD = world_from_ascii(
    """
    ################
    #..............#
    #......##......#
    #......##......#
    #..............#
    #...........#..#
    ################
    """
)


def r95(x, y):
    return np.where((x > 5) & (y > 2.2), 0.5, 0.1 + 0.05 * np.sin(3 * x))


def random_stations(rng, n):
    centre = np.column_stack([rng.uniform(0.6, 7.4, n), rng.uniform(0.6, 2.9, n)])
    angle = rng.uniform(-math.pi, math.pi, n)
    return centre, np.column_stack([np.cos(angle), np.sin(angle)])


def test_everything_inside_is_allowed_and_the_ends_are_ends(rng):
    space = space_of(WORLD, r95, radius=0.25, max_r95=0.3)
    n = 120
    centre, normal = random_stations(rng, n)
    low, anchor, high = np.empty(n), np.empty(n), np.empty(n)
    margin = np.full(n, 0.02)
    corridor(centre, normal, np.zeros(n), margin, 0.4, 1.0, low, anchor, high, *space.kernel_args)
    assert (low <= anchor).all()
    assert (anchor <= high).all()
    assert (low >= np.minimum(-1.0, anchor)).all()
    assert (high <= np.maximum(1.0, anchor)).all()
    wide = np.flatnonzero(high - low > 1e-9)
    assert len(wide) > 60

    def is_allowed(i, offset, need):
        p = centre[i] + offset * normal[i]
        rate = cell_rate(p[0], p[1], space.rate, space.transform)
        return bool(np.isfinite(rate)) and space.clearance.distance([p])[0] >= need

    for i in wide:
        for share in np.linspace(0, 1, 23):
            # Searched in steps of 2 cm: a point between two good ones misses by less than 1 cm.
            assert is_allowed(i, low[i] + share * (high[i] - low[i]), space.need - 0.01)
        assert is_allowed(i, low[i], space.need)
        assert is_allowed(i, high[i], space.need)
        for end, beyond in ((low[i], low[i] - 0.045), (high[i], high[i] + 0.045)):
            if abs(end) < 0.999:
                between = [is_allowed(i, o, space.need + 0.02) for o in np.linspace(end, beyond, 46)]
                assert not all(between)


def test_a_start_in_the_wall_finds_the_nearer_side():
    space = space_of(WORLD, r95, radius=0.25)
    out = np.empty(1), np.empty(1), np.empty(1)
    # 0.1 m too close to the upper wall of the room at y = 3.
    centre, normal = np.array([[2.0, 2.85]]), np.array([[0.0, 1.0]])
    corridor(centre, normal, np.zeros(1), np.full(1, 0.01), 0.4, 1.0, *out, *space.kernel_args)
    assert -0.14 < out[1][0] < -0.10
    assert out[2][0] == out[1][0] or out[2][0] < -0.1


def test_chords_are_exact(rng):
    space = space_of(WORLD, r95, radius=0.25, max_r95=0.3)
    points = np.cumsum(rng.normal(size=(200, 2)) * 0.05, axis=0) + np.array([4.0, 1.2])
    sag = rng.uniform(0, 0.01, 199)
    cost, deficit = np.empty(199), np.empty(199)
    chord_costs(points, sag, cost, deficit, *space.kernel_args)
    real = np.abs(space.clearance.segment_distance(points[:-1], points[1:]))
    want = space.need + sag
    np.testing.assert_allclose(deficit, want - np.minimum(real, want), atol=1e-12)
    valid = np.isfinite(cost) & (deficit <= sag)
    assert valid.sum() > 10
    expected = space.motion_costs(points[:-1][valid], points[1:][valid])
    np.testing.assert_allclose(cost[valid], expected)
