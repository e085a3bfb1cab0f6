"""A world as kernels need it to ask for one line of sight at a time."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray
from maps.grid import OccupancyGrid
from maps.grid_visibility import scene_arrays as grid_arrays
from maps.kernels.sight import GRID, PLAN, sees_pairs
from maps.vector_visibility import RANGE_TOLERANCE_M
from maps.vector_visibility import scene_arrays as plan_arrays
from maps.world import World

#: What ``maps.kernels.sight.sees`` takes after place and landmark.
SceneArgs = tuple[object, ...]

_NO_EDGES = (0, 4)


def scene_args(world: World, *, min_range: float = 0.0, max_range: float = math.inf) -> SceneArgs:
    """Floor, landmarks and ranges as arguments of :func:`maps.kernels.sight.sees`.

    Parameters
    ----------
    world
        Floor and N landmarks.
    min_range, max_range
        m, inclusive.
    """
    low = max(min_range - RANGE_TOLERANCE_M, 0.0)
    high = max_range + RANGE_TOLERANCE_M
    floor, n = world.floor, len(world.landmarks)
    if isinstance(floor, OccupancyGrid):
        g = floor.frame
        opaque, windows, states, shift, places, places_m, modes, cones, limit = grid_arrays(
            floor, world.landmarks
        )
        unit = float(1 << shift)
        numbers = [g.origin_x, g.origin_y, math.cos(g.yaw), math.sin(g.yaw), g.resolution, unit]
        numbers += [low * low, high * high, limit, limit]
        hidden, spans, edges = np.zeros(n, dtype=np.bool_), np.zeros(n), np.empty(_NO_EDGES, dtype=np.int64)
        kind = GRID
    else:
        edges, places, places_m, hidden, cones, spans, corner, per_metre, extent = plan_arrays(
            floor, world.landmarks
        )
        numbers = [*corner, 1.0, 0.0, 1.0, per_metre, low * low, high * high, *extent]
        opaque, windows = np.zeros((1, 1), dtype=np.bool_), np.zeros((n, 1, 1), dtype=np.bool_)
        states, modes, shift = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), 0
        kind = PLAN
    arrays = (edges, opaque, windows, states)
    more = (places, places_m, hidden, modes, cones, spans)
    # Fresh writable arrays: read-only ones would compile the kernels a second time.
    first, last = tuple(np.array(a, order="C") for a in arrays), tuple(np.array(a, order="C") for a in more)
    return (kind, np.array(numbers, dtype=np.float64), *first, shift, *last)


def visible_pairs(points: npt.ArrayLike, landmarks: npt.ArrayLike, scene: SceneArgs) -> BoolArray:
    """Whether each landmark of K is seen from its point of K.

    Parameters
    ----------
    points
        Shape (K, 2), W, m, finite.
    landmarks
        Shape (K,): indices.
    scene
        From :func:`scene_args`.

    Returns
    -------
    visible
        Shape (K,), the same as :func:`maps.visibility.visible_landmarks` says.
    """
    p = np.array(points, dtype=np.float64, order="C").reshape(-1, 2)
    index = np.array(landmarks, dtype=np.int64)
    out = np.empty(len(p), dtype=np.bool_)
    sees_pairs(p, index, out, scene)
    return out
