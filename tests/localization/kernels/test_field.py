"""The loop over cells: masks, orders, and independence of every cell from its neighbours."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.kernels.field import field_tile, ranked_at
from localization.kernels.fix import triplet_fix
from localization.kernels.seen import TOUCH_M, inverted, strongest_first, visible_indices
from localization.kernels.triplets import strong_pairs
from localization.sensors import LASER, kernel_args
from tests import oracles
from tests.triplet_arrays import SENSORS, nearest_first


def masks_of(visible):
    """(h, w, N) bool to (h, w, n_words) uint64."""
    h, w, n = visible.shape
    out = np.zeros((h, w, max(1, -(-n // 64))), dtype=np.uint64)
    for r, c, i in zip(*np.nonzero(visible), strict=True):
        out[r, c, i // 64] |= np.uint64(1) << np.uint64(i % 64)
    return out


def run(centres, free, visible, landmarks, sigmas, sensor, heading=0.0):
    shape = free.shape
    out = (
        np.full((*shape, 3), np.nan),
        np.full(shape, np.nan),
        np.full((*shape, 3), -1, dtype=np.int16),
        np.full(shape, np.nan),
        np.zeros(shape, dtype=np.int16),
        np.full(shape, np.nan, dtype=np.float32),
    )
    survey = np.asarray(sigmas) ** 2
    args = (
        centres,
        free,
        masks_of(visible),
        landmarks,
        survey,
        bool(survey.any()),
        kernel_args(sensor, heading),
    )
    field_tile(*args, *out)
    return out


def scene(rng, shape, n, *, surveyed=False):
    gx, gy = np.meshgrid(np.arange(shape[1]) * 0.4 - 2.0, np.arange(shape[0]) * 0.4 - 1.0)
    landmarks = rng.uniform(-8, 8, (n, 2))
    visible = rng.random((*shape, n)) < 0.8
    free = rng.random(shape) < 0.9
    sigmas = rng.uniform(0, 0.05, n) if surveyed else np.zeros(n)
    return np.stack([gx, gy], -1), free, visible, landmarks, sigmas


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("surveyed", [False, True])
def test_every_cell_is_the_ranking_at_its_place(rng, name, surveyed):
    sensor = SENSORS[name]
    heading = 0.7 if sensor.depends_on_heading else 0.0
    centres, free, visible, landmarks, sigmas = scene(rng, (5, 6), 14, surveyed=surveyed)
    covariance, sigma_theta, triplet, pan, n_visible, validity = run(
        centres, free, visible, landmarks, sigmas, sensor, heading
    )
    args = kernel_args(sensor, heading)
    fixes = 0
    for r, c in np.ndindex(free.shape):
        if not free[r, c]:
            assert n_visible[r, c] == 0
            assert triplet[r, c].tolist() == [-1, -1, -1]
            continue
        x, y = oracles.sensor_place(centres[r, c], sensor, heading)
        seen = [
            i
            for i in np.flatnonzero(visible[r, c])
            if oracles.is_measurable((x, y), landmarks[i], sensor, heading)
        ]
        seen = np.array(seen, dtype=np.int64)
        values, best = np.empty(1), np.empty((1, 3), dtype=np.int64)
        found = ranked_at(x, y, seen, landmarks, sigmas**2, args, values, best)
        assert n_visible[r, c] == len(seen)
        if not found:
            assert np.isnan(covariance[r, c]).all()
            assert np.isnan(validity[r, c])
            continue
        assert 0.0 <= validity[r, c] <= 1.0
        fixes += 1
        i, j, k = (int(t) for t in triplet[r, c])
        assert i < j < k
        xx, xy, yy, heading_variance, axis = triplet_fix(x, y, i, j, k, landmarks, sigmas**2, args)
        rtol = 1e-9 if sensor.mount.lever > 0 else 0.0  # the sensor's place differs by rounding
        np.testing.assert_allclose(covariance[r, c], [xx, xy, yy], rtol=rtol)
        assert sigma_theta[r, c] == pytest.approx(math.sqrt(heading_variance), rel=rtol)
        np.testing.assert_allclose(pan[r, c], axis, rtol=rtol)
        assert xx * yy - xy * xy == pytest.approx(1.0 / values[0], rel=1e-9)
        if sensor.kind != "omnidirectional" or sensor.mount.lever > 0 or surveyed:
            assert [i, j, k] == best[0].tolist()
    assert fixes > 3


@pytest.mark.parametrize("name", ["laser", "mas97", "limited optimal"])
def test_cells_do_not_depend_on_the_window(rng, name):
    centres, free, visible, landmarks, sigmas = scene(rng, (9, 10), 70)
    # Regular landmarks make many equal triplets.
    landmarks[:49] = np.stack(np.meshgrid(np.arange(7) - 3.0, np.arange(7) - 3.0), -1).reshape(-1, 2) + 0.03
    whole = run(centres, free, visible, landmarks, sigmas, SENSORS[name])
    for rows in (slice(0, 4), slice(4, 9)):
        for cols in (slice(0, 1), slice(1, 10)):
            at = (rows, cols)
            part = run(
                np.ascontiguousarray(centres[at]), free[at], visible[at], landmarks, sigmas, SENSORS[name]
            )
            for a, b in zip(part, whole, strict=True):
                np.testing.assert_array_equal(a, b[at])
    back = (slice(None, None, -1), slice(None, None, -1))
    turned = run(
        np.ascontiguousarray(centres[back]), free[back], visible[back], landmarks, sigmas, SENSORS[name]
    )
    for a, b in zip(turned, whole, strict=True):
        np.testing.assert_array_equal(a[back], b)


@pytest.mark.parametrize("name", ["mas97", "limited", "wide"])
def test_landmarks_on_walls_use_the_other_search(rng, name):
    sensor = SENSORS[name]
    centres, free, _, _, _ = scene(rng, (4, 5), 40)
    t, wall = rng.uniform(-9, 9, 40), rng.integers(0, 4, 40)
    nine = np.full(40, 9.0)
    landmarks = np.column_stack([np.choose(wall, [t, nine, t, -nine]), np.choose(wall, [-nine, t, nine, t])])
    visible = np.ones((*free.shape, 40), dtype=bool)
    out = run(centres, free, visible, landmarks, np.zeros(40), sensor)
    strong = 0
    for r, c in zip(*np.nonzero(free), strict=True):
        values, best = np.empty(1), np.empty((1, 3), dtype=np.int64)
        args = kernel_args(sensor)
        seen = np.arange(40)
        assert ranked_at(*centres[r, c], seen, landmarks, np.zeros(40), args, values, best) == 1
        assert out[2][r, c].tolist() == best[0].tolist()
        _, _, _, rho, _, survey = nearest_first(centres[r, c], landmarks, np.zeros(40))
        strong += strong_pairs(40, rho, survey, args, values[0]) > 40 * 4
    assert strong > 5


def test_visible_indices(rng):
    for n in (1, 63, 64, 65, 200):
        for share in (0.0, 0.05, 1.0):
            seen = rng.random(n) < share
            out = np.empty(n, dtype=np.int64)
            found = visible_indices(masks_of(seen[None, None])[0, 0], out)
            assert out[:found].tolist() == np.flatnonzero(seen).tolist()


def test_strongest_first_from_any_start(rng):
    n_all = 30
    strength = rng.integers(1, 6, n_all).astype(float)  # with ties
    seen = np.sort(rng.choice(n_all, 17, replace=False))
    want = sorted(seen.tolist(), key=lambda i: (-strength[i], i))
    for n_last in (0, 5, 30):
        last = rng.permutation(n_all)
        mark, order = np.zeros(n_all, dtype=np.int8), np.empty(17, dtype=np.int64)
        strongest_first(17, seen, strength, last, n_last, mark, order)
        assert order.tolist() == want
        assert not mark.any()


def test_inverted(rng):
    landmarks, point, sigmas = rng.uniform(-8, 8, (6, 2)), rng.uniform(-3, 3, 2), rng.uniform(0, 0.1, 6)
    order, *want = nearest_first(point, landmarks, sigmas, 0.4)
    out = [np.empty(6) for _ in range(5)]
    inverted(point[0], point[1], 6, order, landmarks, sigmas**2, kernel_args(LASER, 0.4), True, *out)
    for a, b in zip(out, want, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_landmark_under_the_robot_does_not_count():
    landmarks = np.array([[0.0, 0.0], [3.0, 1.0], [-2.0, 2.0], [1.0, -3.0]])
    centres = np.array([[[0.0, 0.0], [0.9 * TOUCH_M, 0.0], [1.1 * TOUCH_M, 0.0]]])
    visible = np.ones((1, 3, 4), dtype=bool)
    out = run(centres, np.ones((1, 3), dtype=bool), visible, landmarks, np.zeros(4), SENSORS["laser"])
    assert out[4].tolist() == [[3, 3, 4]]
    assert out[2][0, 0].tolist() == [1, 2, 3]
    assert 0 in out[2][0, 2]
    assert np.isfinite(out[0]).all()
