"""Polygons with factors from a GeoJSON file, in metres of the map frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from shapely import Polygon
from shapely.errors import ShapelyError
from shapely.geometry import shape

from api.codec import DocumentError, read_json_file


def read_areas(path: Path | None) -> list[tuple[Polygon, float]]:
    """Polygons of a GeoJSON file and their property ``factor`` (1 without one); none without a file.

    Raises
    ------
    DocumentError
        If the file cannot be read or holds something else than polygons.
    """
    if path is None:
        return []
    document = read_json_file(str(path), what="areas")
    kind = document.get("type")
    features: list[Any] = document.get("features", []) if kind == "FeatureCollection" else [document]
    out: list[tuple[Polygon, float]] = []
    for k, feature in enumerate(features):
        where = f"Feature {k + 1} of '{path}'"
        if not isinstance(feature, dict):
            raise DocumentError(f"{where} is no GeoJSON object.")
        is_feature = feature.get("type") == "Feature"
        geometry = feature.get("geometry") if is_feature else feature
        properties = (feature.get("properties") if is_feature else None) or {}
        try:
            made = shape(geometry)
        except (ShapelyError, AttributeError, KeyError, TypeError, ValueError) as error:
            raise DocumentError(f"{where} has no geometry that can be read: {error}.") from error
        parts = list(made.geoms) if made.geom_type == "MultiPolygon" else [made]
        if any(part.geom_type != "Polygon" for part in parts):
            raise DocumentError(f"{where} is a {made.geom_type}; areas must be polygons.")
        factor = properties.get("factor", 1.0)
        if isinstance(factor, bool) or not isinstance(factor, (int, float)):
            raise DocumentError(f"{where} has the factor {factor!r}; it must be a number.")
        out += [(part, float(factor)) for part in parts]
    return out
