"""JSON at the doors: sensors in and out, files, numbers without NaN."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn

from pydantic import TypeAdapter, ValidationError

from api.codec_plan import plan_to_json
from api.schemas_sensor import SensorIn
from localization.errors import InvalidSensor
from localization.sensors import Mount, OmnidirectionalSensor, PinholePanSensor, Sensor
from maps.errors import SurepathError

__all__ = [
    "DocumentError",
    "parse_json",
    "plan_to_json",
    "read_json_file",
    "sensor_from_json",
    "sensor_to_json",
    "to_json_bytes",
]

MAX_FILE_BYTES = 1_000_000
MAX_DEPTH = 32
_SENSOR = TypeAdapter[Any](SensorIn)


class DocumentError(SurepathError):
    """A text is not the JSON document that it should be."""


def _refuse_constant(name: str) -> NoReturn:
    raise DocumentError(f"JSON has no {name}; use null or leave the value out.")


def parse_json(data: bytes, *, what: str = "body") -> Any:
    """JSON value of UTF-8 bytes, without NaN and infinities, at most 32 levels deep.

    Raises
    ------
    DocumentError
        If it is not that.
    """
    try:
        value = json.loads(data.decode("utf-8-sig"), parse_constant=_refuse_constant)
    except RecursionError:
        raise DocumentError(f"The {what} is nested too deeply; the limit is {MAX_DEPTH} levels.") from None
    except UnicodeDecodeError as error:
        raise DocumentError(f"The {what} is not UTF-8 text (byte {error.start}).") from None
    except json.JSONDecodeError as error:
        raise DocumentError(
            f"The {what} is not JSON: {error.msg} (line {error.lineno}, column {error.colno})."
        ) from None
    except ValueError:
        raise DocumentError(f"The {what} holds a number with too many digits.") from None
    _check_depth(value, what)
    return value


def _check_depth(value: Any, what: str) -> None:
    level = [value]
    for _ in range(MAX_DEPTH):
        level = [
            child
            for item in level
            if isinstance(item, (dict, list))
            for child in (item.values() if isinstance(item, dict) else item)
            if isinstance(child, (dict, list))
        ]
        if not level:
            return
    raise DocumentError(f"The {what} is nested too deeply; the limit is {MAX_DEPTH} levels.")


def read_json_file(
    path: str | Path, *, what: str = "document", max_bytes: int = MAX_FILE_BYTES
) -> dict[str, Any]:
    """Object in a JSON file of at most ``max_bytes``, by default 1 MB.

    Raises
    ------
    DocumentError
        If there is no such file, or it holds something else.
    """
    place = Path(path)
    try:
        if not place.is_file():
            raise DocumentError(f"There is no {what} at '{place}'.")
        if place.stat().st_size > max_bytes:
            raise DocumentError(f"The {what} '{place}' is larger than {max_bytes} bytes.")
        data = place.read_bytes()
    except OSError as error:
        raise DocumentError(f"Could not read the {what} '{place}': {error.strerror or error}.") from error
    value = parse_json(data, what=f"{what} '{place}'")
    if not isinstance(value, dict):
        raise DocumentError(f"The {what} '{place}' must be a JSON object, in braces.")
    return value


def sensor_from_json(obj: Any) -> Sensor:
    """Sensor from the object that ``POST /v1/fields`` takes (SERVICE §5).

    Examples
    --------
    >>> given = {"kind": "omnidirectional", "bearing_sigma_rad": 0.002, "mount": {"x_m": 0.2}}
    >>> sensor_from_json(given).mount
    Mount(x=0.2, y=0.0, theta=0.0)

    Raises
    ------
    InvalidSensor
        If a name is unknown or missing, or a number impossible.
    """
    try:
        return _SENSOR.validate_python(obj).to_sensor()  # type: ignore[no-any-return]
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        value = first["input"]
        given = "" if isinstance(value, (dict, list)) else f" is {repr(value)[:40]}"
        # The first part of a place inside a tagged union is the tag.
        place = ".".join(str(p)[:80] for p in first["loc"][1:])
        words = first["msg"].removeprefix("Value error, ")
        raise InvalidSensor(f"Sensor{' ' + place if place else ''}{given}: {words}.") from None


def sensor_to_json(sensor: Sensor) -> dict[str, Any]:
    """Inverse of :func:`sensor_from_json`, bit for bit (hence in rad)."""
    common = {
        "bearing_floor_rad": sensor.bearing_floor,
        "min_range_m": sensor.min_range,
        "max_range_m": None if math.isinf(sensor.max_range) else sensor.max_range,
        "mount": _mount_to_json(sensor.mount),
    }
    if isinstance(sensor, OmnidirectionalSensor):
        muted = [{"begin_rad": begin, "end_rad": end} for begin, end in sensor.muted]
        return {"kind": sensor.kind, "bearing_sigma_rad": sensor.bearing_sigma, "muted": muted, **common}
    camera = {
        "kind": sensor.kind,
        "fov_rad": sensor.field_of_view,
        "focal_px": sensor.focal_px,
        "column_sigma_px": sensor.column_sigma_px,
    }
    if isinstance(sensor, PinholePanSensor):
        camera |= {
            "pan_min_rad": sensor.pan_min,
            "pan_max_rad": sensor.pan_max,
            "pan_policy": sensor.pan_policy,
        }
    return {**camera, **common}


def _mount_to_json(mount: Mount) -> dict[str, float]:
    return {"x_m": mount.x, "y_m": mount.y, "theta_rad": mount.theta}


def to_json_bytes(value: Any) -> bytes:
    """Compact JSON; ASCII, so that no text of a caller can fail to encode; NaN is a bug and raises."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode("ascii")
