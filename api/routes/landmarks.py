"""Maps that change: other landmarks make another version; and where on a map a robot can stand."""

from __future__ import annotations

import math
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request
from starlette.responses import Response

from api import answers
from api.caching import HOUR, conditional, etag_of, if_match
from api.codec import to_json_bytes
from api.codec_records import landmarks_to_json, map_to_json
from api.dependencies import Service_
from api.errors import IfMatchRequired
from api.place_orders import SnapOrder
from api.routes.common import NOT_MODIFIED, answer, json_response, problems
from api.routes.maps import UPLOAD_PATH
from api.schemas_base import Finite
from api.schemas_landmarks import LandmarksIn
from api.schemas_places import DEFAULT_DEADLINE_S
from api.settings import LimitExceeded
from api.store_records import VersionChanged
from maps.check import check_world
from maps.grid import MAX_COORDINATE_M
from maps.world import World

router = APIRouter(prefix=UPLOAD_PATH, tags=["maps"])
_SNAPS = 1
Coordinate = Annotated[Finite, Query(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]


def landmarks_tag(world: World, map_id: str) -> str:
    """Entity tag of ``GET …/landmarks``: what If-Match must hold."""
    return etag_of(to_json_bytes(landmarks_to_json(world, map_id)))


@router.put(
    "/{map}/landmarks",
    status_code=201,
    responses={
        201: answer(answers.MapEdited, "The new version; `Location` is its address."),
        200: answer(answers.MapEdited, "These landmarks were on this floor before."),
        **problems(
            "malformed_body",
            "not_found",
            "version_changed",
            "too_large",
            "unsupported_media",
            "invalid_landmark",
            "duplicate_landmark",
            "landmark_outside_map",
            "limit_exceeded",
            "if_match_required",
            "storage_full",
            "store_unavailable",
        ),
    },
)
def put_landmarks(
    map: str,  # noqa: A002
    wanted: LandmarksIn,
    request: Request,
    service: Service_,
    if_match_: Annotated[  # noqa: ARG001  (declared for the document; read from the request)
        str | None,
        Header(
            alias="If-Match",
            max_length=1000,
            description="ETag of GET on this address, so that nobody's change is lost; `*`: any.",
        ),
    ] = None,
    name: Annotated[
        str | None,
        Query(
            min_length=1,
            max_length=200,
            description="Another name for the new version; default: the map's own, which then stands for it.",
        ),
    ] = None,
) -> Response:
    """Put all landmarks of a map in place: a new version of the map, with this one as its parent.

    Versions never change: fields of this one stay as they are, the new one has none yet. Without `name` the
    map must be what its name stands for, else another version was made meanwhile (412).
    """
    record = service.store.map(map)
    if (held := if_match(request)) is None:
        raise IfMatchRequired(
            "Send If-Match with the ETag of GET on this address, so that nobody's change is lost."
        )
    world = service.store.world(record.id)
    if not held(landmarks_tag(world, record.id)) or wanted.map not in {None, record.id}:
        raise VersionChanged(
            f"The landmarks of '{record.name}' are not those that were changed; GET them again.",
            newest=record.id,
        )
    limit = service.settings.max_landmarks
    if len(wanted.landmarks) > limit:
        raise LimitExceeded(
            f"{len(wanted.landmarks)} landmarks are sent, the limit is {limit} (SUREPATH_MAX_LANDMARKS).",
            limit=limit,
            requested=len(wanted.landmarks),
            setting="SUREPATH_MAX_LANDMARKS",
            place="#/landmarks",
        )
    with service.turn():
        changed = world.with_landmarks(wanted.to_landmarks())
        made, created = service.store.add_map(
            changed,
            name=name or record.name,
            parent=record.id,
            only_if=record.id if name in {None, record.name} else None,
        )
        report = check_world(changed)
    findings = [{"severity": f.severity, "code": f.code, "message": f.message} for f in report.findings]
    tag = landmarks_tag(changed, made.id)
    return json_response(
        {**map_to_json(made), "findings": findings, "landmarks_etag": f'"{tag}"'},
        status=201 if created else 200,
        headers={"Location": f"{UPLOAD_PATH}/{made.id}"},
    )


@router.get(
    "/{map}/snap",
    responses={
        200: answer(answers.Snapped, "The nearest place, or that there is none."),
        **NOT_MODIFIED,
        **problems("not_found", "deadline_exceeded", "store_unavailable"),
    },
)
def snap(
    map: str,  # noqa: A002
    x_m: Annotated[Coordinate, Query(description="x in the map frame, m.", examples=[30.0])],
    y_m: Annotated[Coordinate, Query(description="y in the map frame, m.", examples=[20.0])],
    request: Request,
    service: Service_,
    radius_m: Annotated[
        float, Query(ge=0, le=1000, allow_inf_nan=False, description="Of the robot, m.", examples=[0.35])
    ] = 0.0,
    theta_rad: Annotated[
        float | None,
        Query(ge=-2 * math.pi, le=2 * math.pi, allow_inf_nan=False, description="Comes back, wrapped."),
    ] = None,
) -> Response:
    """The nearest pose at which a robot, as a disc, fits: where a click on a wall was meant to be.

    A nearer place that is smaller than a cell of a grid of 500 × 500 over the map can be missed.
    """
    record = service.store.map(map)

    def make() -> Response:
        order = SnapOrder(
            place=(x_m, y_m),
            heading=theta_rad,
            radius=radius_m,
            deadline=min(DEFAULT_DEADLINE_S, service.settings.max_deadline_s),
        )
        found = service.pool.ask_map(service.store.map_path(record.id), order)
        return json_response({"map": record.id, **found})

    return conditional(request, etag_of("snap", _SNAPS, record.id, x_m, y_m, radius_m, theta_rad), HOUR, make)
