"""Cutting a polyline around a place, and joining motions that end and begin at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maps.arrays import FloatArray
from planner.result import Trajectory


def cut_around(
    path: FloatArray, place: FloatArray, half: float
) -> tuple[FloatArray | None, FloatArray, FloatArray | None]:
    """Cut a polyline before and after the point of it that is nearest to a place.

    Parameters
    ----------
    path
        Shape (K, 2), W, m, K ≥ 2.
    place
        Shape (2,): x, y in W, m.
    half
        Way to each cut from the nearest point, m.

    Returns
    -------
    before, middle, after
        Shapes (·, 2); neighbours share an end. None where the cut would lie beyond that end of the path.
    """
    a, d = path[:-1], np.diff(path, axis=0)
    length = np.hypot(d[:, 0], d[:, 1])
    share = np.clip(((place - a) * d).sum(axis=1) / np.maximum(length**2, 1e-300), 0.0, 1.0)
    k = int(np.argmin(np.hypot(*(a + share[:, None] * d - place).T)))
    s = np.concatenate([[0.0], np.cumsum(length)])
    at = s[k] + share[k] * length[k]
    first, last = at - half, at + half
    before = None if first <= 0.0 else _between(path, s, 0.0, first)
    after = None if last >= s[-1] else _between(path, s, last, float(s[-1]))
    return before, _between(path, s, max(first, 0.0), min(last, float(s[-1]))), after


def joined(motions: Sequence[Trajectory]) -> Trajectory:
    """One motion after the other; each begins where and how the one before ends, at rest."""
    t, points, velocity, acceleration = [], [], [], []
    clock = 0.0
    for i, motion in enumerate(motions):
        # Of two samples for one moment, the later motion's stays.
        keep = slice(None) if i == len(motions) - 1 else slice(None, -1)
        t.append(clock + motion.t[keep])
        points.append(motion.points[keep])
        velocity.append(motion.velocity[keep])
        acceleration.append(motion.acceleration[keep])
        clock += motion.duration
    return Trajectory(
        np.concatenate(t), np.concatenate(points), np.concatenate(velocity), np.concatenate(acceleration)
    )


def _between(path: FloatArray, s: FloatArray, first: float, last: float) -> FloatArray:
    inside = path[(s > first) & (s < last)]
    ends = np.column_stack([np.interp([first, last], s, path[:, 0]), np.interp([first, last], s, path[:, 1])])
    return np.concatenate([ends[:1], inside, ends[1:]])
