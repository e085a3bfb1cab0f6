"""World files: polygons and landmarks as GeoJSON in metres of the map frame.

One FeatureCollection. Polygons have ``properties.kind`` ``floor`` or ``obstacle`` (and ``opaque``, by
default true), Points ``landmark`` with ``id`` and, if wanted, ``facing_rad``, ``half_angle_rad``,
``sigma_m``. The collection may have a ``name``. Nothing else is allowed, so that a misspelt member is an
error and not a default. Reading, writing and reading again gives the same world.
"""

from __future__ import annotations

import json
import math
import os
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

from maps.errors import InvalidGeometry, MapError, MapFormatError, MapTooLarge
from maps.floor_plan import FloorPlan
from maps.io.strict import check_size, label, members, number, parse_json, read_bytes, shown
from maps.landmarks import LandmarkSet
from maps.world import World

MAX_WORLD_FILE_BYTES = 64 * 2**20
MAX_FEATURES = 500_000

_LANDMARK_NUMBERS = ("facing_rad", "half_angle_rad", "sigma_m")
_KINDS = {"Polygon": ("floor", "obstacle"), "Point": ("landmark",)}


def world_from_geojson(document: dict[str, Any] | str | bytes, *, name: str | None = None) -> World:
    """World of a GeoJSON document.

    Parameters
    ----------
    document
        The document, parsed or as text (UTF-8), lengths in m, angles in rad, frame W.
    name
        Name of the world; default: the collection's ``name``, else ``world``.

    Raises
    ------
    MapFormatError
        If the document is not of this format; the message says where, as in ``features[3].properties.kind``.
    MapTooLarge
        If it has more bytes or features than the limit.
    MapError
        If it is, but its polygons or landmarks are impossible.
    """
    if isinstance(document, (str, bytes)):
        check_size(document, limit=MAX_WORLD_FILE_BYTES, what="world file")
        document = parse_json(document, "The world file")
    top = members(document, "document", required=("type", "features"), optional=("name",))
    features = feature_list(top)
    title = label(top["name"], "name") if "name" in top else None
    plan: dict[str, list[Polygon]] = {"floor": [], "obstacle": []}
    opaque: list[bool] = []
    points = []
    for i, feature in enumerate(features):
        where = f"features[{i}]"
        kind, properties, coordinates = _feature(feature, where)
        if kind == "landmark":
            points.append(landmark_from_feature(properties, coordinates, where))
            continue
        allowed = ("opaque",) if kind == "obstacle" else ()
        members(properties, f"{where}.properties", required=("kind",), optional=allowed)
        plan[kind].append(_polygon(coordinates, f"{where}.geometry.coordinates"))
        if kind == "obstacle":
            opaque.append(_boolean(properties.get("opaque", True), f"{where}.properties.opaque"))
    floor = FloorPlan(tuple(plan["floor"]), tuple(plan["obstacle"]), tuple(opaque))
    return World(name or title or "world", floor, landmarks_from_rows(points))


def feature_list(collection: Mapping[str, Any]) -> list[Any]:
    """Features of a FeatureCollection.

    Raises
    ------
    MapFormatError
        If it is something else.
    MapTooLarge
        If there are too many.
    """
    if collection.get("type") != "FeatureCollection":
        raise MapFormatError(f"type is {shown(collection.get('type'))}; it must be 'FeatureCollection'.")
    features = collection.get("features")
    if not isinstance(features, list):
        raise MapFormatError(f"features is {shown(features)}; it must be an array.")
    if len(features) > MAX_FEATURES:
        raise MapTooLarge(f"The document has {len(features)} features, the limit is {MAX_FEATURES}.")
    return features


def _feature(feature: object, where: str) -> tuple[str, dict[str, Any], Any]:
    top = members(feature, where, required=("type", "properties", "geometry"))
    if top["type"] != "Feature":
        raise MapFormatError(f"{where}.type is {shown(top['type'])}; it must be 'Feature'.")
    geometry = members(top["geometry"], f"{where}.geometry", required=("type", "coordinates"))
    shape, properties = geometry["type"], top["properties"]
    if not isinstance(shape, str) or shape not in _KINDS:
        raise MapFormatError(f"{where}.geometry.type is {shown(shape)}; it must be 'Polygon' or 'Point'.")
    if not isinstance(properties, dict) or "kind" not in properties:
        raise MapFormatError(f"{where}.properties lacks the member 'kind' (floor, obstacle or landmark).")
    kind = properties["kind"]
    if kind not in _KINDS[shape]:
        allowed = " or ".join(repr(k) for k in _KINDS[shape])
        raise MapFormatError(f"{where}.properties.kind is {shown(kind)}; a {shape} must be {allowed}.")
    return kind, properties, geometry["coordinates"]


def _position(value: object, where: str) -> tuple[float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise MapFormatError(f"{where} is {shown(value)}; it must be [x, y] in m, without a height.")
    return (number(value[0], f"{where}[0]"), number(value[1], f"{where}[1]"))


def _polygon(coordinates: object, where: str) -> Polygon:
    if not isinstance(coordinates, (list, tuple)) or not coordinates:
        raise MapFormatError(
            f"{where} is {shown(coordinates)}; it must be a list of rings, the outer one first."
        )
    rings = []
    for k, ring in enumerate(coordinates):
        if not isinstance(ring, (list, tuple)) or len(ring) < 4:
            raise MapFormatError(f"{where}[{k}] is {shown(ring)}; a ring has at least four positions.")
        points = [_position(p, f"{where}[{k}][{j}]") for j, p in enumerate(ring)]
        if points[0] != points[-1]:
            raise MapFormatError(f"{where}[{k}] is not closed: repeat its first position at its end.")
        rings.append(points)
    polygon = Polygon(rings[0], rings[1:])
    if not polygon.is_valid:
        raise InvalidGeometry(f"{where} is not a valid polygon: {shapely.is_valid_reason(polygon)}.")
    return polygon


def _boolean(value: object, where: str) -> bool:
    if not isinstance(value, bool):
        raise MapFormatError(f"{where} is {shown(value)}; it must be true or false.")
    return value


LandmarkRow = tuple[str, float, float, float, float, float]


def landmark_from_feature(properties: object, coordinates: object, where: str) -> LandmarkRow:
    """Id, x, y, facing, half angle, sigma of a Point feature; NaN where not given, sigma 0."""
    at = f"{where}.properties"
    given = members(properties, at, required=("kind", "id"), optional=_LANDMARK_NUMBERS)
    x, y = _position(coordinates, f"{where}.geometry.coordinates")
    facing = number(given["facing_rad"], f"{at}.facing_rad") if "facing_rad" in given else math.nan
    half = number(given["half_angle_rad"], f"{at}.half_angle_rad") if "half_angle_rad" in given else math.nan
    if math.isnan(facing) and not math.isnan(half):
        raise MapFormatError(f"{at} has half_angle_rad without facing_rad; give both or none.")
    sigma = number(given.get("sigma_m", 0.0), f"{at}.sigma_m")
    return (label(given["id"], f"{at}.id"), x, y, facing, half, sigma)


def landmarks_from_rows(rows: list[LandmarkRow]) -> LandmarkSet:
    """Landmarks of rows as :func:`landmark_from_feature` gives them."""
    if not rows:
        return LandmarkSet.empty()
    table = np.array([row[1:] for row in rows], dtype=np.float64)
    return LandmarkSet(tuple(row[0] for row in rows), table[:, :2], table[:, 2], table[:, 3], table[:, 4])


def world_to_geojson(world: World) -> dict[str, Any]:
    """The GeoJSON document of a world with a polygon floor.

    Raises
    ------
    MapFormatError
        If the floor is a grid: cells are not polygons.
    """
    if not isinstance(world.floor, FloorPlan):
        raise MapFormatError(
            f"World '{world.name}' has a grid floor, which a world file cannot hold; "
            "keep its map image and YAML."
        )
    features = [_polygon_feature({"kind": "floor"}, p) for p in world.floor.floor]
    for polygon, opaque in zip(world.floor.obstacles, world.floor.opaque, strict=True):
        features.append(_polygon_feature({"kind": "obstacle", "opaque": opaque}, polygon))
    marks = world.landmarks
    for i, name in enumerate(marks.ids):
        properties: dict[str, Any] = {"kind": "landmark", "id": name}
        if marks.has_facing[i]:
            properties["facing_rad"] = float(marks.facing[i])
            properties["half_angle_rad"] = float(marks.half_angle[i])
        if marks.sigma[i] != 0:
            properties["sigma_m"] = float(marks.sigma[i])
        point = {"type": "Point", "coordinates": marks.positions[i].tolist()}
        features.append({"type": "Feature", "properties": properties, "geometry": point})
    return {"type": "FeatureCollection", "name": world.name, "features": features}


def _polygon_feature(properties: dict[str, Any], polygon: Polygon) -> dict[str, Any]:
    rings = [shapely.get_coordinates(ring).tolist() for ring in (polygon.exterior, *polygon.interiors)]
    geometry = {"type": "Polygon", "coordinates": rings}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def read_world_file(path: str | Path) -> World:
    """World of a GeoJSON file; without a ``name`` in it, named after the file.

    Raises
    ------
    MapError
        As :func:`world_from_geojson`, the file named; or there is no such file.
    """
    file = Path(path)
    data = read_bytes(file, limit=MAX_WORLD_FILE_BYTES, what="world file")
    try:
        document = parse_json(data, "The world file")
        named = isinstance(document, dict) and "name" in document
        return world_from_geojson(document, name=None if named else file.stem)
    except MapError as error:
        raise type(error)(f"{file}: {error}") from error


def write_world_file(world: World, path: str | Path) -> None:
    """Write a world with a polygon floor, one feature per line; the file is replaced whole or not at all.

    Raises
    ------
    MapFormatError
        If the floor is a grid or the file cannot be written.
    """
    document = world_to_geojson(world)
    lines = ",\n".join(json.dumps(f, ensure_ascii=False, allow_nan=False) for f in document["features"])
    title = json.dumps(document["name"], ensure_ascii=False)
    text = f'{{"type": "FeatureCollection", "name": {title}, "features": [\n{lines}\n]}}\n'
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    try:
        with temporary.open("w", encoding="utf-8", newline="\n") as handle:
            handle.write(text)
            handle.flush()
            os.fsync(handle.fileno())
        temporary.replace(target)
    except OSError as error:
        raise MapFormatError(f"Could not write '{target}': {error.strerror or error}.") from error
    finally:
        temporary.unlink(missing_ok=True)
