"""Where a robot can get to within a cost, a length or a time, and without exceeding bounds: as polygons."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely
from scipy.ndimage import label
from shapely import Polygon

from maps.arrays import BoolArray, IntArray, frozen
from maps.grid import GridFrame
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_to_go import Place
from planner.ends import check_ends
from planner.errors import InvalidProblem
from planner.place_reason import bounds_broken_at
from planner.travel import Travel

Measure = Literal["cost", "length", "time"]
MEASURES = ("cost", "length", "time")
MAX_DEADLINE_S = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The part of the map that is within reach of a place.

    Attributes
    ----------
    place
        (x, y) in W, m.
    measure, limit
        What was bounded, and by how much (m of cost or length, or s); inf: whatever is connected.
    cells
        Shape (ny, nx): cells whose centre is within reach.
    polygons
        Outlines of these cells in W, m, with holes, largest first; valid, simplified by at most half a cell.
        Cells that touch at a corner only are in different polygons or apart, though a robot may pass there.
    area
        Of the cells, m².
    is_complete
        False when the deadline or a stop came first: the region is a part of the true one.
    warnings
        Why nothing is within reach, where the place itself is the reason.
    """

    place: Place
    measure: Measure
    limit: float
    cells: BoolArray
    polygons: tuple[Polygon, ...]
    area: float
    is_complete: bool
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "cells", frozen(self.cells, np.bool_))


def reachable_region(
    context: PlanningContext,
    place: Place,
    *,
    travel: Travel,
    measure: Measure = "cost",
    limit: float = math.inf,
    deadline: float = 30.0,
    stop: npt.NDArray[np.uint8] | None = None,
) -> Region:
    """Region that a robot reaches from a place within a limit, under the bounds of ``travel``.

    Ways can be driven in both directions at the same cost, so it is also the region from which the place is
    reached: one question answers both.

    Parameters
    ----------
    context
        The field.
    place
        (x, y) in W, m.
    travel
        Robot, cost per metre, and bounds: with ``max_r95`` the region is what is reached without ever being
        less certain; ``blind_r95`` None keeps out of cells without a fix.
    measure
        ``cost``: of the cheapest way. ``length``: of the shortest way, m. ``time``: that length at
        ``max_speed``, s, without the time to speed up and slow down.
    limit
        Largest cost, length or time, on 8-connected paths between cell centres; inf: no limit.
    deadline
        Time for the search, s.
    stop
        Shape (1,): another thread sets it to end early.

    Returns
    -------
    region
        A cell belongs to it when its centre is within the limit; the area is exact for these cells. What lies
        behind passages that leave less than half a cell on both sides of the robot may be missing.

    Raises
    ------
    StartOutsideMap, StartOccupied
        If the robot cannot stand at the place.
    InvalidProblem
        If the measure is unknown, or limit or deadline are not positive.
    """
    if measure not in MEASURES:
        raise InvalidProblem(f"The measure is '{measure}'; use one of {', '.join(MEASURES)}.")
    if not limit > 0:
        raise InvalidProblem(f"The limit is {limit}; it must be above 0.")
    if not 0 < deadline <= MAX_DEADLINE_S:
        raise InvalidProblem(f"The deadline is {deadline} s; it must be above 0 and at most 600 s.")
    problem = travel.problem(place, place)
    check_ends(problem, context)
    graph = travel.graph(context, by_length=measure != "cost")
    most = limit * travel.max_speed if measure == "time" else limit
    with Clock(deadline).stop_flag(stop) as flag:
        found = graph.costs_to(problem.start, limit=most * (1 + 1e-9), stop=flag)
    cells = found.cost <= most if math.isfinite(most) else np.isfinite(found.cost)
    frame = context.field.frame
    polygons = polygons_of_cells(cells, frame)
    area = float(np.count_nonzero(cells)) * frame.resolution**2
    warnings: tuple[str, ...] = ()
    if not polygons and found.is_complete:
        x, y = problem.start
        broken = bounds_broken_at(problem.start, problem, context)
        warnings = tuple(f"No way can begin at ({x:g}, {y:g}) m itself: {reason}." for reason in broken)
    return Region(problem.start, measure, limit, cells, polygons, area, found.is_complete, warnings)


def polygons_of_cells(cells: BoolArray, frame: GridFrame) -> tuple[Polygon, ...]:
    """Outlines of cells (ny, nx) in W, m, largest first, with holes, simplified by at most half a cell.

    One polygon for each part of cells that are connected by their sides; none overlaps another by more than
    the simplification, all are valid.
    """
    parts, _ = label(cells)
    boxes, of_part = _boxes(parts)
    if len(boxes) == 0:
        return ()
    order = np.argsort(of_part, kind="stable")
    cuts = np.flatnonzero(np.diff(of_part[order])) + 1
    out = []
    for mine in np.split(order, cuts):
        c0, r0, c1, r1 = boxes[mine].T.astype(np.float64)
        whole = shapely.union_all(shapely.box(c0, r0, c1, r1))
        smooth = shapely.simplify(whole, 0.5, preserve_topology=True)
        if not smooth.is_valid or smooth.is_empty or smooth.geom_type != "Polygon":
            smooth = shapely.simplify(whole, 0.0)
        out.append(shapely.transform(smooth, frame.to_world))
    return tuple(sorted(out, key=lambda p: -p.area))


def _boxes(parts: IntArray) -> tuple[IntArray, IntArray]:
    """Rectangles (K, 4), first column, first row, ends, that tile the labelled cells, and their labels (K,).

    Runs of cells in a row, joined with those of the next rows that are the same.
    """
    ny, nx = parts.shape
    padded = np.zeros((ny, nx + 2), dtype=parts.dtype)
    padded[:, 1:-1] = parts
    edge = padded[:, 1:] != padded[:, :-1]
    rows, begins = np.nonzero(edge & (padded[:, 1:] > 0))
    _, ends = np.nonzero(edge & (padded[:, :-1] > 0))
    if len(rows) == 0:
        return np.empty((0, 4), dtype=np.int64), np.empty(0, dtype=np.int64)
    # Equal runs of successive rows stand one after the other when sorted by columns, then by row.
    order = np.lexsort((rows, ends, begins))
    rows, begins, ends = rows[order], begins[order], ends[order]
    new = np.ones(len(rows), dtype=np.bool_)
    new[1:] = (np.diff(begins) != 0) | (np.diff(ends) != 0) | (np.diff(rows) != 1)
    first = np.flatnonzero(new)
    last = np.concatenate([first[1:], [len(rows)]]) - 1
    boxes = np.stack([begins[first], rows[first], ends[first], rows[last] + 1], axis=1)
    return boxes, np.asarray(parts[rows[first], begins[first]], dtype=np.int64)
