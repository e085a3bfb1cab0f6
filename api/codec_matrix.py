"""Matrices and regions as JSON, CSV and GeoJSON."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from maps.arrays import FloatArray
from planner.matrix import CostMatrix
from planner.reachability import Region
from planner.travel import PlaceStatus

#: Names of the figures of a pair, with units, and where they are in a matrix.
LAYERS = {
    "cost": "cost",
    "length_m": "length",
    "duration_s": "duration",
    "mean_r95_m": "mean_r95",
    "worst_r95_m": "worst_r95",
    "blind_m": "blind",
}


def matrix_to_json(matrix: CostMatrix, sources: Sequence[str], targets: Sequence[str]) -> dict[str, Any]:
    """Document of a matrix: places with their status, and one array of N rows for each figure.

    Parameters
    ----------
    matrix
        N × M pairs.
    sources, targets
        N and M names.

    Returns
    -------
    document
        ``null`` stands where there is no way.
    """
    return {
        "sources": _places(sources, matrix.sources, matrix.source_status),
        "targets": _places(targets, matrix.targets, matrix.target_status),
        **{name: _rows(getattr(matrix, layer)) for name, layer in LAYERS.items()},
        "is_complete": matrix.is_complete,
        "warnings": list(matrix.warnings),
        "stats": matrix.stats,
    }


def matrix_to_csv(matrix: CostMatrix, sources: Sequence[str], targets: Sequence[str]) -> str:
    """One line per pair: names of source and target, and the figures; empty where there is no way."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["source", "target", *LAYERS])
    layers = [getattr(matrix, layer) for layer in LAYERS.values()]
    for i, source in enumerate(sources):
        for j, target in enumerate(targets):
            values = [float(layer[i, j]) for layer in layers]
            writer.writerow([source, target, *("" if math.isnan(v) else repr(v) for v in values)])
    return out.getvalue()


def matrix_to_array(matrix: CostMatrix) -> FloatArray:
    """Shape (6, N, M): the figures in the order of :data:`LAYERS`; NaN where there is no way."""
    return np.stack([getattr(matrix, layer) for layer in LAYERS.values()])


def region_to_geojson(region: Region) -> dict[str, Any]:
    """FeatureCollection of one MultiPolygon, in m of the map frame, exterior rings counter-clockwise."""
    shape = shapely.MultiPolygon([shapely.orient_polygons(p) for p in region.polygons])
    properties = {
        "place": {"x_m": region.place[0], "y_m": region.place[1]},
        "measure": region.measure,
        "limit": region.limit if math.isfinite(region.limit) else None,
        "area_m2": region.area,
        "is_complete": region.is_complete,
    }
    feature = {"type": "Feature", "properties": properties, "geometry": shapely.geometry.mapping(shape)}
    return {"type": "FeatureCollection", "features": [feature]}


def _places(names: Sequence[str], points: FloatArray, status: Sequence[PlaceStatus]) -> list[dict[str, Any]]:
    return [
        {"id": name, "x_m": float(x), "y_m": float(y), "status": state.value}
        for name, (x, y), state in zip(names, points, status, strict=True)
    ]


def _rows(layer: FloatArray) -> list[list[float | None]]:
    return [[None if math.isnan(v) else v for v in row] for row in layer.tolist()]
