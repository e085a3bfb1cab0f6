"""Fixes at poses: those of the search at one place, and of a field whose cells they are."""

import math

import numpy as np
import pytest

from localization import covariance as cov
from localization.at_poses import fixes_at
from localization.errors import LocalizationError
from localization.field_builder import build_field
from localization.method import FieldMethod
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA
from localization.triplets import best_triplet
from maps.io.site import bundled_site

ROOM = bundled_site("mas97_room")


def test_they_are_those_of_the_search_at_one_place(rng):
    poses = np.column_stack(
        [rng.uniform(0.5, 14.5, 900), rng.uniform(0.5, 14.5, 900), rng.uniform(-4, 4, 900)]
    )
    found = fixes_at(ROOM, FORWARD_CAMERA, poses)
    known = 0
    for k, (x, y, heading) in enumerate(poses):
        if np.isnan(found.covariance[k, 0]):
            continue
        best = best_triplet(ROOM, FORWARD_CAMERA, (x, y), heading=heading)
        assert tuple(found.triplet[k]) == best.triplet
        # Where first order fails, planning counts on less.
        assert cov.area95(found.covariance[k]) >= best.area95 * (1 - 1e-9)
        known += 1
    assert 40 < known < 800


@pytest.mark.parametrize("sensor", [LASER, MAS97_CAMERA])
@pytest.mark.parametrize("estimator", ["best_triplet", "all_visible"])
def test_cells_of_a_field_are_poses(sensor, estimator):
    method = FieldMethod(estimator)
    field = build_field(ROOM, sensor, resolution=0.5, method=method).trusted()
    rows, cols = np.nonzero(field.free)
    poses = np.column_stack([field.frame.centres()[rows, cols], np.zeros(len(rows))])
    found = fixes_at(ROOM, sensor, poses, method=method)
    np.testing.assert_allclose(found.covariance, field.covariance[rows, cols], rtol=1e-9)
    np.testing.assert_array_equal(found.triplet, field.triplet[rows, cols])
    np.testing.assert_allclose(found.pan, field.pan[rows, cols], rtol=1e-9)


def test_walls_and_wrong_poses():
    inside = fixes_at(ROOM, LASER, [[-3.0, 2.0, 0.0]])
    assert np.isnan(inside.covariance).all()
    assert len(fixes_at(ROOM, LASER, np.empty((0, 3))).pan) == 0
    with pytest.raises(LocalizationError, match="finite"):
        fixes_at(ROOM, LASER, [[0.0, 1.0, math.nan]])
    with pytest.raises(LocalizationError, match="shape"):
        fixes_at(ROOM, LASER, [[0.0, 1.0]])
