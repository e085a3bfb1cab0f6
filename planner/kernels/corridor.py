"""How far a path may be moved sideways, station by station, and whether chords keep what must be kept.

``args`` below are those of ``planner.kernels.line_cost``: rate (ny, nx), transform (5,), need, and the
five arrays of the clearance search.
"""

from __future__ import annotations

import math

from numba import njit

from maps.kernels.clearance import point_distance, segment_distance
from planner.kernels.line_cost import motion_rate_cost

# Search sideways in steps of this many metres.
_STEP = 0.02
# Searching for a free start, the walk must not come nearer to a wall than this share of the need, or 1 cm.
_CROSSING = 0.5
# Where nowhere along the normal has the wanted clearance, the corridor ends this far below the best, m.
_BELOW_BEST = 1e-3


@njit(cache=True, nogil=True)
def cell_rate(x, y, rate, transform):
    """Rate of the cell that holds (x, y); inf outside the grid (ny, nx)."""
    dx = x - transform[0]
    dy = y - transform[1]
    col = math.floor((transform[2] * dx + transform[3] * dy) / transform[4])
    row = math.floor((transform[2] * dy - transform[3] * dx) / transform[4])
    if row < 0 or col < 0 or row >= rate.shape[0] or col >= rate.shape[1]:
        return math.inf
    return rate[row, col]


@njit(cache=True, nogil=True)
def _room(x, y, cap, rate, transform, segments, start, items, gap, grid):
    """Clearance of (x, y), at most ``cap``; 0 in a forbidden cell."""
    if cell_rate(x, y, rate, transform) == math.inf:
        return 0.0
    return point_distance(x, y, cap, segments, start, items, gap, grid)


@njit(cache=True, nogil=True)
def _anchor(x, y, nx, ny, first, want, search, rate, transform, need, segments, start, items, gap, grid):
    """Offset near ``first`` with room ``want``, else with the most room within ``search``; and that room."""
    best = -1.0
    best_n = first
    stop_at = max(_CROSSING * need, 0.01)
    for side in (1.0, -1.0):
        k = 0 if side > 0.0 else 1
        while k * _STEP <= search:
            n = first + side * k * _STEP
            px = x + n * nx
            py = y + n * ny
            if point_distance(px, py, stop_at, segments, start, items, gap, grid) < stop_at:
                break
            room = _room(px, py, want, rate, transform, segments, start, items, gap, grid)
            closer = room >= want and best >= want and abs(n - first) < abs(best_n - first)
            if room > best or closer:
                best = room
                best_n = n
            if room >= want:
                break
            k += 1
    return best_n, best


@njit(cache=True, nogil=True)
def _reach(x, y, nx, ny, n, side, limit, want, margin, rate, transform, segments, start, items, gap, grid):
    """How far from offset n towards ``side`` the room stays at least ``want`` and the cells allowed."""
    known = n
    last = n
    while side * (limit - last) > 1e-9:
        ahead = last + side * min(_STEP, side * (limit - last))
        px = x + ahead * nx
        py = y + ahead * ny
        if cell_rate(px, py, rate, transform) == math.inf:
            back = last - side * margin
            return back if side * (back - n) > 0.0 else n
        if side * (known - ahead) < 0.0:
            # Clearance changes by at most a metre per metre: what is left over need not be searched.
            room = point_distance(px, py, want + 0.5, segments, start, items, gap, grid)
            if room < want:
                return last
            known = ahead + side * (room - want)
        last = ahead
    return limit


@njit(cache=True, nogil=True)
def corridor(
    centre,
    normal,
    first,
    margin,
    search,
    reach,
    low,
    anchor,
    high,
    rate,
    transform,
    need,
    segments,
    start,
    items,
    gap,
    grid,
):
    """Allowed offsets along the normals (N, 2) of points (N, 2), from first guesses (N,) with margins (N,).

    ``low``, ``anchor``, ``high`` (N,): an allowed offset and the interval around it; both ends equal the
    anchor where no place has the needed clearance. Nothing reaches further than ``reach``.
    """
    for i in range(centre.shape[0]):
        x = centre[i, 0]
        y = centre[i, 1]
        nx = normal[i, 0]
        ny = normal[i, 1]
        want = need + margin[i]
        n, best = _anchor(
            x, y, nx, ny, first[i], want, search, rate, transform, need, segments, start, items, gap, grid
        )
        anchor[i] = n
        low[i] = n
        high[i] = n
        if best < need:
            continue
        want = max(min(want, best - _BELOW_BEST), need)
        back = min(margin[i], 0.5 * transform[4])
        low[i] = _reach(
            x,
            y,
            nx,
            ny,
            n,
            -1.0,
            min(-reach, n),
            want,
            back,
            rate,
            transform,
            segments,
            start,
            items,
            gap,
            grid,
        )
        high[i] = _reach(
            x,
            y,
            nx,
            ny,
            n,
            1.0,
            max(reach, n),
            want,
            back,
            rate,
            transform,
            segments,
            start,
            items,
            gap,
            grid,
        )


@njit(cache=True, nogil=True)
def chord_costs(points, sag, cost, deficit, rate, transform, need, segments, start, items, gap, grid):
    """Cost (K - 1,) of the chords of points (K, 2), and by how much each misses need + sag (K - 1,), m.

    ``sag`` bounds the distance of the curve from its chord. A cost is inf where a forbidden cell is entered.
    """
    for k in range(points.shape[0] - 1):
        x0 = points[k, 0]
        y0 = points[k, 1]
        x1 = points[k + 1, 0]
        y1 = points[k + 1, 1]
        cost[k] = motion_rate_cost(x0, y0, x1, y1, rate, transform)
        want = need + sag[k]
        deficit[k] = want - segment_distance(x0, y0, x1, y1, want, segments, start, items, gap, grid)
