"""Bodies of questions about one place of a map."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from api.place_orders import LocalizeOrder
from api.schemas import FieldId, MapId, clamped_deadline
from api.schemas_base import Finite, Positive, Request, angle, angle_or_none
from api.schemas_sensor import SensorOrPreset, to_sensor
from localization.sensors import Sensor

#: Deadline of a question that names none, s.
DEFAULT_DEADLINE_S = 5.0
#: Less is not enough to read a large map.
LEAST_DEADLINE_S = 1.0
LandmarkId = Annotated[str, Field(min_length=1, max_length=200)]
Three = Annotated[list[LandmarkId], Field(min_length=3, max_length=3)]
_TURN = 2 * math.pi


class PoseAtIn(Request):
    """Where the robot is, and its heading."""

    x_m: Finite = Field(examples=[30.0])
    y_m: Finite = Field(examples=[8.0])
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
        description="Time for the answer, s (default 5, at least 1, at most 30; clamped).",
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
        asked = self.deadline_s and max(self.deadline_s, LEAST_DEADLINE_S)
        return clamped_deadline(asked, DEFAULT_DEADLINE_S, ceiling)[0]


_AT: dict[str, Any] = {"map": "warehouse", "sensor": "laser", "pose": {"x_m": 30.0, "y_m": 8.0}}


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


class FixesIn(WhereIn):
    """Monte Carlo of fixes at a pose: many noisy measurements, and the pose that each one gives."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{**_AT, "n": 2000, "points": 200, "seed": 1}, {**_AT, "sensor": "mas97"}]
        }
    )

    pose: PoseAtIn
    estimator: Literal["best_triplet", "all_visible"] | None = Field(
        default=None, description="What a fix is made of; default: the field's, else best_triplet."
    )
    triplet: Three | None = Field(default=None, description="Ids of three landmarks; default: the best.")
    n: int = Field(default=2000, ge=1, description="Measurements; see max_fixes.")
    points: int = Field(default=500, ge=0, description="Fixes given one by one; see max_cloud_points.")
    seed: int = Field(default=0, ge=0, lt=2**31, description="Same seed, same fixes.")

    @model_validator(mode="after")
    def _check_estimator(self) -> Self:
        if self.triplet is not None and self.estimator == "all_visible":
            raise ValueError("give a triplet or the estimator all_visible, not both")
        return self


_Bearing = Annotated[float, Field(allow_inf_nan=False, ge=-100, le=100)]


class BearingIn(Request):
    """A landmark under a bearing, counter-clockwise from the sensor's zero direction."""

    landmark: LandmarkId
    bearing_rad: _Bearing | None = None
    bearing_deg: Annotated[float, Field(allow_inf_nan=False, ge=-3600, le=3600)] | None = None
    sigma_rad: Annotated[float, Field(allow_inf_nan=False, ge=1e-9, le=math.pi)] | None = Field(
        default=None, description="Standard deviation; default: the sensor's."
    )
    sigma_deg: Annotated[float, Field(allow_inf_nan=False, ge=1e-7, le=180)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        angle("bearing", self.bearing_deg, self.bearing_rad)
        angle_or_none("sigma", self.sigma_deg, self.sigma_rad)
        return self


class ColumnIn(Request):
    """A landmark in an image column; columns grow to the right."""

    landmark: LandmarkId
    column_px: Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]


class LocalizeIn(WhereIn):
    """What a robot measured. Give bearings, or columns of a camera."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "map": "warehouse",
                    "sensor": "laser",
                    "bearings": [
                        {"landmark": "R82", "bearing_deg": 169.8},
                        {"landmark": "R83", "bearing_deg": 90.0},
                        {"landmark": "R84", "bearing_deg": 10.2},
                    ],
                },
                {
                    "map": "warehouse",
                    "sensor": "mas97",
                    "pan_deg": 94.0,
                    "columns": [
                        {"landmark": "R48", "column_px": 478.0},
                        {"landmark": "R58", "column_px": 26.1},
                        {"landmark": "R83", "column_px": 291.8},
                    ],
                },
            ]
        }
    )

    bearings: list[BearingIn] | None = Field(default=None, min_length=3, max_length=10_000)
    columns: list[ColumnIn] | None = Field(default=None, min_length=3, max_length=10_000)
    pan_rad: _Bearing | None = Field(
        default=None, description="Optical axis from the mount's direction, for columns; default 0."
    )
    pan_deg: Annotated[float, Field(allow_inf_nan=False, ge=-3600, le=3600)] | None = None
    principal_px: Annotated[float, Field(allow_inf_nan=False, ge=0, le=1e6)] | None = Field(
        default=None, description="Column of the optical axis; default: the middle of the field of view."
    )

    @model_validator(mode="after")
    def _check_measured(self) -> Self:
        if (self.bearings is None) == (self.columns is None):
            raise ValueError("give bearings or columns, exactly one")
        if self.columns is None and {"pan_rad", "pan_deg", "principal_px"} & self.model_fields_set:
            raise ValueError("pan and principal_px go with columns")
        angle_or_none("pan", self.pan_deg, self.pan_rad)
        return self

    def to_order(self, sensor: Sensor, deadline: float) -> LocalizeOrder:
        """What a worker is asked."""
        rays, columns = self.bearings or [], self.columns or []
        sigma = [angle_or_none("sigma", b.sigma_deg, b.sigma_rad) for b in rays]
        return LocalizeOrder(
            sensor=sensor,
            landmarks=(*(b.landmark for b in rays), *(c.landmark for c in columns)),
            bearings=None
            if not rays
            else tuple(angle("bearing", b.bearing_deg, b.bearing_rad) for b in rays),
            columns=None if not columns else tuple(c.column_px for c in columns),
            principal_px=self.principal_px,
            pan=angle_or_none("pan", self.pan_deg, self.pan_rad) or 0.0,
            sigma=tuple(math.nan if s is None else s for s in sigma) if rays else (math.nan,) * len(columns),
            deadline=deadline,
        )
