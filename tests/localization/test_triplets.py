"""Best triplet and ranking at a place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import box

from localization.errors import LocalizationError
from localization.sensors import LASER, MAS97_CAMERA
from localization.triplets import best_triplet, pack_masks, rank_triplets
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.visibility import visible_landmarks
from maps.world import World
from tests import oracles
from tests.triplet_arrays import SENSORS
from tests.worlds import place_in_ascii, world_from_ascii

HALL = """
    #####################
    #A........B........C#
    #...................#
    #....####...........#
    #D...####......s....#
    #....####...........E
    #...................#
    #F........G.........#
    #####################
"""


def open_world(landmarks, sigma=None):
    """Free cells of 1 m from -20 m to 20 m around the origin, nothing in the way."""
    frame = GridFrame(-20.0, -20.0, 0.0, 1.0, 40, 40)
    floor = OccupancyGrid(frame, np.ones((40, 40), dtype=bool), np.zeros((40, 40), dtype=bool))
    ids = tuple(f"m{i}" for i in range(len(landmarks)))
    return World("open", floor, LandmarkSet(ids, landmarks, sigma=sigma))


@pytest.mark.parametrize("name", SENSORS)
def test_best_and_ranking_against_enumeration(rng, name):
    sensor = SENSORS[name]
    compared = 0
    for _ in range(15):
        heading = rng.uniform(-6, 6) if sensor.depends_on_heading else 0.0
        sigma = rng.choice([0.0, 0.03], 8)
        world, point = open_world(rng.uniform(-9, 9, (8, 2)), sigma), rng.uniform(-3, 3, 2)
        want = oracles.ranked_triplets(point, world.landmarks.positions, sigma, sensor, heading)
        got = rank_triplets(world, sensor, point, heading=heading, count=100)
        best = best_triplet(world, sensor, point, heading=heading)
        assert len(got) == len(want)
        if not want:
            assert best is None
            continue
        compared += 1
        rel = 1e-5 if "optimal" in name else 1e-7
        areas = [math.pi * 5.991464547 * math.sqrt(d) for d, _ in want]
        np.testing.assert_allclose([c.area95 for c in got], areas, rtol=rel)
        assert best.area95 == pytest.approx(got[0].area95, rel=1e-9)
        place = oracles.sensor_place(point, sensor, heading)
        measurable = [oracles.is_measurable(place, m, sensor, heading) for m in world.landmarks.positions]
        assert best.n_visible == sum(measurable)
    assert compared > 0


def test_hidden_landmarks_take_no_part():
    world = world_from_ascii(HALL)
    point = place_in_ascii(HALL, "s")
    seen = visible_landmarks(world, np.array([point]))[0]
    assert not seen.all()
    best = best_triplet(world, LASER, point)
    assert seen[list(best.triplet)].all()
    assert best.n_visible == np.count_nonzero(seen)
    positions = world.landmarks.positions[seen]
    want = oracles.ranked_triplets(point, positions, np.zeros(len(positions)), LASER)[0][0]
    assert best.area95 == pytest.approx(math.pi * 5.991464547 * math.sqrt(want), rel=1e-9)


def test_range_limits():
    landmarks = np.array([[1.0, 0.0], [0.0, 5.0], [-5.0, 0.0], [0.0, -6.0]])
    world = open_world(landmarks)
    assert 0 in best_triplet(world, LASER, (0.0, 0.0)).triplet
    far = best_triplet(world, replace(LASER, min_range=2.0), (0.0, 0.0))
    assert far.triplet == (1, 2, 3)
    assert far.n_visible == 3
    assert best_triplet(world, replace(LASER, max_range=5.0), (0.0, 0.0)).triplet == (0, 1, 2)
    assert best_triplet(world, replace(LASER, max_range=4.0), (0.0, 0.0)) is None


def test_no_fix_is_none():
    world = world_from_ascii(HALL)
    assert best_triplet(world, LASER, (0.25, 0.25)) is None  # in the wall
    assert rank_triplets(world, LASER, (0.25, 0.25)) == []
    three = open_world([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0]])
    assert best_triplet(three, LASER, (0.0, -3.0)) is None  # on the danger circle
    assert rank_triplets(three, LASER, (0.0, -3.0)) == []
    assert best_triplet(three, LASER, (0.0, -2.9)) is not None
    assert best_triplet(three, MAS97_CAMERA, (0.0, 0.0)) is None  # do not fit into the view
    two = open_world([[3.0, 0.0], [0.0, 3.0]])
    assert best_triplet(two, LASER, (0.0, 0.0)) is None
    assert rank_triplets(two, LASER, (0.0, 0.0)) == []


def test_robot_on_a_landmark_uses_the_others():
    landmarks = np.array([[0.0, 0.0], [3.0, 1.0], [-2.0, 2.0], [1.0, -3.0]])
    world = open_world(landmarks)
    best = best_triplet(world, LASER, (0.0, 0.0))
    assert best.triplet == (1, 2, 3)
    assert best.n_visible == 3
    assert len(rank_triplets(world, LASER, (0.0, 0.0))) == 1
    near = best_triplet(world, LASER, (0.002, 0.0))
    assert 0 in near.triplet
    assert near.r95 < best.r95


@pytest.mark.parametrize("point", [(math.nan, 0.0), (0.0, math.inf), (1.0,), ((1.0, 2.0),)])
def test_bad_points_are_refused(point):
    world = open_world([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0]])
    for call in (best_triplet, rank_triplets):
        with pytest.raises(LocalizationError, match="two finite numbers"):
            call(world, LASER, point)


@pytest.mark.parametrize("count", [0, -1, 10_001])
def test_bad_counts_are_refused(count):
    world = open_world([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0]])
    with pytest.raises(LocalizationError, match=str(count)):
        rank_triplets(world, LASER, (0.0, 0.0), count=count)


def test_survey_sigma_can_change_the_choice():
    landmarks = np.array([[1.0, 0.0], [0.0, 6.0], [-5.0, -3.0], [5.0, -5.0]])
    sure = best_triplet(open_world(landmarks), LASER, (0.0, 0.0))
    assert 0 in sure.triplet
    unsure = best_triplet(open_world(landmarks, [0.5, 0.0, 0.0, 0.0]), LASER, (0.0, 0.0))
    assert unsure.triplet == (1, 2, 3)
    assert unsure.area95 > sure.area95


def test_survey_sigma_adds_its_angle():
    # σ_m at r adds (σ_m / r)² to a bearing's variance.
    ring = 4.0 * np.array([[1.0, 0.0], [-0.5, math.sqrt(0.75)], [-0.5, -math.sqrt(0.75)]])
    plain = best_triplet(open_world(ring), LASER, (0.0, 0.0))
    sigma = 4.0 * LASER.bearing_sigma
    surveyed = best_triplet(open_world(ring, [sigma] * 3), LASER, (0.0, 0.0))
    np.testing.assert_allclose(surveyed.covariance, 2.0 * plain.covariance, rtol=1e-9, atol=1e-15)
    assert surveyed.sigma_theta == pytest.approx(math.sqrt(2) * plain.sigma_theta)
    # Three equal bearings: the heading is their mean.
    assert plain.sigma_theta == pytest.approx(LASER.bearing_sigma / math.sqrt(3))


def test_pan_is_relative_to_the_heading():
    world = open_world([[6.0, -1.0], [5.0, 0.0], [6.0, 1.5]])
    middle = 0.5 * (math.atan2(1.5, 6.0) - math.atan2(1.0, 6.0))
    for heading in (0.0, 1.0, -3.0, 9.0):
        choice = best_triplet(world, MAS97_CAMERA, (0.0, 0.0), heading=heading)
        assert math.cos(choice.pan + heading - middle) == pytest.approx(1.0, abs=1e-12)
        assert choice.covariance.tolist() == pytest.approx(
            best_triplet(world, MAS97_CAMERA, (0.0, 0.0)).covariance.tolist(), rel=1e-9
        )
    limited = replace(MAS97_CAMERA, pan_min=0.1, pan_max=0.3)
    choice = best_triplet(world, limited, (0.0, 0.0))
    assert choice.pan == pytest.approx(0.1)
    assert best_triplet(world, limited, (0.0, 0.0), heading=1.0) is None


def test_optimal_pan_is_never_worse(rng):
    better = 0
    for _ in range(40):
        world, point = open_world(rng.uniform(-9, 9, (12, 2))), rng.uniform(-3, 3, 2)
        centred = best_triplet(world, MAS97_CAMERA, point)
        optimal = best_triplet(world, replace(MAS97_CAMERA, pan_policy="optimal"), point)
        assert (centred is None) == (optimal is None)
        if centred is not None:
            assert optimal.area95 <= centred.area95 * (1 + 1e-12)
            better += optimal.area95 < 0.95 * centred.area95
    assert better > 5


def test_pack_masks(rng):
    for n in (0, 1, 64, 65, 130):
        visible = rng.random((4, n)) < 0.5
        words = pack_masks(visible)
        assert words.shape == (4, max(1, -(-n // 64)))
        for p in range(4):
            bits = [bool(int(words[p, i // 64]) >> (i % 64) & 1) for i in range(n)]
            assert bits == visible[p].tolist()


def test_landmark_on_a_polygon_wall():
    plan = FloorPlan((box(0, 0, 10, 10),), (box(4, 4, 6, 6),), (True,))
    ids = ("a", "b", "c", "d")
    landmarks = LandmarkSet(ids, [[0.0, 5.0], [10.0, 5.0], [5.0, 10.0], [5.0, 0.0]])
    world = World("room", plan, landmarks)
    choice = best_triplet(world, LASER, (2.0, 5.0))
    assert choice.triplet == (0, 2, 3)  # b is behind the pillar
    assert choice.n_visible == 3
