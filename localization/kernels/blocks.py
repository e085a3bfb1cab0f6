"""Triplets that can be best anywhere in a block of cells: found once, compared in every cell.

As a complex number, a landmark at ``d`` from the middle of the block has the inverse ``z = 1 / d``; from the
place ``δ`` away it is ``z / (1 - δ z)``. So a side of the triangle of inverted landmarks becomes exactly
``e_jk / ((1 - δ z_j) (1 - δ z_k))``, and with ``a, b`` the sides from corner m to the corners l and h

    D(δ) = Im[conj(a) b ω] / (|1 - δ z_m|² |1 - δ z_l| |1 - δ z_h|),  arg ω = arg(1 - δ z_l) - arg(1 - δ z_h).

With ``|log(1 - w) + w| ≤ |w|² / (2 - 2 |w|)`` every factor is linear in δ up to a small known rest. A triplet
is kept unless its value stays below a value that is known to be reached, everywhere in the block. Values that
are known are put as ``exp(level + slope · δ)``: what all landmarks gain on the way cancels out.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import (
    AREA,
    FIT_TOLERANCE,
    FIXED,
    FLOOR,
    HEADING,
    MAX_AXIS,
    MODE,
    OMNIDIRECTIONAL,
    ON_AXIS,
    VIEW,
)
from localization.kernels.triplets import loosening

#: Bounds are loosened by this share, far above their rounding.
SLACK = 1e-9
#: Largest |δ z|: nearer landmarks change too much within a block.
MOST_TURN = 0.3

# Rows of the work array, by azimuth and twice around: inverted landmark, 1/r, largest gain over the slope,
# rest of the linear form, least share of variance, least variance; then bounds of pairs and of triplets.
X, Y, P, GAIN, REST, SHARE, LEAST, NEAR, FAR, GAIN_MID, MARGIN, THIRD = range(12)
N_ROWS = 12


@njit(cache=True, nogil=True)
def _grown(x):
    """A number little above exp(x), x ≥ 0: the alternating series of exp(-x / 4) ends below it."""
    y = 0.25 * x
    y = 1.0 / (1.0 - y * (1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0 - y / 120.0)))))
    y *= y
    return y * y if x < 2.8 else np.inf


@njit(cache=True, nogil=True)
def place_landmarks(n, ring, x0, y0, hx, hy, slope_x, slope_y, landmarks, survey, sensor, w):
    """Landmarks ``ring`` (n,) as seen from a block's middle, into ``w`` (N_ROWS, 2 N); largest |δ z|.

    The block is ``|δx| ≤ hx, |δy| ≤ hy`` about (x0, y0).
    """
    h = math.hypot(hx, hy)
    mode = sensor[MODE]
    floor = sensor[FLOOR]
    strongest = 0.0
    if mode == OMNIDIRECTIONAL:
        least = sensor[ON_AXIS]
    else:
        least = sensor[ON_AXIS] * math.cos(0.5 * sensor[VIEW]) ** 4
    for a in range(n):
        i = ring[a]
        dx = landmarks[i, 0] - x0
        dy = landmarks[i, 1] - y0
        s = 1.0 / (dx * dx + dy * dy)
        rho = math.sqrt(s)
        strongest = max(strongest, rho)
        w[X, a] = dx * s
        w[Y, a] = dy * s
        w[P, a] = rho
        u = min(h * rho, 0.5)
        rest = u * u / (2.0 - 2.0 * u)
        w[REST, a] = rest
        w[GAIN, a] = _grown(hx * abs(dx * s - 0.125 * slope_x) + hy * abs(dy * s - 0.125 * slope_y) + rest)
        w[SHARE, a] = floor + survey[i] * s / ((1.0 + u) * (1.0 + u))
        w[LEAST, a] = least + w[SHARE, a]
    if mode == FIXED:
        for a in range(n):
            turned = hx * abs(w[Y, a]) + hy * abs(w[X, a]) + w[REST, a]
            c = (w[X, a] * math.cos(sensor[HEADING]) + w[Y, a] * math.sin(sensor[HEADING])) / w[P, a]
            c = max(c - turned, math.cos(0.5 * sensor[VIEW])) - FIT_TOLERANCE
            c *= c
            w[LEAST, a] = sensor[ON_AXIS] * c * c + w[SHARE, a]
    for row in range(LEAST + 1):
        for a in range(n):
            w[row, a + n] = w[row, a]
    return h * strongest


@njit(cache=True, nogil=True)
def known_share(turn, h, sensor):
    """Share by which known values are lowered before bounds are compared with them."""
    return loosening(turn / (h * (1.0 - turn)) if h > 0.0 else np.inf, sensor) * (1.0 - SLACK)


@njit(cache=True, nogil=True)
def third_margins(first, last, w, xi, yi, xj, yj, turned, need, most, sides, axis_need):
    """By how much the bounds of the triplets with two given and one of (first … last - 1) exceed ``need``.

    ``axis_need`` > 0: also by ``D² / N``, N the sum of squared sides times variances; of these ``sides`` (2)
    has the least for the side between the two and for the others. ``most`` is the gain of the two together.
    """
    ex = xj - xi
    ey = yj - yi
    e2 = ex * ex + ey * ey
    tiny = 1e-13 * (xi * xi + yi * yi + xj * xj + yj * yj)
    base = np.uint64(first)
    for step in range(last - first):
        k = base + np.uint64(step)
        ax = xi - w[X, k]
        ay = yi - w[Y, k]
        bx = xj - w[X, k]
        by = yj - w[Y, k]
        d = ax * by - ay * bx
        dot = ax * bx + ay * by
        gain = w[GAIN, k]
        d = (abs(d) + abs(dot) * turned + tiny) * gain * gain
        other = (ax * ax + ay * ay + bx * bx + by * by) / (gain * gain)
        # The gains of the two are in ``most``; either's alone is no larger.
        fits = d * d * most >= axis_need * (sides[0] * e2 + sides[1] * other) / most
        w[THIRD, k] = d - need if fits else -1.0


@njit(cache=True, nogil=True)
def _topped(d, kx, ky, rest_of_sides, hx, hy, slope_x, slope_y, v, pair, most, xs, ys, axes):
    """Largest value over the slope in the block, and its bound ``a exp(k · δ)``: value, a, k (2).

    From ``d exp(k · δ) ≥ D(δ)``; v (3), xs (3), ys (3) of the corners, least and most of their pair sum.
    """
    value = d * d / pair
    top = value * _grown(2.0 * (hx * abs(kx) + hy * abs(ky)))
    gx = 2.0 * kx
    gy = 2.0 * ky
    if axes != AREA:
        # 4 / trace² = 4 D⁴ / N², N = Σ v |opposite side|², and N is no less than its tangent in the exponent.
        a = v[0] * ((xs[2] - xs[1]) ** 2 + (ys[2] - ys[1]) ** 2)
        b = v[1] * ((xs[2] - xs[0]) ** 2 + (ys[2] - ys[0]) ** 2)
        c = v[2] * ((xs[1] - xs[0]) ** 2 + (ys[1] - ys[0]) ** 2)
        total = a + b + c
        mx = 2.0 * (a * (xs[1] + xs[2]) + b * (xs[0] + xs[2]) + c * (xs[0] + xs[1])) / total
        my = 2.0 * (a * (ys[1] + ys[2]) + b * (ys[0] + ys[2]) + c * (ys[0] + ys[1])) / total
        nx = 4.0 * kx + slope_x - 2.0 * mx
        ny = 4.0 * ky + slope_y - 2.0 * my
        root = d * d / total
        grown = _grown(2.0 * rest_of_sides)
        other = 4.0 * root * root * grown
        if axes == MAX_AXIS:
            # λ = trace / 2 (1 + √(1 - 4 det / trace²))
            tx = 2.0 * (kx - mx) + slope_x
            ty = 2.0 * (ky - my) + slope_y
            flat = 4.0 * most * (d / total) ** 2 * grown * _grown(hx * abs(tx) + hy * abs(ty))
            flat = 1.0 + math.sqrt(max(0.0, 1.0 - flat))
            other /= flat * flat
        other_top = other * _grown(hx * abs(nx) + hy * abs(ny))
        if other_top < top:
            return other_top, other, nx, ny
    return top, value, gx, gy


@njit(cache=True, nogil=True)
def bound(lo, m, hi, w, hx, hy, slope_x, slope_y, on_axis, cos_view, fixed, axes):
    """Largest value, over the slope, of a triplet in the block, and its least pair sum of variances.

    The first also as ``a exp(k · δ)``: value, pair sum, a, k (2). ``axes`` is the criterion.
    """
    xl = w[X, lo]
    yl = w[Y, lo]
    xm = w[X, m]
    ym = w[Y, m]
    xh = w[X, hi]
    yh = w[Y, hi]
    ex = xh - xl
    ey = yh - yl
    d = ex * (ym - yl) - ey * (xm - xl)
    dot = (xl - xm) * (xh - xm) + (yl - ym) * (yh - ym)
    outer_rest = w[REST, lo] + w[REST, hi]
    turned = hx * abs(ey) + hy * abs(ex) + outer_rest
    kx = 2.0 * xm + xl + xh - 0.5 * slope_x
    ky = 2.0 * ym + yl + yh - 0.5 * slope_y
    rest = 2.0 * w[REST, m] + outer_rest
    if abs(dot) * turned < abs(d):
        q = dot / d
        rest += abs(q) * (outer_rest + turned * turned * turned / 6.0)
        d = abs(d) * _grown(rest)
        kx += q * ey
        ky -= q * ex
    else:
        d = (abs(d) + abs(dot) * turned) * _grown(rest)
    if fixed:
        v1 = w[LEAST, lo]
        v2 = w[LEAST, m]
        v3 = w[LEAST, hi]
    else:
        rl = w[P, lo]
        rm = w[P, m]
        rh = w[P, hi]
        c13 = (xl * xh + yl * yh) / (rl * rh)
        ax = xm - xl
        ay = ym - yl
        bx = xh - xm
        by = yh - ym
        turned_a = hx * abs(ay) + hy * abs(ax) + w[REST, m] + w[REST, lo]
        turned_b = hx * abs(by) + hy * abs(bx) + w[REST, m] + w[REST, hi]
        if xl * ym - yl * xm > turned_a * rl * rm and xm * yh - ym * xh > turned_b * rm * rh:
            # The middle one stays in the middle.
            p = 0.5 * (1.0 + max(cos_view, c13 - turned))
            outer = on_axis * p * p
            inner = 0.5 * ((xl * xm + yl * ym) / rl + (xm * xh + ym * yh) / rh) / rm
            off = inner / math.sqrt(0.5 * (1.0 + c13))
            bx = xm - 0.5 * (xl + xh)
            by = ym - 0.5 * (yl + yh)
            off -= hx * abs(by) + hy * abs(bx) + w[REST, m] + 0.5 * outer_rest
            p = max(p, off * off) if off > 0.0 else p
            middle = on_axis * p * p
        else:
            p = 0.5 * (1.0 + max(cos_view, c13 - turned - turned_a - turned_b))
            outer = on_axis * p * p
            middle = outer
        v1 = outer + w[SHARE, lo]
        v2 = middle + w[SHARE, m]
        v3 = outer + w[SHARE, hi]
    pair = v1 * v2 + v3 * (v1 + v2)
    # Shares of variance grow by no more than (1 + u)² / (1 - u)², u ≤ MOST_TURN.
    share = 3.5 * max(w[SHARE, lo], w[SHARE, m], w[SHARE, hi])
    v = on_axis + share
    outer = v
    if not fixed:
        outer = 0.5 * (1.0 + min(1.0, (xl * xh + yl * yh) / (w[P, lo] * w[P, hi]) + turned))
        outer = on_axis * outer * outer + share
    most = outer * (outer + 2.0 * v) if not fixed else 3.0 * v * v
    rest = 2.0 * (w[REST, m] + outer_rest)
    top, value, kx, ky = _topped(
        d, kx, ky, rest, hx, hy, slope_x, slope_y, (v1, v2, v3), pair, most, (xl, xm, xh), (yl, ym, yh), axes
    )
    return top, pair, value, kx, ky
