"""Fastest motion along a given curve under limits of speed and of total acceleration.

``b = v²`` over arc length; between two stations the tangential acceleration ``(b₁ - b₀) / 2Δs`` is constant.
The limit is on the length of the acceleration vector: ``a² + (κ b)² ≤ A²``, checked at both ends of each
interval.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
def _entry_limit(b_end, kappa, step, accel):
    """Largest b at a station of curvature ``kappa`` next to one with ``b_end``, by its own limit."""
    k = (2.0 * step * kappa) ** 2
    root = (2.0 * step) ** 2 * (accel * accel * (1.0 + k) - (kappa * b_end) ** 2)
    return (b_end + math.sqrt(max(root, 0.0))) / (1.0 + k)


@njit(cache=True, nogil=True)
def _backward(b_end, kappa, kappa_end, step, accel):
    """Largest b at a station (``kappa``) from which some b ≤ ``b_end`` is reached at the next one."""
    k = (2.0 * step * kappa_end) ** 2
    if kappa_end > 0.0:
        # Arriving slower leaves more acceleration for braking; beyond this it no longer pays.
        b_end = min(b_end, accel / (kappa_end * math.sqrt(1.0 + k)))
    room = math.sqrt(max(accel * accel - (kappa_end * b_end) ** 2, 0.0))
    b = min(b_end + 2.0 * step * room, _entry_limit(b_end, kappa, step, accel))
    if kappa > 0.0:
        b = min(b, accel / kappa)
    return b


@njit(cache=True, nogil=True)
def speed_profile(kappa, step, max_speed, accel, out):
    """Largest b = v² at N stations with |κ| (N,) and spacings (N - 1,), at rest at both ends; out (N,)."""
    n = kappa.shape[0]
    out[n - 1] = 0.0
    for i in range(n - 2, -1, -1):
        b = _backward(out[i + 1], kappa[i], kappa[i + 1], step[i], accel)
        out[i] = min(b, max_speed * max_speed)
    out[0] = 0.0
    for i in range(n - 1):
        room = math.sqrt(max(accel * accel - (kappa[i] * out[i]) ** 2, 0.0))
        b = min(out[i] + 2.0 * step[i] * room, _entry_limit(out[i], kappa[i + 1], step[i], accel))
        out[i + 1] = min(out[i + 1], max(b, 0.0))


@njit(cache=True, nogil=True)
def station_times(b, step, out):
    """Times (N,) at which stations with b = v² (N,) and spacings (N - 1,) are passed, from 0."""
    out[0] = 0.0
    for i in range(b.shape[0] - 1):
        speed = math.sqrt(b[i]) + math.sqrt(b[i + 1])
        out[i + 1] = out[i] + 2.0 * step[i] / max(speed, 1e-12)


@njit(cache=True, nogil=True)
def motion_at(t, times, b, step, arc, out_s, out_v, out_a):
    """Arc length, speed and acceleration along a timed curve of N stations at ascending times (K,)."""
    i = 0
    last = times.shape[0] - 2
    for k in range(t.shape[0]):
        while i < last and times[i + 1] <= t[k]:
            i += 1
        dt = t[k] - times[i]
        v = math.sqrt(b[i])
        a = (b[i + 1] - b[i]) / (2.0 * step[i])
        out_s[k] = min(max(arc[i] + (v + 0.5 * a * dt) * dt, arc[i]), arc[i + 1])
        out_v[k] = max(v + a * dt, 0.0)
        out_a[k] = a
