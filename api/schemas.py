"""Bodies of requests: strict types, finite numbers, no unknown names."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator
from shapely import Polygon

from api.schemas_base import Finite, NotNegative, Positive, Request
from api.schemas_sensor import SensorOrPreset, to_sensor
from localization.method import FieldMethod
from localization.motion import OdometryModel
from localization.sensors import Sensor
from planner.problem import (
    MAX_AREAS,
    MAX_CORNERS,
    MAX_DEADLINE_S,
    MAX_VIA,
    MIN_DEADLINE_S,
    PlanningProblem,
)

MapId = Annotated[
    str, Field(min_length=1, max_length=200, description="Id (m_…) or name of a map.", examples=["warehouse"])
]
FieldId = Annotated[str, Field(min_length=1, max_length=200, description="Id (f_…) of a ready field.")]


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
        description="The sensor, or a preset: laser (0.1°, 30 m), mas97 (the paper's camera on its pan head) "
        "or forward (the same camera, fixed)."
    )
    resolution_m: Finite = Field(default=0.1, description="Side of a cell, m.", ge=0.001, le=100)
    heading_rad: Finite = Field(
        default=0.0,
        description="Heading of the robot; matters to sensors that see otherwise when the robot turns: fixed "
        "cameras, limited pan heads, muted sectors, mounts off the robot's centre.",
        ge=-2 * math.pi,
        le=2 * math.pi,
    )
    estimator: Literal["best_triplet", "all_visible"] = Field(
        default="best_triplet",
        description="What a fix is made of: the best three landmarks in view, or all of them together "
        "(weighted least squares; its validity is not known).",
    )
    criterion: Literal["area", "max_axis", "trace"] = Field(
        default="area",
        description="What the best triplet, and where a pan head looks, make smallest: area or major axis of "
        "the 95 % ellipse, or the sum of the position variances.",
    )

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        return to_sensor(self.sensor)

    def to_method(self) -> FieldMethod:
        """How fixes are made."""
        return FieldMethod(self.estimator, self.criterion)


class PlaceIn(Request):
    """A place in the map frame."""

    x_m: Finite = Field(examples=[4.0])
    y_m: Finite = Field(examples=[4.0])


class StartIn(PlaceIn):
    """Where the robot is, and for ``fused`` how well it knows that."""

    covariance: Annotated[list[Finite], Field(min_length=6, max_length=6)] | None = Field(
        default=None,
        description="For fused: xx, xy, yy (m²), xθ, yθ (m rad), θθ (rad²); null: that of one fix there.",
    )

    def as_tuple(self) -> tuple[float, float, float, float, float, float] | None:
        """The covariance's six numbers."""
        if self.covariance is None:
            return None
        xx, xy, yy, xt, yt, tt = self.covariance
        return xx, xy, yy, xt, yt, tt


class OdometryIn(Request):
    """Noise of the robot's motion: standard deviations after 1 m, or after a turn of 1 rad."""

    distance_sigma_m: NotNegative = Field(default=0.02, description="Of the distance after 1 m, m.")
    turn_sigma_rad: NotNegative = Field(default=0.03, description="Of the turn after 1 rad, rad.")
    drift_sigma_rad: NotNegative = Field(default=0.01, description="Of the heading after 1 m, rad.")
    slip_sigma_m: NotNegative = Field(default=0.0, description="Of the sideways slip after 1 m, m.")

    def to_model(self) -> OdometryModel:
        """The model."""
        return OdometryModel(
            self.distance_sigma_m, self.turn_sigma_rad, self.drift_sigma_rad, self.slip_sigma_m
        )


class RobotIn(Request):
    """A disc that can drive in every direction."""

    radius_m: NotNegative = Field(description="Radius of the disc, m.", examples=[0.35])
    max_speed_m_s: Finite = Field(default=1.2, ge=0.001, le=50, description="Largest speed, m/s.")
    max_accel_m_s2: Finite = Field(default=0.8, ge=0.001, le=50, description="Largest acceleration, m/s².")
    max_turn_rate_rad_s: Finite = Field(
        default=1.0, ge=0.001, le=100, description="Of turns on the spot, rad/s; for fused."
    )
    fix_rate_hz: Finite = Field(default=10.0, ge=0.001, le=1e4, description="Fixes per second; for fused.")
    odometry: OdometryIn = OdometryIn()


class ObjectiveIn(Request):
    """What the path shall minimise."""

    kind: Literal["shortest", "weighted", "minimax"] = Field(
        default="weighted",
        description="shortest: length. weighted: cost per metre 1 + weight · r95. "
        "minimax: the smallest worst r95, then length.",
    )
    uncertainty_weight_per_m: NotNegative = Field(
        default=4.0,
        description="Extra metres accepted per metre driven at r95 = 1 m; for weighted only.",
    )
    covariance: Literal["fix", "fused"] = Field(
        default="fix",
        description="Whose uncertainty counts, in bounds too: fix: of one fix at each place. "
        "fused: of the filter (odometry and fixes) along the path.",
    )


class ConstraintsIn(Request):
    """What the path must keep; bounds that cannot be kept are raised as little as possible and named."""

    max_r95_m: Positive | None = Field(
        default=None, description="Never less certain than this where there is a fix, m; null: no bound."
    )
    max_ellipse95_m: Positive | None = Field(
        default=None, description="Semi-major axis of the 95 % ellipse, m; null: no bound."
    )
    max_collision_probability: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        default=None,
        description="Of every pose, from covariance and clearance, by a bound that knows the direction of "
        "the error; null: no bound.",
        examples=[0.001],
    )
    max_blind_distance_m: NotNegative | None = Field(
        default=None, description="Longest stretch without a fix, m; null: no bound."
    )
    blind_r95_m: NotNegative | None = Field(
        default=None,
        description=(
            "Cells without a usable fix: null forbids them; a number lets the path cross them "
            "at the cost of a place with this r95, m."
        ),
    )


Position = Annotated[list[Finite], Field(min_length=2, max_length=2)]
Ring = Annotated[list[Position], Field(min_length=3)]


class PolygonIn(Request):
    """A polygon as in GeoJSON, in metres of the map frame: an outer ring, then rings of holes."""

    type: Literal["Polygon"]
    coordinates: Annotated[
        list[
            Annotated[list[Annotated[list[Finite], Field(min_length=2, max_length=2)]], Field(min_length=3)]
        ],
        Field(min_length=1, max_length=100),
    ] = Field(examples=[[[[30.0, 10.0], [34.0, 10.0], [34.0, 14.0], [30.0, 10.0]]]])

    @model_validator(mode="after")
    def _check(self) -> Self:
        if sum(len(ring) for ring in self.coordinates) > MAX_CORNERS:
            raise ValueError(f"a polygon may have at most {MAX_CORNERS} corners")
        return self

    def to_polygon(self) -> Polygon:
        """The polygon, m; the planner refuses one that crosses itself."""
        return Polygon(self.coordinates[0], self.coordinates[1:])


class AreaIn(Request):
    """An area in which driving costs more, or less."""

    polygon: PolygonIn
    factor: Annotated[float, Field(ge=0.01, le=1000)] = Field(
        description="Of the cost per metre; where areas overlap, factors multiply.", examples=[2.0]
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
    start: StartIn
    goal: PlaceIn
    robot: RobotIn
    objective: ObjectiveIn = ObjectiveIn()
    constraints: ConstraintsIn = ConstraintsIn()
    via: list[PlaceIn] = Field(
        default=[], max_length=MAX_VIA, description="Places to pass in this order; the robot stops there."
    )
    avoid: list[PolygonIn] = Field(
        default=[], max_length=MAX_AREAS, description="Areas that the robot's body must not enter."
    )
    areas: list[AreaIn] = Field(
        default=[], max_length=MAX_AREAS, description="Areas in which driving costs more, or less."
    )
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
            max_ellipse95=self.constraints.max_ellipse95_m,
            max_collision_probability=self.constraints.max_collision_probability,
            max_blind_distance=self.constraints.max_blind_distance_m,
            covariance=self.objective.covariance,
            odometry=self.robot.odometry.to_model(),
            fix_rate=self.robot.fix_rate_hz,
            turn_rate=self.robot.max_turn_rate_rad_s,
            start_covariance=self.start.as_tuple(),
            via=tuple((place.x_m, place.y_m) for place in self.via),
            avoid=tuple(area.to_polygon() for area in self.avoid),
            areas=tuple((area.polygon.to_polygon(), area.factor) for area in self.areas),
            blind_r95=self.constraints.blind_r95_m,
            max_speed=self.robot.max_speed_m_s,
            max_accel=self.robot.max_accel_m_s2,
            deadline=deadline,
            seed=self.seed,
        )
        return problem, warnings
