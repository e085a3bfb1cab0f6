"""Slow, obvious twins of the kernels: plain Python, no cleverness. Randomised tests compare them."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np

# --- clearance ---


def point_to_segment(point, segment):
    """Distance from a point to a segment (x0, y0, x1, y1)."""
    (px, py), (x0, y0, x1, y1) = point, segment
    dx, dy = x1 - x0, y1 - y0
    length2 = dx * dx + dy * dy
    t = 0.0 if length2 == 0 else ((px - x0) * dx + (py - y0) * dy) / length2
    t = min(1.0, max(0.0, t))
    return ((px - x0 - t * dx) ** 2 + (py - y0 - t * dy) ** 2) ** 0.5


def point_to_segments(point, segments):
    """Distance from a point to the nearest of all segments; inf when there is none."""
    return min((point_to_segment(point, s) for s in segments), default=float("inf"))


def segment_to_segment(p, q):
    """Distance between two segments (x0, y0, x1, y1): 0 where they cross, else from an end of one."""

    def side(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    a, b, c, d = p[:2], p[2:], q[:2], q[2:]
    if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
        return 0.0
    return min(point_to_segment(a, q), point_to_segment(b, q), point_to_segment(c, p), point_to_segment(d, p))


def segment_to_segments(p, segments):
    """Distance from a segment to the nearest of all segments; inf when there is none."""
    return min((segment_to_segment(p, s) for s in segments), default=float("inf"))


# --- runs ---


def masks_of_runs(row_runs, row_offsets, col_runs, col_offsets, shape):
    """Masks (n_rows, n_cols, n_words), one bit set after the other."""
    n = len(row_offsets) - 1
    masks = np.zeros((*shape, max(1, -(-n // 64))), dtype=np.uint64)
    for i in range(n):
        bit = np.uint64(1 << (i % 64))
        for line, first, stop in row_runs[row_offsets[i] : row_offsets[i + 1]]:
            masks[line, first:stop, i // 64] |= bit
        for line, first, stop in col_runs[col_offsets[i] : col_offsets[i + 1]]:
            masks[first:stop, line, i // 64] |= bit
    return masks


# --- planner: line cost ---


def line_rate_integral(rate, start, end):
    """Integral of a piecewise constant rate along a line in cells: cut at every border, look at the middles.

    On a border the larger rate counts; outside the grid the rate is inf; coordinates within 1e-9 of a border
    are on it, pieces shorter than 1e-9 cells do not count.
    """

    def snap(v):
        return float(round(v)) if abs(v - round(v)) < 1e-9 else v

    (x0, y0), (x1, y1) = (tuple(snap(v) for v in p) for p in (start, end))
    length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
    cuts = {0.0, 1.0}
    for a, b in ((x0, x1), (y0, y1)):
        cuts |= {(k - a) / (b - a) for k in range(-2, 200) if a != b and min(a, b) < k < max(a, b)}
    cuts = sorted(cuts)
    total = 0.0
    for t0, t1 in itertools.pairwise(cuts):
        piece = (t1 - t0) * length
        if piece < 1e-9:
            continue
        x, y = x0 + (t0 + t1) / 2 * (x1 - x0), y0 + (t0 + t1) / 2 * (y1 - y0)
        columns = {int(x // 1)} | ({int(x) - 1} if x0 == x1 and x == int(x) else set())
        rows = {int(y // 1)} | ({int(y) - 1} if y0 == y1 and y == int(y) else set())
        inside = [(0 <= r < rate.shape[0] and 0 <= c < rate.shape[1], r, c) for r in rows for c in columns]
        total += piece * max(rate[r, c] if ok else float("inf") for ok, r, c in inside)
    return total


# --- grid visibility ---


def sight_on_grid(opaque_at, cells, unit, landmark, place):
    """Rule of sight between two lattice points, cell by cell in fractions; ``cells`` lists those to look at.

    Hidden: in or on an opaque cell; through the inside of one; or touching some on the left and on the right.
    """
    (lx, ly), (px, py) = landmark, place
    dx, dy = px - lx, py - ly
    if dx == 0 and dy == 0:
        return False
    left = right = False
    for row, col in cells:
        if not opaque_at(row, col):
            continue
        x0, x1, y0, y1 = col * unit, (col + 1) * unit, row * unit, (row + 1) * unit
        if x0 <= px <= x1 and y0 <= py <= y1:
            return False
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        sides = [dx * (y - ly) - dy * (x - lx) for x, y in corners]
        # Where along the line (0 landmark, 1 place) it is within the closed cell.
        enter, leave = Fraction(-(10**9)), Fraction(10**9)
        for start, step, low, high in ((lx, dx, x0, x1), (ly, dy, y0, y1)):
            if step:
                a, b = sorted((Fraction(low - start, step), Fraction(high - start, step)))
                enter, leave = max(enter, a), min(leave, b)
            elif not low <= start <= high:
                enter, leave = Fraction(1), Fraction(0)
        if min(sides) < 0 < max(sides):
            if enter < leave and enter < 1 and leave > 0:
                return False
        elif enter <= leave and (0 < enter < 1 or (enter < leave and enter < 1 and leave > 0)):
            left = left or max(sides) > 0
            right = right or min(sides) < 0
    return not (left and right)


def pocket_on_grid(opaque, free, unit, landmark, normal, tolerance_cells, size):
    """("clear" | "pocket" | "buried", {cell: opaque}) of a landmark in or on a wall."""
    lx, ly = landmark
    half = size // 2
    cells = [(ly // unit + r, lx // unit + c) for r in range(-half, half + 1) for c in range(-half, half + 1)]

    def on_grid(cell):
        return 0 <= cell[0] < opaque.shape[0] and 0 <= cell[1] < opaque.shape[1]

    def gap2(cell):
        dx = max(cell[1] * unit - lx, 0, lx - (cell[1] + 1) * unit)
        dy = max(cell[0] * unit - ly, 0, ly - (cell[0] + 1) * unit)
        return dx * dx + dy * dy

    def rank(cell):
        cx, cy = (cell[1] + 0.5) * unit - lx, (cell[0] + 0.5) * unit - ly
        wrong_side = any(normal) and cx * normal[0] + cy * normal[1] <= 0
        return (wrong_side, not (on_grid(cell) and free[cell]), gap2(cell), cx * cx + cy * cy, cell)

    wall = {c for c in cells if on_grid(c) and opaque[c]}
    near = {c for c in cells if gap2(c) <= int(tolerance_cells * unit) ** 2}
    if not near & wall:
        return "clear", {}
    if not near - wall:
        return "buried", {}

    def steps_from(cell, where):
        """Fewest steps through cell sides to each cell of ``where``."""
        steps, border = {cell: 0}, [cell]
        for row, col in border:
            for beside in ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)):
                if beside in where and beside not in steps:
                    steps[beside] = steps[row, col] + 1
                    border.append(beside)
        return steps

    clear = set(cells) - wall
    reached = set()
    for source in steps_from(min(near - wall, key=rank), near - wall):
        # No detour: as many steps as the cells are apart.
        far = steps_from(source, clear).items()
        reached |= {c for c, n in far if n == abs(c[0] - source[0]) + abs(c[1] - source[1])}

    def inside(cell):
        return cell[1] * unit < lx < (cell[1] + 1) * unit and cell[0] * unit < ly < (cell[0] + 1) * unit

    return "pocket", {c: c not in near if c in wall else not (c in reached or inside(c)) for c in cells}


# --- planner: timing, smoothing, sampling ---


def fastest_speeds(kappa, step, max_speed, accel, levels=600):
    """Largest v² at every station from rest to rest, by trying levels of v² from station to station."""

    def allowed(b0, b1, k0, k1, ds):
        a = (b1 - b0) / (2 * ds)
        limit = accel**2 * (1 + 1e-12)
        return a**2 + (k0 * b0) ** 2 <= limit and a**2 + (k1 * b1) ** 2 <= limit

    grid = [max_speed**2 * i / levels for i in range(levels + 1)]
    n = len(kappa)
    ends = [set() for _ in range(n)]  # levels from which the rest of the way can be driven
    ends[-1] = {0}
    for i in range(n - 2, -1, -1):
        for level in range(levels + 1):
            pair = (kappa[i], kappa[i + 1], step[i])
            if any(allowed(grid[level], grid[other], *pair) for other in ends[i + 1]):
                ends[i].add(level)
    out, now = [0.0], {0}
    for i in range(n - 1):
        pair = (kappa[i], kappa[i + 1], step[i])
        now = {b for b in ends[i + 1] if any(allowed(grid[a], grid[b], *pair) for a in now)}
        out.append(grid[max(now)])
    return out


def blended_rate(gx, gy, rate):
    """Bilinear rate at (column, row) in cells with finite corners only, their shares made to add up to 1."""
    total = share = 0.0
    for r in range(len(rate)):
        for c in range(len(rate[0])):
            w = max(0.0, 1 - abs(gx - 0.5 - c)) * max(0.0, 1 - abs(gy - 0.5 - r))
            if rate[r][c] < float("inf"):
                total += w * rate[r][c]
                share += w
    return total / share if share > 0 else float("inf")


def bending_cost(points, rates, bend, twist, step):
    """``Σ ρ |Δp| + bend Σ κ² l + twist Σ Δκ² / step`` of a polyline, curvature 0 at both ends."""
    from math import atan2, hypot, pi, remainder

    legs = [(b[0] - a[0], b[1] - a[1]) for a, b in zip(points[:-1], points[1:], strict=True)]
    length = [hypot(*leg) for leg in legs]
    azimuth = [atan2(leg[1], leg[0]) for leg in legs]
    kappa = [0.0] * len(points)
    for i in range(1, len(points) - 1):
        turn = remainder(azimuth[i] - azimuth[i - 1], 2 * pi)
        kappa[i] = turn / (0.5 * (length[i - 1] + length[i]))
    cost = sum(0.5 * (rates[i] + rates[i + 1]) * length[i] for i in range(len(legs)))
    cost += bend * sum(kappa[i] ** 2 * 0.5 * (length[i - 1] + length[i]) for i in range(1, len(legs)))
    return cost + twist * sum((b - a) ** 2 for a, b in zip(kappa[:-1], kappa[1:], strict=True)) / step
