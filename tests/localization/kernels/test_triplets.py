"""Largest triangle and branch and bound against enumeration."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from localization.kernels.triangles import largest_triangle
from localization.kernels.triplets import (
    comes_before,
    offer,
    sorted_three,
    strong_pairs,
    triplet_value,
)
from localization.sensors import CRITERIA, kernel_args
from tests import oracles
from tests.triplet_arrays import SENSORS, nearest_first, search


def largest(points):
    n = len(points)
    corners = np.empty(3, dtype=np.int64)
    x, y = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
    area, _ = largest_triangle(n, x, y, np.arange(n), np.empty(n + 1, np.int64), corners)
    again = np.empty(3, dtype=np.int64)
    start = np.random.default_rng(n).permutation(n)
    assert largest_triangle(n, x, y, start, np.empty(n + 1, np.int64), again)[0] == area
    assert again.tolist() == corners.tolist()
    return area, corners


def area_of(points, corners):
    a, b, c = points[list(corners)]
    return abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def clouds(rng):
    for n in (3, 4, 5, 8, 13, 20):
        yield rng.normal(size=(n, 2))
        angles = rng.uniform(0, 2 * math.pi, n)
        yield np.column_stack([np.cos(angles), np.sin(angles)])  # all on the hull
        yield rng.integers(0, 4, (n, 2)).astype(float)  # ties, repeated and collinear points
        t = rng.uniform(0, 1, n)
        yield np.column_stack([t, t**2 * 1e-4])  # nearly a line
        d = rng.uniform(-9, 9, (n, 2))
        yield d / (d**2).sum(axis=1, keepdims=True)  # inverted landmarks


def test_largest_triangle_is_that_of_enumeration(rng):
    for points in clouds(rng):
        want = max(area_of(points, c) for c in itertools.combinations(range(len(points)), 3))
        got, corners = largest(points)
        assert got == pytest.approx(want, rel=1e-9)
        if want > 0:
            assert corners[0] < corners[1] < corners[2]
            assert area_of(points, corners) == pytest.approx(want, rel=1e-9)
        else:
            assert corners.tolist() == [-1, -1, -1]


def test_points_on_a_line_have_no_triangle():
    for points in (np.zeros((4, 2)), np.array([[0.0, 0], [1, 1], [2, 2], [3, 3]]), np.zeros((3, 2))):
        area, corners = largest(points)
        assert area == 0.0
        assert corners.tolist() == [-1, -1, -1]


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("name", SENSORS)
def test_ranking_is_that_of_enumeration(rng, name, criterion):
    sensor = SENSORS[name]
    compared = 0
    for trial in range(10 if criterion == "area" else 4):
        n = 9
        heading = rng.uniform(-3, 3) if sensor.depends_on_heading else 0.0
        landmarks = rng.uniform(-8, 8, (n, 2)) if trial % 2 else on_walls(rng, n)
        point = rng.uniform(-3, 3, 2)
        sigmas = rng.choice([0.0, 0.02], n) if trial % 3 == 0 else np.zeros(n)
        want = oracles.ranked_triplets(point, landmarks, sigmas, sensor, heading, criterion)
        values, triplets = search(point, landmarks, sigmas, sensor, heading, 100, criterion=criterion)
        assert len(values) == len(want)
        # The best axis is found to a thousandth of its range; by area that is an error of second order.
        rel = 1e-7 if "optimal" not in name else 1e-5 if criterion == "area" else 2e-3
        np.testing.assert_allclose(1.0 / values, [d for d, _ in want], rtol=rel)
        assert len({tuple(t) for t in triplets.tolist()}) == len(want)
        compared += len(want)
        best, _ = search(point, landmarks, sigmas, sensor, heading, 1, criterion=criterion)
        np.testing.assert_array_equal(best, values[:1])
        few, which = search(point, landmarks, sigmas, sensor, heading, 5, criterion=criterion)
        np.testing.assert_array_equal(few, values[:5])
        np.testing.assert_array_equal(which, triplets[:5])
    assert compared > 3


def on_walls(rng, n):
    t, wall = rng.uniform(-8, 8, n), rng.integers(0, 4, n)
    eight = np.full(n, 8.0)
    return np.column_stack([np.choose(wall, [t, eight, t, -eight]), np.choose(wall, [-eight, t, eight, t])])


@pytest.mark.parametrize("name", SENSORS)
def test_a_known_value_changes_nothing(rng, name):
    sensor = SENSORS[name]
    for _ in range(10):
        landmarks, point = rng.uniform(-8, 8, (14, 2)), rng.uniform(-3, 3, 2)
        values, triplets = search(point, landmarks, np.zeros(14), sensor)
        for share in (1.0, 0.999, 0.5, 1e-3):
            if len(values):
                again = search(point, landmarks, np.zeros(14), sensor, known=share * values[0])
                np.testing.assert_array_equal(again[0], values)
                np.testing.assert_array_equal(again[1], triplets)


def test_of_equal_triplets_the_smallest_indices_win():
    # Seen from the middle of a square, all four triplets are equal.
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    values, triplets = search((0.0, 0.0), square, np.zeros(4), SENSORS["laser"], count=4)
    assert len(set(values.tolist())) == 1
    assert triplets.tolist() == [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]


def test_triplet_that_just_fits_is_taken():
    # MAS97's field of view is that of (-1, 2) and (1, 2) from the origin.
    sensor = SENSORS["mas97"]
    just = np.array([[-1.0, 2.0], [0.0, 3.0], [1.0, 2.0]])
    assert len(search((0.0, 0.0), just, np.zeros(3), sensor)[0]) == 1
    just[2, 0] = 1.0001
    assert len(search((0.0, 0.0), just, np.zeros(3), sensor)[0]) == 0


def test_wide_view_does_not_take_a_triplet_all_around():
    # 120° apart: every pair is within 149°, all three are not.
    angles = np.array([0.0, 2.0, 4.1])
    around = 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    around[1] *= 1.3
    for name in ("wide", "wide optimal"):
        assert len(search((0.0, 0.0), around, np.zeros(3), SENSORS[name])[0]) == 0
    assert len(search((0.0, 0.0), around, np.zeros(3), SENSORS["laser"])[0]) == 1


def test_value_of_a_degenerate_triplet():
    angles = np.array([0.1, 1.0, 2.0])
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    _, *arrays = nearest_first(np.array([math.cos(4.0), math.sin(4.0)]), circle, np.zeros(3))
    for name in ("laser", "mas97", "limited", "wide optimal"):
        assert triplet_value(0, 1, 2, *arrays, kernel_args(SENSORS[name])) == -1.0


def test_strong_pairs_counts_those_that_could_matter(rng):
    sensor = SENSORS["mas97"]
    landmarks, point = rng.uniform(-8, 8, (20, 2)), rng.uniform(-3, 3, 2)
    _, _, _, rho, _, survey = nearest_first(point, landmarks, np.zeros(20))
    args = kernel_args(sensor)
    values, _ = search(point, landmarks, np.zeros(20), sensor)
    need = math.sqrt(3 * values[0]) * args[1] * math.cos(args[2] / 2) ** 4 / (2 * math.sin(args[2] / 2))
    want = sum(rho[i] * rho[j] >= need for i in range(20) for j in range(i + 1, 20))
    assert strong_pairs(20, rho, survey, args, values[0]) == want
    assert strong_pairs(20, rho, survey, args, 0.0) == 190


def test_sorted_three_and_comes_before():
    for p in itertools.permutations((2, 5, 9)):
        assert sorted_three(*p) == (2, 5, 9)
    assert comes_before(1, 2, 3, np.array([1, 2, 4]))
    assert comes_before(1, 2, 3, np.array([1, 3, 0]))
    assert comes_before(0, 9, 9, np.array([1, 0, 0]))
    assert not comes_before(1, 2, 3, np.array([1, 2, 3]))


def test_offer_keeps_the_best_in_order(rng):
    offers = [(float(v), *sorted(rng.choice(9, 3, replace=False).tolist())) for v in rng.integers(0, 6, 40)]
    values, triplets = np.empty(7), np.empty((7, 3), dtype=np.int64)
    found = 0
    for o in offers:
        found = offer(*o, values, triplets, found)
    want = sorted(offers, key=lambda o: (-o[0], *o[1:]))[:7]
    assert found == 7
    assert [(v, *t) for v, t in zip(values, triplets.tolist(), strict=True)] == want
