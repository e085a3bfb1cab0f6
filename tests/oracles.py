"""Slow, obvious twins of the kernels: plain Python, no cleverness. Randomised tests compare them."""

from __future__ import annotations

import heapq
import itertools
import math
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

    hidden = {c for c in clear - reached if not inside(c)}
    border = {c for c in hidden if max(abs(c[0] - ly // unit), abs(c[1] - lx // unit)) == half}
    behind = set().union(*(steps_from(c, hidden) for c in border))
    return "pocket", {c: c in wall - near or c in behind for c in cells}


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

    legs = [(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(points)]
    length = [hypot(*leg) for leg in legs]
    azimuth = [atan2(leg[1], leg[0]) for leg in legs]
    kappa = [0.0] * len(points)
    for i in range(1, len(points) - 1):
        turn = remainder(azimuth[i] - azimuth[i - 1], 2 * pi)
        kappa[i] = turn / (0.5 * (length[i - 1] + length[i]))
    cost = sum(0.5 * (rates[i] + rates[i + 1]) * length[i] for i in range(len(legs)))
    cost += bend * sum(kappa[i] ** 2 * 0.5 * (length[i - 1] + length[i]) for i in range(1, len(legs)))
    return cost + twist * sum((b - a) ** 2 for a, b in itertools.pairwise(kappa)) / step


def least_in_box(band, slope, low, high, rounds=500):
    """``min ½ xᵀ H x + gᵀ x`` with ``low ≤ x ≤ high``, one coordinate at a time; ``band[i, k]`` = H[i, i + k]."""
    n = len(slope)
    x = [0.0] * n

    def element(i, j):
        return band[min(i, j)][abs(i - j)] + (1e-6 if i == j else 0.0)

    for _ in range(rounds):
        for i in range(n):
            around = range(max(0, i - 3), min(n, i + 4))
            pull = slope[i] + sum(element(i, j) * x[j] for j in around if j != i)
            x[i] = min(max(-pull / element(i, i), low[i]), high[i])
    return np.array(x)


# --- vector visibility ---


def sight_past_edges(edges, landmark, place):
    """Rule of sight between two lattice points past edges (x0, y0, x1, y1), by where lines cross, in fractions.

    Hidden: the open segment crosses an edge, or passes ends of edges that stretch to its left and others to
    its right.
    """
    (lx, ly), (px, py) = landmark, place
    dx, dy = px - lx, py - ly
    left = right = False
    for x0, y0, x1, y1 in edges:
        ex, ey = x1 - x0, y1 - y0
        across = dx * ey - dy * ex
        if across == 0:
            continue
        # L + t (P - L) = A + s (B - A)
        t = Fraction((x0 - lx) * ey - (y0 - ly) * ex, across)
        s = Fraction((x0 - lx) * dy - (y0 - ly) * dx, across)
        if not (0 < t < 1 and 0 <= s <= 1):
            continue
        if 0 < s < 1:
            return False
        # Where the other end lies: dx * ey - dy * ex > 0 means that B is to the left.
        to_left = across > 0 if s == 0 else across < 0
        left, right = left or to_left, right or not to_left
    return not (left and right)


def nearest_edge_all_around(edges, direction):
    """Index of the first edge that a ray from the origin crosses inside; (x0, y0, x1, y1) integers, None without."""
    dx, dy = direction
    hits = []
    for i, (x0, y0, x1, y1) in enumerate(edges):
        across = dx * (y1 - y0) - dy * (x1 - x0)
        if across == 0:
            continue
        t = Fraction(x0 * (y1 - y0) - y0 * (x1 - x0), across)
        s = Fraction(x0 * dy - y0 * dx, across)
        if t > 0 and 0 < s < 1:
            hits.append((t, i))
    return min(hits)[1] if hits else None


# --- planner: grid search ---


def grid_dijkstra(rate, passable, source, resolution):
    """Cost from a cell to every cell, 8 neighbours, length × mean rate; dict of reached cells."""
    done, waiting = {}, [(0.0, source)]
    while waiting:
        cost, (row, col) = heapq.heappop(waiting)
        if (row, col) in done:
            continue
        done[row, col] = cost
        for dr, dc in itertools.product((-1, 0, 1), repeat=2):
            r, c = row + dr, col + dc
            if (dr or dc) and 0 <= r < rate.shape[0] and 0 <= c < rate.shape[1] and passable[r, c]:
                step = (dr * dr + dc * dc) ** 0.5 * resolution * (rate[row, col] + rate[r, c]) / 2
                heapq.heappush(waiting, (cost + step, (r, c)))
    return done


def grid_smallest_worst(values, passable, source, target):
    """Smallest threshold at which source and target are connected by cells with values up to it; inf if none."""
    for threshold in sorted({float(v) for v in values[passable]}):
        usable = passable & (values <= threshold)
        if not (usable[source] and usable[target]):
            continue
        seen, waiting = {source}, [source]
        while waiting:
            row, col = waiting.pop()
            for dr, dc in itertools.product((-1, 0, 1), repeat=2):
                r, c = row + dr, col + dc
                ok = 0 <= r < values.shape[0] and 0 <= c < values.shape[1]
                if ok and usable[r, c] and (r, c) not in seen:
                    seen.add((r, c))
                    waiting.append((r, c))
        if target in seen:
            return threshold
    return float("inf")


def cheapest_points(n, cost):
    """Cheapest way from point 0 to n - 1 with cost(i, j) between any two in order: (cost, indices)."""
    best = [(0.0, [0])]
    for j in range(1, n):
        best.append(min((best[i][0] + cost(i, j), [*best[i][1], j]) for i in range(j)))
    return best[-1]


# --- triplets ---


def azimuths(point, landmarks):
    """Azimuths of landmarks (n, 2) from a point, rad."""
    return [math.atan2(y - point[1], x - point[0]) for x, y in landmarks]


def mas97_covariance(point, three, variances):
    """Σ (2, 2) of a fix by equations (4) and (5) of MAS97, step by step as printed."""
    gradients = []
    for x, y in three:
        dx, dy = x - point[0], y - point[1]
        gradients.append(np.array([dy, -dx]) / (dx * dx + dy * dy))
    to_angles = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    upsilon = to_angles @ np.diag(variances) @ to_angles.T
    jacobian = np.array([gradients[0] - gradients[1], gradients[1] - gradients[2]])
    inverse = np.linalg.inv(jacobian)
    return inverse @ upsilon @ inverse.T


def information_covariance(point, landmarks, variances):
    """Covariance (3, 3) of (x, y, θ): inverse of the sum of w h hᵀ over all landmarks."""
    information = np.zeros((3, 3))
    for (x, y), v in zip(landmarks, variances, strict=True):
        dx, dy = x - point[0], y - point[1]
        r2 = dx * dx + dy * dy
        h = np.array([dy / r2, -dx / r2, -1.0])
        information += np.outer(h, h) / v
    return np.linalg.inv(information)


def smallest_span(angles):
    """First angle and span of the smallest arc that holds all angles, rad."""
    best = None
    for first in angles:
        span = max((a - first) % (2 * math.pi) % (2 * math.pi - 1e-12) for a in angles)
        if best is None or span < best[1]:
            best = (first, span)
    return best


def axes_of_three(angles, sensor, heading, steps=1501):
    """Every optical axis (in W) that a triplet allows, finely sampled with all ends; middle of its span."""
    first, span = smallest_span(angles)
    fov = sensor.field_of_view
    if span > fov + 1e-12:
        return [], 0.0
    low, high = first + span - fov / 2, first + fov / 2
    middle = first + span / 2
    candidates = [*np.linspace(low, max(low, high), steps), middle]
    turns = [turn * 2 * math.pi for turn in (-2, -1, 0, 1, 2)]
    candidates += [heading + limit + turn for limit in (sensor.pan_min, sensor.pan_max) for turn in turns]
    width = sensor.pan_max - sensor.pan_min
    allowed = []
    for axis in candidates:
        turned = (axis - heading - sensor.pan_min + 1e-12) % (2 * math.pi)
        if low - 1e-12 <= axis <= high + 1e-12 and (turned <= width + 2e-12 or width >= 2 * math.pi - 1e-9):
            allowed.append(axis)
    return allowed, middle


def sensor_place(point, sensor, heading):
    """Where the sensor of a robot at ``point`` is, W."""
    c, s = math.cos(heading), math.sin(heading)
    m = sensor.mount
    return np.array([point[0] + c * m.x - s * m.y, point[1] + s * m.x + c * m.y])


def is_measurable(place, landmark, sensor, heading):
    """Whether a landmark lies outside every muted sector and inside the view of a fixed camera."""
    angle = math.atan2(landmark[1] - place[1], landmark[0] - place[0]) - heading - sensor.mount.theta
    if sensor.kind == "pinhole_fixed":
        return abs(math.remainder(angle, 2 * math.pi)) <= sensor.field_of_view / 2
    muted = getattr(sensor, "muted", ())
    return not any((angle - a) % (2 * math.pi) <= (b - a) % (2 * math.pi) for a, b in muted)


def fix_of_three(point, three, survey_sigmas, sensor, heading=0.0):
    """Covariance (2, 2) of a triplet's fix, its variances and axis in W; None when there is no fix.

    ``point`` is the robot's centre. The axis is NaN without a pan head.
    """
    place = sensor_place(point, sensor, heading)
    if not all(is_measurable(place, m, sensor, heading) for m in three):
        return None
    zero = heading + sensor.mount.theta
    angles = azimuths(place, three)
    floor = sensor.bearing_floor**2
    shares = [(s / math.dist(place, m)) ** 2 + floor for s, m in zip(survey_sigmas, three, strict=True)]
    inverted = [(np.array(m) - place) / math.dist(place, m) ** 2 for m in three]
    e, f = inverted[1] - inverted[0], inverted[2] - inverted[0]
    if abs(e[0] * f[1] - e[1] * f[0]) <= 1e-9 * sum(float(g @ g) for g in inverted):
        return None

    def at(axis):
        scale = sensor.column_sigma_px / sensor.focal_px
        return [(scale * math.cos(a - axis) ** 2) ** 2 + s for a, s in zip(angles, shares, strict=True)]

    def size(axis):
        v1, v2, v3 = at(axis)
        return v1 * v2 + v1 * v3 + v2 * v3

    axis = math.nan
    if sensor.kind == "omnidirectional":
        variances = [sensor.bearing_sigma**2 + s for s in shares]
    elif sensor.kind == "pinhole_fixed":
        variances = at(zero)
    else:
        axes, middle = axes_of_three(angles, sensor, zero)
        if not axes:
            return None
        axis = min(axes, key=(lambda a: abs(a - middle)) if sensor.pan_policy == "centred" else size)
        variances = at(axis)
    if sensor.mount.lever == 0:
        return mas97_covariance(place, three, variances), variances, axis
    return at_centre(information_covariance(place, three, variances), point, place), variances, axis


def at_centre(covariance, point, place):
    """Covariance (2, 2) of the robot's centre from that of the sensor's pose (3, 3)."""
    ox, oy = place[0] - point[0], place[1] - point[1]
    jacobian = np.array([[1.0, 0.0, oy], [0.0, 1.0, -ox]])
    return jacobian @ covariance @ jacobian.T


def ranked_triplets(point, landmarks, survey_sigmas, sensor, heading=0.0, criterion="area"):
    """All triplets of visible landmarks (n, 2) that give a fix, as (number, triplet), best first.

    The number is det Σ, or the square of the largest eigenvalue or of half the trace.
    """
    numbers = {
        "area": np.linalg.det,
        "max_axis": lambda c: np.linalg.eigvalsh(c)[1] ** 2,
        "trace": lambda c: (np.trace(c) / 2) ** 2,
    }
    out = []
    for i, j, k in itertools.combinations(range(len(landmarks)), 3):
        chosen = [i, j, k]
        fix = fix_of_three(
            point, [tuple(landmarks[c]) for c in chosen], [survey_sigmas[c] for c in chosen], sensor, heading
        )
        if fix is not None:
            out.append((float(numbers[criterion](fix[0])), (i, j, k)))
    return sorted(out)


def all_visible_fix(point, landmarks, survey_sigmas, sensor, heading=0.0, criterion="area", steps=2001):
    """Smallest cost (det, λ or trace), over every axis allowed, of the fix from all landmarks in view; or None.

    Pan heads: axes on the middle of pairs (centred), or ``steps`` axes and those where a landmark enters or
    leaves the view (optimal).
    """
    place = sensor_place(point, sensor, heading)
    zero = heading + sensor.mount.theta
    kept = [k for k, m in enumerate(landmarks) if is_measurable(place, m, sensor, heading)]
    angles = azimuths(place, [landmarks[k] for k in kept])
    axes = [zero]
    if sensor.kind == "pinhole_pan":
        half = sensor.field_of_view / 2
        if sensor.pan_policy == "centred":
            axes = []
            for a, b in itertools.combinations(angles, 2):
                allowed, middle = axes_of_three([a, a, b], sensor, zero)
                axes += [min(allowed, key=lambda axis, middle=middle: abs(axis - middle))] if allowed else []
        else:
            low, high = zero + sensor.pan_min, zero + sensor.pan_max
            axes = list(np.linspace(low, high, steps))
            for edge in (a + side * half for a in angles for side in (-1, 1)):
                axes += [e for e in (edge + turn * 2 * math.pi for turn in range(-2, 3)) if low <= e <= high]
    best = None
    for axis in axes:
        chosen, variances = [], []
        for k, angle in zip(kept, angles, strict=True):
            off = math.remainder(angle - axis, 2 * math.pi)
            share = (survey_sigmas[k] / math.dist(place, landmarks[k])) ** 2 + sensor.bearing_floor**2
            if sensor.kind == "omnidirectional":
                variances.append(sensor.bearing_sigma**2 + share)
            elif abs(off) <= sensor.field_of_view / 2 + 1e-12:
                variances.append((sensor.column_sigma_px / sensor.focal_px * math.cos(off) ** 2) ** 2 + share)
            else:
                continue
            chosen.append(landmarks[k])
        if len(chosen) >= 3:
            c = at_centre(information_covariance(place, chosen, variances), point, place)
            cost = {"area": np.linalg.det(c), "max_axis": np.linalg.eigvalsh(c)[1], "trace": np.trace(c)}
            best = cost[criterion] if best is None else min(best, cost[criterion])
    return best


# --- belief along a path ---


def moved_by(pose, distance, turn, slip=0.0):
    """Pose after an arc, in a thousand small straight pieces; the slip is a sideways step at half the turn."""
    x, y, theta = pose
    for _ in range(1000):
        middle = theta + turn / 2000
        x += distance / 1000 * math.cos(middle)
        y += distance / 1000 * math.sin(middle)
        theta += turn / 1000
    side = pose[2] + turn / 2 + math.pi / 2
    return np.array([x + slip * math.cos(side), y + slip * math.sin(side), theta])


def numeric_jacobian(function, at, step=1e-6):
    """Central differences of a vector function."""
    columns = []
    for i in range(len(at)):
        high, low = np.array(at, float), np.array(at, float)
        high[i] += step
        low[i] -= step
        columns.append((np.asarray(function(high)) - np.asarray(function(low))) / (2 * step))
    return np.array(columns).T


def kalman_update(mean, covariance, innovation, measurement_matrix, noise):
    """Posterior mean and covariance in information form; the prior must be invertible."""
    H, R = np.atleast_2d(measurement_matrix), np.atleast_2d(noise)
    P = np.linalg.inv(np.linalg.inv(covariance) + H.T @ np.linalg.inv(R) @ H)
    return mean + P @ H.T @ np.linalg.inv(R) @ np.atleast_1d(innovation), P


def belief_along(poses, covariance, odometry_sigmas, sightings):
    """Covariances (K, 3, 3): straight legs between poses, then the bearings [(landmark, sigma), …] seen there."""
    distance_sigma, turn_sigma, drift_sigma, slip_sigma = odometry_sigmas
    out = []
    for i, seen in enumerate(sightings):
        if i > 0:
            step = poses[i][:2] - poses[i - 1][:2]
            turn = math.remainder(poses[i][2] - poses[i - 1][2], 2 * math.pi)
            phi = poses[i - 1][2] + turn / 2
            d = (step @ [math.cos(phi), math.sin(phi)]) / (math.sin(turn / 2) / (turn / 2) if turn else 1.0)

            def arc(q, before=poses[i - 1]):
                return moved_by(before, q[0], q[1], q[2])

            G = numeric_jacobian(arc, [d, turn, 0.0])
            F = numeric_jacobian(lambda q, d=d, turn=turn: moved_by(q, d, turn), poses[i - 1])
            M = np.diag(
                [
                    distance_sigma**2 * abs(d),
                    turn_sigma**2 * abs(turn) + drift_sigma**2 * abs(d),
                    slip_sigma**2 * abs(d),
                ]
            )
            covariance = F @ covariance @ F.T + G @ M @ G.T
        if len(seen) >= 3:
            rows = []
            for (lx, ly), _ in seen:
                dx, dy = lx - poses[i][0], ly - poses[i][1]
                rows.append([dy / (dx * dx + dy * dy), -dx / (dx * dx + dy * dy), -1.0])
            noise = np.diag([s**2 for _, s in seen])
            _, covariance = kalman_update(np.zeros(3), covariance, np.zeros(len(seen)), rows, noise)
        out.append(covariance)
    return np.array(out)


# --- triangulation ---


def bearings_from(pose, landmarks):
    """Bearings of landmarks (n, 2) from a pose (x, y, θ), rad in [-π, π]."""
    return [math.remainder(math.atan2(v - pose[1], u - pose[0]) - pose[2], 2 * math.pi) for u, v in landmarks]


def total_position(bearings, three):
    """Position by the published formulas of ToTal (Pierlot and Van Droogenbroeck 2014, algorithm 1).

    Undefined where two bearings are equal or opposite; says nothing about whether the bearings fit.
    """
    (x1, y1), (x2, y2), (x3, y3) = three
    x1, y1, x3, y3 = x1 - x2, y1 - y2, x3 - x2, y3 - y2
    t12 = 1 / math.tan(bearings[1] - bearings[0])
    t23 = 1 / math.tan(bearings[2] - bearings[1])
    t31 = (1 - t12 * t23) / (t12 + t23)
    x12, y12 = x1 + t12 * y1, y1 - t12 * x1
    x23, y23 = x3 - t23 * y3, y3 + t23 * x3
    x31, y31 = (x3 + x1) + t31 * (y3 - y1), (y3 + y1) - t31 * (x3 - x1)
    k31 = x1 * x3 + y1 * y3 + t31 * (x1 * y3 - x3 * y1)
    d = (x12 - x23) * (y23 - y31) - (y12 - y23) * (x23 - x31)
    return x2 + k31 * (y12 - y23) / d, y2 + k31 * (x23 - x12) / d


def triangulated(bearings, three, tolerance=1e-6):
    """Pose (x, y, θ) that sees three landmarks under these bearings, or None; not for degenerate places."""
    x, y = total_position(bearings, three)
    heading = math.atan2(three[1][1] - y, three[1][0] - x) - bearings[1]
    seen = bearings_from((x, y, heading), three)
    fits = all(
        abs(math.remainder(s - b, 2 * math.pi)) < tolerance for s, b in zip(seen, bearings, strict=True)
    )
    return (x, y, math.remainder(heading, 2 * math.pi)) if fits else None


# --- coverage ---


def share_inside(three, variances, axis, column_variance, normals):
    """Share of simulated fixes in the 95 % ellipse, sensor at the origin; ``normals`` (n, 6) is the noise.

    The columns' part of a variance goes onto ``tan ψ``, the rest onto the bearing. Position by ToTal; it counts
    if the three landmarks are seen from there as measured.
    """
    three = np.asarray(three, float)
    azimuth = np.arctan2(three[:, 1], three[:, 0])
    psi = azimuth - axis
    extra = np.asarray(variances) - column_variance * np.cos(psi) ** 4
    bearings = azimuth + normals[:, :3] * np.sqrt(np.maximum(extra, 0))
    if column_variance > 0:
        seen = np.arctan(np.tan(psi) + math.sqrt(column_variance) * normals[:, 3:])
        bearings = seen + axis + normals[:, :3] * np.sqrt(np.maximum(extra, 0))
    a, b = bearings[:, 1] - bearings[:, 0], bearings[:, 2] - bearings[:, 1]
    (x1, y1), (x3, y3) = three[0] - three[1], three[2] - three[1]
    t12, t23 = 1 / np.tan(a), 1 / np.tan(b)
    t31 = (1 - t12 * t23) / (t12 + t23)
    x12, y12, x23, y23 = x1 + t12 * y1, y1 - t12 * x1, x3 - t23 * y3, y3 + t23 * x3
    x31, y31 = (x3 + x1) + t31 * (y3 - y1), (y3 + y1) - t31 * (x3 - x1)
    k31 = x1 * x3 + y1 * y3 + t31 * (x1 * y3 - x3 * y1)
    d = (x12 - x23) * (y23 - y31) - (y12 - y23) * (x23 - x31)
    place = three[1] + np.stack([k31 * (y12 - y23) / d, k31 * (x23 - x12) / d], axis=1)
    ray = three - place[:, None]
    again = np.arctan2(ray[..., 1], ray[..., 0])
    off = again - bearings
    off = np.angle(np.exp(1j * (off - off[:, :1])))
    found = np.abs(off).max(axis=1) < 1e-6
    precision = np.linalg.inv(mas97_covariance((0.0, 0.0), three, variances))
    return float(np.mean(found & (np.einsum("ni,ij,nj->n", place, precision, place) <= -2 * math.log(0.05))))


# --- planner: poses ---


def pose_along(pose, parts):
    """Pose after parts (way, curvature, turn), in closed form part by part."""
    x, y, theta = pose
    for way, kappa, turn in parts:
        if kappa == 0:
            x, y = x + way * math.cos(theta), y + way * math.sin(theta)
        else:
            x += (math.sin(theta + way * kappa) - math.sin(theta)) / kappa
            y -= (math.cos(theta + way * kappa) - math.cos(theta)) / kappa
        theta += way * kappa + turn
    return x, y, theta


def curve_cost(curve, space, step):
    """Cost of a curve by small steps, the rate taken in their middles, and the least clearance on the way."""
    total, kept, gear = 0.0, math.inf, 0
    pose = tuple(curve.start)
    frame = space.cost_space.frame
    for way, kappa, turn in curve.parts:
        total += space.steering.turn_price * abs(turn)
        if way:
            total += space.steering.gear_price * (gear * way < 0)
            gear = 1 if way > 0 else -1
        n = max(1, math.ceil(abs(way) / step))
        places = [pose_along(pose, [(way * (k + 0.5) / n, kappa, 0.0)]) for k in range(n if way else 0)]
        for place in places:
            row, col = (int(v) for v in frame.cell_at(place[:2]))
            which = round(place[2] / (2 * math.pi) * len(space.rates)) % len(space.rates)
            inside = 0 <= row < frame.n_rows and 0 <= col < frame.n_cols
            total += abs(way) / n * (space.rates[which, row, col] if inside else math.inf)
        if places:
            kept = min(kept, float(space.cost_space.clearance.distance(np.array(places)[:, :2]).min()))
        pose = pose_along(pose, [(way, kappa, turn)])
    return total, kept


# --- planner: label searches ---


def cheapest_with_stretches(rate, passable, has_fix, source, target, *, resolution, limit):
    """Cheapest 8-connected walk whose stretches without a fix are at most ``limit``: cost over every label
    (cell, metres since the last fix), none dropped but repeated ones; inf without a walk."""
    done, waiting = set(), [(0.0, source, 0.0)]
    while waiting:
        cost, cell, metres = heapq.heappop(waiting)
        if cell == target:
            return cost
        if (cell, round(metres, 9)) in done:
            continue
        done.add((cell, round(metres, 9)))
        for dr, dc in itertools.product((-1, 0, 1), repeat=2):
            to = (cell[0] + dr, cell[1] + dc)
            inside = 0 <= to[0] < rate.shape[0] and 0 <= to[1] < rate.shape[1]
            if not (dr or dc) or not inside or not passable[to]:
                continue
            half = (dr * dr + dc * dc) ** 0.5 * resolution / 2
            until = metres + (0.0 if has_fix[cell] else half)
            since = 0.0 if has_fix[to] else until + half
            if max(until, since) <= limit + 1e-9:
                heapq.heappush(waiting, (cost + half * (rate[cell] + rate[to]), to, since))
    return math.inf


def smallest_stretch(rate, passable, has_fix, source, target, *, resolution):
    """Smallest limit with which ``cheapest_with_stretches`` finds a walk, by bisection."""
    low, high = 0.0, 2.0 * resolution * rate.size
    options = {"resolution": resolution}
    if cheapest_with_stretches(rate, passable, has_fix, source, target, limit=high, **options) == math.inf:
        return math.inf
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        cost = cheapest_with_stretches(rate, passable, has_fix, source, target, limit=middle, **options)
        low, high = (low, middle) if cost < math.inf else (middle, high)
    return high


# --- closed loop ---


def followed(pose, target, goal, distance, turn, robot, top):
    """Command (distance, turn, direction) of a robot that believes ``pose``, should be at ``target`` and be next
    at ``goal``; ``top`` (distance, turn) of a step.
    """
    share = min(robot.step / robot.follow_time, 1.0)
    off = np.array(target[:2]) - pose[:2]
    turned = math.remainder(target[2] - pose[2], 2 * math.pi)
    if robot.steering == "holonomic":
        way = np.array(goal[:2]) - np.array(target[:2]) + share * off
        w = float(np.clip(turn + share * turned, -top[1], top[1]))
        return min(float(np.hypot(*way)), top[0]), w, math.atan2(way[1], way[0]) - pose[2] - w / 2
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ahead, aside = c * off[0] + s * off[1], c * off[1] - s * off[0]
    if distance == 0:
        most = 0.0 if robot.min_turn_radius else top[1]
        return 0.0, float(np.clip(turn + share * turned, -most, most)), 0.0
    length = robot.follow_length
    d = distance * math.cos(turned) + share * ahead
    d = min(max(d, 0.0), top[0]) if distance > 0 else max(min(d, 0.0), -top[0])
    w = turn + distance * float(np.clip(aside, -length, length)) / length**2
    w += 2 * abs(distance) * math.sin(turned) / length
    most = min(top[1], abs(d) / robot.min_turn_radius) if robot.min_turn_radius else top[1]
    return d, float(np.clip(w, -most, most)), 0.0


def bearings_of_sensor(pose, three, mount):
    """Bearings from the zero of a sensor mounted (x, y, θ) on a robot at ``pose``."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    place = (pose[0] + c * mount[0] - s * mount[1], pose[1] + s * mount[0] + c * mount[1], pose[2] + mount[2])
    return np.array(bearings_from(place, three))


def driven_once(draw, poses, is_fix, triplets, world, sensor, robot, P, sees, walls):
    """Tracks (K, 4) of true and believed places of one run, and the step of a collision or None.

    ``triplets(k, believed pose)`` says what is looked at, ``sees(place, i)`` what is in sight; a camera with a
    pan head looks at the middle of the triplet. ``walls`` (M, 4) bound free space.
    """
    n, noise, mount = len(poses), robot.odometry, sensor.mount.as_array()
    steps = [poses[k + 1] - poses[k] for k in range(n - 1)]
    turns = [math.remainder(step[2], 2 * math.pi) for step in steps]
    ways = [np.hypot(*step[:2]) for step in steps]
    if robot.steering == "differential":
        middle = [pose[2] + w / 2 for pose, w in zip(poses, turns, strict=False)]
        ways = [
            (step @ [math.cos(m), math.sin(m), 0]) / (math.sin(w / 2) / (w / 2) if w else 1)
            for step, m, w in zip(steps, middle, turns, strict=True)
        ]
    top = (1.25 * max(map(abs, ways)), robot.max_turn_rate * robot.step)
    positions, survey = world.landmarks.positions, world.landmarks.sigma
    stand = positions
    fixes, used = int(np.sum(is_fix)), 0
    if survey.any():
        stand = positions + survey[:, None] * draw[3 + 3 * (n - 1) + 7 * fixes :].reshape(-1, 2)
    true, mean = poses[0] + np.linalg.cholesky(P) @ draw[:3], np.array(poses[0])
    out, before = np.full((n, 4), np.nan), np.array(poses[0])
    for k in range(n):
        if k > 0:
            d, w, direction = followed(mean, poses[k - 1], poses[k], ways[k - 1], turns[k - 1], robot, top)
            at = draw[3 + 3 * (k - 1) :][:3]
            M = np.array([noise.distance_sigma**2 * abs(d), 0, noise.slip_sigma**2 * abs(d)])
            M[1] = noise.turn_sigma**2 * abs(w) + noise.drift_sigma**2 * abs(d)
            e = np.sqrt(M) * at
            shift = np.array([0, 0, direction])
            true = moved_by(true + shift, d + e[0], w + e[1], e[2]) - shift

            def arc(q, start=mean + shift):
                return moved_by(start, q[0], q[1], q[2])

            def carried(q, d=d, w=w):
                return moved_by(q, d, w)

            F, G = numeric_jacobian(carried, mean + shift), numeric_jacobian(arc, [d, w, 0])
            mean, P = carried(mean + shift) - shift, F @ P @ F.T + G @ np.diag(M) @ G.T
        if segment_to_segments((*before[:2], *true[:2]), walls) < robot.radius - 1e-6:
            return out, k
        before = true
        if is_fix[k]:
            at = draw[3 + 3 * (n - 1) + 7 * used :][:7]
            used += 1
            z, v, three = measured(true, mean, triplets(k, mean), at, stand, positions, sensor, sees)
            if z is not None:
                places = positions[three]
                c, s = math.cos(mean[2]), math.sin(mean[2])
                arm = np.array([c * mount[0] - s * mount[1], s * mount[0] + c * mount[1]])
                away = np.hypot(*(places - mean[:2] - arm).T)
                R = np.diag(v + (survey[three] / away) ** 2)

                def seen(q, places=places):
                    return bearings_of_sensor(q, places, mount)

                if robot.mode == "fix":
                    found = triangulated(list(z), [tuple(p) for p in places])
                    if found is not None:
                        theta = found[2] - mount[2]
                        c, s = math.cos(theta), math.sin(theta)
                        arm = np.array([c * mount[0] - s * mount[1], s * mount[0] + c * mount[1]])
                        mean = np.array([*(np.array(found[:2]) - arm), theta])
                        H = numeric_jacobian(seen, mean)
                        P = np.linalg.inv(H.T @ np.linalg.inv(R) @ H)
                else:
                    off = [math.remainder(a - b, 2 * math.pi) for a, b in zip(z, seen(mean), strict=True)]
                    mean, P = kalman_update(mean, P, off, numeric_jacobian(seen, mean), R)
        out[k] = (*true[:2], *mean[:2])
    return out, None


def measured(true, mean, three, draw, stand, positions, sensor, sees):
    """Bearings of three landmarks with noise and their variances; None where one is out of sight or view."""
    if three is None:
        return None, None, None
    mount, floor = sensor.mount.as_array(), sensor.bearing_floor
    three, axis = list(three), 0.0
    psi = bearings_of_sensor(true, stand[three], mount)
    if not all(sees(sensor_place(true[:2], sensor, true[2]), i) for i in three):
        return None, None, None
    if sensor.kind == "omnidirectional":
        v = np.full(3, sensor.bearing_sigma**2 + floor**2)
        return psi + sensor.bearing_sigma * draw[:3] + floor * draw[3:6], v, three
    if sensor.kind == "pinhole_pan":
        believed = list(bearings_of_sensor(mean, positions[three], mount))
        axes, axis = axes_of_three(believed, sensor, 0.0)
        if not axes:
            return None, None, None
    off = np.array([math.remainder(a - axis, 2 * math.pi) for a in psi])
    if (np.abs(off) > sensor.field_of_view / 2).any():
        return None, None, None
    spread = sensor.column_sigma_px / sensor.focal_px
    off = np.arctan(np.tan(off) + spread * draw[:3])
    return axis + off + floor * draw[3:6], (spread * np.cos(off) ** 2) ** 2 + floor**2, three


def lattice_move(lattice, p, row, col):
    """Cost of a move of a lattice from a cell by the kernel that searches use."""
    from planner.kernels.lattice import move_cost

    _, *rest = lattice.move_args
    return move_cost(p, row, col, math.inf, *rest)


def lattice_dijkstra(lattice, start, goal):
    """Cheapest cost from end to end by plain Dijkstra over (cell, heading, gear), moves costed as curves."""
    from planner.steering import PoseCurve, shortest_curve

    space, made = lattice.space, lattice.primitives
    n, cols = len(made.headings), space.cost_space.frame.n_cols
    price = space.steering.gear_price if lattice.n_gears == 2 else 0.0

    def changed(a, b):
        return price if a * b < 0 else 0.0

    direct = shortest_curve((start.x, start.y, start.heading), (goal.x, goal.y, goal.heading), space.steering)
    best = space.cost(direct)
    first, last = lattice.joints(start, is_start=True), lattice.joints(goal, is_start=False)
    ends = {int(k): (c, int(g)) for k, c, g in zip(last.keys, last.costs, last.gears, strict=True)}
    waiting = [(c, int(k), int(g)) for k, c, g in zip(first.keys, first.costs, first.gears, strict=True)]
    heapq.heapify(waiting)
    done, known = set(), {}
    while waiting:
        cost, key, gear = heapq.heappop(waiting)
        if (key, gear) in done:
            continue
        done.add((key, gear))
        if key in ends:
            best = min(best, cost + ends[key][0] + changed(gear, ends[key][1]))
        row, col, heading = key // n // cols, key // n % cols, key % n
        pose = lattice.pose(np.array([key]))[0]
        for p in range(made.arrays[0][heading], made.arrays[0][heading + 1]):
            _, to, rows, columns, moved = made.arrays[1][p].tolist()
            r, c = row + rows, col + columns
            if not (0 <= r < space.cost_space.frame.n_rows and 0 <= c < cols):
                continue
            if (key, p) not in known:
                known[key, p] = space.cost(PoseCurve(pose, made.parts[p]))
            if known[key, p] < math.inf:
                new = cost + known[key, p] + changed(gear, moved)
                heapq.heappush(waiting, (new, (r * cols + c) * n + to, moved or gear))
    return best


# --- planner: figures of ways between many places ---


def figures_by_samples(cells, r95, step=1e-3):
    """Length, ``∫ r95``, blind length and worst r95 of a polyline in cells, by the middles of tiny steps."""
    length = integral = blind = 0.0
    worst = math.nan
    for a, b in itertools.pairwise(np.asarray(cells, dtype=float)):
        d = float(np.hypot(*(b - a)))
        n = max(1, math.ceil(d / step))
        for k in range(n):
            x, y = a + (b - a) * (k + 0.5) / n
            value = r95[int(y), int(x)]
            length += d / n
            if math.isnan(value):
                blind += d / n
            else:
                integral += value * d / n
                worst = value if math.isnan(worst) else max(worst, value)
    return length, integral, blind, worst


def lattice_without_headings(lattice, goal):
    """Cost from every cell to an end when the robot may take up any heading for nothing, by relaxing to rest."""
    made, n = lattice.primitives, len(lattice.primitives.headings)
    rows, cols = lattice.space.cost_space.frame.shape
    cost = np.full((rows, cols), np.inf)
    joints = lattice.joints(goal, is_start=False)
    for key, value in zip(joints.keys // n, joints.costs, strict=True):
        cost[key // cols, key % cols] = min(cost[key // cols, key % cols], value)
    steps = [
        (r, c, r + dr, c + dc, lattice_move(lattice, p, r, c))
        for p, (_, _, dr, dc, _) in enumerate(made.arrays[1].tolist())
        for r in range(max(0, -dr), min(rows, rows - dr))
        for c in range(max(0, -dc), min(cols, cols - dc))
    ]
    steps = [s for s in steps if s[4] < math.inf]
    changed = True
    while changed:
        changed = False
        for r, c, to_r, to_c, step in steps:
            if cost[to_r, to_c] + step < cost[r, c]:
                cost[r, c] = cost[to_r, to_c] + step
                changed = True
    return cost


def belief_after(P, direction, d, turn, driven, *, fixes, sigmas, period, parts=4):
    """Covariance (3, 3), metres since a fix was due and worst r95 after a turn on the spot and d m straight ahead.

    ``fixes``: information (3, 3) or None of the cell left and the one entered; ``sigmas``: distance, turn,
    drift, slip; ``period``: metres between fixes.
    """

    def r95(P):
        return math.sqrt(-2 * math.log(0.05) * math.sqrt(np.linalg.det(P[:2, :2])))

    P = P + np.diag([0.0, 0.0, sigmas[1] ** 2 * turn])
    driven += d
    times = math.floor(driven / period + 1e-9)
    driven = max(driven - times * period, 0.0)
    pieces = min(max(times, 1), parts)
    c, s, worst = math.cos(direction), math.sin(direction), 0.0
    for i in range(pieces):
        e = d / pieces
        F = np.array([[1, 0, -e * s], [0, 1, e * c], [0, 0, 1]])
        G = np.array([[c, -e * s / 2, -s], [s, e * c / 2, c], [0, 1, 0]])
        M = np.diag([sigmas[0] ** 2 * e, sigmas[2] ** 2 * e, sigmas[3] ** 2 * e])
        P = F @ P @ F.T + G @ M @ G.T
        worst = max(worst, r95(P))
        J = fixes[0] if times > 1 and 2 * (i + 1) <= pieces else fixes[1]
        if times and J is not None:
            P = np.linalg.inv(np.linalg.inv(P) + times / pieces * J)
    return P, driven, worst


def dead_reckoning(fixes, steps, directions, sigmas):
    """Covariances (3, 3) or None along a way: the fix (or None) of each place, else odometry since the last."""
    out = [fixes[0]]
    for k in range(1, len(fixes)):
        if fixes[k] is not None or out[-1] is None:
            out.append(fixes[k])
            continue
        turn = 0.0 if k == 1 else abs(math.remainder(directions[k - 1] - directions[k - 2], 2 * math.pi))
        P, _, _ = belief_after(
            out[-1],
            directions[k - 1],
            steps[k - 1],
            turn,
            0.0,
            fixes=(None, None),
            sigmas=sigmas,
            period=math.inf,
        )
        out.append(P)
    return out


def every_fused_walk(
    passable, fixes, source, target, P, *, resolution, weight, max_r95, sigmas, period, most
):
    """Cheapest walk by fused belief, all walks tried in the order of their cost, none dropped; every corner is
    driven. Cost ``∫ 1 + weight · r95``; inf without a walk; None when more than ``most`` walks came first."""
    waiting = [(0.0, 0, source, P, 0.0, None)]
    count = 0

    def r95(P):
        return math.sqrt(-2 * math.log(0.05) * math.sqrt(np.linalg.det(P[:2, :2])))

    while waiting:
        cost, _, cell, P, driven, last = heapq.heappop(waiting)
        if cell == target:
            return cost
        for dr, dc in itertools.product((-1, 0, 1), repeat=2):
            to = (cell[0] + dr, cell[1] + dc)
            inside = 0 <= to[0] < passable.shape[0] and 0 <= to[1] < passable.shape[1]
            if not (dr or dc) or not inside or not passable[to]:
                continue
            direction = math.atan2(dr, dc)
            turn = 0.0 if last is None else abs(math.remainder(direction - last, 2 * math.pi))
            d = math.hypot(dr, dc) * resolution
            pair = (fixes[cell], fixes[to])
            after, then, worst = belief_after(
                P, direction, d, turn, driven, fixes=pair, sigmas=sigmas, period=period
            )
            if worst > max_r95 * (1 + 1e-9):
                continue
            count += 1
            if count > most:
                return None
            new = cost + d * (1 + weight * (r95(P) + r95(after)) / 2)
            heapq.heappush(waiting, (new, count, to, after, then, direction))
    return math.inf


def front_of_worst(values, passable, source, target, *, resolution):
    """Front of (length, worst value) from cell to cell: the shortest way under every level, dominated ones out."""
    front = []
    for level in sorted({float(v) for v in values[passable]}):
        usable = passable & (values <= level)
        if usable[source] and usable[target]:
            length = grid_dijkstra(np.ones(values.shape), usable, source, resolution).get(target, math.inf)
            if length < (front[-1][0] - 1e-9 if front else math.inf):
                front.append((length, level))
    return front[::-1]


def hull_of_weights(values, passable, source, target, *, resolution, weights):
    """Smallest ``length + w · ∫ value`` from cell to cell for each weight."""
    return [
        grid_dijkstra(1 + w * values, passable, source, resolution).get(target, math.inf) for w in weights
    ]


def turning_allowed(b0, b1, k0, k1, ds, max_speed, accel, max_turn_rate, alpha):
    """Whether the step from v² = b0 to b1 over ds keeps all limits at its ends, κ going from k0 to k1."""
    a, slope = (b1 - b0) / (2 * ds), (k1 - k0) / ds
    ok = True
    for b, k in ((b0, k0), (b1, k1)):
        ok &= b <= max_speed**2 * (1 + 1e-9)
        ok &= k * k * b <= max_turn_rate**2 * (1 + 1e-9)
        ok &= a**2 + (k * b) ** 2 <= accel**2 * (1 + 1e-9)
        ok &= abs(slope * b + k * a) <= alpha * (1 + 1e-9)
    return bool(ok)


def turning_time(kappa, step, max_speed, accel, max_turn_rate, alpha, levels):
    """Least time from rest to rest over stations by trying levels of v² at each."""
    limits = (max_speed, accel, max_turn_rate, alpha)
    grid = [max_speed**2 * (i / levels) ** 2 for i in range(levels + 1)]
    best = {0: 0.0}
    for i, ds in enumerate(step):
        last = i == len(step) - 1
        after = {}
        for p, t in best.items():
            for q in [0] if last else range(levels + 1):
                speeds = grid[p] ** 0.5 + grid[q] ** 0.5
                if speeds > 0 and turning_allowed(grid[p], grid[q], *kappa[i], ds, *limits):
                    after[q] = min(after.get(q, math.inf), t + 2 * ds / speeds)
        best = after
    return best[0]


# --- landmark schedule ---


def cheapest_looks(cost, blind, pan, halves, times, borders, switch, rate, *, is_endless):
    """Least cost of a schedule: every sequence of triplets and of none, one after the other."""
    n, m = cost.shape
    best = math.inf
    for way in itertools.product([*range(m), None], repeat=n):
        if not all(c is None or cost[k, c] < math.inf for k, c in enumerate(way)):
            continue
        looks = [(k, c) for k, c in enumerate(way) if c is not None]
        seen = np.array([[0.0, 0.0] if c is None else [1.0, 1.0] for c in way])
        total = 0.0
        for (k, a), (j, c) in itertools.pairwise(looks):
            turn = 0.0 if math.isnan(pan[k, a]) else abs(pan[j, c] - pan[k, a])
            if is_endless:
                turn = min(turn % (2 * math.pi), -turn % (2 * math.pi))
            total += switch if a != c else 0.0
            if turn / rate > (times[j] - times[k]) * (1 + 1e-12):
                total = math.inf  # not there in time
            elif a != c or j > k + 1:
                # What the cells between leave is turned in the half cells at both sides, in equal shares.
                there = (borders[k + 1] - times[k]) + (times[j] - borders[j])
                share = max(0.0, turn / rate - (borders[j] - borders[k + 1])) / there
                seen[k, 1] -= share
                seen[j, 0] -= share
        for k, c in enumerate(way):
            for side in (0, 1):
                own = blind[k] if c is None else cost[k, c]
                if halves[k, side] > 0:
                    total += halves[k, side] * (seen[k, side] * own + (1 - seen[k, side]) * blind[k])
        best = min(best, total)
    return best


def nearest_following(pan, slack, seconds, rate, step):
    """Least sum of how far a head is off its angles ``pan`` (K,) while all is in view; inf: it cannot follow.

    All sequences of angles on a grid of ``step``; ``slack`` (K, 2), ``seconds`` (K - 1,) between.
    """
    n = len(pan)
    grid = [
        np.arange(math.ceil((p + a) / step - 1e-6), math.floor((p + b) / step + 1e-6) + 1)
        for p, (a, b) in zip(pan, slack, strict=True)
    ]
    least = {int(g): abs(g * step - pan[0]) for g in grid[0]}
    for k in range(1, n):
        reach = rate * seconds[k - 1] / step + 1e-9
        least = {
            int(g): abs(g * step - pan[k])
            + min((v for q, v in least.items() if abs(q - g) <= reach), default=math.inf)
            for g in grid[k]
        }
    return min(least.values(), default=math.inf)


def fix_information_of(cell, three, sigmas, *, arm, axis, on_axis, floor, pinhole, covariance, sigma_theta):
    """Information (3, 3) of a fix at a cell's centre, and by how much its ellipse is wider than the triplet's.

    ``three``: places of the triplet or None; ``arm``: from the robot to the sensor; ``axis``: where it looks;
    ``covariance`` (2, 2) and ``sigma_theta``: what the field says.
    """
    if three is not None:
        M = np.zeros((3, 3))
        for place, sigma in zip(three, sigmas, strict=True):
            to = np.asarray(place) - (np.asarray(cell) + arm)
            r2 = to @ to
            # The bearing's gradient; turning the robot moves the sensor, too.
            h = np.array([to[1] / r2, -to[0] / r2, 0.0])
            h[2] = -h[0] * arm[1] + h[1] * arm[0] - 1.0
            variance = on_axis**2 + floor**2 + sigma**2 / r2
            if pinhole:
                off = math.atan2(to[1], to[0]) - axis
                variance = on_axis**2 * math.cos(off) ** 4 + floor**2 + sigma**2 / r2
            M += np.outer(h, h) / variance
        wider = math.sqrt(np.linalg.det(covariance) / np.linalg.det(np.linalg.inv(M)[:2, :2]))
        if wider > 1.0 - 1e-6:
            return M / max(wider, 1.0), max(wider, 1.0)
    out = np.zeros((3, 3))
    out[:2, :2] = np.linalg.inv(covariance)
    out[2, 2] = 1.0 / sigma_theta**2
    return out, math.nan


def ends_of_lines(points, limit, means, is_valid, window=400, patience=8, more=1.02):
    """Indices of points at which straight lines along a path begin and end.

    ``means``: functions (a, b) → integral of a layer along a segment; ``is_valid`` (a, b): of a line.
    """
    p = np.asarray(points)

    def is_close(i, j):
        way = p[j] - p[i]
        length = np.hypot(*way)
        for q in p[i + 1 : j] - p[i]:
            along = q @ way / length
            if abs(q[0] * way[1] - q[1] * way[0]) / length > limit or not -limit <= along <= length + limit:
                return False
        return length > 0

    def stands_for(i, j):
        if not is_close(i, j) or not is_valid(p[i], p[j]):
            return False
        driven = sum(math.dist(p[k], p[k + 1]) for k in range(i, j))
        for mean in means:
            along = sum(mean(p[k], p[k + 1]) for k in range(i, j))
            if mean(p[i], p[j]) > more * math.dist(p[i], p[j]) / driven * along + 1e-6:
                return False
        return True

    kept = [0]
    while kept[-1] < len(p) - 1:
        i = kept[-1]
        best, missed = i + 1, 0
        for j in range(i + 2, min(i + window, len(p) - 1) + 1):
            missed = 0 if stands_for(i, j) else missed + 1
            best = j if missed == 0 else best
            if missed > patience:
                break
        kept.append(best)
    return kept


# --- widest ways ---


def widest_on_cells(values, start, goal):
    """Largest least value of an 8-connected way between two cells (row, col): every threshold is tried."""
    for least in sorted(set(values.ravel().tolist()), reverse=True):
        if values[start] < least or values[goal] < least:
            continue
        reached, todo = {start}, [start]
        while todo:
            row, col = todo.pop()
            for r, c in itertools.product((row - 1, row, row + 1), (col - 1, col, col + 1)):
                inside = 0 <= r < values.shape[0] and 0 <= c < values.shape[1]
                if inside and (r, c) not in reached and values[r, c] >= least:
                    reached.add((r, c))
                    todo.append((r, c))
        if goal in reached:
            return least
    return -math.inf
