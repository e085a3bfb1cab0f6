"""Numbers from callers: arrays of floats, or an error of the package that names what was given."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from localization.errors import InvalidMeasurement, LocalizationError
from maps.arrays import FloatArray


def as_numbers(
    values: npt.ArrayLike, name: str, error: type[LocalizationError] = InvalidMeasurement
) -> FloatArray:
    """Array of float64 of what a caller gave.

    Raises
    ------
    LocalizationError
        Of the given kind, if that is no rectangular array of numbers.
    """
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise error(f"{name}: {repr(values)[:60]} holds something other than numbers.") from None


def is_number(value: Any) -> bool:
    """Whether a value is a real number: no text, no truth value, no array."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def as_place(point: npt.ArrayLike, name: str = "Point") -> FloatArray:
    """Two finite coordinates, shape (2,), m.

    Raises
    ------
    LocalizationError
        If they are not.
    """
    place = as_numbers(point, name, LocalizationError)
    if place.shape != (2,) or not np.isfinite(place).all():
        raise LocalizationError(f"{name} is {point!r}; it must be two finite numbers, m.")
    return place


def as_heading(heading: float) -> float:
    """A finite heading, rad.

    Raises
    ------
    LocalizationError
        If it is not.
    """
    if not is_number(heading) or not math.isfinite(heading):
        raise LocalizationError(f"Heading is {heading!r}; it must be finite, rad.")
    return float(heading)
