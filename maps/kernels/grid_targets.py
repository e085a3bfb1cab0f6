"""Stretches of one line of targets within a sector, a viewing cone and two ranges of a landmark.

Targets stand on evenly rising places: ``tx`` (n,) on the lattice of ``grid_visibility``, ``gx`` (n,) in
metres; ``inverse`` is (n - 1) / (tx[-1] - tx[0]) or 0. The landmark stands at ``lx`` or ``mx`` and the line
``y`` > 0 units above it. Bounds are compared in whole numbers, distances in metres.
"""

from __future__ import annotations

import math

from numba import njit

# Slopes at the start of a sweep reach a little beyond the sector and the cone, so that what touches a line of
# sight on its outer side is known.
SCALE = 1 << 20
_REACH = SCALE + SCALE // 64
_MARGIN = 1e-3


@njit(cache=True, nogil=True)
def first_beyond(tx, inverse, lx, num, den, y, more):
    """First j with (tx[j] - lx) · den ≥ num · y + more, or len(tx); tx (n,) rises evenly, den > 0."""
    guess = (lx + float(num) * float(y) / float(den) - tx[0]) * inverse
    n = tx.shape[0]
    j = int(min(max(guess, 0.0), float(n)))
    need = num * y + more
    while j > 0 and (tx[j - 1] - lx) * den >= need:
        j -= 1
    while j < n and (tx[j] - lx) * den < need:
        j += 1
    return j


@njit(cache=True, nogil=True)
def _clip(tx, inverse, lx, y, a, b, j0, j1):
    """Part of j0 … j1 with a · (tx[j] - lx) + b · y ≥ 0; empty when j0 > j1."""
    if a > 0:
        return max(j0, first_beyond(tx, inverse, lx, -b, a, y, 0)), j1
    if a < 0:
        return j0, min(j1, first_beyond(tx, inverse, lx, b, -a, y, 1) - 1)
    if b >= 0:
        return j0, j1
    return j0, j0 - 1


@njit(cache=True, nogil=True)
def _chord(gx, mx, dy2, limit2, inclusive, j0, j1):
    """Part of j0 … j1 within a distance of the landmark, (gx[j] - mx)² + dy2 ≤ or < limit2; gx (n,), m."""
    n = gx.shape[0]
    reach = math.sqrt(max(limit2 - dy2, 0.0))
    inverse = (n - 1) / (gx[n - 1] - gx[0]) if n > 1 else 0.0
    j = int(min(max((mx - reach - gx[0]) * inverse, float(j0)), float(j1 + 1)))
    while j > j0:
        d = gx[j - 1] - mx
        if d * d + dy2 < limit2 or (inclusive and d * d + dy2 == limit2):
            j -= 1
        else:
            break
    while j <= j1 and gx[j] < mx:
        d = gx[j] - mx
        if d * d + dy2 < limit2 or (inclusive and d * d + dy2 == limit2):
            break
        j += 1
    k = int(min(max((mx + reach - gx[0]) * inverse, float(j - 1)), float(j1)))
    while k < j1:
        d = gx[k + 1] - mx
        if d * d + dy2 < limit2 or (inclusive and d * d + dy2 == limit2):
            k += 1
        else:
            break
    while k >= j and gx[k] >= mx:
        d = gx[k] - mx
        if d * d + dy2 < limit2 or (inclusive and d * d + dy2 == limit2):
            break
        k -= 1
    return j, k


@njit(cache=True, nogil=True)
def allowed_stretches(pieces, tx, inverse, lx, y, gx, mx, dy2, low2, high2, mode, a1, b1, a2, b2, strict):
    """Stretches of a target line within sector, cone and ranges; pieces (4, 2) first, last; their number."""
    j0 = first_beyond(tx, inverse, lx, -y, 1, 1, strict)
    j1 = first_beyond(tx, inverse, lx, y, 1, 1, 1 - strict) - 1
    if high2 < math.inf and j0 <= j1:
        j0, j1 = _chord(gx, mx, dy2, high2, True, j0, j1)
    if mode == 1:
        j0, j1 = _clip(tx, inverse, lx, y, a1, b1, j0, j1)
        j0, j1 = _clip(tx, inverse, lx, y, a2, b2, j0, j1)
    n = 1
    pieces[0, 0] = j0
    pieces[0, 1] = j1
    if mode == 2:
        k0, k1 = _clip(tx, inverse, lx, y, a1, b1, j0, j1)
        pieces[0, 0] = k0
        pieces[0, 1] = k1
        if k0 > k1:
            k0 = j0
            k1 = j0 - 1
        # What the first form leaves is one stretch, before or behind its own.
        if k0 > j0:
            j1 = k0 - 1
        else:
            j0 = k1 + 1
        j0, j1 = _clip(tx, inverse, lx, y, a2, b2, j0, j1)
        pieces[1, 0] = j0
        pieces[1, 1] = j1
        n = 2
    if low2 > dy2:
        for t in range(n):
            j0 = pieces[t, 0]
            j1 = pieces[t, 1]
            pieces[n + t, 0] = 0
            pieces[n + t, 1] = -1
            if j0 <= j1:
                k0, k1 = _chord(gx, mx, dy2, low2, False, j0, j1)
                if k0 <= k1:
                    pieces[t, 1] = k0 - 1
                    pieces[n + t, 0] = k1 + 1
                    pieces[n + t, 1] = j1
        n *= 2
    return n


@njit(cache=True, nogil=True)
def start_slopes(mode, a1, b1, a2, b2):
    """Slopes at which a sweep starts, in units of 1 / SCALE; none when the first is not lower."""
    low = -_REACH
    high = _REACH
    if mode == 1:
        for a, b in ((a1, b1), (a2, b2)):
            if a > 0:
                bound = min(max(-float(b) / float(a), -4.0), 4.0)
                low = max(low, math.floor((bound - _MARGIN) * SCALE))
            elif a < 0:
                bound = min(max(-float(b) / float(a), -4.0), 4.0)
                high = min(high, math.ceil((bound + _MARGIN) * SCALE))
            elif b < 0:
                return 0, 0
    return low, high
