"""Who sees whom from four million cells: one sweep per landmark against one exact ray per cell and landmark.

One row in fifty, seeded, is compared; ``python -m tests.benchmarks.bench_visibility`` compares every cell.
"""

from __future__ import annotations

import math
import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from maps.visibility import compute_visibility, visible_landmarks
from tests.benchmarks import floors

TITLE = "Visibility: sweeps against one exact ray per cell and landmark (all cores)"
SIDE, LANDMARKS, RANGE_M = 2000, 200, 30.0
TILE = 256
RAY_ROWS = 4


def run(share=0.02):
    makers, missing = floors.available()
    rows = [_compare(make(SIDE, LANDMARKS), share) for make in makers.values()]
    return [{**row, "note": missing} for row in rows] if missing else rows


def paint(visibility, workers):
    """Every tile once; the masks are thrown away."""
    n_rows, n_cols = visibility.shape
    corners = [(r, c) for r in range(0, n_rows, TILE) for c in range(0, n_cols, TILE)]
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(lambda at: visibility.masks(*(slice(k, k + TILE) for k in at)) is None, corners):
            pass


def packed(seen):
    """Bits of (P, N) booleans as masks have them, (P, n_words)."""
    words = max(1, -(-seen.shape[1] // 64))
    bits = np.zeros((len(seen), 8 * words), dtype=np.uint8)
    some = np.packbits(seen, axis=1, bitorder="little")
    bits[:, : some.shape[1]] = some
    return bits.view(np.uint64)


def _compare(world, share):
    frame, workers = world.floor.frame, os.cpu_count() or 1
    few = world.with_landmarks(world.landmarks.subset(range(2)))
    paint(compute_visibility(few, frame, max_range=RANGE_M), workers)  # compiled before it is timed
    visible_landmarks(few, [[1.0, 1.0]], max_range=RANGE_M)
    swept, painted, processor = [], [], []
    for _ in range(5):
        cpu, began = time.process_time(), time.perf_counter()
        visibility = compute_visibility(world, frame, max_range=RANGE_M)
        middle = time.perf_counter()
        paint(visibility, workers)
        swept.append(middle - began)
        painted.append(time.perf_counter() - middle)
        processor.append(time.process_time() - cpu)

    def rays(first):
        """Processor time of the rays of some rows; cells that differ; pairs in sight."""
        part = slice(first, first + RAY_ROWS)
        points = frame.centres(part).reshape(-1, 2)
        began = time.thread_time()
        seen = visible_landmarks(world, points, max_range=RANGE_M)
        took = time.thread_time() - began
        masks = visibility.masks(part).reshape(len(points), -1)
        return took, int((packed(seen) != masks).any(axis=1).sum()), int(seen.sum())

    stripes = np.arange(0, frame.n_rows, RAY_ROWS)
    some = np.random.default_rng(3).choice(stripes, math.ceil(share * len(stripes)), replace=False)
    with ThreadPoolExecutor(workers) as pool:
        took, different, pairs = np.sum(list(pool.map(rays, some)), axis=0)
    cells, compared = frame.n_rows * frame.n_cols, len(some) * RAY_ROWS * frame.n_cols
    took *= cells / compared
    best = min(range(5), key=lambda k: swept[k] + painted[k])
    return {
        "floor": world.name,
        "cells": f"{cells:,}",
        "landmarks": len(world.landmarks),
        "range [m]": f"{RANGE_M:g}",
        "seen per cell": f"{pairs / compared:.1f}",
        "sweeps [s]": f"{swept[best]:.3f}",
        "all masks [s]": f"{painted[best]:.3f}",
        "together [s]": f"{swept[best] + painted[best]:.3f}",
        "processor [s]": f"{min(processor):.2f}",
        "rays on all cells, processor [s]": f"{took:.1f}",
        "ratio": f"{took / min(processor):.0f}",
        "cells that differ": f"{int(different)} of {compared:,}",
    }


if __name__ == "__main__":
    for row in run(share=1.0):
        print(row)
