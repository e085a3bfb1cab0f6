"""A very small cost space, on which the stages of the planner compile or load their kernels."""

from __future__ import annotations

import numpy as np

from maps.clearance import ClearanceIndex
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.cost_space import CostSpace, cost_space_for


def example_space() -> CostSpace:
    """An empty room of 3 m × 3 m, cells of 0.25 m, r95 from 0.05 m to 0.1 m, a robot of radius 0.2 m."""
    frame = GridFrame(0.0, 0.0, 0.0, 0.25, 12, 12)
    everywhere = np.ones(frame.shape, dtype=np.bool_)
    floor = OccupancyGrid(frame, everywhere, ~everywhere)
    clearance = ClearanceIndex.from_world(World("example", floor, LandmarkSet((), np.empty((0, 2)))))
    r95 = np.broadcast_to(np.linspace(0.05, 0.1, frame.n_cols), frame.shape)
    centre_clearance = clearance.at_centres(frame, threads=1)
    return cost_space_for(frame, everywhere, r95, clearance, centre_clearance, radius=0.2, weight=1.0)
