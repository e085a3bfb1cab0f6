"""Exact best triplet against compiled enumeration of all triplets, in one run, doing the same job.

Both go over the cells of one window: read the mask of visible landmarks, invert them, find the best triplet, write
its indices. The enumeration keeps its landmarks contiguous, sorts them by azimuth for a camera that pans and looks
only at triplets that fit its view; it has no bounds, no seeds and no hull.
"""

from __future__ import annotations

import math
import time

import numpy as np
from numba import njit

from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    CRITERION,
    FIXED,
    MODE,
    TRACE,
    VIEW,
    fixed_variance,
    triplet_fix,
)
from localization.kernels.seen import visible_indices
from localization.kernels.tile_search import search_tile
from localization.sensors import LASER, MAS97_CAMERA, PinholeFixedSensor, kernel_args

TITLE = "Best triplet: search against compiled enumeration, per cell (processor time of one thread)"
SIDE_M = 40.0
CELL_M = 0.1
FIXED_CAMERA = PinholeFixedSensor(
    MAS97_CAMERA.field_of_view, MAS97_CAMERA.focal_px, MAS97_CAMERA.column_sigma_px
)
HEADING = 0.3


@njit(cache=True, nogil=True)
def enumerate_around(n, gx, gy, triplet):
    """Largest |D| of all triplets; positions into ``triplet`` (3,)."""
    best = 0.0
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            ex = gx[j] - gx[i]
            ey = gy[j] - gy[i]
            c = ex * gy[i] - ey * gx[i]
            for k in range(j + 1, n):
                d = abs(ex * gy[k] - ey * gx[k] - c)
                if d > best:
                    best = d
                    triplet[0] = i
                    triplet[1] = j
                    triplet[2] = k


@njit(cache=True, nogil=True)
def enumerate_view(n, gx, gy, ux, uy, phi, view, triplet):
    """Largest D² / (c1 c2 + c1 c3 + c2 c3), c = cos⁴ψ, axis on the middle, within ``view``; arrays (2 n,)."""
    best = 0.0
    for a in range(n):
        for b in range(a + 2, a + n):
            span = phi[b] - phi[a]
            if span > view + 1e-12:
                break
            half = math.cos(0.5 * span)
            mx = (ux[a] + ux[b]) / (2.0 * half)
            my = (uy[a] + uy[b]) / (2.0 * half)
            outer = half**4
            square = outer * outer
            twice = 2.0 * outer
            ex = gx[b] - gx[a]
            ey = gy[b] - gy[a]
            for m in range(a + 1, b):
                d = ex * (gy[m] - gy[a]) - ey * (gx[m] - gx[a])
                c = ux[m] * mx + uy[m] * my
                c *= c
                pair = square + twice * (c * c)
                if d * d > best * pair:
                    best = d * d / pair
                    triplet[0] = a
                    triplet[1] = m
                    triplet[2] = b


@njit(cache=True, nogil=True)
def enumerate_view_axes(n, gx, gy, ux, uy, phi, view, trace, triplet):
    """As ``enumerate_view``, by the trace or the larger eigenvalue of Σ."""
    best = 0.0
    for a in range(n):
        for b in range(a + 2, a + n):
            span = phi[b] - phi[a]
            if span > view + 1e-12:
                break
            half = math.cos(0.5 * span)
            mx = (ux[a] + ux[b]) / (2.0 * half)
            my = (uy[a] + uy[b]) / (2.0 * half)
            outer = half**4
            ex = gx[b] - gx[a]
            ey = gy[b] - gy[a]
            for m in range(a + 1, b):
                px = gx[m] - gx[a]
                py = gy[m] - gy[a]
                qx = gx[b] - gx[m]
                qy = gy[b] - gy[m]
                d = ex * py - ey * px
                c = ux[m] * mx + uy[m] * my
                c *= c
                c *= c
                xx = outer * (px * px + qx * qx) + c * ex * ex
                yy = outer * (py * py + qy * qy) + c * ey * ey
                size = 0.5 * (xx + yy)
                if not trace:
                    xy = outer * (px * py + qx * qy) + c * ex * ey
                    size += math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
                if d * d > best * size:
                    best = d * d / size
                    triplet[0] = a
                    triplet[1] = m
                    triplet[2] = b


@njit(cache=True, nogil=True)
def enumerate_fixed(n, gx, gy, v, triplet):
    """Largest D² / (v1 v2 + v1 v3 + v2 v3) of landmarks that are all in view, with variances v (n,)."""
    best = 0.0
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            ex = gx[j] - gx[i]
            ey = gy[j] - gy[i]
            product = v[i] * v[j]
            sum_ = v[i] + v[j]
            for k in range(j + 1, n):
                d = ex * (gy[k] - gy[i]) - ey * (gx[k] - gx[i])
                pair = product + sum_ * v[k]
                if d * d > best * pair:
                    best = d * d / pair
                    triplet[0] = i
                    triplet[1] = j
                    triplet[2] = k


@njit(cache=True, nogil=True)
def enumerate_tile(centres, free, masks, landmarks, sensor, out_triplet, out_n_visible):
    """As ``search_tile``, by enumeration, over cells (h, w, 2); without survey sigmas and lever arm."""
    h, w = out_triplet.shape[:2]
    n_all = landmarks.shape[0]
    seen = np.empty(n_all + 1, dtype=np.int64)
    work = np.empty((6, 2 * n_all))
    gx, gy, ux, uy, phi, v = work[0], work[1], work[2], work[3], work[4], work[5]
    triplet = np.empty(3, dtype=np.int64)
    azimuth = np.empty(n_all)
    for row in range(h):
        for col in range(w):
            if not free[row, col]:
                continue
            x = centres[row, col, 0]
            y = centres[row, col, 1]
            n = visible_indices(masks[row, col], seen)
            triplet[:] = -1
            if sensor[MODE] == CENTRED_FREE:
                for a in range(n):
                    azimuth[a] = math.atan2(landmarks[seen[a], 1] - y, landmarks[seen[a], 0] - x)
                # Insertion: best for few, and next to nothing beside the triplets of many.
                for a in range(1, n):
                    i = seen[a]
                    angle = azimuth[a]
                    b = a
                    while b > 0 and azimuth[b - 1] > angle:
                        seen[b] = seen[b - 1]
                        azimuth[b] = azimuth[b - 1]
                        b -= 1
                    seen[b] = i
                    azimuth[b] = angle
            m = 0
            for a in range(n):
                i = seen[a]
                dx = landmarks[i, 0] - x
                dy = landmarks[i, 1] - y
                r2 = dx * dx + dy * dy
                if sensor[MODE] == FIXED:
                    v[m] = fixed_variance(dx, dy, r2, 0.0, sensor)
                    if math.isnan(v[m]):
                        continue
                    seen[m] = i
                gx[m] = dx / r2
                gy[m] = dy / r2
                if sensor[MODE] == CENTRED_FREE:
                    r = math.sqrt(r2)
                    ux[m] = dx / r
                    uy[m] = dy / r
                m += 1
            if sensor[MODE] == CENTRED_FREE:
                for a in range(n):
                    gx[a + n] = gx[a]
                    gy[a + n] = gy[a]
                    ux[a + n] = ux[a]
                    uy[a + n] = uy[a]
                    phi[a] = azimuth[a]
                    phi[a + n] = azimuth[a] + 2.0 * math.pi
                if sensor[CRITERION] == AREA:
                    enumerate_view(n, gx, gy, ux, uy, phi, sensor[VIEW], triplet)
                else:
                    trace = sensor[CRITERION] == TRACE
                    enumerate_view_axes(n, gx, gy, ux, uy, phi, sensor[VIEW], trace, triplet)
            elif sensor[MODE] == FIXED:
                enumerate_fixed(m, gx, gy, v, triplet)
            else:
                enumerate_around(n, gx, gy, triplet)
            out_n_visible[row, col] = m
            for c in range(3):
                out_triplet[row, col, c] = seen[triplet[c] % n] if triplet[0] >= 0 else -1


def least_by_enumeration(x, y, landmarks, args):
    """What the criterion compares (see ``_size``) of the best triplet at (x, y); inf without a fix."""
    masks = masks_of((1, 1), len(landmarks))
    _, triplet = run_enumeration(np.array([[[x, y]]]), masks, landmarks, args)
    least = _size((x, y), triplet[0, 0], landmarks, args)
    return math.inf if math.isnan(least) else least


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


def masks_of(shape, n):
    """Every landmark visible from every cell: (h, w, n_words)."""
    bits = np.zeros((n + 63) // 64, dtype=np.uint64)
    for i in range(n):
        bits[i // 64] |= np.uint64(1) << np.uint64(i % 64)
    return np.ascontiguousarray(np.broadcast_to(bits, (*shape, len(bits))))


def run_search(centres, masks, landmarks, args):
    """Search in every cell of a window; seconds, triplets, landmarks in view."""
    shape = centres.shape[:2]
    triplet, count = np.full((*shape, 3), -1, dtype=np.int16), np.zeros(shape, dtype=np.int16)
    free, survey = np.ones(shape, dtype=np.bool_), np.zeros(len(landmarks))
    began = time.thread_time()
    search_tile(centres, free, masks, landmarks, survey, False, args, triplet, count)
    return time.thread_time() - began, triplet, count


def run_enumeration(centres, masks, landmarks, args):
    """Enumeration in every cell; seconds, triplets."""
    shape = centres.shape[:2]
    triplet, count = np.full((*shape, 3), -1, dtype=np.int16), np.zeros(shape, dtype=np.int16)
    free = np.ones(shape, dtype=np.bool_)
    began = time.thread_time()
    enumerate_tile(centres, free, masks, landmarks, args, triplet, count)
    return time.thread_time() - began, triplet


LAYOUTS = ("uniform", "walls", "rows")
CASES = (
    ("omnidirectional", LASER, "area", LAYOUTS, (3, 5, 10, 15, 30, 100, 300)),
    ("pinhole, F = 53°", MAS97_CAMERA, "area", LAYOUTS, (3, 5, 10, 15, 30, 100, 300)),
    ("pinhole, F = 53°", MAS97_CAMERA, "max_axis", LAYOUTS[:2], (10, 100, 300)),
    ("pinhole, F = 53°", MAS97_CAMERA, "trace", LAYOUTS[:2], (10, 100, 300)),
    ("fixed pinhole, F = 53°", FIXED_CAMERA, "area", LAYOUTS[:2], (10, 100, 300, 1000)),
)


def run(budget_s=0.4, cells=(48, 48), cases=CASES):
    rng = np.random.default_rng(5)
    rows = []
    for label, sensor, criterion, layouts, sizes in cases:
        for name in layouts:
            for n in sizes:
                landmarks = layout(name, n, rng)
                corner = rng.uniform(0.2 * SIDE_M, 0.7 * SIDE_M, 2)
                gx, gy = np.meshgrid(np.arange(cells[1]), np.arange(cells[0]))
                centres = np.ascontiguousarray(corner + CELL_M * np.stack([gx, gy], -1))
                args = kernel_args(sensor, HEADING, criterion)
                result = _compare(centres, landmarks, args, budget_s)
                rows.append({"sensor": label, "criterion": criterion, "layout": name, "visible": n, **result})
    return rows


def _size(place, triplet, landmarks, args):
    """What a criterion compares: det Σ, its larger eigenvalue squared, or its trace squared; inf without a fix."""
    if triplet[0] < 0:
        return math.inf
    survey = np.zeros(len(landmarks))
    xx, xy, yy, _, _ = triplet_fix(*place, *(int(t) for t in triplet), landmarks, survey, args)
    if args[CRITERION] == AREA:
        return xx * yy - xy * xy
    half = 0.5 * (xx + yy)
    return (half if args[CRITERION] == TRACE else half + math.hypot(0.5 * (xx - yy), xy)) ** 2


def _compare(centres, landmarks, args, budget_s):
    shape = centres.shape[:2]
    landmarks = landmarks.copy()
    landmarks.flags.writeable = False
    masks = masks_of(shape, len(landmarks))
    run_search(centres[:2, :2].copy(), masks[:2, :2].copy(), landmarks, args)
    run_enumeration(centres[:1, :1].copy(), masks[:1, :1].copy(), landmarks, args)
    once = max(run_enumeration(centres[:1, :1].copy(), masks[:1, :1].copy(), landmarks, args)[0], 1e-7)
    # As many cells as the budget allows, spread over the window.
    step = max(1, math.ceil(math.sqrt(centres[..., 0].size * once / budget_s)))
    at = (slice(None, None, step), slice(None, None, step))
    few, few_masks = np.ascontiguousarray(centres[at]), np.ascontiguousarray(masks[at])
    searches, enumerations = [], []
    for _ in range(3):
        # One after the other, so that both meet the same machine.
        seconds, triplet, count = run_search(centres, masks, landmarks, args)
        searches.append(seconds / centres[..., 0].size)
        seconds, want = run_enumeration(few, few_masks, landmarks, args)
        enumerations.append(seconds / few[..., 0].size)
    search, enumeration = min(searches), min(enumerations)
    got = triplet[at].reshape(-1, 3)
    pairs = zip(few.reshape(-1, 2), got, want.reshape(-1, 3), strict=True)
    sizes = [(_size(p, g, landmarks, args), _size(p, w, landmarks, args)) for p, g, w in pairs]
    same = sum(a == b or abs(a / b - 1.0) <= 1e-9 for a, b in sizes)
    return {
        "in view": f"{count.mean():.0f}",
        "search [µs]": f"{1e6 * search:.2f}",
        "enumeration [µs]": f"{1e6 * enumeration:.2f}",
        "ratio": f"{enumeration / search:.1f}",
        "cells compared": len(sizes),
        "equal to 1e-9": f"{same} of {len(sizes)}",
    }
