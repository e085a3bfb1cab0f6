"""Figures and windows of a field."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon
from shapely.geometry import box

from api.canvas import InvalidPicture
from api.field_statistics import statistics
from api.field_window import cells_of, window_to_json, window_values
from maps.errors import InvalidGeometry
from maps.grid import GridFrame
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

DRAWING = """
##########
#A......B#
#........#
#...##...#
#...##..C#
##########
"""


@pytest.fixture(scope="module")
def field():
    return synthetic_field(
        world_from_ascii(DRAWING, 1.0), 0.5, lambda x, y: np.where(x > 7, np.nan, 0.02 * (1 + x))
    )


def figures(field, metric="sigma_max_m", **more):
    asked = {"percentiles": (0, 50, 100), "bins": 5, "scale": "log", "most_cells": 10**6, **more}
    return statistics(field, metric, **asked)


def test_figures_are_those_of_the_cells(field):
    found = figures(field)
    values = field.metric("sigma_max_m")
    known = values[np.isfinite(values)]
    assert (found["cells"], found["with_value"], found["step"]) == (field.free.sum(), len(known), 1)
    assert found["free_area_m2"] == pytest.approx(0.25 * field.free.sum())
    assert found["share_with_fix"] == pytest.approx(len(known) / field.free.sum())
    assert found["share_valid"] == found["share_with_fix"], "all fixes of this field can be believed"
    assert (found["min"], found["max"]) == (known.min(), known.max())
    assert found["mean"] == pytest.approx(known.mean())
    assert [p["value"] for p in found["percentiles"]] == pytest.approx(np.percentile(known, [0, 50, 100]))
    assert sum(found["histogram"]["counts"]) == len(known)
    assert len(found["histogram"]["edges"]) == 6


def test_an_area_counts_cells_whose_centre_lies_inside(field):
    found = figures(field, area=box(1.0, 2.0, 3.0, 5.0))
    x, y = np.moveaxis(field.frame.centres(), -1, 0)
    inside = (x > 1) & (x < 3) & (y > 2) & (y < 5) & field.free
    assert found["cells"] == inside.sum() > 0
    assert found["mean"] == pytest.approx(field.metric("sigma_max_m")[inside].mean())
    triangle = Polygon([(1, 1), (7, 1), (7, 5)])
    assert 0 < figures(field, area=triangle)["cells"] < figures(field, area=box(1, 1, 7, 5))["cells"]


def test_beside_the_map_there_is_nothing(field):
    found = figures(field, area=box(100, 100, 101, 101))
    assert (found["cells"], found["share_with_fix"], found["mean"]) == (0, None, None)
    assert found["histogram"]["counts"] == []
    with pytest.raises(InvalidPicture):
        figures(field, bbox=(100, 100, 101, 101))
    with pytest.raises(InvalidGeometry, match="cross"):
        figures(field, area=Polygon([(1, 1), (3, 3), (3, 1), (1, 3)]))


def test_of_too_many_cells_some_count_and_it_is_said(field):
    found = figures(field, most_cells=20)
    assert found["step"] > 1
    assert found["cells"] * found["step"] ** 2 == pytest.approx(field.free.sum(), rel=0.4)
    assert found["free_area_m2"] == found["cells"] * (0.5 * found["step"]) ** 2


def test_a_metric_of_one_value_and_of_zeros(field):
    found = figures(field, "n_visible", scale="linear")
    assert sum(found["histogram"]["counts"]) + found["histogram"]["outside"] == found["cells"]
    logs = figures(field, "n_visible", scale="log")
    assert logs["histogram"]["outside"] == (field.n_visible[field.free] == 0).sum() > 0


def test_a_window_is_its_cells(field):
    cells = cells_of(field.frame, (1.0, 2.0, 3.0, 4.5))
    assert (cells.rows, cells.cols, cells.step) == ((4, 9), (2, 6), 1)
    np.testing.assert_array_equal(window_values(field, "r95_m", cells), field.metric("r95_m")[4:9, 2:6])
    body = window_to_json(field, "r95_m", cells)
    assert body["first"] == {"x_m": 1.25, "y_m": 2.25}
    assert (body["rows"], body["columns"], body["step_m"]) == (5, 4, 0.5)
    assert body["values"][0][0] == pytest.approx(field.metric("r95_m")[4, 2], rel=5e-6)
    wide = window_to_json(field, "r95_m", cells_of(field.frame, None))
    assert wide["values"][0][0] is None, "a wall"


def test_a_window_with_a_step_takes_cells_in_the_middle(field):
    cells = cells_of(field.frame, None, max_side=7)
    assert cells.step == 3
    np.testing.assert_array_equal(window_values(field, "r95_m", cells), field.metric("r95_m")[1::3, 1::3])
    body = window_to_json(field, "r95_m", cells)
    assert body["first"] == {"x_m": 0.75, "y_m": 0.75}
    assert max(body["rows"], body["columns"]) <= 7
    assert body["step_m"] == 1.5


@pytest.mark.parametrize("side", [1, 2, 3, 5, 40])
def test_no_side_is_longer_than_asked(side):
    frame = GridFrame(0.0, 0.0, 0.0, 0.1, 17, 39)
    cells = cells_of(frame, None, max_side=side)
    shape = [len(range(*s.indices(n))) for s, n in zip(cells.slices, frame.shape, strict=True)]
    assert 1 <= max(shape) <= side
    assert min(shape) >= 1
