"""Headings at which the discs that cover an outline are free, cell by cell."""

from __future__ import annotations

import math

from numba import njit

from maps.kernels.clearance import point_distance

FREE = 1
#: Only the floor itself can tell: a disc's centre may lie beyond an edge of free space.
UNSURE = 2
# Exact distances are looked for a little beyond what is needed, so that rounding of the cap does not count.
_BEYOND = 1.001


@njit(cache=True, nogil=True)
def fit_rows(
    first,
    last,
    turns,
    discs,
    inscribed,
    circumscribed,
    touch,
    centre_clearance,
    transform,
    clearance,
    stop,
    out,
):
    """Rows ``first`` to ``last`` of ``out`` (H, ny, nx): 0, ``FREE`` or ``UNSURE``.

    ``turns`` (H, 2) are cosines and sines of the headings in W, ``discs`` (D, 3) x, y, radius in B, m;
    ``transform`` (5,) as in ``planner.kernels.line_cost``, ``clearance`` the arrays of a ClearanceIndex.
    Returns whether it was not stopped.
    """
    n_rows, n_cols = centre_clearance.shape
    ox, oy, cos_yaw, sin_yaw, side = transform[0], transform[1], transform[2], transform[3], transform[4]
    for row in range(first, last):
        if stop[0] != 0:
            return False
        for col in range(n_cols):
            here = centre_clearance[row, col]
            if here >= circumscribed - touch:
                out[:, row, col] = FREE
                continue
            if here < inscribed - touch:
                continue
            u = (col + 0.5) * side
            v = (row + 0.5) * side
            x = ox + cos_yaw * u - sin_yaw * v
            y = oy + sin_yaw * u + cos_yaw * v
            for h in range(turns.shape[0]):
                c = turns[h, 0]
                s = turns[h, 1]
                state = FREE
                for k in range(discs.shape[0]):
                    dx = c * discs[k, 0] - s * discs[k, 1]
                    dy = s * discs[k, 0] + c * discs[k, 1]
                    need = discs[k, 2] - touch
                    pu = u + cos_yaw * dx + sin_yaw * dy
                    pv = v + cos_yaw * dy - sin_yaw * dx
                    i = math.floor(pv / side)
                    j = math.floor(pu / side)
                    if i < 0 or j < 0 or i >= n_rows or j >= n_cols:
                        state = 0
                        break
                    near = centre_clearance[i, j]
                    away = math.hypot(pu - (j + 0.5) * side, pv - (i + 0.5) * side)
                    if near - away >= need:
                        continue
                    if near + away < need:
                        state = 0
                        break
                    if away >= near:
                        state = UNSURE
                        continue
                    if point_distance(x + dx, y + dy, need * _BEYOND, *clearance) < need:
                        state = 0
                        break
                out[h, row, col] = state
    return True
