"""Cells that see few landmarks: every triplet is looked at, which is faster there than any bound."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    COS_VIEW,
    CRITERION,
    FIT_TOLERANCE,
    FIXED,
    HEADING,
    MODE,
    ON_AXIS,
    TRACE,
    VIEW,
)
from localization.kernels.seen import TOUCH_M, visible_indices
from localization.kernels.spans import azimuth_key
from localization.kernels.triplets import is_degenerate, sorted_three

# Values nearer than this share are told apart by the other searches, which round all in one order.
_EQUAL = 1e-8
#: Most landmarks in view that are searched here: all around, by a camera that pans, by one that does not.
FEW_AROUND = 18
FEW_PANNED = 16
FEW_FIXED = 24
_ROOM = 24
# Whether there is a triplet, and whether another is as good.
_NONE, _ONE, _EQUALS = range(3)


@njit(cache=True, nogil=True)
def few_around(n, x, y, triplet):
    """Largest |D| of all triplets of inverted landmarks (n,), positions into ``triplet`` (3,)."""
    best = 0.0
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            ex = x[j] - x[i]
            ey = y[j] - y[i]
            c = ex * y[i] - ey * x[i]
            for k in range(j + 1, n):
                d = abs(ex * y[k] - ey * x[k] - c)
                if d > best:
                    best = d
                    triplet[0] = i
                    triplet[1] = j
                    triplet[2] = k
    return _ONE if best > 0.0 else _NONE


@njit(cache=True, nogil=True)
def _spread(px, py, qx, qy, ex, ey, v1, v2, v3, trace):
    """Half the trace, or the larger eigenvalue, of Σ D²: sides p, q, e opposite to corners 3, 1, 2."""
    xx = v3 * px * px + v1 * qx * qx + v2 * ex * ex
    yy = v3 * py * py + v1 * qy * qy + v2 * ey * ey
    half = 0.5 * (xx + yy)
    if trace:
        return half
    xy = v3 * px * py + v1 * qx * qy + v2 * ex * ey
    return half + math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)


@njit(cache=True, nogil=True)
def few_given(n, x, y, v, area, trace, triplet):
    """As ``few_around`` with variances v (n,): largest D² / pair sum, or D² / half trace or eigenvalue."""
    best = 0.0
    bar = 0.0
    equal = False
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            ex = x[j] - x[i]
            ey = y[j] - y[i]
            product = v[i] * v[j]
            both = v[i] + v[j]
            for k in range(j + 1, n):
                px = x[k] - x[i]
                py = y[k] - y[i]
                d = ex * py - ey * px
                d *= d
                if area:
                    size = product + both * v[k]
                else:
                    size = _spread(ex, ey, x[k] - x[j], y[k] - y[j], px, py, v[i], v[j], v[k], trace)
                if d > bar * size:
                    value = d / size
                    equal = value <= best * (1.0 + _EQUAL)
                    if value > best:
                        best = value
                        triplet[0] = i
                        triplet[1] = j
                        triplet[2] = k
                    bar = best * (1.0 - _EQUAL)
    if best == 0.0:
        return _NONE
    return _EQUALS if equal else _ONE


@njit(cache=True, nogil=True)
def few_panned(n, x, y, ux, uy, cos_view, area, trace, triplet):
    """As ``few_given`` for a camera that pans: arrays (2 n,) by azimuth, twice around; ``u`` of length 1."""
    best = 0.0
    bar = 0.0
    equal = False
    for a in range(n):
        for b in range(a + 1, a + n):
            cosine = ux[a] * ux[b] + uy[a] * uy[b]
            if cosine < cos_view or ux[a] * uy[b] - uy[a] * ux[b] < -1e-9:
                break
            if b == a + 1:
                continue
            # cos² off the axis, which is on the middle: p for the outer two, and (u · sum)² / 4 p.
            p = 0.5 * (1.0 + cosine)
            outer = p * p
            square = outer * outer
            sx = ux[a] + ux[b]
            sy = uy[a] + uy[b]
            inverse = 0.25 / p
            ex = x[b] - x[a]
            ey = y[b] - y[a]
            for m in range(a + 1, b):
                px = x[m] - x[a]
                py = y[m] - y[a]
                d = ex * py - ey * px
                d *= d
                c = ux[m] * sx + uy[m] * sy
                c *= c * inverse
                c *= c
                if area:
                    size = square + 2.0 * outer * c
                else:
                    size = _spread(px, py, x[b] - x[m], y[b] - y[m], ex, ey, outer, c, outer, trace)
                if d > bar * size:
                    value = d / size
                    equal = value <= best * (1.0 + _EQUAL)
                    if value > best:
                        best = value
                        triplet[0] = a
                        triplet[1] = m
                        triplet[2] = b
                    bar = best * (1.0 - _EQUAL)
    if best == 0.0:
        return _NONE
    return _EQUALS if equal else _ONE


@njit(cache=True, nogil=True)
def search_few(centres, free, masks, landmarks, sensor, out_triplet, out_n_visible, done):
    """Best triplet of every cell that sees few landmarks; for sensors without lever arm, shares and sectors.

    Cells that are left to the other searches stay as they are, and their number is returned; the others are
    marked in ``done`` (h, w).
    """
    h, w = free.shape
    left = 0
    mode = sensor[MODE]
    area = sensor[CRITERION] == AREA
    trace = sensor[CRITERION] == TRACE
    cos_view = sensor[COS_VIEW] - FIT_TOLERANCE
    half_view = math.cos(0.5 * sensor[VIEW]) - FIT_TOLERANCE
    ahead_x = math.cos(sensor[HEADING])
    ahead_y = math.sin(sensor[HEADING])
    few = FEW_FIXED if mode == FIXED else FEW_PANNED if mode == CENTRED_FREE else FEW_AROUND
    seen = np.empty(landmarks.shape[0] + 1, dtype=np.int64)
    x = np.empty(2 * _ROOM)
    y = np.empty(2 * _ROOM)
    ux = np.empty(2 * _ROOM)
    uy = np.empty(2 * _ROOM)
    v = np.empty(_ROOM)
    key = np.empty(_ROOM)
    triplet = np.zeros(3, dtype=np.int64)
    for row in range(h):
        for col in range(w):
            if not free[row, col]:
                continue
            left += 1
            n_seen = visible_indices(masks[row, col], seen)
            if mode != FIXED and n_seen > few:
                continue
            cx = centres[row, col, 0]
            cy = centres[row, col, 1]
            n = 0
            for a in range(n_seen):
                i = seen[a]
                dx = landmarks[i, 0] - cx
                dy = landmarks[i, 1] - cy
                r2 = dx * dx + dy * dy
                if r2 < TOUCH_M * TOUCH_M:
                    continue
                if mode == FIXED:
                    forward = dx * ahead_x + dy * ahead_y
                    if forward < 0.0 or forward < half_view * math.sqrt(r2):
                        continue
                    if n == few:
                        n += 1
                        break
                    c = forward * forward / r2
                    v[n] = sensor[ON_AXIS] * c * c
                    seen[n] = i
                    x[n] = dx / r2
                    y[n] = dy / r2
                elif mode == CENTRED_FREE:
                    # By azimuth.
                    at = azimuth_key(dx, dy)
                    b = n
                    while b > 0 and key[b - 1] > at:
                        key[b] = key[b - 1]
                        x[b] = x[b - 1]
                        y[b] = y[b - 1]
                        ux[b] = ux[b - 1]
                        uy[b] = uy[b - 1]
                        seen[b] = seen[b - 1]
                        b -= 1
                    s = 1.0 / r2
                    r = math.sqrt(s)
                    key[b] = at
                    x[b] = dx * s
                    y[b] = dy * s
                    ux[b] = dx * r
                    uy[b] = dy * r
                    seen[b] = i
                else:
                    if not area:
                        v[n] = sensor[ON_AXIS]
                    seen[n] = i
                    x[n] = dx / r2
                    y[n] = dy / r2
                n += 1
            if n > few:
                continue
            found = _NONE
            if n >= 3:
                if mode == CENTRED_FREE:
                    for a in range(n):
                        x[a + n] = x[a]
                        y[a + n] = y[a]
                        ux[a + n] = ux[a]
                        uy[a + n] = uy[a]
                    found = few_panned(n, x, y, ux, uy, cos_view, area, trace, triplet)
                elif mode == FIXED or not area:
                    found = few_given(n, x, y, v, area, trace, triplet)
                else:
                    found = few_around(n, x, y, triplet)
            if found == _EQUALS:
                continue
            if found == _NONE:
                out_n_visible[row, col] = n
                done[row, col] = True
                left -= 1
                continue
            a = triplet[0]
            b = triplet[1] if triplet[1] < n else triplet[1] - n
            c = triplet[2] if triplet[2] < n else triplet[2] - n
            d = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
            size = x[a] * x[a] + y[a] * y[a] + x[b] * x[b] + y[b] * y[b] + x[c] * x[c] + y[c] * y[c]
            if is_degenerate(d, 2.0 * size):
                # Near the limit the others decide.
                continue
            out_n_visible[row, col] = n
            done[row, col] = True
            left -= 1
            i, j, k = sorted_three(seen[a], seen[b], seen[c])
            out_triplet[row, col, 0] = i
            out_triplet[row, col, 1] = j
            out_triplet[row, col, 2] = k
    return left
