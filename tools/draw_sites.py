"""Draws the two bundled sites and writes them as world files into ``maps/sites``.

Run it from anywhere: ``python tools/draw_sites.py [FOLDER]``. The same drawing gives the same bytes.
Lengths in m, angles in rad; x to the right, y up, corner of the room at (0, 0), walls outside of it.
"""  # noqa: INP001

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Point = tuple[float, float]
Feature = dict[str, Any]

EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, -math.pi, -math.pi / 2


class Site:
    """A drawing: polygons and landmarks in the order in which they were drawn."""

    def __init__(self, name: str, half_angle: float, prefix: str) -> None:
        self.name = name
        self.half_angle = half_angle
        self.prefix = prefix
        self.features: list[Feature] = []
        self.n_landmarks = 0

    def polygon(self, corners: Iterable[Point], *, kind: str = "obstacle", opaque: bool = True) -> None:
        """Add a polygon; corners counter-clockwise, not closed."""
        ring = [[round(x, 3), round(y, 3)] for x, y in corners]
        properties: dict[str, Any] = {"kind": kind}
        if kind == "obstacle":
            properties["opaque"] = opaque
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        self.features.append({"type": "Feature", "properties": properties, "geometry": geometry})

    def box(
        self, x0: float, y0: float, x1: float, y1: float, *, kind: str = "obstacle", opaque: bool = True
    ) -> None:
        """Add a box from its lower left to its upper right corner."""
        self.polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], kind=kind, opaque=opaque)

    def disc(self, x: float, y: float, radius: float, *, opaque: bool, corners: int = 12) -> None:
        """Add a regular polygon around a circle's centre."""
        turn = [2 * math.pi * (k + 0.5) / corners for k in range(corners)]
        self.polygon([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in turn], opaque=opaque)

    def landmark(self, x: float, y: float, facing: float) -> None:
        """Add a landmark that looks along ``facing``; ids count up in drawing order."""
        self.n_landmarks += 1
        properties = {
            "kind": "landmark",
            "id": f"{self.prefix}{self.n_landmarks:02d}",
            "facing_rad": facing,
            "half_angle_rad": self.half_angle,
        }
        geometry = {"type": "Point", "coordinates": [round(x, 3), round(y, 3)]}
        self.features.append({"type": "Feature", "properties": properties, "geometry": geometry})

    def text(self) -> str:
        """The world file, one feature per line."""
        lines = ",\n".join(json.dumps(f) for f in self.features)
        name = json.dumps(self.name)
        return f'{{"type": "FeatureCollection", "name": {name}, "features": [\n{lines}\n]}}\n'


def mas97_room() -> Site:
    """A room of 15 m × 15 m after Madsen, Andersen and Sørensen (1997): boxes, landmarks, a free diagonal."""
    site = Site("mas97_room", half_angle=1.4, prefix="L")
    size, wall = 15.0, 0.2
    site.box(-wall, -wall, size + wall, size + wall, kind="floor")
    site.box(-wall, -wall, size + wall, 0.0)
    site.box(-wall, size, size + wall, size + wall)
    site.box(-wall, 0.0, 0.0, size)
    site.box(size, 0.0, size + wall, size)

    site.box(1.2, 7.0, 3.4, 9.0)
    site.box(4.6, 10.0, 6.4, 12.4)
    site.box(1.0, 12.6, 3.2, 13.6)
    site.box(9.0, 12.4, 11.2, 13.4)
    site.box(6.0, 2.0, 8.2, 4.0)
    site.box(9.8, 5.4, 11.6, 7.2)
    site.box(11.8, 1.4, 13.2, 3.4)
    site.box(13.4, 8.0, 14.4, 9.6)

    for x, y, facing in (
        # south, east, north and west wall
        (2.2, 0.0, NORTH),
        (4.9, 0.0, NORTH),
        (8.9, 0.0, NORTH),
        (11.6, 0.0, NORTH),
        (14.3, 0.0, NORTH),
        (15.0, 1.9, WEST),
        (15.0, 4.6, WEST),
        (15.0, 7.1, WEST),
        (15.0, 11.4, WEST),
        (15.0, 13.6, WEST),
        (12.6, 15.0, SOUTH),
        (10.4, 15.0, SOUTH),
        (7.7, 15.0, SOUTH),
        (4.0, 15.0, SOUTH),
        (0.0, 11.2, EAST),
        (0.0, 8.3, EAST),
        (0.0, 5.9, EAST),
        (0.0, 2.0, EAST),
        # boxes
        (6.0, 3.1, WEST),
        (2.6, 7.0, SOUTH),
        (6.4, 11.0, EAST),
        (10.0, 12.4, SOUTH),
        (9.8, 6.4, WEST),
        (13.4, 8.7, WEST),
    ):
        site.landmark(x, y, facing)
    return site


# --- warehouse ---

_RACK_DEPTH = 2.4
_BAY = 2.8
_RACK_ROWS = (14.8, 20.0, 25.2, 30.4, 35.6)
_WEST_BLOCK = (8.8, 31.2)
_EAST_BLOCK = (34.2, 51.0)
_COLUMNS = (10.0, 20.0, 30.0, 40.0, 50.0)
_DOORS = (1.4, 5.6, 11.4, 15.6, 21.4, 25.6, 31.4, 35.6, 41.4)
_DOOR_WIDTH = 3.0
_PILASTER = 0.25


def _shell(site: Site) -> None:
    wall, pocket = 0.3, 0.15
    site.box(-wall, -wall, 60.0 + wall, 40.0 + wall, kind="floor")
    # South wall with a pocket for each dock door.
    top: list[Point] = []
    for x in reversed(_DOORS):
        top += [(x + _DOOR_WIDTH, 0.0), (x + _DOOR_WIDTH, -pocket), (x, -pocket), (x, 0.0)]
    site.polygon([(-wall, -wall), (60.0 + wall, -wall), (60.0 + wall, 0.0), *top, (-wall, 0.0)])
    site.box(-wall, 40.0, 60.0 + wall, 40.0 + wall)
    site.box(-wall, 0.0, 0.0, 40.0)
    site.box(60.0, 0.0, 60.0 + wall, 40.0)
    # Steel frame, 10 m apart: pilasters on the walls, free columns in the south, the rest inside racks.
    for x in _COLUMNS:
        site.box(x - 0.2, 40.0 - _PILASTER, x + 0.2, 40.0)
        site.box(x - 0.2, 0.0, x + 0.2, _PILASTER)
        site.box(x - 0.2, 9.8, x + 0.2, 10.2)
    for y in (10.0, 20.0, 30.0):
        site.box(0.0, y - 0.2, _PILASTER, y + 0.2)
        site.box(60.0 - _PILASTER, y - 0.2, 60.0, y + 0.2)


def _rack_boxes() -> list[tuple[float, float, float, float]]:
    half = _RACK_DEPTH / 2
    boxes = []
    for row, y in enumerate(_RACK_ROWS):
        boxes.append((_WEST_BLOCK[0], y - half, _WEST_BLOCK[1], y + half))
        # The northern east rack is two bays shorter: room for block storage.
        end = _EAST_BLOCK[1] - (2 * _BAY if row == len(_RACK_ROWS) - 1 else 0.0)
        boxes.append((_EAST_BLOCK[0], y - half, end, y + half))
    return boxes


def _racks(site: Site) -> None:
    post, away = 0.09, 0.16
    for x0, y0, x1, y1 in _rack_boxes():
        site.box(x0, y0, x1, y1)
        # Low guard posts before the end frames.
        for x, y in (
            (x0 - away, y0 + post),
            (x0 - away, y1 - post),
            (x1 + away, y0 + post),
            (x1 + away, y1 - post),
        ):
            site.disc(x, y, post, opaque=False, corners=8)


def _docks(site: Site) -> None:
    for x in _DOORS:
        for bollard in (x - 0.3, x + _DOOR_WIDTH + 0.3):
            site.disc(bollard, 0.55, 0.12, opaque=False, corners=8)
    # Staging lanes: pallets two abreast, as many rows as goods came in; low, seen over.
    lanes = (0, 0, 3, 4, 0, 2, 4, 3, 1)
    taken = {(2, 2, 1), (6, 3, 0), (7, 0, 1)}
    for lane, (x, rows) in enumerate(zip(_DOORS, lanes, strict=True)):
        for row in range(rows):
            for column in range(2):
                if (lane, row, column) in taken:
                    continue
                left, low = x + 0.55 + 1.05 * column, 2.7 + 1.35 * row
                site.box(left, low, left + 0.8, low + 1.2, opaque=False)
    # Telescopic belt at the first door, stretch wrapper at the head of the conveyor.
    site.box(2.5, 0.9, 3.3, 8.4, opaque=False)
    site.disc(3.0, 10.9, 0.9, opaque=False, corners=16)
    # Shipping booth.
    site.box(44.0, 5.2, 46.8, 7.8)


def _packing(site: Site) -> None:
    # Conveyor with three spurs to the packing benches on the west wall.
    spurs = (14.4, 22.4, 26.8)
    west: list[Point] = []
    for y in reversed(spurs):
        west += [(2.6, y + 0.6), (1.5, y + 0.6), (1.5, y), (2.6, y)]
    site.polygon([(2.6, 12.6), (3.4, 12.6), (3.4, 31.4), (2.6, 31.4), *west], opaque=False)
    for y in spurs:
        site.box(0.0, y - 0.7, 0.8, y + 1.3, opaque=False)
    # Cage for valuables: mesh, gate of 1.8 m towards the aisle, shelves inside.
    site.box(0.0, 34.2, 6.4, 34.3, opaque=False)
    site.box(6.3, 34.3, 6.4, 36.6, opaque=False)
    site.box(6.3, 38.4, 6.4, 40.0, opaque=False)
    site.box(0.6, 39.4, 5.6, 40.0)
    site.box(0.0, 35.0, 0.5, 38.6)


def _offices(site: Site) -> None:
    # South-east corner: two rooms, doors of 1.2 m.
    inner = 0.15
    site.box(48.0, 0.0, 48.0 + inner, 5.6)
    site.box(48.0, 6.8, 48.0 + inner, 8.0)
    site.box(48.0, 8.0, 56.0, 8.0 + inner)
    site.box(57.2, 8.0, 60.0, 8.0 + inner)
    site.box(54.0, 0.0, 54.0 + inner, 5.0)
    site.box(54.0, 6.2, 54.0 + inner, 8.0)
    site.box(50.6, 0.0, 53.0, 0.6)
    site.box(49.6, 2.6, 51.2, 3.4, opaque=False)
    site.box(51.8, 4.6, 53.4, 5.4, opaque=False)
    site.box(56.0, 2.6, 58.4, 3.8, opaque=False)
    site.box(59.5, 4.6, 60.0, 6.8)


def _east_side(site: Site) -> None:
    inner = 0.15
    # Charging bays along the east wall, guard walls between them, closed off to the north.
    for y in (10.5, 12.1, 13.7):
        site.box(59.4, y, 60.0, y + 0.7)
        site.box(57.8, y + 1.1, 60.0, y + 1.2)
    site.box(54.6, 19.4, 60.0, 19.4 + inner)
    # Returns: block stacks.
    for x, y in ((57.0, 20.8), (57.0, 23.4), (54.2, 27.4), (57.0, 27.4)):
        site.box(x, y, x + 2.4, y + 1.6)
    # Workshop in the north-east corner, gate of 2.2 m.
    site.box(54.0, 30.6, 60.0, 30.6 + inner)
    site.box(54.0, 30.6 + inner, 54.0 + inner, 36.4)
    site.box(54.0, 38.6, 54.0 + inner, 40.0)
    site.box(59.2, 32.0, 60.0, 36.0)
    site.box(55.8, 33.0, 57.6, 34.0, opaque=False)
    site.box(56.0, 39.3, 59.0, 40.0)
    # Block storage beside the short rack.
    site.box(46.4, 34.5, 47.6, 36.7)
    site.box(48.0, 34.5, 49.2, 35.7)


def _wall_reflectors(site: Site) -> None:
    for x, y, facing in (
        # south wall: between the doors and on pilasters
        (0.6, 0.0, NORTH),
        (5.0, 0.0, NORTH),
        (10.0, _PILASTER, NORTH),
        (15.0, 0.0, NORTH),
        (20.0, _PILASTER, NORTH),
        (25.1, 0.0, NORTH),
        (35.0, 0.0, NORTH),
        (40.0, _PILASTER, NORTH),
        (46.2, 0.0, NORTH),
        # office front
        (48.0, 3.1, WEST),
        (48.0, 7.4, WEST),
        (50.6, 8.15, NORTH),
        (54.9, 8.15, NORTH),
        # east wall: charging, the three that end the first aisle, returns
        (60.0, 9.2, WEST),
        (60.0, 16.4, WEST),
        (60.0, 17.6, WEST),
        (60.0, 18.4, WEST),
        (56.3, 19.55, NORTH),
        (60.0, 22.9, WEST),
        (60.0, 26.3, WEST),
        # workshop front
        (54.0, 32.2, WEST),
        (54.0, 35.4, WEST),
        # north wall
        (52.1, 40.0, SOUTH),
        (45.3, 40.0, SOUTH),
        (36.9, 40.0, SOUTH),
        (28.8, 40.0, SOUTH),
        (19.1, 40.0, SOUTH),
        (8.2, 40.0, SOUTH),
        # west wall: cage, packing, the three that end the first aisle
        (0.0, 33.1, EAST),
        (_PILASTER, 30.0, EAST),
        (0.0, 24.9, EAST),
        (0.0, 18.6, EAST),
        (0.0, 17.7, EAST),
        (0.0, 16.9, EAST),
        (_PILASTER, 10.1, EAST),
        (0.0, 3.4, EAST),
    ):
        site.landmark(x, y, facing)


def _rack_reflectors(site: Site) -> None:
    half = _RACK_DEPTH / 2
    # Rack ends, a little off their middle, never twice the same.
    for x, facing, shifts in (
        (_WEST_BLOCK[0], WEST, (0.4, -0.5, 0.7, -0.2, 0.3)),
        (_WEST_BLOCK[1], EAST, (-0.3, 0.6, -0.6, 0.2, -0.7)),
        (_EAST_BLOCK[0], WEST, (0.7, -0.1, 0.5, -0.6, 0.4)),
        (_EAST_BLOCK[1], EAST, (-0.6, 0.3, -0.4, 0.5)),
    ):
        for y, shift in zip(_RACK_ROWS, shifts, strict=False):
            site.landmark(x, y + shift, facing)
    # Uprights of the aisles that vehicles use: the main aisle in the south, the second and the fourth.
    for x in (13.0, 21.4, 27.0, 38.4, 46.8):
        site.landmark(x, _RACK_ROWS[0] - half, SOUTH)
    for row, north, south in (
        (1, (11.6, 20.0, 28.4, 39.8, 48.2), (14.4, 25.6, 37.0, 45.4)),
        (3, (14.4, 22.8, 37.0, 45.4), (10.2, 18.6, 27.0, 41.2)),
    ):
        for x in north:
            site.landmark(x, _RACK_ROWS[row] + half, NORTH)
        for x in south:
            site.landmark(x, _RACK_ROWS[row + 1] - half, SOUTH)
    # The first aisle has one per block: with the three at its ends, too few for a good fix.
    site.landmark(22.8, _RACK_ROWS[1] - half, SOUTH)
    site.landmark(42.6, _RACK_ROWS[1] - half, SOUTH)


def _column_reflectors(site: Site) -> None:
    for x in _COLUMNS:
        site.landmark(x, 9.8, SOUTH)
        if x not in {20.0, 30.0}:
            site.landmark(x, 10.2, NORTH)
    site.landmark(29.8, 10.05, WEST)


def warehouse() -> Site:
    """A hall of 60 m × 40 m: docks south, racks, packing west, workshop and offices east."""
    site = Site("warehouse", half_angle=1.3963, prefix="R")
    _shell(site)
    _racks(site)
    _docks(site)
    _packing(site)
    _offices(site)
    _east_side(site)
    _wall_reflectors(site)
    _rack_reflectors(site)
    _column_reflectors(site)
    return site


def main() -> None:
    """Write both sites."""
    here = Path(__file__).resolve().parent.parent / "maps" / "sites"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else here
    for site in (mas97_room(), warehouse()):
        (folder / f"{site.name}.geojson").write_text(site.text(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
