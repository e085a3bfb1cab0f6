from __future__ import annotations

import contextlib
import copy
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon, box

from maps.errors import (
    DuplicateLandmark,
    InvalidGeometry,
    InvalidLandmark,
    LandmarkOutsideMap,
    MapError,
    MapFormatError,
    MapTooLarge,
)
from maps.floor_plan import FloorPlan
from maps.io import world_file
from maps.io.world_file import read_world_file, world_from_geojson, world_to_geojson, write_world_file
from maps.landmarks import LandmarkSet
from maps.world import World
from tests.worlds import world_from_ascii

RING = [[0, 0], [10, 0], [10, 8], [0, 8], [0, 0]]
HOLE = [[4, 4], [5, 4], [5, 5], [4, 5], [4, 4]]


def polygon(kind="floor", rings=(RING,), **properties):
    geometry = {"type": "Polygon", "coordinates": list(rings)}
    return {"type": "Feature", "properties": {"kind": kind, **properties}, "geometry": geometry}


def point(name="A", xy=(1, 1), **properties):
    geometry = {"type": "Point", "coordinates": list(xy)}
    return {
        "type": "Feature",
        "properties": {"kind": "landmark", "id": name, **properties},
        "geometry": geometry,
    }


def document(*features, **more):
    return {"type": "FeatureCollection", "features": list(features), **more}


def good():
    return document(
        polygon(rings=(RING, HOLE)),
        polygon("obstacle", ([[1, 2], [2, 2], [2, 3], [1, 3], [1, 2]],), opaque=False),
        polygon("obstacle", ([[6, 2], [7, 2], [7, 3], [6, 3], [6, 2]],)),
        point("A", (0.5, 0.5)),
        point("B", (9.5, 0.5), facing_rad=1.5, half_angle_rad=0.7, sigma_m=0.01),
        point("C", (9.5, 7.5), facing_rad=-2),
        name="hall",
    )


def test_a_world_has_what_its_file_says():
    world = world_from_geojson(good())
    assert world.name == "hall"
    assert world.bounds == (0, 0, 10, 8)
    assert world.floor.free_area_m2 == pytest.approx(80 - 1 - 1 - 1)
    assert world.floor.opaque == (False, True)
    assert world.landmarks.ids == ("A", "B", "C")
    np.testing.assert_array_equal(world.landmarks.has_facing, [False, True, True])
    np.testing.assert_allclose(world.landmarks.half_angle, [math.pi, 0.7, math.pi / 2])
    np.testing.assert_array_equal(world.landmarks.sigma, [0, 0.01, 0])
    assert world_from_geojson(good(), name="other").name == "other"
    assert world_from_geojson(document(polygon())).name == "world"


def test_text_bytes_and_parsed_documents_are_the_same():
    text = json.dumps(good())
    hashes = {
        world_from_geojson(d).content_hash()
        for d in (good(), text, text.encode(), b"\xef\xbb\xbf" + text.encode())
    }
    assert len(hashes) == 1


def change(path, value):
    """A good document with one place changed, added or (Ellipsis) removed."""
    out = copy.deepcopy(good())
    place = out
    for key in path[:-1]:
        place = place[key]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return out


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (["crs"], {}, r"document\.crs is not allowed; allowed here: type, features, name"),
        (["bbox"], [0, 0, 1, 1], r"document\.bbox"),
        (["name"], 7, "name is 7"),
        (["name"], "", "name is ''"),
        (["type"], "Feature", "type is 'Feature'"),
        (["features"], {}, r"features is \{\}"),
        (["features", 0], 5, r"features\[0\] is 5"),
        (["features", 3, "id"], 5, r"features\[3\]\.id is not allowed"),
        (["features", 3, "type"], "Point", r"features\[3\]\.type"),
        (["features", 3, "properties"], None, r"features\[3\]\.properties"),
        (
            ["features", 3, "properties", "color"],
            "red",
            r"features\[3\]\.properties\.color is not allowed; .*sigma_m",
        ),
        (["features", 0, "properties", "opaque"], True, r"features\[0\]\.properties\.opaque is not allowed"),
        (
            ["features", 1, "properties", "opaque"],
            1,
            r"features\[1\]\.properties\.opaque is 1; .* true or false",
        ),
        (
            ["features", 1, "properties", "kind"],
            "wall",
            r"features\[1\]\.properties\.kind is 'wall'.*'floor' or 'obstacle'",
        ),
        (["features", 1, "properties", "kind"], "landmark", r"features\[1\]\.properties\.kind"),
        (["features", 1, "properties", "kind"], ["floor"], r"features\[1\]\.properties\.kind"),
        (["features", 1, "properties", "kind"], ..., r"features\[1\]\.properties lacks the member 'kind'"),
        (["features", 3, "properties", "kind"], "floor", r"a Point must be 'landmark'"),
        (["features", 3, "properties", "id"], ..., r"features\[3\]\.properties lacks the member 'id'"),
        (["features", 3, "properties", "id"], 3, r"features\[3\]\.properties\.id is 3"),
        (["features", 4, "properties", "facing_rad"], "1", r"features\[4\]\.properties\.facing_rad is '1'"),
        (["features", 4, "properties", "facing_rad"], True, r"features\[4\]\.properties\.facing_rad is True"),
        (
            ["features", 4, "properties", "facing_rad"],
            math.nan,
            r"features\[4\]\.properties\.facing_rad is nan",
        ),
        (["features", 4, "properties", "facing_rad"], ..., "half_angle_rad without facing_rad"),
        (["features", 0, "geometry"], None, r"features\[0\]\.geometry is None"),
        (["features", 0, "geometry", "bbox"], [], r"features\[0\]\.geometry\.bbox is not allowed"),
        (
            ["features", 0, "geometry", "type"],
            "MultiPolygon",
            r"features\[0\]\.geometry\.type is 'MultiPolygon'",
        ),
        (["features", 0, "geometry", "type"], {}, r"features\[0\]\.geometry\.type"),
        (["features", 0, "geometry", "coordinates"], [], r"features\[0\]\.geometry\.coordinates is \[\]"),
        (["features", 0, "geometry", "coordinates", 1], 3, r"coordinates\[1\] is 3"),
        (["features", 0, "geometry", "coordinates", 1], RING[:3], r"coordinates\[1\] is .* at least four"),
        (["features", 0, "geometry", "coordinates", 0, 4], [0, 1], r"coordinates\[0\] is not closed"),
        (
            ["features", 0, "geometry", "coordinates", 0, 1],
            [10, 0, 0],
            r"coordinates\[0\]\[1\] is \[10, 0, 0\].*without a height",
        ),
        (["features", 0, "geometry", "coordinates", 0, 1], [10, None], r"coordinates\[0\]\[1\]\[1\] is None"),
        (["features", 3, "geometry", "coordinates"], [1], r"features\[3\]\.geometry\.coordinates is \[1\]"),
        (
            ["features", 3, "geometry", "coordinates"],
            [1, math.inf],
            r"features\[3\]\.geometry\.coordinates\[1\] is inf",
        ),
    ],
)
def test_what_is_foreign_or_wrong_is_named_with_its_place(path, value, says):
    with pytest.raises(MapFormatError, match=says):
        world_from_geojson(change(path, value))


@pytest.mark.parametrize(
    ("path", "value", "error", "says"),
    [
        (["features", 4, "properties", "sigma_m"], -0.1, InvalidLandmark, "'B' has survey sigma -0.1"),
        (["features", 4, "properties", "half_angle_rad"], 0, InvalidLandmark, "'B' has half angle 0"),
        (["features", 4, "properties", "id"], "A", DuplicateLandmark, "'A' is used twice"),
        (["features", 4, "geometry", "coordinates"], [0.5, 0.5], DuplicateLandmark, "both stand at"),
        (
            ["features", 4, "geometry", "coordinates"],
            [10.6, 0.5],
            LandmarkOutsideMap,
            r"'B' at \(10.6, 0.5\)",
        ),
        (
            ["features", 0, "geometry", "coordinates", 0, 2],
            [-1, 9],
            InvalidGeometry,
            r"features\[0\].*not a valid polygon",
        ),
        (["features", 0, "geometry", "coordinates"], [[[0, 0]] * 4], InvalidGeometry, r"features\[0\]"),
        (["features", 0, "properties", "kind"], "obstacle", InvalidGeometry, "no floor polygon"),
        (["features", 1, "geometry", "coordinates"], [RING], InvalidGeometry, "no free space"),
        (
            ["features", 1, "geometry", "coordinates"],
            [[[0, 0], [2e7, 0], [2e7, 1], [0, 0]]],
            InvalidGeometry,
            "2e.07 m; the limit",
        ),
    ],
)
def test_impossible_worlds_have_their_own_errors(path, value, error, says):
    with pytest.raises(error, match=says):
        world_from_geojson(change(path, value))


def test_limits(monkeypatch):
    monkeypatch.setattr(world_file, "MAX_FEATURES", 5)
    with pytest.raises(MapTooLarge, match="6 features, the limit is 5"):
        world_from_geojson(good())
    monkeypatch.setattr(world_file, "MAX_WORLD_FILE_BYTES", 100)
    with pytest.raises(MapTooLarge, match="100 bytes"):
        world_from_geojson(json.dumps(good()))


@pytest.mark.parametrize(
    "text", ["", "[]", "null", "7", '"x"', '{"type": "FeatureCollection"}', "[" * 10_000]
)
def test_other_documents_are_refused(text):
    with pytest.raises(MapFormatError):
        world_from_geojson(text)


def test_a_grid_is_no_world_file(tmp_path):
    world = world_from_ascii("A.B\n..C")
    with pytest.raises(MapFormatError, match="grid floor"):
        write_world_file(world, tmp_path / "w.geojson")
    assert list(tmp_path.iterdir()) == []


def test_files_are_written_whole_and_named_after_themselves(tmp_path):
    world = world_from_geojson(good()).renamed("Halle »5«")
    file = tmp_path / "w.geojson"
    write_world_file(world, file)
    again = read_world_file(file)
    assert (again.name, again.content_hash()) == (world.name, world.content_hash())
    assert file.read_text(encoding="utf-8").count("\n") == 6 + 2
    assert [f.name for f in tmp_path.iterdir()] == ["w.geojson"]
    plain = tmp_path / "store 7.geojson"
    plain.write_text(json.dumps(document(polygon())))
    assert read_world_file(plain).name == "store 7"


def test_file_errors_name_the_file_and_change_nothing(tmp_path):
    file = tmp_path / "bad.geojson"
    with pytest.raises(MapFormatError, match=r"bad\.geojson"):
        read_world_file(file)
    file.write_text(json.dumps(change(["features", 4, "properties", "id"], "A")))
    before = file.read_bytes()
    with pytest.raises(DuplicateLandmark, match=r"bad\.geojson: Landmark id"):
        read_world_file(file)
    with pytest.raises(MapFormatError, match="Could not write"):
        write_world_file(world_from_geojson(good()), tmp_path / "nowhere" / "w.geojson")
    with pytest.raises(MapFormatError, match="grid"):
        write_world_file(world_from_ascii("ABC"), file)
    assert file.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


numbers = st.floats(-900, 900, allow_nan=False)
names = st.text(min_size=1, max_size=8).filter(str.isprintable)


@st.composite
def worlds(draw):
    def cell(k):
        # Disjoint places on a lattice: any number of polygons makes a valid plan.
        x, y = 20.0 * (k % 7), 20.0 * (k // 7)
        w, h, turn = draw(st.floats(1, 9)), draw(st.floats(1, 9)), draw(st.floats(0, 6))
        corners = [(w, 0), (0, h), (-w, 0), (0, -h)]
        c, s = math.cos(turn), math.sin(turn)
        shell = [(x + c * a - s * b, y + s * a + c * b) for a, b in corners]
        holes = [[(x, y), (x + 0.1, y), (x, y + 0.1)]] if draw(st.booleans()) else []
        return Polygon(shell, holes)

    n_obstacles = draw(st.integers(0, 5))
    floor = [box(-1000, -1000, 1000, 1000), *(cell(k) for k in range(draw(st.integers(0, 3))))]
    obstacles = [cell(10 + k) for k in range(n_obstacles)]
    ids = draw(st.lists(names, max_size=5, unique=True))
    xy = [(draw(numbers), draw(numbers)) for _ in ids]
    facing = [draw(st.one_of(st.just(math.nan), st.floats(-10, 10))) for _ in ids]
    half = [draw(st.floats(1e-6, math.pi)) for _ in ids]
    sigma = [draw(st.floats(0, 1)) for _ in ids]
    try:
        marks = LandmarkSet(ids, np.array(xy).reshape(-1, 2), facing, half, sigma)
    except DuplicateLandmark:
        marks = LandmarkSet.empty()
    opaque = draw(st.lists(st.booleans(), min_size=n_obstacles, max_size=n_obstacles))
    return World(draw(names), FloorPlan(tuple(floor), tuple(obstacles), tuple(opaque)), marks)


@settings(max_examples=60, deadline=None)
@given(worlds())
def test_import_export_import_is_identity(world):
    text = json.dumps(world_to_geojson(world))
    again = world_from_geojson(text)
    assert again.name == world.name
    assert again.content_hash() == world.content_hash()
    assert json.dumps(world_to_geojson(again)) == text


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=3) | st.integers(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_any_change_gives_a_world_or_an_error_of_the_map_layer(data):
    out = good()
    place, key = None, None
    node = out
    while isinstance(node, (dict, list)) and node and (place is None or data.draw(st.booleans())):
        key = data.draw(st.sampled_from(list(node) if isinstance(node, dict) else range(len(node))))
        place, node = node, node[key]
    place[key] = data.draw(json_values)
    with contextlib.suppress(MapError):
        assert isinstance(world_from_geojson(out), World)
