"""A world as one JSON object and a few arrays, for stores that keep it inside something else."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from maps.errors import MapFormatError
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World

BUNDLE_FORMAT = 1

Arrays = dict[str, npt.NDArray[Any]]


def pack_world(world: World) -> tuple[dict[str, Any], Arrays]:
    """Take a world apart, without loss.

    Returns
    -------
    meta
        JSON-able: format, name, kind of floor, its scalars, landmark ids.
    arrays
        Landmarks: ``positions`` (N, 2) m, ``facing`` (N,) rad with NaN for none, ``half_angle`` (N,) rad,
        ``sigma`` (N,) m. Grids: ``free``, ``opaque``, ``unknown`` (n_rows, n_cols) bool. Polygons:
        ``vertices`` (V, 2) m, ``ring_starts`` (R + 1,), ``polygon_starts`` (P + 1,) rings per polygon,
        floors first, and ``opaque`` per obstacle.
    """
    landmarks = world.landmarks
    meta: dict[str, Any] = {"format": BUNDLE_FORMAT, "name": world.name, "landmark_ids": list(landmarks.ids)}
    arrays: Arrays = {
        "positions": landmarks.positions,
        "facing": landmarks.facing,
        "half_angle": landmarks.half_angle,
        "sigma": landmarks.sigma,
    }
    floor = world.floor
    if isinstance(floor, OccupancyGrid):
        meta |= {"kind": "grid", "frame": list(floor.frame.as_tuple())}
        arrays |= {"free": floor.free, "opaque": floor.opaque, "unknown": floor.unknown}
        return meta, arrays
    polygons = np.array([*floor.floor, *floor.obstacles], dtype=object)
    _, vertices, (ring_starts, polygon_starts) = shapely.to_ragged_array(polygons, include_z=False)
    meta |= {"kind": "polygons", "n_floors": len(floor.floor)}
    arrays |= {
        "vertices": vertices,
        "ring_starts": np.asarray(ring_starts, dtype=np.int64),
        "polygon_starts": np.asarray(polygon_starts, dtype=np.int64),
        "opaque": np.array(floor.opaque, dtype=np.bool_),
    }
    return meta, arrays


def unpack_world(meta: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> World:
    """Inverse of :func:`pack_world`: the same name and the same content hash.

    Raises
    ------
    MapFormatError
        If the parts are not those of a packed world, or of another format.
    MapError
        If they are, but do not make a valid world.
    """
    if not isinstance(meta, Mapping) or meta.get("format") != BUNDLE_FORMAT:
        found = meta.get("format") if isinstance(meta, Mapping) else meta
        raise MapFormatError(f"Packed world has format {found!r}, this program reads {BUNDLE_FORMAT}.")
    try:
        landmarks = LandmarkSet(
            tuple(meta["landmark_ids"]),
            arrays["positions"],
            arrays["facing"],
            arrays["half_angle"],
            arrays["sigma"],
        )
        floor = _grid(meta, arrays) if meta["kind"] == "grid" else _plan(meta, arrays)
        return World(str(meta["name"]), floor, landmarks)
    except KeyError as error:
        raise MapFormatError(f"Packed world lacks {error}; it was cut or is not one.") from error
    except (TypeError, ValueError, IndexError, AttributeError, shapely.errors.ShapelyError) as error:
        raise MapFormatError(f"Packed world is damaged: {error}.") from error


def _grid(meta: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> OccupancyGrid:
    x, y, yaw, resolution, n_rows, n_cols = meta["frame"]
    frame = GridFrame(x, y, yaw, resolution, int(n_rows), int(n_cols))
    return OccupancyGrid(frame, arrays["free"], arrays["opaque"], arrays["unknown"])


def _plan(meta: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> FloorPlan:
    if meta["kind"] != "polygons":
        raise MapFormatError(f"Packed world has a floor of kind {meta['kind']!r}; 'grid' or 'polygons'.")
    rings, starts = np.asarray(arrays["ring_starts"]), np.asarray(arrays["polygon_starts"])
    vertices = np.asarray(arrays["vertices"], dtype=np.float64)
    polygons = shapely.from_ragged_array(shapely.GeometryType.POLYGON, vertices, (rings, starts))
    n = int(meta["n_floors"])
    return FloorPlan(tuple(polygons[:n]), tuple(polygons[n:]), tuple(arrays["opaque"].tolist()))
