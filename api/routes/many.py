"""Questions about many places, and simulations: answered at once, in a worker process, by a deadline."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from starlette.responses import Response

from api import answers_many
from api.codec import DocumentError
from api.codec_simulation import footprint_of_answer, radius_of_answer, trajectory_of_answer
from api.dependencies import Service, Service_
from api.errors import InvalidRequest
from api.planning import newest_field
from api.routes.common import answer, json_response, problems
from api.schemas_many import MatrixIn, ReachIn, SimulationIn
from api.schemas_parts import OdometryIn
from api.settings import LimitExceeded
from api.worker_orders import MatrixOrder, Order, RegionOrder, SimulationOrder
from planner.reference import fitting_steering
from planner.result import Trajectory

router = APIRouter(prefix="/v1", tags=["plans"])
CODES = (
    "malformed_body",
    "not_found",
    "field_not_ready",
    "too_large",
    "unsupported_media",
    "limit_exceeded",
    "deadline_exceeded",
    "store_unavailable",
)
_DEFAULT_RUNS = 1000


@router.post(
    "/matrix",
    responses={
        200: answer(answers_many.Matrix, "Figures of every pair, null where there is no way."),
        **problems(*CODES),
    },
)
def make_matrix(question: MatrixIn, service: Service_) -> Response:
    """Cost, length, duration and uncertainty from every source to every target, by one search each.

    Places that the robot cannot use have a status and do not keep the others from being answered. Costs are
    those of grid paths: at most 8.3 % above the ones of plans.
    """
    settings = service.settings
    pairs = len(question.sources) * len(question.sources if question.targets is None else question.targets)
    _limit("pairs of places", pairs, settings.max_matrix_pairs, "SUREPATH_MAX_MATRIX_PAIRS", "#/sources")
    deadline, warnings = question.deadline(settings.max_deadline_s)
    order = MatrixOrder(
        sources=tuple((p.x_m, p.y_m) for p in question.sources),
        targets=None if question.targets is None else tuple((p.x_m, p.y_m) for p in question.targets),
        problem=question.to_problem(),
        metrics=tuple(question.metrics),
        deadline=deadline,
        threads=settings.workers,
        client_ref=question.client_ref,
        warnings=warnings,
    )
    return ask_field(service, question.field, question.map, order)


@router.post(
    "/reachability",
    responses={
        200: answer(answers_many.Region, "GeoJSON in m of the map frame."),
        **problems(*CODES, "start_outside_map", "start_occupied"),
    },
)
def reach(question: ReachIn, service: Service_) -> Response:
    """The area that a robot reaches from a place within a cost, a length or a time, under all constraints.

    With `max_r95_m`: what it reaches without ever being less certain. Ways may be driven in both directions:
    it is also the area from which the place is reached.
    """
    deadline, warnings = question.deadline(service.settings.max_deadline_s)
    measure, limit = question.measure()
    order = RegionOrder(
        place=(question.start.x_m, question.start.y_m),
        problem=question.to_problem(),
        measure=measure,
        limit=limit,
        deadline=deadline,
        client_ref=question.client_ref,
        warnings=warnings,
    )
    return ask_field(service, question.field, question.map, order)


@router.post(
    "/simulations",
    responses={
        200: answer(answers_many.Simulation, "Collisions, deviations, and whether the ellipses held."),
        **problems(*CODES),
    },
)
def simulate(question: SimulationIn, service: Service_) -> Response:
    """Drive a plan, or a trajectory, many times in closed loop: odometry, bearings, filter, path follower.

    Says how often the robot touches something, how far it strays, and whether the predicted 95 % ellipses
    hold. The same seed gives the same runs.
    """
    settings = service.settings
    runs = min(_DEFAULT_RUNS, settings.max_simulation_runs) if question.runs is None else question.runs
    _limit("runs", runs, settings.max_simulation_runs, "SUREPATH_MAX_SIMULATION_RUNS", "#/runs")
    deadline, warnings = question.deadline(settings.max_deadline_s)
    planned: dict[str, Any] = {}
    field = question.field
    if question.plan is None:
        trajectory = question.to_trajectory()
    else:
        planned = service.store.plan(question.plan).answer
        trajectory = trajectory_of_plan(planned, question.route)
        field = str(planned["field"])
    order = SimulationOrder(
        trajectory=trajectory,
        robot=_robot(question, planned, trajectory),
        runs=runs,
        seed=question.seed,
        plan=question.plan,
        deadline=deadline,
        threads=settings.workers,
        client_ref=question.client_ref,
        warnings=warnings,
    )
    return ask_field(service, field, question.map, order)


def ask_field(service: Service, field: str | None, map_name: str | None, order: Order) -> Response:
    """What a worker answers to an order on a field, or on the newest one of a map."""
    name = newest_field(service, map_name or "") if field is None else field
    path = service.store.field_path(service.store.ready_field(name).id)
    return json_response(service.pool.ask(path, order))


def _limit(what: str, requested: int, limit: int, setting: str, place: str) -> None:
    if requested <= limit:
        return
    raise LimitExceeded(
        f"{requested} {what} are asked for, the limit is {limit} ({setting}).",
        limit=limit,
        requested=requested,
        setting=setting,
        place=place,
    )


def trajectory_of_plan(planned: dict[str, Any], route: int, *, place: str = "#") -> Trajectory:
    """Trajectory of one of a plan's routes.

    Raises
    ------
    InvalidRequest
        If there is none; ``place`` is where the plan was named.
    """
    routes = planned["routes"]
    if route >= len(routes):
        raise InvalidRequest(
            f"The plan has {len(routes)} routes; route {route} is not one of them, they count from 0.",
            place=f"{place}/route",
        )
    try:
        return trajectory_of_answer({"routes": [routes[route]]})
    except DocumentError as error:
        raise InvalidRequest(str(error), place=f"{place}/plan") from error


def _robot(question: SimulationIn, planned: dict[str, Any], trajectory: Trajectory) -> dict[str, Any]:
    """Values of a simulated robot: the request's, else the plan's, else a plan's defaults."""
    given = question.robot
    robot = planned["request"]["robot"] if planned else {}
    odometry = given.odometry or OdometryIn(**robot.get("odometry", {}))
    return {
        "radius": radius_of_answer(planned) if given.radius_m is None else given.radius_m,
        "footprint": footprint_of_answer(planned) if given.radius_m is None else None,
        "odometry": odometry.to_model(),
        "fix_rate": given.fix_rate_hz or robot.get("fix_rate_hz", 10.0),
        "max_turn_rate": given.max_turn_rate_rad_s or robot.get("max_turn_rate_rad_s", 1.0),
        "mode": question.mode,
        "policy": question.policy,
        "steering": question.steering or fitting_steering(trajectory),
        "min_turn_radius": given.min_turn_radius_m or 0.0,
        "start_covariance": question.start_matrix(),
    }
