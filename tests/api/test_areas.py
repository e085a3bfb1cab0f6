"""Areas from GeoJSON files."""

from __future__ import annotations

import json

import pytest

from api.areas import read_areas
from api.codec import DocumentError

SQUARE = {"type": "Polygon", "coordinates": [[[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]]}


def write(tmp_path, document):
    path = tmp_path / "areas.geojson"
    path.write_text(json.dumps(document))
    return path


def test_polygons_with_and_without_a_factor(tmp_path):
    assert read_areas(None) == []
    (one,) = read_areas(write(tmp_path, SQUARE))
    assert one[0].area == 4.0
    assert one[1] == 1.0
    many = {"type": "MultiPolygon", "coordinates": [SQUARE["coordinates"]] * 2}
    features = [
        {"type": "Feature", "geometry": SQUARE, "properties": {"factor": 3}},
        {"type": "Feature", "geometry": many, "properties": None},
    ]
    found = read_areas(write(tmp_path, {"type": "FeatureCollection", "features": features}))
    assert [factor for _, factor in found] == [3.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ({"type": "Point", "coordinates": [1, 2]}, "Feature 1 .* is a Point"),
        ({"type": "FeatureCollection", "features": [3]}, "no GeoJSON object"),
        ({"type": "Polygon", "coordinates": "x"}, "cannot be read|no geometry"),
        ({"type": "Feature", "geometry": None}, "no geometry"),
        (
            {"type": "Feature", "geometry": SQUARE, "properties": {"factor": "much"}},
            "'much'; it must be a number",
        ),
    ],
)
def test_what_is_no_area_is_refused(tmp_path, document, words):
    with pytest.raises(DocumentError, match=words):
        read_areas(write(tmp_path, document))
