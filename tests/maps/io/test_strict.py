from __future__ import annotations

import math

import pytest

from maps.errors import MapFormatError, MapTooLarge
from maps.io.strict import label, members, number, parse_json, parse_yaml, read_bytes, shown


def test_plain_json_is_read():
    assert parse_json(b'\xef\xbb\xbf{"a": [1, -0.5e-3, true, null, "\xc3\xa9"]}', "file") == {
        "a": [1, -0.5e-3, True, None, "é"]
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b'{"a": NaN}', "NaN"),
        (b'{"a": -Infinity}', "-Infinity"),
        (b'{"a": 1, "b": {"c": 1, "c": 2}}', "'c' twice"),
        (b'{"a": 1,\n "b" 2}', "line 2, column 6"),
        (b"", "line 1"),
        (b'{"a": "\xff"}', "not UTF-8"),
        (b"[" * 100_000, "too deeply"),
        (b'{"a":' * 100_000, "too deeply"),
        (b"[" + b"1" * 5000 + b"]", "can"),
        ('{"a": "\ud800"', "line 1"),
    ],
)
def test_wrong_json_is_named(text, says):
    with pytest.raises(MapFormatError, match=says):
        parse_json(text, "The file")


def test_plain_yaml_is_read():
    assert parse_yaml("a: [1, 2.5, x]\nb: {c: true}\n", "file") == {"a": [1, 2.5, "x"], "b": {"c": True}}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: [1, 2", "line 1|line 2"),
        ("a: 1\nb:\n\t- 2", "line 3"),
        ("a: &x 1\nb: *x", r"anchor or alias \(line 1\)"),
        ("a: *x", r"anchor or alias"),
        ("a: 1\na: 2", "'a' is given twice"),
        ("a: !!python/object/apply:os.system ['echo']", "constructor"),
        ("[" * 200, "too deeply"),
        ("- " * 200 + "x", "too deeply"),
        (b"a: \xff\xfe", "UTF-8"),
        ("a: \x07", "YAML"),
        ("a: 2020-13-45", "month"),
        ("--- a\n--- b", "another document"),
        ("? [a, b]\n: 1", "unhashable|key"),
    ],
)
def test_wrong_yaml_is_named(text, says):
    with pytest.raises(MapFormatError, match=says):
        parse_yaml(text, "The file")


def test_yaml_bombs_and_long_files_are_refused_by_size():
    with pytest.raises(MapTooLarge, match="64 kB"):
        parse_yaml("a: " + "x" * 70_000, "The file")


def test_files_are_read_to_their_limit(tmp_path):
    file = tmp_path / "f"
    file.write_bytes(b"12345")
    assert read_bytes(file, limit=5, what="map") == b"12345"
    with pytest.raises(MapTooLarge, match="limit"):
        read_bytes(file, limit=4, what="map")
    with pytest.raises(MapFormatError, match="There is no map"):
        read_bytes(tmp_path / "g", limit=4, what="map")
    with pytest.raises(MapFormatError, match="is a folder"):
        read_bytes(tmp_path, limit=4, what="map")
    with pytest.raises(MapFormatError, match="cannot be read"):
        read_bytes(tmp_path / ("x" * 5000), limit=4, what="map")
    with pytest.raises(MapFormatError, match="cannot be read"):
        read_bytes("a\0b", limit=4, what="map")


@pytest.mark.parametrize("value", [1, -2.5, 0])
def test_numbers_pass(value):
    assert number(value, "x") == value
    assert number(f" {value}e1 ", "x", text_ok=True) == value * 10


@pytest.mark.parametrize(
    "value", [True, None, "1", math.nan, math.inf, 10**400, [], {}, "nan", "inf", "1_0", "0x1"]
)
def test_what_is_no_finite_number_is_refused(value):
    with pytest.raises(MapFormatError, match=r"where is .* finite number"):
        number(value, "where")
    if value != "1":
        with pytest.raises(MapFormatError, match="finite number"):
            number(value, "where", text_ok=True)
    with pytest.raises(MapFormatError):
        number("1e999", "where", text_ok=True)


def test_members_names_the_foreign_and_the_missing():
    assert members({"a": 1}, "top", required=("a",), optional=("b",)) == {"a": 1}
    with pytest.raises(MapFormatError, match=r"top\.c is not allowed; allowed here: a, b"):
        members({"a": 1, "c": 2}, "top", required=("a",), optional=("b",))
    with pytest.raises(MapFormatError, match="top lacks the member 'a'"):
        members({}, "top", required=("a",))
    with pytest.raises(MapFormatError, match="must be an object"):
        members([], "top", required=())


def test_labels_and_short_messages():
    assert label("Röhre 7", "x") == "Röhre 7"
    for bad in ("", "a\nb", "x" * 201, 7, None):
        with pytest.raises(MapFormatError, match="printable"):
            label(bad, "x")
    assert len(shown("x" * 1000)) == 60
