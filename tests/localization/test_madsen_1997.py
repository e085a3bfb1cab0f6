"""Madsen, Andersen, Sørensen, A Robustness Analysis of Triangulation-Based Robot Self-Positioning, SIRS 1997.

The paper prints neither floor plan nor landmark coordinates: layouts here give its orders and sizes.
Camera of §2: 512 columns, 53.13°, σ_u = 5 px.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

from localization import covariance as cov
from localization.sensors import MAS97_CAMERA
from localization.triplets import best_triplet, rank_triplets
from maps.grid import GridFrame, OccupancyGrid
from maps.io.site import bundled_site
from maps.landmarks import LandmarkSet
from maps.world import World


def room(landmarks):
    """A room of 15 m × 15 m, landmarks on its walls or inside."""
    frame = GridFrame(-0.5, -0.5, 0.0, 0.5, 32, 32)
    nothing = np.zeros((32, 32), dtype=bool)
    ids = tuple(f"m{i}" for i in range(len(landmarks)))
    return World("room", OccupancyGrid(frame, ~nothing, nothing), LandmarkSet(ids, landmarks))


def area(landmarks, place, sensor=MAS97_CAMERA):
    choice = best_triplet(room(landmarks), sensor, place)
    return None if choice is None else choice.area95


def simulated_fixes(landmarks, place, axis, n, rng):
    """Positions (n, 2) triangulated from noisy columns, solving the camera equations for x, y, θ."""

    def columns(pose):
        azimuth = np.arctan2(landmarks[:, 1] - pose[1], landmarks[:, 0] - pose[0])
        return MAS97_CAMERA.focal_px * np.tan(azimuth - pose[2])

    truth = np.array([*place, axis])
    fixes = []
    for noise in rng.normal(0.0, MAS97_CAMERA.column_sigma_px, (n, 3)):
        seen = columns(truth) + noise
        pose, _, found, _ = fsolve(lambda p, seen=seen: columns(p) - seen, truth, full_output=True)
        if found == 1:
            fixes.append(pose)
    return np.array(fixes)


def test_madsen_1997_figure_3_ellipse_holds_the_simulated_fixes(rng):
    # §2: fixes of a poor triplet cover about 2 m × 1 m; the predicted 95 % ellipse matches 1000 of them.
    landmarks, place = np.array([[0.0, 0.9], [0.0, 5.3], [0.0, 10.0]]), (9.2, 4.9)
    choice = best_triplet(room(landmarks), MAS97_CAMERA, place)
    a, b, _ = cov.ellipse95(choice.covariance)
    assert 1.5 < 2 * a < 3.0
    assert 0.4 < 2 * b < 1.5
    fixes = simulated_fixes(landmarks, place, choice.pan, 1500, rng)
    assert len(fixes) > 1480
    error = fixes[:, :2] - place
    sample = np.cov(error.T)
    want = cov.as_matrix(choice.covariance)
    np.testing.assert_allclose(sample, want, rtol=0.12, atol=0.05 * want.max())
    inside = np.einsum("ni,ij,nj->n", error, np.linalg.inv(want), error) <= cov.CHI2_95
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    assert np.std(fixes[:, 2]) == pytest.approx(choice.sigma_theta, rel=0.1)


def test_madsen_1997_figure_6_topologies():
    # §4.3: middle landmark in front, behind, collinear: 0.2, 0.6 and 3.5 m² at (2.5 m, 3.0 m).
    place, y = (2.5, 3.0), 7.65
    front, behind, line = (
        area([[1.5, y], [2.5, y + offset], [3.5, y]], place) for offset in (-1.9, 1.9, 0.0)
    )
    assert front < behind < line
    assert front == pytest.approx(0.2, rel=0.1)
    assert behind == pytest.approx(0.6, rel=0.1)
    assert line == pytest.approx(3.5, rel=0.1)


@pytest.mark.parametrize("offset", [-1.0, 1.0, 0.0])
def test_madsen_1997_area_grows_with_distance(offset):
    # §4.3.
    landmarks = [[6.5, 14.0], [7.5, 14.0 + 0.9 * offset], [8.5, 14.0]]
    areas = [area(landmarks, (7.5, y)) for y in np.arange(11.5, 1.0, -0.5)]
    assert all(a < b for a, b in itertools.pairwise(areas))


def test_madsen_1997_no_fix_where_the_triplet_does_not_fit_the_view():
    # §4.3: ±2.5 m seen at 5 m is 53.13°, exactly the field of view.
    landmarks = [[5.0, 12.0], [7.5, 12.5], [10.0, 12.0]]
    assert area(landmarks, (7.5, 7.0)) is not None
    assert area(landmarks, (7.5, 6.9)) is not None
    assert area(landmarks, (7.5, 7.05)) is None
    assert area(landmarks, (7.5, 11.0)) is None


def test_madsen_1997_footnote_5_area_scales_with_the_variance():
    landmarks, place = [[1.5, 7.5], [2.5, 5.5], [3.5, 7.5]], (2.5, 3.0)
    one = area(landmarks, place)
    for factor in (0.2, 2.0, 3.0):
        sensor = replace(MAS97_CAMERA, column_sigma_px=5.0 * factor)
        assert area(landmarks, place, sensor) == pytest.approx(factor**2 * one, rel=1e-12)


def test_madsen_1997_figure_7_best_triplet_along_a_path():
    # §5.1: best triplet with free pan against an arbitrary one in a camera forced forward:
    # mean area 2 → 0.3 m² (factor 6), worst 8 → 0.12 m² there, more than an order of magnitude.
    world = bundled_site("mas97_room")
    forward = replace(MAS97_CAMERA, pan_min=0.0, pan_max=0.0)
    generator = np.random.default_rng(7)
    best, arbitrary = [], []
    for place in np.linspace((1.2, 1.2), (13.9, 13.9), 41):
        assert world.floor.free_at(place)
        choices = rank_triplets(world, forward, place, heading=math.pi / 4, count=10_000)
        chosen = best_triplet(world, MAS97_CAMERA, place)

        if chosen is not None and choices:
            best.append(chosen.area95)
            arbitrary.append(choices[generator.integers(len(choices))].area95)
    assert len(best) > 20
    assert 0.1 < np.mean(best) < 0.6
    assert np.mean(arbitrary) > 6 * np.mean(best)
    assert max(arbitrary) > 10 * max(best)


def test_madsen_1997_danger_circle_has_no_fix_and_its_surroundings_are_bad():
    # §5.2: near the circle through robot and landmarks the area grows without bound.
    circle, radius = np.array([7.5, 9.0]), 4.0
    at = [math.radians(a) for a in (60.0, 90.0, 120.0)]
    landmarks = [circle + radius * np.array([math.cos(a), math.sin(a)]) for a in at]
    below = circle - [0.0, radius]
    assert area(landmarks, below) is None
    areas = [area(landmarks, below - [0.0, d]) for d in (1e-3, 1e-2, 0.1, 1.0)]
    assert all(a > 5 * b for a, b in itertools.pairwise(areas))
    assert areas[0] == pytest.approx(10 * areas[1], rel=0.1)
