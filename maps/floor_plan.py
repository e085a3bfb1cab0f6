"""Floors as polygons: what vector maps are made of."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from maps.arrays import BoolArray, FloatArray, digest
from maps.errors import InvalidGeometry
from maps.grid import MAX_COORDINATE_M, GridFrame

MAX_VERTICES = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """Floor as polygons, in W, m. Free space is the floor without the obstacles.

    What lies outside the floor is not free and stops every line of sight, as outer walls do. Inside,
    each obstacle says whether it is opaque (a wall, a rack) or not (a pit, a glass wall, a conveyor).

    Attributes
    ----------
    floor
        Polygons whose union is the floor.
    obstacles
        Polygons that a robot cannot enter.
    opaque
        One flag per obstacle.

    Raises
    ------
    InvalidGeometry
        If a polygon is empty, not finite or crosses itself, or no floor is left.
    """

    floor: tuple[Polygon, ...]
    obstacles: tuple[Polygon, ...] = ()
    opaque: tuple[bool, ...] = ()
    _free: BaseGeometry = field(init=False, repr=False)
    _see_through: BaseGeometry = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "floor", tuple(self.floor))
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        object.__setattr__(self, "opaque", tuple(bool(o) for o in self.opaque))
        if len(self.opaque) != len(self.obstacles):
            raise InvalidGeometry(f"{len(self.obstacles)} obstacles but {len(self.opaque)} opaque flags.")
        if not self.floor:
            raise InvalidGeometry("The map has no floor polygon; add at least one with kind 'floor'.")
        for kind, polygons in (("floor", self.floor), ("obstacle", self.obstacles)):
            for i, polygon in enumerate(polygons):
                _check(kind, i, polygon)
        n = int(shapely.get_num_coordinates(np.array([*self.floor, *self.obstacles], dtype=object)).sum())
        if n > MAX_VERTICES:
            raise InvalidGeometry(f"The map has {n} vertices, the limit is {MAX_VERTICES}; simplify it.")
        floor = self.floor_area()
        walls = [p for p, o in zip(self.obstacles, self.opaque, strict=True) if o]
        object.__setattr__(self, "_free", _ready(floor, list(self.obstacles)))
        object.__setattr__(self, "_see_through", _ready(floor, walls))
        if self._free.is_empty:
            raise InvalidGeometry("Obstacles cover the whole floor: no free space is left.")

    def __reduce__(self) -> tuple[type[FloorPlan], tuple[object, ...]]:
        return (FloorPlan, (self.floor, self.obstacles, self.opaque))

    def floor_area(self) -> BaseGeometry:
        """Union of the floor polygons."""
        return shapely.union_all(list(self.floor))

    def free_space(self) -> BaseGeometry:
        """Floor without any obstacle: (multi)polygon in W, m."""
        return self._free

    def see_through(self) -> BaseGeometry:
        """Floor without the opaque obstacles: where lines of sight may run; (multi)polygon in W, m."""
        return self._see_through

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(x_min, y_min, x_max, y_max)`` of the floor in W, m."""
        x0, y0, x1, y1 = self.floor_area().bounds
        return (float(x0), float(y0), float(x1), float(y1))

    @property
    def free_area_m2(self) -> float:
        """Area a point robot may stand on, m²."""
        return float(self.free_space().area)

    def grid_frame(self, resolution: float) -> GridFrame:
        """Frame of a field over this floor: no yaw, lower-left corner of the bounds."""
        if not (math.isfinite(resolution) and resolution > 0):
            raise InvalidGeometry(f"Grid resolution is {resolution} m; it must be positive and finite.")
        x0, y0, x1, y1 = self.bounds
        n_rows = max(1, math.ceil((y1 - y0) / resolution - 1e-6))
        n_cols = max(1, math.ceil((x1 - x0) / resolution - 1e-6))
        return GridFrame(x0, y0, 0.0, resolution, n_rows, n_cols)

    def free_at(self, points: npt.ArrayLike) -> BoolArray:
        """Whether points (..., 2) in W lie strictly inside free space."""
        return self._inside(self.free_space(), points)

    def opaque_at(self, points: npt.ArrayLike) -> BoolArray:
        """Whether points (..., 2) in W lie in or on an opaque obstacle, or not inside the floor."""
        return ~self._inside(self.see_through(), points)

    @staticmethod
    def _inside(area: BaseGeometry, points: npt.ArrayLike) -> BoolArray:
        p = np.asarray(points, dtype=np.float64)
        flat = p.reshape(-1, 2)
        return np.asarray(shapely.contains_xy(area, flat[:, 0], flat[:, 1])).reshape(p.shape[:-1])

    def free_edges(self) -> FloatArray:
        """Boundary of free space as segments; shape (M, 4): x0, y0, x1, y1 in W, m."""
        return _edges(self.free_space())

    def opaque_edges(self) -> FloatArray:
        """Boundary of what can be seen through; shape (M, 4): x0, y0, x1, y1 in W, m."""
        return _edges(self.see_through())

    def content_hash(self) -> str:
        """SHA-256 (hex) of all polygons in their order."""
        parts: list[bytes | str] = ["plan"]
        parts += [shapely.to_wkb(p, byte_order=1) for p in self.floor]
        for polygon, opaque in zip(self.obstacles, self.opaque, strict=True):
            parts += ["opaque" if opaque else "clear", shapely.to_wkb(polygon, byte_order=1)]
        return digest(*parts)


def _check(kind: str, i: int, polygon: Polygon) -> None:
    if not isinstance(polygon, Polygon) or polygon.is_empty:
        raise InvalidGeometry(f"The {kind} number {i} is not a polygon with at least three corners.")
    if shapely.has_z(polygon):
        raise InvalidGeometry(f"The {kind} number {i} has heights; a floor plan is flat: give x and y only.")
    coordinates = shapely.get_coordinates(polygon)
    if not np.isfinite(coordinates).all():
        raise InvalidGeometry(f"The {kind} number {i} has a coordinate that is not finite.")
    if np.abs(coordinates).max() > MAX_COORDINATE_M:
        raise InvalidGeometry(
            f"The {kind} number {i} reaches {np.abs(coordinates).max():g} m; the limit is "
            f"{MAX_COORDINATE_M:g} m from the origin. Use metres of the map frame."
        )
    if not polygon.is_valid:
        raise InvalidGeometry(f"The {kind} number {i} is not valid: {shapely.is_valid_reason(polygon)}.")


def _ready(floor: BaseGeometry, without: list[Polygon]) -> BaseGeometry:
    area = shapely.difference(floor, shapely.union_all(without))
    # The first question builds the index inside; later ones may come from several threads.
    shapely.prepare(area)
    shapely.contains_xy(area, *floor.bounds[:2])
    return area


def _edges(area: BaseGeometry) -> FloatArray:
    rings: Iterable[BaseGeometry] = []
    polygons = area.geoms if isinstance(area, MultiPolygon) else [area]
    rings = [ring for p in polygons if isinstance(p, Polygon) for ring in (p.exterior, *p.interiors)]
    pieces = [np.asarray(shapely.get_coordinates(ring)) for ring in rings]
    if not pieces:
        return np.empty((0, 4))
    return np.concatenate([np.concatenate([c[:-1], c[1:]], axis=1) for c in pieces])
