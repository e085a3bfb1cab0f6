"""Landmarks as they are sent to a map."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from api.schemas_base import Finite, NotNegative, Request, angle_or_none
from maps.landmarks import MAX_LANDMARKS, LandmarkSet

_TurnRad = Annotated[float, Field(allow_inf_nan=False, ge=-2 * math.pi, le=2 * math.pi)]
_TurnDeg = Annotated[float, Field(allow_inf_nan=False, ge=-360, le=360)]


class LandmarkIn(Request):
    """A landmark in the map frame, as GET gives it; angles in rad or in degrees."""

    id: str = Field(min_length=1, max_length=200, examples=["A"])
    x_m: Finite = Field(examples=[0.5])
    y_m: Finite = Field(examples=[0.5])
    facing_rad: _TurnRad | None = Field(
        default=None, description="Azimuth of the outward normal; null: seen from all sides."
    )
    facing_deg: _TurnDeg | None = Field(default=None, description="The same in degrees; give at most one.")
    half_angle_rad: Annotated[float, Field(allow_inf_nan=False, gt=0, le=math.pi)] | None = Field(
        default=None, description="Largest angle off the normal under which it is seen; default π/2."
    )
    half_angle_deg: Annotated[float, Field(allow_inf_nan=False, gt=0, le=180)] | None = None
    sigma_m: NotNegative = Field(default=0.0, description="Standard deviation of the survey.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        angle_or_none("facing", self.facing_deg, self.facing_rad)
        angle_or_none("half_angle", self.half_angle_deg, self.half_angle_rad)
        return self


class LandmarksIn(Request):
    """All landmarks of a map's next version: those that are not in the list are gone."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "landmarks": [
                        {"id": "A", "x_m": 0.5, "y_m": 0.5},
                        {"id": "B", "x_m": 7.5, "y_m": 0.5, "facing_deg": 180.0, "half_angle_deg": 60.0},
                        {"id": "C", "x_m": 4.0, "y_m": 5.5, "sigma_m": 0.01},
                    ]
                }
            ]
        }
    )

    map: str | None = Field(
        default=None, max_length=200, description="As GET gives it: the version that was changed, or null."
    )
    landmarks: list[LandmarkIn] = Field(max_length=MAX_LANDMARKS)

    def to_landmarks(self) -> LandmarkSet:
        """The landmarks.

        Raises
        ------
        InvalidLandmark, DuplicateLandmark
            If a number is impossible, or two have one id or one place.
        """
        marks = self.landmarks
        if not marks:
            return LandmarkSet.empty()
        facing = [angle_or_none("facing", m.facing_deg, m.facing_rad) for m in marks]
        half = [angle_or_none("half_angle", m.half_angle_deg, m.half_angle_rad) for m in marks]
        return LandmarkSet(
            tuple(m.id for m in marks),
            np.array([(m.x_m, m.y_m) for m in marks]),
            np.array(facing, dtype=np.float64),  # None becomes NaN
            np.array(half, dtype=np.float64),
            np.array([m.sigma_m for m in marks]),
        )
