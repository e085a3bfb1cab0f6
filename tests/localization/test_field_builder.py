"""Whole fields: equal to the choice at every place, whatever the threads, tiles, frame or order."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from shapely.affinity import rotate, translate
from shapely.geometry import box

from localization import field_builder
from localization.covariance import CHI2_95
from localization.errors import Cancelled, FieldTooLarge
from localization.field_builder import build_field, warm_up
from localization.sensors import LASER, MAS97_CAMERA, OmnidirectionalSensor, kernel_args
from localization.tiles import tile_windows
from localization.triplets import best_triplet
from maps.arrays import frozen
from maps.errors import InvalidGeometry, TooFewLandmarks
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.io.load import load_world
from maps.io.site import bundled_site
from maps.landmarks import LandmarkSet
from maps.visibility import compute_visibility, visible_landmarks
from maps.world import World
from tests.benchmarks.bench_triplets import least_by_enumeration
from tests.worlds import world_from_ascii

HALL = """
    #########################
    #A..........B..........C#
    #.......................#
    #....#####..............#
    #D...#####..............#
    #.............####......E
    #.............####......#
    #.......................#
    #F.........G...........H#
    #########################
"""
SENSORS = {
    "laser": LASER,
    "mas97": MAS97_CAMERA,
    "optimal": replace(MAS97_CAMERA, pan_policy="optimal", max_range=9.0),
    "limited": replace(MAS97_CAMERA, field_of_view=1.3, pan_min=-1.0, pan_max=1.5, min_range=1.0),
}


def same(a, b):
    for name in ("free", "covariance", "sigma_theta", "triplet", "pan", "n_visible"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def plan_world(landmarks=None):
    """A room with a pillar and a pit, as polygons."""
    floor = FloorPlan((box(0, 0, 9, 6),), (box(3, 2, 4, 4), box(6, 1, 7, 2)), (True, False))
    if landmarks is None:
        landmarks = [[0.0, 1.0], [0.0, 5.0], [4.0, 0.0], [9.0, 2.5], [5.0, 6.0], [8.0, 6.0], [2.0, 6.0]]
    ids = tuple(f"m{i}" for i in range(len(landmarks)))
    return World("plan", floor, LandmarkSet(ids, landmarks))


@pytest.mark.parametrize("name", SENSORS)
def test_every_cell_is_the_best_triplet_at_its_centre(name):
    sensor = SENSORS[name]
    for world in (world_from_ascii(HALL), plan_world()):
        field = build_field(world, sensor, resolution=0.5, heading=0.6)
        centres = field.frame.centres()
        np.testing.assert_array_equal(field.free, world.floor.free_at(centres))
        fixes = 0
        for row, col in np.ndindex(field.frame.shape):
            choice = best_triplet(world, sensor, centres[row, col], heading=field.heading)
            if choice is None:
                assert field.triplet[row, col].tolist() == [-1, -1, -1]
                assert np.isnan(field.covariance[row, col]).all()
                assert np.isnan(field.sigma_theta[row, col])
                assert np.isnan(field.pan[row, col])
                if field.free[row, col]:
                    seen = visible_landmarks(
                        world, centres[row, col][None], min_range=sensor.min_range, max_range=sensor.max_range
                    )
                    assert field.n_visible[row, col] == np.count_nonzero(seen)
                else:
                    assert field.n_visible[row, col] == 0
                continue
            fixes += 1
            assert tuple(field.triplet[row, col]) == choice.triplet
            assert field.covariance[row, col].tolist() == choice.covariance.tolist()
            assert field.sigma_theta[row, col] == choice.sigma_theta
            np.testing.assert_array_equal(field.pan[row, col], choice.pan)
            assert field.n_visible[row, col] == choice.n_visible
        assert fixes > 20


@pytest.mark.parametrize("name", SENSORS)
def test_threads_and_tiles_do_not_matter(name, monkeypatch):
    world = world_from_ascii(HALL)
    want = build_field(world, SENSORS[name], resolution=0.2, heading=0.3, threads=1)
    for tile, threads in ((128, 3), (7, 2), (1000, 1)):
        monkeypatch.setattr(field_builder, "tile_windows", lambda shape, tile=tile: tile_windows(shape, tile))
        same(build_field(world, SENSORS[name], resolution=0.2, heading=0.3, threads=threads), want)


def test_heading_matters_only_with_pan_limits():
    world = world_from_ascii(HALL)
    for name in ("laser", "mas97"):
        field = build_field(world, SENSORS[name], resolution=0.5, heading=1.0)
        assert field.heading == 0.0
        same(field, build_field(world, SENSORS[name], resolution=0.5))
    turned = build_field(world, SENSORS["limited"], resolution=0.5, heading=7.0)
    assert turned.heading == pytest.approx(7.0 - 2 * math.pi)
    assert (turned.has_fix != build_field(world, SENSORS["limited"], resolution=0.5).has_fix).any()
    pan = turned.pan[turned.has_fix]
    assert (pan >= -1.0 - 1e-9).all()
    assert (pan <= 1.5 + 1e-9).all()


def test_permuted_landmarks_give_the_same_areas():
    world = world_from_ascii(HALL)
    order = np.random.default_rng(3).permutation(len(world.landmarks))
    for sensor in SENSORS.values():
        a = build_field(world, sensor, resolution=0.5)
        b = build_field(world.with_landmarks(world.landmarks.subset(order)), sensor, resolution=0.5)
        np.testing.assert_allclose(b.area95, a.area95, rtol=1e-9)


@pytest.mark.parametrize("name", ["laser", "mas97", "optimal"])
def test_moving_and_turning_the_world_moves_and_turns_the_field(name):
    world, turn, shift = plan_world(), math.pi / 2, np.array([30.0, -7.0])
    plan = world.floor

    def moved(p):
        return translate(rotate(p, 90, origin=(0, 0)), *shift)

    floor = FloorPlan(tuple(map(moved, plan.floor)), tuple(map(moved, plan.obstacles)), plan.opaque)
    x, y = world.landmarks.positions.T
    landmarks = LandmarkSet(world.landmarks.ids, np.column_stack([-y, x]) + shift)
    a = build_field(world, SENSORS[name], resolution=0.25)
    b = build_field(World("moved", floor, landmarks), SENSORS[name], resolution=0.25)
    # Row r, column c of the first is row c, column (last - r) of the second.
    same_cells = b.area95.T[::-1]
    agree = np.isnan(same_cells) == np.isnan(a.area95)
    assert np.mean(agree) > 0.98  # sight lines that graze a corner may fall either way
    both = ~np.isnan(same_cells) & ~np.isnan(a.area95)
    close = np.isclose(same_cells[both], a.area95[both], rtol=1e-8)
    assert np.mean(close) > 0.98
    if name != "laser":
        cells = np.flatnonzero(both)[close]
        change = b.pan.T[::-1].ravel()[cells] - a.pan.ravel()[cells]
        assert np.mean(np.abs(np.exp(1j * (change - turn)) - 1) < 1e-6) > 0.95


def test_doubling_the_world_doubles_the_ellipses():
    # Bearings have no scale.
    world = plan_world()
    double = World(
        "double",
        FloorPlan((box(0, 0, 18, 12),), (box(6, 4, 8, 8), box(12, 2, 14, 4)), (True, False)),
        LandmarkSet(world.landmarks.ids, 2 * world.landmarks.positions),
    )
    for sensor in (OmnidirectionalSensor(0.002), MAS97_CAMERA):
        a, b = build_field(world, sensor, resolution=0.25), build_field(double, sensor, resolution=0.5)
        np.testing.assert_allclose(b.r95, 2 * a.r95, rtol=1e-9)
        np.testing.assert_allclose(b.sigma_theta, a.sigma_theta, rtol=1e-9)


@pytest.mark.parametrize("name", SENSORS)
def test_more_landmarks_are_never_worse(name):
    world = world_from_ascii(HALL)
    areas = []
    for n in range(3, len(world.landmarks) + 1):
        some = world.with_landmarks(world.landmarks.subset(range(n)))
        areas.append(np.nan_to_num(build_field(some, SENSORS[name], resolution=0.5).area95, nan=np.inf))
    for few, more in itertools.pairwise(areas):
        assert (more <= few * (1 + 1e-9)).all()
    assert (areas[-1] < areas[0]).any()


def test_turned_grid():
    frame = GridFrame(3.0, -2.0, 0.4, 0.5, 12, 16)
    free = np.ones(frame.shape, dtype=bool)
    free[5:7, 6:9] = False
    floor = OccupancyGrid(frame, free, ~free)
    landmarks = LandmarkSet(
        tuple("abcde"), frame.to_world([[0.5, 0.5], [15.5, 1.5], [8.5, 11.5], [1.5, 9.5], [15.5, 10.5]])
    )
    world = World("turned", floor, landmarks)
    for resolution in (0.5, 0.3):
        field = build_field(world, LASER, resolution=resolution)
        assert field.frame.yaw == 0.4
        centres = field.frame.centres()
        np.testing.assert_array_equal(field.free, floor.free_at(centres))
        row, col = 2, 3
        choice = best_triplet(world, LASER, centres[row, col])
        assert field.covariance[row, col].tolist() == choice.covariance.tolist()


def test_progress_rises_to_its_total():
    calls = []
    build_field(world_from_ascii(HALL), LASER, resolution=0.05, progress=lambda d, t: calls.append((d, t)))
    done = [d for d, _ in calls]
    assert done[0] == 0
    assert done == sorted(set(done))
    assert {t for _, t in calls} == {done[-1]}
    assert len(calls) > 5


@pytest.mark.parametrize("after", [0, 3, 12])
def test_cancelling_stops_at_any_step(after):
    seen = []

    def cancelled():
        seen.append(1)
        return len(seen) > after

    with pytest.raises(Cancelled):
        build_field(world_from_ascii(HALL), LASER, resolution=0.02, cancelled=cancelled)
    assert len(seen) == after + 1


def test_errors_of_the_caller():
    world = world_from_ascii(HALL)
    with pytest.raises(FieldTooLarge, match="use a resolution of"):
        build_field(world, LASER, resolution=0.01, max_cells=10_000)
    with pytest.raises(FieldTooLarge):
        build_field(world, LASER, resolution=1e-6)
    with pytest.raises(FieldTooLarge):
        build_field(plan_world(), LASER, resolution=1e-5)
    for resolution in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InvalidGeometry):
            build_field(world, LASER, resolution=resolution)
    with pytest.raises(TooFewLandmarks):
        build_field(world.with_landmarks(world.landmarks.subset([0, 1])), LASER)


def test_too_large_names_a_resolution_that_works():
    world = world_from_ascii(HALL)
    for limit in (1000, 3000, 4567):
        with pytest.raises(FieldTooLarge) as caught:
            build_field(world, LASER, resolution=0.05, max_cells=limit)
        words = str(caught.value).split()
        enough = float(words[words.index("of", words.index("resolution")) + 1])
        assert enough < 1.0
        assert build_field(world, LASER, resolution=enough, max_cells=limit).has_fix.any()


def test_warm_up_is_enough():
    warm_up()
    warm_up()


def test_bundled_sites_have_good_and_bad_places():
    for name, sensor in (("mas97_room", MAS97_CAMERA), ("warehouse", LASER)):
        field = build_field(bundled_site(name), sensor, resolution=0.25)
        fix = field.has_fix[field.free]
        assert 0.5 < np.mean(fix) < 1.0
        r95 = field.r95[field.has_fix]
        assert np.percentile(r95, 95) > 3 * np.percentile(r95, 5)


@pytest.mark.parametrize("name", ["mas97_room", "warehouse"])
@pytest.mark.parametrize("sensor", [LASER, MAS97_CAMERA], ids=["laser", "mas97"])
def test_every_cell_of_the_bundled_sites_equals_enumeration(name, sensor):
    world = bundled_site(name)
    field = build_field(world, sensor, resolution=0.5 if name == "warehouse" else 0.25)
    visible = compute_visibility(world, field.frame, max_range=sensor.max_range).masks()
    area95 = field.area95
    centres = field.frame.centres()
    args = kernel_args(sensor)
    variance = args[1]
    positions = world.landmarks.positions
    assert not world.landmarks.sigma.any()
    compared = 0
    for row, col in zip(*np.nonzero(field.free), strict=True):
        words = visible[row, col]
        seen = [i for i in range(len(positions)) if int(words[i // 64]) >> (i % 64) & 1]
        assert field.n_visible[row, col] == len(seen)
        x, y = centres[row, col]
        best = variance / math.sqrt(least_by_enumeration(x, y, frozen(positions[seen]), args))
        if not field.has_fix[row, col]:
            assert best * 100.0 < 1e-6  # nothing, or a danger circle
            continue
        compared += 1
        assert area95[row, col] == pytest.approx(math.pi * CHI2_95 * variance / best, rel=1e-9)
    assert compared > 1000


def test_plant_with_its_real_reflectors(shared_data):
    world = load_world(shared_data / "landmark_maps" / "cob" / "ipa-production-plant")
    assert len(world.landmarks) == 48
    field = build_field(world, LASER, resolution=0.25)
    assert 0.5 < np.mean(field.has_fix[field.free]) < 0.85
    assert np.nanmedian(field.r95) < 0.1
    rows, cols = np.nonzero(field.has_fix)
    centres = field.frame.centres()
    for at in np.random.default_rng(1).choice(len(rows), 25, replace=False):
        row, col = rows[at], cols[at]
        choice = best_triplet(world, LASER, centres[row, col])
        assert choice.covariance.tolist() == field.covariance[row, col].tolist()
