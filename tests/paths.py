"""Cost spaces and paths for tests of what improves paths: plain, slow, exact."""

from __future__ import annotations

import numpy as np
from skimage.graph import MCP_Geometric

from maps.clearance import ClearanceIndex
from planner.cost_space import cost_space_for


def space_of(world, r95, *, resolution=0.1, radius=0.3, weight=4.0, **bounds):
    """Cost space over a world with ``r95(x, y)`` in m, NaN for no fix."""
    frame = world.floor.grid_frame(resolution)
    centres = frame.centres()
    free = world.floor.free_at(centres)
    values = np.where(free, r95(centres[..., 0], centres[..., 1]), np.nan)
    index = ClearanceIndex.from_world(world)
    clearance = index.at_centres(frame, threads=1)
    return cost_space_for(frame, free, values, index, clearance, radius=radius, weight=weight, **bounds)


def cost_from(space, place):
    """Cost of the best 8-connected path from the cell of a place to every cell, and the search itself."""
    search = MCP_Geometric(np.where(space.passable, space.rate, -1.0))
    cost, _ = search.find_costs([tuple(int(v) for v in space.frame.cell_at([place])[0])])
    return cost * space.frame.resolution, search


def grid_path(space, start, goal):
    """Cell centres (K, 2) of the best 8-connected path between the cells of two places; None without one."""
    cost, search = cost_from(space, start)
    row, col = (int(v) for v in space.frame.cell_at([goal])[0])
    if not np.isfinite(cost[row, col]):
        return None
    cells = np.array(search.traceback((row, col)))
    return space.centre(cells[:, 0], cells[:, 1])


def pulled(space, path, window=60):
    """The cheapest polyline over the points of a path, straight pieces spanning at most ``window`` of them."""
    best = np.full(len(path), np.inf)
    best[0] = 0.0
    before = np.zeros(len(path), dtype=int)
    for j in range(1, len(path)):
        first = max(0, j - window)
        costs = best[first:j] + space.motion_costs(path[first:j], path[j])
        before[j] = first + int(np.argmin(costs))
        best[j] = costs.min()
    kept = [len(path) - 1]
    while kept[-1]:
        kept.append(before[kept[-1]])
    return path[kept[::-1]]


def random_pairs(space, rng, n, *, tries=400):
    """Up to n pulled paths between random passable cells, from several tries."""
    rows, cols = np.nonzero(space.passable)
    out = []
    for _ in range(tries):
        if len(out) == n:
            break
        a, b = rng.integers(len(rows), size=2)
        path = grid_path(space, space.centre(rows[a], cols[a]), space.centre(rows[b], cols[b]))
        if path is not None and len(path) > 1:
            out.append(pulled(space, path))
    return out
