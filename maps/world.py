"""World: a floor with its landmarks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.arrays import digest
from maps.errors import LandmarkOutsideMap, MapFormatError, TooFewLandmarks
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet

Floor = FloorPlan | OccupancyGrid
OUTSIDE_TOLERANCE_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A floor (cells or polygons) with its landmarks, in one map frame W. Immutable.

    Attributes
    ----------
    name
        A label; not part of the content hash.
    floor
        :class:`~maps.grid.OccupancyGrid` or :class:`~maps.floor_plan.FloorPlan`.
    landmarks
        Positions in W.

    Raises
    ------
    MapFormatError
        If the name is not 1 to 200 printable characters.
    LandmarkOutsideMap
        If a landmark stands more than 0.5 m outside the floor's bounds (walls have thickness).
    """

    name: str
    floor: Floor
    landmarks: LandmarkSet

    def __post_init__(self) -> None:
        if not self.name or len(self.name) > 200 or not self.name.isprintable():
            raise MapFormatError(f"World name {self.name[:40]!r}: use 1 to 200 printable characters.")
        x0, y0, x1, y1 = self.floor.bounds
        for name, (x, y) in zip(self.landmarks.ids, self.landmarks.positions, strict=True):
            t = OUTSIDE_TOLERANCE_M
            if not (x0 - t <= x <= x1 + t and y0 - t <= y <= y1 + t):
                raise LandmarkOutsideMap(
                    f"Landmark '{name}' at ({x:g}, {y:g}) m is outside the map, which spans "
                    f"x {x0:g} … {x1:g} m, y {y0:g} … {y1:g} m; check frame and units."
                )

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(x_min, y_min, x_max, y_max)`` in W, m."""
        return self.floor.bounds

    def grid_frame(self, resolution: float) -> GridFrame:
        """Frame of a field over this world with cells of ``resolution`` m."""
        return self.floor.grid_frame(resolution)

    def with_landmarks(self, landmarks: LandmarkSet) -> World:
        """The same floor with other landmarks."""
        return World(self.name, self.floor, landmarks)

    def renamed(self, name: str) -> World:
        """The same world under another name."""
        return World(name, self.floor, self.landmarks)

    def require_triangulation(self) -> None:
        """Raise :class:`~maps.errors.TooFewLandmarks` unless there are at least three landmarks."""
        if len(self.landmarks) < 3:
            raise TooFewLandmarks(
                f"Map '{self.name}' has {len(self.landmarks)} landmarks; a fix needs 3. Add landmarks."
            )

    def content_hash(self) -> str:
        """SHA-256 (hex) of floor and landmarks."""
        return digest("world", self.floor.content_hash(), self.landmarks.content_hash())


def default_resolution(world: World, *, cells: int = 400_000) -> float:
    """A field resolution that suits the map: about ``cells`` cells, between 0.05 and 0.5 m."""
    x0, y0, x1, y1 = world.bounds
    raw = math.sqrt((x1 - x0) * (y1 - y0) / cells)
    steps = np.array([0.05, 0.1, 0.2, 0.25, 0.5])
    return float(steps[np.argmin(np.abs(np.log(steps / max(raw, 1e-9))))])
