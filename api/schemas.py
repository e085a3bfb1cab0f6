"""Bodies of requests: strict types, finite numbers, no unknown names."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from api.questions import More
from api.schemas_base import Finite, Positive, Request
from api.schemas_parts import (
    AlternativesIn,
    AreaIn,
    ConstraintsIn,
    ObjectiveIn,
    PlaceIn,
    PolygonIn,
    PoseIn,
    RobotIn,
    StartIn,
)
from api.schemas_sensor import SensorOrPreset, to_sensor
from localization.heading_field import MAX_HEADINGS
from localization.method import FieldMethod
from localization.sensors import Sensor
from planner.problem import MAX_AREAS, MAX_DEADLINE_S, MAX_VIA, MIN_DEADLINE_S, PlanningProblem

MapId = Annotated[
    str, Field(min_length=1, max_length=200, description="Id (m_…) or name of a map.", examples=["warehouse"])
]
FieldId = Annotated[str, Field(min_length=1, max_length=200, description="Id (f_…) of a ready field.")]


_SENSOR_EXAMPLE: dict[str, Any] = {"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "max_range_m": 30.0}


class FieldIn(Request):
    """Order for an uncertainty field."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"map": "warehouse", "resolution_m": 0.1, "sensor": _SENSOR_EXAMPLE},
                {"map": "warehouse", "resolution_m": 0.5, "sensor": "forward", "headings": 12},
            ],
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
    headings: int = Field(
        default=1,
        ge=1,
        le=MAX_HEADINGS,
        description="So many evenly spaced headings from 0 on, for sensors to which they matter: plans drive "
        "by the heading then. Cells count once for each; 36 will do for a camera.",
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

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.headings > 1 and self.heading_rad:
            raise ValueError("give heading_rad or headings, not both")
        return self

    def to_sensor(self) -> Sensor:
        """The sensor; raises :class:`~localization.errors.InvalidSensor` on impossible numbers."""
        return to_sensor(self.sensor)

    def to_method(self) -> FieldMethod:
        """How fixes are made."""
        return FieldMethod(self.estimator, self.criterion)


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
                },
                {
                    "map": "warehouse",
                    "start": {"x_m": 6.2, "y_m": 18.0},
                    "goal": {"x_m": 54.0, "y_m": 17.0},
                    "robot": {"radius_m": 0.35},
                    "alternatives": {"count": 3, "max_cost_factor": 1.4, "max_share": 0.6},
                    "include": ["schedule"],
                    "deadline_s": 8.0,
                },
                {
                    "map": "warehouse",
                    "start": {"x_m": 6.2, "y_m": 18.0},
                    "goal": {"x_m": 54.0, "y_m": 17.0},
                    "robot": {"radius_m": 0.35},
                    "objective": {"kind": "pareto", "against": "worst", "count": 5},
                    "deadline_s": 8.0,
                },
            ],
        }
    )

    field: FieldId | None = None
    map: MapId | None = None
    start: StartIn
    goal: PoseIn
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
    alternatives: AlternativesIn | None = Field(
        default=None, description="Further routes that go elsewhere; null: the best one alone."
    )
    include: list[Literal["schedule", "shortest_baseline", "covariance"]] = Field(
        default=[],
        max_length=10,
        description="schedule: for every stretch of each route which landmarks to look at, and where. "
        "The others are always there.",
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

    def to_more(self) -> More:
        """What is asked for beside one route.

        Raises
        ------
        InvalidProblem
            If it does not go together.
        """
        return More(
            None if self.alternatives is None else self.alternatives.to_asked(),
            self.objective.to_front(),
            "schedule" in self.include,
            self.robot.pan_rate,
        )

    def to_problem(
        self, *, default_deadline: float = 2.0, max_deadline: float = MAX_DEADLINE_S
    ) -> tuple[PlanningProblem, tuple[str, ...]]:
        """The planner's question, and warnings where a number was clamped.

        Raises
        ------
        InvalidProblem
            If a number is out of its range.
        """
        deadline, warnings = clamped_deadline(self.deadline_s, default_deadline, max_deadline)
        # A front is one of lengths: the planner leaves the objective aside.
        kind: Any = "shortest" if self.objective.kind == "pareto" else self.objective.kind
        problem = PlanningProblem(
            start=(self.start.x_m, self.start.y_m),
            goal=(self.goal.x_m, self.goal.y_m),
            radius=self.robot.radius_m,
            objective=kind,
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
            kinematics=self.robot.kinematics,
            min_turn_radius=self.robot.min_turn_radius_m,
            max_turn_accel=self.robot.max_turn_accel_rad_s2 or math.inf,
            start_heading=self.start.heading,
            goal_heading=self.goal.heading,
            footprint=self.robot.corners,
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


def clamped_deadline(
    asked: float | None, default: float, ceiling: float = MAX_DEADLINE_S
) -> tuple[float, tuple[str, ...]]:
    """A deadline within the limits, s, and a warning where that is not what was asked for."""
    ceiling = min(ceiling, MAX_DEADLINE_S)
    wanted = min(default, ceiling) if asked is None else asked
    deadline = min(max(wanted, MIN_DEADLINE_S), ceiling)
    if deadline == wanted:
        return deadline, ()
    said = f"deadline_s was {wanted:g} s and is now {deadline:g} s; "
    return deadline, (f"{said}the limits are {MIN_DEADLINE_S:g} and {ceiling:g} s.",)
