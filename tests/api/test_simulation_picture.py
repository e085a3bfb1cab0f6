"""The picture of simulated runs."""

import io

import numpy as np
import pytest
from PIL import Image

from api.canvas import InvalidPicture
from api.simulation_picture import simulation_png
from localization.motion import OdometryModel
from localization.sensors import LASER
from maps.io.site import bundled_site
from planner.simulation import SimulatedRobot, simulate
from planner.timing import time_polyline

ROOM = bundled_site("mas97_room")


def report(**robot):
    way = time_polyline([[0.7, 2.0], [0.7, 9.5], [2.0, 10.5]], max_speed=1.0, max_accel=1.0)
    chosen = SimulatedRobot(**{"radius": 0.4, "fix_rate": 1.0, **robot})
    return simulate(ROOM, LASER, way, robot=chosen, runs=60, rng=np.random.default_rng(0))


def pixels(data):
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def count(image, color):
    return int((np.abs(image - np.array(color)).max(axis=2) < 40).sum())


def test_tracks_ellipses_and_collisions_are_drawn():
    noisy = report(odometry=OdometryModel(drift_sigma=0.2))
    assert 5 < noisy.collisions < 60
    image = pixels(simulation_png(ROOM, noisy))
    assert image.shape[1] == 1400
    assert count(image, (200, 16, 46)) > 200
    assert count(image, (0, 92, 230)) > 500
    quiet = pixels(simulation_png(ROOM, report()))
    assert count(quiet, (200, 16, 46)) < count(image, (200, 16, 46))


def test_a_simulation_in_which_nothing_arrives_can_be_drawn():
    lost = report(radius=0.75)
    assert lost.stations.n.max() == 0
    assert np.isnan(lost.goal_error).all()
    assert pixels(simulation_png(ROOM, lost, title="lost")).shape[2] == 3


def test_sizes_that_make_no_sense_are_refused():
    with pytest.raises(InvalidPicture):
        simulation_png(ROOM, report(), width=100_000)
