"""Bearing variances of triplets along a drive against single fixes."""

from __future__ import annotations

import numpy as np
import pytest

from localization.schedule import Drive, schedule_of_triplets
from localization.sensors import LASER, Mount, PinholeFixedSensor
from tests.localization.test_schedule import CAMERA, HALL
from tests.oracles import fix_of_three
from tests.worlds import world_from_ascii


@pytest.mark.parametrize(
    "sensor",
    [
        CAMERA,
        LASER,
        PinholeFixedSensor(2.6, 512.0, 5.0, bearing_floor=0.003, mount=Mount(0.3, -0.2, 0.5)),
    ],
)
def test_variances_of_triplets_are_those_of_single_fixes(sensor):
    world = world_from_ascii(HALL)
    rng = np.random.default_rng(3)
    n = len(world.landmarks)
    poses = np.column_stack([rng.uniform(1.0, 8.0, 200), rng.uniform(1.0, 3.0, 200), rng.uniform(-3, 3, 200)])
    triplets = np.array([rng.choice(n, size=3, replace=False) for _ in poses])
    schedule = schedule_of_triplets(Drive(poses, np.arange(200.0)), triplets, world.landmarks, sensor)
    assert np.isfinite(schedule.variances).any()
    sigmas = world.landmarks.sigma
    for pose, triplet, variances in zip(poses, triplets, schedule.variances, strict=True):
        fix = fix_of_three(pose[:2], world.landmarks.positions[triplet], sigmas[triplet], sensor, pose[2])
        assert (fix is None) == np.isnan(variances).all()
        if fix is not None:
            assert np.allclose(variances, fix[1], rtol=1e-9)
