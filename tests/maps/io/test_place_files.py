"""Files of places: what is read, and what is refused in words."""

from __future__ import annotations

import numpy as np
import pytest

from maps.errors import MapFormatError, MapTooLarge
from maps.io.place_files import parse_places, read_places


@pytest.mark.parametrize(
    ("name", "text", "ids"),
    [
        ("a.csv", "id,x,y\nA,1,2\nB,3.5,-4\n", ("A", "B")),
        ("a.csv", "x_m;y_m\n1;2\n\n3.5;-4\n", ("1", "2")),
        ("a.tsv", "Y\tX\tid\n2\t1\tA\n-4\t3.5\t\u00e9\n", ("A", "\u00e9")),
        ("a.json", "[[1, 2], [3.5, -4]]", ("1", "2")),
        ("a.json", '{"places": [{"id": 7, "x_m": 1, "y_m": 2}, {"x": 3.5, "y": -4}]}', ("7", "2")),
    ],
)
def test_what_is_read(tmp_path, name, text, ids):
    (tmp_path / name).write_text(text)
    found, points = read_places(tmp_path / name)
    assert found == ids
    np.testing.assert_array_equal(points, [[1.0, 2.0], [3.5, -4.0]])


@pytest.mark.parametrize(
    ("is_json", "text", "words"),
    [
        (False, "", "no place"),
        (False, "id,x,y\n", "no place"),
        (False, "1,2\n3,4\n", "first line names the columns"),
        (False, "id,x,y\nA,1\n", "line 2 has 2 values"),
        (False, "id,x,y\nA,1,north\n", "line 2: y"),
        (False, "id,x,y\nA,1,nan\n", "line 2: y"),
        (False, "id,x,y\nA,1,2\nA,2,3\n", "two places 'A'"),
        (False, "id,x\nA,1\n", "lacks y"),
        (False, 'id,x,y\n"A,1,2\n', "not valid CSV"),
        (True, "{}", "places"),
        (True, "3", "list of places"),
        (True, "[[1]]", r"must be \[x, y\]"),
        (True, '[{"x": 1, "x_m": 1, "y": 2}]', "x twice"),
        (True, '[{"x": 1, "z": 2}]', "z"),
        (True, "[[1, NaN]]", "NaN"),
        (True, '[{"id": "", "x": 1, "y": 2}]', "id"),
    ],
)
def test_what_is_refused(is_json, text, words):
    with pytest.raises(MapFormatError, match=words):
        parse_places(text.encode(), is_json=is_json)


def test_limits_and_endings(tmp_path):
    with pytest.raises(MapTooLarge):
        parse_places(b"x,y\n" + b"1,2\n" * 10_001, is_json=False)
    with pytest.raises(MapTooLarge):
        parse_places(b" " * (2**20 + 1), is_json=True)
    (tmp_path / "a.xlsx").write_text("")
    for path in (tmp_path / "a.xlsx", tmp_path / "none.csv"):
        with pytest.raises(MapFormatError):
            read_places(path)
