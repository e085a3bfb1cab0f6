"""Stations along a path and what is measured at them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.errors import LocalizationError
from localization.method import FieldMethod
from localization.motion import OdometryModel
from localization.propagation import propagate
from localization.schedule import (
    Drive,
    LandmarkSchedule,
    all_visible_schedule,
    best_triplet_schedule,
    drive_along,
    schedule_of_triplets,
)
from localization.sensors import LASER, Mount, OmnidirectionalSensor, PinholeFixedSensor, PinholePanSensor
from localization.tiles import compute_tile
from localization.triplets import best_triplet, pack_masks
from maps.visibility import visible_landmarks
from tests.worlds import world_from_ascii

HALL = """
    #####################
    #A........B........C#
    #...................#
    #....####...........#
    #D...####...........#
    #....####...........E
    #...................#
    #F........G.........#
    #####################
"""
CAMERA = PinholePanSensor(math.radians(100), 500.0, 2.0, pan_min=-2.0, pan_max=2.0)


def test_stations_follow_the_legs_and_turn_at_corners():
    drive = drive_along(
        [[0, 0], [1, 0], [1, 0], [1, 2]], speed=0.5, turn_rate=2.0, spacing=0.25, spacing_rad=0.5
    )
    np.testing.assert_allclose(drive.poses[0], [0, 0, 0])
    np.testing.assert_allclose(drive.poses[-1], [1, 2, math.pi / 2])
    assert drive.times[-1] == pytest.approx(3.0 / 0.5 + math.pi / 2 / 2.0)
    step = np.hypot(*np.diff(drive.poses[:, :2], axis=0).T)
    assert step.max() == pytest.approx(0.25)
    assert np.abs(np.diff(drive.poses[:, 2])).max() <= 0.5
    assert (np.diff(drive.times) > 0).all()


def test_a_point_is_a_drive_of_one_station():
    drive = drive_along([[3.0, 4.0]], speed=1.0)
    np.testing.assert_array_equal(drive.poses, [[3.0, 4.0, 0.0]])


@pytest.mark.parametrize("sensor", [LASER, CAMERA])
def test_best_triplets_are_those_of_the_places(sensor):
    world = world_from_ascii(HALL)
    drive = drive_along([[1.2, 1.2], [9.3, 1.3], [9.3, 3.2]], speed=1.0, spacing=1.0, spacing_rad=1.0)
    schedule = best_triplet_schedule(world, sensor, drive)
    found = 0
    for k, (x, y, heading) in enumerate(drive.poses):
        choice = best_triplet(world, sensor, [x, y], heading=heading)
        if choice is None:
            assert (schedule.landmarks[k] == -1).all()
            continue
        found += 1
        assert tuple(schedule.landmarks[k]) == choice.triplet
        # The covariance of these three bearings alone is the triplet's.
        d = schedule.places[k] - [x, y]
        r2 = np.sum(d * d, axis=1)
        rows = np.column_stack([d[:, 1] / r2, -d[:, 0] / r2, -np.ones(3)])
        P = np.linalg.inv((rows.T / schedule.variances[k]) @ rows)
        np.testing.assert_allclose([P[0, 0], P[0, 1], P[1, 1]], choice.covariance, rtol=1e-8)
    assert found > 5


def test_all_visible_landmarks_are_scheduled():
    world = world_from_ascii(HALL, sigma=np.full(7, 0.02))
    drive = drive_along([[1.2, 1.2], [4.0, 1.2]], speed=1.0)
    schedule = all_visible_schedule(world, LASER, drive)
    seen = schedule.landmarks >= 0
    assert seen.sum(axis=1).min() >= 3
    assert not seen.all()
    np.testing.assert_array_equal(np.isnan(schedule.variances), ~seen)
    k, i = np.argwhere(seen)[0]
    r = math.dist(drive.poses[k, :2], world.landmarks.positions[i])
    assert schedule.variances[k, i] == pytest.approx(LASER.bearing_sigma**2 + (0.02 / r) ** 2)


def test_triplets_without_a_fix_are_left_out():
    world = world_from_ascii(HALL)
    drive = Drive(np.array([[5.0, 2.0, 0.0]] * 2), np.arange(2.0))
    # Landmarks all around do not fit into one view.
    schedule = schedule_of_triplets(drive, [[0, 2, 6], [-1, -1, -1]], world.landmarks, CAMERA)
    assert (schedule.landmarks == -1).all()
    assert np.isnan(schedule.variances).all()


def test_impossible_values_are_refused():
    with pytest.raises(LocalizationError, match="speed"):
        drive_along([[0, 0], [1, 0]], speed=0.0)
    with pytest.raises(LocalizationError, match="points"):
        drive_along([[0, 0], [math.nan, 0]], speed=1.0)
    with pytest.raises(LocalizationError, match="too many"):
        drive_along([[0, 0], [1e9, 0]], speed=1.0)
    with pytest.raises(LocalizationError, match="ascend"):
        Drive(np.zeros((2, 3)), np.array([1.0, 0.0]))
    with pytest.raises(LocalizationError, match="give"):
        Drive(np.zeros((2, 2)), np.zeros(2))
    with pytest.raises(LocalizationError, match="finite"):
        Drive(np.full((1, 3), math.nan), np.zeros(1))
    with pytest.raises(LocalizationError, match="schedule"):
        LandmarkSchedule(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(LocalizationError, match="Triplets"):
        schedule_of_triplets(
            Drive(np.zeros((1, 3)), np.zeros(1)), [[0, 1, 7]], world_from_ascii(HALL).landmarks, LASER
        )


@pytest.mark.parametrize(
    "sensor",
    [
        PinholeFixedSensor(1.8, 512.0, 5.0, bearing_floor=0.003, mount=Mount(0.3, -0.2, 0.5)),
        OmnidirectionalSensor(0.01, mount=Mount(0.5, 0.1), muted=((2.0, -2.0),)),
    ],
)
def test_schedules_of_mounted_sensors_give_the_covariance_of_the_robot(sensor):
    world = world_from_ascii(HALL)
    drive = drive_along([[1.2, 1.2], [4.0, 1.2], [4.0, 3.0]], speed=1.0, spacing=0.4)
    odometry = OdometryModel(1e-4, 1e-4, 1e-4, 1e-4)
    huge = np.diag([1e6, 1e6, 1e4])
    best, everything = best_triplet_schedule(world, sensor, drive), all_visible_schedule(world, sensor, drive)
    fixes = 0
    for k, (x, y, heading) in enumerate(drive.poses):
        choice = best_triplet(world, sensor, [x, y], heading=heading)
        assert (choice is None) == bool((best.landmarks[k] == -1).any())
        if choice is None:
            continue
        fixes += 1
        one = Drive(np.array([[x, y, heading]] * 2), np.array([0.0, 1.0]))
        belief = []
        for s in (best, everything):
            twice = LandmarkSchedule(s.landmarks[[k, k]], s.places[[k, k]], s.variances[[k, k]], s.mount)
            belief.append(propagate(one, twice, huge, odometry=odometry).covariance[1])
        P = belief[0]
        np.testing.assert_allclose([P[0, 0], P[0, 1], P[1, 1]], choice.covariance, rtol=1e-4, atol=1e-9)
        assert math.sqrt(P[2, 2]) == pytest.approx(choice.sigma_theta, rel=1e-4)
        assert np.linalg.eigvalsh(P - belief[1]).min() > -1e-7
        method = FieldMethod("all_visible")
        seen = visible_landmarks(world, np.array([[x, y]]) + sensor.mount.offset(heading))
        tile = compute_tile(
            world,
            sensor,
            np.array([[[x, y]]]),
            np.ones((1, 1), dtype=bool),
            pack_masks(seen)[None],
            heading=heading,
            method=method,
        )
        Q = belief[1]
        np.testing.assert_allclose([Q[0, 0], Q[0, 1], Q[1, 1]], tile.covariance[0, 0], rtol=1e-4, atol=1e-9)
    assert fixes > 3
