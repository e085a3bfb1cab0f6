"""Places by name from files: CSV or JSON, in metres of the map frame.

CSV has the names ``x``, ``y`` (or ``x_m``, ``y_m``) and, if wanted, ``id`` in its first line and commas,
semicolons or tabs between them. JSON is a list, alone or as ``places``, of ``[x, y]`` or of objects with the
same names. A place without an id is called by its number, from 1.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from maps.arrays import FloatArray
from maps.errors import MapError, MapFormatError, MapTooLarge
from maps.io.strict import check_size, decode, label, members, number, parse_json, read_bytes, shown

MAX_PLACE_FILE_BYTES = 2**20
MAX_PLACES = 10_000
_NAMES = {"id": "id", "x": "x", "x_m": "x", "y": "y", "y_m": "y"}


def read_places(path: str | Path) -> tuple[tuple[str, ...], FloatArray]:
    """Names and places of a ``.csv``, ``.tsv``, ``.txt`` or ``.json`` file.

    Returns
    -------
    ids, points
        N names, all different, and shape (N, 2), W, m.

    Raises
    ------
    MapFormatError
        If the file is missing, has another ending or another content, or gives a name twice.
    MapTooLarge
        If there are more bytes or places than the limit.
    """
    file = Path(path)
    if file.suffix.lower() not in {".csv", ".tsv", ".txt", ".json"}:
        raise MapFormatError(f"'{file}': files of places end in .csv, .tsv, .txt or .json.")
    data = read_bytes(file, limit=MAX_PLACE_FILE_BYTES, what="file of places")
    return parse_places(data, is_json=file.suffix.lower() == ".json", source=str(file))


def parse_places(data: bytes, *, is_json: bool, source: str = "places") -> tuple[tuple[str, ...], FloatArray]:
    """Names and places of a file's content; see :func:`read_places`.

    Raises
    ------
    MapFormatError
        If the content is something else; the message says where.
    MapTooLarge
        If there are more bytes or places than the limit.
    """
    check_size(data, limit=MAX_PLACE_FILE_BYTES, what=f"file of places '{source}'")
    try:
        rows = _json_rows(data) if is_json else _csv_rows(data)
        if not rows:
            raise MapFormatError("there is no place; give at least one.")
        if len(rows) > MAX_PLACES:
            raise MapTooLarge(f"there are {len(rows)} places, the limit is {MAX_PLACES}.")
        ids = tuple(row[0] for row in rows)
        twice = next((name for k, name in enumerate(ids) if name in set(ids[:k])), None)
        if twice is not None:
            raise MapFormatError(f"there are two places {shown(twice)}; names must differ.")
    except MapError as error:
        raise type(error)(f"{source}: {error}") from error
    return ids, np.array([row[1:] for row in rows], dtype=np.float64)


def _row(given: dict[str, Any], where: str, count: int) -> tuple[str, float, float]:
    values: dict[str, Any] = {}
    for name, value in given.items():
        what = _NAMES[name]
        if what in values:
            raise MapFormatError(f"{where} gives {what} twice (once as '{name}'); give it once.")
        values[what] = value
    missing = [what for what in ("x", "y") if what not in values]
    if missing:
        raise MapFormatError(f"{where} lacks {' and '.join(missing)}.")
    name = values.get("id", str(count))
    if isinstance(name, int) and not isinstance(name, bool):
        name = str(name)
    x, y = (number(values[what], f"{where}: {what}", text_ok=True) for what in ("x", "y"))
    return label(name, f"{where}: id"), x, y


def _csv_rows(data: bytes) -> list[tuple[str, float, float]]:
    text = decode(data, "the file")
    delimiter = max(";\t,", key=text.lstrip().split("\n", 1)[0].count)
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=delimiter, strict=True, skipinitialspace=True
    )
    rows: list[tuple[str, float, float]] = []
    columns: list[str] = []
    try:
        for cells in reader:
            where = f"line {reader.line_num}"
            values = [cell.strip() for cell in cells]
            if not any(values):
                continue
            if not columns:
                columns = [name.lower() for name in values]
                bad = next((name for name in columns if name not in _NAMES), None)
                if bad is not None:
                    raise MapFormatError(
                        f"{where} has {shown(bad)}; the first line names the columns: {', '.join(_NAMES)}."
                    )
                continue
            if len(values) != len(columns):
                raise MapFormatError(f"{where} has {len(values)} values, the header has {len(columns)}.")
            rows.append(_row(dict(zip(columns, values, strict=True)), where, len(rows) + 1))
    except csv.Error as error:
        raise MapFormatError(f"line {reader.line_num} is not valid CSV: {error}.") from error
    return rows


def _json_rows(data: bytes) -> list[tuple[str, float, float]]:
    document = parse_json(data, "the file")
    if isinstance(document, dict):
        document = members(document, "the file", required=("places",))["places"]
    if not isinstance(document, list):
        raise MapFormatError(f"the file holds {shown(document)}; it must be a list of places.")
    rows = []
    for k, item in enumerate(document):
        where = f"place {k + 1}"
        if isinstance(item, list):
            if len(item) != 2:
                raise MapFormatError(f"{where} is {shown(item)}; it must be [x, y].")
            item = {"x": item[0], "y": item[1]}  # noqa: PLW2901
        rows.append(_row(members(item, where, required=(), optional=tuple(_NAMES)), where, k + 1))
    return rows
