"""Matrices and regions as documents."""

from __future__ import annotations

import csv
import io
import json
import math

import numpy as np
import pytest
import shapely

from api.codec_matrix import LAYERS, matrix_to_array, matrix_to_csv, matrix_to_json, region_to_geojson
from planner.matrix import cost_matrix
from planner.reachability import reachable_region
from planner.travel import Travel
from tests.planner.test_matrix import CLOSED, context_of, places


@pytest.fixture(scope="module")
def found():
    a, b, c = places(CLOSED, "abc")
    return cost_matrix(context_of(CLOSED), [a, (2.75, 1.25), b, c], travel=Travel(0.2))


def test_json_has_null_where_there_is_no_way(found):
    names = ("a", "wall", "b", "c")
    document = json.loads(json.dumps(matrix_to_json(found, names, names), allow_nan=False))
    assert [p["status"] for p in document["sources"]] == ["ok", "occupied", "ok", "ok"]
    assert document["cost"][0][1] is None
    assert document["cost"][0][3] == found.cost[0, 3]
    assert set(LAYERS) <= set(document)
    assert document["is_complete"] is True
    assert len(document["warnings"]) == 2


def test_csv_has_a_line_per_pair(found):
    names = ("a", "wall", "b", "c")
    rows = list(csv.DictReader(io.StringIO(matrix_to_csv(found, names, names))))
    assert len(rows) == 16
    assert rows[3]["source"] == "a"
    assert rows[3]["target"] == "c"
    assert float(rows[3]["length_m"]) == found.length[0, 3]
    assert rows[1]["cost"] == ""


def test_array_has_the_figures_in_order(found):
    array = matrix_to_array(found)
    assert array.shape == (6, 4, 4)
    np.testing.assert_array_equal(array[4], found.worst_r95)


def test_regions_are_geojson():
    context = context_of(CLOSED)
    region = reachable_region(context, places(CLOSED, "a")[0], travel=Travel(0.2))
    document = json.loads(json.dumps(region_to_geojson(region), allow_nan=False))
    (feature,) = document["features"]
    shape = shapely.geometry.shape(feature["geometry"])
    assert shape.is_valid
    assert shape.area == pytest.approx(region.area)
    assert all(shapely.is_ccw(p.exterior) for p in shape.geoms)
    assert feature["properties"]["limit"] is None
    near = reachable_region(context, places(CLOSED, "a")[0], travel=Travel(0.2), limit=1.0)
    assert region_to_geojson(near)["features"][0]["properties"]["limit"] == 1.0
    assert math.isinf(region.limit)
