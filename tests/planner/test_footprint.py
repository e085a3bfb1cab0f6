"""Footprints: covers, exact fits, headings at which a robot fits."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from maps.clearance import ClearanceIndex
from maps.floor_plan import FloorPlan
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.errors import InvalidProblem
from planner.footprint import Footprint, fitting_headings

FORKLIFT = [[-0.6, -0.4], [1.4, -0.4], [1.4, 0.4], [-0.6, 0.4]]
SHAPES = {
    "forklift": FORKLIFT,
    "square": [[-0.3, -0.3], [0.3, -0.3], [0.3, 0.3], [-0.3, 0.3]],
    "triangle": [[-0.4, -0.4], [0.8, 0.0], [-0.4, 0.4]],
    "turned": [[0.0, -0.9], [0.6, -0.3], [-0.3, 0.6], [-0.9, 0.0]],
}


@pytest.fixture(params=SHAPES)
def footprint(request):
    return Footprint.of(SHAPES[request.param])


@pytest.fixture(scope="module")
def corridor():
    """A corridor of 1 m between two halls."""
    floor = shapely.union_all(
        [shapely.box(0, 0, 6, 6), shapely.box(6, 2.5, 10, 3.5), shapely.box(10, 0, 16, 6)]
    )
    return World("corridor", FloorPlan((floor,)), LandmarkSet((), np.empty((0, 2))))


def test_discs_cover_the_outline(footprint, rng):
    discs = shapely.union_all([shapely.Point(x, y).buffer(r, quad_segs=64) for x, y, r in footprint.discs])
    assert footprint.outline.difference(discs).area < 1e-4
    assert discs.difference(footprint.outline.buffer(footprint.outline.length / 36 * 0.6)).area < 1e-6
    assert len(footprint.discs) < 60
    assert 0 < footprint.inscribed_radius <= footprint.circumscribed_radius
    pose = rng.uniform(-3, 3, 3)
    moved = footprint.at(pose)
    assert moved.area == pytest.approx(footprint.outline.area)
    centres = footprint.disc_centres(pose)
    covered = shapely.union_all(
        [
            shapely.Point(c).buffer(r, quad_segs=64)
            for c, r in zip(centres, footprint.discs[:, 2], strict=True)
        ]
    )
    assert moved.difference(covered).area < 1e-4


def test_clearance_is_never_more_than_the_outlines(footprint, corridor, rng):
    index, free = ClearanceIndex.from_world(corridor), corridor.floor.free_space()
    poses = np.column_stack(
        [rng.uniform(0.5, 15.5, 200), rng.uniform(0.5, 5.5, 200), rng.uniform(-4, 4, 200)]
    )
    clearance = footprint.clearance(index, poses)
    fits = footprint.fits(free, poses)
    assert fits[clearance >= 0].all()
    for pose, c in zip(poses[fits], clearance[fits], strict=True):
        assert c <= footprint.at(pose).distance(free.boundary) + 1e-9


def test_a_forklift_fits_a_corridor_lengthwise_only(corridor):
    index = ClearanceIndex.from_world(corridor)
    frame = corridor.grid_frame(0.1)
    headings = np.linspace(-math.pi, math.pi, 8, endpoint=False)
    forklift = Footprint.of(FORKLIFT)
    clearance = np.asarray(index.at_centres(frame))
    fits = fitting_headings(forklift, index, frame, clearance, headings)
    row, col = frame.cell_at((8.0, 3.0))
    assert fits[:, row, col].tolist() == [abs(math.sin(h)) < 1e-9 for h in headings]
    row, col = frame.cell_at((3.0, 3.0))
    assert fits[:, row, col].all()
    centres = frame.centres()
    rng = np.random.default_rng(3)
    for _ in range(300):
        k, r, c = rng.integers(len(headings)), rng.integers(frame.n_rows), rng.integers(frame.n_cols)
        pose = [*centres[r, c], headings[k]]
        near = clearance[r, c] >= forklift.inscribed_radius - 1e-9
        sure = clearance[r, c] >= forklift.circumscribed_radius
        assert fits[k, r, c] == (sure or (near and forklift.clearance(index, [pose])[0] >= -1e-9))


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ([[0, 0], [1, 1]], "3 to 100 corners"),
        ([[-1, -1], [1, 1], [1, -1], [-1, 1]], "Self-intersection"),
        ([[-1, -1], [math.nan, 1], [1, 1]], "finite"),
        ([[-1, 0], [0, 0], [1, 0]], "area|simple"),
        ([[1, 1], [2, 1], [2, 2]], "does not hold"),
        ([[-60, -1], [1, -1], [0, 1]], "within ±50"),
    ],
)
def test_impossible_outlines(corners, words):
    with pytest.raises(InvalidProblem, match=words):
        Footprint.of(corners)
