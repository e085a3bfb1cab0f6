"""Uncertainty fields: order, list, read, ask for values."""

from __future__ import annotations

import math
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.responses import Response

from api import answers
from api.caching import HOUR, IMMUTABLE, REVALIDATE, conditional, etag_of
from api.codec import to_json_bytes
from api.codec_records import field_to_json, ordered_to_json
from api.dependencies import Service, Service_
from api.field_views import point_of
from api.place_orders import RankingOrder
from api.routes.common import NOT_MODIFIED, answer, json_response, problems
from api.routes.places import require_ranking
from api.schemas import FieldIn
from api.schemas_base import Finite
from api.schemas_places import DEFAULT_DEADLINE_S
from api.store_records import FieldRecord, FieldStatus

router = APIRouter(prefix="/v1/fields", tags=["fields"])
#: Part of every point's tag: changes when the same question gives another answer.
POINTS = 3


@router.post(
    "",
    status_code=202,
    responses={
        202: answer(answers.FieldOrdered, "Accepted; `Location` is the job, which tells the progress."),
        200: answer(answers.FieldOrdered, "The field is there already."),
        **problems(
            "malformed_body",
            "not_found",
            "too_large",
            "unsupported_media",
            "limit_exceeded",
            "invalid_sensor",
            "too_few_landmarks",
            "storage_full",
            "store_unavailable",
        ),
    },
)
def order_field(order: FieldIn, service: Service_) -> Response:
    """Compute the field of a map for a sensor: for every cell the covariance of a fix there.

    The fix is that of the best landmark triplet, or of all landmarks in view (`estimator`).

    The same order never computes twice: it leads to the existing field or its running job.
    """
    record, job = service.jobs.submit_field(
        service.store.map(order.map).id,
        order.to_sensor(),
        order.resolution_m,
        order.heading_rad,
        method=order.to_method(),
        headings=order.headings,
    )
    body = ordered_to_json(record, job)
    if job is None:
        return json_response(body, headers={"Location": f"/v1/fields/{record.id}"})
    return json_response(body, status=202, headers={"Location": f"/v1/jobs/{job.id}"})


@router.get("", responses={200: answer(answers.Fields, "Newest first."), **problems("store_unavailable")})
def list_fields(
    service: Service_,
    map: Annotated[str | None, Query(max_length=200, description="Only fields of this map.")] = None,  # noqa: A002
) -> Response:
    """All fields, ready or not."""
    records = service.store.fields(None if map is None else service.store.map(map).id)
    return json_response({"fields": [field_to_json(r) for r in reversed(records)]})


@router.get(
    "/{field}",
    responses={
        200: answer(answers.UncertaintyField, "The field without its numbers."),
        **NOT_MODIFIED,
        **problems("not_found", "store_unavailable"),
    },
)
def read_field(field: str, request: Request, service: Service_) -> Response:
    """Sensor, grid, state and links of a field. Immutable once it is ready."""
    record = service.store.field(field)
    body = to_json_bytes(field_to_json(record))
    kept = IMMUTABLE if record.status is FieldStatus.READY else REVALIDATE
    return conditional(request, etag_of(body), kept, lambda: Response(body, media_type="application/json"))


@router.delete(
    "/{field}", status_code=204, responses={**problems("not_found", "in_use", "store_unavailable")}
)
def delete_field(field: str, service: Service_) -> Response:
    """Delete a field and its numbers; refused while a job computes it."""
    service.store.delete_field(field)
    return Response(status_code=204)


@router.get(
    "/{field}/point",
    responses={
        200: answer(answers.PointValue, "Values, or why there are none."),
        **NOT_MODIFIED,
        **problems(
            "not_found", "field_not_ready", "limit_exceeded", "deadline_exceeded", "store_unavailable"
        ),
    },
)
def read_point(
    field: str,
    x_m: Annotated[Finite, Query(description="x in the map frame, m.", examples=[30.0])],
    y_m: Annotated[Finite, Query(description="y in the map frame, m.", examples=[20.0])],
    request: Request,
    service: Service_,
    theta_rad: Annotated[
        float | None,
        Query(
            ge=-2 * math.pi,
            le=2 * math.pi,
            allow_inf_nan=False,
            description="Heading, of a field over headings: the nearest one; default: the best one there.",
        ),
    ] = None,
    ranking: Annotated[
        int | None,
        Query(
            ge=1,
            le=10_000,
            description="So many triplets, best first, with every landmark's status and the reason of a bad "
            "place; see max_ranking.",
            examples=[10],
        ),
    ] = None,
) -> Response:
    """Metrics, covariance, validity and best triplet at a place; outside and on obstacles it says so.

    With `ranking`: the triplets of the cell's middle by the field's criterion (for a field of all landmarks
    in view too), what keeps the other landmarks out, and where they stand, to draw sight lines.
    """
    record = service.store.ready_field(field)
    if ranking is not None:
        require_ranking(ranking, service.settings.max_ranking, "ranking")

    def make() -> Response:
        values = service.store.load_field(record.id)
        value = point_of(values, x_m, y_m, theta_rad)
        if ranking is not None and (cell := value["cell"]) is not None:
            at = (cell["row"], cell["column"])
            value["ranking"] = _ranking(service, record, at, value["heading_rad"], ranking)
        return json_response({"field": record.id, **value})

    return conditional(request, etag_of("point", POINTS, record.id, x_m, y_m, theta_rad, ranking), HOUR, make)


def _ranking(
    service: Service, record: FieldRecord, cell: tuple[int, int], heading: float, count: int
) -> dict[str, Any]:
    """The ranking at the middle of a cell, where the field's own numbers hold."""
    x, y = record.frame.centres(slice(cell[0], cell[0] + 1), slice(cell[1], cell[1] + 1))[0, 0].tolist()
    order = RankingOrder(
        place=(x, y),
        heading=heading,
        sensor=record.sensor,
        count=count,
        criterion=record.method.criterion,
        deadline=min(DEFAULT_DEADLINE_S, service.settings.max_deadline_s),
    )
    found = service.pool.ask_map(service.store.map_path(record.map_id), order)
    del found["asked"]
    return found
