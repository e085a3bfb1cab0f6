from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from maps.se2 import wrap


@given(st.floats(-1e6, 1e6))
def test_wrapping_keeps_the_direction_and_lies_in_the_range(angle):
    out = float(wrap(angle))
    assert -math.pi <= out < math.pi
    assert math.isclose(math.cos(out), math.cos(angle), abs_tol=1e-8)
    assert math.isclose(math.sin(out), math.sin(angle), abs_tol=1e-8)


@given(st.floats(-math.pi, math.pi, exclude_max=True))
def test_what_is_in_range_stays_bit_by_bit(angle):
    assert float(wrap(angle)) == angle


def test_both_ends():
    assert float(wrap(math.pi)) == -math.pi
    assert float(wrap(-math.pi)) == -math.pi
    assert -math.pi <= float(wrap(np.nextafter(-math.pi, -4))) < math.pi
    np.testing.assert_array_equal(wrap([[0.0], [2 * math.pi]]), [[0.0], [0.0]])
    assert math.isnan(float(wrap(math.nan)))
