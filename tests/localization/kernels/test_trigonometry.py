"""Polynomials against the standard library."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.kernels.trigonometry import MAX_ANGLE, arc_tangent, sine_cosine, wrap_angle


def angles(rng):
    corners = [k * math.pi / 4 + d for k in range(-9, 10) for d in (-1e-15, -1e-9, 0.0, 1e-9, 1e-15)]
    return [*corners, *rng.uniform(-10, 10, 500), 1e-300, -1e-300]


def test_sine_and_cosine(rng):
    for x in angles(rng):
        sine, cosine = sine_cosine(x)
        assert sine == pytest.approx(math.sin(x), abs=5e-16)
        assert cosine == pytest.approx(math.cos(x), abs=5e-16)


def test_sine_and_cosine_after_many_turns(rng):
    for x in rng.uniform(-MAX_ANGLE, MAX_ANGLE, 500):
        sine, cosine = sine_cosine(x)
        assert sine == pytest.approx(math.sin(x), abs=2e-15)
        assert cosine == pytest.approx(math.cos(x), abs=2e-15)


def test_sine_of_small_angles_is_relative():
    for x in (1e-3, -1e-6, 1e-12, 1e-100):
        assert sine_cosine(x)[0] == pytest.approx(math.sin(x), rel=4e-16)


def test_arc_tangent(rng):
    for a in angles(rng):
        for r in (1e-100, 1.0, 1e9):
            y, x = r * math.sin(a), r * math.cos(a)
            assert arc_tangent(y, x) == pytest.approx(math.atan2(y, x), abs=9e-16)
    for y, x in [(0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (1.0, 1.0), (-1.0, -1.0)]:
        assert arc_tangent(y, x) == pytest.approx(math.atan2(y, x), abs=5e-16)


def test_wrapped_angles_lie_in_the_half_open_interval(rng):
    for a in [*angles(rng), math.pi, -math.pi, np.nextafter(math.pi, 0), np.nextafter(-math.pi, -4)]:
        out = wrap_angle(a)
        assert -math.pi <= out < math.pi
        assert math.remainder(out - a, 2 * math.pi) == pytest.approx(0.0, abs=4e-15)
    assert wrap_angle(math.pi) == -math.pi
