"""Questions on a field, inside a worker process: it is loaded once, and asked many times."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from api.codec_many import matrix_answer, region_answer, simulation_answer
from api.codec_plan import FieldLabel, plan_to_json
from api.evaluating import evaluated
from api.finding import find
from api.questions import More
from api.store_files import read_field
from api.worker_main import Channel
from api.worker_orders import EvaluationOrder, Loaded, MatrixOrder, RegionOrder, SimulationOrder
from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField
from planner.clock import Clock
from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.example_context import example_context
from planner.matrix import cost_matrix
from planner.matrix import warm_up as warm_up_matrix
from planner.problem import MIN_DEADLINE_S, PlanningProblem
from planner.reachability import reachable_region
from planner.simulation import SimulatedRobot
from planner.simulation import simulate as run_simulation
from planner.timing import time_polyline
from planner.travel import Travel

_FIELDS = "fields"
# Encoding and sending an answer, and each further route in it.
_ENCODING_S = 0.15
_ROUTE_S = 0.03
#: What a context takes for each cell before anything is planned on it, bytes.
_CONTEXT_BYTES_PER_CELL = 100
#: Graphs, and as much again for costs to go, that plans leave in a context: some dozens on a small field.
_CACHE_BYTES_PER_CELL = 200
_CACHE_BYTES = (32 * 2**20, 256 * 2**20)


@dataclass(slots=True)
class Ready:
    """A field made ready for questions.

    Attributes
    ----------
    context, label
        For plans, and what answers say of the field.
    size
        Bytes that it takes.
    headings
        The field itself if it is one over headings.
    """

    context: PlanningContext
    label: FieldLabel
    size: int = 0
    headings: HeadingField | None = None
    _worst: PlanningContext | None = None

    def flat(self) -> tuple[PlanningContext, tuple[str, ...]]:
        """For questions that know no headings: the worst one of every cell, and that it is so."""
        if self.headings is None:
            return self.context, ()
        if self._worst is None:
            self._worst = PlanningContext(self.headings.reduced("worst"), cache_bytes=_CACHE_BYTES[0])
        said = f"The field is over {len(self.headings)} headings; the worst of them counts in every cell."
        return self._worst, (said,)


def load(channel: Channel, path: Path, keep_bytes: int) -> Loaded:
    """Make a field ready for planning, and forget those that were not used for longest.

    Raises
    ------
    FieldFormatError
        If there is no readable field.
    """
    kept: dict[str, Ready] = channel.memory.setdefault(_FIELDS, {})
    ready = kept.pop(path.name, None)
    if ready is None:
        field = read_field(path)
        headings = field if isinstance(field, HeadingField) else None
        cells = field.free.size * (1 if headings is None else len(headings))
        cache = min(max(_CACHE_BYTES[0], cells * _CACHE_BYTES_PER_CELL), _CACHE_BYTES[1])
        size = cells * _CONTEXT_BYTES_PER_CELL + 2 * cache
        ready = Ready(PlanningContext(field, cache_bytes=cache), FieldLabel.of(field), size, headings)
    kept[path.name] = ready  # the newest is last
    while len(kept) > 1 and sum(r.size for r in kept.values()) > keep_bytes:
        del kept[next(iter(kept))]
    return Loaded(ready.label, frozenset(kept))


def plan(
    channel: Channel,
    path: Path,
    problem: PlanningProblem,
    more: More,
    ends_at: float,
    client_ref: str | None,
    warnings: tuple[str, ...],
) -> dict[str, Any]:
    """Plan on a field that was loaded before; the answer of ``POST /v1/plans``.

    Reports each result that is better than the one before.

    Raises
    ------
    PlannerError
        If the question is wrong.
    """
    ready: Ready = channel.memory[_FIELDS][path.name]
    # The request in the answer stays as it was asked.
    hurried = replace(problem, deadline=min(problem.deadline, _left(ends_at, more.most_routes)))
    found = find(hurried, ready.context, more, report=channel.report)
    return plan_to_json(
        found, ready.label, problem=problem, more=more, client_ref=client_ref, warnings=warnings
    )


def _left(ends_at: float, routes: int = 1) -> float:
    """Seconds for a question: what waiting and loading took is gone, and encoding takes its share."""
    left = ends_at - time.monotonic()
    further = min(_ROUTE_S * (routes - 1), 0.15 * left)
    return max(MIN_DEADLINE_S, left - further - min(_ENCODING_S, 0.1 * left))


def matrix(channel: Channel, path: Path, order: MatrixOrder, ends_at: float) -> dict[str, Any]:
    """Figures between many places; the answer of ``POST /v1/matrix``.

    Raises
    ------
    InvalidProblem
        If there are too many places.
    """
    ready: Ready = channel.memory[_FIELDS][path.name]
    context, said = ready.flat()
    order = replace(order, warnings=(*order.warnings, *said))
    found = cost_matrix(
        context,
        order.sources,
        order.targets,
        travel=_travel(order.problem),
        deadline=min(order.deadline, _left(ends_at)),
        workers=order.threads,
    )
    return matrix_answer(found, ready.label, order)


def reach(channel: Channel, path: Path, order: RegionOrder, ends_at: float) -> dict[str, Any]:
    """The area within reach of a place; the answer of ``POST /v1/reachability``.

    Raises
    ------
    StartOutsideMap, StartOccupied
        If the robot cannot stand there.
    """
    ready: Ready = channel.memory[_FIELDS][path.name]
    context, said = ready.flat()
    order = replace(order, warnings=(*order.warnings, *said))
    region = reachable_region(
        context,
        order.place,
        travel=_travel(order.problem),
        measure=order.measure,
        limit=order.limit,
        deadline=min(order.deadline, _left(ends_at)),
    )
    return region_answer(region, ready.label, order)


def _travel(problem: PlanningProblem) -> Travel:
    names = (f.name for f in fields(Travel))
    return Travel(**{name: getattr(problem, name) for name in names})


def simulate(channel: Channel, path: Path, order: SimulationOrder, ends_at: float) -> dict[str, Any]:
    """Closed-loop runs; the answer of ``POST /v1/simulations``.

    Raises
    ------
    InvalidProblem, LocalizationError
        If they cannot be driven as asked.
    """
    ready: Ready = channel.memory[_FIELDS][path.name]
    field = ready.context.field
    inside = np.asarray(field.frame.contains(order.trajectory.points))
    if not inside.all():
        at = int(np.flatnonzero(~inside)[0])
        x, y = order.trajectory.points[at].tolist()
        raise InvalidProblem(f"Sample {at} of the trajectory is at ({x:g}, {y:g}) m, outside the map.")
    robot = SimulatedRobot(**order.robot)
    followed: UncertaintyField | HeadingField | None = ready.headings
    if followed is None and not field.sensor.depends_on_heading:
        followed = field
    with Clock(min(order.deadline, _left(ends_at))).stop_flag() as stop:
        report = run_simulation(
            field.world,
            field.sensor,
            order.trajectory,
            robot=robot,
            runs=order.runs,
            rng=np.random.default_rng(order.seed),
            field=followed if robot.policy == "best_triplet" else None,
            threads=order.threads,
            stop=stop,
        )
    return simulation_answer(report, robot, ready.label, order)


def evaluate(channel: Channel, path: Path, order: EvaluationOrder, ends_at: float) -> dict[str, Any]:  # noqa: ARG001
    """Figures of given paths; the answer of ``POST /v1/evaluations``.

    Raises
    ------
    InvalidProblem
        If a path leaves the map.
    """
    ready: Ready = channel.memory[_FIELDS][path.name]
    context, said = ready.flat()
    order = replace(order, warnings=(*order.warnings, *said))
    return evaluated(context, ready.label, order)


TASKS: dict[str, Callable[..., Any]] = {
    "load": load,
    "plan": plan,
    "matrix": matrix,
    "reach": reach,
    "simulate": simulate,
    "evaluate": evaluate,
}


def warm_up() -> None:
    """Compile or load what questions about many places and simulations need, in a made-up room."""
    warm_up_matrix()
    context = example_context()
    reachable_region(context, (1.0, 1.0), travel=Travel(0.2))
    corners = np.array([[1.0, 1.0], [5.0, 1.0], [5.0, 5.0]])
    trajectory = time_polyline(corners, max_speed=1.0, max_accel=1.0)
    field = context.field
    run_simulation(
        field.world,
        field.sensor,
        trajectory,
        robot=SimulatedRobot(0.2, start_covariance=1e-4 * np.eye(3)),
        runs=2,
        rng=np.random.default_rng(0),
        field=field,
    )
