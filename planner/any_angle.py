"""From the grid's eight directions to any: string pulling, then elastic relaxation, by exact costs."""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.cost_space import CostSpace
from planner.kernels.any_angle import pull_string, relax, subdivide

_WINDOW = 64
# No place costs less per metre.
_LOWEST_RATE = 1.0
_SPACINGS_CELLS = (64, 32, 16, 8, 4, 2)
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

    def pull() -> None:
        for _ in range(_MAX_PULLS):
            before = len(best)
            if late():
                return
            keep(pull_string(best, _WINDOW, _LOWEST_RATE, *cost_space.kernel_args))
            if len(best) == before:
                return

    cell = cost_space.frame.resolution
    pull()
    for spacing in _SPACINGS_CELLS:
        if late():
            break
        fine = subdivide(best, spacing * cell)
        relax(fine, 0.25 * spacing * cell, cell / 16.0, _MAX_SWEEPS, *cost_space.kernel_args)
        keep(fine)
        pull()
    return best, best_cost
