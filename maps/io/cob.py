"""Sites of a laser-guided robot: image, reflectors in ``point_maps``, walls in ``line_maps``.

Files as in the ``cob_environments`` package (ipa320): ``source_id`` and ``features``; a point has
``position``, a line ``source`` and ``target``, in m in the map frame; heights are not used.

A line map holds walls as the scanner saw them, with openings where doors stood; no line says which side
is floor. The floor is taken to be what the walls enclose when every opening of up to 3 m is closed, as a
commissioning engineer would draw it: corridors, halls and rooms, not the unknown beyond the doors.
Reflectors stand on walls, lines are fitted, so that a reflector can come to lie some centimetres behind
its wall and would see nothing: a wall with a reflector within 0.1 m is led through it instead; reflectors
stay where they were surveyed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from maps.arrays import FloatArray
from maps.errors import InvalidGeometry, MapError, MapFormatError, MapTooLarge
from maps.floor_plan import FloorPlan
from maps.io.landmark_files import read_landmarks, xyz
from maps.io.strict import members, parse_yaml, read_bytes, shown
from maps.landmarks import LandmarkSet

#: Openings between walls up to this width are closed, m.
OPENING_M = 3.0
#: A wall this close to a reflector carries it, m.
CARRIES_M = 0.1
#: Half the thickness of walls that have floor on both sides, m.
_HALF_WALL_M = 0.02
#: Free space around a reflector on a wall, m: more than all rounding of the outline.
_NICHE_M = 0.005
#: Floor narrower or smaller than this is not kept, m and m².
_THIN_M = 0.3
_SMALLEST_FLOOR_M2 = 1.0
_MAX_BYTES = 8 * 2**20
_MAX_LINES = 20_000
_ARC_STEPS = 64


def read_point_maps(folder: Path) -> LandmarkSet | None:
    """Reflectors of all files in ``folder/point_maps``, by file name; None when there are none.

    Raises
    ------
    MapError
        If a file cannot be read or two reflectors share an id or a place.
    """
    sets = [read_landmarks(file) for file in sorted((folder / "point_maps").glob("*.yaml"))]
    if not sets:
        return None
    ids = tuple(name for s in sets for name in s.ids)
    return LandmarkSet(ids, np.concatenate([s.positions for s in sets]))


def read_line_maps(folder: Path) -> FloatArray | None:
    """Walls of all files in ``folder/line_maps``: shape (N, 4), x0, y0, x1, y1, m; None when there are none.

    Raises
    ------
    MapFormatError
        If a file is not a line map.
    MapTooLarge
        If there are more than 20,000 lines.
    """
    files = sorted((folder / "line_maps").glob("*.yaml"))
    lines = [line for file in files for line in _lines(file)]
    if len(lines) > _MAX_LINES:
        raise MapTooLarge(f"The line maps in '{folder}' have {len(lines)} lines, the limit is {_MAX_LINES}.")
    return np.array(lines, dtype=np.float64).reshape(-1, 4) if lines else None


def _lines(file: Path) -> list[tuple[float, float, float, float]]:
    data = read_bytes(file, limit=_MAX_BYTES, what="line map")
    try:
        document = parse_yaml(data, "the file", limit=_MAX_BYTES)
        features = document.get("features") if isinstance(document, dict) else None
        if not isinstance(features, list):
            raise MapFormatError(f"features is {shown(features)}; a line map has a list there.")
        out = []
        for i, item in enumerate(features):
            where = f"features[{i}]"
            line = members(item, where, required=("source", "target"), optional=("id", "description"))
            a, b = xyz(line["source"], f"{where}.source"), xyz(line["target"], f"{where}.target")
            # A line of no length carries no direction; scanners leave some behind.
            if a != b:
                out.append((*a, *b))
    except MapError as error:
        raise type(error)(f"{file}: {error}") from error
    return out


def plan_from_walls(walls: FloatArray, reflectors: FloatArray) -> FloorPlan:
    """Floor that thin walls enclose; see the top of this module for the rules.

    Parameters
    ----------
    walls
        Shape (N, 4): x0, y0, x1, y1 in W, m.
    reflectors
        Shape (M, 2) in W, m.

    Returns
    -------
    plan
        Walls at the rim of the floor are its outline; walls within it are opaque strips of 4 cm.

    Raises
    ------
    InvalidGeometry
        If the walls enclose no floor.
    """
    lines = shapely.union_all([_through(wall, reflectors) for wall in walls])
    floor = _enclosed(lines)
    if floor.is_empty:
        raise InvalidGeometry(
            f"The {len(walls)} walls of the line map enclose no floor: openings wider than {OPENING_M:g} m "
            "stay open."
        )
    points = shapely.points(reflectors)
    carried = points[shapely.distance(points, lines) <= CARRIES_M]
    # A flat hollow for each reflector on a wall, open to the floor before it.
    discs = shapely.buffer(carried, _NICHE_M, quad_segs=4)
    near = shapely.intersection(shapely.buffer(carried, CARRIES_M), floor)
    niches = shapely.union_all(shapely.convex_hull(shapely.union(discs, near))[~shapely.is_empty(near)])
    rim = shapely.buffer(shapely.boundary(floor), 2 * _HALF_WALL_M)
    inner = shapely.intersection(shapely.difference(lines, rim), floor)
    strips = shapely.difference(shapely.buffer(inner, _HALF_WALL_M, cap_style="flat"), niches)
    obstacles = tuple(_polygons(strips))
    floor = shapely.union(floor, niches)
    return FloorPlan(tuple(_polygons(floor)), obstacles, (True,) * len(obstacles))


def _enclosed(lines: BaseGeometry) -> BaseGeometry:
    # Close openings: grow the walls until they meet, fill what they surround, shrink the rim back to them.
    radius = OPENING_M / 2
    grown = shapely.buffer(lines, radius, quad_segs=_ARC_STEPS)
    full = shapely.union_all([Polygon(p.exterior) for p in _polygons(grown)])
    filled = shapely.buffer(full, _HALF_WALL_M - radius, quad_segs=_ARC_STEPS)
    # That also fillets the outside of corners; walls cut those slivers off, the rest is too thin to stay.
    cut = shapely.difference(filled, shapely.buffer(lines, _HALF_WALL_M))
    core = shapely.buffer(cut, -_THIN_M / 2, join_style="mitre")
    wide = shapely.intersection(shapely.buffer(core, _THIN_M / 2, join_style="mitre"), cut)
    kept = shapely.union_all([p for p in _polygons(wide) if p.area >= _SMALLEST_FLOOR_M2])
    return shapely.simplify(shapely.buffer(kept, _HALF_WALL_M, join_style="mitre"), _NICHE_M / 4)


def _through(wall: FloatArray, reflectors: FloatArray) -> LineString:
    """The wall, led through the reflectors close to it, in the order along it."""
    a, b = wall[:2], wall[2:]
    if len(reflectors) == 0:
        return LineString([a, b])
    near = shapely.distance(shapely.points(reflectors), LineString([a, b])) <= CARRIES_M
    stops = np.vstack([a, b, reflectors[near]])
    along = (stops - a) @ (b - a)
    return LineString(stops[np.argsort(along, kind="stable")])


def _polygons(area: BaseGeometry) -> list[Polygon]:
    parts = area.geoms if isinstance(area, MultiPolygon) else [area]
    return [p for p in parts if isinstance(p, Polygon) and not p.is_empty]
