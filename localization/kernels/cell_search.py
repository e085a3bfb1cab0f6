"""Best triplet of one cell: the search that suits its number and strength of landmarks."""

from __future__ import annotations

import numpy as np
from numba import njit

from localization.kernels.fix import CENTRED_FREE, FIXED, MODE, OMNIDIRECTIONAL
from localization.kernels.seen import in_view, inverted, strongest_first, visible_indices
from localization.kernels.spans import azimuth_key, ranked_by_span
from localization.kernels.triangles import largest_triangle
from localization.kernels.triplets import (
    is_degenerate,
    ranked_triplets,
    sorted_three,
    strong_pairs,
    triplet_value,
)

# State of the search: lengths of the orders and of the list of seeds, the newest of these, how many climbs
# are left before the exact search is tried again.
N_LAST, N_RING, N_KNOWN, NEWEST, CLIMBS = range(5)
# Rows of the work arrays: order, last, hull, seen, ring, place in the order; and the floats.
ORDER, LAST, HULL, SEEN, RING, AT = range(6)
GX, GY, RHO, AZIMUTH, SHARES, CX, CY, CRHO, KEY, STRENGTH, SCRATCH = range(11)
N_WORK = SCRATCH + 8

# Strong pairs per landmark from which the search by outer pairs is faster: constant, and per landmark.
_MANY = 2.0
_MANY_SHARE = 0.05
# Seeds that are tried; with few landmarks they do not pay.
_TRIED = 6
_SEEDED_FROM = 12
# Points near the hull from which their order is kept.
_SORTED_FROM = 20


@njit(cache=True, nogil=True)
def _holds(order, n, at, i):
    """Whether landmark i is among ``order`` (n,); ``at`` (N,) says where it would be, and may be stale."""
    return 0 <= at[i] < n and order[at[i]] == i


@njit(cache=True, nogil=True)
def remember(best, seeds, state):
    """Keep a triplet that was best somewhere."""
    newest = state[NEWEST]
    for a in range(state[N_KNOWN]):
        if seeds[a, 0] == best[0] and seeds[a, 1] == best[1] and seeds[a, 2] == best[2]:
            return
    newest = (newest + 1) % seeds.shape[0]
    state[NEWEST] = newest
    state[N_KNOWN] = min(state[N_KNOWN] + 1, seeds.shape[0])
    seeds[newest] = best


@njit(cache=True, nogil=True)
def remember_sorted(triplet, seeds, state):
    """Keep a triplet in any order, which is ascending afterwards."""
    triplet[0], triplet[1], triplet[2] = sorted_three(triplet[0], triplet[1], triplet[2])
    remember(triplet, seeds, state)


@njit(cache=True, nogil=True)
def _as_before(n, seen, last, n_last, at, mark, order):
    """Positions in ``seen`` (n,) in the order of the landmarks ``last`` (n_last,), then the others."""
    if n_last == 0:
        for a in range(n):
            order[a] = a
        return
    for a in range(n):
        at[seen[a]] = a
        mark[seen[a]] = 1
    m = 0
    for a in range(n_last):
        if mark[last[a]] == 1:
            order[m] = at[last[a]]
            mark[last[a]] = 0
            m += 1
    for a in range(n):
        if mark[seen[a]] == 1:
            order[m] = a
            mark[seen[a]] = 0
            m += 1


@njit(cache=True, nogil=True)
def search_cell(
    x, y, words, landmarks, survey, sensor, hull_only, work, orders, mark, seeds, state, quick, best
):
    """Best triplet seen from (x, y) into ``best`` (3,), -1 without; number of landmarks in view.

    ``quick``: not by outer pairs; then -1 is returned and ``best`` is as it was.
    """
    pinhole = sensor[MODE] != OMNIDIRECTIONAL
    needs_azimuth = pinhole and sensor[MODE] != CENTRED_FREE and sensor[MODE] != FIXED
    seen = orders[SEEN]
    order = orders[ORDER]
    strength = work[STRENGTH]
    gx = work[GX]
    gy = work[GY]
    rho = work[RHO]
    n = in_view(x, y, visible_indices(words, seen), seen, landmarks, sensor)
    if n < 3:
        best[:] = -1
        return n
    for a in range(n):
        i = seen[a]
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        r2 = dx * dx + dy * dy
        strength[i] = 1.0 / r2
        gx[a] = dx / r2
        gy[a] = dy / r2
    if hull_only:
        _as_before(n, seen, orders[LAST], state[N_LAST], orders[AT], mark, order)
        d, m = largest_triangle(n, gx, gy, order, orders[HULL], best)
        state[N_LAST] = m if m > _SORTED_FROM else 0
        for a in range(state[N_LAST]):
            orders[LAST, a] = seen[order[a]]
        if best[0] >= 0:
            for c in range(3):
                best[c] = seen[best[c]]
            if not is_degenerate(d, strength[best[0]] + strength[best[1]] + strength[best[2]]):
                return n
    last = orders[LAST]
    at = orders[AT]
    azimuth = work[AZIMUTH]
    shares = work[SHARES]
    strongest_first(n, seen, strength, last, state[N_LAST], mark, order)
    for a in range(n):
        last[a] = order[a]
        at[order[a]] = a
    state[N_LAST] = n
    inverted(x, y, n, order, landmarks, survey, sensor, needs_azimuth, gx, gy, rho, azimuth, shares)
    # Triplets that were best nearby tell how good the best is at least.
    known = 0.0
    tried = 0
    newest = state[NEWEST]
    for back in range(state[N_KNOWN] if n >= _SEEDED_FROM else 0):
        a = (newest - back) % seeds.shape[0]
        s0 = seeds[a, 0]
        s1 = seeds[a, 1]
        s2 = seeds[a, 2]
        if _holds(order, n, at, s0) and _holds(order, n, at, s1) and _holds(order, n, at, s2):
            # In the order of the search, so that both compute the same number.
            a0, a1, a2 = sorted_three(at[s0], at[s1], at[s2])
            known = max(known, triplet_value(a0, a1, a2, gx, gy, rho, azimuth, shares, sensor))
            tried += 1
            if tried == _TRIED:
                break
    by_pairs = known == 0.0 or not pinhole
    if not by_pairs:
        strong = strong_pairs(n, rho, shares, sensor, known)
        by_pairs = strong <= n * (_MANY + _MANY_SHARE * n)
    if quick and not by_pairs:
        return -1
    values = np.empty(1)
    triplets = np.empty((1, 3), dtype=np.int64)
    hull = orders[HULL]
    if by_pairs:
        found = ranked_triplets(
            n, order, gx, gy, rho, azimuth, shares, sensor, known, work[CX], work[CY], work[CRHO], hull,
            values, triplets,
        )  # fmt: skip
    else:
        key = work[KEY]
        for a in range(n):
            key[order[a]] = -azimuth_key(gx[a], gy[a])
        strongest_first(n, seen, key, orders[RING], state[N_RING], mark, hull)
        state[N_RING] = n
        for a in range(n):
            orders[RING, a] = hull[a]
            hull[a] = at[hull[a]]
        s = SCRATCH
        found = ranked_by_span(
            n, order, gx, gy, rho, azimuth, shares, sensor, known, hull, work[s], work[s + 1], work[s + 2],
            work[s + 3], work[s + 4], work[s + 5], work[s + 6], work[s + 7], values, triplets,
        )  # fmt: skip
    best[:] = triplets[0]
    if found > 0:
        remember(best, seeds, state)
    return n
