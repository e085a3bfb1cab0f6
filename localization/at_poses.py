"""The fix at poses of the robot: place and heading as they are, not those of a cell and a bin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from localization.errors import LocalizationError
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import FORWARD_CAMERA, Sensor
from localization.tiles import FieldTile, compute_tile
from localization.triplets import pack_masks
from localization.uncertainty_field import is_off, trusted_where
from maps.io.site import bundled_site
from maps.visibility import visible_landmarks
from maps.world import World

# Headings closer than this are one, rad.
_SAME_RAD = 1e-9


def fixes_at(
    world: World, sensor: Sensor, poses: npt.ArrayLike, *, method: FieldMethod = BEST_AREA
) -> FieldTile:
    """What a field would hold in a cell whose centre and heading are a pose.

    Parameters
    ----------
    world, sensor
        Landmarks and what measures them.
    poses
        Shape (K, 3): x, y (m), heading (rad) of the robot in W.
    method
        Estimator and criterion.

    Returns
    -------
    fixes
        Arrays (K, …), as planning may count on them: enlarged, or no fix, where first order fails (see
        :meth:`localization.uncertainty_field.UncertaintyField.trusted`).

    Raises
    ------
    LocalizationError
        If the shape is wrong or a number is not finite.
    """
    p = np.asarray(poses, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or not np.isfinite(p).all():
        raise LocalizationError(f"Poses have shape {p.shape}; give (K, 3), all finite (m, m, rad).")
    out = FieldTile.blank((len(p),))
    if len(p) == 0:
        return out
    c, s, mount = np.cos(p[:, 2]), np.sin(p[:, 2]), sensor.mount
    at = p[:, :2] + np.column_stack([c * mount.x - s * mount.y, s * mount.x + c * mount.y])
    masks = pack_masks(visible_landmarks(world, at, min_range=sensor.min_range, max_range=sensor.max_range))
    free = np.asarray(world.floor.free_at(p[:, :2]))
    _, group = np.unique(np.round(p[:, 2] / _SAME_RAD), return_inverse=True)
    order = np.argsort(group, kind="stable")
    for k in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        tile = compute_tile(
            world,
            sensor,
            p[None, k, :2],
            free[None, k],
            masks[None, k],
            heading=float(p[k[0], 2]),
            method=method,
        )
        for name in FieldTile.__dataclass_fields__:
            getattr(out, name)[k] = getattr(tile, name)[0]
    doubtful = np.isfinite(out.covariance[:, 0]) & is_off(out.validity)
    return trusted_where(doubtful, out) if doubtful.any() else out


def warm_up() -> None:
    """Compile or load the kernels, lines of sight among polygons included."""
    fixes_at(bundled_site("mas97_room"), FORWARD_CAMERA, [[3.0, 3.0, 0.5]])
