"""A part of a cost space: what lies outside cannot be on any path that is asked for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from maps.arrays import BoolArray
from planner.cost_space import CostSpace

Window = tuple[slice, slice]


def window_around(cells: BoolArray, margin: int) -> Window:
    """Rows and columns of all marked cells (ny, nx), with a margin in cells; the whole grid when none is."""
    out = []
    for axis in (1, 0):
        on = np.flatnonzero(cells.any(axis=axis))
        n = cells.shape[1 - axis]
        low, high = (on[0], on[-1] + 1) if len(on) else (0, n)
        out.append(slice(max(int(low) - margin, 0), min(int(high) + margin, n)))
    return (out[0], out[1])


def cropped(space: CostSpace, window: Window) -> CostSpace:
    """The cost space of a window of cells: outside of it the robot must not be."""
    rows, cols = window
    frame = space.frame
    x, y = (float(v) for v in frame.to_world([float(cols.start), float(rows.start)]))
    part = replace(
        frame, origin_x=x, origin_y=y, n_rows=rows.stop - rows.start, n_cols=cols.stop - cols.start
    )
    return replace(
        space,
        frame=part,
        rate=space.rate[window],
        passable=space.passable[window],
        centre_clearance=space.centre_clearance[window],
    )


def cells_of(metres: float, space: CostSpace) -> int:
    """Cells that a length, m, spans at most."""
    return math.ceil(metres / space.frame.resolution)
