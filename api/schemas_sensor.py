"""Sensors in requests and sensor files: lengths in m, every angle in degrees or rad, exactly one of both."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import Discriminator, Field, Tag, model_validator

from api.schemas_base import Finite, NotNegative, Positive, Request, angle, angle_or_none
from localization.sensors import (
    PRESETS,
    Mount,
    OmnidirectionalSensor,
    PinholeFixedSensor,
    PinholePanSensor,
    Sensor,
)

_MAX_SECTORS = 64
_HALF_TURN_RAD = math.pi + 1e-9
_ONE = "The same in rad; give exactly one."
_ONE_AT_MOST = "The same in rad; give at most one."

_SigmaDeg = Annotated[float, Field(allow_inf_nan=False, gt=0, lt=180)]
_SigmaRad = Annotated[float, Field(allow_inf_nan=False, gt=0, lt=math.pi)]
_FloorDeg = Annotated[float, Field(allow_inf_nan=False, ge=0, lt=180)]
_FloorRad = Annotated[float, Field(allow_inf_nan=False, ge=0, lt=math.pi)]
_HalfTurnDeg = Annotated[float, Field(allow_inf_nan=False, ge=-180, le=180)]
_HalfTurnRad = Annotated[float, Field(allow_inf_nan=False, ge=-_HALF_TURN_RAD, le=_HALF_TURN_RAD)]
_TurnDeg = Annotated[float, Field(allow_inf_nan=False, ge=-360, le=360)]
_TurnRad = Annotated[float, Field(allow_inf_nan=False, ge=-2 * math.pi, le=2 * math.pi)]
_Arm = Annotated[float, Field(allow_inf_nan=False, ge=-100, le=100)]


class MountIn(Request):
    """Where the sensor sits on the robot: its pose in the robot's frame."""

    x_m: _Arm = Field(default=0.0, description="Ahead of the robot's centre, m.")
    y_m: _Arm = Field(default=0.0, description="To the left of the robot's centre, m.")
    theta_deg: Finite | None = Field(
        default=None, description="Sensor's zero direction from the robot's heading, degrees; default 0."
    )
    theta_rad: Finite | None = Field(default=None, description=_ONE_AT_MOST)

    @model_validator(mode="after")
    def _check(self) -> Self:
        angle_or_none("theta", self.theta_deg, self.theta_rad)
        return self

    def to_mount(self) -> Mount:
        """The mount; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        theta = angle_or_none("theta", self.theta_deg, self.theta_rad)
        return Mount(self.x_m, self.y_m, 0.0 if theta is None else theta)


class SectorIn(Request):
    """Directions from ``begin`` counter-clockwise to ``end``, from the sensor's zero direction."""

    begin_deg: _TurnDeg | None = Field(default=None, description="Where the sector begins, degrees.")
    end_deg: _TurnDeg | None = Field(default=None, description="Where it ends, degrees.")
    begin_rad: _TurnRad | None = Field(default=None, description="The same in rad; give one pair.")
    end_rad: _TurnRad | None = Field(default=None, description="The same in rad; give one pair.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = {
            name
            for name in ("begin_deg", "end_deg", "begin_rad", "end_rad")
            if getattr(self, name) is not None
        }
        if given not in ({"begin_deg", "end_deg"}, {"begin_rad", "end_rad"}):
            raise ValueError("give begin_deg and end_deg, or begin_rad and end_rad")
        if self.begin_deg is not None and self.end_deg is not None:
            width = (self.end_deg - self.begin_deg) % 360
        else:
            begin, end = self.to_sector()
            width = (end - begin) % (2 * math.pi)
        if width == 0:
            raise ValueError(
                "the sector is empty or the whole turn: it ends in the direction where it begins"
            )
        return self

    def to_sector(self) -> tuple[float, float]:
        """``(begin, end)``, rad."""
        return (angle("begin", self.begin_deg, self.begin_rad), angle("end", self.end_deg, self.end_rad))


class _SensorBase(Request):
    bearing_floor_deg: _FloorDeg | None = Field(
        default=None,
        description="Second, constant part of a bearing's standard deviation, degrees; the variances add. "
        "Default 0.",
    )
    bearing_floor_rad: _FloorRad | None = Field(default=None, description=_ONE_AT_MOST)
    min_range_m: NotNegative = Field(default=0.0, description="Nearest landmark that is seen, m.")
    max_range_m: Positive | None = Field(
        default=None, description="Farthest landmark that is seen, m; null: any."
    )
    mount: MountIn = Field(default=MountIn(), description="Where it sits on the robot; default: its centre.")

    @model_validator(mode="after")
    def _check_common(self) -> Self:
        angle_or_none("bearing_floor", self.bearing_floor_deg, self.bearing_floor_rad)
        return self

    def _common(self) -> dict[str, Any]:
        floor = angle_or_none("bearing_floor", self.bearing_floor_deg, self.bearing_floor_rad)
        return {
            "bearing_floor": 0.0 if floor is None else floor,
            "min_range": self.min_range_m,
            "max_range": math.inf if self.max_range_m is None else self.max_range_m,
            "mount": self.mount.to_mount(),
        }


class OmnidirectionalIn(_SensorBase):
    """A scanner that measures bearings all around, such as a navigation laser on reflectors."""

    kind: Literal["omnidirectional"]
    bearing_sigma_deg: _SigmaDeg | None = Field(
        default=None, description="Standard deviation of a bearing, degrees."
    )
    bearing_sigma_rad: _SigmaRad | None = Field(default=None, description=_ONE)
    muted: list[SectorIn] = Field(
        default=[],
        max_length=_MAX_SECTORS,
        description="Sectors in which nothing is seen, for instance where the robot's body is.",
        examples=[[{"begin_deg": 170, "end_deg": -170}]],
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        angle("bearing_sigma", self.bearing_sigma_deg, self.bearing_sigma_rad)
        return self

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        return OmnidirectionalSensor(
            bearing_sigma=angle("bearing_sigma", self.bearing_sigma_deg, self.bearing_sigma_rad),
            muted=[sector.to_sector() for sector in self.muted],
            **self._common(),
        )


class _CameraBase(_SensorBase):
    fov_deg: _SigmaDeg | None = Field(default=None, description="Full opening angle, degrees, below 180.")
    fov_rad: _SigmaRad | None = Field(default=None, description=_ONE)
    focal_px: Positive = Field(description="Focal length, px.")
    column_sigma_px: Positive = Field(description="Standard deviation of an image column, px.")

    @model_validator(mode="after")
    def _check_camera(self) -> Self:
        angle("fov", self.fov_deg, self.fov_rad)
        return self

    def _camera(self) -> dict[str, Any]:
        return {
            "field_of_view": angle("fov", self.fov_deg, self.fov_rad),
            "focal_px": self.focal_px,
            "column_sigma_px": self.column_sigma_px,
            **self._common(),
        }


class PinholePanIn(_CameraBase):
    """A pinhole camera on a pan head: a bearing has standard deviation ``column_sigma · cos²ψ / focal``."""

    kind: Literal["pinhole_pan"]
    pan_min_deg: _HalfTurnDeg | None = Field(
        default=None, description="Lower pan limit off the mount's direction, degrees; default -180."
    )
    pan_min_rad: _HalfTurnRad | None = Field(default=None, description=_ONE_AT_MOST)
    pan_max_deg: _HalfTurnDeg | None = Field(
        default=None, description="Upper pan limit off the mount's direction, degrees; default 180."
    )
    pan_max_rad: _HalfTurnRad | None = Field(default=None, description=_ONE_AT_MOST)
    pan_policy: Literal["centred", "optimal"] = Field(
        default="centred", description="Axis on the middle of the triplet, or where the ellipse is smallest."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        angle_or_none("pan_min", self.pan_min_deg, self.pan_min_rad)
        angle_or_none("pan_max", self.pan_max_deg, self.pan_max_rad)
        return self

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        low = angle_or_none("pan_min", self.pan_min_deg, self.pan_min_rad)
        high = angle_or_none("pan_max", self.pan_max_deg, self.pan_max_rad)
        return PinholePanSensor(
            pan_min=-math.pi if low is None else low,
            pan_max=math.pi if high is None else high,
            pan_policy=self.pan_policy,
            **self._camera(),
        )


class PinholeFixedIn(_CameraBase):
    """A pinhole camera fixed to the robot; it looks in the mount's direction."""

    kind: Literal["pinhole_fixed"]

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        return PinholeFixedSensor(**self._camera())


SensorIn = Annotated[OmnidirectionalIn | PinholePanIn | PinholeFixedIn, Field(discriminator="kind")]
PresetName = Literal["laser", "mas97", "forward"]
SENSOR_KINDS = ("omnidirectional", "pinhole_pan", "pinhole_fixed")
SENSOR_TAGS = (*SENSOR_KINDS, "preset")


def _sensor_tag(value: Any) -> str | None:
    if isinstance(value, str):
        return "preset"
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return kind if kind in SENSOR_KINDS else None


SensorOrPreset = Annotated[
    Annotated[OmnidirectionalIn, Tag("omnidirectional")]
    | Annotated[PinholePanIn, Tag("pinhole_pan")]
    | Annotated[PinholeFixedIn, Tag("pinhole_fixed")]
    | Annotated[PresetName, Tag("preset")],
    Discriminator(
        _sensor_tag,
        custom_error_type="sensor_kind",
        custom_error_message=f"the kind must be one of {', '.join(SENSOR_KINDS)}, "
        f"or the whole sensor one of the presets {', '.join(get_args(PresetName))}",
    ),
]


def to_sensor(given: OmnidirectionalIn | PinholePanIn | PinholeFixedIn | str) -> Sensor:
    """Sensor of a body or of a preset's name.

    Raises
    ------
    InvalidSensor
        On impossible numbers.
    """
    return PRESETS[given] if isinstance(given, str) else given.to_sensor()
