"""Angles and planar poses; batch axes first."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray


def wrap(angle: npt.ArrayLike) -> FloatArray:
    """Angles wrapped to [-π, π), rad.

    Examples
    --------
    >>> float(wrap(4.0)) == 4.0 - 2 * math.pi
    True
    """
    a = np.asarray(angle, dtype=np.float64)
    out = a - 2 * math.pi * np.floor((a + math.pi) / (2 * math.pi))
    # Rounding can leave the range by a hair at either end; what is in range stays as it is.
    out = np.where((out >= math.pi) | (out < -math.pi), -math.pi, out)
    return np.asarray(np.where((a >= -math.pi) & (a < math.pi), a, out))
