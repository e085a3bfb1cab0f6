from __future__ import annotations

import numpy as np
import pytest
import shapely
import yaml

from maps.errors import DuplicateLandmark, InvalidGeometry, MapFormatError, MapTooLarge
from maps.io import cob
from maps.io.cob import plan_from_walls, read_line_maps, read_point_maps
from maps.io.load import load_world
from maps.visibility import buried_landmarks, visible_landmarks

NONE = np.empty((0, 2))


def box_of_walls(x0, y0, x1, y1):
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return [(*corners[k], *corners[(k + 1) % 4]) for k in range(4)]


def test_a_closed_room_is_its_floor():
    plan = plan_from_walls(np.array(box_of_walls(0, 0, 8, 6)), NONE)
    assert plan.bounds == pytest.approx((0, 0, 8, 6), abs=0.005)
    assert plan.free_area_m2 == pytest.approx(48, abs=0.1)
    assert plan.obstacles == ()


def test_doors_are_closed_and_wider_openings_are_not():
    door = np.array([(0, 0, 3, 0), (4, 0, 8, 0), (8, 0, 8, 6), (8, 6, 0, 6), (0, 6, 0, 0)], dtype=float)
    plan = plan_from_walls(door, NONE)
    assert plan.free_area_m2 == pytest.approx(48, abs=0.3)
    assert not plan.free_at([3.5, -0.2])
    gate = np.array([(0, 0, 1, 0), (7, 0, 8, 0), (8, 0, 8, 6), (8, 6, 0, 6), (0, 6, 0, 0)], dtype=float)
    for walls in (gate, np.array([(0, 0, 8, 0), (0, 5, 8, 5)], dtype=float)):
        with pytest.raises(InvalidGeometry, match=f"The {len(walls)} walls of the line map enclose no floor"):
            plan_from_walls(walls, NONE)


def test_a_wall_with_floor_on_both_sides_is_an_opaque_strip():
    walls = np.array([*box_of_walls(0, 0, 8, 6), (4, 1, 4, 5)], dtype=float)
    plan = plan_from_walls(walls, NONE)
    assert plan.opaque == (True,)
    assert plan.opaque_at([4, 3])
    assert plan.free_at([[3.95, 3], [4.05, 3], [4, 0.5]]).all()
    assert plan.free_area_m2 == pytest.approx(48 - 4 * 0.04, abs=0.1)


@pytest.mark.parametrize("off", [-0.06, -0.02, 0.0, 0.02, 0.06])
def test_reflectors_stay_in_place_and_are_seen_from_the_floor(off):
    # Before, on and behind the lower wall.
    reflector = np.array([[4.0, off]])
    plan = plan_from_walls(np.array(box_of_walls(0, 0, 8, 6)), reflector)
    see = plan.see_through()
    assert shapely.contains_xy(see, *reflector[0])
    for x in (0.5, 2, 4, 6, 7.5):
        assert shapely.contains(see, shapely.linestrings([reflector[0], [x, 1.5]]))
    assert not plan.free_at([4, -0.15])


def test_what_is_too_thin_or_too_small_is_no_floor():
    walls = np.array(
        [*box_of_walls(0, 0, 8, 6), *box_of_walls(20, 0, 20.8, 0.8), *box_of_walls(30, 0, 36, 0.2)]
    )
    plan = plan_from_walls(walls, NONE)
    assert plan.bounds == pytest.approx((0, 0, 8, 6), abs=0.005)


def write(folder, name, features):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(yaml.safe_dump({"source_id": "laser", "features": features}))


def test_files_of_a_site(tmp_path):
    assert read_point_maps(tmp_path) is None
    assert read_line_maps(tmp_path) is None
    lines = [
        {"id": i, "source": [*w[:2], 0.0], "target": [*w[2:], 0.0]}
        for i, w in enumerate(box_of_walls(0, 0, 5, 5))
    ]
    write(tmp_path / "line_maps", "b.yaml", lines[:2])
    write(tmp_path / "line_maps", "a.yaml", [*lines[2:], {"source": [1, 1, 0], "target": [1, 1, 0]}])
    np.testing.assert_array_equal(read_line_maps(tmp_path), np.roll(box_of_walls(0, 0, 5, 5), 2, axis=0))
    write(tmp_path / "point_maps", "a.yaml", [{"id": 0, "position": [1, 0, 0]}])
    write(tmp_path / "point_maps", "b.yaml", [{"id": "x", "position": [2, 0], "description": "no"}])
    assert read_point_maps(tmp_path).ids == ("0", "x")
    world = load_world(tmp_path)
    assert world.floor.free_area_m2 == pytest.approx(25, abs=0.1)
    write(tmp_path / "point_maps", "c.yaml", [{"id": "x", "position": [3, 0, 0]}])
    with pytest.raises(DuplicateLandmark, match="'x'"):
        load_world(tmp_path)


@pytest.mark.parametrize(
    ("feature", "says"),
    [
        ({"source": [0, 0, 0]}, r"features\[0\] lacks the member 'target'"),
        ({"source": [0, 0, 0], "target": [0, ".nan", 0]}, r"features\[0\]\.target\[1\]"),
        ({"source": [0, 0, 0], "target": 7}, r"features\[0\]\.target is 7"),
        ({"source": [0, 0, 0], "target": [1, 1, 0], "width": 1}, r"features\[0\]\.width is not allowed"),
        (7, r"features\[0\] is 7"),
    ],
)
def test_mistakes_in_line_maps_name_file_and_place(tmp_path, feature, says):
    write(tmp_path / "line_maps", "walls.yaml", [feature])
    with pytest.raises(MapFormatError, match=r"walls\.yaml: " + says):
        load_world(tmp_path)


def test_limits_of_line_maps(tmp_path, monkeypatch):
    (tmp_path / "line_maps").mkdir()
    (tmp_path / "line_maps" / "a.yaml").write_text("source_id: x")
    with pytest.raises(MapFormatError, match="features is None"):
        read_line_maps(tmp_path)
    write(tmp_path / "line_maps", "a.yaml", [{"source": [0, k, 0], "target": [1, k, 0]} for k in range(4)])
    with pytest.raises(InvalidGeometry, match="line_maps: The 4 walls"):
        load_world(tmp_path)
    monkeypatch.setattr(cob, "_MAX_LINES", 3)
    with pytest.raises(MapTooLarge, match="4 lines, the limit is 3"):
        read_line_maps(tmp_path)


def test_the_real_office(shared_data):
    folder = shared_data / "landmark_maps/cob/ipa-office"
    world = load_world(folder)
    assert world.name == "ipa-office"
    raw = yaml.safe_load((folder / "point_maps/reflMarkerMap_IPA4thFloor.yaml").read_text())["features"]
    np.testing.assert_array_equal(world.landmarks.positions, [f["position"][:2] for f in raw])
    assert len(world.landmarks) == 16
    # The corridors are where the site's own vehicles drove, but for the rooms that the scanner left open.
    route = yaml.safe_load((folder / "path_segments.yaml").read_text())["control points"]
    places = np.array([p["location"] for p in route])
    assert world.floor.free_at(places).mean() > 0.95
    # Every wall of the line map is an edge of free space or shut off from it.
    walls = read_line_maps(folder)
    middles = (walls[:, :2] + walls[:, 2:]) / 2
    assert shapely.distance(shapely.points(middles), world.floor.free_space().buffer(-0.03)).min() > 0.009
    assert 400 < world.floor.free_area_m2 < 700
    assert not buried_landmarks(world).any()
    # The crossing in the north, with reflectors all around, is a good place.
    seen = visible_landmarks(world, [[3.5, 41.5], [6.3, 50.0]], max_range=30.0)
    assert seen.sum(axis=1).min() >= 7


def test_the_real_plant(shared_data):
    world = load_world(shared_data / "landmark_maps/cob/ipa-production-plant")
    assert world.name == "ipa-production-plant"
    assert len(world.landmarks) == 48
    assert world.floor.frame.shape == (1536, 1985)
    assert world.floor.free_area_m2 == pytest.approx(1221263 * 0.05**2)
    assert not buried_landmarks(world).any()
