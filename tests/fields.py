"""Small uncertainty fields made by hand, for tests of what stands on fields."""

from __future__ import annotations

import numpy as np

from localization.sensors import LASER, Sensor
from localization.uncertainty_field import UncertaintyField
from maps.world import World


def synthetic_field(
    world: World, resolution: float = 0.5, sigma=lambda x, y: 0.05 + 0.0 * x, sensor: Sensor = LASER
) -> UncertaintyField:
    """Isotropic field with standard deviation ``sigma(x, y)`` (m) at each centre; NaN means no fix."""
    frame = world.grid_frame(resolution)
    centres = frame.centres()
    free = world.floor.free_at(centres)
    s = np.where(free, sigma(centres[..., 0], centres[..., 1]), np.nan)
    covariance = np.stack([s**2, 0.0 * s, s**2], axis=-1)
    fix = np.isfinite(s)
    triplet = np.where(fix[..., None], np.array([0, 1, 2]), -1).astype(np.int16)
    n_visible = np.where(fix, 3, 0).astype(np.int16)
    pan = np.full(frame.shape, np.nan)
    validity = np.where(fix, 0.95, np.nan).astype(np.float32)
    return UncertaintyField(
        world, sensor, frame, 0.0, free, covariance, 0.1 * s, triplet, pan, n_visible, validity
    )
