"""Largest triangle among points: the best triplet of bearings that are all equally good (MATH §3)."""

from __future__ import annotations

from numba import njit

from localization.kernels.triplets import comes_before, sorted_three


@njit(cache=True, nogil=True)
def _turn(xs, ys, a, b, c):
    """Twice the signed area of the triangle of points a, b, c."""
    return (xs[b] - xs[a]) * (ys[c] - ys[a]) - (ys[b] - ys[a]) * (xs[c] - xs[a])


@njit(cache=True, nogil=True)
def _hull(n, xs, ys, order, hull):
    """Convex hull of points (n,), counter-clockwise, into ``hull``; its size, and of how many in ``order``.

    ``order`` (n,) lists the points, best as they were ordered nearby; afterwards those outside the octagon,
    sorted.
    """
    # The extreme points of eight directions span an octagon; what lies inside it cannot matter.
    e0 = 0
    e1 = 0
    e2 = 0
    e3 = 0
    e4 = 0
    e5 = 0
    e6 = 0
    e7 = 0
    for i in range(1, n):
        x = xs[i]
        y = ys[i]
        if x > xs[e0]:
            e0 = i
        if x < xs[e4]:
            e4 = i
        if y > ys[e2]:
            e2 = i
        if y < ys[e6]:
            e6 = i
        s = x + y
        if s > xs[e1] + ys[e1]:
            e1 = i
        if s < xs[e5] + ys[e5]:
            e5 = i
        s = y - x
        if s > ys[e3] - xs[e3]:
            e3 = i
        if s < ys[e7] - xs[e7]:
            e7 = i
    corners = (e0, e1, e2, e3, e4, e5, e6, e7)
    m = 0
    for a in range(n):
        i = order[a]
        x = xs[i]
        y = ys[i]
        inside = True
        c = e7
        for b in corners:
            if c != b:
                if (xs[b] - xs[c]) * (y - ys[c]) - (ys[b] - ys[c]) * (x - xs[c]) <= 0.0:
                    inside = False
                    break
                c = b
        if inside:
            continue
        # Insertion by (x, y, index): few are left, or nearly in order.
        k = m
        while k > 0:
            b = order[k - 1]
            if not (xs[b] > x or (xs[b] == x and (ys[b] > y or (ys[b] == y and b > i)))):
                break
            order[k] = b
            k -= 1
        order[k] = i
        m += 1
    size = 0
    for step in range(m):
        i = order[step]
        while size >= 2 and _turn(xs, ys, hull[size - 2], hull[size - 1], i) <= 0.0:
            size -= 1
        hull[size] = i
        size += 1
    lower = size + 1
    for step in range(m - 2, -1, -1):
        i = order[step]
        while size >= lower and _turn(xs, ys, hull[size - 2], hull[size - 1], i) <= 0.0:
            size -= 1
        hull[size] = i
        size += 1
    return size - 1, m


@njit(cache=True, nogil=True)
def _farthest(size, xs, ys, hull, a, b):
    """Vertex of a hull farthest from the line through its vertices a and b; twice the triangle's area."""
    best = -1.0
    at = a
    for c in range(size):
        area = abs(_turn(xs, ys, hull[a], hull[b], hull[c]))
        if area > best:
            best = area
            at = c
    return at, best


@njit(cache=True, nogil=True)
def _stable_triangle(size, xs, ys, hull):
    """Vertices of a hull, ascending, of a triangle that moving one corner cannot make larger."""
    a = 0
    b = size // 3
    c, best = _farthest(size, xs, ys, hull, a, b)
    unchanged = 1
    while unchanged < 3:
        a, b, c = b, c, a
        to, area = _farthest(size, xs, ys, hull, a, b)
        if area > best:
            best = area
            c = to
            unchanged = 1
        else:
            unchanged += 1
    return sorted_three(a, b, c)


@njit(cache=True, nogil=True)
def largest_triangle(n, xs, ys, order, hull, triplet):
    """Largest triangle among points (n,): twice its area, its corners ascending in ``triplet`` (3,).

    ``order`` (n,) lists the points in any order, nearly sorted by (x, y) being fastest; the number of those
    that it lists in order afterwards comes second. ``hull`` (n + 1,) is scratch. Corners -1 and area 0 where
    all points lie on a line.
    """
    triplet[:] = -1
    best = 0.0
    size, m = _hull(n, xs, ys, order, hull)
    if size < 3:
        return best, m
    # The largest has a corner on each of the three arcs of any triangle that moving one corner cannot better
    # (Jin, Maximal area triangles in a convex polygon, arXiv:1707.04071: such triangles interleave).
    p, q, r = _stable_triangle(size, xs, ys, hull)
    for a in range(p, q + 1):
        i = hull[a]
        c = r
        for b in range(max(q, a + 1), r + 1):
            j = hull[b]
            c = max(c, b + 1)
            if c > p + size or c - size >= a:
                break
            area = _turn(xs, ys, i, j, hull[c % size])
            # Along a convex polygon the height over (i, j) rises to one top and falls.
            while c < p + size and c + 1 - size < a:
                following = _turn(xs, ys, i, j, hull[(c + 1) % size])
                if following < area:
                    break
                area = following
                c += 1
            if area >= best and area > 0.0:
                k0, k1, k2 = sorted_three(i, j, hull[c % size])
                if area > best or comes_before(k0, k1, k2, triplet):
                    best = area
                    triplet[0] = k0
                    triplet[1] = k1
                    triplet[2] = k2
    return best, m
