"""Cost of a path moved sideways: equal to the plain sum, with the slope and matrix of that sum."""

from __future__ import annotations

import itertools
import math

import numpy as np

from planner.kernels.line_cost import motion_rate_cost
from planner.kernels.offsets import (
    path_cost,
    place,
    quadratic_model,
    rate_along_normals,
    relax,
    smooth_rate,
    turns,
)
from tests.oracles import bending_cost, blended_rate

TRANSFORM = np.array([2.0, -1.0, math.cos(0.4), math.sin(0.4), 0.5])


def to_world(gx, gy):
    c, s = TRANSFORM[2], TRANSFORM[3]
    x, y = gx * TRANSFORM[4], gy * TRANSFORM[4]
    return TRANSFORM[0] + c * x - s * y, TRANSFORM[1] + s * x + c * y


def test_rate_between_centres(rng):
    rate = rng.uniform(1, 3, (5, 6))
    rate[rng.random((5, 6)) < 0.3] = np.inf
    for _ in range(200):
        gx, gy = rng.uniform(-0.4, 6.4), rng.uniform(-0.4, 5.4)
        expected = blended_rate(gx, gy, rate.tolist())
        got = smooth_rate(*to_world(gx, gy), rate, TRANSFORM)
        assert got == expected or abs(got - expected) < 1e-5
    assert math.isinf(smooth_rate(*to_world(-5, 2), rate, TRANSFORM))


def test_slope_and_curvature_along_normals_of_a_parabola():
    rows, cols = np.mgrid[:60, :60]
    x = (cols + 0.5) * 0.02
    rate = 1 + 0.3 * x + 2.0 * x**2 + 0.0 * rows
    transform = np.array([0.0, 0.0, 1.0, 0.0, 0.02])
    out = np.empty((1, 3))
    centre, normal = np.array([[0.5, 0.6]]), np.array([[1.0, 0.0]])
    rate_along_normals(centre, normal, np.array([0.1]), 0.1, out, rate, transform)
    np.testing.assert_allclose(out[0], [1 + 0.18 + 0.72, 0.3 + 2.4, 4.0], rtol=1e-3)
    rate_along_normals(centre, normal, np.array([0.1]), 0.1, out, 5.0 - rate, transform)
    assert out[0, 2] == 0.0


def some_path(rng, n):
    x = np.arange(n) * 0.25
    centre = np.column_stack([x, 0.3 * np.sin(x)])
    normal = np.column_stack([-0.3 * np.cos(x), np.ones(n)])
    normal /= np.hypot(*normal.T)[:, None]
    return centre, normal, rng.normal(size=n) * 0.05


def cost_of(centre, normal, offset, rates, bend, twist):
    n = len(offset)
    points, chord, kappa = np.empty((n, 2)), np.empty(n - 1), np.empty(n)
    place(centre, normal, offset, points)
    turns(points, chord, kappa)
    return path_cost(chord, kappa, rates, bend, twist, 0.25), points, chord, kappa


def test_cost_is_the_plain_sum(rng):
    for n in (3, 4, 12):
        centre, normal, offset = some_path(rng, n)
        rates = rng.uniform(1, 2, (n, 3))
        cost, points, _, _ = cost_of(centre, normal, offset, rates, 0.7, 0.3)
        assert abs(cost - bending_cost(points.tolist(), rates[:, 0].tolist(), 0.7, 0.3, 0.25)) < 1e-9


def model(centre, normal, offset, rates, bend, twist):
    n = len(offset)
    _, points, chord, kappa = cost_of(centre, normal, offset, rates, bend, twist)
    slope, band, rows = np.empty(n), np.empty((n, 4)), np.empty((n, 4))
    quadratic_model(points, normal, chord, kappa, rates, bend, twist, 0.25, slope, band, rows)
    full = np.zeros((n, n))
    for k in range(4):
        for i in range(n - k):
            full[i, i + k] = full[i + k, i] = band[i, k]
    return slope, full


def test_slope_is_that_of_the_cost(rng):
    # Lengths inside κ are held fixed by the model, so small offsets from an even line.
    n = 14
    centre, normal, offset = some_path(rng, n)
    offset *= 0.02
    rates = np.column_stack([rng.uniform(1, 2, n), rng.normal(size=n), np.zeros(n)])
    slope, _ = model(centre, normal, offset, rates, 0.0, 0.0)

    def at(o):
        moved = rates.copy()
        moved[:, 0] += rates[:, 1] * (o - offset)
        return cost_of(centre, normal, o, moved, 0.0, 0.0)[0]

    h = 1e-6
    central = [(at(offset + h * e) - at(offset - h * e)) / (2 * h) for e in np.eye(n)]
    np.testing.assert_allclose(slope, central, rtol=1e-6, atol=1e-8)


def test_bending_terms_on_an_even_straight_line(rng):
    # On a straight line with even stations κ is linear in the offsets: slope and matrix are exact there.
    n, step = 12, 0.25
    centre = np.column_stack([np.arange(n) * step, np.zeros(n)])
    normal = np.tile([0.0, 1.0], (n, 1))
    rates = np.zeros((n, 3))
    second = np.zeros((n, n))
    for i in range(1, n - 1):
        second[i, i - 1 : i + 2] = np.array([1.0, -2.0, 1.0]) / step**2
    change = np.diff(second, axis=0)
    expected = 2 * 0.8 * step * second.T @ second + 2 * 0.2 / step * change.T @ change
    slope, full = model(centre, normal, np.zeros(n), rates, 0.8, 0.2)
    np.testing.assert_allclose(full, expected, atol=1e-9)
    np.testing.assert_allclose(slope, 0.0, atol=1e-12)
    offset = 1e-5 * rng.normal(size=n)
    slope, _ = model(centre, normal, offset, rates, 0.8, 0.2)
    np.testing.assert_allclose(slope, expected @ offset, rtol=1e-4, atol=1e-9)


def test_matrix_is_positive_semidefinite(rng):
    for _ in range(10):
        centre, normal, offset = some_path(rng, 15)
        rates = rng.uniform(0, 2, (15, 3))
        _, full = model(centre, normal, offset * 3, rates, 0.5, 0.2)
        assert np.linalg.eigvalsh(full).min() > -1e-9


def exact_cost(points, rate, bend, twist):
    """Cells' exact cost plus the bending of the plain sum, which without rates is bending alone."""
    cells = sum(motion_rate_cost(*a, *b, rate, TRANSFORM) for a, b in itertools.pairwise(points))
    return cells + bending_cost(points.tolist(), [0.0] * len(points), bend, twist, 0.25)


def test_relaxing_saves_what_it_says_and_stays_inside(rng):
    rate = rng.uniform(1, 3, (12, 20))
    for half in (1, 3):
        n = 24
        gx = np.linspace(1, 18, n)
        centre = np.array([to_world(x, 5 + np.sin(0.3 * x)) for x in gx])
        tangent = np.gradient(centre, axis=0)
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.hypot(*tangent.T)[:, None]
        low, high = -rng.uniform(0, 0.5, n), rng.uniform(0, 0.5, n)
        low[[0, -1]] = high[[0, -1]] = 0.0
        offset, points = np.zeros(n), np.empty((n, 2))
        place(centre, normal, offset, points)
        before = exact_cost(points, rate, 0.05, 0.01)
        shifts = np.array([0.1, -0.1, 0.02, -0.02])
        saved = relax(
            centre, normal, low, high, shifts, half, 0.05, 0.01, 0.25, offset, points, rate, TRANSFORM
        )
        after = exact_cost(points, rate, 0.05, 0.01)
        assert saved > 0
        assert abs(before - after - saved) < 1e-9
        assert ((low <= offset) & (offset <= high)).all()
        again = np.empty((n, 2))
        place(centre, normal, offset, again)
        np.testing.assert_allclose(points, again, atol=1e-15)
