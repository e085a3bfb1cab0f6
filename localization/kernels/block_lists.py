"""Lists of the triplets that can be best in a block: by their outer two, or by their two strongest."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.blocks import (
    FAR,
    GAIN,
    GAIN_MID,
    LEAST,
    MARGIN,
    MOST_TURN,
    NEAR,
    REST,
    SHARE,
    SLACK,
    THIRD,
    P,
    X,
    Y,
    bound,
    known_share,
    third_margins,
)
from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    COS_VIEW,
    CRITERION,
    FIT_TOLERANCE,
    FIXED,
    LEVER,
    MODE,
    OMNIDIRECTIONAL,
    ON_AXIS,
    VIEW,
)

# Strong pairs per landmark from which the list by outer pairs is faster: constant, and per landmark.
_MANY = 2.0
_MANY_SHARE = 0.02


@njit(cache=True, nogil=True)
def _pair_margins(lo, first, last, w, hx, hy, h, bar, least, on_axis, cos_view, fixed, axes):
    """By how much the bound of the pairs (lo, first … last - 1) exceeds what is needed, into row MARGIN.

    Unsigned indices and no branches: the compiler makes it several pairs at a time.
    """
    xl = w[X, lo]
    yl = w[Y, lo]
    rl = w[P, lo]
    gl = w[GAIN, lo]
    restl = w[REST, lo]
    sl = w[SHARE, lo]
    vl = w[LEAST, lo]
    axis_need = 0.5 * math.sqrt(bar) * (1.0 - SLACK) if axes != AREA else 0.0
    base = np.uint64(first)
    for step in range(last - first):
        i = base + np.uint64(step)
        xh = w[X, i]
        yh = w[Y, i]
        rh = w[P, i]
        near = w[NEAR, i]
        far = w[FAR, i]
        off = xl * yh - yl * xh
        dot = xl * xh + yl * yh
        ex = xh - xl
        ey = yh - yl
        e2 = ex * ex + ey * ey
        turned = hx * abs(ey) + hy * abs(ex) + restl + w[REST, i]
        big = max(rl, rh)
        # Angles within the triplet change by no more than this.
        bend = 2.2 * h * max(big, near)
        both = rl * rh
        cosine = dot / both
        p = 0.5 * (1.0 + max(cos_view, cosine - bend))
        p = on_axis * p * p
        v1 = vl if fixed else p + sl
        v2 = w[LEAST, i] if fixed else p + w[SHARE, i]
        v3 = least if fixed else p + least
        mid = w[GAIN_MID, i]
        need = math.sqrt(bar * (v1 * v2 + v3 * (v1 + v2))) / (gl * w[GAIN, i] * mid * mid)
        # The middle one sticks out of the chord by at most near·|e| - off, or stays off·(1 - far/big) inside.
        d = max(near * math.sqrt(e2) - off, off * (1.0 - far / big))
        # Its sides to the outer two: their scalar product lies between -|e|²/4 and the value at an edge.
        edge = min(rl + dot / rl, rh + dot / rh)
        side = max(0.25 * e2, dot + max(near * (near - edge), far * (far - edge)))
        margin = d + side * turned + 1e-13 * big * big + 1e-13 * near * near - need
        # D² / N with N ≥ v3 |e|² + v1 (2 t² + |e|² / 2), t = D / |e| the height of the middle one.
        both = gl * w[GAIN, i]
        d = (d + side * turned) * both * mid * mid
        low = min(v1, v2)
        inverse = (v3 + 0.5 * low) * e2 / (both * both * d * d) + 2.0 * low / (e2 * both * both)
        fits = cosine >= cos_view - turned and axis_need * inverse <= 1.0
        w[MARGIN, i] = margin if fits else -1.0


@njit(cache=True, nogil=True)
def block_triplets(n, w, turn, hx, hy, slope_x, slope_y, level, sensor, found, sums, tops, limit):
    """Triplets whose value can reach ``exp(level + slope · δ)`` in the block; their number, or -1.

    Positions in ``w`` (see ``place_landmarks``, which gives ``turn``) modulo n go to ``found`` (3, C), the
    least pair sums of their variances to ``sums`` (C,), a bound of the log of
    the value over the slope to ``tops`` (3, C): constant, and gradient.
    -1: more than ``limit``, or the block is too wide.
    """
    fixed = sensor[MODE] == FIXED
    view = sensor[VIEW]
    if turn > MOST_TURN or view + 2.2 * turn > 3.0:
        return -1
    h = math.hypot(hx, hy)
    on_axis = sensor[ON_AXIS]
    cos_view = -2.0 if fixed else sensor[COS_VIEW] - FIT_TOLERANCE
    row = LEAST if fixed else SHARE
    least = np.inf
    for a in range(n):
        least = min(least, w[row, a])
    bar = math.exp(level) * known_share(turn, h, sensor)
    axes = sensor[CRITERION] if sensor[LEVER] == 0.0 else AREA
    axis_need = 0.5 * math.sqrt(bar) * (1.0 - SLACK) if axes != AREA else 0.0
    count = 0
    for lo in range(n):
        xl = w[X, lo]
        yl = w[Y, lo]
        rl = w[P, lo]
        widest = cos_view - 1.1 * (turn + h * rl)
        last = lo + 1
        near = 0.0
        far = np.inf
        gain = 0.0
        while last < lo + n:
            both = rl * w[P, last]
            if (
                xl * w[X, last] + yl * w[Y, last] < widest * both
                or xl * w[Y, last] - yl * w[X, last] < -1e-9 * both
            ):
                break
            w[NEAR, last] = near
            w[FAR, last] = far
            w[GAIN_MID, last] = gain
            near = max(near, w[P, last])
            far = min(far, w[P, last])
            gain = max(gain, w[GAIN, last])
            last += 1
        if last < lo + 3:
            continue
        _pair_margins(lo, lo + 2, last, w, hx, hy, h, bar, least, on_axis, cos_view, fixed, axes)
        for hi in range(lo + 2, last):
            if w[MARGIN, hi] < 0.0:
                continue
            ex = w[X, hi] - xl
            ey = w[Y, hi] - yl
            turned = hx * abs(ey) + hy * abs(ex) + w[REST, lo] + w[REST, hi]
            if fixed:
                v1 = w[LEAST, lo]
                v2 = w[LEAST, hi]
                v3 = least
            else:
                bend = 2.2 * h * max(rl, w[P, hi], w[NEAR, hi])
                p = 0.5 * (1.0 + max(cos_view, (xl * w[X, hi] + yl * w[Y, hi]) / (rl * w[P, hi]) - bend))
                p = on_axis * p * p
                v1 = p + w[SHARE, lo]
                v2 = p + w[SHARE, hi]
                v3 = p + least
            need = math.sqrt(bar * (v1 * v2 + v3 * (v1 + v2))) / (w[GAIN, lo] * w[GAIN, hi])
            gain = w[GAIN, lo] * w[GAIN, hi]
            third_margins(
                lo + 1, hi, w, xl, yl, w[X, hi], w[Y, hi], turned, need * (1.0 - SLACK), gain,
                (v3, min(v1, v2)), axis_need,
            )  # fmt: skip
            for m in range(lo + 1, hi):
                if w[THIRD, m] < 0.0:
                    continue
                top, pair, value, kx, ky = bound(
                    lo, m, hi, w, hx, hy, slope_x, slope_y, on_axis, cos_view, fixed, axes
                )
                if top < bar:
                    continue
                if count == limit:
                    return -1
                found[0, count] = lo
                found[1, count] = m % n
                found[2, count] = hi % n
                sums[count] = pair
                tops[0, count] = math.log(value)
                tops[1, count] = kx
                tops[2, count] = ky
                count += 1
    return count


@njit(cache=True, nogil=True)
def _by_azimuth(i, j, k, w):
    """Three positions that lie within a half turn, counter-clockwise."""
    if w[X, i] * w[Y, j] < w[Y, i] * w[X, j]:
        i, j = j, i
    if w[X, j] * w[Y, k] < w[Y, j] * w[X, k]:
        j, k = k, j
    if w[X, i] * w[Y, j] < w[Y, i] * w[X, j]:
        i, j = j, i
    return i, j, k


@njit(cache=True, nogil=True)
def _strong_need(n, w, hx, hy, slope_x, slope_y, level, turn, sensor):
    """What the product of a triplet's two largest 1/r must reach; bar of values; least variance."""
    mode = sensor[MODE]
    reach = 1.5 * math.sqrt(3.0) if mode == OMNIDIRECTIONAL else 2.0 * math.sin(0.5 * sensor[VIEW])
    least = np.inf
    for a in range(n):
        least = min(least, w[LEAST, a])
    bar = math.exp(level) * known_share(turn, math.hypot(hx, hy), sensor)
    # What a pair of the strongest can gain over the slope, whichever it is.
    ahead = math.exp(0.5 * (hx * abs(slope_x) + hy * abs(slope_y)))
    return math.sqrt(3.0 * bar) * least / (reach * ahead), bar, least


@njit(cache=True, nogil=True)
def few_are_strong(n, w, hx, hy, slope_x, slope_y, level, turn, sensor):
    """Whether ``strong_block_triplets`` is the faster of the two listings."""
    h = math.hypot(hx, hy)
    lowest, _, _ = _strong_need(n, w, hx, hy, slope_x, slope_y, level, turn, sensor)
    most = n * (_MANY + _MANY_SHARE * n)
    count = 0
    j = n - 1
    for i in range(n - 1):
        top = w[P, i] / (1.0 - h * w[P, i])
        while j > i and top * w[P, j] < lowest * (1.0 - h * w[P, j]):
            j -= 1
        if j <= i:
            break
        count += j - i
        if count > most:
            return False
    return True


@njit(cache=True, nogil=True)
def strong_block_triplets(n, w, turn, hx, hy, slope_x, slope_y, level, sensor, found, sums, tops, limit):
    """As ``block_triplets`` by the two strongest of a triplet, all around too; ``w`` by falling strength.

    The gains in ``w`` are over no slope.
    """
    mode = sensor[MODE]
    view = sensor[VIEW]
    fixed = mode != CENTRED_FREE
    axes = sensor[CRITERION] if sensor[LEVER] == 0.0 else AREA
    if turn > MOST_TURN or (mode != OMNIDIRECTIONAL and view + 2.2 * turn > 3.0):
        return -1
    h = math.hypot(hx, hy)
    on_axis = sensor[ON_AXIS]
    cos_view = -2.0 if fixed else sensor[COS_VIEW] - FIT_TOLERANCE
    lowest, bar, least = _strong_need(n, w, hx, hy, slope_x, slope_y, level, turn, sensor)
    count = 0
    for i in range(n - 2):
        xi = w[X, i]
        yi = w[Y, i]
        ri = w[P, i]
        top = ri / (1.0 - h * ri)
        if top * top < lowest:
            break
        for j in range(i + 1, n - 1):
            xj = w[X, j]
            yj = w[Y, j]
            rj = w[P, j]
            if top * rj < lowest * (1.0 - h * rj):
                break
            ex = xj - xi
            ey = yj - yi
            turned = hx * abs(ey) + hy * abs(ex) + w[REST, i] + w[REST, j]
            if xi * xj + yi * yj < (cos_view - turned) * ri * rj:
                continue
            v1 = w[LEAST, i]
            v2 = w[LEAST, j]
            need = math.sqrt(bar * (v1 * v2 + least * (v1 + v2))) / math.exp(
                hx * abs(xi + xj - 0.5 * slope_x)
                + hy * abs(yi + yj - 0.5 * slope_y)
                + w[REST, i]
                + w[REST, j]
            )
            # With the third so far that it stands for the origin, and what its nearness can add.
            off = abs(xi * yj - yi * xj) + ri * rj * turned
            side = math.sqrt(ex * ex + ey * ey)
            last = n
            if off < need:
                enough = (need - off) * (1.0 - SLACK)
                first = j + 1
                while first < last:
                    k = (first + last) >> 1
                    if w[P, k] * side < enough * (1.0 - h * w[P, k]):
                        last = k
                    else:
                        first = k + 1
            need *= 1.0 - SLACK
            third_margins(j + 1, last, w, xi, yi, xj, yj, turned, need, 1.0, (0.0, 0.0), 0.0)
            for k in range(j + 1, last):
                if w[THIRD, k] < 0.0:
                    continue
                a, b, c = i, j, k
                if not fixed:
                    a, b, c = _by_azimuth(i, j, k, w)
                    outer = h * (w[P, a] + w[P, c]) + w[REST, a] + w[REST, c]
                    both = w[P, a] * w[P, c]
                    if w[X, a] * w[X, c] + w[Y, a] * w[Y, c] < (cos_view - outer) * both:
                        continue
                top, pair, value, kx, ky = bound(
                    a, b, c, w, hx, hy, slope_x, slope_y, on_axis, cos_view, fixed, axes
                )
                if top < bar:
                    continue
                if count == limit:
                    return -1
                found[0, count] = a
                found[1, count] = b
                found[2, count] = c
                sums[count] = pair
                tops[0, count] = math.log(value)
                tops[1, count] = kx
                tops[2, count] = ky
                count += 1
    return count
