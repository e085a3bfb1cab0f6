"""The shadow sweep against an exact ray to every target."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maps.kernels.grid_sweep import opaque_lines, sweep_landmark
from maps.kernels.grid_visibility import FAR, clear_sight, in_cone

SHIFT = 3
UNIT = 1 << SHIFT


def lines_of(opaque):
    offsets = np.empty(opaque.shape[0] + 1, dtype=np.int64)
    n = opaque_lines(opaque, offsets, np.empty((0, 2), dtype=np.int32))
    lines = np.empty((n, 2), dtype=np.int32)
    assert opaque_lines(opaque, offsets, lines) == n
    return lines, offsets


def test_opaque_lines_rebuild_the_grid(rng):
    for share in (0.0, 0.2, 0.7, 1.0):
        opaque = rng.random((7, 9)) < share
        lines, offsets = lines_of(opaque)
        again = np.zeros_like(opaque)
        for row in range(7):
            for first, stop in lines[offsets[row] : offsets[row + 1]]:
                assert not again[row, max(first - 1, 0) : stop].any()
                again[row, first:stop] = True
        assert (again == opaque).all()


def sweep_case(rng, step):
    """Counts per target of both orientations, and what exact rays say."""
    shape = tuple(rng.integers(1, 11, 2))
    opaque = rng.random(shape) < rng.choice([0.05, 0.2, 0.4])
    window = rng.random((3, 3)) < 0.3
    row, col = (int(v) for v in rng.integers(-1, 8, 2)) if rng.random() < 0.5 else (FAR, FAR)
    lx, ly = (int(v) for v in rng.integers(-UNIT, [(shape[1] + 1) * UNIT, (shape[0] + 1) * UNIT]))
    if rng.random() < 0.4:
        lx = lx // UNIT * UNIT
    if rng.random() < 0.4:
        ly = ly // UNIT * UNIT
    first = int(rng.integers(0, UNIT))
    tx = np.arange(first, shape[1] * UNIT + step, step)
    ty = np.arange(first, shape[0] * UNIT + step, step)
    mode = int(rng.integers(3))
    cone = rng.integers(-3, 4, 4)
    a1, b1, a2, b2 = (int(v) for v in cone)
    low2, high2 = float(rng.choice([0.0, 4.0])), float(rng.choice([math.inf, 16.0, 40.0]))
    got = np.zeros((len(ty), len(tx)), dtype=int)
    turned = np.ascontiguousarray(opaque.T)
    for line, first, stop in sweep_landmark(
        *lines_of(opaque), opaque, window, row, col, SHIFT, lx, ly, lx / UNIT, ly / UNIT,
        tx, ty, tx / UNIT, ty / UNIT, low2, high2, mode, a1, b1, a2, b2, 0,
    ):  # fmt: skip
        got[line, first:stop] += 1
    for line, first, stop in sweep_landmark(
        *lines_of(turned), turned, np.ascontiguousarray(window.T), col, row, SHIFT, ly, lx, ly / UNIT, lx / UNIT,
        ty, tx, ty / UNIT, tx / UNIT, low2, high2, mode, b1, a1, b2, a2, 1,
    ):  # fmt: skip
        got[first:stop, line] += 1
    expected = np.zeros_like(got)
    for r, y in enumerate(ty):
        for c, x in enumerate(tx):
            d2 = ((x - lx) / UNIT) ** 2 + ((y - ly) / UNIT) ** 2
            expected[r, c] = (
                low2 <= d2 <= high2
                and in_cone(mode, cone, x - lx, y - ly)
                and clear_sight(opaque, window, row, col, SHIFT, lx, ly, x, y)
            )
    return got, expected


@pytest.mark.parametrize("step", [UNIT, 2 * UNIT, UNIT // 2, 3, 13, 21])
def test_sweep_equals_a_ray_per_target(rng, step):
    seen = 0
    for _ in range(150):
        got, expected = sweep_case(rng, step)
        assert (got == expected).all()
        seen += expected.sum()
    assert seen > 300
