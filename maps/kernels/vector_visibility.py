"""Lines of sight between lattice points past edges, in whole numbers.

Edges are (M, 4) int64: x0, y0, x1, y1, the boundary of what can be seen through, meeting at their ends only.
Coordinates stay below 2³⁰, so that every product of differences fits into int64.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_TWO_PI = 2.0 * math.pi
# Nearer than this to the landmark a place has no bearing of it, m.
_OWN_PLACE_M = 1e-6


@njit(cache=True, nogil=True)
def in_range(dx, dy, high2):
    """Whether a place dx, dy m from a landmark is within the squared range and not its own place."""
    d2 = dx * dx + dy * dy
    return d2 <= high2 and d2 > _OWN_PLACE_M * _OWN_PLACE_M


@njit(cache=True, nogil=True)
def in_cone(dx, dy, sx, sy, ex, ey, span):
    """Whether direction (dx, dy) lies in the closed cone from (sx, sy) counter-clockwise to (ex, ey)."""
    if span >= _TWO_PI:
        return True
    from_start = sx * dy - sy * dx >= 0
    to_end = dx * ey - dy * ex >= 0
    if sx * ey - sy * ex >= 0 and span < 1.5 * math.pi:
        return from_start and to_end
    return from_start or to_end


@njit(cache=True, nogil=True)
def in_sight(edges, lx, ly, px, py, may_left, may_right):
    """Whether P is in sight of L: turned about L a hair to the left or to the right, no edge is between them.

    ``may_left`` and ``may_right`` say which of the two turns count.
    """
    dx = px - lx
    dy = py - ly
    left = may_left
    right = may_right
    x_low = min(lx, px)
    x_high = max(lx, px)
    y_low = min(ly, py)
    y_high = max(ly, py)
    for i in range(edges.shape[0]):
        if min(edges[i, 0], edges[i, 2]) > x_high or max(edges[i, 0], edges[i, 2]) < x_low:
            continue
        if min(edges[i, 1], edges[i, 3]) > y_high or max(edges[i, 1], edges[i, 3]) < y_low:
            continue
        ax = edges[i, 0] - lx
        ay = edges[i, 1] - ly
        bx = edges[i, 2] - lx
        by = edges[i, 3] - ly
        side_l = ax * by - ay * bx
        side_p = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
        if not ((side_l > 0 and side_p < 0) or (side_l < 0 and side_p > 0)):
            continue
        side_a = dx * ay - dy * ax
        side_b = dx * by - dy * bx
        if (side_a > 0 and side_b > 0) or (side_a < 0 and side_b < 0):
            continue
        # An end on the line of sight: the edge stops the turns to its own side only.
        left = left and not (side_a > 0 or side_b > 0)
        right = right and not (side_a < 0 or side_b < 0)
        if not (left or right):
            return False
    return left or right


@njit(cache=True, nogil=True)
def see_points(edges, places, places_m, hidden, cones, spans, points, points_m, high2, out):
    """Sight of N landmarks from P points; (M, 4), 2 × (N, 2), (N,), (N, 4), (N,), 2 × (P, 2), (P, N)."""
    for p in range(points.shape[0]):
        for i in range(places.shape[0]):
            out[p, i] = False
            if hidden[i] or not in_range(
                points_m[p, 0] - places_m[i, 0], points_m[p, 1] - places_m[i, 1], high2
            ):
                continue
            dx = points[p, 0] - places[i, 0]
            dy = points[p, 1] - places[i, 1]
            sx, sy, ex, ey = cones[i, 0], cones[i, 1], cones[i, 2], cones[i, 3]
            if not in_cone(dx, dy, sx, sy, ex, ey, spans[i]):
                continue
            may_left = True
            may_right = True
            if spans[i] < _TWO_PI:
                # On the rim of the cone only the turn into it counts.
                may_left = not (ex * dy - ey * dx == 0 and ex * dx + ey * dy > 0)
                may_right = not (sx * dy - sy * dx == 0 and sx * dx + sy * dy > 0)
            out[p, i] = in_sight(
                edges, places[i, 0], places[i, 1], points[p, 0], points[p, 1], may_left, may_right
            )


@njit(cache=True, nogil=True)
def strictly_inside(edges, x, y):
    """Whether a lattice point lies inside the area that the edges bound, not on its rim; (M, 4)."""
    inside = False
    for i in range(edges.shape[0]):
        ax = edges[i, 0] - x
        ay = edges[i, 1] - y
        bx = edges[i, 2] - x
        by = edges[i, 3] - y
        side = ax * by - ay * bx
        if side == 0 and min(ax, bx) <= 0 <= max(ax, bx) and min(ay, by) <= 0 <= max(ay, by):
            return False
        if (ay > 0) != (by > 0) and (side > 0) == (by > ay):
            inside = not inside
    return inside


@njit(cache=True, nogil=True)
def _along_normal(edges, x, y, nx, ny, reach, step, out):
    """First place inside along a ray from (x, y), in ``reach``, ``step`` beyond an edge; into out (2,)."""
    n = edges.shape[0]
    at = np.empty(n + 1)
    at[0] = 0.0
    k = 1
    for i in range(n):
        ax = edges[i, 0] - x
        ay = edges[i, 1] - y
        bx = edges[i, 2] - x
        by = edges[i, 3] - y
        side_a = nx * ay - ny * ax
        side_b = nx * by - ny * bx
        if side_a * side_b > 0.0 or side_a == side_b:
            continue
        t = side_a / (side_a - side_b)
        along = nx * (ax + t * (bx - ax)) + ny * (ay + t * (by - ay))
        if 0.0 <= along <= reach:
            at[k] = along
            k += 1
    at[:k].sort()
    for j in range(k):
        # A wall hit at a flat angle needs longer steps to get clear of it, but not past the next one.
        room = at[j + 1] - at[j] if j + 1 < k else math.inf
        beyond = step
        while beyond <= 64.0 * step and beyond < room:
            qx = np.int64(np.rint(x + nx * (at[j] + beyond)))
            qy = np.int64(np.rint(y + ny * (at[j] + beyond)))
            if strictly_inside(edges, qx, qy):
                out[0] = qx
                out[1] = qy
                return True
            beyond *= 4.0
    return False


@njit(cache=True, nogil=True)
def _nearest_rim(edges, x, y, out):
    """Distance from (x, y) to the nearest edge; the nearest point and that edge's direction into out (4,)."""
    best = math.inf
    for i in range(edges.shape[0]):
        ax = edges[i, 0] - x
        ay = edges[i, 1] - y
        ux = float(edges[i, 2] - edges[i, 0])
        uy = float(edges[i, 3] - edges[i, 1])
        length2 = ux * ux + uy * uy
        if length2 == 0.0:
            continue
        t = min(max(-(ax * ux + ay * uy) / length2, 0.0), 1.0)
        qx = ax + t * ux
        qy = ay + t * uy
        d2 = qx * qx + qy * qy
        if d2 < best:
            best = d2
            length = math.sqrt(length2)
            out[0] = x + qx
            out[1] = y + qy
            out[2] = ux / length
            out[3] = uy / length
    return math.sqrt(best)


@njit(cache=True, nogil=True)
def _beyond_rim(edges, x, y, reach, step, out):
    """Place inside nearest to (x, y), ``step`` beyond the rim; into out (2,); False if out of reach."""
    near = np.empty(4)
    gap = _nearest_rim(edges, x, y, near)
    if not gap <= reach:
        return False
    # Straight on, square to the edge, then all around: corners have no normal.
    for k in range(-3, 128):
        length = step if k < 64 else 4.0 * step
        if k == -3:
            if gap < 1.0:
                continue
            nx = (near[0] - x) / gap
            ny = (near[1] - y) / gap
        elif k < 0:
            turn = 1.0 if k == -2 else -1.0
            nx = -near[3] * turn
            ny = near[2] * turn
        else:
            nx = math.cos(_TWO_PI * k / 64.0)
            ny = math.sin(_TWO_PI * k / 64.0)
        qx = np.int64(np.rint(near[0] + nx * length))
        qy = np.int64(np.rint(near[1] + ny * length))
        if strictly_inside(edges, qx, qy):
            out[0] = qx
            out[1] = qy
            return True
    return False


@njit(cache=True, nogil=True)
def stand_clear(edges, places, normals, reach, step, out, buried):
    """Move landmarks in or on walls to their see-through side; (M, 4), (N, 2), (N, 2), …, (N, 2), (N,).

    ``places`` in lattice units, not rounded; ``normals`` of length 1, or 0 where there is none; ``out`` on
    the lattice. Deeper than ``reach`` in a wall: ``buried``.
    """
    for i in range(places.shape[0]):
        x = places[i, 0]
        y = places[i, 1]
        out[i, 0] = np.int64(np.rint(x))
        out[i, 1] = np.int64(np.rint(y))
        buried[i] = False
        if strictly_inside(edges, out[i, 0], out[i, 1]):
            continue
        nx = normals[i, 0]
        ny = normals[i, 1]
        if (nx != 0.0 or ny != 0.0) and _along_normal(edges, x, y, nx, ny, reach, step, out[i]):
            continue
        buried[i] = not _beyond_rim(edges, x, y, reach, step, out[i])
