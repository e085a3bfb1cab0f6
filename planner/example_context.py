"""A very small field, on which the whole planner compiles or loads what it needs."""

from __future__ import annotations

import numpy as np

from localization.sensors import LASER
from localization.uncertainty_field import UncertaintyField
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.context import PlanningContext


def example_context() -> PlanningContext:
    """A room of 6 m × 6 m with a block in the middle, cells of 0.25 m, less certain towards larger x."""
    frame = GridFrame(0.0, 0.0, 0.0, 0.25, 24, 24)
    free = np.ones(frame.shape, dtype=np.bool_)
    free[8:16, 8:16] = False
    landmarks = LandmarkSet(("a", "b", "c"), np.array([[0.5, 0.5], [5.5, 0.5], [3.0, 5.5]]))
    world = World("example", OccupancyGrid(frame, free, ~free), landmarks)
    sigma = np.where(free, np.linspace(0.01, 0.05, frame.n_cols), np.nan)
    field = UncertaintyField(
        world=world,
        sensor=LASER,
        frame=frame,
        heading=0.0,
        free=free,
        covariance=np.stack([sigma**2, 0.0 * sigma, sigma**2], axis=-1),
        sigma_theta=0.1 * sigma,
        triplet=np.where(free[..., None], np.arange(3), -1).astype(np.int16),
        pan=np.full(frame.shape, np.nan),
        n_visible=np.where(free, 3, 0).astype(np.int16),
        validity=np.where(free, 0.95, np.nan).astype(np.float32),
    )
    return PlanningContext(field)
