"""What a world holds, in figures, and what in it will cause trouble, in findings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from scipy.ndimage import label
from scipy.spatial import KDTree

from maps.arrays import FloatArray, IntArray
from maps.floor_plan import FloorPlan
from maps.grid import OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.visibility import buried_landmarks
from maps.world import World

Severity = Literal["error", "warning", "info"]

#: Landmarks nearer to each other than this cannot be told apart by most sensors, m.
CLOSE_M = 0.05
#: All landmarks within this of one line count as collinear, m.
LINE_M = 0.05
#: Free regions smaller than this are specks, m².
SPECK_M2 = 1.0
#: Share of unknown cells from which it is worth a remark.
MUCH_UNKNOWN = 0.5
_USUAL_RESOLUTION_M = (0.01, 0.25)
#: A wall this far in front of a landmark blinds it: m on polygons, cells on grids.
_BLINDS_M, _BLINDS_CELLS = 0.05, 2.0
_NAMED = 6


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing to know about a world.

    Attributes
    ----------
    severity
        ``error``: no field can be built. ``warning``: probably a mistake. ``info``: good to know.
    code
        A stable word for programs.
    message
        For people: what, where, how much, what to do.
    """

    severity: Severity
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class WorldReport:
    """Figures of a world by name, for people, and findings, the worst first."""

    figures: dict[str, str]
    findings: tuple[Finding, ...]


def check_world(world: World) -> WorldReport:
    """Examine a world.

    Parameters
    ----------
    world
        Any world; what could not be built at all has raised an error before.

    Returns
    -------
    report
        Figures and findings; no finding of severity ``error`` means that a field can be built.
    """
    findings = [*_floor_findings(world), *_landmark_findings(world)]
    order = ("error", "warning", "info")
    return WorldReport(_figures(world), tuple(sorted(findings, key=lambda f: order.index(f.severity))))


def _figures(world: World) -> dict[str, str]:
    floor, marks = world.floor, world.landmarks
    x0, y0, x1, y1 = world.bounds
    out = {"name": world.name}
    if isinstance(floor, OccupancyGrid):
        frame = floor.frame
        cells = frame.n_rows * frame.n_cols
        opaque, unknown = np.count_nonzero(floor.opaque), np.count_nonzero(floor.unknown)
        out |= {
            "kind": "grid",
            "size": f"{frame.n_cols} × {frame.n_rows} cells, {frame.width_m:.2f} × {frame.height_m:.2f} m",
            "resolution": f"{frame.resolution:g} m",
            "origin": f"({frame.origin_x:.9g}, {frame.origin_y:.9g}) m, yaw {math.degrees(frame.yaw):g}°",
            "free area": f"{floor.free_area_m2:.2f} m²",
            "opaque": f"{opaque} cells ({opaque / cells:.1%})",
            "unknown": f"{unknown} cells ({unknown / cells:.1%})",
        }
    else:
        n_opaque = sum(floor.opaque)
        out |= {
            "kind": "polygons",
            "size": f"{x1 - x0:.2f} × {y1 - y0:.2f} m",
            "free area": f"{floor.free_area_m2:.2f} m²",
            "floor": f"{len(floor.floor)} polygons",
            "obstacles": f"{n_opaque} opaque, {len(floor.obstacles) - n_opaque} that can be seen through",
        }
    out["bounds"] = f"x {x0:g} … {x1:g} m, y {y0:g} … {y1:g} m"
    out["landmarks"] = f"{len(marks)}, {np.count_nonzero(marks.has_facing)} with a facing direction"
    if len(marks):
        out["survey sigma"] = f"{marks.sigma.min():g} … {marks.sigma.max():g} m"
    out["content"] = world.content_hash()[:12]
    return out


def _floor_findings(world: World) -> list[Finding]:
    floor = world.floor
    out = []
    if isinstance(floor, OccupancyGrid):
        low, high = _USUAL_RESOLUTION_M
        if not low <= floor.frame.resolution <= high:
            usual = f"{low:g} … {high:g} m"
            text = f"Cells measure {floor.frame.resolution:g} m, usual is {usual}. Check the resolution."
            out.append(Finding("warning", "odd_resolution", text))
        unknown = float(np.mean(floor.unknown))
        if unknown > MUCH_UNKNOWN:
            text = f"{unknown:.0%} of the cells are unknown: not free, and not opaque unless asked otherwise."
            out.append(Finding("info", "much_unknown", text))
        if not floor.opaque.any():
            out.append(
                Finding("warning", "no_walls", "Nothing stops a line of sight: there is no opaque cell.")
            )
    areas = free_regions(world)
    if len(areas) == 0:
        text = "There is no free floor: no place for a robot. Check negate and the thresholds of the map."
        return [*out, Finding("error", "no_free_space", text)]
    large = areas[areas >= SPECK_M2]
    if len(large) > 1:
        shares = ", ".join(f"{a:.1f} m² ({a / areas.sum():.1%})" for a in large[:_NAMED])
        more = f" and {len(large) - _NAMED} more" if len(large) > _NAMED else ""
        text = f"The free floor falls into {len(large)} regions without a way between them: {shares}{more}."
        out.append(Finding("info", "disconnected", text))
    return out


def free_regions(world: World) -> FloatArray:
    """Areas of the connected regions of free floor, m², the largest first; cells meet at their sides."""
    floor = world.floor
    if isinstance(floor, OccupancyGrid):
        regions, n = label(floor.free)
        areas = np.bincount(regions.ravel(), minlength=n + 1)[1:] * floor.frame.resolution**2
    else:
        areas = shapely.area(shapely.get_parts(floor.free_space()))
    return np.asarray(np.sort(areas)[::-1], dtype=np.float64)


def _landmark_findings(world: World) -> list[Finding]:
    marks = world.landmarks
    out = []
    if len(marks) < 3:
        text = f"There are {len(marks)} landmarks; a fix needs three that are seen at once. Add landmarks."
        out.append(Finding("error", "too_few_landmarks", text))
    if len(marks) == 0:
        return out
    buried = np.nonzero(buried_landmarks(world))[0]
    if len(buried):
        text = (
            f"{_names(marks, buried)} stand inside walls and cannot be seen from anywhere. Check the survey."
        )
        out.append(Finding("warning", "buried", text))
    blind = np.setdiff1d(_faces_wall(world), buried)
    if len(blind):
        text = (
            f"{_names(marks, blind)} face into a wall. Check facing: it points from the landmark to the room."
        )
        out.append(Finding("warning", "faces_wall", text))
    pairs = sorted(KDTree(marks.positions).query_pairs(CLOSE_M))
    if pairs:
        named = ", ".join(f"'{marks.ids[i]}' and '{marks.ids[j]}'" for i, j in pairs[:_NAMED])
        more = f" and {len(pairs) - _NAMED} more pairs" if len(pairs) > _NAMED else ""
        text = f"Closer than {CLOSE_M:g} m to each other: {named}{more}. Surveyed twice?"
        out.append(Finding("warning", "close_together", text))
    if len(marks) >= 3 and _spread_m(marks.positions) < LINE_M:
        text = (
            f"All {len(marks)} landmarks stand on one line: fixes are poor near it and ambiguous across it."
        )
        out.append(Finding("info", "collinear", text))
    return out


def _spread_m(positions: FloatArray) -> float:
    """Largest distance from the line that fits best, m."""
    centred = positions - positions.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    return float(np.abs(centred @ axes[1]).max())


def _faces_wall(world: World) -> IntArray:
    marks, floor = world.landmarks, world.floor
    facing = np.where(marks.has_facing, marks.facing, 0.0)
    normal = np.stack([np.cos(facing), np.sin(facing)], axis=-1)
    if isinstance(floor, FloorPlan):
        blind = floor.opaque_at(marks.positions + _BLINDS_M * normal)
    else:
        # One cell of its own wall may lie before a landmark; behind it there must be floor.
        near, far = (marks.positions + k * floor.frame.resolution * normal for k in (1.0, _BLINDS_CELLS))
        blind = floor.opaque_at(far) | (floor.opaque_at(near) & ~floor.free_at(far))
    return np.asarray(np.nonzero(marks.has_facing & blind)[0])


def _names(marks: LandmarkSet, which: IntArray) -> str:
    named = ", ".join(f"'{marks.ids[int(i)]}'" for i in which[:_NAMED])
    more = f" and {len(which) - _NAMED} more" if len(which) > _NAMED else ""
    return f"{len(which)} landmarks ({named}{more})" if len(which) > 1 else f"Landmark {named}"
