"""Lines of sight over a grid of opaque cells, exact: whole numbers only.

Positions are whole numbers of lattice units, ``1 << shift`` units to a cell, cell (row, col) being the square
``col … col + 1`` by ``row … row + 1`` in cells; all of them below 2^30 in size, so that every product fits.
A landmark may have a *window*: cells (w, w) with their opacity for this landmark alone, whose first cell is
(corner_row, corner_col); without one corner_row is FAR. Beyond the grid nothing is opaque.

A place P is hidden from a landmark L when P lies in or on an opaque cell, when the open segment enters the
inside of one, or when it touches opaque cells on its left and on its right (not necessarily at one place).
"""

from __future__ import annotations

import numpy as np
from numba import njit

NO_WALL, POCKET, BURIED = 0, 1, 2
FAR = 1 << 40


@njit(cache=True, nogil=True)
def is_opaque(opaque, window, corner_row, corner_col, row, col):
    """Whether cell (row, col) stops the sight of a landmark; (n_rows, n_cols), (w, w)."""
    r = row - corner_row
    c = col - corner_col
    if 0 <= r < window.shape[0] and 0 <= c < window.shape[1]:
        return window[r, c]
    return 0 <= row < opaque.shape[0] and 0 <= col < opaque.shape[1] and opaque[row, col]


@njit(cache=True, nogil=True)
def touches_opaque(opaque, window, corner_row, corner_col, shift, x, y):
    """Whether (x, y) lies in or on an opaque cell; (n_rows, n_cols), (w, w)."""
    for row in range((y - 1) >> shift, (y >> shift) + 1):
        for col in range((x - 1) >> shift, (x >> shift) + 1):
            if is_opaque(opaque, window, corner_row, corner_col, row, col):
                return True
    return False


@njit(cache=True, nogil=True)
def _clear_upright(opaque, window, corner_row, corner_col, shift, x, y0, y1, level):
    """Whether the line x = const, y0 < y < y1 is clear; ``level``: the same with rows and columns swapped."""
    on_line = (x & ((1 << shift) - 1)) == 0
    right = x >> shift
    touched_left = False
    touched_right = False
    for k in range(y0 >> shift, ((y1 - 1) >> shift) + 1):
        if level:
            hit = is_opaque(opaque, window, corner_row, corner_col, right, k)
        else:
            hit = is_opaque(opaque, window, corner_row, corner_col, k, right)
        touched_right = touched_right or hit
        if on_line:
            if level:
                hit = is_opaque(opaque, window, corner_row, corner_col, right - 1, k)
            else:
                hit = is_opaque(opaque, window, corner_row, corner_col, k, right - 1)
            touched_left = touched_left or hit
        else:
            touched_left = touched_right
        if touched_left and touched_right:
            return False
    return True


@njit(cache=True, nogil=True)
def clear_sight(opaque, window, corner_row, corner_col, shift, lx, ly, px, py):
    """Whether (px, py) is seen from (lx, ly); (n_rows, n_cols), (w, w). Not from itself."""
    if px == lx and py == ly:
        return False
    if touches_opaque(opaque, window, corner_row, corner_col, shift, px, py):
        return False
    if px == lx:
        low = min(ly, py)
        return _clear_upright(opaque, window, corner_row, corner_col, shift, lx, low, max(ly, py), False)
    if py == ly:
        low = min(lx, px)
        return _clear_upright(opaque, window, corner_row, corner_col, shift, ly, low, max(lx, px), True)
    # Mirrored so that the line rises to the right; a mirrored cell k is -1 - k.
    mirror_x = px < lx
    mirror_y = py < ly
    dx = abs(px - lx)
    dy = abs(py - ly)
    x = -lx if mirror_x else lx
    y = -ly if mirror_y else ly
    col = x >> shift
    row = y >> shift
    unit = 1 << shift
    to_x = ((col + 1) << shift) - x
    to_y = ((row + 1) << shift) - y
    touched_above = False
    touched_below = False
    while True:
        r = -1 - row if mirror_y else row
        c = -1 - col if mirror_x else col
        if is_opaque(opaque, window, corner_row, corner_col, r, c):
            return False
        order = to_x * dy - to_y * dx
        if (order <= 0 and to_x >= dx) or (order > 0 and to_y >= dy):
            return True
        if order == 0:
            # Through a corner: the two cells beside it are touched.
            above = -1 - (row + 1) if mirror_y else row + 1
            beside = -1 - (col + 1) if mirror_x else col + 1
            if is_opaque(opaque, window, corner_row, corner_col, above, c):
                touched_above = True
            if is_opaque(opaque, window, corner_row, corner_col, r, beside):
                touched_below = True
            if touched_above and touched_below:
                return False
        if order <= 0:
            col += 1
            to_x += unit
        if order >= 0:
            row += 1
            to_y += unit


@njit(cache=True, nogil=True)
def in_cone(mode, cone, dx, dy):
    """Whether (dx, dy) satisfies both (mode 1) or one (mode 2) of two forms a·dx + b·dy ≥ 0; (4,)."""
    if mode == 0:
        return True
    first = cone[0] * dx + cone[1] * dy >= 0
    second = cone[2] * dx + cone[3] * dy >= 0
    if mode == 1:
        return first and second
    return first or second


@njit(cache=True, nogil=True)
def _spread(filled, allowed):
    """Fill what is connected to ``filled`` by cell sides within ``allowed``; both (w, w)."""
    size = filled.shape[0]
    grows = True
    while grows:
        grows = False
        for r in range(size):
            for c in range(size):
                if filled[r, c] or not allowed[r, c]:
                    continue
                if (
                    (r > 0 and filled[r - 1, c])
                    or (r + 1 < size and filled[r + 1, c])
                    or (c > 0 and filled[r, c - 1])
                    or (c + 1 < size and filled[r, c + 1])
                ):
                    filled[r, c] = True
                    grows = True


@njit(cache=True, nogil=True)
def make_pocket(opaque, free, shift, lx, ly, normal_x, normal_y, tolerance, window):
    """Fill the window (w, w), w odd, of a landmark at (lx, ly); NO_WALL, POCKET (it is needed) or BURIED.

    Opaque cells within ``tolerance`` units become transparent. Transparent cells that can be reached from the
    landmark's side of the wall only by a detour, and go on to the border of the window, become opaque: what
    lies behind the wall stays hidden. Its side are the transparent cells within the tolerance that are
    connected there, side by side, to its own cell; no detour is a way through cell sides that never turns
    back in row or column, as along every line of sight. Its own cell is the nearest transparent one within
    the tolerance; those on the side of the normal (0, 0: none) come first, then free ones.
    """
    size = window.shape[0]
    corner_row = (ly >> shift) - size // 2
    corner_col = (lx >> shift) - size // 2
    limit = tolerance * tolerance
    half = (1 << shift) // 2
    near = np.zeros((size, size), dtype=np.bool_)
    allowed = np.zeros((size, size), dtype=np.bool_)
    behind = np.zeros((size, size), dtype=np.bool_)
    wall_near = False
    own = -1
    own_class = 4
    own_distance = limit
    own_centre = limit
    for r in range(size):
        for c in range(size):
            row = corner_row + r
            col = corner_col + c
            x0 = (col << shift) - lx
            y0 = (row << shift) - ly
            dx = max(x0, 0, -x0 - 2 * half)
            dy = max(y0, 0, -y0 - 2 * half)
            distance = dx * dx + dy * dy
            on_grid = 0 <= row < opaque.shape[0] and 0 <= col < opaque.shape[1]
            blocked = on_grid and opaque[row, col]
            window[r, c] = blocked
            near[r, c] = distance <= limit
            if distance > limit:
                continue
            if blocked:
                wall_near = True
                continue
            cx = x0 + half
            cy = y0 + half
            kind = 0 if on_grid and free[row, col] else 1
            if (normal_x != 0.0 or normal_y != 0.0) and cx * normal_x + cy * normal_y <= 0.0:
                kind += 2
            centre = cx * cx + cy * cy
            if (
                kind < own_class
                or (kind == own_class and distance < own_distance)
                or (kind == own_class and distance == own_distance and centre < own_centre)
            ):
                own = r * size + c
                own_class = kind
                own_distance = distance
                own_centre = centre
    if not wall_near:
        return NO_WALL
    if own < 0:
        return BURIED
    # The landmark's side within the tolerance.
    reached = np.zeros((5, size, size), dtype=np.bool_)
    reached[4, own // size, own % size] = True
    for r in range(size):
        for c in range(size):
            allowed[r, c] = near[r, c] and not window[r, c]
    _spread(reached[4], allowed)
    # From there by steps in two directions only, for each of the four pairs of directions.
    for quadrant in range(4):
        dr = 1 if quadrant < 2 else -1
        dc = 1 if quadrant % 2 == 0 else -1
        for i in range(size):
            r = i if dr > 0 else size - 1 - i
            for j in range(size):
                c = j if dc > 0 else size - 1 - j
                if window[r, c]:
                    continue
                reached[quadrant, r, c] = (
                    reached[4, r, c]
                    or (i > 0 and reached[quadrant, r - dr, c])
                    or (j > 0 and reached[quadrant, r, c - dc])
                )
    # The rest is behind the wall where it goes on beyond the window, else a notch; the cell that the landmark
    # stands in never closes.
    for r in range(size):
        for c in range(size):
            x0 = ((corner_col + c) << shift) - lx
            y0 = ((corner_row + r) << shift) - ly
            inside = -2 * half < x0 < 0 and -2 * half < y0 < 0
            seen = reached[0, r, c] or reached[1, r, c] or reached[2, r, c] or reached[3, r, c]
            allowed[r, c] = not (window[r, c] or seen or inside)
            at_border = min(r, c) == 0 or max(r, c) == size - 1
            behind[r, c] = allowed[r, c] and at_border
    _spread(behind, allowed)
    for r in range(size):
        for c in range(size):
            window[r, c] = (window[r, c] and not near[r, c]) or behind[r, c]
    return POCKET


@njit(cache=True, nogil=True)
def make_pockets(opaque, free, shift, landmarks, normals, tolerance, windows, states):
    """:func:`make_pocket` for N landmarks; (n_rows, n_cols) twice, (N, 2), (N, 2), out (N, w, w), (N,)."""
    for i in range(landmarks.shape[0]):
        states[i] = make_pocket(
            opaque,
            free,
            shift,
            landmarks[i, 0],
            landmarks[i, 1],
            normals[i, 0],
            normals[i, 1],
            tolerance,
            windows[i],
        )


@njit(cache=True, nogil=True)
def see_points(
    opaque, windows, states, shift, landmarks, landmarks_m, modes, cones, points, points_m, low2, high2, out
):
    """Whether P points see N landmarks, by one exact ray each; out (P, N).

    Lattice positions (N, 2), (P, 2) and unsnapped ones in metres (N, 2), (P, 2); windows (N, w, w); cones
    (N, 4); squared ranges in m². A window is used where the state (N,) is POCKET.
    """
    size = windows.shape[1]
    for p in range(points.shape[0]):
        px = points[p, 0]
        py = points[p, 1]
        for i in range(landmarks.shape[0]):
            out[p, i] = False
            dx_m = points_m[p, 0] - landmarks_m[i, 0]
            dy_m = points_m[p, 1] - landmarks_m[i, 1]
            distance2 = dx_m * dx_m + dy_m * dy_m
            if states[i] == BURIED or distance2 < low2 or distance2 > high2:
                continue
            lx = landmarks[i, 0]
            ly = landmarks[i, 1]
            if not in_cone(modes[i], cones[i], px - lx, py - ly):
                continue
            row = (ly >> shift) - size // 2 if states[i] == POCKET else FAR
            col = (lx >> shift) - size // 2
            out[p, i] = clear_sight(opaque, windows[i], row, col, shift, lx, ly, px, py)
