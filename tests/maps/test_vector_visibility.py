"""Sight on floors of polygons: rooms, thin walls, wall landmarks, ranges, cones; runs against single points."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from maps.floor_plan import FloorPlan
from maps.grid import GridFrame
from maps.io.site import bundled_site
from maps.landmarks import LandmarkSet
from maps.vector_visibility import buried_landmarks, vector_runs, vector_visible
from tests.oracles import sight_past_edges


def landmarks_at(positions, **options):
    positions = np.asarray(positions, dtype=float).reshape(-1, 2)
    return LandmarkSet(tuple(f"L{i}" for i in range(len(positions))), positions, **options)


def random_plan(rng, n=12):
    """Two overlapping floors, rotated boxes and triangles, some of them glass."""
    shapes = []
    for k in range(n):
        x, y = rng.uniform([0, 0], [30, 18])
        if k % 3:
            shape = shapely.box(x, y, x + rng.uniform(0.02, 4), y + rng.uniform(0.2, 4))
            shapes.append(shapely.affinity.rotate(shape, rng.uniform(0, 90)))
        else:
            shapes.append(shapely.Polygon([(x, y), (x + 3, y + rng.uniform(-1, 1)), (x + 1, y + 2.5)]))
    floor = (shapely.box(-0.3, 0.2, 20, 18), shapely.box(19, 2, 30, 9))
    return FloorPlan(floor, tuple(shapes), tuple(rng.random(n) < 0.8))


def random_landmarks(rng, plan, n):
    """Some in the open, some on walls, some with a view to one side."""
    x0, y0, x1, y1 = plan.bounds
    edges = plan.opaque_edges()
    some = edges[rng.integers(0, len(edges), n)]
    t = rng.random((n, 1))
    on_walls = some[:, :2] + t * (some[:, 2:] - some[:, :2])
    anywhere = rng.uniform([x0, y0], [x1, y1], (n, 2))
    positions = np.where(rng.random((n, 1)) < 0.5, on_walls, anywhere)
    facing = np.where(rng.random(n) < 0.5, rng.uniform(-math.pi, math.pi, n), np.nan)
    half = np.where(np.isnan(facing), math.pi, rng.uniform(0.3, 3.0, n))
    return landmarks_at(positions, facing=facing, half_angle=half)


def seen_cells(runs):
    """Shape (n_rows, n_cols, N); a cell in two runs of one landmark fails."""
    out = np.zeros((*runs.shape, runs.n_landmarks), dtype=int)
    for i in range(runs.n_landmarks):
        for row, first, stop in runs.row_runs[runs.row_offsets[i] : runs.row_offsets[i + 1]]:
            out[row, first:stop, i] += 1
    assert out.max(initial=0) <= 1
    assert len(runs.col_runs) == 0
    return out.astype(bool)


def frames(rng, plan):
    x0, y0, _, _ = plan.bounds
    yield plan.grid_frame(0.4)
    yield GridFrame(x0 - 3, y0 + 4, 0.6, 0.35, 60, 80)
    yield GridFrame(x0 + 25, y0 - 5, rng.uniform(-math.pi, math.pi), 0.5, 70, 70)


def test_runs_are_what_single_points_see(rng):
    for _ in range(4):
        plan = random_plan(rng)
        landmarks = random_landmarks(rng, plan, 14)
        for frame, max_range in zip(frames(rng, plan), (6.0, math.inf, 15.0), strict=True):
            cells = seen_cells(vector_runs(plan, landmarks, frame, max_range=max_range))
            points = frame.centres().reshape(-1, 2)
            single = vector_visible(plan, landmarks, points, max_range=max_range)
            np.testing.assert_array_equal(cells.reshape(len(points), -1), single)
        assert cells.any()


def test_lattice_aligned_plans_too(rng):
    # Walls, landmarks and centres share lines: grazes and rays along rows everywhere.
    for _ in range(4):
        boxes = [
            shapely.box(*xy, *(xy + wh))
            for xy, wh in zip(rng.integers(0, 15, (14, 2)), rng.integers(1, 4, (14, 2)), strict=True)
        ]
        plan = FloorPlan((shapely.box(0, 0, 16, 16),), tuple(boxes), (True,) * 14)
        positions = np.unique(rng.integers(1, 32, (12, 2)), axis=0) / 2
        landmarks = landmarks_at(positions)
        for frame in (
            plan.grid_frame(0.5),
            GridFrame(-0.25, -0.25, 0.0, 0.5, 33, 33),
            GridFrame(0, 0, math.pi / 4, math.sqrt(0.5), 30, 20),
        ):
            cells = seen_cells(vector_runs(plan, landmarks, frame))
            points = frame.centres().reshape(-1, 2)
            np.testing.assert_array_equal(
                cells.reshape(len(points), -1), vector_visible(plan, landmarks, points)
            )


def test_against_fractions_on_the_given_corners(rng):
    # Corners, landmarks and places are multiples of 1/8 m: the lattice moves nothing.
    def eighths(low, high, shape):
        return rng.integers(low * 8, high * 8, shape) / 8

    checked = np.zeros(2, dtype=int)
    for _ in range(5):
        shapes = [shapely.Polygon(eighths(0, 12, (3, 2))) for _ in range(7)]
        shapes = [s for s in shapes if 0 < s.area < 15]
        walls = shapely.union_all(shapes)
        parts = [p for p in shapely.get_parts(walls) if p.area > 0]
        # Only worlds whose walls do not cross keep their corners on multiples of 1/8.
        if len(parts) != len(shapes):
            shapes = [p for p in shapes if sum(p.intersects(q) for q in shapes) == 1]
        plan = FloorPlan((shapely.box(0, 0, 12, 12),), tuple(shapes), (True,) * len(shapes))
        if shapely.union_all(shapes).bounds and not shapely.box(0, 0, 12, 12).contains(
            shapely.union_all(shapes)
        ):
            continue
        places = eighths(0, 12, (60, 2))
        places = places[plan.free_at(places)]
        landmarks = landmarks_at(np.unique(places[:8], axis=0))
        edges = (plan.opaque_edges() * 8).astype(int).tolist()
        visible = vector_visible(plan, landmarks, places)
        for i, landmark in enumerate((landmarks.positions * 8).astype(int).tolist()):
            for k, place in enumerate((places * 8).astype(int).tolist()):
                expected = landmark != place and sight_past_edges(edges, landmark, place)
                assert visible[k, i] == expected
                checked[int(expected)] += 1
    assert checked.min() > 50


def test_against_shapely(rng):
    for _ in range(3):
        plan = random_plan(rng)
        see_through = plan.see_through()
        x0, y0, x1, y1 = plan.bounds
        places = rng.uniform([x0, y0], [x1, y1], (150, 2))
        positions = rng.uniform([x0, y0], [x1, y1], (60, 2))
        positions = positions[~plan.opaque_at(positions)]
        visible = vector_visible(plan, landmarks_at(positions), places)
        ends = np.stack(np.broadcast_arrays(places[:, None], positions[None]), axis=2)
        lines = shapely.linestrings(ends)
        shapely.prepare(see_through)
        np.testing.assert_array_equal(visible, shapely.covers(see_through, lines))
        assert visible.any()


OFFICE = FloorPlan(
    (shapely.box(0, 0, 10, 6),),
    (shapely.box(4.98, 0, 5.0, 2.5), shapely.box(4.98, 3.5, 5.0, 6), shapely.box(7, 2, 7.01, 4)),
    (True, True, False),
)


class TestThinWalls:
    @pytest.mark.parametrize(
        ("position", "facing", "west", "east"),
        [
            ((4.98, 1.0), math.pi, True, False),
            ((5.0, 1.0), 0.0, False, True),
            ((4.99, 1.0), math.pi, True, False),
            ((4.99, 1.0), 0.0, False, True),
            ((4.98, 1.0), None, True, False),
            ((5.0, 1.0), None, False, True),
            ((4.9800000001, 1.0), None, True, False),
            ((5.0000004, 1.0), None, False, True),
        ],
    )
    def test_a_wall_landmark_shines_into_its_own_room(self, position, facing, west, east):
        options = {} if facing is None else {"facing": [facing]}
        seen = vector_visible(OFFICE, landmarks_at([position], **options), [[2.0, 1.5], [8.0, 1.5]])
        assert seen[:, 0].tolist() == [west, east]

    def test_nothing_leaks_anywhere(self):
        frame = OFFICE.grid_frame(0.05)
        landmarks = landmarks_at([(4.98, 1.0), (5.0, 5.0)], facing=[math.pi, 0.0])
        cells = seen_cells(vector_runs(OFFICE, landmarks, frame))
        x = frame.centres()[..., 0]
        assert not cells[..., 0][x > 4.99].any()
        assert not cells[..., 1][x < 4.99].any()
        assert cells[..., 0][x < 4.9].all()

    def test_through_the_door_and_through_glass(self):
        landmarks = landmarks_at([(1.0, 3.0), (9.0, 3.0)])
        seen = vector_visible(OFFICE, landmarks, [[9.0, 3.0], [9.0, 5.5], [5.5, 3.0], [6.0, 5.0]])
        assert seen.tolist() == [[True, False], [False, True], [True, True], [False, True]]


class TestRangeAndFacing:
    HALL = FloorPlan((shapely.box(0, 0, 20, 20),))

    def test_the_range_is_inclusive(self):
        points = [[13.0, 14.0], [13.0, 14.001], [10.0, 15.0], [10.3, 10.4]]
        landmarks = landmarks_at([(10.0, 10.0)])
        seen = vector_visible(self.HALL, landmarks, points, max_range=5.0)
        assert seen[:, 0].tolist() == [True, False, True, True]
        assert vector_visible(self.HALL, landmarks, points, max_range=0.5)[3, 0]

    def test_the_range_is_measured_from_the_surveyed_place(self):
        plan = FloorPlan((shapely.box(0, 0, 20, 20),), (shapely.box(0, 0, 1, 20),), (True,))
        landmarks = landmarks_at([(0.95, 10.0)])
        seen = vector_visible(plan, landmarks, [[5.95, 10.0], [5.96, 10.0]], max_range=5.0)
        assert seen[:, 0].tolist() == [True, False]

    def test_a_disc_of_cells(self):
        frame = self.HALL.grid_frame(0.25)
        cells = seen_cells(vector_runs(self.HALL, landmarks_at([(7.3, 9.1)]), frame, max_range=4.0))[..., 0]
        away = np.hypot(*np.moveaxis(frame.centres() - [7.3, 9.1], -1, 0))
        np.testing.assert_array_equal(cells, away <= 4.0)

    @pytest.mark.parametrize("half", [0.2, math.pi / 4, math.pi / 2, 2.0, 3.0])
    @pytest.mark.parametrize("facing", [0.0, 1.1, -math.pi, math.pi / 4])
    def test_the_cone_is_inclusive(self, half, facing):
        landmarks = landmarks_at([(10.0, 10.0)], facing=[facing], half_angle=[half])
        turn = np.concatenate([np.linspace(-math.pi, math.pi, 97), [half, -half, half + 1e-6, -half - 1e-6]])
        points = 10.0 + 5.0 * np.column_stack([np.cos(facing + turn), np.sin(facing + turn)])
        seen = vector_visible(self.HALL, landmarks, points)[:, 0]
        # Places are rounded to a micrometre: the rim is as sharp as that allows.
        off = np.abs(np.abs(turn) - half)
        sharp = off > 5e-7
        np.testing.assert_array_equal(seen[sharp], (np.abs(turn) < half)[sharp])
        frame = self.HALL.grid_frame(0.5)
        cells = seen_cells(vector_runs(self.HALL, landmarks, frame))[..., 0]
        np.testing.assert_array_equal(
            cells.ravel(), vector_visible(self.HALL, landmarks, frame.centres().reshape(-1, 2))[:, 0]
        )

    def test_exact_diagonals_of_a_quarter_cone_are_in_it(self):
        landmarks = landmarks_at([(10.0, 10.0)], facing=[0.0], half_angle=[math.pi / 4])
        seen = vector_visible(self.HALL, landmarks, [[13.0, 13.0], [13.0, 7.0], [13.0, 13.01]])
        assert seen[:, 0].tolist() == [True, True, False]

    def test_not_from_its_own_place(self):
        landmarks = landmarks_at([(10.25, 10.25)])
        assert not vector_visible(self.HALL, landmarks, [[10.25, 10.25]]).any()
        cells = seen_cells(vector_runs(self.HALL, landmarks, self.HALL.grid_frame(0.5)))
        assert (~cells).sum() == 1


class TestBuried:
    PLAN = FloorPlan((shapely.box(0, 0, 10, 10),), (shapely.box(4, 4, 6, 6),), (True,))

    def test_deep_in_a_wall_or_outside(self):
        landmarks = landmarks_at([(5, 5), (4.08, 5), (4.2, 5), (10.3, 5), (10.05, 5), (2, 2)])
        assert buried_landmarks(self.PLAN, landmarks).tolist() == [True, False, True, True, False, False]
        points = [[3.0, 5.0], [9.0, 5.0]]
        seen = vector_visible(self.PLAN, landmarks, points)
        assert seen.tolist() == [
            [False, True, False, False, False, True],
            [False, False, False, False, True, True],
        ]
        counts = vector_runs(self.PLAN, landmarks, self.PLAN.grid_frame(0.5)).counts()
        assert ((counts == 0) == buried_landmarks(self.PLAN, landmarks)).all()

    def test_no_landmarks(self):
        none = LandmarkSet.empty()
        assert vector_visible(self.PLAN, none, [[1.0, 1.0]]).shape == (1, 0)
        assert vector_runs(self.PLAN, none, self.PLAN.grid_frame(0.5)).n_landmarks == 0
        assert buried_landmarks(self.PLAN, none).shape == (0,)


def test_points_far_outside_see_nothing():
    plan = TestBuried.PLAN
    seen = vector_visible(plan, landmarks_at([(2, 2)]), [[-1e9, 2.0], [1e12, 1e12], [10.5, 2.0], [1.0, 2.0]])
    assert seen[:, 0].tolist() == [False, False, False, True]
    far = GridFrame(1e6, 1e6, 0.3, 1.0, 20, 20)
    assert vector_runs(plan, landmarks_at([(2, 2)]), far).nbytes == 0


def test_a_huge_floor_gets_a_coarser_lattice():
    plan = FloorPlan((shapely.box(-4e4, 0, 4e4, 3e4),), (shapely.box(0, 0, 1, 2.9e4),), (True,))
    seen = vector_visible(plan, landmarks_at([(-100, 10)]), [[-3e4, 2e4], [100, 10]])
    assert seen[:, 0].tolist() == [True, False]


def test_threads_and_ticks():
    world = bundled_site("warehouse")
    frame = world.grid_frame(0.4)
    ticks = []
    one = vector_runs(world.floor, world.landmarks, frame, max_range=30.0, threads=1)
    many = vector_runs(
        world.floor, world.landmarks, frame, max_range=30.0, threads=4, tick=lambda *a: ticks.append(a)
    )
    np.testing.assert_array_equal(one.row_runs, many.row_runs)
    np.testing.assert_array_equal(one.row_offsets, many.row_offsets)
    n = len(world.landmarks)
    assert ticks == [(k, n) for k in range(1, n + 1)]

    class Stop(Exception):
        pass

    def stop(done, total):
        raise Stop

    with pytest.raises(Stop):
        vector_runs(world.floor, world.landmarks, frame, tick=stop)


def test_warehouse_cells_and_points_agree(rng):
    world = bundled_site("warehouse")
    frame = world.grid_frame(0.1)
    runs = vector_runs(world.floor, world.landmarks, frame, max_range=30.0)
    rows, cols = rng.integers(0, frame.n_rows, 4000), rng.integers(0, frame.n_cols, 4000)
    masks = runs.masks()[rows, cols]
    bits = np.arange(len(world.landmarks))
    seen = (masks[:, bits // 64] >> (bits % 64).astype(np.uint64)) & np.uint64(1)
    single = vector_visible(world.floor, world.landmarks, frame.centres()[rows, cols], max_range=30.0)
    np.testing.assert_array_equal(seen.astype(bool), single)
    assert not buried_landmarks(world.floor, world.landmarks).any()
    assert (runs.counts() > 0).all()
