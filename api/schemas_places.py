"""Bodies of questions about one place of a map."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from api.schemas import FieldId, MapId, clamped_deadline
from api.schemas_base import Finite, Positive, Request, angle_or_none
from api.schemas_sensor import SensorOrPreset, to_sensor
from localization.sensors import Sensor

#: Deadline of a question that names none, s.
DEFAULT_DEADLINE_S = 5.0
LandmarkId = Annotated[str, Field(min_length=1, max_length=200)]
Three = Annotated[list[LandmarkId], Field(min_length=3, max_length=3)]
_TURN = 2 * math.pi


class PoseAtIn(Request):
    """Where the robot is, and its heading."""

    x_m: Finite = Field(examples=[30.0])
    y_m: Finite = Field(examples=[20.0])
    theta_rad: Annotated[float, Field(allow_inf_nan=False, ge=-_TURN, le=_TURN)] | None = Field(
        default=None, description="Heading, rad; default: that of the field, else 0."
    )
    theta_deg: Annotated[float, Field(allow_inf_nan=False, ge=-360, le=360)] | None = Field(
        default=None, description="The same in degrees; give at most one."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        angle_or_none("theta", self.theta_deg, self.theta_rad)
        return self

    @property
    def heading(self) -> float | None:
        """rad; None: not given."""
        return angle_or_none("theta", self.theta_deg, self.theta_rad)


class WhereIn(Request):
    """What questions about a place stand on: a field, or a map and a sensor."""

    field: FieldId | None = Field(default=None, description="Takes map, sensor, heading and method from it.")
    map: MapId | None = Field(default=None, description="Without a field: the map, and a sensor with it.")
    sensor: SensorOrPreset | None = None
    deadline_s: Positive | None = Field(
        default=None,
        description="Time for the answer, s (default 5, at least 0.05, at most 30; clamped).",
    )

    @model_validator(mode="after")
    def _check_where(self) -> Self:
        if (self.field is None) == (self.map is None):
            raise ValueError("give field or map, exactly one")
        if (self.map is None) != (self.sensor is None):
            raise ValueError("give a sensor with a map, and none with a field")
        return self

    def to_sensor(self) -> Sensor | None:
        """The sensor; None: the field's."""
        return None if self.sensor is None else to_sensor(self.sensor)

    def deadline(self, ceiling: float) -> float:
        """Seconds for the answer."""
        return clamped_deadline(self.deadline_s, DEFAULT_DEADLINE_S, ceiling)[0]


_AT: dict[str, Any] = {"map": "warehouse", "sensor": "laser", "pose": {"x_m": 30.0, "y_m": 20.0}}


class TripletsIn(WhereIn):
    """Which triplets are good at a pose, and what keeps the others out."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {**_AT, "count": 5},
                {**_AT, "sensor": "mas97", "criterion": "max_axis", "triplet": ["R01", "R02", "R03"]},
            ]
        }
    )

    pose: PoseAtIn
    count: int = Field(
        default=10, ge=1, le=10_000, description="Triplets at most; as many that are missed. See max_ranking."
    )
    criterion: Literal["area", "max_axis", "trace"] | None = Field(
        default=None, description="What makes a triplet better; default: the field's, else area."
    )
    triplet: Three | None = Field(default=None, description="Ids: ask about these three too.")
