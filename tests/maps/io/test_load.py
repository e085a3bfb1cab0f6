from __future__ import annotations

import numpy as np
import pytest

from maps.errors import LandmarkOutsideMap, MapFormatError
from maps.floor_plan import FloorPlan
from maps.io.load import load_world
from maps.io.site import bundled_site, bundled_site_text

YAML = (
    "image: map.pgm\nresolution: 1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


@pytest.fixture
def ros_site(tmp_path):
    folder = tmp_path / "hall"
    folder.mkdir()
    (folder / "map.yaml").write_text(YAML)
    (folder / "map.pgm").write_bytes(b"P5 3 2 255\n" + bytes([254, 205, 0, 254, 254, 254]))
    (folder / "marks.csv").write_text("id,x,y\nA,0.5,0.5\nB,2.5,0.5\n")
    return folder


def test_world_files(tmp_path):
    file = tmp_path / "x.geojson"
    file.write_text(bundled_site_text("mas97_room"))
    world = load_world(file)
    assert world.name == "mas97_room"
    assert world.content_hash() == bundled_site("mas97_room").content_hash()
    assert load_world(str(file), name="other").name == "other"
    (tmp_path / "m.csv").write_text("id,x,y\nA,1,1\n")
    assert load_world(file, landmarks=tmp_path / "m.csv").landmarks.ids == ("A",)
    assert load_world(tmp_path, landmarks=tmp_path / "m.csv").landmarks.ids == ("A",)
    assert isinstance(load_world(tmp_path).floor, FloorPlan)


def test_map_images(ros_site):
    world = load_world(ros_site / "map.yaml")
    assert (world.name, len(world.landmarks)) == ("hall", 0)
    assert load_world(ros_site).content_hash() == world.content_hash()
    world = load_world(ros_site / "map.yaml", landmarks=ros_site / "marks.csv", name="n")
    assert (world.name, world.landmarks.ids) == ("n", ("A", "B"))
    assert not world.floor.free[1, 1]
    assert not world.floor.opaque[1, 1]
    assert load_world(ros_site, unknown_is_free=True).floor.free[1, 1]
    assert load_world(ros_site / "map.yaml", unknown_is_opaque=True).floor.opaque[1, 1]
    (ros_site / "map.yaml").rename(ros_site / "plan.yml")
    assert load_world(ros_site / "plan.yml").name == "plan"
    assert load_world(ros_site).name == "hall"


def test_point_maps_beside_the_image_belong_to_the_site(ros_site):
    (ros_site / "point_maps").mkdir()
    (ros_site / "point_maps" / "a.yaml").write_text("features: [{id: 1, position: [1.0, 1.0, 0.0]}]")
    world = load_world(ros_site)
    np.testing.assert_array_equal(world.landmarks.positions, [[1, 1]])
    assert load_world(ros_site, landmarks=ros_site / "marks.csv").landmarks.ids == ("A", "B")
    # Walls are asked only where there is no image.
    (ros_site / "line_maps").mkdir()
    (ros_site / "line_maps" / "a.yaml").write_text("features: nonsense")
    assert load_world(ros_site).content_hash() == world.content_hash()
    (ros_site / "map.pgm").unlink()
    with pytest.raises(MapFormatError, match="features is 'nonsense'"):
        load_world(ros_site)
    with pytest.raises(
        MapFormatError, match=r"map\.yaml' is missing; give the folder '.*hall' to use its line_maps"
    ):
        load_world(ros_site / "map.yaml")


def test_what_is_missing_or_unclear_is_named(ros_site, tmp_path):
    with pytest.raises(MapFormatError, match=r"There is no map '.*nowhere'"):
        load_world(tmp_path / "nowhere")
    (tmp_path / "floor.dxf").write_text("0\nSECTION")
    with pytest.raises(MapFormatError, match=r"floor\.dxf' is no map that can be read: give a world file"):
        load_world(tmp_path / "floor.dxf")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MapFormatError, match=r"empty' holds no map: it needs map\.yaml"):
        load_world(tmp_path / "empty")
    (ros_site / "map.pgm").unlink()
    for source in (ros_site, ros_site / "map.yaml"):
        with pytest.raises(MapFormatError, match=r"map\.yaml: There is no map image"):
            load_world(source)
    (ros_site / "map.yaml").rename(ros_site / "a.yaml")
    (ros_site / "b.yaml").write_text(YAML)
    (ros_site / "c.geojson").write_text("{}")
    with pytest.raises(MapFormatError, match=r"several maps \(a\.yaml, b\.yaml, c\.geojson\)"):
        load_world(ros_site)
    (ros_site / "c.geojson").unlink()
    (ros_site / "b.yaml").unlink()
    (ros_site / "a.yaml").write_text("image: [")
    with pytest.raises(MapFormatError, match=r"a\.yaml: The map YAML is not valid"):
        load_world(ros_site)


def test_landmarks_outside_the_map_are_refused_and_nothing_changes(ros_site):
    (ros_site / "far.csv").write_text("id,x,y\nA,0.5,0.5\nB,3.6,0.5\n")
    before = {f.name: f.read_bytes() for f in ros_site.iterdir()}
    with pytest.raises(
        LandmarkOutsideMap, match=r"'B' at \(3\.6, 0\.5\) m is outside the map, which spans x 0 … 3"
    ):
        load_world(ros_site / "map.yaml", landmarks=ros_site / "far.csv")
    assert {f.name: f.read_bytes() for f in ros_site.iterdir()} == before
