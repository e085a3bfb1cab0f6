"""Figures of a polyline over the cells that it crosses."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planner.kernels.line_cost import polyline_pieces


@njit(cache=True, nogil=True)
def way_figures(cells, r95):
    """Length, ``∫ r95``, length without a fix, all in cells, and worst r95 of a polyline (K, 2) in cells.

    ``r95`` (ny, nx), m, NaN without a fix; on a border of two cells the worse one counts, no fix being the
    worst. The worst r95 is NaN where no cell has a fix. Pieces outside the grid count as without a fix.
    """
    pieces = polyline_pieces(cells, r95)
    length = 0.0
    integral = 0.0
    blind = 0.0
    worst = math.nan
    for k in range(pieces.shape[0]):
        value = 0.0
        for side in range(2):
            row = int(pieces[k, 2 * side])
            col = int(pieces[k, 2 * side + 1])
            here = math.nan
            if 0 <= row < r95.shape[0] and 0 <= col < r95.shape[1]:
                here = r95[row, col]
            value = math.nan if np.isnan(here) or np.isnan(value) else max(value, here)
        step = pieces[k, 4]
        length += step
        if np.isnan(value):
            blind += step
            continue
        integral += step * value
        if not worst >= value:
            worst = value
    return length, integral, blind, worst
