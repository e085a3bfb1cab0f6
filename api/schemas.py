"""Bodies of requests: strict types, finite numbers, no unknown names."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from localization.sensors import PRESETS, OmnidirectionalSensor, PinholePanSensor, Sensor
from planner.problem import MAX_DEADLINE_S, MIN_DEADLINE_S, PlanningProblem

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]
MapId = Annotated[
    str, Field(min_length=1, max_length=200, description="Id (m_…) or name of a map.", examples=["warehouse"])
]
FieldId = Annotated[str, Field(min_length=1, max_length=200, description="Id (f_…) of a ready field.")]


class Request(BaseModel):
    """Base of all request bodies: what is not known is refused, nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _one_angle(name: str, deg: float | None, rad: float | None) -> float | None:
    if deg is not None and rad is not None:
        raise ValueError(f"give {name}_deg or {name}_rad, not both")
    return math.radians(deg) if deg is not None else rad


def _needed_angle(name: str, deg: float | None, rad: float | None) -> float:
    angle = _one_angle(name, deg, rad)
    if angle is None:
        raise ValueError(f"give {name}_deg or {name}_rad")
    return angle


class OmnidirectionalIn(Request):
    """A scanner that measures bearings all around, such as a navigation laser on reflectors."""

    kind: Literal["omnidirectional"]
    bearing_sigma_deg: Positive | None = Field(
        default=None, description="Standard deviation of a bearing, degrees."
    )
    bearing_sigma_rad: Positive | None = Field(default=None, description="The same in rad; give exactly one.")
    min_range_m: NotNegative = Field(default=0.0, description="Nearest landmark that is seen, m.")
    max_range_m: Positive | None = Field(
        default=None, description="Farthest landmark that is seen, m; null: any."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        _needed_angle("bearing_sigma", self.bearing_sigma_deg, self.bearing_sigma_rad)
        return self

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        return OmnidirectionalSensor(
            bearing_sigma=_needed_angle("bearing_sigma", self.bearing_sigma_deg, self.bearing_sigma_rad),
            min_range=self.min_range_m,
            max_range=math.inf if self.max_range_m is None else self.max_range_m,
        )


class PinholePanIn(Request):
    """A pinhole camera on a pan head: a bearing has standard deviation ``column_sigma · cos²ψ / focal``."""

    kind: Literal["pinhole_pan"]
    fov_deg: Positive | None = Field(default=None, description="Full opening angle, degrees, below 180.")
    fov_rad: Positive | None = Field(default=None, description="The same in rad; give exactly one.")
    focal_px: Positive = Field(description="Focal length, px.")
    column_sigma_px: Positive = Field(description="Standard deviation of an image column, px.")
    pan_min_deg: Finite | None = Field(
        default=None, description="Lower pan limit off the heading; default -180."
    )
    pan_min_rad: Finite | None = Field(default=None, description="The same in rad; give at most one.")
    pan_max_deg: Finite | None = Field(
        default=None, description="Upper pan limit off the heading; default 180."
    )
    pan_max_rad: Finite | None = Field(default=None, description="The same in rad; give at most one.")
    min_range_m: NotNegative = Field(default=0.0, description="Nearest landmark that is seen, m.")
    max_range_m: Positive | None = Field(
        default=None, description="Farthest landmark that is seen, m; null: any."
    )
    pan_policy: Literal["centred", "optimal"] = Field(
        default="centred", description="Axis on the middle of the triplet, or where the ellipse is smallest."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        _needed_angle("fov", self.fov_deg, self.fov_rad)
        _one_angle("pan_min", self.pan_min_deg, self.pan_min_rad)
        _one_angle("pan_max", self.pan_max_deg, self.pan_max_rad)
        return self

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        low = _one_angle("pan_min", self.pan_min_deg, self.pan_min_rad)
        high = _one_angle("pan_max", self.pan_max_deg, self.pan_max_rad)
        return PinholePanSensor(
            field_of_view=_needed_angle("fov", self.fov_deg, self.fov_rad),
            focal_px=self.focal_px,
            column_sigma_px=self.column_sigma_px,
            pan_min=-math.pi if low is None else low,
            pan_max=math.pi if high is None else high,
            min_range=self.min_range_m,
            max_range=math.inf if self.max_range_m is None else self.max_range_m,
            pan_policy=self.pan_policy,
        )


SensorIn = Annotated[OmnidirectionalIn | PinholePanIn, Field(discriminator="kind")]
PresetName = Literal["laser", "mas97"]
SENSOR_TAGS = ("omnidirectional", "pinhole_pan", "preset")


def _sensor_tag(value: Any) -> str | None:
    if isinstance(value, str):
        return "preset"
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return kind if kind in SENSOR_TAGS[:2] else None


SensorOrPreset = Annotated[
    Annotated[OmnidirectionalIn, Tag("omnidirectional")]
    | Annotated[PinholePanIn, Tag("pinhole_pan")]
    | Annotated[PresetName, Tag("preset")],
    Discriminator(
        _sensor_tag,
        custom_error_type="sensor_kind",
        custom_error_message="the kind must be omnidirectional or pinhole_pan, "
        "or the whole sensor one of the presets laser and mas97",
    ),
]
_SENSOR_EXAMPLE: dict[str, Any] = {"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "max_range_m": 30.0}


class FieldIn(Request):
    """Order for an uncertainty field."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"map": "warehouse", "resolution_m": 0.1, "sensor": _SENSOR_EXAMPLE}],
        }
    )

    map: MapId
    sensor: SensorOrPreset = Field(
        description="The sensor, or a preset: laser (0.1°, 30 m) or mas97 (the paper's camera)."
    )
    resolution_m: Finite = Field(default=0.1, description="Side of a cell, m.", ge=0.001, le=100)
    heading_rad: Finite = Field(
        default=0.0,
        description="Heading of the robot; matters for limited pan heads only.",
        ge=-2 * math.pi,
        le=2 * math.pi,
    )

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        return PRESETS[self.sensor] if isinstance(self.sensor, str) else self.sensor.to_sensor()


class PlaceIn(Request):
    """A place in the map frame."""

    x_m: Finite = Field(examples=[4.0])
    y_m: Finite = Field(examples=[4.0])


class RobotIn(Request):
    """A disc that can drive in every direction."""

    radius_m: NotNegative = Field(description="Radius of the disc, m.", examples=[0.35])
    max_speed_m_s: Finite = Field(default=1.2, ge=0.001, le=50, description="Largest speed, m/s.")
    max_accel_m_s2: Finite = Field(default=0.8, ge=0.001, le=50, description="Largest acceleration, m/s².")


class ObjectiveIn(Request):
    """What the path shall minimise."""

    kind: Literal["shortest", "weighted"] = Field(
        default="weighted", description="shortest: length. weighted: cost per metre 1 + weight · r95."
    )
    uncertainty_weight_per_m: NotNegative = Field(
        default=4.0,
        description="Extra metres accepted per metre driven at r95 = 1 m; without effect on shortest.",
    )


class ConstraintsIn(Request):
    """What the path must keep."""

    max_r95_m: Positive | None = Field(
        default=None, description="Never less certain than this where there is a fix, m; null: no bound."
    )
    blind_r95_m: NotNegative | None = Field(
        default=None,
        description=(
            "Cells from which no triplet is seen: null forbids them; a number lets the path cross them "
            "at the cost of a place with this r95, m."
        ),
    )


class PlanIn(Request):
    """One question to the planner. Give ``field``, or ``map`` for its newest ready field."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "map": "warehouse",
                    "start": {"x_m": 4.0, "y_m": 4.0},
                    "goal": {"x_m": 55.0, "y_m": 20.0},
                    "robot": {"radius_m": 0.35, "max_speed_m_s": 1.2, "max_accel_m_s2": 0.8},
                    "objective": {"kind": "weighted", "uncertainty_weight_per_m": 4.0},
                    "deadline_s": 2.0,
                }
            ],
        }
    )

    field: FieldId | None = None
    map: MapId | None = None
    start: PlaceIn
    goal: PlaceIn
    robot: RobotIn
    objective: ObjectiveIn = ObjectiveIn()
    constraints: ConstraintsIn = ConstraintsIn()
    deadline_s: Positive | None = Field(
        default=None,
        description="Time for the plan, s (default 2, at least 0.05, at most 30; clamped with a warning). "
        "The best found until then is the answer.",
    )
    seed: int = Field(default=0, ge=0, lt=2**31, description="Same question, same seed: same answer.")
    client_ref: str | None = Field(
        default=None, max_length=200, description="Comes back in the answer, unread."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.field is None) == (self.map is None):
            raise ValueError("give field or map, exactly one")
        return self

    def to_problem(
        self, *, default_deadline: float = 2.0, max_deadline: float = MAX_DEADLINE_S
    ) -> tuple[PlanningProblem, tuple[str, ...]]:
        """The planner's question, and warnings where a number was clamped.

        Raises
        ------
        InvalidProblem
            If a number is out of its range.
        """
        asked = default_deadline if self.deadline_s is None else self.deadline_s
        ceiling = min(max_deadline, MAX_DEADLINE_S)
        deadline = min(max(asked, MIN_DEADLINE_S), ceiling)
        warnings: tuple[str, ...] = ()
        if deadline != asked:
            said = f"deadline_s was {asked:g} s and is now {deadline:g} s; "
            warnings = (f"{said}the limits are {MIN_DEADLINE_S:g} and {ceiling:g} s.",)
        problem = PlanningProblem(
            start=(self.start.x_m, self.start.y_m),
            goal=(self.goal.x_m, self.goal.y_m),
            radius=self.robot.radius_m,
            objective=self.objective.kind,
            weight=self.objective.uncertainty_weight_per_m,
            max_r95=self.constraints.max_r95_m,
            blind_r95=self.constraints.blind_r95_m,
            max_speed=self.robot.max_speed_m_s,
            max_accel=self.robot.max_accel_m_s2,
            deadline=deadline,
            seed=self.seed,
        )
        return problem, warnings
