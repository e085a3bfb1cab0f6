"""Why a place is good or bad: statuses, counts and missed triplets against plain enumeration."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from localization.errors import LocalizationError
from localization.ranking import LandmarkStatus, TripletStatus, explain_place, triplet_status
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA, Mount
from localization.triplets import best_triplet, rank_triplets
from maps.visibility import visible_landmarks
from tests import oracles
from tests.localization.test_triplets import open_world
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


@pytest.mark.parametrize("name", SENSORS)
def test_counts_and_statuses_are_those_of_enumeration(rng, name):
    sensor = SENSORS[name]
    for _ in range(4):
        heading = rng.uniform(-3, 3) if sensor.depends_on_heading else 0.0
        world, point = open_world(rng.uniform(-9, 9, (8, 2))), rng.uniform(-3, 3, 2)
        report = explain_place(world, sensor, point, heading=heading, count=100)
        place = oracles.sensor_place(point, sensor, heading)
        positions = world.landmarks.positions
        fixes = 0
        for triplet in itertools.combinations(range(8), 3):
            fix = oracles.fix_of_three(
                point, [tuple(positions[i]) for i in triplet], [0.0] * 3, sensor, heading
            )
            status = triplet_status(world, sensor, point, triplet, heading=heading)
            assert (status is TripletStatus.FIX) == (fix is not None)
            fixes += fix is not None
        assert report.counts[TripletStatus.FIX] == fixes == len(report.ranked)
        assert sum(report.counts.values()) == math.comb(8, 3)
        for i, status in enumerate(report.landmarks):
            ok = oracles.is_measurable(place, positions[i], sensor, heading)
            if sensor.kind != "pinhole_pan":
                assert (status is LandmarkStatus.MEASURABLE) == ok
        assert report.missed == ()


def test_reasons_of_landmarks():
    landmarks = np.array([[1.0, 0.0], [0.0, 12.0], [-5.0, 0.0], [0.0, -6.0], [4.0, 4.0]])
    facing = [math.nan, math.nan, math.pi, math.nan, math.nan]
    base = open_world(landmarks)
    world = base.with_landmarks(replace(base.landmarks, facing=np.array(facing), half_angle=None))
    sensor = replace(LASER, min_range=2.0, max_range=10.0, muted=((-2.0, -1.0),))
    report = explain_place(world, sensor, (0.0, 0.0))
    want = [
        LandmarkStatus.TOO_NEAR,
        LandmarkStatus.TOO_FAR,
        LandmarkStatus.TURNED_AWAY,
        LandmarkStatus.MUTED,
        LandmarkStatus.MEASURABLE,
    ]
    assert list(report.landmarks) == want
    np.testing.assert_allclose(report.distance, [1.0, 12.0, 5.0, 6.0, math.hypot(4, 4)])
    assert report.ranked == ()
    assert report.counts[TripletStatus.NOT_VISIBLE] == 10
    assert report.blocking((0, 3, 4)) == {0: LandmarkStatus.TOO_NEAR, 3: LandmarkStatus.MUTED}
    on_it = explain_place(world, LASER, (4.0, 4.0))
    assert on_it.landmarks[4] is LandmarkStatus.TOO_NEAR
    ahead = explain_place(world, FORWARD_CAMERA, (0.0, 0.0), heading=math.pi / 4)
    assert ahead.landmarks[4] is LandmarkStatus.MEASURABLE
    assert ahead.landmarks[3] is LandmarkStatus.OUTSIDE_VIEW
    limited = replace(MAS97_CAMERA, pan_min=-0.5, pan_max=0.5)
    panned = explain_place(world, limited, (0.0, 0.0))
    assert panned.landmarks[0] is LandmarkStatus.MEASURABLE
    assert panned.landmarks[4] is LandmarkStatus.MEASURABLE
    assert panned.landmarks[1] is LandmarkStatus.OUTSIDE_VIEW


def test_what_hidden_landmarks_would_bring():
    world = world_from_ascii(HALL)
    point = place_in_ascii(HALL, "s")
    seen = visible_landmarks(world, np.array([point]))[0]
    report = explain_place(world, LASER, point, count=5)
    hidden = [i for i, s in enumerate(report.landmarks) if s is LandmarkStatus.HIDDEN]
    assert hidden == np.flatnonzero(~seen).tolist()
    assert hidden
    assert [c.triplet for c in report.ranked] == [
        c.triplet for c in rank_triplets(world, LASER, point, count=5)
    ]
    assert report.missed
    for choice in report.missed:
        assert set(choice.triplet) & set(hidden)
        assert triplet_status(world, LASER, point, choice.triplet) is TripletStatus.NOT_VISIBLE
    positions = world.landmarks.positions
    want = oracles.ranked_triplets(point, positions, np.zeros(len(positions)), LASER)[0]
    best = min([*report.missed, *report.ranked], key=lambda c: c.area95)
    assert best.area95 == pytest.approx(math.pi * 5.991464547 * math.sqrt(want[0]), rel=1e-9)


def test_degenerate_and_too_wide():
    three = open_world([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0]])
    assert triplet_status(three, LASER, (0.0, -3.0), (0, 1, 2)) is TripletStatus.DEGENERATE
    assert triplet_status(three, MAS97_CAMERA, (0.0, 0.0), (2, 0, 1)) is TripletStatus.NOT_IN_ONE_VIEW
    report = explain_place(three, MAS97_CAMERA, (0.0, 0.0))
    assert report.counts[TripletStatus.NOT_IN_ONE_VIEW] == 1


def test_validity_of_choices_is_that_of_the_field():
    world = open_world([[6.0, -2.0], [7.0, 0.5], [6.5, 2.0], [-3.0, 4.0], [9.0, 1.0]])
    best = best_triplet(world, MAS97_CAMERA, (0.0, 0.0))
    assert 0.0 < best.validity < 0.951
    ranked = rank_triplets(world, MAS97_CAMERA, (0.0, 0.0))
    assert ranked[0].validity == pytest.approx(best.validity, abs=1e-6)
    assert len({c.validity for c in ranked}) == len(ranked) > 1


def test_walls_rank_nothing_and_wrong_points_are_refused():
    world = world_from_ascii(HALL)
    report = explain_place(world, replace(LASER, mount=Mount(0.2)), (0.25, 0.25))
    assert not report.is_free
    assert report.ranked == report.missed == ()
    assert report.counts is None
    for call in (
        lambda: explain_place(world, LASER, (math.nan, 0.0)),
        lambda: explain_place(world, LASER, (1, 1), heading=math.inf),
    ):
        with pytest.raises(LocalizationError, match="finite"):
            call()
