"""Exact best triplet against compiled enumeration of all triplets, cell by cell, in one run."""

from __future__ import annotations

import math
import time

import numpy as np
from numba import njit

from localization.kernels.field import field_tile
from localization.sensors import LASER, MAS97_CAMERA, kernel_args

TITLE = "Best triplet: search against compiled enumeration (processor time of one thread)"
SIDE_M = 40.0
CELL_M = 0.1


@njit(cache=True, nogil=True)
def enumerate_all(x, y, landmarks):
    """Largest |D| of all triplets seen all around from (x, y); landmarks (n, 2)."""
    n = landmarks.shape[0]
    g = np.empty((n, 2))
    for i in range(n):
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        r2 = dx * dx + dy * dy
        g[i, 0] = dx / r2
        g[i, 1] = dy / r2
    best = 0.0
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            ex = g[j, 0] - g[i, 0]
            ey = g[j, 1] - g[i, 1]
            c = ex * g[i, 1] - ey * g[i, 0]
            for k in range(j + 1, n):
                best = max(best, abs(ex * g[k, 1] - ey * g[k, 0] - c))
    return best


@njit(cache=True, nogil=True)
def enumerate_view(x, y, landmarks, view):
    """Largest D² / (c1 c2 + c1 c3 + c2 c3), c = cos⁴ψ, axis on the middle, of all triplets within ``view``."""
    n = landmarks.shape[0]
    azimuth = np.empty(n)
    for i in range(n):
        azimuth[i] = math.atan2(landmarks[i, 1] - y, landmarks[i, 0] - x)
    order = np.argsort(azimuth)
    u = np.empty((n, 2))
    g = np.empty((n, 2))
    phi = np.empty(n)
    for a in range(n):
        i = order[a]
        dx = landmarks[i, 0] - x
        dy = landmarks[i, 1] - y
        r2 = dx * dx + dy * dy
        r = math.sqrt(r2)
        u[a, 0] = dx / r
        u[a, 1] = dy / r
        g[a, 0] = dx / r2
        g[a, 1] = dy / r2
        phi[a] = azimuth[i]
    best = 0.0
    for a in range(n):
        for step in range(2, n):
            b = (a + step) % n
            span = phi[b] - phi[a]
            if span < 0.0:
                span += 2.0 * math.pi
            if span > view + 1e-12:
                break
            half = math.cos(0.5 * span)
            mx = (u[a, 0] + u[b, 0]) / (2.0 * half)
            my = (u[a, 1] + u[b, 1]) / (2.0 * half)
            outer = half**4
            ex = g[b, 0] - g[a, 0]
            ey = g[b, 1] - g[a, 1]
            for between in range(1, step):
                m = (a + between) % n
                d = ex * (g[m, 1] - g[a, 1]) - ey * (g[m, 0] - g[a, 0])
                c = u[m, 0] * mx + u[m, 1] * my
                c *= c
                c *= c
                best = max(best, d * d / (outer * outer + 2.0 * outer * c))
    return best


@njit(cache=True, nogil=True)
def enumerate_cells(cells, landmarks, view, out):
    """One enumeration per cell (m, 2) into ``out`` (m,); all around when ``view`` is 0."""
    for i in range(cells.shape[0]):
        if view == 0.0:
            out[i] = enumerate_all(cells[i, 0], cells[i, 1], landmarks)
        else:
            out[i] = enumerate_view(cells[i, 0], cells[i, 1], landmarks, view)


def layout(name, n, rng):
    """Landmarks (n, 2) in a square hall, m."""
    if name == "uniform":
        return rng.uniform(0.0, SIDE_M, (n, 2))
    if name == "walls":
        t = rng.uniform(0.0, SIDE_M, n)
        wall = rng.integers(0, 4, n)
        zero, far = np.zeros(n), np.full(n, SIDE_M)
        x = np.choose(wall, [t, far, t, zero])
        y = np.choose(wall, [zero, t, far, t])
        return np.column_stack([x, y]) + rng.normal(0.0, 0.02, (n, 2))
    rows = np.linspace(5.0, SIDE_M - 5.0, 4)  # racks
    return np.column_stack([rng.uniform(0.0, SIDE_M, n), rng.choice(rows, n)]) + rng.normal(0, 0.02, (n, 2))


def run_tile(centres, landmarks, sensor):
    """Search in every cell of a window; seconds, covariances, triplets."""
    shape = centres.shape[:2]
    n = len(landmarks)
    bits = np.zeros((n + 63) // 64, dtype=np.uint64)
    for i in range(n):
        bits[i // 64] |= np.uint64(1) << np.uint64(i % 64)
    masks = np.ascontiguousarray(np.broadcast_to(bits, (*shape, len(bits))))
    out = (
        np.full((*shape, 3), np.nan),
        np.full(shape, np.nan),
        np.full((*shape, 3), -1, dtype=np.int16),
        np.full(shape, np.nan),
        np.zeros(shape, dtype=np.int16),
        np.full(shape, np.nan, dtype=np.float32),
    )
    positions = landmarks.copy()
    positions.flags.writeable = False
    args = (
        centres,
        np.ones(shape, dtype=np.bool_),
        masks,
        positions,
        np.zeros(n),
        False,
        kernel_args(sensor),
    )
    began = time.thread_time()
    field_tile(*args, *out)
    return time.thread_time() - began, out[0], out[2]


def run(sizes=(10, 30, 100, 300), budget_s=0.4, cells=(48, 48)):
    rng = np.random.default_rng(5)
    rows = []
    for label, sensor in (("omnidirectional", LASER), ("pinhole, F = 53°", MAS97_CAMERA)):
        for name in ("uniform", "walls", "rows"):
            for n in sizes:
                landmarks = layout(name, n, rng)
                corner = rng.uniform(0.2 * SIDE_M, 0.7 * SIDE_M, 2)
                gx, gy = np.meshgrid(np.arange(cells[1]), np.arange(cells[0]))
                centres = np.ascontiguousarray(corner + CELL_M * np.stack([gx, gy], -1))
                rows.append(
                    {
                        "sensor": label,
                        "layout": name,
                        "visible": n,
                        **_compare(centres, landmarks, sensor, budget_s),
                    }
                )
    return rows


def _compare(centres, landmarks, sensor, budget_s):
    run_tile(centres[:1, :1], landmarks, sensor)
    search = min(run_tile(centres, landmarks, sensor)[0] for _ in range(3)) / centres[..., 0].size
    covariance = run_tile(centres, landmarks, sensor)[1].reshape(-1, 3)
    view = 0.0 if sensor.kind == "omnidirectional" else sensor.field_of_view
    flat = centres.reshape(-1, 2)
    value = np.empty(1)
    enumerate_cells(flat[:1], landmarks, view, value)
    began = time.thread_time()
    enumerate_cells(flat[:1], landmarks, view, value)
    once = time.thread_time() - began
    # As many cells as the budget allows, spread over the window.
    tried = flat[:: max(1, math.ceil(len(flat) * once / budget_s))]
    value = np.empty(len(tried))
    began = time.thread_time()
    enumerate_cells(tried, landmarks, view, value)
    enumeration = (time.thread_time() - began) / len(tried)
    c = covariance[:: max(1, math.ceil(len(flat) * once / budget_s))]
    det = c[:, 0] * c[:, 2] - c[:, 1] ** 2
    variance = kernel_args(sensor)[1]
    want = variance**2 / value**2 * 3.0 if view == 0.0 else variance**2 / np.where(value > 0, value, np.nan)
    same = (np.isnan(det) & np.isnan(want)) | (np.abs(np.sqrt(det / want) - 1.0) <= 1e-9)
    return {
        "search [µs]": f"{1e6 * search:.2f}",
        "enumeration [µs]": f"{1e6 * enumeration:.2f}",
        "ratio": f"{enumeration / search:.1f}",
        "cells compared": len(tried),
        "equal to 1e-9": f"{np.count_nonzero(same)} of {len(tried)}",
    }
