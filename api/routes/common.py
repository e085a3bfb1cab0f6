"""What the routes share: JSON answers and the errors that each documents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from starlette.responses import Response

from api.codec import to_json_bytes
from api.errors import CODES, PROBLEM_MEDIA_TYPE

_ALWAYS = ("invalid_request", "internal", "overloaded")


def json_response(value: Any, *, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """A value as JSON; a NaN in it is a bug and raises."""
    return Response(
        to_json_bytes(value), status_code=status, media_type="application/json", headers=dict(headers or {})
    )


def problems(*codes: str) -> dict[int | str, dict[str, Any]]:
    """OpenAPI entries of the errors that a route may answer with, by their codes."""
    by_status: dict[int, list[str]] = {}
    for code in (*codes, *_ALWAYS):
        by_status.setdefault(CODES[code][0], []).append(code)
    content = {PROBLEM_MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {
        status: {"description": "code " + " or ".join(sorted(set(found))), "content": content}
        for status, found in sorted(by_status.items())
    }


def answer(model: type[Any], description: str) -> dict[str, Any]:
    """OpenAPI entry of a JSON answer."""
    return {"model": model, "description": description}


def binary(media_type: str, description: str) -> dict[str, Any]:
    """OpenAPI entry of an answer that is a file."""
    return {
        "description": description,
        "content": {media_type: {"schema": {"type": "string", "format": "binary"}}},
    }


NOT_MODIFIED: dict[int | str, dict[str, Any]] = {304: {"description": "The client's copy is still right."}}
