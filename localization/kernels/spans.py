"""Best triplet in a field of view by its two outer landmarks: for places where many are nearly equal.

Along walls and rows all landmarks are about as strong, and pairs of strong ones (``kernels.triplets``)
bound little. The outer pair of a triplet bounds more: it fixes the span, and the middle landmark lies
between, no nearer and no farther than those that do.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import CENTRED_FREE, COS_VIEW, FIT_TOLERANCE, FIXED, MODE, ON_AXIS, VIEW
from localization.kernels.triplets import SLACK, loosening, offer, sorted_three, triplet_value

# Share of ρ² that rounding may add to twice an area.
_ROUNDING = 1e-14


@njit(cache=True, nogil=True)
def azimuth_key(x, y):
    """Number in [-2, 2] that rises with the azimuth of (x, y), without trigonometry."""
    t = y / (abs(x) + abs(y))
    if x >= 0.0:
        return t
    return 2.0 - t if t >= 0.0 else -2.0 - t


@njit(cache=True, nogil=True)
def _margins(lo, first, count, x, y, rho, r, s, near, far, bar, least, terms, out):
    """By how much the bounds of pairs (lo, first … first + count - 1) exceed what is needed, into ``out``.

    Unsigned indices and no branches: the compiler makes it several pairs at a time.
    """
    xl = x[lo]
    yl = y[lo]
    rl = rho[lo]
    inv = r[lo]
    sl = s[lo]
    a0 = terms[0]
    a1 = terms[1]
    a2 = terms[2]
    on_axis = terms[3]
    f0 = terms[4]
    f1 = terms[5]
    base = np.uint64(first)
    for step in range(count):
        i = base + np.uint64(step)
        off = xl * y[i] - yl * x[i]
        dot = xl * x[i] + yl * y[i]
        ex = x[i] - xl
        ey = y[i] - yl
        scale = inv * r[i]
        # Product of the cosines off the axis, at the worst axis for this span.
        p = 0.5 * (a0 + scale * (a1 * dot + a2 * off))
        p = on_axis * p * p
        f = f0 + f1 * p
        sh = s[i]
        need = math.sqrt(bar * (p * p + f * (sl + sh) + sl * sh + (f + least) * (2.0 * p + sl + sh)))
        rh = rho[i]
        big = rl if rl > rh else rh
        tiny = _ROUNDING * big * big
        beyond = need + off - tiny
        # The middle one sticks out of the chord by at most near·|e| - off, or stays off·(1 - far/big) inside.
        out_side = near[i] * near[i] * (ex * ex + ey * ey) - beyond * beyond
        in_side = off * (big - far[i]) - (need - tiny) * big
        out[i] = out_side if out_side > in_side else in_side


@njit(cache=True, nogil=True)
def ranked_by_span(
    n, index, gx, gy, rho, azimuth, survey, sensor, known, ring, x, y, r, p, s, near, far, margin,
    values, triplets,
):  # fmt: skip
    """As ``ranked_triplets``, for pinholes; ``ring`` (n,) lists positions in these arrays by azimuth.

    ``x`` to ``margin`` (2 n,) are scratch.
    """
    size = values.shape[0]
    found = 0
    values[:] = -1.0
    triplets[:] = -1
    view = sensor[VIEW]
    cos_view = sensor[COS_VIEW] - FIT_TOLERANCE
    terms = np.zeros(6)
    terms[3] = sensor[ON_AXIS]
    if sensor[MODE] == CENTRED_FREE:
        terms[0] = 1.0
        terms[1] = 1.0
        terms[5] = 1.0
    elif sensor[MODE] != FIXED:  # there the shares hold the whole variance
        terms[1] = 1.0 + math.cos(view)
        terms[2] = math.sin(view)
        terms[4] = sensor[ON_AXIS] * math.cos(0.5 * view) ** 4
    least = np.inf
    for a in range(n):
        i = ring[a]
        least = min(least, survey[i])
        for b in (a, a + n):
            x[b] = gx[i]
            y[b] = gy[i]
            p[b] = rho[i]
            r[b] = 1.0 / rho[i]
            s[b] = survey[i]
    strongest = 0.0
    for a in range(n):
        strongest = max(strongest, p[a])
    loose = loosening(strongest, sensor) * (1.0 - SLACK)
    bar = known * loose
    last = 1
    for lo in range(n):
        xl = x[lo]
        yl = y[lo]
        # The window of one landmark ends no earlier than that of the one before.
        last = max(last, lo + 1)
        while last < lo + n:
            both = p[lo] * p[last]
            if xl * x[last] + yl * y[last] < cos_view * both or xl * y[last] - yl * x[last] < -1e-9 * both:
                break
            last += 1
        if last < lo + 3:
            continue
        nearest = p[lo + 1]
        farthest = nearest
        for hi in range(lo + 2, last):
            near[hi] = nearest
            far[hi] = farthest
            nearest = max(nearest, p[hi])
            farthest = min(farthest, p[hi])
        _margins(lo, lo + 2, last - lo - 2, x, y, p, r, s, near, far, bar, least, terms, margin)
        for hi in range(lo + 2, last):
            if margin[hi] < 0.0:
                continue
            ex = x[hi] - xl
            ey = y[hi] - yl
            off = xl * y[hi] - yl * x[hi]
            dot = xl * x[hi] + yl * y[hi]
            scale = r[lo] * r[hi]
            c = 0.5 * (terms[0] + scale * (terms[1] * dot + terms[2] * off))
            c = sensor[ON_AXIS] * c * c
            f = terms[4] + terms[5] * c
            pair = c * c + f * (s[lo] + s[hi]) + s[lo] * s[hi] + (f + least) * (2.0 * c + s[lo] + s[hi])
            strongest = max(p[lo], p[hi], near[hi])
            tiny = _ROUNDING * strongest * strongest
            need = math.sqrt(bar * pair) - tiny
            for m in range(lo + 1, hi):
                d = ex * (y[m] - yl) - ey * (x[m] - xl)
                if abs(d) < need:
                    continue
                i, j, k = sorted_three(ring[lo], ring[m % n], ring[hi % n])
                value = triplet_value(i, j, k, gx, gy, rho, azimuth, survey, sensor)
                if value < bar or value < 0.0:
                    continue
                i, j, k = sorted_three(index[i], index[j], index[k])
                found = offer(value, i, j, k, values, triplets, found)
                if found == size and values[size - 1] * loose > bar:
                    bar = values[size - 1] * loose
                    need = math.sqrt(bar * pair) - tiny
    return found
