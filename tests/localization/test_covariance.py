"""Ellipses and what is read off them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization import covariance as cov


def random_covariances(rng, n):
    a = rng.normal(size=(n, 2, 2)) * 10.0 ** rng.uniform(-4, 1, (n, 1, 1))
    m = a @ np.swapaxes(a, 1, 2)
    return m, np.stack([m[:, 0, 0], m[:, 0, 1], m[:, 1, 1]], -1)


def test_figures_agree_with_eigenvalues(rng):
    matrices, triples = random_covariances(rng, 200)
    values = np.linalg.eigvalsh(matrices)
    k2 = cov.CHI2_95
    np.testing.assert_allclose(
        cov.area95(triples), math.pi * k2 * np.sqrt(values[:, 0] * values[:, 1]), rtol=1e-6
    )
    np.testing.assert_allclose(cov.max_eigenvalue(triples), values[:, 1], rtol=1e-12)
    ellipse = cov.ellipse95(triples)
    np.testing.assert_allclose(ellipse[:, 0], np.sqrt(k2 * values[:, 1]), rtol=1e-9)
    np.testing.assert_allclose(ellipse[:, 1], np.sqrt(k2 * values[:, 0]), rtol=1e-5)
    np.testing.assert_allclose(math.pi * ellipse[:, 0] * ellipse[:, 1], cov.area95(triples), rtol=1e-9)
    np.testing.assert_array_equal(cov.as_matrix(triples), matrices * [[1, 1], [1, 1]])


def test_direction_is_that_of_the_long_axis(rng):
    matrices, triples = random_covariances(rng, 50)
    direction = cov.ellipse95(triples)[:, 2]
    u = np.stack([np.cos(direction), np.sin(direction)], -1)
    along = np.einsum("ni,nij,nj->n", u, matrices, u)
    np.testing.assert_allclose(along, cov.max_eigenvalue(triples), rtol=1e-9)


def test_r95_is_the_radius_of_the_circle_of_equal_area():
    assert cov.r95([0.01, 0.0, 0.01]) == pytest.approx(0.1 * math.sqrt(cov.CHI2_95))
    assert math.pi * cov.r95([4.0, 1.0, 2.0]) ** 2 == pytest.approx(float(cov.area95([4.0, 1.0, 2.0])))


def test_no_fix_stays_no_fix():
    nan = [math.nan] * 3
    assert np.isnan(cov.area95(nan))
    assert np.isnan(cov.r95(nan))
    assert np.isnan(cov.ellipse95([nan, [1.0, 0.0, 1.0]])[0]).all()


def test_nearly_flat_ellipse_keeps_its_thin_axis():
    # One direction a million times better known than the other, turned by 30°.
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    big, small = 1.0, 1e-12
    xx, xy, yy = c * c * big + s * s * small, c * s * (big - small), s * s * big + c * c * small
    a, b, direction = cov.ellipse95([xx, xy, yy])
    assert a == pytest.approx(math.sqrt(cov.CHI2_95))
    assert b == pytest.approx(math.sqrt(cov.CHI2_95 * small), rel=1e-3)
    assert direction == pytest.approx(math.pi / 6)


def test_ellipse_holds_95_percent(rng):
    covariance = np.array([0.4, -0.3, 0.5])
    errors = rng.multivariate_normal([0, 0], cov.as_matrix(covariance), 20_000)
    inside = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(cov.as_matrix(covariance)), errors) <= cov.CHI2_95
    assert np.mean(inside) == pytest.approx(0.95, abs=0.005)


IMPOSSIBLE = ([1.0, 2.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, -1e-3], [0.0, 1.0, 0.0])


@pytest.mark.parametrize("covariance", IMPOSSIBLE)
def test_what_is_no_covariance_has_no_ellipse(covariance):
    assert np.linalg.eigvalsh(cov.as_matrix(covariance))[0] < 0
    for value in (cov.area95, cov.r95, cov.max_eigenvalue):
        assert np.isnan(value(covariance))
    assert np.isnan(cov.ellipse95(covariance)).all()
    both = cov.ellipse95([covariance, [1.0, 0.0, 1.0]])
    assert np.isfinite(both[1]).all()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e6])
def test_rounding_does_not_make_a_covariance_impossible(scale, rng):
    # Flat ellipses in every direction: the determinant is zero up to rounding, on either side.
    angle = rng.uniform(0, math.pi, 1000)
    flat = scale * np.stack([np.cos(angle) ** 2, np.cos(angle) * np.sin(angle), np.sin(angle) ** 2], -1)
    for dtype in (np.float64, np.float32):
        c = flat.astype(dtype)
        assert (cov.area95(c) >= 0).all()
        np.testing.assert_allclose(cov.max_eigenvalue(c), scale, rtol=1e-6)
        assert np.isfinite(cov.ellipse95(c)).all()
    assert cov.area95([0.0, 0.0, 0.0]) == 0.0
    assert cov.area95([math.inf, 0.0, math.inf]) == math.inf
