"""Bodies of questions about many places, and of simulations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from api.codec_simulation import headings_of
from api.errors import InvalidRequest
from api.schemas import FieldId, MapId, clamped_deadline
from api.schemas_base import Finite, NotNegative, Positive, Request
from api.schemas_parts import (
    AreaIn,
    ConstraintsIn,
    ObjectiveIn,
    OdometryIn,
    PlaceIn,
    PolygonIn,
    RobotIn,
)
from planner.problem import MAX_AREAS, PlanningProblem
from planner.result import Trajectory

#: Deadline of a question that names none, s.
DEFAULT_DEADLINE_S = 10.0
_WAREHOUSE: dict[str, Any] = {"map": "warehouse", "robot": {"radius_m": 0.35}}
_PLACES: list[Any] = [{"x_m": 6.2, "y_m": 18.0}, {"x_m": 54.0, "y_m": 17.0}, {"x_m": 30.0, "y_m": 8.0}]

Metric = Literal["cost", "length_m", "duration_s", "mean_r95_m", "worst_r95_m", "blind_m"]
METRICS: tuple[Metric, ...] = get_args(Metric)


class Question(Request):
    """What questions about many places have in common. Give ``field``, or ``map`` for its newest one."""

    field: FieldId | None = None
    map: MapId | None = None
    robot: RobotIn
    objective: ObjectiveIn = ObjectiveIn()
    constraints: ConstraintsIn = ConstraintsIn()
    avoid: list[PolygonIn] = Field(
        default=[], max_length=MAX_AREAS, description="Areas that the robot's body must not enter."
    )
    areas: list[AreaIn] = Field(
        default=[], max_length=MAX_AREAS, description="Areas in which driving costs more, or less."
    )
    deadline_s: Positive | None = Field(
        default=None,
        description="Time for the answer, s (default 10, at least 0.05, at most 30; clamped with a warning). "
        "What is found until then is the answer.",
    )
    client_ref: str | None = Field(
        default=None, max_length=200, description="Comes back in the answer, unread."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.field is None) == (self.map is None):
            raise ValueError("give field or map, exactly one")
        if self.objective.kind not in {"shortest", "weighted"}:
            raise ValueError("questions about many places take the objectives shortest and weighted")
        if self.objective.covariance != "fix" or self.constraints.max_blind_distance_m is not None:
            raise ValueError("questions about many places have single fixes and no max_blind_distance_m")
        if self.robot.footprint is not None or self.robot.kinematics in {"dubins", "reeds_shepp"}:
            raise ValueError("questions about many places take discs that turn in place; give radius_m alone")
        return self

    def to_problem(self) -> PlanningProblem:
        """Robot, costs and bounds, as of a plan between any two places.

        Raises
        ------
        InvalidProblem
            If a number is out of its range.
        """
        return PlanningProblem(
            start=(0.0, 0.0),
            goal=(0.0, 0.0),
            radius=self.robot.radius_m,
            weight=0.0 if self.objective.kind == "shortest" else self.objective.uncertainty_weight_per_m,
            max_r95=self.constraints.max_r95_m,
            max_ellipse95=self.constraints.max_ellipse95_m,
            max_collision_probability=self.constraints.max_collision_probability,
            blind_r95=self.constraints.blind_r95_m,
            avoid=tuple(area.to_polygon() for area in self.avoid),
            areas=tuple((area.polygon.to_polygon(), area.factor) for area in self.areas),
            max_speed=self.robot.max_speed_m_s,
            max_accel=self.robot.max_accel_m_s2,
        )

    def deadline(self, ceiling: float) -> tuple[float, tuple[str, ...]]:
        """Seconds for the answer, and warnings where they are clamped."""
        return clamped_deadline(self.deadline_s, DEFAULT_DEADLINE_S, ceiling)


class MatrixIn(Question):
    """Figures of the ways between many places. Give ``field``, or ``map`` for its newest ready field."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{**_WAREHOUSE, "sources": _PLACES[:2], "targets": _PLACES, "deadline_s": 10.0}]
        }
    )

    sources: list[PlaceIn] = Field(min_length=1, description="Where ways begin.")
    targets: list[PlaceIn] | None = Field(
        default=None, min_length=1, description="Where they end; null: the sources."
    )
    metrics: list[Metric] = Field(
        default=list(METRICS), min_length=1, max_length=20, description="Figures wanted."
    )


class ReachIn(Question):
    """The area within reach of a place, and from which it is reached: both are the same."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{**_WAREHOUSE, "start": _PLACES[0], "max_length_m": 20.0}]}
    )

    start: PlaceIn
    max_cost: Positive | None = Field(default=None, description="Largest cost of the cheapest way.")
    max_length_m: Positive | None = Field(default=None, description="Largest length of the shortest way, m.")
    max_time_s: Positive | None = Field(default=None, description="That length at full speed, s.")

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        if sum(v is not None for v in (self.max_cost, self.max_length_m, self.max_time_s)) > 1:
            raise ValueError("give at most one of max_cost, max_length_m and max_time_s")
        return self

    def measure(self) -> tuple[Literal["cost", "length", "time"], float]:
        """What is bounded, and by how much; inf: whatever is connected."""
        if self.max_length_m is not None:
            return "length", self.max_length_m
        if self.max_time_s is not None:
            return "time", self.max_time_s
        return "cost", float("inf") if self.max_cost is None else self.max_cost


Coordinate = Annotated[float, Field(allow_inf_nan=False, ge=-1e7, le=1e7)]
Rate = Annotated[float, Field(allow_inf_nan=False, ge=-1e3, le=1e3)]


class MotionIn(Request):
    """A moment of a trajectory, as plans have them; velocity and acceleration may be left out."""

    t_s: Annotated[float, Field(allow_inf_nan=False, ge=0, le=1e6)]
    x_m: Coordinate
    y_m: Coordinate
    vx_m_s: Rate = 0.0
    vy_m_s: Rate = 0.0
    ax_m_s2: Rate = 0.0
    ay_m_s2: Rate = 0.0
    theta_rad: Finite | None = Field(default=None, description="Heading; null: the robot looks ahead.")


def trajectory_of(motions: Sequence[MotionIn], place: str) -> Trajectory:
    """A trajectory that came with a request, at ``place`` of its body.

    Raises
    ------
    InvalidRequest
        If its times do not ascend from 0.
    """
    rows = np.array([[m.t_s, m.x_m, m.y_m, m.vx_m_s, m.vy_m_s, m.ax_m_s2, m.ay_m_s2] for m in motions])
    backwards = np.flatnonzero(np.diff(rows[:, 0]) < 0)
    if rows[0, 0] != 0 or len(backwards):
        at = int(backwards[0]) + 1 if rows[0, 0] == 0 else 0
        raise InvalidRequest(
            f"Sample {at} of the trajectory is at {rows[at, 0]:g} s; times ascend from 0.",
            place=f"{place}/{at}/t_s",
        )
    heading = headings_of([m.theta_rad for m in motions])
    return Trajectory(rows[:, 0], rows[:, 1:3], rows[:, 3:5], rows[:, 5:7], heading)


class DrivenRobotIn(Request):
    """The robot that is simulated; what is null is as in the plan, or as a plan's default."""

    radius_m: NotNegative | None = Field(
        default=None, description="Of the disc, m; null: radius or footprint of the plan."
    )
    max_turn_rate_rad_s: Annotated[float, Field(ge=0.001, le=100)] | None = None
    min_turn_radius_m: NotNegative | None = Field(
        default=None,
        description="Of a car: it turns no sharper, corrections included; smaller than the plan's leaves "
        "room for them. Default: it can turn in place.",
    )
    fix_rate_hz: Annotated[float, Field(ge=0.001, le=1e4)] | None = Field(
        default=None, description="Fixes per second; at most 20 are made."
    )
    odometry: OdometryIn | None = None


class SimulationIn(Request):
    """Closed-loop runs of a plan, or of a trajectory on a field (or on the newest one of a map)."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    **_WAREHOUSE,
                    "trajectory": [
                        {"t_s": 0.0, "x_m": 4.0, "y_m": 12.0},
                        {"t_s": 8.0, "x_m": 12.0, "y_m": 12.0},
                        {"t_s": 16.0, "x_m": 20.0, "y_m": 12.0},
                    ],
                    "runs": 200,
                    "seed": 1,
                }
            ]
        }
    )

    plan: str | None = Field(default=None, min_length=1, max_length=200, description="Id (p_…) of a plan.")
    route: int = Field(default=0, ge=0, lt=100, description="Which of the plan's routes; 0 is the first.")
    field: FieldId | None = None
    map: MapId | None = None
    trajectory: list[MotionIn] | None = Field(default=None, min_length=2, max_length=100_000)
    robot: DrivenRobotIn = DrivenRobotIn()
    runs: int | None = Field(
        default=None, ge=1, description="How many (default 1000, or the limit where that is lower)."
    )
    seed: int = Field(default=0, ge=0, lt=2**31, description="Same seed, same runs.")
    mode: Literal["filter", "fix"] = Field(
        default="filter", description="What is steered on: the filter, or the last fix alone."
    )
    policy: Literal["best_triplet", "arbitrary", "forced_forward", "arbitrary_forward"] = Field(
        default="best_triplet", description="How landmarks are chosen; forward: by a camera that looks ahead."
    )
    steering: Literal["differential", "holonomic"] | None = Field(
        default=None,
        description="differential: drives along its heading, backwards where the trajectory does, and turns "
        "on the spot at corners. null: as the trajectory asks, holonomic where it moves sideways.",
    )
    start_covariance: Annotated[list[Finite], Field(min_length=6, max_length=6)] | None = Field(
        default=None,
        description="xx, xy, yy (m²), xθ, yθ (m rad), θθ (rad²); null: that of one fix at the start.",
    )
    deadline_s: Positive | None = Field(
        default=None,
        description="Time for the runs, s (default 10, at least 0.05, at most 30; clamped with a warning). "
        "The runs that are done until then are the answer.",
    )
    client_ref: str | None = Field(
        default=None, max_length=200, description="Comes back in the answer, unread."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        on = [name for name in ("field", "map") if getattr(self, name) is not None]
        if self.plan is not None and (on or self.trajectory is not None):
            raise ValueError("give a plan, or a trajectory with field or map, not both")
        if self.plan is None:
            if self.trajectory is None or len(on) != 1:
                raise ValueError("give a plan, or a trajectory with field or map, exactly one")
            if self.robot.radius_m is None:
                raise ValueError("a trajectory needs the robot's radius_m")
        return self

    def to_trajectory(self) -> Trajectory:
        """The trajectory that came with the request.

        Raises
        ------
        InvalidRequest
            If its times do not ascend from 0.
        """
        return trajectory_of(self.trajectory or [], "#/trajectory")

    def start_matrix(self) -> np.ndarray[Any, np.dtype[np.float64]] | None:
        """``start_covariance`` as a matrix (3, 3)."""
        if self.start_covariance is None:
            return None
        xx, xy, yy, xt, yt, tt = self.start_covariance
        return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])

    def deadline(self, ceiling: float) -> tuple[float, tuple[str, ...]]:
        """Seconds for the runs, and warnings where they are clamped."""
        return clamped_deadline(self.deadline_s, DEFAULT_DEADLINE_S, ceiling)
