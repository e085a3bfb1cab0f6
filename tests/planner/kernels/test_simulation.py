"""The compiled closed loop against its plain twin, draw by draw."""

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.motion import OdometryModel
from localization.sensors import (
    FORWARD_CAMERA,
    LASER,
    MAS97_CAMERA,
    Mount,
    OmnidirectionalSensor,
)
from localization.triplets import best_triplet
from maps.clearance import ClearanceIndex
from maps.io.site import bundled_site
from maps.landmarks import LandmarkSet
from maps.visibility import visible_landmarks
from planner.choices import choices_of
from planner.kernels import follower as follow
from planner.kernels import simulation as kernel
from planner.pose_timing import MotionLimits, time_poses
from planner.reference import reference_of
from planner.simulation import SimulatedRobot, _draws, _drive, _kernel_args, _stops, fix_stations
from planner.steering import PoseCurve
from planner.timing import time_polyline
from tests import oracles

ROOM = bundled_site("mas97_room")
START = np.diag([0.03, 0.02, 0.01]) ** 2 + 1e-5
NOISE = OdometryModel(0.03, 0.05, 0.02, 0.01)
WAY = [[3.0, 3.0], [4.2, 3.2], [4.5, 4.0]]


def compiled(robot, sensor, world, *, seed, runs=3, way=WAY):
    """Runs along a polyline, or a motion with headings."""
    reference = reference_of(
        time_polyline(way, max_speed=1.0, max_accel=1.0) if isinstance(way, list) else way,
        step=robot.step,
        steering=robot.steering,
        max_turn_rate=0.8 * robot.max_turn_rate,
    )
    is_fix = fix_stations(reference.times, robot.fix_rate)
    choices = choices_of(world, sensor, reference=reference, is_fix=is_fix, policy=robot.policy)
    stops = _stops(reference)
    args = _kernel_args(world, choices, reference, is_fix=is_fix, stops=stops, robot=robot, P0=START.copy())
    draws = _draws(reference, is_fix, world)
    seeds = np.random.default_rng(seed).integers(0, 2**63, size=runs)
    per_run, per_station, tracks = _drive(args, draws, len(stops), seeds=seeds, threads=1, stop=None)
    normals = [np.random.default_rng(int(s)).standard_normal(draws) for s in seeds]
    return reference, is_fix, choices, normals, per_run, per_station, tracks


CASES = {
    "laser": (LASER, {}),
    "laser off centre with a floor": (
        OmnidirectionalSensor(
            bearing_sigma=0.004, max_range=30.0, bearing_floor=0.003, mount=Mount(0.4, -0.2, 0.5)
        ),
        {},
    ),
    "single fixes": (LASER, {"mode": "fix"}),
    "single fixes off centre": (replace(LASER, mount=Mount(0.3, 0.2, -0.4)), {"mode": "fix"}),
    "holonomic": (LASER, {"steering": "holonomic"}),
    "pan camera": (MAS97_CAMERA, {}),
    "fixed camera": (replace(FORWARD_CAMERA, field_of_view=1.4, mount=Mount(0.2, 0.0, 0.1)), {}),
}


def test_a_car_that_backs_is_the_twin_s():
    robot = SimulatedRobot(radius=0.3, odometry=NOISE, step=0.1, min_turn_radius=0.9)
    shape = PoseCurve(np.array([5.0, 5.0, 0.3]), np.array([[1.0, 1.0, 0], [-1.5, -0.5, 0], [0.5, 0.0, 0]]))
    way = time_poses(shape, MotionLimits(1.0, 1.0)).to_trajectory()
    reference, is_fix, choices, normals, _, _, tracks = compiled(robot, LASER, ROOM, seed=5, runs=3, way=way)
    assert reference.increments("differential")[0].min() < -0.02
    walls = ClearanceIndex.from_world(ROOM).segments
    for r, draw in enumerate(normals):
        expected, _ = oracles.driven_once(
            draw, reference.poses, is_fix, lambda k, _: list(choices.planned[k]), ROOM, LASER, robot, START,
            lambda place, i: bool(visible_landmarks(ROOM, [place], max_range=30.0)[0, i]), walls,
        )  # fmt: skip
        np.testing.assert_allclose(tracks[r], expected, atol=2e-6)


@pytest.mark.parametrize("name", CASES)
def test_runs_are_those_of_the_twin(name):
    sensor, options = CASES[name]
    surveyed = name in {"laser", "pan camera", "single fixes"}
    landmarks = ROOM.landmarks
    world = ROOM
    if surveyed:
        sigma = np.full(len(landmarks), 0.01)
        world = ROOM.with_landmarks(
            LandmarkSet(landmarks.ids, landmarks.positions, landmarks.facing, landmarks.half_angle, sigma)
        )
    robot = SimulatedRobot(radius=0.3, odometry=NOISE, step=0.1, **options)
    reference, is_fix, choices, normals, per_run, _, tracks = compiled(robot, sensor, world, seed=11, runs=1)
    walls = ClearanceIndex.from_world(world).segments

    def triplets(k, _):
        three = choices.planned[k]
        return None if three[0] < 0 else [int(i) for i in three]

    def sees(place, i):
        ranges = {"min_range": sensor.min_range, "max_range": sensor.max_range}
        return bool(visible_landmarks(world, [place], **ranges)[0, i])

    for r, draw in enumerate(normals):
        expected, hit = oracles.driven_once(
            draw, reference.poses, is_fix, triplets, world, sensor, robot, START, sees, walls
        )
        assert (-1 if hit is None else hit) == per_run[r, kernel.HIT_STEP]
        np.testing.assert_allclose(tracks[r], expected, atol=2e-6)
    assert per_run[:, kernel.FIXES].min() > 6
    assert per_run[:, kernel.MISSED].max() < 0.7 * per_run[:, kernel.FIXES].min()


def test_a_run_along_a_wall_ends_where_the_twin_ends():
    noisy = OdometryModel(0.1, 0.2, 0.3)
    robot = SimulatedRobot(radius=0.3, odometry=noisy, step=0.1, fix_rate=0.5)
    way = [[0.5, 3.0], [0.5, 7.0]]
    reference, is_fix, choices, normals, per_run, _, tracks = compiled(
        robot, LASER, ROOM, seed=4, runs=4, way=way
    )
    walls = ClearanceIndex.from_world(ROOM).segments
    hits = []
    for r, draw in enumerate(normals):
        expected, hit = oracles.driven_once(
            draw, reference.poses, is_fix, lambda k, _: list(choices.planned[k]), ROOM, LASER, robot, START,
            lambda place, i: bool(visible_landmarks(ROOM, [place], max_range=30.0)[0, i]), walls,
        )  # fmt: skip
        hits.append(-1 if hit is None else hit)
        np.testing.assert_allclose(tracks[r], expected, atol=2e-6)
    np.testing.assert_array_equal(per_run[:, kernel.HIT_STEP], hits)
    assert max(hits) > 0


def test_a_polygon_touches_where_its_sides_corners_or_centre_meet_a_wall():
    rng = np.random.default_rng(8)
    walls = ClearanceIndex.from_world(ROOM)
    arrays = tuple(np.array(a) for a in walls.arrays)
    shape = np.array([[0.6, 0.3], [-0.4, 0.3], [-0.4, -0.3], [0.6, -0.3]])
    hits = 0
    for _ in range(300):
        a = np.array([*rng.uniform(-0.2, 15.2, 2), rng.uniform(-math.pi, math.pi)])
        b = a + rng.normal(0, [0.1, 0.1, 0.1])

        def corners(pose):
            c, s = math.cos(pose[2]), math.sin(pose[2])
            return pose[:2] + shape @ np.array([[c, s], [-s, c]])

        ways = [(*a[:2], *b[:2])]
        ways += [(*p, *q) for p, q in zip(corners(a), corners(b), strict=True)]
        ways += [(*p, *q) for p, q in zip(corners(b), np.roll(corners(b), 1, axis=0), strict=True)]
        expected = any(oracles.segment_to_segments(way, walls.segments) == 0 for way in ways)
        assert follow.touches(a, b, shape, 0.68, arrays) == expected
        hits += expected
    assert 20 < hits < 280


def test_cells_are_looked_up_by_the_believed_place():
    table = np.array([1.0, 2.0, math.cos(0.3), math.sin(0.3), 0.5, 4.0, 6.0, 8.0])
    triplets = np.arange(8 * 4 * 6 * 3, dtype=np.int16).reshape(-1, 3)
    three, none = np.empty(3, dtype=np.int64), np.empty(0, dtype=np.int64)
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(200):
        mean = np.array([*rng.uniform(-1, 6, 2), rng.uniform(-math.pi, math.pi)])
        c, s = math.cos(0.3), math.sin(0.3)
        col, row = np.floor(np.array([[c, s], [-s, c]]) @ (mean[:2] - [1, 2]) / 0.5).astype(int)
        inside = 0 <= row < 4 and 0 <= col < 6
        assert kernel.choose(0, mean, 0.0, table, none, triplets, three) == inside
        if inside:
            nearest = min(range(8), key=lambda h: abs(math.remainder(mean[2] - h * math.pi / 4, 2 * math.pi)))
            np.testing.assert_array_equal(three, triplets[(nearest * 4 + row) * 6 + col])
            found += 1
    assert found > 20


def test_candidates_of_a_step_are_drawn_evenly():
    offsets = np.array([0, 2, 2, 6])
    triplets = np.arange(18, dtype=np.int16).reshape(6, 3)
    three = np.empty(3, dtype=np.int64)
    by_step, mean = np.zeros(8), np.zeros(3)
    assert not kernel.choose(1, mean, 0.0, by_step, offsets, triplets, three)
    drawn = []
    for draw in np.random.default_rng(2).standard_normal(4000):
        assert kernel.choose(2, mean, draw, by_step, offsets, triplets, three)
        drawn.append(three[0] // 3)
    counts = np.bincount(np.array(drawn), minlength=6)
    assert counts[:2].sum() == 0
    assert (np.abs(counts[2:] - 1000) < 120).all()


def test_best_candidates_are_the_best_triplets():
    robot = SimulatedRobot(step=0.1)
    reference, is_fix, choices, *_ = compiled(robot, MAS97_CAMERA, ROOM, seed=1, runs=1)
    for k in np.flatnonzero(is_fix)[::6]:
        x, y, heading = reference.poses[k]
        best = best_triplet(ROOM, MAS97_CAMERA, (x, y), heading=heading)
        assert tuple(choices.planned[k]) == best.triplet
