"""Madsen, Andersen, Sørensen, A Robustness Analysis of Triangulation-Based Robot Self-Positioning, SIRS 1997.

The paper prints neither floor plan nor landmark coordinates: layouts here give its orders and sizes.
Camera of §2: 512 columns, 53.13°, σ_u = 5 px.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

from localization import covariance as cov
from localization.madsen_1997 import SEED, reproduce
from localization.madsen_1997 import area as area_of
from localization.madsen_1997_path import PATH, study_path
from localization.madsen_1997_report import COMMAND, HEAD, PICTURE_FOLDER, PICTURES, cells, report
from localization.madsen_1997_scenes import POOR_PLACE, SITE, WORST, bend, spans
from localization.sensors import MAS97_CAMERA
from localization.simulation import simulate_fixes
from localization.triplets import best_triplet, rank_triplets
from maps.grid import GridFrame, OccupancyGrid
from maps.io.site import bundled_site
from maps.landmarks import LandmarkSet
from maps.world import World

DOCUMENT = Path(__file__).parents[2] / "docs" / "mas97.md"


@pytest.fixture(scope="module")
def made():
    return reproduce(bundled_site(SITE), rng=np.random.default_rng(SEED))


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


def test_madsen_1997_every_claim_holds(made):
    rows = made.rows()
    assert [r.where for r in rows if not r.holds] == []
    # Every row of the list of claims, and every figure that is drawn.
    places = " ".join(r.where for r in rows)
    for word in (
        "Fig. 3, §2",
        "Fig. 4",
        "Fig. 6, §4.3",
        "§4.3",
        "Fig. 7, §5.1",
        "footnote 5",
        "Fig. 8, §5.2",
    ):
        assert word in places
    for row in rows:
        text = cells(row)
        assert len(text) == len(HEAD)
        assert all(text)
        assert not any(re.search(r"\bnan\b|\|", cell) for cell in text)


def test_madsen_1997_claims_do_not_hang_on_the_seed():
    for seed in (3, 4):
        again = reproduce(bundled_site(SITE), rng=np.random.default_rng(seed))
        assert [r.where for r in again.rows() if not r.holds] == []


def test_madsen_1997_the_same_seed_makes_the_same_document(made):
    again = reproduce(bundled_site(SITE), rng=np.random.default_rng(SEED))
    assert report(again) == report(made)


def test_madsen_1997_the_document_is_what_the_command_makes(made):
    text = DOCUMENT.read_text()
    assert report(made) == text, f"docs/mas97.md is old: run {COMMAND} again"
    for name in PICTURES.values():
        assert f"({PICTURE_FOLDER}/{name})" in text
        assert (DOCUMENT.parent / PICTURE_FOLDER / name).exists()
    for paper in ("2 m × 1 m", "0.2 < 0.6 < 3.5 m²", "2 → 0.3 m²", "8 → 0.12 m²", "24 and 37 m²"):
        assert paper in text


def test_madsen_1997_a_claim_that_fails_is_said(made):
    # Worst triplets in the place of the poor one, best ones in the place of the worst.
    wrong = replace(made, poor=made.worst[0], worst=(made.better, made.poor))
    failed = {row.where for row in wrong.rows() if not row.holds}
    assert failed >= {"Fig. 3, §2", "Fig. 8, §5.2"}
    assert any(cells(row)[-1].startswith("no: ") for row in wrong.rows())


def test_madsen_1997_figure_4_better_triplet(made):
    assert made.better.triplet != made.poor.triplet
    assert area_of(made.better.predicted) < 0.2 * area_of(made.poor.predicted)
    best = best_triplet(made.room, MAS97_CAMERA, POOR_PLACE)
    assert area_of(made.better.predicted) == pytest.approx(best.area95, rel=1e-9)


def test_madsen_1997_spans_are_the_smallest_angles_that_hold_the_triplet(made, rng):
    field = made.topologies[0].field
    found = spans(field)
    for row, col in rng.integers(0, 150, (200, 2)):
        x, y = field.frame.centres(slice(row, row + 1), slice(col, col + 1))[0, 0]
        azimuth = [math.atan2(b - y, a - x) for a, b in field.world.landmarks.positions]
        # Counter-clockwise from each landmark to the last of the others.
        want = min(max((other - first) % (2 * math.pi) for other in azimuth) for first in azimuth)
        assert found[row, col] == pytest.approx(want, abs=1e-12)


def test_madsen_1997_figure_7_reduction(made):
    for kept in (False, True):
        assert made.path.reduction(kept=kept).low >= 6
        worst, there = made.path.worst(kept=kept)
        assert np.quantile(worst / there, 0.05) > 10
    assert made.path.mean_best < made.path.mean_best_forward < made.path.means().min()


def test_madsen_1997_figure_7_drives_take_what_the_camera_sees_ahead():
    path = study_path(bundled_site(SITE), drives=20, rng=np.random.default_rng(5))
    np.testing.assert_allclose(path.points[[0, -1]], PATH)
    heading, half = math.pi / 4, 0.5 * MAS97_CAMERA.field_of_view
    positions = bundled_site(SITE).landmarks.positions
    for point, choices, best in zip(path.points, path.forward, path.best, strict=True):
        for choice in choices:
            d = positions[list(choice.triplet)] - point
            off = np.arctan2(d[:, 1], d[:, 0]) - heading
            assert np.abs(off).max() <= half + 1e-12
        # A free pan sees every triplet that the forced camera sees.
        if choices:
            assert best is not None
            assert best.area95 <= min(c.area95 for c in choices) * 1.05
    for drive in range(20):
        held = None
        for place, choices in enumerate(path.forward):
            drawn, kept = path.drawn[drive, place], path.kept[drive, place]
            if not choices:
                assert drawn == kept == -1
                held = None
                continue
            assert 0 <= drawn < len(choices)
            if held is not None and held in [c.triplet for c in choices]:
                assert choices[kept].triplet == held
            else:
                assert kept == drawn
            held = choices[kept].triplet
    areas = [
        [c[i].area95 for c, i, on in zip(path.forward, row, path.compared, strict=True) if on]
        for row in path.kept
    ]
    np.testing.assert_allclose(path.means(kept=True), np.mean(areas, axis=1), rtol=1e-12)
    np.testing.assert_allclose(path.worst(kept=True)[0], np.max(areas, axis=1), rtol=1e-12)


def test_madsen_1997_figure_7_draws_are_uniform():
    path = study_path(bundled_site(SITE), drives=4000, rng=np.random.default_rng(6))
    place = int(np.argmax([len(c) for c in path.forward]))
    counts = np.bincount(path.drawn[:, place], minlength=len(path.forward[place]))
    expected = 4000 / len(counts)
    assert np.abs(counts - expected).max() < 5 * math.sqrt(expected)


def test_madsen_1997_figure_8_clouds_lie_on_a_horopter_and_not_in_the_ellipse(made):
    for cloud, found in zip(made.worst, made.bends, strict=True):
        assert cloud.share_inside < 0.6
        assert found.rms_axis > 4 * found.rms_horopter
        # The distance from the circle, once more: the angle between the pair says where a point is.
        a, b = made.room.landmarks.positions[list(found.pair)]
        angle = inscribed(cloud.pose[:2], a, b)
        radius = np.hypot(*(a - b)) / (2 * math.sin(angle))
        fixes = cloud.fixes.pose[cloud.fixes.ok, :2]
        offs = [abs(inscribed(p, a, b) - angle) for p in fixes[:300]]
        assert np.median(offs) < 0.05
        assert radius > 1.0
    assert [area_of(c.predicted) for c in made.worst] == pytest.approx([24.0, 37.0], rel=0.1)


def inscribed(point, a, b):
    """Angle under which two landmarks are seen."""
    u, v = a - point, b - point
    return abs(math.atan2(u[0] * v[1] - u[1] * v[0], u @ v))


def test_madsen_1997_a_cloud_that_is_not_bent_is_as_near_to_its_axis(rng):
    world = bundled_site(SITE)
    tame = replace(MAS97_CAMERA, column_sigma_px=0.01)
    place, names = WORST[0]
    triplet = tuple(world.landmarks.ids.index(n) for n in names)
    cloud = simulate_fixes(world, tame, place, triplet=triplet, n=2000, rng=rng)
    assert cloud.share_inside == pytest.approx(0.95, abs=0.02)
    found = bend(cloud)
    assert found.rms_axis == pytest.approx(found.rms_horopter, rel=0.3)
