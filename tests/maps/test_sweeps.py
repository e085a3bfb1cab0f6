"""Runs within bounded memory: bands give the masks that all runs at once give."""

from __future__ import annotations

import math
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from maps.grid import GridFrame, OccupancyGrid
from maps.grid_visibility import GridSweep
from maps.io.site import bundled_site
from maps.landmarks import LandmarkSet
from maps.runs import Runs
from maps.sweeps import BandedRuns, TooManyRuns, all_runs
from maps.vector_visibility import VectorSweep
from maps.visibility import compute_visibility
from maps.world import World


def cluttered_world(rng, n=70):
    frame = GridFrame(-2.0, 1.0, 0.4, 0.25, 700, 90)
    opaque = rng.random(frame.shape) < 0.02
    places = frame.to_world(rng.uniform([0, 0], [90, 700], (n, 2)))
    facing = np.where(rng.random(n) < 0.5, np.nan, rng.uniform(-3, 3, n))
    landmarks = LandmarkSet(tuple(f"L{i}" for i in range(n)), places, facing)
    return World("clutter", OccupancyGrid(frame, ~opaque, opaque), landmarks)


def plan_world():
    return bundled_site("warehouse")


def sweep_of(world, frame, **ranges):
    kind = GridSweep if isinstance(world.floor, OccupancyGrid) else VectorSweep
    return kind.of(world.floor, world.landmarks, frame, **ranges)


@pytest.mark.parametrize("ranges", [{}, {"min_range": 2.0, "max_range": 20.0}])
@pytest.mark.parametrize("kind", ["cells", "plan"])
def test_some_rows_are_cut_from_the_whole(rng, kind, ranges):
    world = cluttered_world(rng) if kind == "cells" else plan_world()
    frame = world.grid_frame(0.25)
    sweep = sweep_of(world, frame, **ranges)
    whole = all_runs(sweep).masks()
    assert whole.any()
    n = frame.n_rows
    for first, stop in [(0, n), (0, 1), (n - 1, n), *np.sort(rng.integers(0, n + 1, (6, 2)))]:
        if first < stop:
            part = all_runs(sweep, rows=(int(first), int(stop)))
            assert (part.masks(slice(first, stop)) == whole[first:stop]).all()
            assert not part.masks(slice(0, first)).any()
            assert not part.masks(slice(stop, n)).any()


@pytest.mark.parametrize("kind", ["cells", "plan"])
def test_bands_paint_the_same_masks(rng, kind):
    world = cluttered_world(rng) if kind == "cells" else plan_world()
    frame = world.grid_frame(0.25 if kind == "cells" else 0.08)
    calls = []
    whole = compute_visibility(world, frame, max_range=30.0)
    banded = compute_visibility(
        world, frame, max_range=30.0, max_run_bytes=100_000, tick=lambda *a: calls.append(a)
    )
    assert isinstance(whole.runs, Runs)
    assert isinstance(banded.runs, BandedRuns)
    n = len(world.landmarks)
    assert calls[-1] == (n, n)
    assert sorted(calls) == calls
    want = whole.masks()
    assert (banded.masks() == want).all()
    windows = [
        (slice(r, r + int(h)), slice(c, c + 50)) for r, c, h in rng.integers(0, 90, (12, 3)) * [[5, 1, 2]]
    ]
    with ThreadPoolExecutor(4) as pool:
        for window, got in zip(windows, pool.map(lambda w: banded.masks(*w), windows), strict=True):
            assert (got == want[window]).all()
    assert (banded.shape, banded.n_landmarks, banded.n_words) == (
        whole.shape,
        whole.n_landmarks,
        whole.n_words,
    )
    assert (banded.runs.counts() == whole.runs.counts()).all()
    assert (pickle.loads(pickle.dumps(banded)).masks(slice(200, 300)) == want[200:300]).all()
    assert banded.masks(slice(5, 5)).shape == (0, frame.n_cols, whole.n_words)


def test_bands_that_take_too_much_are_halved(rng):
    world = cluttered_world(rng)
    sweep = sweep_of(world, world.floor.frame)
    whole = all_runs(sweep)
    banded = BandedRuns(sweep, whole.nbytes / 3, 10_000)
    assert (banded.masks() == whole.masks()).all()
    assert max(band.runs.nbytes for band in banded._kept) <= whole.nbytes / 3
    assert len(banded._kept) <= 2


def test_the_limit_stops_the_work(rng):
    world = cluttered_world(rng)
    done = []
    with pytest.raises(TooManyRuns) as found:
        all_runs(sweep_of(world, world.floor.frame), limit=20_000, tick=lambda *a: done.append(a))
    assert found.value.n_bytes > 20_000
    assert found.value.done == len(done) + 1 < 70


def test_no_landmarks_need_no_bands(rng):
    world = cluttered_world(rng).with_landmarks(LandmarkSet.empty())
    assert not compute_visibility(world, world.floor.frame, max_run_bytes=0).masks().any()
    assert BandedRuns(sweep_of(world, world.floor.frame, max_range=math.inf), 0, 1).counts().shape == (0,)
