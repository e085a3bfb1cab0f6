"""Bodies of batches of plans, and of questions about given paths."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from api.schemas import PlanIn
from api.schemas_base import Positive, Request
from api.schemas_many import MotionIn, Question, trajectory_of
from api.schemas_parts import PlaceIn
from planner.result import Trajectory

MAX_BATCH = 1000
MAX_PATHS = 10
MAX_SAMPLES = 20_000
_ROBOT: dict[str, Any] = {"radius_m": 0.35}
_WAYS: list[Any] = [
    {"name": "along the wall", "points": [{"x_m": 4, "y_m": 12}, {"x_m": 20, "y_m": 12}]},
    {"name": "detour", "points": [{"x_m": 4, "y_m": 12}, {"x_m": 12, "y_m": 11}, {"x_m": 20, "y_m": 12}]},
]
_ASKED: dict[str, Any] = {"map": "warehouse", "robot": _ROBOT, "deadline_s": 5.0}


class BatchIn(Request):
    """Several plans at once, each as of POST /v1/plans."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "plans": [
                        {**_ASKED, "start": {"x_m": 4.0, "y_m": 4.0}, "goal": {"x_m": 55.0, "y_m": 20.0}},
                        {**_ASKED, "start": {"x_m": 4.0, "y_m": 4.0}, "goal": {"x_m": 30.0, "y_m": 20.0}},
                    ]
                }
            ]
        }
    )

    plans: list[PlanIn] = Field(min_length=1, max_length=MAX_BATCH, description="See max_batch.")
    deadline_s: Positive | None = Field(
        default=None, description="Time for all together, s; default and most: max_batch_s."
    )


class PathIn(Request):
    """A path: places, a trajectory, or a route of a plan."""

    name: str | None = Field(default=None, min_length=1, max_length=200, description="Default: its number.")
    points: list[PlaceIn] | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_SAMPLES,
        description="Corners of a polyline; the robot is timed to stop at each.",
    )
    trajectory: list[MotionIn] | None = Field(default=None, min_length=1, max_length=MAX_SAMPLES)
    plan: Annotated[str, Field(min_length=1, max_length=200, description="Id (p_…).")] | None = None
    route: int = Field(default=0, ge=0, lt=100, description="Which of the plan's routes; 0 is the first.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if sum(v is not None for v in (self.points, self.trajectory, self.plan)) != 1:
            raise ValueError("give points, trajectory or plan, exactly one")
        if self.route and self.plan is None:
            raise ValueError("route goes with plan")
        return self

    def to_trajectory(self, place: str) -> Trajectory | None:
        """The trajectory that came with the request; None: it has none.

        Raises
        ------
        InvalidRequest
            If its times do not ascend from 0.
        """
        return None if self.trajectory is None else trajectory_of(self.trajectory, place)


class EvaluationIn(Question):
    """Given paths, scored as plans are. Give ``field``, or ``map`` for its newest ready field."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"map": "warehouse", "robot": _ROBOT, "constraints": {"max_r95_m": 0.1}, "paths": _WAYS},
            ]
        }
    )

    paths: list[PathIn] = Field(
        min_length=1, max_length=MAX_PATHS, description="The others against the first."
    )
