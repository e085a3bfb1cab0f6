"""Cost of a path moved sideways, its slope and its curvature: the quadratic programme of one step.

The path has N + 1 stations ``p_i = r_i + n_i ν_i``. Its cost is
``Σ ρ_i |p_{i+1} - p_i| + bend Σ κ_i² l_i + twist Σ (κ_{i+1} - κ_i)² / l``, with ρ the rate between the
stations and κ the turn at a station over the mean length of its two chords, 0 at both ends.
"""

from __future__ import annotations

import math

from numba import njit

from planner.kernels.line_cost import motion_rate_cost

# Rate of a station with no allowed cell around it, 1/m: no path that can be offered has one.
_NO_RATE = 1e3


@njit(cache=True, nogil=True)
def smooth_rate(x, y, rate, transform):
    """Rate (ny, nx) at (x, y), bilinear between the centres of the allowed cells; inf without any."""
    dx = x - transform[0]
    dy = y - transform[1]
    gx = (transform[2] * dx + transform[3] * dy) / transform[4] - 0.5
    gy = (transform[2] * dy - transform[3] * dx) / transform[4] - 0.5
    col = math.floor(gx)
    row = math.floor(gy)
    total = 0.0
    weight = 0.0
    for r in (row, row + 1):
        for c in (col, col + 1):
            if r < 0 or c < 0 or r >= rate.shape[0] or c >= rate.shape[1] or rate[r, c] == math.inf:
                continue
            w = (1.0 - abs(gx - c)) * (1.0 - abs(gy - r)) + 1e-9
            total += w * rate[r, c]
            weight += w
    return total / weight if weight > 0.0 else math.inf


@njit(cache=True, nogil=True)
def rate_along_normals(centre, normal, offset, spread, out, rate, transform):
    """Value, slope and curvature (N, 3) of the rate along normals (N, 2) at offsets (N,) from centres (N, 2).

    Slope and curvature by least squares through five samples ``spread`` apart; the curvature is not
    negative. Samples without an allowed cell around count like the middle one.
    """
    for i in range(centre.shape[0]):
        middle = smooth_rate(
            centre[i, 0] + offset[i] * normal[i, 0], centre[i, 1] + offset[i] * normal[i, 1], rate, transform
        )
        if middle == math.inf:
            middle = _NO_RATE
        slope = 0.0
        second = -2.0 * middle
        for k in (-2, -1, 1, 2):
            n = offset[i] + k * spread
            q = smooth_rate(centre[i, 0] + n * normal[i, 0], centre[i, 1] + n * normal[i, 1], rate, transform)
            if q == math.inf:
                q = middle
            slope += k * q
            second += (k * k - 2.0) * q
        out[i, 0] = middle
        out[i, 1] = slope / (10.0 * spread)
        out[i, 2] = max(second / (7.0 * spread * spread), 0.0)


@njit(cache=True, nogil=True)
def place(centre, normal, offset, points):
    """Points (N, 2) at offsets (N,) along normals (N, 2) of centres (N, 2)."""
    for i in range(centre.shape[0]):
        points[i, 0] = centre[i, 0] + offset[i] * normal[i, 0]
        points[i, 1] = centre[i, 1] + offset[i] * normal[i, 1]


@njit(cache=True, nogil=True)
def turns(points, chord, kappa):
    """Lengths (N - 1,) of the chords of points (N, 2) and curvature (N,) at the points, 0 at the ends."""
    n = points.shape[0]
    for i in range(n - 1):
        dx = points[i + 1, 0] - points[i, 0]
        dy = points[i + 1, 1] - points[i, 1]
        chord[i] = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    kappa[0] = 0.0
    kappa[n - 1] = 0.0
    for i in range(1, n - 1):
        ax = points[i, 0] - points[i - 1, 0]
        ay = points[i, 1] - points[i - 1, 1]
        bx = points[i + 1, 0] - points[i, 0]
        by = points[i + 1, 1] - points[i, 1]
        turn = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        kappa[i] = 2.0 * turn / (chord[i - 1] + chord[i])


@njit(cache=True, nogil=True)
def path_cost(chord, kappa, rates, bend, twist, step):
    """The cost that is minimised, from chords (N - 1,), curvature (N,) and rates (N, 3) at the stations."""
    total = 0.0
    for i in range(chord.shape[0]):
        total += 0.5 * (rates[i, 0] + rates[i + 1, 0]) * chord[i]
        change = kappa[i + 1] - kappa[i]
        total += twist * change * change / step
        total += 0.5 * bend * (kappa[i] * kappa[i] + kappa[i + 1] * kappa[i + 1]) * chord[i]
    return total


@njit(cache=True, nogil=True)
def quadratic_model(points, normal, chord, kappa, rates, bend, twist, step, slope, band, rows):
    """Slope (N,) and Gauss–Newton matrix of the cost; ``band[i, k]`` = H[i, i + k], shape (N, 4).

    ``rates`` (N, 3): value, slope, curvature along the normals. ``rows`` (N, 4) is scratch: derivatives of κ
    by the offsets before, at and after a station. The lengths in κ are held fixed, which leaves the matrix
    positive semidefinite.
    """
    n = points.shape[0]
    for i in range(n):
        slope[i] = 0.0
        for k in range(4):
            band[i, k] = 0.0
            rows[i, k] = 0.0
    for i in range(n - 1):
        ex = (points[i + 1, 0] - points[i, 0]) / chord[i]
        ey = (points[i + 1, 1] - points[i, 1]) / chord[i]
        along_a = ex * normal[i, 0] + ey * normal[i, 1]
        along_b = ex * normal[i + 1, 0] + ey * normal[i + 1, 1]
        across_a = ex * normal[i, 1] - ey * normal[i, 0]
        across_b = ex * normal[i + 1, 1] - ey * normal[i + 1, 0]
        rho = 0.5 * (rates[i, 0] + rates[i + 1, 0])
        slope[i] += -rho * along_a + 0.5 * rates[i, 1] * chord[i]
        slope[i + 1] += rho * along_b + 0.5 * rates[i + 1, 1] * chord[i]
        stiff = rho / chord[i]
        band[i, 0] += stiff * across_a * across_a + 0.5 * rates[i, 2] * chord[i]
        band[i + 1, 0] += stiff * across_b * across_b + 0.5 * rates[i + 1, 2] * chord[i]
        band[i, 1] -= stiff * across_a * across_b
        # The direction of this chord turns κ at both of its ends.
        if i > 0:
            c = 2.0 / (chord[i - 1] + chord[i]) / chord[i]
            rows[i, 1] -= c * across_a
            rows[i, 2] += c * across_b
        if i + 2 < n:
            c = 2.0 / (chord[i] + chord[i + 1]) / chord[i]
            rows[i + 1, 0] += c * across_a
            rows[i + 1, 1] -= c * across_b
    for i in range(1, n - 1):
        w = bend * (chord[i - 1] + chord[i])
        for a in range(3):
            slope[i - 1 + a] += w * kappa[i] * rows[i, a]
            for b in range(a, 3):
                band[i - 1 + a, b - a] += w * rows[i, a] * rows[i, b]
    w = 2.0 * twist / step
    for i in range(n - 1):
        # κ_{i+1} - κ_i by the offsets i - 1 … i + 2.
        change = kappa[i + 1] - kappa[i]
        for a in range(4):
            ja = (rows[i + 1, a - 1] if a > 0 else 0.0) - rows[i, a]
            if ja == 0.0:
                continue
            slope[i - 1 + a] += w * change * ja
            for b in range(a, 4):
                jb = (rows[i + 1, b - 1] if b > 0 else 0.0) - rows[i, b]
                if jb != 0.0:
                    band[i - 1 + a, b - a] += w * ja * jb


@njit(cache=True, nogil=True)
def _stretch_cost(points, first, last, bend, twist, step, rate, transform):
    """Exact cost of the chords from station ``first`` to ``last`` of points (N, 2), and their bending."""
    n = points.shape[0]
    total = 0.0
    kappa = 0.0
    # κ of the stations outside does not change: theirs is needed for the change of κ only.
    for i in range(max(first - 1, 0), min(last + 1, n - 1) + 1):
        before = kappa
        kappa = 0.0
        if 0 < i < n - 1:
            ax = points[i, 0] - points[i - 1, 0]
            ay = points[i, 1] - points[i - 1, 1]
            bx = points[i + 1, 0] - points[i, 0]
            by = points[i + 1, 1] - points[i, 1]
            lengths = math.sqrt(ax * ax + ay * ay) + math.sqrt(bx * bx + by * by)
            kappa = 2.0 * math.atan2(ax * by - ay * bx, ax * bx + ay * by) / max(lengths, 1e-9)
            total += 0.5 * bend * kappa * kappa * lengths
        if i > max(first - 1, 0):
            total += twist * (kappa - before) ** 2 / step
        if first <= i < last:
            total += motion_rate_cost(
                points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1], rate, transform
            )
    return total


@njit(cache=True, nogil=True)
def relax(centre, normal, low, high, shifts, half, bend, twist, step, offset, points, rate, transform):
    """Lower the exact cost by moving humps of ``2 half + 1`` stations sideways; one round over all.

    ``offset`` (N,) and ``points`` (N, 2) are changed in place, offsets stay in low … high (N,). ``shifts``
    (S,) are tried in turn, m. Returns what was saved.
    """
    n = offset.shape[0]
    saved = 0.0
    for i in range(1, n - 1):
        first = max(i - half, 1)
        last = min(i + half, n - 2)
        here = _stretch_cost(points, first - 1, last + 1, bend, twist, step, rate, transform)
        for shift in shifts:
            for k in range(first, last + 1):
                hump = 1.0 - ((k - i) / (half + 1.0)) ** 2
                moved = min(max(offset[k] + shift * hump * hump, low[k]), high[k])
                points[k, 0] = centre[k, 0] + moved * normal[k, 0]
                points[k, 1] = centre[k, 1] + moved * normal[k, 1]
            there = _stretch_cost(points, first - 1, last + 1, bend, twist, step, rate, transform)
            better = there < here
            if better:
                saved += here - there
                here = there
            for k in range(first, last + 1):
                hump = 1.0 - ((k - i) / (half + 1.0)) ** 2
                if better:
                    offset[k] = min(max(offset[k] + shift * hump * hump, low[k]), high[k])
                points[k, 0] = centre[k, 0] + offset[k] * normal[k, 0]
                points[k, 1] = centre[k, 1] + offset[k] * normal[k, 1]
    return saved
