"""The OpenAPI document: FastAPI's, with our problem document in place of its own error model."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.openapi.utils import get_openapi
from starlette.responses import Response

from api.answers import Problem
from api.caching import REVALIDATE, conditional, etag_of
from api.codec import to_json_bytes
from api.codec_plan import engine_version

VERSION = engine_version()
SUMMARY = "Paths for mobile robots that know how well the robot will know where it is."
DESCRIPTION = """
**In three steps**

1. `POST /v1/maps`: a floor with landmarks (the *warehouse* is there already).
2. `POST /v1/fields`: for every place of the floor, how well a robot with this sensor would know its position
   from the best three landmarks in view. A job; watch `GET /v1/jobs/{job}`.
3. `POST /v1/plans`: a path on which the robot stays certain of its position, beside the shortest one.

**Conventions.** Metres, seconds, radians; names carry the unit (`_m`, `_s`, `_rad`, `_m2`); `_deg` only in
sensors. The map frame is ROS's: x to the right, y up, angles counter-clockwise. Unknown numbers are `null`.
PNG: top row is the highest y; npy: row 0 is the lowest y.

**Outcomes are answers.** `no_path`, `timeout` and `risk_unmet` come with status 200. A mistake in the request
is a problem document (`application/problem+json`, RFC 9457) with a stable `code`; see
[the list](/docs/problems).

**Identity.** Maps, fields and plans are named by a hash of their content: the same input never computes
twice, and answers carry ETags.
"""
TAGS: list[dict[str, Any]] = [
    {
        "name": "maps",
        "description": "Floors with landmarks. Immutable; a name stands for the newest version.",
    },
    {"name": "fields", "description": "Localization uncertainty of every place of a map for a sensor."},
    {"name": "heatmaps", "description": "Fields as pictures and arrays."},
    {"name": "plans", "description": "Paths through a field."},
    {
        "name": "places",
        "description": "Which landmarks serve at a pose, and where a robot is that sees them.",
    },
    {"name": "jobs", "description": "Computations that take a while."},
    {"name": "service", "description": "Health, limits, versions."},
]

router = APIRouter(include_in_schema=False)


def document(app: FastAPI) -> dict[str, Any]:
    """The document, made once."""
    if app.openapi_schema is None:
        made = get_openapi(
            title=app.title,
            version=app.version,
            summary=app.summary,
            description=app.description,
            tags=app.openapi_tags,
            license_info=app.license_info,
            routes=app.routes,
        )
        schemas = made["components"]["schemas"]
        for name in ("HTTPValidationError", "ValidationError"):
            schemas.pop(name, None)
        schemas["Problem"] = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        app.openapi_schema = made
    return app.openapi_schema


@router.get("/openapi.json")
def openapi_json(request: Request) -> Response:
    """The document."""
    body = to_json_bytes(document(request.app))
    return conditional(
        request, etag_of(body), REVALIDATE, lambda: Response(body, media_type="application/json")
    )
