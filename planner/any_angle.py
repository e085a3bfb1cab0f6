"""From the grid's eight directions to any: string pulling, then elastic relaxation, by exact costs."""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.cost_space import CostSpace
from planner.kernels.any_angle import pull_string, relax, subdivide

_WINDOW = 64
# Points that were moved lie on a taut line: fewer are looked at.
_LAST_WINDOW = 16
# Every so many points of a path on the grid are enough to begin with, each seen from so many others.
_EVERY, _FIRST_WINDOW = 4, 32
# No place costs less per metre.
_LOWEST_RATE = 1.0
# Distances of the points that are moved, in cells, and those after which the string is pulled again.
_SPACINGS_CELLS = (64, 32, 16, 8, 4, 2)
# No finer than this, m, where cells are small.
_FINEST_M = 0.2
_PULL_AFTER = (32,)
_MAX_SWEEPS = 40
_MAX_PULLS = 6


def shorten(
    points: npt.ArrayLike, cost_space: CostSpace, *, deadline_at: float | None = None
) -> tuple[FloatArray, float]:
    """A polyline of lower cost along the same way.

    Points are left out where a straight line is cheaper (dynamic programming over the path's points), then
    points at spacings of 64, 32, … 2 cells are moved while the exact cost falls.

    Parameters
    ----------
    points
        Shape (K, 2), W, m: a valid path. Its ends stay.
    cost_space
        What is allowed, and at which cost.
    deadline_at
        ``time.monotonic()`` after which nothing new is begun, s.

    Returns
    -------
    points, cost
        Shape (M, 2), and the exact cost: never above that of the path given.
    """
    p = np.array(points, dtype=np.float64, order="C")
    given = cost_space.line_cost(p)
    best, best_cost = p, given
    if len(p) < 2:
        return best, best_cost

    def late() -> bool:
        return deadline_at is not None and time.monotonic() >= deadline_at

    def keep(candidate: FloatArray) -> None:
        nonlocal best, best_cost
        cost = cost_space.line_cost(candidate)
        # Equal up to rounding with fewer points is better.
        if cost < best_cost or (cost <= min(best_cost * (1 + 1e-12), given) and len(candidate) < len(best)):
            best, best_cost = candidate, cost

    def pull(window: int = _WINDOW) -> None:
        for _ in range(_MAX_PULLS):
            before = len(best)
            if late():
                return
            keep(pull_string(best, window, _LOWEST_RATE, *cost_space.kernel_args))
            if len(best) == before:
                return

    cell = cost_space.frame.resolution
    if len(p) > 2 * _EVERY:
        some = np.append(np.arange(0, len(p) - 1, _EVERY), len(p) - 1)
        keep(pull_string(p[some], _FIRST_WINDOW, _LOWEST_RATE, *cost_space.kernel_args))
    pull()
    for spacing in _SPACINGS_CELLS:
        if late() or (spacing * cell < 0.99 * _FINEST_M and spacing < _SPACINGS_CELLS[1]):
            break
        fine = subdivide(best, spacing * cell)
        relax(fine, 0.25 * spacing * cell, cell / 16.0, _MAX_SWEEPS, *cost_space.kernel_args)
        if spacing in _PULL_AFTER:
            keep(fine)
            pull()
        elif cost_space.line_cost(fine) < best_cost:
            best, best_cost = fine, cost_space.line_cost(fine)
    pull(_LAST_WINDOW)
    return best, best_cost


def with_fewer_corners(points: npt.ArrayLike, cost_space: CostSpace, limit: float) -> FloatArray:
    """A polyline without the corners that cost least to leave out, for a robot that stops at each.

    Parameters
    ----------
    points
        Shape (K, 2), W, m: a valid path. Its ends stay.
    cost_space
        What is allowed, and at which cost.
    limit
        The result costs at most this, or as much as the path given.

    Returns
    -------
    points
        Shape (M, 2): a part of the points given.
    """
    p = np.array(points, dtype=np.float64, order="C")
    spare = limit - cost_space.line_cost(p)
    while len(p) > 2:
        costs = cost_space.motion_costs(p[:-1], p[1:])
        loss = cost_space.motion_costs(p[:-2], p[2:]) - costs[:-1] - costs[1:]
        drop = np.zeros(len(p), dtype=np.bool_)
        for k in np.argsort(loss, kind="stable"):
            if loss[k] > spare:
                break
            # Losses of neighbours change with each other.
            if not (drop[k] or drop[k + 1] or drop[k + 2]):
                drop[k + 1] = True
                spare -= max(loss[k], 0.0)
        if not drop.any():
            break
        p = p[~drop]
    return p
