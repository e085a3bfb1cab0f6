"""Information of the fixes in a field's cells, and the real filter along a polyline."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization import covariance as cov
from localization.field_builder import build_field
from localization.method import FieldMethod
from localization.motion import OdometryModel
from localization.sensors import LASER, MAS97_CAMERA
from planner.errors import InvalidProblem
from planner.fused_belief import FilterModel, FusedField, as_matrices, as_packed
from tests.oracles import belief_along
from tests.worlds import world_from_ascii

ROOM = """
############
#A........B#
#..........#
#..........#
#.....C....#
#D.........#
############
"""


@pytest.fixture(scope="module")
def world():
    return world_from_ascii(ROOM, resolution=1.0, sigma=np.full(4, 0.01))


@pytest.mark.parametrize("sensor", [LASER, MAS97_CAMERA])
def test_information_inverts_to_the_fields_covariance(world, sensor):
    field = build_field(world, sensor, resolution=0.5)
    fused = FusedField.from_field(field)
    known = field.has_fix
    assert np.array_equal(fused.has_fix, known)
    P = np.linalg.inv(as_matrices(fused.information[known]))
    assert np.allclose(as_packed(P)[:, :3], field.covariance[known], rtol=1e-5, atol=1e-12)
    assert np.allclose(np.sqrt(P[:, 2, 2]), field.sigma_theta[known], rtol=1e-5)
    assert np.allclose(fused.widening[known], 1.0, atol=1e-5)


def test_where_first_order_fails_information_shrinks_with_the_ellipse(world):
    trusted = build_field(world, MAS97_CAMERA, resolution=0.5).trusted()
    fused = FusedField.from_field(trusted)
    known = trusted.has_fix
    assert (fused.widening[known] > 1.01).any()
    P = np.linalg.inv(as_matrices(fused.information[known]))
    assert np.allclose(cov.r95(as_packed(P)[:, :3]), trusted.r95[known], rtol=1e-5)


def test_fixes_of_all_landmarks_count_position_and_heading_apart(world):
    field = build_field(world, LASER, resolution=1.0, method=FieldMethod(estimator="all_visible"))
    fused = FusedField.from_field(field)
    assert np.isnan(fused.widening).all()
    P = np.linalg.inv(as_matrices(fused.information[field.has_fix]))
    assert np.allclose(as_packed(P)[:, :3], field.covariance[field.has_fix])
    assert np.allclose(np.sqrt(P[:, 2, 2]), field.sigma_theta[field.has_fix])
    start = fused.fix_covariance((3.5, 3.5))
    belief = fused.along([(3.5, 3.5), (6.5, 3.5)], start, FilterModel())
    assert belief.r95[-1] < cov.r95(as_packed(start)[:3])


def test_the_filter_along_a_line_is_that_of_plain_matrices(world):
    field = build_field(world, LASER, resolution=1.0)
    fused = FusedField.from_field(field)
    start = np.diag([0.1**2, 0.1**2, 0.02**2])
    model = FilterModel(OdometryModel(), fix_rate=2.0, speed=1.0)
    belief = fused.along([(2.5, 3.5), (8.5, 3.5)], start, model)
    poses, sightings = belief.drive.poses, []
    for k, (x, y, _) in enumerate(poses):
        row, col = field.frame.cell_at((x, y))
        seen = []
        if belief.n_used[k]:
            for i in field.triplet[row, col]:
                place = world.landmarks.positions[i]
                r2 = float(np.sum((place - (x, y)) ** 2))
                variance = LASER.bearing_sigma**2 + LASER.bearing_floor**2 + 0.01**2 / r2
                seen.append((place, math.sqrt(variance)))
        sightings.append(seen)
    assert belief.n_used.sum() == 3 * 12
    expected = belief_along(poses, start, (0.02, 0.03, 0.01, 0.0), sightings)
    assert np.allclose(belief.covariance, expected, rtol=1e-6, atol=1e-12)


def test_places_without_a_fix_are_named(world):
    fused = FusedField.from_field(build_field(world, LASER, resolution=0.5))
    for place in ((0.5, 0.5), (-5.0, 0.0)):
        with pytest.raises(InvalidProblem, match="no fix"):
            fused.fix_covariance(place)


@pytest.mark.parametrize("wrong", [{"fix_rate": 0.0}, {"speed": math.inf}, {"turn_rate": -1.0}])
def test_impossible_models_are_refused(wrong):
    with pytest.raises(InvalidProblem):
        FilterModel(**wrong)
