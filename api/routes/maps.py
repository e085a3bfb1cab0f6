"""Maps: upload, list, read, delete."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request
from starlette.responses import Response

from api import answers
from api.caching import IMMUTABLE, REVALIDATE, conditional, etag_of
from api.codec import to_json_bytes
from api.codec_records import landmarks_to_json, map_to_json
from api.dependencies import Service_
from api.errors import InvalidRequest
from api.render import map_png
from api.routes.common import NOT_MODIFIED, answer, binary, json_response, problems
from api.store_records import MapRecord
from api.uploads import Upload, read_upload
from maps.check import check_world
from maps.io.world_file import world_to_geojson

UPLOAD_PATH = "/v1/maps"
RENDERER = 1

router = APIRouter(prefix=UPLOAD_PATH, tags=["maps"])
_READ = problems("not_found", "store_unavailable")
_FILE = {"type": "string", "format": "binary"}
_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {
                "schema": {
                    "type": "object",
                    "description": "world.geojson: a FeatureCollection in map metres. Polygons are floor or "
                    "obstacle, points are landmarks.",
                },
                "example": {
                    "type": "FeatureCollection",
                    "name": "room",
                    "features": [
                        {
                            "type": "Feature",
                            "properties": {"kind": "floor"},
                            "geometry": {
                                "type": "Polygon",
                                "coordinates": [[[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]],
                            },
                        },
                        *(
                            {
                                "type": "Feature",
                                "properties": {"kind": "landmark", "id": name},
                                "geometry": {"type": "Point", "coordinates": place},
                            }
                            for name, place in (("A", [0.5, 0.5]), ("B", [7.5, 0.5]), ("C", [4, 5.5]))
                        ),
                    ],
                },
            },
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["image", "meta"],
                    "additionalProperties": False,
                    "properties": {
                        "image": {**_FILE, "description": "PNG or PGM of a ROS map_server map."},
                        "meta": {**_FILE, "description": "Its map.yaml, or the same as JSON."},
                        "landmarks": {
                            **_FILE,
                            "description": "GeoJSON, CSV (id,x,y,…) or YAML, in map metres.",
                        },
                        "name": {"type": "string", "maxLength": 200},
                        "unknown_is_free": {"type": "boolean", "default": False},
                        "unknown_is_opaque": {"type": "boolean", "default": False},
                    },
                }
            },
        },
    }
}


@router.post(
    "",
    status_code=201,
    openapi_extra=_BODY,
    responses={
        201: answer(answers.MapUploaded, "Stored; `Location` is the map."),
        200: answer(answers.MapUploaded, "This very map was here already."),
        **problems(
            "malformed_body",
            "too_large",
            "unsupported_media",
            "invalid_map",
            "invalid_geometry",
            "invalid_landmark",
            "duplicate_landmark",
            "landmark_outside_map",
            "limit_exceeded",
            "storage_full",
            "store_unavailable",
        ),
    },
)
def upload_map(upload: Annotated[Upload, Depends(read_upload)], service: Service_) -> Response:
    """Store a floor with landmarks: a world.geojson as JSON, or a ROS map as a form.

    The answer lists what the map check found; only errors of form and number refuse a map.
    """
    world = service.pool.parse(upload)
    record, created = service.store.add_map(world, name=upload.name)
    with service.turn():
        report = check_world(world)
    findings = [{"severity": f.severity, "code": f.code, "message": f.message} for f in report.findings]
    return json_response(
        {**map_to_json(record), "findings": findings},
        status=201 if created else 200,
        headers={"Location": f"{UPLOAD_PATH}/{record.id}"},
    )


@router.get("", responses={200: answer(answers.Maps, "Newest first."), **problems("store_unavailable")})
def list_maps(service: Service_) -> Response:
    """All map versions."""
    return json_response({"maps": [map_to_json(m) for m in reversed(service.store.maps())]})


def _cached(request: Request, record: MapRecord, asked: str, body: bytes, media_type: str) -> Response:
    """An answer that is immutable under the map's id, and may change under its name."""
    kept = IMMUTABLE if asked == record.id else REVALIDATE
    return conditional(request, etag_of(body), kept, lambda: Response(body, media_type=media_type))


@router.get("/{map}", responses={200: answer(answers.Map, "The map."), **NOT_MODIFIED, **_READ})
def read_map(map: str, request: Request, service: Service_) -> Response:  # noqa: A002
    """Bounds, floor, number of landmarks and links of a map, by id or name."""
    record = service.store.map(map)
    return conditional(
        request,
        etag_of(body := to_json_bytes(map_to_json(record))),
        REVALIDATE,
        lambda: Response(body, media_type="application/json"),
    )


@router.get(
    "/{map}/image.png",
    response_class=Response,
    responses={200: binary("image/png", "Floor and landmarks. Top row: highest y."), **NOT_MODIFIED, **_READ},
)
def map_image(map: str, request: Request, service: Service_) -> Response:  # noqa: A002
    """Picture of floor and landmarks."""
    record = service.store.map(map)
    tag = etag_of(record.id, RENDERER, "map.png")

    def make() -> Response:
        png = service.pictures.get(tag)
        if png is None:
            world = service.store.world(record.id)
            with service.turn():
                png = map_png(world)
            service.pictures.put(tag, png)
        return Response(png, media_type="image/png")

    return conditional(request, tag, IMMUTABLE if map == record.id else REVALIDATE, make)


@router.get(
    "/{map}/landmarks", responses={200: answer(answers.Landmarks, "In their order."), **NOT_MODIFIED, **_READ}
)
def map_landmarks(map: str, request: Request, service: Service_) -> Response:  # noqa: A002
    """Ids, places, facing and survey sigma of the landmarks."""
    record = service.store.map(map)
    body = to_json_bytes(landmarks_to_json(service.store.world(record.id), record.id))
    return _cached(request, record, map, body, "application/json")


@router.get(
    "/{map}/world.geojson",
    response_class=Response,
    responses={
        200: {"description": "A world.geojson.", "content": {"application/geo+json": {}}},
        **NOT_MODIFIED,
        **_READ,
    },
)
def map_world(map: str, request: Request, service: Service_) -> Response:  # noqa: A002
    """A map of polygons as it can be uploaded again."""
    record = service.store.map(map)
    if record.kind != "polygons":
        raise InvalidRequest(
            "This map is a grid; world.geojson holds polygons only. See image.png.", place="map"
        )
    body = to_json_bytes(world_to_geojson(service.store.world(record.id)))
    return _cached(request, record, map, body, "application/geo+json")


@router.delete("/{map}", status_code=204, responses=problems("not_found", "in_use", "store_unavailable"))
def delete_map(map: str, service: Service_) -> Response:  # noqa: A002
    """Delete a map; refused while fields stand on it."""
    service.store.delete_map(service.store.map(map).id)
    return Response(status_code=204)
