"""What the service asks of its workers, and what they say of themselves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from api.codec_plan import FieldLabel
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import Sensor
from planner.problem import PlanningProblem
from planner.result import Trajectory


@dataclass(frozen=True, slots=True)
class FieldOrder:
    """A field to compute.

    Attributes
    ----------
    field_id
        What the result must be.
    map_path, target
        Where the map is read and the field is written.
    sensor, resolution, heading, method
        As of :func:`localization.field_builder.build_field`.
    threads, max_cells
        Limits.
    headings
        How many evenly spaced ones; 1: ``heading`` alone.
    """

    field_id: str
    map_path: Path
    target: Path
    sensor: Sensor
    resolution: float
    heading: float
    threads: int
    max_cells: int
    method: FieldMethod = BEST_AREA
    headings: int = 1


@dataclass(frozen=True, slots=True)
class UploadLimits:
    """How large a decoded map may be: cells, landmarks, and bytes while it is decoded."""

    pixels: int
    landmarks: int
    memory: int


@dataclass(frozen=True, slots=True)
class Loaded:
    """A field that a worker has ready.

    Attributes
    ----------
    label
        Ids and landmarks.
    kept
        Names of all fields that the worker has in memory now.
    """

    label: FieldLabel
    kept: frozenset[str]


@dataclass(frozen=True, slots=True)
class MatrixOrder:
    """Figures between many places.

    Attributes
    ----------
    sources, targets
        Places (x, y), m; no targets: the sources.
    problem
        Robot, costs and bounds; its ends do not matter.
    metrics
        Names of the figures, keys of :data:`api.codec_matrix.LAYERS`.
    deadline
        s.
    threads
        How many.
    client_ref, warnings
        For the answer.
    """

    sources: tuple[tuple[float, float], ...]
    targets: tuple[tuple[float, float], ...] | None
    problem: PlanningProblem
    metrics: tuple[str, ...]
    deadline: float
    threads: int
    client_ref: str | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RegionOrder:
    """The area within reach of a place; ``measure`` and ``limit`` as of :func:`reachable_region`."""

    place: tuple[float, float]
    problem: PlanningProblem
    measure: Literal["cost", "length", "time"]
    limit: float
    deadline: float
    client_ref: str | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SimulationOrder:
    """Closed-loop runs.

    Attributes
    ----------
    trajectory
        The motion as planned.
    robot
        Values of :class:`planner.simulation.SimulatedRobot`, by name.
    runs, seed
        How many, and of which noise.
    plan
        Id of the plan; None: the trajectory came with the request.
    deadline, threads, client_ref, warnings
        As of :class:`MatrixOrder`.
    """

    trajectory: Trajectory
    robot: dict[str, Any]
    runs: int
    seed: int
    plan: str | None
    deadline: float
    threads: int
    client_ref: str | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class GivenPath:
    """A path to score: ``points`` (x, y), m, of a polyline, or a trajectory."""

    name: str
    points: tuple[tuple[float, float], ...]
    trajectory: Trajectory | None


@dataclass(frozen=True, slots=True, eq=False)
class EvaluationOrder:
    """Figures of given paths; ``problem`` has robot, costs and bounds, the rest is as of MatrixOrder."""

    paths: tuple[GivenPath, ...]
    problem: PlanningProblem
    deadline: float
    client_ref: str | None = None
    warnings: tuple[str, ...] = ()


Order = MatrixOrder | RegionOrder | SimulationOrder | EvaluationOrder
#: Order -> task of a worker.
TASK_OF: dict[type[Order], str] = {
    MatrixOrder: "matrix",
    RegionOrder: "reach",
    SimulationOrder: "simulate",
    EvaluationOrder: "evaluate",
}
