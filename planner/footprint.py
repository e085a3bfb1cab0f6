"""Polygonal footprints: a robot's outline, discs that cover it, and the headings at which it fits a cell."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Polygon
from shapely.affinity import affine_transform

from maps.arrays import BoolArray, FloatArray, frozen
from maps.clearance import TOUCH_M, ClearanceIndex
from maps.grid import GridFrame
from planner.errors import InvalidProblem
from planner.kernels.footprint import UNSURE, fit_rows

MAX_CORNERS = 100
MAX_SIZE_M = 50.0
# The outline's rim is cut into pieces of about this share of its length; a disc about a piece reaches over
# the rim by at most half of that.
_RIM_SHARE = 1 / 36
# Rows of a task, poses of a part: an early end waits for one of them.
_BAND_ROWS = 16
_PART = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """Outline of a robot in its own frame B: x ahead, y to the left, the origin its centre of motion.

    Attributes
    ----------
    corners
        Shape (K, 2): m, in order, without a repeated end.
    discs
        Shape (D, 3): x, y, radius, m: together they cover the outline (and a little more).

    Raises
    ------
    InvalidProblem
        If the outline has fewer than three corners, crosses itself, is not finite, has no area, does not
        hold the origin, or is larger than 50 m.
    """

    corners: FloatArray
    discs: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", frozen(self.corners))
        object.__setattr__(self, "discs", frozen(self.discs))

    @classmethod
    def of(cls, corners: npt.ArrayLike) -> Footprint:
        """Footprint of an outline (K, 2), m."""
        c = np.asarray(corners, dtype=np.float64)
        if c.ndim != 2 or c.shape[1] != 2 or not 3 <= len(c) <= MAX_CORNERS:
            raise InvalidProblem(f"A footprint has 3 to {MAX_CORNERS} corners (x, y); this one is {c.shape}.")
        if not np.isfinite(c).all() or np.abs(c).max() > MAX_SIZE_M:
            raise InvalidProblem(f"A footprint's corners must be finite and within ±{MAX_SIZE_M:g} m.")
        outline = Polygon(c)
        if not outline.is_valid:
            raise InvalidProblem(f"The footprint is no simple polygon: {shapely.is_valid_reason(outline)}.")
        if outline.area < 1e-6:
            raise InvalidProblem(f"The footprint has an area of {outline.area:g} m²; give corners in order.")
        if not outline.covers(shapely.Point(0.0, 0.0)):
            raise InvalidProblem(
                "The footprint does not hold the robot's centre (0, 0), about which it turns."
            )
        return cls(c, _cover(outline))

    @property
    def key(self) -> bytes:
        """The same for outlines that are equal."""
        return self.corners.tobytes() + self.discs.tobytes()

    @property
    def outline(self) -> Polygon:
        """The polygon, in B."""
        return Polygon(self.corners)

    @property
    def inscribed_radius(self) -> float:
        """Largest disc about the origin inside the outline, m: with less clearance the robot never fits."""
        return float(self.outline.exterior.distance(shapely.Point(0.0, 0.0)))

    @property
    def circumscribed_radius(self) -> float:
        """Smallest disc about the origin that holds the outline, m: with that clearance it always fits."""
        return float(np.hypot(*self.corners.T).max())

    def at(self, pose: npt.ArrayLike) -> Polygon:
        """The outline in W at a pose (3,): x, y (m), heading (rad)."""
        x, y, theta = (float(v) for v in np.asarray(pose))
        c, s = math.cos(theta), math.sin(theta)
        return affine_transform(self.outline, [c, -s, s, c, x, y])

    def disc_centres(self, poses: npt.ArrayLike) -> FloatArray:
        """Centres (..., D, 2) in W of the discs at poses (..., 3)."""
        p = np.asarray(poses, dtype=np.float64)
        c, s = np.cos(p[..., 2, None]), np.sin(p[..., 2, None])
        x, y = self.discs[:, 0], self.discs[:, 1]
        return np.stack([p[..., 0, None] + c * x - s * y, p[..., 1, None] + s * x + c * y], axis=-1)

    def clearance(self, index: ClearanceIndex, poses: npt.ArrayLike) -> FloatArray:
        """Clearance (N,) of the discs at poses (N, 3), m: at most that of the outline; negative: touching."""
        centres = self.disc_centres(np.asarray(poses, dtype=np.float64).reshape(-1, 3))
        d = index.distance(centres.reshape(-1, 2)).reshape(centres.shape[:2])
        return np.asarray((d - self.discs[:, 2]).min(axis=1))

    def fits(self, free: Polygon | shapely.MultiPolygon, poses: npt.ArrayLike) -> BoolArray:
        """Whether the outline itself lies in free space (W) at poses (N, 3)."""
        shapely.prepare(free)
        outlines = [self.at(pose) for pose in np.asarray(poses, dtype=np.float64).reshape(-1, 3)]
        return np.asarray(shapely.covers(free, np.array(outlines, dtype=object)))


def fitting_headings(
    footprint: Footprint,
    index: ClearanceIndex,
    frame: GridFrame,
    centre_clearance: FloatArray,
    headings: npt.ArrayLike,
    *,
    stop: npt.NDArray[np.uint8] | None = None,
    threads: int | None = None,
) -> BoolArray | None:
    """Cells (H, ny, nx) at whose centre the covering discs are free at each heading (H,), rad.

    Exact for the discs. Cells with less clearance than the inscribed radius never fit, those with the
    circumscribed one always; only between them are discs looked at.

    Parameters
    ----------
    footprint, index, frame
        Outline, boundary of free space, cells.
    centre_clearance
        Shape (ny, nx), m: at the cells' centres, 0 where they are not free.
    headings
        Shape (H,), in W, rad.
    stop
        Shape (1,); another thread sets it to end early, then there is no answer.
    threads
        Default: one per core. The result does not depend on it.
    """
    angles = np.asarray(headings, dtype=np.float64)
    turns = np.column_stack([np.cos(angles), np.sin(angles)])
    flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
    transform = (frame.origin_x, frame.origin_y, math.cos(frame.yaw), math.sin(frame.yaw), frame.resolution)
    out = np.zeros((len(angles), *frame.shape), dtype=np.uint8)
    args = (
        turns,
        np.array(footprint.discs),
        footprint.inscribed_radius,
        footprint.circumscribed_radius,
        TOUCH_M,
        np.array(centre_clearance),
        np.array(transform),
        tuple(np.array(a) for a in index.arrays),
        flag,
        out,
    )

    def band(first: int) -> bool:
        return bool(fit_rows(first, min(first + _BAND_ROWS, frame.n_rows), *args))

    with ThreadPoolExecutor(max_workers=threads or os.cpu_count() or 1) as pool:
        if not all(pool.map(band, range(0, frame.n_rows, _BAND_ROWS))):
            return None
    which, rows, cols = np.nonzero(out == UNSURE)
    centres = frame.to_world(np.column_stack([cols + 0.5, rows + 0.5]))
    for part in np.array_split(np.arange(len(which)), max(1, len(which) // _PART)):
        if flag[0] != 0:
            return None
        poses = np.column_stack([centres[part], angles[which[part]]])
        free = footprint.clearance(index, poses) >= -TOUCH_M if len(part) else np.zeros(0, dtype=np.bool_)
        out[which[part], rows[part], cols[part]] = free
    return np.asarray(out.astype(np.bool_))


def _cover(outline: Polygon) -> FloatArray:
    """Discs (D, 3): large ones inside, and small ones about what is left along the rim."""
    side = outline.length * _RIM_SHARE
    box = outline.minimum_rotated_rectangle
    corner, right, _, left = np.asarray(box.exterior.coords)[:4]
    u, v = right - corner, left - corner
    nu, nv = (max(1, math.ceil(float(np.hypot(*w)) / side)) for w in (u, v))
    pieces = []
    for i in range(nu):
        for j in range(nv):
            cell = Polygon(
                [
                    corner + u * a / nu + v * b / nv
                    for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
                ]
            )
            piece = outline.intersection(cell)
            if piece.area > 0:
                hull = np.asarray(piece.convex_hull.exterior.coords)
                pieces.append((hull, np.asarray(piece.centroid.coords)[0]))
    centres = np.array([c for _, c in pieces])
    depth = np.array([outline.exterior.distance(shapely.Point(c)) for c in centres])
    discs: list[tuple[float, float, float]] = []
    left_over = list(range(len(pieces)))
    for k in np.argsort(-depth, kind="stable"):
        x, y = centres[k]
        within = [i for i in left_over if np.hypot(*(pieces[i][0] - [x, y]).T).max() <= depth[k]]
        if len(within) >= 2:
            discs.append((x, y, float(depth[k])))
            left_over = [i for i in left_over if i not in within]
    for i in left_over:
        hull, (x, y) = pieces[i]
        discs.append((x, y, float(np.hypot(*(hull - [x, y]).T).max())))
    return np.array(discs)
