from __future__ import annotations

import contextlib
import io
import math
import re
import struct
import time
import zlib
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from maps.errors import InvalidGeometry, MapError, MapFormatError, MapTooLarge
from maps.io import map_server
from maps.io.map_server import MapMeta, grid_from_image, parse_map_yaml, read_map_server

META = MapMeta("map.pgm", 0.5, (1.0, 2.0, 0.0), negate=False, occupied_thresh=0.65, free_thresh=0.196)
YAML = "image: map.pgm\nresolution: 0.05\norigin: [-1.5, 2, 0.1]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def pgm(pixels, top=255):
    rows, cols = np.shape(pixels)
    kind = ">u2" if top > 255 else "u1"
    return b"P5\n# made by hand\n%d %d\n%d\n" % (cols, rows, top) + np.asarray(pixels).astype(kind).tobytes()


def png(pixels):
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels)).save(out, "PNG")
    return out.getvalue()


# --- the YAML ---


def test_a_yaml_says_what_it_says():
    meta = parse_map_yaml(YAML)
    assert meta == MapMeta("map.pgm", 0.05, (-1.5, 2.0, 0.1), False, 0.65, 0.196, "trinary")
    assert parse_map_yaml(YAML + "mode: scale\nnegated_by: nobody\ncost: {a: [1]}\n").mode == "scale"
    assert parse_map_yaml(YAML.replace("0.05\n", "5e-2\n").encode()).resolution == 0.05
    assert parse_map_yaml(YAML.replace("negate: 0", "negate: true")).negate is True


@pytest.mark.parametrize("key", ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh"])
def test_a_missing_member_is_named(key):
    with pytest.raises(MapFormatError, match=f"lacks '{key}'"):
        parse_map_yaml(re.sub(rf"{key}:.*\n", "", YAML))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("map.pgm", "[map.pgm]", "image is"),
        ("map.pgm", "''", "image is ''"),
        ("map.pgm", '"a\\nb"', "image is"),
        ("0.05", "0", "resolution is 0 m"),
        ("0.05", "-0.05", "resolution is -0.05 m"),
        ("0.05", ".nan", "resolution is nan"),
        ("0.05", "yes", "resolution is True"),
        ("0.05", "5 cm", "resolution is '5 cm'"),
        ("[-1.5, 2, 0.1]", "[-1.5, 2]", r"origin is \[-1.5, 2\]; it must be \[x, y, yaw\]"),
        ("[-1.5, 2, 0.1]", "0", "origin is 0"),
        ("[-1.5, 2, 0.1]", "[-1.5, .inf, 0]", r"origin\[1\] is inf"),
        ("negate: 0", "negate: 2", "negate is 2"),
        ("negate: 0", "negate: [1]", r"negate is \[1\]"),
        ("negate: 0", "negate: maybe", "negate is 'maybe'"),
        ("0.65", "65", "occupied_thresh is 65; it must be between 0 and 1"),
        ("0.196", "-0.1", "free_thresh is -0.1"),
        ("0.196", "0.7", "free_thresh 0.7 is above its occupied_thresh 0.65"),
        ("negate: 0", "negate: 0\nmode: cubic", "mode is 'cubic'.*trinary, scale, raw"),
        ("negate: 0", "negate: 0\nmode: [raw]", "mode is"),
        ("negate: 0", "negate: &n 0", "anchor"),
        ("negate: 0", "negate: 0\nnegate: 1", "twice"),
        ("negate: 0", "negate: [", "not valid YAML"),
    ],
)
def test_wrong_members_are_named(old, new, says):
    assert old in YAML
    with pytest.raises(MapFormatError, match=says):
        parse_map_yaml(YAML.replace(old, new))


yaml_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=3) | st.integers() | st.dates(),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3) | st.integers(), inner, max_size=2)
    ),
    max_leaves=6,
)


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(list(yaml.safe_load(YAML))), yaml_values)
def test_any_value_gives_a_meta_or_an_error_of_the_map_layer(key, value):
    with contextlib.suppress(MapError):
        meta = parse_map_yaml(yaml.safe_dump(yaml.safe_load(YAML) | {key: value}, allow_unicode=True))
        assert math.isfinite(meta.resolution)


@pytest.mark.parametrize("text", ["", "- 1", "hello", "7"])
def test_other_documents_are_no_map(text):
    with pytest.raises(MapFormatError, match="must be a mapping"):
        parse_map_yaml(text)


def test_a_long_yaml_is_refused():
    with pytest.raises(MapTooLarge, match="64 kB"):
        parse_map_yaml(YAML + "#" * 70_000)


# --- the image ---


def test_the_top_row_of_the_image_is_the_highest_row_of_the_grid():
    grid = grid_from_image(pgm([[0, 254, 205], [254, 254, 0]]), replace(META, origin=(1.0, 2.0, 0.3)))
    np.testing.assert_array_equal(grid.opaque, [[False, False, True], [True, False, False]])
    np.testing.assert_array_equal(grid.free, [[True, True, False], [False, True, False]])
    np.testing.assert_array_equal(grid.unknown, [[False, False, False], [False, False, True]])
    assert grid.frame.as_tuple() == (1.0, 2.0, 0.3, 0.5, 2, 3)


def test_unknown_cells_count_as_asked():
    image = pgm([[0, 254, 205]])
    for free in (False, True):
        for opaque in (False, True):
            grid = grid_from_image(image, META, unknown_is_free=free, unknown_is_opaque=opaque)
            np.testing.assert_array_equal(grid.free, [[False, True, free]])
            np.testing.assert_array_equal(grid.opaque, [[True, False, opaque]])
            np.testing.assert_array_equal(grid.unknown, [[False, False, True]])


def states(data, **changes):
    """One letter per pixel of a one-row image: # opaque, . free, ? unknown, - none of them."""
    grid = grid_from_image(data, replace(META, **changes))
    letters = {(1, 0, 0): "#", (0, 1, 0): ".", (0, 0, 1): "?", (0, 0, 0): "-"}
    cells = zip(grid.opaque[0], grid.free[0], grid.unknown[0], strict=True)
    return "".join(letters[tuple(map(int, cell))] for cell in cells)


def test_thresholds_themselves_are_neither():
    # 204 is p = 0.2 exactly, 51 is p = 0.8 exactly.
    exact = {"free_thresh": 0.2, "occupied_thresh": 0.8}
    assert states(pgm([[205, 204, 203, 52, 51, 50]]), **exact) == ".????#"
    assert states(pgm([[205, 204, 203, 52, 51, 50]]), **exact, mode="scale") == ".----#"
    assert states(pgm([[50, 51, 52, 203, 204, 205]]), **exact, negate=True) == ".????#"


def test_raw_pixels_are_percent():
    assert states(pgm([[0, 19, 20, 65, 66, 100, 101, 255]]), mode="raw") == "..--##??"
    assert states(pgm([[0, 66, 255]]), mode="raw", negate=True) == ".#?"


def test_colours_count_by_their_mean_and_transparency_is_unknown():
    rgb = np.array([[[255, 255, 255], [0, 0, 0], [255, 0, 0], [255, 255, 130], [0, 40, 240]]], dtype=np.uint8)
    assert states(png(rgb)) == ".##.?"
    rgba = np.concatenate([rgb, np.array([[[255], [254], [255], [0], [255]]], dtype=np.uint8)], axis=2)
    assert states(png(rgba)) == ".?#??"
    assert states(png(rgba), mode="scale") == ".?#?-"
    assert states(png(rgba), mode="raw", occupied_thresh=0.8, free_thresh=0.1) == "?.#?#"
    grey_alpha = np.array([[[255, 255], [0, 255], [255, 9]]], dtype=np.uint8)
    assert states(png(grey_alpha)) == ".#?"


def test_other_kinds_of_png_mean_the_same():
    grey = Image.fromarray(np.array([[255, 0, 205, 254]], dtype=np.uint8))
    for image in (
        grey,
        grey.convert("RGB"),
        grey.convert("RGB").convert("P", palette=Image.Palette.ADAPTIVE),
    ):
        out = io.BytesIO()
        image.save(out, "PNG")
        assert states(out.getvalue()) == ".#?."
    out = io.BytesIO()
    grey.convert("1").save(out, "PNG")
    assert states(out.getvalue())[:2] == ".#"
    out = io.BytesIO()
    grey.save(out, "PNG", transparency=205)
    assert states(out.getvalue()) == ".#?."
    out = io.BytesIO()
    grey.save(out, "PNG", transparency=254)
    assert states(out.getvalue()) == ".#??"


def test_deep_images_are_scaled():
    deep = np.array([[65535, 0, 205 * 257, 254 * 257, 52_680]])
    assert states(pgm(deep, top=65535)) == ".#?.?"
    assert states(png(deep.astype(np.uint16))) == ".#?.?"
    assert states(pgm([[100, 0, 80, 99]], top=100)) == ".#?."


def test_ascii_pgm_reads_like_binary():
    rng = np.random.default_rng(3)
    pixels = rng.integers(0, 256, (5, 7))
    text = b"P2 # comment\n7 5\n255\n" + b"\n".join(b" ".join(b"%d" % v for v in row) for row in pixels)
    one, other = grid_from_image(text, META), grid_from_image(pgm(pixels), META)
    assert one.content_hash() == other.content_hash()


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_pixels_are_judged_as_the_fractions_say(data):
    percent = st.integers(0, 100)
    low, high = sorted((data.draw(percent), data.draw(percent)))
    values = data.draw(st.lists(st.integers(0, 255), min_size=1, max_size=9))
    negate = data.draw(st.booleans())
    expected = ""
    for v in values:
        p = Fraction(v if negate else 255 - v, 255)
        expected += "#" if p > Fraction(high, 100) else "." if p < Fraction(low, 100) else "?"
    found = states(pgm([values]), negate=negate, free_thresh=low / 100, occupied_thresh=high / 100)
    assert found == expected


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "is empty"),
        (b"\xff\xd8\xff\xe0JFIF", "a JPEG image"),
        (b"GIF89a", "a GIF"),
        (b"BM1234", "a BMP"),
        (b"RIFF1234WEBP", "a WebP"),
        (b"II*\x00abc", "a TIFF"),
        (b"P4 1 1 \x00", "PBM"),
        (b"%PDF-1.7", "PDF"),
        (b"<svg/>", "SVG"),
        (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
        (b"hello", "no image that is known"),
        (b"P5 ab", "header cannot be read"),
        (b"\x89PNG\r\n\x1a\n", "header cannot be read"),
        (b"P5 0 5 255\n", "is empty"),
        (b"P5 3 3 255\n12", "damaged"),
        (b"P5 3 3 99999\n" + b"1" * 9, "damaged"),
        (b"P2 3 1 255\n1 2 x", "damaged"),
        (b"P2 3 1 255\n1 2 300", "damaged"),
        (png(np.zeros((40, 40), dtype=np.uint8))[:50], "damaged"),
        (png(np.random.default_rng(1).integers(0, 255, (40, 40), dtype=np.uint8))[:700], "damaged"),
    ],
)
def test_images_of_the_wrong_kind_say_what_they_are(data, says):
    with pytest.raises(MapFormatError, match=f"'map.pgm'.*{says}"):
        grid_from_image(data, META)


def huge_png(width, height):
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunk = b"IHDR" + head
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))


@pytest.mark.parametrize(
    "data", [b"P5 100000 100000 255\n", b"P2 64000001 1 255\n", huge_png(2**31 - 1, 2**31 - 1)]
)
def test_absurd_sizes_are_refused_before_anything_is_read(data):
    start = time.process_time()
    with pytest.raises(MapTooLarge, match="the limit is 64000000"):
        grid_from_image(data, META)
    assert time.process_time() - start < 0.5


def test_impossible_frames_are_refused():
    with pytest.raises(InvalidGeometry):
        grid_from_image(pgm([[0]]), replace(META, resolution=0.0))


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damaged_images_give_errors_of_the_map_layer(data):
    image = bytearray(
        data.draw(st.sampled_from([pgm([[1, 2], [3, 4]]), png(np.eye(9, dtype=np.uint8) * 255)]))
    )
    for _ in range(data.draw(st.integers(1, 3))):
        image[data.draw(st.integers(0, len(image) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(MapError):
        grid_from_image(bytes(image), META)


# --- files ---


def test_files_are_found_beside_the_yaml_and_named_in_errors(tmp_path, monkeypatch):
    folder = tmp_path / "site"
    (folder / "images").mkdir(parents=True)
    (folder / "map.yaml").write_text(YAML.replace("map.pgm", "images/a b.pgm"))
    with pytest.raises(MapFormatError, match=r"map\.yaml: There is no map image '.*images/a b\.pgm'"):
        read_map_server(folder / "map.yaml")
    (folder / "images" / "a b.pgm").write_bytes(pgm([[254, 0]]))
    monkeypatch.chdir(tmp_path)
    assert read_map_server("site/map.yaml").free.tolist() == [[True, False]]
    (folder / "images" / "a b.pgm").write_bytes(b"GIF89a")
    with pytest.raises(MapFormatError, match=r"map\.yaml: The map image 'images/a b.pgm' is a GIF"):
        read_map_server(folder / "map.yaml")
    monkeypatch.setattr(map_server, "MAX_IMAGE_BYTES", 3)
    with pytest.raises(MapTooLarge, match=r"map\.yaml"):
        read_map_server(folder / "map.yaml")
    with pytest.raises(MapFormatError, match=r"There is no map YAML 'nowhere\.yaml'"):
        read_map_server("nowhere.yaml")


# --- real maps ---

#: file, (columns, rows), resolution, origin, free and occupied cells, free cells in the upper half of the
#: image; counted by exact fractions from the raw pixels, apart from this package.
REAL = [
    ("ros_maps/aws_warehouse_005/map.yaml", (286, 423), 0.05, (-7.0, -10.5, 0.0), 93698, 3673, 39050),
    ("ros_maps/f1tenth/columbia.yaml", (435, 350), 0.05, (-5.70654, -2.020793, 0.0), 43024, 109212, 19979),
    (
        "ros_maps/f1tenth/vegas.yaml",
        (3000, 2248),
        0.05,
        (-11.60654, -27.320793, 0.0),
        779082,
        5964918,
        401582,
    ),
    ("ros_maps/mir/maze_virtual_walls.yaml", (400, 400), 0.05, (0.0, 0.0, 0.0), 153362, 4893, 75846),
    (
        "ros_maps/mit_stata/stata_basement.yaml",
        (1730, 1300),
        0.0504,
        (25.9, 48.5, 3.14),
        310278,
        18384,
        187958,
    ),
    ("ros_maps/nav2/depot.yaml", (604, 307), 0.05, (0.0, 0.0, 0.0), 179481, 5947, 90149),
    ("ros_maps/nav2/tb3_sandbox.yaml", (384, 384), 0.05, (-10.0, -10.0, 0.0), 7903, 870, 4721),
    ("ros_maps/nav2/warehouse.yaml", (1006, 1674), 0.03, (-15.1, -25.0, 0.0), 1422292, 30951, 721389),
    (
        "ros_maps/pal_hospital_with_aruco/map.yaml",
        (510, 1147),
        0.05,
        (-12.8, -36.2, 0.0),
        531258,
        53712,
        267592,
    ),
    ("ros_maps/pal_office/map.yaml", (520, 469), 0.05, (-14.2, -12.2, 0.0), 230421, 13459, 115303),
    ("ros_maps/strands_g4s/g4s_y2.yaml", (657, 731), 0.05, (-6.3, -6.55, 0.0), 153382, 14956, 81157),
    ("ros_maps/strands_kth/map.yaml", (260, 781), 0.05, (-7.0, -17.5, 0.0), 145051, 9894, 78206),
    ("ros_maps/willow/willow-2010-02-18-0.10.yaml", (566, 608), 0.1, (0.0, 0.0, 0.0), 109207, 544, 50495),
    (
        "landmark_maps/cob/ipa-production-plant/map.yaml",
        (1985, 1536),
        0.05,
        (-31.200001, -56.799999, 0.0),
        1221263,
        35172,
        717746,
    ),
]


def test_the_table_of_real_maps_is_complete(shared_data):
    found = {str(f.relative_to(shared_data)) for f in (shared_data / "ros_maps").glob("*/*.yaml")}
    found |= {str(f.relative_to(shared_data)) for f in (shared_data / "landmark_maps").glob("cob/*/map.yaml")}
    assert found - {row[0] for row in REAL} == {"landmark_maps/cob/ipa-office/map.yaml"}


@pytest.mark.parametrize(("file", "size", "resolution", "origin", "free", "occupied", "upper"), REAL)
def test_real_maps(shared_data, file, size, resolution, origin, free, occupied, upper):
    start = time.process_time()
    grid = read_map_server(shared_data / file)
    seconds = time.process_time() - start
    frame = grid.frame
    assert (frame.n_cols, frame.n_rows) == size
    assert frame.resolution == resolution
    np.testing.assert_allclose((frame.origin_x, frame.origin_y, frame.yaw), origin, atol=1e-12)
    assert np.count_nonzero(grid.free) == free
    assert grid.free_area_m2 == pytest.approx(free * resolution**2)
    assert np.count_nonzero(grid.opaque) == occupied
    assert np.count_nonzero(grid.free[frame.n_rows - frame.n_rows // 2 :]) == upper
    assert np.count_nonzero(grid.unknown) == math.prod(size) - free - occupied
    assert not (grid.free & grid.opaque).any()
    assert seconds < 1.0


def test_real_cells_are_where_the_pixels_are(shared_data):
    file = shared_data / "landmark_maps/cob/ipa-production-plant/map.pgm"
    raw = file.read_bytes()
    head = re.match(rb"P5\s+(?:#[^\n]*\n)*\s*(\d+)\s+(\d+)\s+255\s", raw)
    pixels = np.frombuffer(raw, np.uint8, offset=head.end()).reshape(1536, 1985)
    grid = read_map_server(file.with_name("map.yaml"))
    np.testing.assert_array_equal(grid.free, pixels[::-1] == 254)
    np.testing.assert_array_equal(grid.opaque, pixels[::-1] == 0)
    np.testing.assert_array_equal(grid.unknown, pixels[::-1] == 205)


def test_a_turned_map_lies_where_ros_puts_it(shared_data):
    grid = read_map_server(shared_data / "ros_maps/mit_stata/stata_basement.yaml")
    # Lower-left pixel at the origin; with a yaw of 3.14 rad the map extends to the left and down.
    np.testing.assert_allclose(grid.frame.to_world([0, 0]), (25.9, 48.5))
    far = grid.frame.to_world([1730, 1300])
    c, s, w, h = math.cos(3.14), math.sin(3.14), 1730 * 0.0504, 1300 * 0.0504
    np.testing.assert_allclose(far, (25.9 + c * w - s * h, 48.5 + s * w + c * h))
    assert far[0] < -60
    assert far[1] < -16
