"""What a landmark sees all around: the nearest edge in each direction, by merging envelopes.

Coordinates are lattice units relative to the landmark, int64 below 2³⁰. A direction is an angle from the
start of the viewing cone (double, for speed) with an integer vector that decides where angles are too close
to tell. An envelope is a list of directions, each with the edge that is nearest from there on (-1: none).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_TWO_PI = 2.0 * math.pi
# Angles closer than this are compared by their vectors.
_CLOSE_RAD = 1e-9


@njit(cache=True, nogil=True)
def direction_order(t1, x1, y1, t2, x2, y2):
    """-1, 0 or 1: whether the first direction comes before, with or after the second."""
    if t1 < t2 - _CLOSE_RAD:
        return -1
    if t1 > t2 + _CLOSE_RAD:
        return 1
    side = x1 * y2 - y1 * x2
    if side > 0:
        return -1
    return 1 if side < 0 else 0


@njit(cache=True, nogil=True)
def is_nearer(near, e, f):
    """Whether edge e hides edge f where both are met; rows of near (K, 4), turned alike, not crossing."""
    ax, ay, bx, by = near[e, 0], near[e, 1], near[e, 2], near[e, 3]
    cx, cy, dx, dy = near[f, 0], near[f, 1], near[f, 2], near[f, 3]
    side_c = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    side_d = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    if side_c <= 0 and side_d <= 0:
        return side_c != 0 or side_d != 0 or e < f
    if side_c >= 0 and side_d >= 0:
        return False
    side_a = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    side_b = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    return side_a >= 0 and side_b >= 0


@njit(cache=True, nogil=True)
def gather_edges(edges, lx, ly, reach, half_box, near):
    """Edges within reach, counter-clockwise as seen from L, and a box around all; (M, 4) → near (M + 4, 4).

    Edges whose line passes through L hide nothing. Returns how many there are.
    """
    k = 0
    for i in range(edges.shape[0]):
        ax = edges[i, 0] - lx
        ay = edges[i, 1] - ly
        bx = edges[i, 2] - lx
        by = edges[i, 3] - ly
        side = ax * by - ay * bx
        if side == 0:
            continue
        ux = float(bx - ax)
        uy = float(by - ay)
        t = min(max(-(ax * ux + ay * uy) / (ux * ux + uy * uy), 0.0), 1.0)
        if math.hypot(ax + t * ux, ay + t * uy) > reach:
            continue
        flip = side < 0
        near[k, 0] = bx if flip else ax
        near[k, 1] = by if flip else ay
        near[k, 2] = ax if flip else bx
        near[k, 3] = ay if flip else by
        k += 1
    x = half_box
    y = -half_box
    for _ in range(4):
        near[k, 0] = x
        near[k, 1] = y
        near[k, 2] = -y
        near[k, 3] = x
        x, y = -y, x
        k += 1
    return k


@njit(cache=True, nogil=True)
def _angle(sx, sy, dx, dy, is_end):
    """Angle of (dx, dy) from (sx, sy), counter-clockwise: [0, 2π), or (0, 2π] for the end of an edge."""
    side = sx * dy - sy * dx
    along = sx * dx + sy * dy
    if side == 0 and along > 0:
        return _TWO_PI if is_end else 0.0
    t = math.atan2(float(side), float(along))
    return t if side >= 0 else t + _TWO_PI


@njit(cache=True, nogil=True)
def _leaf(t0, x0, y0, t1, x1, y1, edge, ex, ey, span, k, angles, vectors, ids):
    """Write one edge as an envelope of two directions at 2k, cut by the end of the cone; False if outside."""
    if direction_order(t0, x0, y0, span, ex, ey) >= 0:
        return False
    if direction_order(t1, x1, y1, span, ex, ey) > 0:
        t1, x1, y1 = span, ex, ey
    angles[2 * k] = t0
    vectors[2 * k, 0] = x0
    vectors[2 * k, 1] = y0
    ids[2 * k] = edge
    angles[2 * k + 1] = t1
    vectors[2 * k + 1, 0] = x1
    vectors[2 * k + 1, 1] = y1
    ids[2 * k + 1] = -1
    return True


@njit(cache=True, nogil=True)
def _leaves(near, n, sx, sy, ex, ey, span, angles, vectors, ids):
    """One envelope per edge, two where it passes the start direction; returns how many."""
    k = 0
    for i in range(n):
        ax, ay, bx, by = near[i, 0], near[i, 1], near[i, 2], near[i, 3]
        ta = _angle(sx, sy, ax, ay, False)
        tb = _angle(sx, sy, bx, by, True)
        if direction_order(ta, ax, ay, tb, bx, by) < 0:
            k += _leaf(ta, ax, ay, tb, bx, by, i, ex, ey, span, k, angles, vectors, ids)
        else:
            k += _leaf(0.0, sx, sy, tb, bx, by, i, ex, ey, span, k, angles, vectors, ids)
            k += _leaf(ta, ax, ay, _TWO_PI, sx, sy, i, ex, ey, span, k, angles, vectors, ids)
    return k


@njit(cache=True, nogil=True)
def _merge(near, a, a_stop, b, b_stop, angles, vectors, ids, out_angles, out_vectors, out_ids):
    """Nearer of two envelopes, written from a on; returns where it stops."""
    edge_a = -1
    edge_b = -1
    last = -1
    k = a
    while a < a_stop or b < b_stop:
        if b >= b_stop:
            order = -1
        elif a >= a_stop:
            order = 1
        else:
            order = direction_order(
                angles[a], vectors[a, 0], vectors[a, 1], angles[b], vectors[b, 0], vectors[b, 1]
            )
        at = a if order <= 0 else b
        if order <= 0:
            edge_a = ids[a]
            a += 1
        if order >= 0:
            edge_b = ids[b]
            b += 1
        best = edge_a
        if edge_a < 0 or (edge_b >= 0 and is_nearer(near, edge_b, edge_a)):
            best = edge_b
        if best != last:
            out_angles[k] = angles[at]
            out_vectors[k, 0] = vectors[at, 0]
            out_vectors[k, 1] = vectors[at, 1]
            out_ids[k] = best
            last = best
            k += 1
    return k


@njit(cache=True, nogil=True)
def find_sectors(near, n, sx, sy, ex, ey, span):
    """Directions (K, 2) and nearest edges (K,) of near[:n] from the start to the end of the cone.

    Edge k is the nearest from direction k to direction k + 1; -1 at the end.
    """
    angles = np.empty(4 * n)
    vectors = np.empty((4 * n, 2), dtype=np.int64)
    ids = np.empty(4 * n, dtype=np.int64)
    count = _leaves(near, n, sx, sy, ex, ey, span, angles, vectors, ids)
    other_angles = np.empty(2 * count)
    other_vectors = np.empty((2 * count, 2), dtype=np.int64)
    other_ids = np.empty(2 * count, dtype=np.int64)
    # Block j of the current level lies from start[j] to stop[j].
    start = np.empty(count, dtype=np.int64)
    stop = np.empty(count, dtype=np.int64)
    for k in range(count):
        start[k] = 2 * k
        stop[k] = 2 * k + 2
    while count > 1:
        half = 0
        for k in range(0, count, 2):
            b = start[k + 1] if k + 1 < count else stop[k]
            b_stop = stop[k + 1] if k + 1 < count else stop[k]
            end = _merge(
                near,
                start[k],
                stop[k],
                b,
                b_stop,
                angles,
                vectors,
                ids,
                other_angles,
                other_vectors,
                other_ids,
            )
            start[half] = start[k]
            stop[half] = end
            half += 1
        count = half
        angles, other_angles = other_angles, angles
        vectors, other_vectors = other_vectors, vectors
        ids, other_ids = other_ids, ids
    if count == 0:
        return vectors[:0], ids[:0]
    return vectors[: stop[0]], ids[: stop[0]]
