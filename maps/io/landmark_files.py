"""Landmarks from files of their own: CSV, YAML or GeoJSON, in metres of the map frame.

A landmark has ``id``, ``x``, ``y`` (or ``x_m``, ``y_m``) and, if wanted, ``facing_rad`` or ``facing_deg``,
``half_angle_rad`` or ``half_angle_deg``, ``sigma_m``. CSV has these names in its first line and commas,
semicolons or tabs between them (with semicolons, decimal commas are read too); YAML is a list of such
mappings, alone or as ``landmarks``, or a point map of a laser scanner (``features`` with ``position``);
GeoJSON is a FeatureCollection of Points. Other names are refused: a misspelt one is not a default.
"""

from __future__ import annotations

import csv
import io
import math
import re
from pathlib import Path
from typing import Any, Literal, get_args

from maps.errors import InvalidLandmark, MapError, MapFormatError, MapTooLarge
from maps.io.strict import (
    check_size,
    decode,
    label,
    members,
    number,
    parse_json,
    parse_yaml,
    read_bytes,
    shown,
)
from maps.io.world_file import LandmarkRow, feature_list, landmark_from_feature, landmarks_from_rows
from maps.landmarks import MAX_LANDMARKS, LandmarkSet

MAX_LANDMARK_FILE_BYTES = 8 * 2**20

LandmarkFormat = Literal["geojson", "csv", "yaml"]
_SUFFIXES: dict[str, LandmarkFormat] = {
    ".geojson": "geojson",
    ".json": "geojson",
    ".csv": "csv",
    ".tsv": "csv",
    ".txt": "csv",
    ".yaml": "yaml",
    ".yml": "yaml",
}
#: name in the file -> (what it is, factor to m or rad)
_COLUMNS = {
    "id": ("id", 1.0),
    "x": ("x", 1.0),
    "x_m": ("x", 1.0),
    "y": ("y", 1.0),
    "y_m": ("y", 1.0),
    "facing_rad": ("facing", 1.0),
    "facing_deg": ("facing", math.pi / 180),
    "half_angle_rad": ("half angle", 1.0),
    "half_angle_deg": ("half angle", math.pi / 180),
    "sigma_m": ("sigma", 1.0),
}
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")


def parse_landmarks(data: bytes, *, format: LandmarkFormat, source: str = "landmarks") -> LandmarkSet:  # noqa: A002
    """Landmarks of a file's content.

    Parameters
    ----------
    data
        The content, UTF-8.
    format
        ``geojson``, ``csv`` or ``yaml``.
    source
        Name of the file, for messages.

    Raises
    ------
    MapFormatError
        If the content is not of this format; the message gives line or number and value.
    InvalidLandmark
        If a value is impossible, or an id or a position is used twice.
    MapTooLarge
        If there are more bytes or landmarks than the limit.
    """
    check_size(data, limit=MAX_LANDMARK_FILE_BYTES, what=f"landmark file '{source}'")
    readers = {"geojson": _geojson_rows, "csv": _csv_rows, "yaml": _yaml_rows}
    if format not in readers:
        raise MapFormatError(
            f"Landmark format {shown(format)} is not known; use {', '.join(get_args(LandmarkFormat))}."
        )
    try:
        rows = readers[format](data)
        if len(rows) > MAX_LANDMARKS:
            raise MapTooLarge(f"there are {len(rows)} landmarks, the limit is {MAX_LANDMARKS}.")
        return landmarks_from_rows(rows)
    except MapError as error:
        raise type(error)(f"{source}: {error}") from error


def read_landmarks(path: str | Path) -> LandmarkSet:
    """Landmarks of a ``.geojson``, ``.json``, ``.csv``, ``.tsv``, ``.txt``, ``.yaml`` or ``.yml`` file.

    Raises
    ------
    MapError
        As :func:`parse_landmarks`; or the file is missing or has another ending.
    """
    file = Path(path)
    kind = _SUFFIXES.get(file.suffix.lower())
    data = read_bytes(file, limit=MAX_LANDMARK_FILE_BYTES, what="landmark file")
    if kind is None:
        raise MapFormatError(f"'{file}': landmark files end in {', '.join(_SUFFIXES)}.")
    return parse_landmarks(data, format=kind, source=str(file))


def point_map_rows(document: dict[str, Any]) -> list[LandmarkRow]:
    """Landmarks of a laser scanner's point map: ``features`` with ``id`` and ``position`` [x, y, z], m.

    Raises
    ------
    MapFormatError
        If a feature is not of this form.
    """
    features = document.get("features")
    if not isinstance(features, list):
        raise MapFormatError(f"features is {shown(features)}; a point map has a list there.")
    rows = []
    for i, item in enumerate(features):
        where = f"features[{i}]"
        feature = members(item, where, required=("id", "position"), optional=("description",))
        x, y = xyz(feature["position"], f"{where}.position")
        rows.append((_id(feature["id"], f"{where}.id"), x, y, math.nan, math.nan, 0.0))
    return rows


def xyz(value: object, where: str) -> tuple[float, float]:
    """First two numbers of ``[x, y]`` or ``[x, y, z]``; MapFormatError for anything else."""
    if not isinstance(value, list) or len(value) not in {2, 3}:
        raise MapFormatError(f"{where} is {shown(value)}; it must be [x, y, z].")
    numbers = [number(v, f"{where}[{k}]", text_ok=True) for k, v in enumerate(value)]
    return (numbers[0], numbers[1])


def _id(value: object, where: str) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    return label(value, where)


def _row(given: dict[str, Any], where: str) -> LandmarkRow:
    """Row of the values that are given by column name, all of them known."""
    values: dict[str, Any] = {}
    for name, value in given.items():
        what, factor = _COLUMNS[name]
        if what in values:
            raise MapFormatError(f"{where} gives its {what} twice (once as '{name}'); give it once.")
        if what == "id":
            values[what] = _id(value, f"{where}: id")
        else:
            values[what] = number(value, f"{where}: {name}", text_ok=True) * factor
    missing = [what for what in ("id", "x", "y") if what not in values]
    if missing:
        raise MapFormatError(f"{where} lacks {' and '.join(missing)}.")
    facing, half = values.get("facing", math.nan), values.get("half angle", math.nan)
    sigma = values.get("sigma", 0.0)
    if sigma < 0:
        raise InvalidLandmark(f"{where}: survey sigma is {sigma:g} m; it must be ≥ 0.")
    if math.isnan(facing) and not math.isnan(half):
        raise InvalidLandmark(f"{where} has a half angle but no facing; give both or none.")
    if not math.isnan(half) and not 0 < half <= math.pi:
        raise InvalidLandmark(f"{where}: half angle is {half:g} rad; it must be in (0, π].")
    return (values["id"], values["x"], values["y"], facing, half, sigma)


def _known(name: object, where: str) -> str:
    if not isinstance(name, str) or name not in _COLUMNS:
        raise MapFormatError(
            f"{where} has {shown(name)}, which is not allowed; allowed: {', '.join(_COLUMNS)}."
        )
    return name


def _check_header(columns: list[str], where: str) -> None:
    whats = [_COLUMNS[name][0] for name in columns]
    for what in ("id", "x", "y"):
        if what not in whats:
            raise MapFormatError(
                f"{where} lacks the column {what}; the first line names the columns id, x, y."
            )
    twice = next((what for i, what in enumerate(whats) if what in whats[:i]), None)
    if twice is not None:
        raise MapFormatError(f"{where} gives {twice} in two columns; give it once.")


def _csv_rows(data: bytes) -> list[LandmarkRow]:
    text = decode(data, "The file")
    head = text.lstrip().split("\n", 1)[0]
    delimiter = max(";\t,", key=head.count)
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, strict=True, skipinitialspace=True
    )
    rows: list[LandmarkRow] = []
    columns: list[str] = []
    try:
        for cells in reader:
            line = f"line {reader.line_num}"
            values = [cell.strip() for cell in cells]
            if not any(values):
                continue
            if not columns:
                columns = [_known(name.lower(), line) for name in values]
                _check_header(columns, line)
                continue
            if len(values) != len(columns):
                raise MapFormatError(f"{line} has {len(values)} values, the header has {len(columns)}.")
            if delimiter == ";":
                values = [v.replace(",", ".") if _DECIMAL_COMMA.fullmatch(v) else v for v in values]
            rows.append(_row({n: v for n, v in zip(columns, values, strict=True) if v}, line))
    except csv.Error as error:
        raise MapFormatError(f"line {reader.line_num} is not valid CSV: {error}.") from error
    if not columns:
        raise MapFormatError("the file is empty; its first line must name the columns id, x, y.")
    return rows


def _yaml_rows(data: bytes) -> list[LandmarkRow]:
    document = parse_yaml(data, "the file", limit=MAX_LANDMARK_FILE_BYTES)
    if isinstance(document, dict) and "features" in document:
        return point_map_rows(document)
    if isinstance(document, dict):
        document = members(document, "the file", required=("landmarks",))["landmarks"]
    if not isinstance(document, list):
        raise MapFormatError(f"the file holds {shown(document)}; it must be a list of landmarks.")
    rows = []
    for i, item in enumerate(document):
        where = f"landmark number {i}"
        if not isinstance(item, dict):
            raise MapFormatError(f"{where} is {shown(item)}; it must be a mapping with id, x, y.")
        rows.append(_row({_known(name, where): value for name, value in item.items()}, where))
    return rows


def _geojson_rows(data: bytes) -> list[LandmarkRow]:
    document = parse_json(data, "the file")
    top = members(document, "document", required=("type", "features"), optional=("name",))
    rows = []
    for i, item in enumerate(feature_list(top)):
        where = f"features[{i}]"
        feature = members(item, where, required=("type", "properties", "geometry"))
        geometry = members(feature["geometry"], f"{where}.geometry", required=("type", "coordinates"))
        if geometry["type"] != "Point":
            raise MapFormatError(f"{where}.geometry.type is {shown(geometry['type'])}; landmarks are Points.")
        properties = feature["properties"]
        if isinstance(properties, dict):
            properties = {"kind": "landmark"} | properties
            if properties["kind"] != "landmark":
                raise MapFormatError(
                    f"{where}.properties.kind is {shown(properties['kind'])}; it must be 'landmark'."
                )
        rows.append(landmark_from_feature(properties, geometry["coordinates"], where))
    return rows
