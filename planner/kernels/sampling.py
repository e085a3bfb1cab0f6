"""Where a better path can lead."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
def through_cost(cost_to_go, cost_so_far, places, least_rate, transform, out):
    """Cost of the best grid path through each cell (ny, nx); inf where there is none.

    ``places`` (3,): x, y of the start, and whether ``cost_so_far`` is known; without it, distance times
    ``least_rate`` stands in. ``transform`` (5,) as in ``planner.kernels.line_cost``.
    """
    x = places[0] - transform[0]
    y = places[1] - transform[1]
    col0 = (transform[2] * x + transform[3] * y) / transform[4] - 0.5
    row0 = (transform[2] * y - transform[3] * x) / transform[4] - 0.5
    known = places[2] > 0.5
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            to_go = cost_to_go[row, col]
            if to_go == math.inf:
                out[row, col] = math.inf
            elif known:
                out[row, col] = to_go + cost_so_far[row, col]
            else:
                way = math.hypot(col - col0, row - row0) * transform[4]
                out[row, col] = to_go + least_rate * way
