"""Cells searched together find what each of them finds alone, on every layout, sensor and criterion."""

from __future__ import annotations

import numpy as np
import pytest

from localization.kernels.block_known import value_at
from localization.kernels.field import ranked_at
from localization.kernels.seen import in_view
from localization.kernels.tile_search import search_tile
from localization.sensors import CRITERIA, kernel_args
from tests.localization.kernels.test_field import masks_of
from tests.triplet_arrays import SENSORS

LAYOUTS = ("uniform", "walls", "rows", "clustered", "lattice", "circle")
TOGETHER = (
    "mas97",
    "pinhole fixed",
    "pinhole fixed, mounted",
    "camera, mounted",
    "coarse",
    "laser, mounted",
    "wide",
)


def layout(rng, name, n):
    if name == "uniform":
        return rng.uniform(-10, 10, (n, 2))
    if name == "walls":
        t, wall, ten = rng.uniform(-10, 10, n), rng.integers(0, 4, n), np.full(n, 10.0)
        return np.column_stack([np.choose(wall, [t, ten, t, -ten]), np.choose(wall, [-ten, t, ten, t])])
    if name == "rows":
        return np.column_stack([rng.uniform(-10, 10, n), rng.choice([-6.0, -2.0, 2.0, 6.0], n)])
    if name == "clustered":
        return rng.uniform(-9, 9, (5, 2))[rng.integers(0, 5, n)] + rng.normal(0, 0.4, (n, 2))
    if name == "circle":
        angles = rng.uniform(-np.pi, np.pi, n)
        return 7.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    side = int(np.ceil(np.sqrt(n)))
    at = rng.permutation(side * side)[:n]
    return np.column_stack([at % side, at // side]) * (16.0 / side) - 7.93


def check(
    rng, sensor, landmarks, shape, cell, sigmas, criterion="area", share=1.0, heading=0.4, by_value=False
):
    """A tile against every cell's own ranking; cells with a triplet."""
    n = len(landmarks)
    gx, gy = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    centres = np.ascontiguousarray(np.stack([gx, gy], -1) * cell + rng.uniform(-5, 5, 2))
    free = rng.random(shape) < 0.97
    visible = rng.random((*shape, n)) < share
    args = kernel_args(sensor, heading, criterion)
    triplet, count = np.full((*shape, 3), -1, dtype=np.int16), np.zeros(shape, dtype=np.int16)
    survey = sigmas**2
    search_tile(centres, free, masks_of(visible), landmarks, survey, bool(survey.any()), args, triplet, count)
    found = 0
    for r, c in zip(*np.nonzero(free), strict=True):
        x, y = centres[r, c, 0] + args[11], centres[r, c, 1] - args[10]
        seen = np.flatnonzero(visible[r, c])
        seen = seen[: in_view(x, y, len(seen), seen, landmarks, args)]
        values, best = np.empty(1), np.empty((1, 3), dtype=np.int64)
        assert count[r, c] == len(seen)
        got = [int(i) for i in triplet[r, c]]
        if len(seen) < 3 or not ranked_at(x, y, seen, landmarks, survey, args, values, best):
            assert got == [-1, -1, -1]
            continue
        if by_value:
            assert got == sorted(got)
            assert value_at(x, y, *got, landmarks, survey, args) == pytest.approx(values[0], rel=1e-9)
        else:
            assert got == best[0].tolist(), (r, c, got, best[0])
        found += 1
    return found


@pytest.mark.parametrize("layout_name", LAYOUTS)
@pytest.mark.parametrize("name", TOGETHER)
def test_together_as_alone(rng, name, layout_name):
    sensor = SENSORS[name]
    found = 0
    for n in (3, 6, 15, 40):
        landmarks = layout(rng, layout_name, n)
        sigmas = np.full(n, 0.02) if name in {"coarse", "laser, mounted"} else np.zeros(n)
        found += check(rng, sensor, landmarks, (11, 13), 0.1, sigmas)
    assert found > (100 if name in {"mas97", "coarse"} else 0)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("name", TOGETHER)
def test_with_other_criteria_surveys_and_gaps(rng, name, criterion):
    found = 0
    for trial, layout_name in enumerate(LAYOUTS):
        n = 24
        sigmas = rng.choice([0.0, 0.03], n)
        share = (1.0, 0.6, 0.9)[trial % 3]
        found += check(
            rng, SENSORS[name], layout(rng, layout_name, n), (9, 9), 0.07, sigmas, criterion, share
        )
    assert found > 100


@pytest.mark.parametrize("layout_name", LAYOUTS)
def test_many_landmarks(rng, layout_name):
    for n in (120, 300):
        found = check(rng, SENSORS["mas97"], layout(rng, layout_name, n), (8, 9), 0.1, np.zeros(n))
        assert found > 20


@pytest.mark.parametrize("layout_name", LAYOUTS)
def test_largest_triangle_in_every_cell(rng, layout_name):
    # By hull and by enumeration; of equal triangles either may be taken.
    for n in (3, 5, 12, 17, 30, 80):
        landmarks = layout(rng, layout_name, n)
        assert check(rng, SENSORS["laser"], landmarks, (9, 9), 0.1, np.zeros(n), by_value=True) > 30
        check(rng, SENSORS["laser"], landmarks, (5, 5), 0.1, np.zeros(n), share=0.5, by_value=True)


@pytest.mark.parametrize("criterion", ["max_axis", "trace"])
def test_many_landmarks_with_other_criteria(rng, criterion):
    for layout_name in LAYOUTS:
        landmarks = layout(rng, layout_name, 60)
        assert check(rng, SENSORS["mas97"], landmarks, (8, 8), 0.1, np.zeros(60), criterion) > 20
        check(rng, SENSORS["pinhole fixed"], landmarks, (8, 8), 0.1, np.zeros(60), criterion)


def test_coarse_cells_and_cells_on_landmarks(rng):
    for cell in (0.8, 0.02, 0.3):
        landmarks = layout(rng, "uniform", 40)
        landmarks[:10] = rng.uniform(-1.5, 1.5, (10, 2))
        check(rng, SENSORS["mas97"], landmarks, (10, 10), cell, np.zeros(40))
        check(rng, SENSORS["pinhole fixed"], landmarks, (10, 10), cell, np.zeros(40))
