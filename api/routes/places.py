"""Questions about one place of a map: which landmarks serve there."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from fastapi import APIRouter
from starlette.responses import Response

from api import answers_places
from api.dependencies import Service, Service_
from api.errors import InvalidRequest
from api.place_orders import FixesOrder, RankingOrder
from api.routes.common import answer, json_response, problems
from api.schemas_places import FixesIn, LocalizeIn, PoseAtIn, TripletsIn, WhereIn
from api.settings import LimitExceeded
from api.store_records import MapRecord
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import OmnidirectionalSensor, Sensor
from maps.se2 import wrap

router = APIRouter(prefix="/v1", tags=["places"])
_CODES = (
    "malformed_body",
    "not_found",
    "too_large",
    "unsupported_media",
    "invalid_sensor",
    "too_few_landmarks",
    "limit_exceeded",
    "deadline_exceeded",
    "store_unavailable",
)


class Where(NamedTuple):
    """What a question about a place stands on."""

    map: MapRecord
    path: Path
    sensor: Sensor
    heading: float
    method: FieldMethod


def where_of(service: Service, question: WhereIn) -> Where:
    """Map, sensor, default heading and method of a question.

    Raises
    ------
    NotFound
        If there is no such field or map.
    TooFewLandmarks
        If a fix cannot be had anywhere on the map.
    """
    if question.field is not None:
        # A field that is still computed says what it will be of.
        field = service.store.field(question.field)
        record = service.store.map(field.map_id)
        where = Where(record, service.store.map_path(record.id), field.sensor, field.heading, field.method)
    else:
        record = service.store.map(question.map or "")
        sensor = question.to_sensor()
        assert sensor is not None  # checked by the schema
        where = Where(record, service.store.map_path(record.id), sensor, 0.0, BEST_AREA)
    if record.n_landmarks < 3:
        service.store.world(record.id).require_triangulation()
    return where


def require_on_map(record: MapRecord, pose: PoseAtIn, place: str = "#/pose") -> tuple[float, float]:
    """The pose's place, m.

    Raises
    ------
    InvalidRequest
        If it is outside the map.
    """
    x0, y0, x1, y1 = record.bounds
    if not (x0 <= pose.x_m <= x1 and y0 <= pose.y_m <= y1):
        raise InvalidRequest(
            f"Place ({pose.x_m:g}, {pose.y_m:g}) m is outside the map, which spans x {x0:g} … {x1:g} m, "
            f"y {y0:g} … {y1:g} m.",
            place=place,
        )
    return pose.x_m, pose.y_m


def require_ranking(count: int, limit: int, place: str | None) -> None:
    """Raise :class:`~api.settings.LimitExceeded` if more triplets are wanted than the limit."""
    require_limit("triplets", count, limit, "SUREPATH_MAX_RANKING", place)


def require_limit(what: str, requested: int, limit: int, setting: str, place: str | None) -> None:
    """Raise :class:`~api.settings.LimitExceeded` if more is asked for than a setting allows."""
    if requested > limit:
        raise LimitExceeded(
            f"{requested} {what} are asked for, the limit is {limit} ({setting}).",
            limit=limit,
            requested=requested,
            setting=setting,
            place=place,
        )


@router.post(
    "/triplets",
    responses={
        200: answer(answers_places.Triplets, "Triplets best first, and every landmark with its status."),
        **problems(*_CODES),
    },
)
def rank_triplets(question: TripletsIn, service: Service_) -> Response:
    """The landmark triplets at a pose, ranked by covariance, and why the others give no fix.

    With `triplet` also: the rank of these three, or which of them cannot be measured and why, and what they
    would give. Nothing is computed beforehand: any pose, sensor and criterion will do.
    """
    require_ranking(question.count, service.settings.max_ranking, "#/count")
    where = where_of(service, question)
    place = require_on_map(where.map, question.pose)
    heading = question.pose.heading
    found = service.pool.ask_map(
        where.path,
        RankingOrder(
            place=place,
            heading=where.heading if heading is None else heading,
            sensor=where.sensor,
            count=question.count,
            criterion=question.criterion or where.method.criterion,
            deadline=question.deadline(service.settings.max_deadline_s),
            triplet=None if question.triplet is None else (*question.triplet,),  # type: ignore[arg-type]
        ),
    )
    return json_response({"map": where.map.id, **found})


@router.post(
    "/fixes",
    responses={
        200: answer(answers_places.Fixes, "Figures and a cloud, or why there is no fix."),
        **problems(*_CODES),
    },
)
def simulate_fixes(question: FixesIn, service: Service_) -> Response:
    """Monte Carlo at a pose: the sensor's noise on many measurements, and the fix that each one gives.

    Says how many fixes lie inside the predicted 95 % ellipse, and how prediction and sample compare. At most
    `max_fixes` measurements; `max_cloud_points` of the fixes one by one, to be drawn.
    """
    settings = service.settings
    for what, asked, limit, name in (
        ("measurements", question.n, settings.max_fixes, "n"),
        ("points", question.points, settings.max_cloud_points, "points"),
    ):
        setting = "SUREPATH_MAX_FIXES" if name == "n" else "SUREPATH_MAX_CLOUD_POINTS"
        require_limit(what, asked, limit, setting, f"#/{name}")
    where = where_of(service, question)
    heading = question.pose.heading
    default = "best_triplet" if question.triplet is not None else where.method.estimator
    found = service.pool.ask_map(
        where.path,
        FixesOrder(
            place=require_on_map(where.map, question.pose),
            heading=float(wrap(where.heading if heading is None else heading)),
            sensor=where.sensor,
            estimator=question.estimator or default,
            triplet=None if question.triplet is None else tuple(question.triplet),
            count=question.n,
            seed=question.seed,
            points=question.points,
            deadline=question.deadline(settings.max_deadline_s),
        ),
    )
    return json_response({"map": where.map.id, **found})


@router.post(
    "/localize",
    responses={
        200: answer(answers_places.Localized, "The pose, or why there is none: see `status`."),
        **problems(*_CODES),
    },
)
def localize(question: LocalizeIn, service: Service_) -> Response:
    """Where a robot is that measured three or more landmarks, and how well that is known.

    By weighted least squares over all of them; landmarks with a survey sigma count less the nearer they are.
    `ambiguous` with `suspects`: somebody misread a landmark.
    """
    count = len(question.bearings or question.columns or ())
    place = "#/bearings" if question.bearings is not None else "#/columns"
    limit = service.settings.max_bearings
    require_limit("measured landmarks", count, limit, "SUREPATH_MAX_BEARINGS", place)
    where = where_of(service, question)
    if question.columns is not None and isinstance(where.sensor, OmnidirectionalSensor):
        raise InvalidRequest("This sensor has no image columns; send bearings.", place="#/columns")
    order = question.to_order(where.sensor, question.deadline(service.settings.max_deadline_s))
    return json_response({"map": where.map.id, **service.pool.ask_map(where.path, order)})
