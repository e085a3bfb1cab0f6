"""Visibility on cells: sweeps against exact rays, drawn rooms, walls that carry landmarks, real maps."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from PIL import Image

from maps.errors import InvalidGeometry
from maps.grid import GridFrame, OccupancyGrid
from maps.grid_visibility import buried_landmarks, grid_runs, grid_visible
from maps.landmarks import LandmarkSet
from tests.oracles import pocket_on_grid, sight_on_grid
from tests.worlds import place_in_ascii, world_from_ascii

UNIT = 1 << 16
PLANT = "landmark_maps/cob/ipa-production-plant"


def bits(runs, masks=None):
    """Masks as bool (n_rows, n_cols, N)."""
    masks = runs.masks() if masks is None else masks
    i = np.arange(runs.n_landmarks)
    return (masks[..., i // 64] >> (i % 64).astype(np.uint64) & np.uint64(1)).astype(bool)


def rays(floor, landmarks, frame, **ranges):
    return grid_visible(floor, landmarks, frame.centres().reshape(-1, 2), **ranges).reshape(*frame.shape, -1)


def random_floor(rng, n_rows, n_cols, resolution=None):
    frame = GridFrame(
        float(rng.choice([0.0, -3.7, 12.25])),
        float(rng.choice([0.0, 5.1])),
        float(rng.choice([0.0, 0.3, -2.0])),
        float(rng.choice([0.05, 0.1, 1.0, 0.0504])) if resolution is None else resolution,
        int(n_rows),
        int(n_cols),
    )
    opaque = rng.random(frame.shape) < rng.choice([0.02, 0.1, 0.3])
    return OccupancyGrid(frame, ~opaque & (rng.random(frame.shape) < 0.8), opaque)


def random_landmarks(rng, floor, n, facing=True):
    """On corners, edges, middles, a lattice unit beside them, anywhere, also just outside the grid."""
    n_rows, n_cols = floor.frame.shape
    while True:
        cells = rng.uniform([-1, -1], [n_cols + 1, n_rows + 1], (n, 2))
        kind = rng.integers(0, 5, n)
        cells[kind == 0] = np.rint(cells[kind == 0])
        cells[kind == 1] = np.floor(cells[kind == 1]) + 0.5
        cells[kind == 2, 0] = np.rint(cells[kind == 2, 0])
        cells[kind == 3] = np.rint(cells[kind == 3]) + rng.integers(-2, 3, (int((kind == 3).sum()), 2)) / UNIT
        if len(np.unique(cells.round(3), axis=0)) == n:
            break
    azimuth = rng.choice([0.0, math.pi / 2, math.pi / 4, 1.1, -2.3], n) + floor.frame.yaw
    half = rng.choice([0.3, math.pi / 4, math.pi / 2, 2.0, 3.1, math.pi], n)
    all_around = (rng.random(n) < 0.5) | (not facing)
    return LandmarkSet(
        tuple(f"L{i}" for i in range(n)),
        floor.frame.to_world(cells),
        np.where(all_around, np.nan, azimuth),
        np.where(all_around, np.nan, half),
    )


@pytest.mark.parametrize("ratio", [1.0, 2.0, 3.0, 0.5, 1 / 3, 0.3, 1.5, 0.1 / 0.0504, 0.7071])
def test_sweep_equals_one_exact_ray_per_cell(rng, ratio):
    seen = 0
    for _ in range(250):
        floor = random_floor(rng, *rng.integers(1, 14, 2))
        landmarks = random_landmarks(rng, floor, 4)
        res = floor.frame.resolution
        frame = floor.grid_frame(res * ratio)
        ranges = {
            "min_range": float(rng.choice([0.0, 0.0, 1.5, 2.0])) * res,
            "max_range": float(rng.choice([math.inf, 4.0, 7.3])) * res,
        }
        runs = grid_runs(floor, landmarks, frame, threads=1, **ranges)
        got = bits(runs)
        assert (got == rays(floor, landmarks, frame, **ranges)).all()
        assert (runs.counts() == got.sum(axis=(0, 1))).all()  # no cell twice
        seen += got.sum()
    assert seen > 2000


def test_everything_equals_the_slow_twin(rng):
    seen = 0
    for _ in range(150):
        floor = random_floor(rng, *rng.integers(2, 8, 2))
        frame, (n_rows, n_cols) = floor.frame, floor.frame.shape
        landmarks = random_landmarks(rng, floor, 3)
        max_range = 4.0 * frame.resolution
        got = bits(grid_runs(floor, landmarks, frame, max_range=max_range, threads=1))
        azimuth = landmarks.facing - frame.yaw
        for i in range(3):
            place = tuple(int(v) for v in np.rint(frame.to_grid(landmarks.positions[i]) * UNIT))
            normal = (0.0, 0.0)
            if landmarks.has_facing[i]:
                normal = (math.cos(azimuth[i]), math.sin(azimuth[i]))
            name, pocket = pocket_on_grid(floor.opaque, floor.free, UNIT, place, normal, 1.2, 9)
            cells = {(r, c): floor.opaque[r, c] for r in range(n_rows) for c in range(n_cols)} | pocket
            for row in range(n_rows):
                for col in range(n_cols):
                    target = (col * UNIT + UNIT // 2, row * UNIT + UNIT // 2)
                    d = np.array(target) - place
                    distance = math.hypot(*d) / UNIT * frame.resolution
                    off_axis = 0.0
                    if landmarks.has_facing[i]:
                        off_axis = abs(math.remainder(math.atan2(d[1], d[0]) - azimuth[i], 2 * math.pi))
                    if abs(off_axis - landmarks.half_angle[i]) < 1e-8 or abs(distance - max_range) < 1e-8:
                        continue
                    expected = (
                        name != "buried"
                        and distance <= max_range
                        and off_axis <= landmarks.half_angle[i]
                        and sight_on_grid(lambda r, c, cells=cells: cells[r, c], cells, UNIT, place, target)
                    )
                    assert got[row, col, i] == expected
                    seen += expected
    assert seen > 1000


def seen_picture(drawing, letter="A", **options):
    """The drawing with * where landmark A is visible on free cells."""
    world = world_from_ascii(drawing, **options)
    seen = bits(grid_runs(world.floor, world.landmarks, world.floor.frame))[
        ..., world.landmarks.ids.index(letter)
    ]
    lines = [line.strip() for line in drawing.strip().splitlines()]
    return [
        "".join("*" if seen[len(lines) - 1 - r, c] and ch != "#" else ch for c, ch in enumerate(line))
        for r, line in enumerate(lines)
    ]


def test_a_wall_hides_what_is_behind_it():
    assert seen_picture("""
        .......
        ...#...
        ...#...
        A..#...
        .......
        .......
        .......
    """) == [
        "****...",
        "***#...",
        "***#...",
        "A**#...",
        "******.",
        "*******",
        "*******",
    ]  # fmt: skip


def test_no_gap_between_cells_that_meet_at_a_corner():
    seen = seen_picture("""
        ....#....
        ....#....
        ....#....
        .A...#...
        .....#...
        .....#...
    """)
    for line, wall in zip(seen, (4, 4, 4, 5, 5, 5), strict=True):
        assert "*" not in line[wall:]
        assert "." not in line[:wall].replace("A", "*")


ROOMS = """
    ?????????????
    ?###########?
    ?#....#....#?
    ?#....#....#?
    ?#....#....#?
    ?#....#....#?
    ?#.........#?
    ?###########?
    ?????????????
"""


def room_world(x, y, **options):
    world = world_from_ascii(ROOMS, resolution=1.0)
    return world.with_landmarks(LandmarkSet(("A",), np.array([[x, y]]), **options))


@pytest.mark.parametrize("x", [6.0, 5.999999, 6.000001, 5.9])
def test_landmark_on_a_wall_sees_its_room_and_not_the_one_behind(x):
    # The wall between the rooms is column 6; the landmark hangs at its left face.
    world = room_world(x, 4.5)
    seen = bits(grid_runs(world.floor, world.landmarks, world.floor.frame))[..., 0]
    assert seen[2:7, 2:6].all()
    assert not seen[3:7, 7:11].any()
    assert not seen[3:7, 11:].any()


@pytest.mark.parametrize(("facing", "left"), [(math.pi, True), (0.0, False)])
def test_facing_says_which_side_a_landmark_inside_a_thin_wall_belongs_to(facing, left):
    world = room_world(6.5, 4.5, facing=np.array([facing]))
    seen = bits(grid_runs(world.floor, world.landmarks, world.floor.frame))[..., 0]
    assert seen[2:7, 2:6].all() == left
    assert seen[3:7, 7:11].all() != left
    assert seen[3:7, 2:6].any() == left


def test_landmark_on_the_outer_wall_or_outside_it(rng):
    inside = bits(
        grid_runs(room_world(1.2, 4.5).floor, room_world(1.2, 4.5).landmarks, room_world(0, 0).floor.frame)
    )
    assert inside[2:7, 2:6, 0].all()
    # Beyond the grid, in front of a wall that it does not touch.
    world = room_world(-0.4, 4.5)
    seen = bits(grid_runs(world.floor, world.landmarks, world.floor.frame))[..., 0]
    assert seen[:, 0].all()
    assert not seen[2:7, 2:11].any()


def test_buried_landmarks_see_nothing_and_are_reported():
    opaque = np.ones((9, 9), dtype=bool)
    opaque[:, :2] = False
    floor = OccupancyGrid(GridFrame(0, 0, 0, 0.1, 9, 9), ~opaque, opaque)
    landmarks = LandmarkSet(("deep", "shallow"), np.array([[0.45, 0.45], [0.31, 0.45]]))
    assert buried_landmarks(floor, landmarks).tolist() == [True, False]
    assert bits(grid_runs(floor, landmarks, floor.frame)).any(axis=(0, 1)).tolist() == [False, True]
    assert not grid_visible(floor, landmarks, [[0.05, 0.45]])[0, 0]


def test_ranges_and_viewing_angles_are_inclusive():
    open_floor = OccupancyGrid(GridFrame(0, 0, 0, 0.1, 9, 9), np.ones((9, 9), bool), np.zeros((9, 9), bool))
    centre = np.array([[0.45, 0.45]])
    plain = LandmarkSet(("A",), centre)
    seen = bits(grid_runs(open_floor, plain, open_floor.frame, min_range=0.2, max_range=0.3))[4, :, 0]
    assert seen.tolist() == [False, True, True, False, False, False, True, True, False]
    facing = LandmarkSet(("A",), centre, np.array([0.0]), np.array([math.pi / 4]))
    seen = bits(grid_runs(open_floor, facing, open_floor.frame))[..., 0]
    rows, cols = np.indices((9, 9)) - 4
    assert (seen == ((np.abs(rows) <= cols) & (cols > 0))).all()
    back = LandmarkSet(("A",), centre, np.array([math.pi]), np.array([3 * math.pi / 4]))
    seen = bits(grid_runs(open_floor, back, open_floor.frame))[..., 0]
    away = (rows != 0) | (cols != 0)
    assert (seen == (away & (np.abs(rows) >= cols))).all()


def test_turned_map_sees_the_same_cells(rng):
    for yaw in (0.7, -2.5):
        a = random_floor(rng, 12, 9, 0.1)
        straight = OccupancyGrid(GridFrame(0, 0, 0, 0.1, 12, 9), a.free, a.opaque)
        turned = OccupancyGrid(GridFrame(3, -2, yaw, 0.1, 12, 9), a.free, a.opaque)
        cells = rng.uniform([0, 0], [9, 12], (6, 2))
        facing = rng.uniform(-3, 3, 6)
        names = tuple("abcdef")
        both = [
            bits(
                grid_runs(
                    f,
                    LandmarkSet(names, f.frame.to_world(cells), facing + f.frame.yaw),
                    f.frame,
                    max_range=0.6,
                )
            )
            for f in (straight, turned)
        ]
        assert (both[0] == both[1]).all()
        assert both[0].any()


def test_landmarks_in_the_far_corner_of_a_turned_maps_bounds(rng):
    floor = random_floor(rng, 20, 30, 0.1)
    floor = OccupancyGrid(GridFrame(0, 0, math.pi / 4, 0.1, 20, 30), floor.free, floor.opaque)
    x0, y0, x1, y1 = floor.bounds
    landmarks = LandmarkSet(tuple("abcd"), np.array([[x0, y0], [x1, y0], [x1, y1], [x0 - 0.4, y1]]))
    frame = floor.grid_frame(0.13)
    got = bits(grid_runs(floor, landmarks, frame))
    assert (got == rays(floor, landmarks, frame)).all()
    assert got.any()


def test_threads_do_not_change_the_result_and_every_landmark_ticks(rng):
    floor = random_floor(rng, 60, 50, 0.1)
    landmarks = random_landmarks(rng, floor, 70)
    calls = []
    one = grid_runs(floor, landmarks, floor.grid_frame(0.07), threads=1)
    many = grid_runs(floor, landmarks, floor.grid_frame(0.07), threads=4, tick=lambda *a: calls.append(a))
    assert calls == [(i + 1, 70) for i in range(70)]
    for name in ("row_runs", "row_offsets", "col_runs", "col_offsets"):
        assert (getattr(one, name) == getattr(many, name)).all()
    assert one.n_words == 2


def test_a_tick_may_stop_the_work(rng):
    floor = random_floor(rng, 10, 10, 0.1)

    def stop(done, total):
        raise InterruptedError

    with pytest.raises(InterruptedError):
        grid_runs(floor, random_landmarks(rng, floor, 5), floor.frame, tick=stop)


def test_no_landmarks_and_no_points(rng):
    floor = random_floor(rng, 4, 5, 0.1)
    assert not grid_runs(floor, LandmarkSet.empty(), floor.frame).masks().any()
    assert grid_visible(floor, LandmarkSet.empty(), np.zeros((3, 2))).shape == (3, 0)
    assert grid_visible(floor, random_landmarks(rng, floor, 2), np.empty((0, 2))).shape == (0, 2)
    assert not grid_visible(floor, random_landmarks(rng, floor, 2), [[1e9, 0.0]]).any()


def test_frames_that_do_not_suit_are_refused(rng):
    floor = random_floor(rng, 4, 5, 0.1)
    own = floor.frame
    turned = GridFrame(own.origin_x, own.origin_y, own.yaw + 0.1, 0.1, 4, 5)
    with pytest.raises(InvalidGeometry, match=r"turned by 0\.1 rad"):
        grid_runs(floor, LandmarkSet.empty(), turned)
    far = GridFrame(own.origin_x + 1e6, own.origin_y, own.yaw, 0.1, 4, 5)
    with pytest.raises(InvalidGeometry, match="keep it within"):
        grid_runs(floor, LandmarkSet.empty(), far)


def test_very_long_grids_get_a_coarser_lattice():
    opaque = np.zeros((1, 300_000), dtype=bool)
    opaque[0, 200_000] = True
    floor = OccupancyGrid(GridFrame(0, 0, 0, 0.05, 1, 300_000), ~opaque, opaque)
    landmarks = LandmarkSet(("A",), np.array([[100.0, 0.025]]))
    seen = bits(grid_runs(floor, landmarks, floor.frame))[0, :, 0]
    assert seen.sum() == 200_000  # all before the wall; the landmark stands between two centres
    assert seen[:200_000].all()


def scattered_landmarks(rng, floor, n):
    rows, cols = np.nonzero(floor.free)
    pick = rng.choice(len(rows), n, replace=False)
    cells = np.column_stack([cols[pick], rows[pick]]) + rng.choice([0.0, 0.5, 0.31], (n, 2))
    facing = np.where(rng.random(n) < 0.5, np.nan, rng.uniform(-3, 3, n))
    return LandmarkSet(tuple(f"R{i}" for i in range(n)), floor.frame.to_world(cells), facing)


def floor_from_image(path, resolution, origin):
    dark = (255 - np.array(Image.open(path).convert("L"))[::-1]) / 255.0
    frame = GridFrame(origin[0], origin[1], 0.0, resolution, *dark.shape)
    return OccupancyGrid(frame, dark < 0.196, dark > 0.65, (dark >= 0.196) & (dark <= 0.65))


def compare_on_random_cells(rng, floor, landmarks, resolution, n, **ranges):
    frame = floor.grid_frame(resolution)
    runs = grid_runs(floor, landmarks, frame, **ranges)
    masks = runs.masks()
    rows, cols = rng.integers(0, frame.n_rows, n), rng.integers(0, frame.n_cols, n)
    # Half of them at the borders of what is seen, where mistakes would be.
    border = np.argwhere((masks[1:, 1:] != masks[:-1, :-1]).any(axis=2))
    pick = border[rng.choice(len(border), n // 2)]
    rows[: n // 2], cols[: n // 2] = pick[:, 0], pick[:, 1]
    points = frame.to_world(np.column_stack([cols + 0.5, rows + 0.5]))
    assert (bits(runs, masks[rows, cols]) == grid_visible(floor, landmarks, points, **ranges)).all()
    return runs


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_plant_with_its_reflectors(rng, shared_data, resolution):
    folder = shared_data / PLANT
    floor = floor_from_image(folder / "map.pgm", 0.05, (-31.200001, -56.799999))
    features = yaml.safe_load((folder / "point_maps/reflMarker_gazebo.yaml").read_text())["features"]
    places = np.array([f["position"][:2] for f in features])
    landmarks = LandmarkSet(tuple(f["description"] for f in features), places)
    assert not buried_landmarks(floor, landmarks).any()
    runs = compare_on_random_cells(rng, floor, landmarks, resolution, 4000, max_range=30.0)
    if resolution == 0.05:
        return
    where = floor.free_at(floor.grid_frame(resolution).centres())
    seen = bits(runs)[where]
    assert seen.any(axis=0).all()  # every reflector is seen from somewhere
    assert 0.6 < (seen.sum(axis=1) >= 3).mean() < 0.8
    # A shift by a micrometre, as in the map's own origin, changes next to nothing.
    moved = LandmarkSet(landmarks.ids, places + 1e-6)
    again = bits(compare_on_random_cells(rng, floor, moved, resolution, 100, max_range=30.0))[where]
    assert (again != seen).sum() < 1e-3 * seen.sum()


def test_depot_with_scattered_landmarks(rng, shared_data):
    folder = next((shared_data / "ros_maps" / "nav2").rglob("depot.pgm"))
    floor = floor_from_image(folder, 0.05, (0.0, 0.0))
    landmarks = scattered_landmarks(rng, floor, 40)
    for resolution in (0.05, 0.03, 0.1):
        compare_on_random_cells(rng, floor, landmarks, resolution, 3000, min_range=0.5, max_range=12.0)


def test_single_points_agree_with_a_drawing():
    drawing = """
        #######
        #A.#.s#
        #..#..#
        #.....#
        #g....#
        #######
    """
    world = world_from_ascii(drawing)
    points = [place_in_ascii(drawing, "g"), place_in_ascii(drawing, "s")]
    assert grid_visible(world.floor, world.landmarks, points).tolist() == [[True], [False]]
