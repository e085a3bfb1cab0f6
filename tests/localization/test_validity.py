"""What the field calls valid holds 95 ± 2 % of the simulated fixes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.errors import LocalizationError
from localization.field_builder import build_field
from localization.kernels.coverage import NOMINAL_SHARE, VALID_TOLERANCE
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA
from localization.validity import MAX_DEVIATION, coverage_study
from maps.io.site import bundled_site, bundled_site_names
from maps.landmarks import LandmarkSet

SENSORS = {
    "laser": (LASER, 0.0),
    "laser, survey": (LASER, 0.02),
    "camera": (MAS97_CAMERA, 0.0),
    "camera, survey": (MAS97_CAMERA, 0.05),
    "camera, optimal pan": (replace(MAS97_CAMERA, pan_policy="optimal"), 0.0),
    "camera, limited pan": (replace(MAS97_CAMERA, pan_min=-math.pi / 2, pan_max=math.pi / 2), 0.0),
    "camera, fixed": (FORWARD_CAMERA, 0.0),
}


def surveyed(world, sigma):
    marks = world.landmarks
    sigmas = np.full(len(marks), sigma)
    return replace(
        world,
        landmarks=LandmarkSet(marks.ids, marks.positions, marks.facing, marks.half_angle, sigmas),
    )


@pytest.mark.parametrize("site", bundled_site_names())
@pytest.mark.parametrize("name", SENSORS)
def test_valid_cells_hold_95_percent_of_the_fixes(site, name, rng):
    sensor, sigma = SENSORS[name]
    study = coverage_study(
        surveyed(bundled_site(site), sigma), sensor, cells=60, resolution=0.25, heading=0.4, rng=rng
    )
    assert len(study) == 60
    assert study.valid.sum() >= 20
    assert study.missed == 0
    assert study.worst_valid <= MAX_DEVIATION
    assert np.abs(study.prediction_error[study.valid]).max() < 5 * math.sqrt(0.06 * 0.94 / study.fixes) + 3e-3
    invalid = ~study.valid
    assert invalid.sum() >= 10
    assert study.simulated[invalid].max() < NOMINAL_SHARE + 5e-3
    assert np.abs(study.prediction_error[invalid]).max() < 0.08
    # The true region is larger than predicted where too few fixes fall inside.
    assert (study.area_factor[invalid & (study.simulated < 0.94)] > 1.0).all()
    assert ((study.failed >= 0) & (study.failed <= 1 - study.simulated)).all()


def test_counts_are_those_of_the_field(rng):
    world = bundled_site("mas97_room")
    field = build_field(world, LASER, resolution=0.5)
    study = coverage_study(world, LASER, cells=40, n=100, resolution=0.5, rng=rng)
    assert study.cells_with_fix == field.has_fix.sum()
    assert study.cells_valid == field.is_valid.sum()
    assert study.invalid_share == pytest.approx(1 - study.cells_valid / study.cells_with_fix)
    assert study.at_random.sum() == 20
    assert len(np.unique(study.points, axis=0)) == len(study)
    assert (np.abs(study.predicted[study.valid] - NOMINAL_SHARE) <= VALID_TOLERANCE).all()
    assert study.harmless <= (~study.valid).sum()


def test_the_same_seed_gives_the_same_study():
    world = bundled_site("mas97_room")
    one, two = (
        coverage_study(world, MAS97_CAMERA, cells=12, n=500, resolution=0.5, rng=np.random.default_rng(4))
        for _ in range(2)
    )
    assert np.array_equal(one.points, two.points)
    assert np.array_equal(one.simulated, two.simulated)


def test_a_field_without_fixes_gives_an_empty_study(rng):
    world = bundled_site("mas97_room")
    blind = replace(LASER, min_range=0.0, max_range=0.01)
    study = coverage_study(world, blind, cells=10, n=10, resolution=1.0, rng=rng)
    assert len(study) == 0
    assert math.isnan(study.invalid_share)
    assert study.worst_valid == 0.0


def test_cells_must_be_positive(rng):
    with pytest.raises(LocalizationError, match="Number of cells"):
        coverage_study(bundled_site("mas97_room"), LASER, cells=0, rng=rng)


def test_progress_counts_the_cells(rng):
    seen = []
    coverage_study(
        bundled_site("mas97_room"),
        LASER,
        cells=6,
        n=10,
        resolution=1.0,
        rng=rng,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen[0][0] == 1
    assert seen[-1][0] == seen[-1][1] == len(seen)
