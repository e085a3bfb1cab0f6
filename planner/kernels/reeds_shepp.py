"""Shortest curves of bounded curvature that may go backwards, for radius 1: the 48 words of [RS90].

A word is up to five pieces; ``out`` (5, 2) has their signed lengths (negative: backwards) and turns
(1 left, 0 straight, -1 right), ended by lengths of 0. Every family below is a formula of [RS90, section 8]
for "forwards, left first"; the others follow by flipping time, by reflecting and by going the way back.
"""

from __future__ import annotations

import math

from numba import njit

# Signs are judged up to rounding.
_ZERO = 1e-10
_HALF = 0.5 * math.pi
# Families: CSC (two), CCC, CCCC (two), CCSC (two), CCSCC; those from 8 on are families of the way back.
N_FAMILIES = 11


@njit(cache=True, nogil=True)
def _wrapped(angle):
    """The angle in (-π, π]."""
    a = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
    return a - 2.0 * math.pi if a > math.pi else a


@njit(cache=True, nogil=True)
def _tau_omega(u, v, xi, eta, phi):
    """First and last angle of a CCCC word."""
    delta = _wrapped(u - v)
    a = math.sin(u) - math.sin(delta)
    b = math.cos(u) - math.cos(delta) - 1.0
    t1 = math.atan2(eta * a - xi * b, xi * a + eta * b)
    t2 = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0
    tau = _wrapped(t1 + math.pi) if t2 < 0.0 else _wrapped(t1)
    return tau, _wrapped(tau - u + v - phi)


@njit(cache=True, nogil=True)
def _solve(family, x, y, phi):
    """Whether a family reaches (x, y, phi) from (0, 0, 0), and its angles t, u, v."""
    s = math.sin(phi)
    c = math.cos(phi)
    # Centre of the last circle as seen from that of the first: for a last turn left, and right.
    xl = x - s
    yl = y - 1.0 + c
    xr = x + s
    yr = y - 1.0 - c
    if family == 0:  # L+ S+ L+ (8.1)
        u = math.hypot(xl, yl)
        t = math.atan2(yl, xl)
        v = _wrapped(phi - t)
        return t >= -_ZERO and v >= -_ZERO, t, u, v
    if family == 1:  # L+ S+ R+ (8.2)
        u1 = xr * xr + yr * yr
        if u1 < 4.0:
            return False, 0.0, 0.0, 0.0
        u = math.sqrt(u1 - 4.0)
        t = _wrapped(math.atan2(yr, xr) + math.atan2(2.0, u))
        v = _wrapped(t - phi)
        return t >= -_ZERO and v >= -_ZERO, t, u, v
    if family == 2:  # L+ R- L (8.3, 8.4)
        u1 = math.hypot(xl, yl)
        if u1 > 4.0:
            return False, 0.0, 0.0, 0.0
        u = -2.0 * math.asin(0.25 * u1)
        t = _wrapped(math.atan2(yl, xl) + 0.5 * u + math.pi)
        return t >= -_ZERO and u <= _ZERO, t, u, _wrapped(phi - t + u)
    if family == 3:  # L+ R+ L- R- (8.7)
        rho = 0.25 * (2.0 + math.hypot(xr, yr))
        if rho > 1.0:
            return False, 0.0, 0.0, 0.0
        u = math.acos(rho)
        t, v = _tau_omega(u, -u, xr, yr, phi)
        return t >= -_ZERO and v <= _ZERO, t, u, v
    if family == 4:  # L+ R- L- R+ (8.8)
        rho = (20.0 - xr * xr - yr * yr) / 16.0
        if rho < 0.0 or rho > 1.0:
            return False, 0.0, 0.0, 0.0
        u = -math.acos(rho)
        t, v = _tau_omega(u, u, xr, yr, phi)
        return t >= -_ZERO and v >= -_ZERO, t, u, v
    if family == 5:  # L+ R- S- L- (8.9)
        rho = math.hypot(xl, yl)
        if rho < 2.0:
            return False, 0.0, 0.0, 0.0
        r = math.sqrt(rho * rho - 4.0)
        u = 2.0 - r
        t = _wrapped(math.atan2(yl, xl) + math.atan2(r, -2.0))
        v = _wrapped(phi - _HALF - t)
        return t >= -_ZERO and u <= _ZERO and v <= _ZERO, t, u, v
    if family == 6:  # L+ R- S- R- (8.10)
        rho = math.hypot(xr, yr)
        if rho < 2.0:
            return False, 0.0, 0.0, 0.0
        t = math.atan2(xr, -yr)
        u = 2.0 - rho
        v = _wrapped(t + _HALF - phi)
        return t >= -_ZERO and u <= _ZERO and v <= _ZERO, t, u, v
    # The longest family, with two quarters of circles (8.11).
    rho = math.hypot(xr, yr)
    if rho < 2.0:
        return False, 0.0, 0.0, 0.0
    u = 4.0 - math.sqrt(rho * rho - 4.0)
    t = _wrapped(math.atan2((4.0 - u) * xr - 2.0 * yr, -2.0 * xr + (u - 4.0) * yr))
    v = _wrapped(t - phi)
    return u <= _ZERO and t >= -_ZERO and v >= -_ZERO, t, u, v


@njit(cache=True, nogil=True)
def _piece(out, k, length, turn):
    """Set a piece of a word."""
    out[k, 0] = length
    out[k, 1] = turn


@njit(cache=True, nogil=True)
def _spell(family, t, u, v, out):
    """Pieces of a word of a family into ``out`` (5, 2); returns their number."""
    _piece(out, 0, t, 1.0)
    if family <= 1:
        _piece(out, 1, u, 0.0)
        _piece(out, 2, v, 1.0 if family == 0 else -1.0)
        return 3
    if family == 2:
        _piece(out, 1, u, -1.0)
        _piece(out, 2, v, 1.0)
        return 3
    if family <= 4:
        _piece(out, 1, u, -1.0)
        _piece(out, 2, -u if family == 3 else u, 1.0)
        _piece(out, 3, v, -1.0)
        return 4
    _piece(out, 1, -_HALF, -1.0)
    _piece(out, 2, u, 0.0)
    if family <= 6:
        _piece(out, 3, v, 1.0 if family == 5 else -1.0)
        return 4
    _piece(out, 3, -_HALF, 1.0)
    _piece(out, 4, v, -1.0)
    return 5


@njit(cache=True, nogil=True)
def _extent(family, t, u, v):
    """Length of a word."""
    total = abs(t) + abs(u) + abs(v)
    if family in (3, 4):
        total += abs(u)
    elif family in (5, 6):
        total += _HALF
    elif family == 7:
        total += math.pi
    return total


@njit(cache=True, nogil=True)
def reeds_shepp_word(x, y, phi, out):
    """Shortest word from (0, 0, 0) to (x, y, phi) for radius 1 into ``out`` (5, 2): pieces, total length."""
    best = math.inf
    best_family = 0
    best_flip = 0
    best_t = 0.0
    best_u = 0.0
    best_v = 0.0
    s = math.sin(phi)
    c = math.cos(phi)
    for family in range(N_FAMILIES):
        back = family >= 8
        base = (2, 5, 6)[family - 8] if back else family
        gx = x * c + y * s if back else x
        gy = x * s - y * c if back else y
        for flip in range(4):
            ax = -gx if flip & 1 else gx
            ay = -gy if flip & 2 else gy
            aphi = -phi if flip in (1, 2) else phi
            ok, t, u, v = _solve(base, ax, ay, aphi)
            if not ok:
                continue
            total = _extent(base, t, u, v)
            if total < best - _ZERO:
                best = total
                best_family = family
                best_flip = flip
                best_t = t
                best_u = u
                best_v = v
    back = best_family >= 8
    base = (2, 5, 6)[best_family - 8] if back else best_family
    n = _spell(base, best_t, best_u, best_v, out)
    if back:
        for k in range(n // 2):
            for j in range(2):
                held = out[k, j]
                out[k, j] = out[n - 1 - k, j]
                out[n - 1 - k, j] = held
    for k in range(n):
        if best_flip & 1:
            out[k, 0] = -out[k, 0]
        if best_flip & 2:
            out[k, 1] = -out[k, 1]
    return n, best
