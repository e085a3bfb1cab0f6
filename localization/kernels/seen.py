"""Who is seen from a place, how strongly, and where: masks, orders, inverted landmarks."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from localization.kernels.fix import FIXED, FLOOR, HEADING, MODE, N_MUTED, fixed_variance, is_muted, wrapped

#: A landmark nearer than this has no usable bearing: the robot stands on it. m
TOUCH_M = 1e-3


@njit(cache=True, nogil=True)
def visible_indices(words, out):
    """Indices of the bits set in ``words`` (n_words,) uint64, ascending, into ``out``; their number."""
    n = 0
    one = np.uint64(1)
    for w in range(words.shape[0]):
        word = words[w]
        base = w * 64
        while word != 0:
            # Whole empty bytes are skipped.
            if word & np.uint64(255) == 0:
                word >>= np.uint64(8)
                base += 8
                continue
            if word & one:
                out[n] = base
                n += 1
            word >>= one
            base += 1
    return n


@njit(cache=True, nogil=True)
def strongest_first(n, seen, strength, last, n_last, mark, order):
    """Sort ``seen`` (n,) by falling strength, then index, into ``order``; ``last`` (n_last,) is a good start.

    ``strength`` and ``mark`` are indexed by landmark; ``mark`` must be 0 and is 0 again afterwards.
    """
    for a in range(n):
        mark[seen[a]] = 1
    m = 0
    for a in range(n_last):
        if mark[last[a]] == 1:
            order[m] = last[a]
            mark[last[a]] = 0
            m += 1
    for a in range(n):
        if mark[seen[a]] == 1:
            order[m] = seen[a]
            mark[seen[a]] = 0
            m += 1
    for a in range(1, n):
        i = order[a]
        s = strength[i]
        b = a
        while b > 0 and (strength[order[b - 1]] < s or (strength[order[b - 1]] == s and order[b - 1] > i)):
            order[b] = order[b - 1]
            b -= 1
        order[b] = i


@njit(cache=True, nogil=True)
def in_view(x, y, n, seen, landmarks, sensor):
    """Keep those of ``seen`` (n,) that a sensor at (x, y) can measure; their number.

    Out go landmarks that it stands on, those in a muted sector and those outside a fixed camera's view.
    """
    m = 0
    for a in range(n):
        i = seen[a]
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        r2 = dx * dx + dy * dy
        if r2 < TOUCH_M * TOUCH_M:
            continue
        if sensor[MODE] == FIXED and math.isnan(fixed_variance(dx, dy, r2, 0.0, sensor)):
            continue
        if sensor[N_MUTED] > 0.0 and is_muted(dx, dy, sensor):
            continue
        seen[m] = i
        m += 1
    return m


@njit(cache=True, nogil=True)
def inverted(x, y, n, order, landmarks, survey, sensor, needs_azimuth, gx, gy, rho, azimuth, shares):
    """Landmarks ``order`` (n,) seen from (x, y): inverted, 1/r, azimuth, what is added to the variance.

    For a fixed camera the last is the whole variance.
    """
    for a in range(n):
        i = order[a]
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        r2 = dx * dx + dy * dy
        s = 1.0 / r2
        gx[a] = dx * s
        gy[a] = dy * s
        rho[a] = math.sqrt(s)
        shares[a] = survey[i] * s + sensor[FLOOR]
        if sensor[MODE] == FIXED:
            shares[a] = fixed_variance(dx, dy, r2, shares[a], sensor)
        azimuth[a] = wrapped(math.atan2(dy, dx) - sensor[HEADING]) if needs_azimuth else 0.0


@njit(cache=True, nogil=True)
def has_bit(words, i):
    """Whether bit i of ``words`` (n_words,) uint64 is set."""
    return (words[i >> 6] >> np.uint64(i & 63)) & np.uint64(1) != 0


@njit(cache=True, nogil=True)
def bits_set(word):
    """How many bits of a uint64 are set."""
    word -= (word >> np.uint64(1)) & np.uint64(0x5555555555555555)
    word = (word & np.uint64(0x3333333333333333)) + ((word >> np.uint64(2)) & np.uint64(0x3333333333333333))
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    word += word >> np.uint64(8)
    word += word >> np.uint64(16)
    word += word >> np.uint64(32)
    return np.int64(word & np.uint64(0x7F))
