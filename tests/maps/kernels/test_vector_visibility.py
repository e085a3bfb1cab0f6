"""Sight past edges on coarse lattices, where grazes, pinches and shared corners are the rule."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from maps.kernels.vector_scan import scan_landmark
from maps.kernels.vector_sectors import direction_order, find_sectors, gather_edges, is_nearer
from maps.kernels.vector_visibility import (
    in_cone,
    in_range,
    in_sight,
    see_points,
    stand_clear,
    strictly_inside,
)
from tests.oracles import nearest_edge_all_around, sight_past_edges

SIDE = 11
ALL_AROUND = np.array([1, 0, 1, 0])
TURN = 2.0 * math.pi


def area_with_obstacles(rng, n=6):
    """A room with boxes and triangles whose corners are integers, and its edges."""
    area = shapely.box(0, 0, SIDE, SIDE)
    for _ in range(n):
        if rng.random() < 0.6:
            x, y = rng.integers(0, SIDE - 1, 2)
            w, h = rng.integers(1, 4, 2)
            shape = shapely.box(x, y, x + w, y + h)
        else:
            corners = rng.integers(0, SIDE + 1, (3, 2))
            shape = shapely.Polygon(corners)
            if shape.area == 0 or shape.area > 12:
                continue
        area = shapely.difference(area, shape, grid_size=1.0)
    rings = shapely.get_rings(shapely.get_parts(area))
    coordinates = [shapely.get_coordinates(r).astype(np.int64) for r in rings]
    edges = np.concatenate([np.concatenate([c[:-1], c[1:]], axis=1) for c in coordinates])
    return area, np.ascontiguousarray(edges)


def inner_points(edges):
    grid = [(x, y) for x in range(SIDE + 1) for y in range(SIDE + 1)]
    return [p for p in grid if strictly_inside(edges, *p)]


def scanned(edges, landmark, cone=ALL_AROUND, span=TURN, max_range=math.inf):
    """Cells seen on a grid whose centres are the lattice points, as a boolean array [y, x]."""
    frame = np.array([-0.5, -0.5, 1.0, 0.0, 1.0])
    unit = np.array([0.0, 0.0, 1.0])
    extent = np.array([SIDE, SIDE])
    high2 = (max_range + 1e-9) ** 2
    n = SIDE + 1
    x, y = landmark
    runs = scan_landmark(
        edges, extent, x, y, cone, span, float(x), float(y), max_range, high2, frame, unit, 0, n, n
    )
    out = np.zeros((n, n), dtype=int)
    for row, first, stop in runs:
        out[row, first:stop] += 1
    assert out.max(initial=0) <= 1
    return out.astype(bool)


def test_inside_as_shapely_says(rng):
    for _ in range(8):
        area, edges = area_with_obstacles(rng)
        for x in range(-1, SIDE + 2):
            for y in range(-1, SIDE + 2):
                assert strictly_inside(edges, x, y) == area.contains(shapely.Point(x, y))


def test_sight_and_scan_against_fractions(rng):
    seen = {True: 0, False: 0}
    for _ in range(12):
        _, edges = area_with_obstacles(rng)
        places = inner_points(edges)
        if not places:
            continue
        for k in rng.integers(0, len(places), 2):
            lx, ly = places[k]
            cells = scanned(edges, (lx, ly))
            for px, py in places:
                expected = sight_past_edges(edges.tolist(), (lx, ly), (px, py))
                assert in_sight(edges, lx, ly, px, py, True, True) == expected
                assert in_sight(edges, px, py, lx, ly, True, True) == expected
                assert cells[py, px] == (expected and (lx, ly) != (px, py))
                seen[expected] += 1
    assert min(seen.values()) > 100


def test_cones_and_ranges_cut_scan_and_points_alike(rng):
    some = 0
    for _ in range(10):
        _, edges = area_with_obstacles(rng, n=3)
        places = inner_points(edges)
        if not places:
            continue
        landmark = places[rng.integers(len(places))]
        sx, sy, ex, ey = 0, 0, 0, 0
        while (sx, sy) == (0, 0) or (ex, ey) == (0, 0) or (sx * ey == sy * ex and sx * ex + sy * ey > 0):
            sx, sy, ex, ey = (int(v) for v in rng.integers(-2, 3, 4))
        span = math.atan2(sx * ey - sy * ex, sx * ex + sy * ey) % TURN
        max_range = float(rng.choice([3.0, 5.0, math.inf]))
        cone = np.array([sx, sy, ex, ey])
        cells = scanned(edges, landmark, cone, span, max_range)
        points = np.array(places)
        out = np.zeros((len(points), 1), dtype=np.bool_)
        see_points(
            edges,
            np.array([landmark]),
            np.array([landmark], dtype=float),
            np.zeros(1, dtype=np.bool_),
            cone[None, :],
            np.array([span]),
            points,
            points.astype(float),
            (max_range + 1e-9) ** 2,
            out,
        )
        for (px, py), visible in zip(places, out[:, 0], strict=True):
            assert cells[py, px] == visible
            dx, dy = px - landmark[0], py - landmark[1]
            turn = (math.atan2(dy, dx) - math.atan2(sy, sx)) % TURN
            if abs(turn - span) > 1e-9 and 1e-9 < turn < TURN - 1e-9 and (dx, dy) != (0, 0):
                near = math.hypot(dx, dy) <= max_range
                sight = sight_past_edges(edges.tolist(), landmark, (px, py))
                assert visible == (near and turn < span and sight)
                some += visible
    assert some > 20


@pytest.mark.parametrize(
    ("walls", "place", "visible"),
    [
        ([(4, 0, 6, 2)], (8, 2), True),  # along the top of a box
        ([(4, 2, 6, 4)], (8, 2), True),  # along its bottom
        ([(4, 0, 6, 2), (4, 2, 6, 4)], (8, 2), False),  # between two boxes that touch
        ([(4, 0, 5, 2), (6, 2, 7, 4)], (8, 2), False),  # touched on the right, then on the left
        ([(4, 0, 5, 2), (5, 2, 6, 4)], (8, 2), False),  # boxes that meet in one corner
        ([(4, 0, 5, 2), (6, 0, 7, 2)], (8, 2), True),  # touched twice on one side
        ([(4, 1, 6, 3)], (8, 2), False),  # through a box
    ],
)
def test_grazing_is_visible_and_pinching_is_not(walls, place, visible):
    area = shapely.difference(shapely.box(0, 0, 10, 10), shapely.union_all([shapely.box(*w) for w in walls]))
    rings = shapely.get_rings(shapely.get_parts(area))
    coordinates = [shapely.get_coordinates(r).astype(np.int64) for r in rings]
    edges = np.concatenate([np.concatenate([c[:-1], c[1:]], axis=1) for c in coordinates])
    assert in_sight(edges, 1, 2, *place, True, True) == visible
    assert scanned(edges, (1, 2))[place[1], place[0]] == visible
    assert sight_past_edges(edges.tolist(), (1, 2), place) == visible


def test_sectors_name_the_nearest_edge(rng):
    for _ in range(10):
        _, edges = area_with_obstacles(rng)
        places = inner_points(edges)
        if not places:
            continue
        x, y = places[rng.integers(len(places))]
        near = np.empty((len(edges) + 4, 4), dtype=np.int64)
        n = gather_edges(edges, x, y, math.inf, SIDE + 8, near)
        directions, ids = find_sectors(near, n, 1, 0, 1, 0, TURN)
        assert ids[-1] == -1
        assert (ids[:-1] >= 0).all()
        for k in range(len(ids) - 1):
            (ax, ay), (bx, by) = directions[k].tolist(), directions[k + 1].tolist()
            assert ax * by - ay * bx > 0
            # A direction strictly between the two.
            middle = (ax * 3 + bx, ay * 3 + by)
            assert ids[k] == nearest_edge_all_around(near[:n].tolist(), middle)
        ends = np.arctan2(directions[1:, 1], directions[1:, 0]) - np.arctan2(
            directions[:-1, 1], directions[:-1, 0]
        )
        assert (ends % TURN).sum() == pytest.approx(TURN)


def test_edges_out_of_reach_are_left_out():
    edges = np.array([[10, -5, 10, 5], [-30, -5, -30, 5]])
    near = np.empty((6, 4), dtype=np.int64)
    assert gather_edges(edges, 0, 0, 12.0, 100, near) == 5
    assert near[0].tolist() == [10, -5, 10, 5]
    assert gather_edges(edges, 0, 0, 40.0, 100, near) == 6
    assert near[1].tolist() == [-30, 5, -30, -5]


def test_directions_too_close_for_angles():
    x, y = 1 << 28, (1 << 28) - 1
    a, b = math.atan2(y, x), math.atan2(y - 1, x - 1)
    assert abs(a - b) < 1e-9
    assert direction_order(a, x, y, b, x - 1, y - 1) == 1
    assert direction_order(b, x - 1, y - 1, a, x, y) == -1
    assert direction_order(a, x, y, a, 2 * x, 2 * y) == 0
    assert direction_order(0.0, 1, 0, TURN, 1, 0) == -1


def test_nearer_of_two_edges_is_a_matter_of_sides():
    near = np.array([[2, -1, 2, 1], [4, -4, 4, 4], [4, 4, 2, 1], [3, -9, 9, 9]])
    assert is_nearer(near, 0, 1)
    assert not is_nearer(near, 1, 0)
    assert is_nearer(near, 0, 3)
    assert not is_nearer(near, 3, 0)
    # The same edge twice: the first one counts.
    twice = np.array([[2, -1, 2, 1], [2, -1, 2, 1]])
    assert is_nearer(twice, 0, 1)
    assert not is_nearer(twice, 1, 0)


@pytest.mark.parametrize(
    ("cone", "span", "inside", "outside"),
    [
        ((1, 0, 0, 1), math.pi / 2, [(1, 0), (1, 1), (0, 3)], [(-1, 0), (1, -1), (-1, 1)]),
        ((1, 0, -1, 0), math.pi, [(1, 0), (0, 1), (-2, 0)], [(0, -1), (1, -1)]),
        ((1, 0, 0, -1), 1.5 * math.pi, [(1, 0), (-1, -1), (0, -1), (-1, 3)], [(1, -1)]),
        ((1, 0, 1, 0), TURN, [(1, 0), (-1, 0), (0, -1)], []),
    ],
)
def test_cones_are_closed(cone, span, inside, outside):
    assert all(in_cone(*d, *cone, span) for d in inside)
    assert not any(in_cone(*d, *cone, span) for d in outside)


def test_a_place_is_in_range_up_to_the_rim_but_not_at_the_landmark():
    assert in_range(3.0, 4.0, 25.0)
    assert not in_range(3.0, 4.1, 25.0)
    assert not in_range(0.0, 0.0, 25.0)
    assert in_range(1e6, 0.0, math.inf)


class TestStandClear:
    EDGES = np.array(
        [
            [0, 0, 100000, 0], [100000, 0, 100000, 100000], [100000, 100000, 0, 100000], [0, 100000, 0, 0],
            [40000, 40000, 40000, 60000], [40000, 60000, 60000, 60000],
            [60000, 60000, 60000, 40000], [60000, 40000, 40000, 40000],
        ]
    )  # fmt: skip

    def moved(self, place, normal=(0.0, 0.0), reach=5000.0):
        out, buried = np.zeros((1, 2), dtype=np.int64), np.zeros(1, dtype=np.bool_)
        stand_clear(self.EDGES, np.array([place], dtype=float), np.array([normal]), reach, 8.0, out, buried)
        return None if buried[0] else tuple(out[0].tolist())

    def test_in_the_open_nothing_moves(self):
        assert self.moved((20000.2, 30000.4)) == (20000, 30000)

    def test_along_the_normal(self):
        assert self.moved((50000, 60000), (0.0, 1.0)) == (50000, 60008)
        assert self.moved((50000, 59000), (0.0, 1.0)) == (50000, 60008)
        assert self.moved((0, 500), (1.0, 0.0)) == (8, 500)
        assert self.moved((-300, 500), (1.0, 0.0)) == (8, 500)

    def test_a_flat_angle_gets_clear_too(self):
        x, y = self.moved((50000, 60000), (math.cos(0.02), math.sin(0.02)))
        assert 50000 < x < 50600
        assert y > 60000

    def test_to_the_nearest_side_without_a_normal(self):
        assert self.moved((50000, 60000)) == (50000, 60008)
        assert self.moved((41000, 50000)) == (39992, 50000)
        assert self.moved((100000, 5)) == (99992, 5)

    def test_corners(self):
        for corner in ((40000, 40000), (0, 0), (100000, 100000)):
            x, y = self.moved(corner)
            assert strictly_inside(self.EDGES, x, y)
            assert math.hypot(x - corner[0], y - corner[1]) < 40

    def test_a_normal_into_the_wall_falls_back_to_the_nearest_side(self):
        assert self.moved((50000, 60000), (0.0, -1.0)) == (50000, 60008)

    def test_too_deep(self):
        assert self.moved((50000, 50000)) is None
        assert self.moved((50000, 50000), (0.0, 1.0)) is None
        assert self.moved((-6000, 500), (1.0, 0.0)) is None
