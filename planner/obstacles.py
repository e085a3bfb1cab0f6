"""Walls and areas to avoid as obstacles of one kind: clearance of places from both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely import Point, Polygon

from maps.arrays import FloatArray, frozen
from maps.clearance import ClearanceIndex
from maps.grid import GridFrame
from maps.kernels.clearance import points_distance

if TYPE_CHECKING:
    from planner.context import PlanningContext

# A place on an area's boundary, up to rounding, m.
_ON_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Everything that a disc must not touch in one question.

    Attributes
    ----------
    clearance
        Segments of the walls and of the areas' outlines; its distances are right in free space.
    centre_clearance
        Shape (ny, nx), m: exact clearance of the cells' centres from both; 0 in walls and in areas.
    avoid
        The areas, W, m.
    """

    clearance: ClearanceIndex
    centre_clearance: FloatArray
    avoid: tuple[Polygon, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre_clearance", frozen(self.centre_clearance))

    @classmethod
    def of(cls, context: PlanningContext, avoid: tuple[Polygon, ...]) -> Obstacles:
        """The walls of a field's world and areas to avoid; see ``PlanningContext.obstacles``."""
        if not avoid:
            return cls(context.clearance, context.centre_clearance, ())
        frame, floor = context.field.frame, context.clearance.floor
        outlines = [_outline(polygon) for polygon in avoid]
        room = np.array(context.centre_clearance)
        most = float(room.max(initial=0.0))
        for polygon, outline in zip(avoid, outlines, strict=True):
            # Further away the walls are nearer.
            near = cells_around(frame, polygon, most)
            here = room[near]
            rows, cols = np.nonzero(here)
            if len(rows) == 0:
                continue
            centres = frame.centres(*near)[rows, cols]
            away = np.empty(len(centres))
            points_distance(centres, math.inf, away, *context.clearance.from_edges(floor, outline).arrays)
            shapely.prepare(polygon)
            away[shapely.intersects_xy(polygon, *centres.T)] = 0.0
            here[rows, cols] = np.minimum(here[rows, cols], away)
        return cls(context.clearance.with_edges(np.concatenate(outlines)), room, avoid)

    def areas_at(self, x: float, y: float) -> tuple[int, ...]:
        """Numbers, from 1, of the areas that hold a place or have it on their outline."""
        place = Point(x, y)
        return tuple(k for k, polygon in enumerate(self.avoid, 1) if polygon.distance(place) <= _ON_M)


def cells_around(frame: GridFrame, polygon: Polygon, distance: float = 0.0) -> tuple[slice, slice]:
    """Rows and columns of a frame that hold all cells within a distance, m, of a polygon's bounds."""
    x0, y0, x1, y1 = polygon.bounds
    reach = distance + frame.resolution
    corners = np.array([[x, y] for x in (x0 - reach, x1 + reach) for y in (y0 - reach, y1 + reach)])
    cells = frame.to_grid(corners)
    (c0, r0), (c1, r1) = np.floor(cells.min(axis=0)).astype(int), np.ceil(cells.max(axis=0)).astype(int)

    def within(first: int, last: int, count: int) -> slice:
        begin = min(max(first, 0), count)
        return slice(begin, max(begin, min(last + 1, count)))

    return within(int(r0), int(r1), frame.n_rows), within(int(c0), int(c1), frame.n_cols)


def _outline(polygon: Polygon) -> FloatArray:
    """Segments (K, 4) of a polygon's rings."""
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    return np.concatenate([np.concatenate([ring[:-1], ring[1:]], axis=1) for ring in rings])
