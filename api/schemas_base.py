"""What request bodies are made of: strict models, finite numbers, angles in one of two units."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]


class Request(BaseModel):
    """Base of all request bodies: what is not known is refused, nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def angle_or_none(name: str, deg: float | None, rad: float | None) -> float | None:
    """An angle given in degrees or in rad, as rad; None if it is not given.

    Raises
    ------
    ValueError
        If it is given in both.
    """
    if deg is not None and rad is not None:
        raise ValueError(f"give {name}_deg or {name}_rad, not both")
    return math.radians(deg) if deg is not None else rad


def angle(name: str, deg: float | None, rad: float | None) -> float:
    """An angle given in degrees or in rad, as rad.

    Raises
    ------
    ValueError
        If it is given in neither or in both.
    """
    value = angle_or_none(name, deg, rad)
    if value is None:
        raise ValueError(f"give {name}_deg or {name}_rad")
    return value
