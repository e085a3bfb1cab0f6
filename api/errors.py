"""The one table from exceptions to HTTP status and code, and the problem document (RFC 9457)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

import localization.errors as localization
import maps.errors as maps
import planner.errors as planner
from api import settings
from api import store_records as store
from api import worker_process as worker
from api.canvas import InvalidPicture
from api.codec import DocumentError, to_json_bytes
from api.schemas_sensor import SENSOR_TAGS

PROBLEM_MEDIA_TYPE = "application/problem+json"
RETRY_AFTER_S = "2"
_MAX_ERRORS = 20

#: code -> (HTTP status, title). Codes never change their meaning.
CODES: dict[str, tuple[int, str]] = {
    "malformed_body": (400, "The body cannot be read"),
    "not_found": (404, "There is no such thing"),
    "method_not_allowed": (405, "This address does not take that method"),
    "field_not_ready": (409, "The field is not computed yet"),
    "in_use": (409, "Something else still needs it"),
    "job_ended": (409, "The job has already ended"),
    "version_changed": (412, "It was changed by somebody else meanwhile"),
    "too_large": (413, "The request is too large"),
    "unsupported_media": (415, "The content type is not one of those taken here"),
    "invalid_request": (422, "The request is not valid"),
    "limit_exceeded": (422, "A limit of this service is exceeded"),
    "invalid_map": (422, "The map is not usable"),
    "invalid_geometry": (422, "The geometry makes no sense"),
    "invalid_landmark": (422, "A landmark is wrong"),
    "duplicate_landmark": (422, "Two landmarks are the same"),
    "landmark_outside_map": (422, "A landmark stands outside the map"),
    "too_few_landmarks": (422, "A fix needs three landmarks"),
    "invalid_sensor": (422, "The sensor is impossible"),
    "invalid_picture": (422, "The picture cannot be made as asked"),
    "start_outside_map": (422, "Start is not on the map"),
    "goal_outside_map": (422, "Goal is not on the map"),
    "start_occupied": (422, "The robot does not fit at the start"),
    "goal_occupied": (422, "The robot does not fit at the goal"),
    "via_outside_map": (422, "A via point is not on the map"),
    "via_occupied": (422, "The robot does not fit at a via point"),
    "if_match_required": (428, "If-Match is needed here"),
    "overloaded": (503, "The service is busy"),
    "deadline_exceeded": (503, "Nothing was ready at the deadline"),
    "store_unavailable": (503, "The store does not answer"),
    "internal": (500, "The service failed"),
    "storage_full": (507, "The storage is full"),
}

_OF_STATUS = {
    400: "malformed_body",
    404: "not_found",
    405: "method_not_allowed",
    413: "too_large",
    415: "unsupported_media",
    503: "overloaded",
}


class InvalidRequest(maps.SurepathError):
    """A parameter or a part of a request is wrong.

    Attributes
    ----------
    place
        ``#/…`` for a part of the body, else the name of a parameter.
    """

    def __init__(self, message: str, *, place: str | None = None) -> None:
        super().__init__(message)
        self.place = place


class UnsupportedMedia(maps.SurepathError):
    """A file or body is of a kind that is not taken here."""


class Busy(maps.SurepathError):
    """Too many requests want the processor at once."""


class IfMatchRequired(maps.SurepathError):
    """A change that must say what it was made from."""


class JobEnded(maps.SurepathError):
    """A job that has ended cannot be dismissed."""


#: exception -> code, and the place in the request that it is about.
TABLE: dict[type[Exception], tuple[str, str | None]] = {
    DocumentError: ("malformed_body", None),
    UnsupportedMedia: ("unsupported_media", None),
    settings.LimitExceeded: ("limit_exceeded", None),
    worker.DeadlineExceeded: ("deadline_exceeded", "#/deadline_s"),
    worker.WorkerError: ("overloaded", None),
    Busy: ("overloaded", None),
    JobEnded: ("job_ended", None),
    IfMatchRequired: ("if_match_required", None),
    store.NotFound: ("not_found", None),
    store.InUse: ("in_use", None),
    store.FieldNotReady: ("field_not_ready", None),
    store.VersionChanged: ("version_changed", None),
    store.StorageFull: ("storage_full", None),
    store.StoreUnavailable: ("store_unavailable", None),
    maps.MapTooLarge: ("too_large", None),
    maps.InvalidGeometry: ("invalid_geometry", None),
    maps.DuplicateLandmark: ("duplicate_landmark", None),
    maps.LandmarkOutsideMap: ("landmark_outside_map", None),
    maps.InvalidLandmark: ("invalid_landmark", None),
    maps.TooFewLandmarks: ("too_few_landmarks", None),
    maps.MapError: ("invalid_map", None),
    localization.InvalidSensor: ("invalid_sensor", "#/sensor"),
    localization.FieldTooLarge: ("limit_exceeded", "#/resolution_m"),
    localization.FieldFormatError: ("store_unavailable", None),
    localization.LocalizationError: ("invalid_request", None),
    InvalidPicture: ("invalid_picture", None),
    planner.StartOutsideMap: ("start_outside_map", "#/start"),
    planner.GoalOutsideMap: ("goal_outside_map", "#/goal"),
    planner.StartOccupied: ("start_occupied", "#/start"),
    planner.GoalOccupied: ("goal_occupied", "#/goal"),
    planner.ViaOutsideMap: ("via_outside_map", "#/via"),
    planner.ViaOccupied: ("via_occupied", "#/via"),
    planner.PlannerError: ("invalid_request", None),
    maps.SurepathError: ("invalid_request", None),
}


@dataclass(frozen=True)
class Problem:
    """A problem document before it is sent.

    Attributes
    ----------
    code
        Key of :data:`CODES`.
    detail
        What is wrong here, in words.
    errors
        Places in the request: ``{"pointer": "#/goal", "detail": …}`` or ``{"parameter": …, …}``.
    hint
        What would help: ``nearest_free``; ``job`` to wait for; ``map``, the newest version; ``order``, a body
        for ``POST /v1/fields``.
    limit, requested, setting
        The limit that is exceeded, by what, and the setting that moves it.
    headers
        Further headers of the answer.
    """

    code: str
    detail: str
    errors: Sequence[Mapping[str, str]] = ()
    hint: Mapping[str, Any] = field(default_factory=dict)
    limit: float | None = None
    requested: float | None = None
    setting: str | None = None
    headers: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of_code(cls, code: str, detail: str, **more: Any) -> Problem:
        """A problem with the headers that its status wants."""
        if CODES[code][0] == 503:
            more["headers"] = {**more.get("headers", {}), "Retry-After": RETRY_AFTER_S}
        return cls(code, detail, **more)

    @classmethod
    def of_exception(cls, error: Exception) -> Problem:
        """The problem that an exception is; unknown ones are ``internal`` and keep their words inside."""
        if isinstance(error, RequestValidationError):
            return _of_validation(error)
        if isinstance(error, HTTPException):
            return _of_http(error)
        for kind in type(error).__mro__:
            if kind in TABLE:
                code, place = TABLE[kind]
                break
        else:
            return cls.of_code("internal", "Something failed inside the service; its log knows more.")
        detail = str(error)
        place = getattr(error, "place", None) or place
        more: dict[str, Any] = {}
        if place is not None:
            key = "pointer" if place.startswith("#") else "parameter"
            more["errors"] = [{key: place, "detail": detail}]
        more.update(
            {k: v for k in ("limit", "requested", "setting") if (v := getattr(error, k, None)) is not None}
        )
        if (free := getattr(error, "nearest_free", None)) is not None:
            more["hint"] = {"nearest_free": {"x_m": free[0], "y_m": free[1]}}
        if (job := getattr(error, "job", None)) is not None:
            more["hint"] = {"job": f"/v1/jobs/{job}"}
        if (newest := getattr(error, "newest", None)) is not None:
            more["hint"] = {"map": f"/v1/maps/{newest}"}
        if (order := getattr(error, "order", None)) is not None:
            more["hint"] = {**more.get("hint", {}), "order": order}
        return cls.of_code(code, detail, **more)

    @property
    def status(self) -> int:
        """HTTP status."""
        return CODES[self.code][0]

    def document(self, instance: str, request_id: str) -> dict[str, Any]:
        """The members of RFC 9457 and ours."""
        status, title = CODES[self.code]
        return {
            "type": f"/docs/problems#{self.code}",
            "title": title,
            "status": status,
            "code": self.code,
            "detail": self.detail,
            "instance": instance,
            "request_id": request_id,
            "errors": [dict(e) for e in self.errors],
            "hint": dict(self.hint),
            "limit": self.limit,
            "requested": self.requested,
            "setting": self.setting,
        }

    def response(self, instance: str, request_id: str) -> Response:
        """The answer."""
        return Response(
            to_json_bytes(self.document(instance, request_id)),
            status_code=self.status,
            media_type=PROBLEM_MEDIA_TYPE,
            headers={"Cache-Control": "no-store", **self.headers},
        )


def _of_http(error: HTTPException) -> Problem:
    code = _OF_STATUS.get(error.status_code, "invalid_request" if error.status_code < 500 else "internal")
    return Problem.of_code(code, str(error.detail), headers=dict(error.headers or {}))


def _of_validation(error: RequestValidationError) -> Problem:
    """Places and words of a validation error, never the values that were sent."""
    found = error.errors()
    if any(e["type"] == "json_invalid" for e in found):
        place = next((e["loc"][-1] for e in found if isinstance(e["loc"][-1], int)), 0)
        return Problem.of_code("malformed_body", f"The body is not JSON: it breaks at character {place}.")
    errors = [_place(e["loc"], str(e["msg"])) for e in found[:_MAX_ERRORS]]
    first = errors[0]
    where = first.get("pointer") or first.get("parameter", "")
    more = f" ({len(found) - 1} more)" if len(found) > 1 else ""
    return Problem.of_code("invalid_request", f"{where}: {first['detail']}{more}", errors=errors)


def _place(loc: Sequence[Any], message: str) -> dict[str, str]:
    words = message.removeprefix("Value error, ")[:300]
    parts = [str(p)[:80] for p in loc]
    if parts and parts[0] == "body":
        # Inside a tagged union pydantic puts the tag into the place, where the document has nothing.
        inner = [p for before, p in pairwise(parts) if not (before == "sensor" and p in SENSOR_TAGS)]
        pointer = "#" + "".join("/" + p.replace("~", "~0").replace("/", "~1") for p in inner)
        return {"pointer": pointer, "detail": words}
    return {"parameter": parts[-1] if parts else "", "detail": words}
