from __future__ import annotations

import contextlib
import json
import math

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from maps.errors import DuplicateLandmark, InvalidLandmark, MapError, MapFormatError, MapTooLarge
from maps.io import landmark_files
from maps.io.landmark_files import parse_landmarks, read_landmarks

CSV = "id,x,y,facing_rad,half_angle_rad,sigma_m\nA,1,2,,,\nB,-3.5,4e-1,1.5,0.7,0.01\nC,0,0,-2,,\n"
YAML = """
landmarks:
  - {id: A, x: 1, y: 2}
  - {id: B, x: -3.5, y: 4e-1, facing_rad: 1.5, half_angle_rad: 0.7, sigma_m: 0.01}
  - {id: C, x_m: 0, y_m: 0, facing_rad: -2}
"""


def point(name, xy, **properties):
    geometry = {"type": "Point", "coordinates": xy}
    return {"type": "Feature", "properties": {"id": name, **properties}, "geometry": geometry}


GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        point("A", [1, 2], kind="landmark"),
        point("B", [-3.5, 0.4], facing_rad=1.5, half_angle_rad=0.7, sigma_m=0.01),
        point("C", [0, 0], facing_rad=-2),
    ],
}


def read(text, kind="csv"):
    return parse_landmarks(text.encode(), format=kind, source="marks")


def test_all_formats_say_the_same():
    sets = [read(CSV), read(YAML, "yaml"), read(json.dumps(GEOJSON), "geojson")]
    for marks in sets:
        assert marks.ids == ("A", "B", "C")
        np.testing.assert_array_equal(marks.positions, [[1, 2], [-3.5, 0.4], [0, 0]])
        np.testing.assert_array_equal(marks.facing, [np.nan, 1.5, -2])
        np.testing.assert_allclose(marks.half_angle, [math.pi, 0.7, math.pi / 2])
        np.testing.assert_array_equal(marks.sigma, [0, 0.01, 0])
    assert len({m.content_hash() for m in sets}) == 1


@pytest.mark.parametrize(
    "text",
    [
        "id;x;y;facing_rad;half_angle_rad;sigma_m\nA;1;2\n".replace("2\n", "2;;;\n")
        + "B;-3,5;0,4;1,5;0,7;0,01\nC;0;0;-2;;\n",
        CSV.replace(",", "\t"),
        "\ufeff" + CSV.replace("\n", "\r\n"),
        "\n" + CSV.replace("id,x,y", "ID, X , y_m") + "\n\n,,,,,\n",
        CSV.replace("A,1", '"A", 1'),
        CSV.rstrip("\n"),
    ],
)
def test_csv_as_people_save_it(text):
    assert read(text).content_hash() == read(CSV).content_hash()


def test_degrees_are_turned_into_radians():
    marks = read("id,x,y,facing_deg,half_angle_deg\nA,0,0,90,180\nB,1,0,-180,45\n")
    np.testing.assert_allclose(marks.facing, [math.pi / 2, -math.pi])
    np.testing.assert_allclose(marks.half_angle, [math.pi, math.pi / 4])
    marks = read("[{id: 7, x: 0, y: 0, facing_deg: 360, half_angle_deg: 1}]", "yaml")
    assert marks.ids == ("7",)
    np.testing.assert_allclose(marks.facing, [0], atol=1e-15)


def test_ids_that_hold_delimiters_and_no_landmarks_at_all():
    assert read('id,x,y\n"rack 3, left",0,0\n').ids == ("rack 3, left",)
    assert len(read("id,x,y\n")) == 0
    assert len(read("[]", "yaml")) == 0
    assert len(read('{"type": "FeatureCollection", "features": []}', "geojson")) == 0


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("", MapFormatError, "marks: the file is empty"),
        ("id,x\nA,1\n", MapFormatError, "line 1 lacks the column y"),
        ("A,1,2\n", MapFormatError, "line 1 has 'a', which is not allowed; allowed: id, x"),
        ("id,x,y,colour\nA,1,2,red\n", MapFormatError, "line 1 has 'colour'"),
        ("id,x,y,x_m\nA,1,2,1\n", MapFormatError, "line 1 gives x in two columns"),
        ("id,x,y,facing_rad,facing_deg\n", MapFormatError, "line 1 gives facing in two columns"),
        ("id,x,y\nA,1,2\nB,1\n", MapFormatError, "line 3 has 2 values, the header has 3"),
        ("id,x,y\nA,1,2\n\nB,1,two\n", MapFormatError, "line 4: y is 'two'"),
        ("id,x,y\nA,1,nan\n", MapFormatError, "line 2: y is 'nan'"),
        ("id,x,y\nA,inf,1\n", MapFormatError, "line 2: x is 'inf'"),
        ("id,x,y\nA,1e999,1\n", MapFormatError, "line 2: x is '1e999'"),
        ("id,x,y\nA,,1\n", MapFormatError, "line 2 lacks x"),
        ("id,x,y\n,1,1\n", MapFormatError, "line 2 lacks id"),
        ("id,x,y\nA,1,1\nA,2,2\n", DuplicateLandmark, "marks: Landmark id 'A' is used twice"),
        ("id,x,y\nA,1,1\nB,1,1\n", DuplicateLandmark, "'A' and 'B' both stand at"),
        ("id,x,y,sigma_m\nA,1,1,-0.1\n", InvalidLandmark, "line 2: survey sigma is -0.1 m"),
        ("id,x,y,half_angle_rad\nA,1,1,1\n", InvalidLandmark, "line 2 has a half angle but no facing"),
        ("id,x,y,facing_deg,half_angle_deg\nA,1,1,0,181\n", InvalidLandmark, "line 2: half angle is 3.15"),
        ("id,x,y,facing_deg,half_angle_deg\nA,1,1,0,0\n", InvalidLandmark, "line 2: half angle is 0"),
        ('id,x,y\n"A,1,1\n', MapFormatError, "line 2 is not valid CSV"),
        ("id,x,y\n" + "A" * 201 + ",1,1\n", MapFormatError, "line 2: id is"),
        ("id;x;y\nA;1.000,5;1\n", MapFormatError, "line 2: x is '1.000,5'"),
    ],
)
def test_csv_mistakes_name_line_and_value(text, error, says):
    with pytest.raises(error, match=says):
        read(text)


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("hello", MapFormatError, "must be a list"),
        ("{marks: []}", MapFormatError, "the file.marks is not allowed"),
        ("{landmarks: {A: 1}}", MapFormatError, "must be a list"),
        ("[{id: A, x: 1, y: 2}, 7]", MapFormatError, "landmark number 1 is 7"),
        ("[{id: A, x: 1}]", MapFormatError, "landmark number 0 lacks y"),
        ("[{id: A, x: 1, y: 2, z: 0}]", MapFormatError, "number 0 has 'z'"),
        ("[{id: A, x: 1, y: 2, 5: 0}]", MapFormatError, "number 0 has 5"),
        ("[{id: A, x: 1, y: 2, x_m: 1}]", MapFormatError, "gives its x twice"),
        ("[{id: true, x: 1, y: 2}]", MapFormatError, "id is True"),
        ("[{id: A, x: .nan, y: 2}]", MapFormatError, "x is nan"),
        ("[{id: A, x: [1], y: 2}]", MapFormatError, r"x is \[1\]"),
        ("[{id: A, x: 1, y: 2, sigma_m: -1}]", InvalidLandmark, "number 0: survey sigma is -1"),
        ("[{id: &a A, x: 1, y: 2}]", MapFormatError, "anchor"),
        ("[", MapFormatError, "marks: the file is not valid YAML"),
        ("{features: 7}", MapFormatError, "features is 7"),
        ("{features: [{id: 1, position: [1]}]}", MapFormatError, r"features\[0\]\.position is \[1\]"),
        (
            "{features: [{id: 1, position: [1, x, 0]}]}",
            MapFormatError,
            r"features\[0\]\.position\[1\] is 'x'",
        ),
        ("{features: [{id: 1}]}", MapFormatError, r"features\[0\] lacks the member 'position'"),
        (
            "{features: [{id: 1, source: [1, 2, 0], target: [1, 2, 0]}]}",
            MapFormatError,
            r"features\[0\]\.source is not allowed",
        ),
    ],
)
def test_yaml_mistakes_name_number_and_value(text, error, says):
    with pytest.raises(error, match=says):
        read(text, "yaml")


@pytest.mark.parametrize(
    ("feature", "says"),
    [
        (point("A", [1, 2], kind="floor"), r"features\[0\]\.properties\.kind is 'floor'"),
        (point("A", [1, 2], color="red"), r"features\[0\]\.properties\.color is not allowed"),
        (point("A", [1, 2, 3]), r"features\[0\]\.geometry\.coordinates"),
        (point(5, [1, 2]), r"features\[0\]\.properties\.id is 5"),
        (point("A", [1, 2]) | {"geometry": {"type": "Polygon", "coordinates": []}}, "landmarks are Points"),
        (point("A", [1, 2]) | {"properties": None}, r"features\[0\]\.properties is None"),
        (7, r"features\[0\] is 7"),
    ],
)
def test_geojson_mistakes_name_the_place(feature, says):
    with pytest.raises(MapFormatError, match=says):
        read(json.dumps({"type": "FeatureCollection", "features": [feature]}), "geojson")


keys = st.sampled_from(["id", "x", "y", "x_m", "facing_deg", "half_angle_rad", "sigma_m", "z", 5])
values = (
    st.none()
    | st.booleans()
    | st.floats()
    | st.text(max_size=3)
    | st.integers()
    | st.lists(st.integers(), max_size=2)
)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.dictionaries(keys, values, max_size=6) | values, max_size=3))
def test_any_list_gives_landmarks_or_an_error_of_the_map_layer(rows):
    good = [{"id": "good", "x": 7, "y": 8}]
    with contextlib.suppress(MapError):
        assert len(read(yaml.safe_dump(good + rows, allow_unicode=True), "yaml")) == 1 + len(rows)


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet='idxy,;\t\n"01.-e ', max_size=40))
def test_any_text_gives_landmarks_or_an_error_of_the_map_layer(text):
    with contextlib.suppress(MapError):
        read("id,x,y\n" + text)
    with contextlib.suppress(MapError):
        read(text)


def test_limits_and_formats(monkeypatch):
    with pytest.raises(MapFormatError, match="'xml' is not known; use geojson, csv, yaml"):
        parse_landmarks(b"", format="xml")
    monkeypatch.setattr(landmark_files, "MAX_LANDMARKS", 2)
    with pytest.raises(MapTooLarge, match="3 landmarks, the limit is 2"):
        read(CSV)
    monkeypatch.setattr(landmark_files, "MAX_LANDMARK_FILE_BYTES", 20)
    with pytest.raises(MapTooLarge, match="marks"):
        read(CSV)
    with pytest.raises(MapFormatError, match="UTF-8"):
        parse_landmarks(b"id,x,y\n\xff,1,2\n", format="csv")


def test_files_go_by_their_ending(tmp_path):
    for name, text in (("a.csv", CSV), ("b.YML", YAML), ("c.geojson", json.dumps(GEOJSON)), ("d.txt", CSV)):
        (tmp_path / name).write_text(text)
        assert read_landmarks(tmp_path / name).ids == ("A", "B", "C")
    (tmp_path / "e.xlsx").write_text(CSV)
    with pytest.raises(MapFormatError, match=r"e\.xlsx.*end in \.geojson"):
        read_landmarks(tmp_path / "e.xlsx")
    with pytest.raises(MapFormatError, match=r"There is no landmark file .*none\.csv"):
        read_landmarks(tmp_path / "none.csv")
    (tmp_path / "bad.csv").write_text("id,x,y\nA,1,x\n")
    with pytest.raises(MapFormatError, match=r"bad\.csv: line 2: y is 'x'"):
        read_landmarks(tmp_path / "bad.csv")


def test_ten_thousand_landmarks_are_read_in_every_format():
    rows = [(f"L{i}", i % 100, i // 100) for i in range(10_000)]
    text = "id,x,y\n" + "\n".join(f"{n},{x},{y}" for n, x, y in rows)
    assert len(read(text)) == 10_000
    lists = "\n".join(f"- {{id: {n}, x: {x}, y: {y}}}" for n, x, y in rows)
    assert len(read(lists, "yaml")) == 10_000
    with pytest.raises(MapTooLarge, match="10001 landmarks"):
        read(text + "\nextra,0.5,0.5")


def test_real_point_maps(shared_data):
    cob = shared_data / "landmark_maps" / "cob"
    plant = read_landmarks(cob / "ipa-production-plant/point_maps/reflMarker_gazebo.yaml")
    assert len(plant) == 48
    assert plant.ids[:2] == ("0", "1")
    np.testing.assert_array_equal(plant.positions[:2], [[1.8, 12.8], [-6, 12.8]])
    assert not plant.has_facing.any()
    office = read_landmarks(cob / "ipa-office/point_maps/reflMarkerMap_IPA4thFloor.yaml")
    assert len(office) == 16
    np.testing.assert_array_equal(office.positions[-1], [7.76875, 56.8391])
    with pytest.raises(MapError, match="source"):
        read_landmarks(cob / "ipa-office/line_maps/lineMap_IPA4thFloor.yaml")
