"""Uploads of maps: the parts of a request, and the world that they make."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath
from typing import Literal

from fastapi import Request
from python_multipart.exceptions import FormParserError
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException

from api.errors import InvalidRequest, UnsupportedMedia

LandmarkFormat = Literal["geojson", "csv", "yaml"]
PARTS = ("image", "meta", "landmarks")
OPTIONS = ("name", "unknown_is_free", "unknown_is_opaque")
_MAX_PART = 1_000_000
_MAX_NAME = 200
_FORMATS: dict[str, LandmarkFormat] = {
    ".geojson": "geojson",
    ".json": "geojson",
    ".csv": "csv",
    ".txt": "csv",
    ".yaml": "yaml",
    ".yml": "yaml",
}
_TYPES: dict[str, LandmarkFormat] = {
    "application/geo+json": "geojson",
    "application/json": "geojson",
    "text/csv": "csv",
    "application/yaml": "yaml",
    "application/x-yaml": "yaml",
    "text/yaml": "yaml",
}


@dataclass(frozen=True, slots=True)
class Upload:
    """What was sent, not looked into yet.

    Attributes
    ----------
    world
        A world.geojson; None for an image.
    image, meta
        PNG or PGM, and the text of its map.yaml (or the same as JSON).
    landmarks, landmark_format
        Landmarks of the image; None without any.
    name
        Label to store it under; None takes the document's own.
    unknown_is_free, unknown_is_opaque
        Meaning of unknown cells.
    """

    world: bytes | None = None
    image: bytes | None = None
    meta: str | None = None
    landmarks: bytes | None = None
    landmark_format: LandmarkFormat = "geojson"
    name: str | None = None
    unknown_is_free: bool = False
    unknown_is_opaque: bool = False


async def read_upload(request: Request) -> Upload:
    """The parts of ``POST /v1/maps``; options of a JSON body stand in the query.

    Raises
    ------
    InvalidRequest
        If a part is missing, unknown or given twice.
    UnsupportedMedia
        If the kind of the landmarks cannot be told.
    """
    media = request.headers.get("content-type", "").split(";")[0].strip().lower()
    if media != "multipart/form-data":
        if unknown := sorted(set(request.query_params) - {"name"}):
            raise InvalidRequest("A JSON world takes no option but name.", place=unknown[0][:80])
        return Upload(world=await request.body(), name=_name(request.query_params.get("name")))
    try:
        form = await request.form(max_files=len(PARTS), max_fields=8, max_part_size=_MAX_PART)
    except (FormParserError, ValueError, UnicodeError, LookupError) as error:
        raise HTTPException(400, f"The form cannot be read: {str(error)[:200]}") from error
    try:
        return await _of_form(form)
    finally:
        await form.close()


async def _of_form(form: FormData) -> Upload:
    for key in form:
        if key not in PARTS + OPTIONS:
            raise InvalidRequest(
                f"There is no part '{key[:80]}'; the parts are {', '.join(PARTS + OPTIONS)}."
            )
        if len(form.getlist(key)) > 1:
            raise InvalidRequest(f"The part '{key}' is given twice.", place=f"#/{key}")
    image, meta, landmarks = [await _bytes(form, key) for key in PARTS]
    for key, value in (("image", image), ("meta", meta)):
        if value is None:
            raise InvalidRequest(
                f"The part '{key}' is missing; send image (PNG or PGM) and meta (map.yaml or JSON).",
                place=f"#/{key}",
            )
    try:
        text = (meta or b"").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidRequest("The part 'meta' is not UTF-8 text.", place="#/meta") from None
    return Upload(
        image=image,
        meta=text,
        landmarks=landmarks,
        landmark_format="geojson" if landmarks is None else _format(form["landmarks"], landmarks),
        name=_name(_option(form, "name")),
        unknown_is_free=_flag(form, "unknown_is_free"),
        unknown_is_opaque=_flag(form, "unknown_is_opaque"),
    )


async def _bytes(form: FormData, key: str) -> bytes | None:
    part = form.get(key)
    if part is None:
        return None
    return await part.read() if isinstance(part, UploadFile) else part.encode("utf-8", "replace")


def _option(form: FormData, key: str) -> str | None:
    value = form.get(key)
    if isinstance(value, UploadFile):
        raise InvalidRequest(f"The part '{key}' must be plain text, not a file.", place=f"#/{key}")
    return value


def _flag(form: FormData, key: str) -> bool:
    value = _option(form, key)
    if value not in {None, "true", "false"}:
        raise InvalidRequest(f"The part '{key}' must be true or false.", place=f"#/{key}")
    return value == "true"


def _name(value: str | None) -> str | None:
    if value is None or value == "":
        return None
    if len(value) > _MAX_NAME or not value.isprintable():
        raise InvalidRequest(f"The name must have at most {_MAX_NAME} printable characters.", place="name")
    if value.startswith("m_"):
        raise InvalidRequest("A name must not start with m_: ids do.", place="name")
    return value


def _format(part: UploadFile | str, data: bytes) -> LandmarkFormat:
    """Kind of a landmark part: by its file name, its content type, or how it begins."""
    if isinstance(part, UploadFile):
        if found := _FORMATS.get(PurePath(part.filename or "").suffix.lower()):
            return found
        if found := _TYPES.get((part.content_type or "").split(";")[0].strip().lower()):
            return found
    start = data.lstrip(b"\xef\xbb\xbf \t\r\n")[:200]
    if start.startswith(b"{"):
        return "geojson"
    first = start.split(b"\n")[0]
    if b"," in first and b":" not in first:
        return "csv"
    if b":" in first or start.startswith((b"-", b"#")):
        return "yaml"
    raise UnsupportedMedia("The kind of the landmarks cannot be told; name the file .geojson, .csv or .yaml.")
