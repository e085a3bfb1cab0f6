"""Collision probability: bounds against simulation and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy.stats import norm

from maps.clearance import ClearanceIndex
from maps.floor_plan import FloorPlan
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.clock import Stopped
from planner.errors import InvalidProblem
from planner.kernels.risk import exceeds, isotropic_bound, principal_axes, sector_bound, sector_table
from planner.risk import cell_probabilities, collision_risk, risky_cells
from tests.worlds import world_from_ascii

ROOM = """
    #########
    #.......#
    #..##...#
    #.......#
    ####.####
    #.......#
    #########
"""


def hall(width=40.0, height=20.0):
    floor = FloorPlan((shapely.box(0.0, 0.0, width, height),))
    return ClearanceIndex.from_world(World("hall", floor, LandmarkSet((), np.empty((0, 2)))))


def covariance(large, small, azimuth):
    c, s = math.cos(azimuth), math.sin(azimuth)
    turn = np.array([[c, -s], [s, c]])
    full = turn @ np.diag([large**2, small**2]) @ turn.T
    return np.array([full[0, 0], full[0, 1], full[1, 1]])


def test_principal_axes(rng):
    for _ in range(50):
        large, small = sorted(rng.uniform(0.01, 2.0, 2))[::-1]
        azimuth = rng.uniform(-1.5, 1.5)
        got = principal_axes(*covariance(large, small, azimuth))
        np.testing.assert_allclose(got, (large, small, azimuth), rtol=1e-9)


@pytest.mark.parametrize("azimuth", [0.0, 0.7, math.pi / 2])
@pytest.mark.parametrize("gap", [0.2, 0.5, 1.0])
def test_one_wall_is_a_half_plane(azimuth, gap):
    index = hall()
    c = covariance(0.4, 0.1, azimuth)
    risk = collision_risk(index, [[20.0, 0.3 + gap]], [c], 0.3)
    exact = norm.cdf(-gap / math.sqrt(c[2]))
    assert exact <= risk.tight[0] * (1 + 1e-9)
    assert risk.tight[0] <= risk.rigorous[0]
    assert risk.rigorous[0] == pytest.approx(math.exp(-(gap**2) / (2 * 0.4**2)))
    if exact > 1e-5:
        assert risk.tight[0] <= 1.8 * exact


def test_bounds_hold_in_simulation(rng):
    index = ClearanceIndex.from_world(world_from_ascii(ROOM, resolution=0.5))
    tight = []
    for _ in range(60):
        point = rng.uniform([0.6, 0.6], [3.9, 2.9])
        if index.distance([point])[0] < 0.21:
            continue
        c = covariance(*sorted(rng.uniform(0.02, 0.25, 2))[::-1], rng.uniform(-1.5, 1.5))
        risk = collision_risk(index, [point], [c], 0.2)
        full = np.array([[c[0], c[1]], [c[1], c[2]]])
        places = rng.multivariate_normal(point, full, 20_000)
        hit = float(np.mean(index.distance(places) < 0.2))
        deviation = math.sqrt(max(hit, 1e-4) / 20_000)
        assert hit <= risk.tight[0] + 4 * deviation
        assert risk.tight[0] <= risk.rigorous[0] <= 1.0
        if hit > 0.02:
            tight.append(risk.tight[0] / hit)
    assert len(tight) > 10
    # Places behind a corner count as reached: the star is smaller than what is free.
    assert np.median(tight) < 1.4


def test_touching_and_unknown():
    index = hall()
    c = covariance(0.1, 0.1, 0.0)
    risk = collision_risk(
        index, [[20.0, 0.2], [-1.0, 5.0], [20.0, 10.0], [20.0, 10.0]], [c, c, np.full(3, np.nan), 0 * c], 0.3
    )
    np.testing.assert_array_equal(risk.rigorous, [1.0, 1.0, np.nan, 0.0])
    np.testing.assert_array_equal(risk.tight, [1.0, 1.0, np.nan, 0.0])
    assert isotropic_bound(0.0, *c) == 1.0
    for points, covariances in (([[0.0]], [c]), ([[1.0, 2.0]], [[1.0]])):
        with pytest.raises(InvalidProblem, match="give"):
            collision_risk(index, points, covariances, 0.3)


@pytest.mark.parametrize("limit", [1e-3, 0.05])
def test_cells_are_sorted_out_as_reported(rng, limit):
    world = world_from_ascii(ROOM, resolution=0.5)
    index = ClearanceIndex.from_world(world)
    frame = world.grid_frame(0.25)
    centres = frame.centres()
    clearance = np.asarray(index.at_centres(frame))
    covariances = np.empty((*frame.shape, 3))
    for at in np.ndindex(frame.shape):
        covariances[at] = covariance(*sorted(rng.uniform(0.01, 0.2, 2))[::-1], rng.uniform(-1.5, 1.5))
    covariances[3, 3] = np.nan
    risky = risky_cells(index, frame, clearance, covariances, radius=0.2, limit=limit)
    one = risky_cells(index, frame, clearance, covariances, radius=0.2, limit=limit, threads=1)
    np.testing.assert_array_equal(risky, one)
    free = clearance > 0
    risk = collision_risk(index, centres[free], covariances[free], 0.2)
    # The finer bound of reports lies below the one that sorts out: never the other way round.
    assert not (~risky[free] & (risk.tight > limit * (1 + 1e-9))).any()
    assert risky[free].sum() >= np.count_nonzero(risk.tight > limit)
    assert (risk.tight[risky[free]] > 0.6 * limit).all()
    assert not risky[3, 3]
    probability = cell_probabilities(index, frame, clearance, covariances, radius=0.2)
    np.testing.assert_array_equal(np.nan_to_num(probability) > limit, risky)
    np.testing.assert_array_equal(np.isnan(probability), ~free | np.isnan(covariances[..., 0]))
    for wrong in (0.0, 1.0, math.nan):
        with pytest.raises(InvalidProblem, match="between 0 and 1"):
            risky_cells(index, frame, clearance, covariances, radius=0.2, limit=wrong)


def test_some_cells_alone_and_stopped(rng):
    world = world_from_ascii(ROOM, resolution=0.5)
    index = ClearanceIndex.from_world(world)
    frame = world.grid_frame(0.1)
    clearance = np.asarray(index.at_centres(frame))
    covariances = np.tile(covariance(0.15, 0.05, 0.4), (*frame.shape, 1))
    options = {"radius": 0.15, "limit": 0.02}
    every = risky_cells(index, frame, clearance, covariances, **options)
    some = rng.random(frame.shape) < 0.5
    found = risky_cells(index, frame, clearance, covariances, among=some, **options)
    np.testing.assert_array_equal(found, every & some)
    assert 0.1 < every[clearance > 0].mean() < 0.95
    values = cell_probabilities(index, frame, clearance, covariances, radius=0.15, among=some)
    np.testing.assert_array_equal(np.isfinite(values), some & (clearance > 0))
    for judge in (risky_cells, cell_probabilities):
        asked = options if judge is risky_cells else {"radius": 0.15}
        with pytest.raises(Stopped):
            judge(index, frame, clearance, covariances, stop=np.ones(1, dtype=np.uint8), **asked)


def test_far_cells_are_decided_as_by_the_sectors(rng):
    """The decision with few sectors is that of all of them."""
    world = world_from_ascii(ROOM, resolution=0.5)
    index = ClearanceIndex.from_world(world)
    args = index.arrays
    table = sector_table(64)
    shares = np.empty(64)
    above = 0
    for _ in range(400):
        x, y = rng.uniform([0.5, 0.5], [4.0, 3.0])
        here = float(index.distance([[x, y]])[0])
        c = covariance(*sorted(10 ** rng.uniform(-2.5, 0, 2))[::-1], rng.uniform(-1.5, 1.5))
        p = sector_bound(x, y, here, *c, 0.1, table, *args)
        for limit in (1e-4, 0.01, 0.3):
            assert exceeds(x, y, here, *c, 0.1, table, limit, shares, *args) == (p > limit)
        above += p > 0.01
    assert 50 < above < 380
