from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from shapely.geometry import box

from api.canvas import InvalidPicture, fit_view, picture_size
from api.colormaps import COLORMAPS
from api.layers import color_range, ticks
from api.render import heatmap_png, map_png
from maps.floor_plan import FloorPlan
from maps.landmarks import LandmarkSet
from maps.world import World
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


@pytest.fixture
def field():
    return synthetic_field(
        world_from_ascii(DRAWING, 1.0), 0.5, lambda x, y: np.where(x > 7, np.nan, 0.02 * (1 + x))
    )


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)))


def test_heatmap_has_the_size_asked_for(field):
    assert pixels(heatmap_png(field, width=640, height=360)).shape == (360, 640, 3)


def test_bare_heatmap_shows_each_cell_in_its_place(field):
    ny, nx = field.frame.shape
    got = pixels(
        heatmap_png(field, width=4 * nx, height=4 * ny, legend=False, landmarks=False, vmin=0.001, vmax=0.5)
    )
    values = field.metric("area95_m2")
    table = COLORMAPS["viridis"]
    for row, col in [(3, 3), (8, 5), (9, 12)]:
        t = (np.log(values[row, col]) - np.log(0.001)) / (np.log(0.5) - np.log(0.001))
        color = table[int(np.clip(t, 0, 1) * 255 + 0.5)]
        shown = got[4 * (ny - 1 - row) + 2, 4 * col + 2]  # top row of the picture is the highest y
        assert np.array_equal(shown, color), (row, col)


def test_cells_without_a_fix_are_hatched_and_walls_are_not_coloured(field):
    ny, nx = field.frame.shape
    got = pixels(heatmap_png(field, width=8 * nx, height=8 * ny, legend=False, landmarks=False))
    blind = got[8 * 4 : 8 * 5, 8 * 16 : 8 * 17].reshape(-1, 3)
    assert len(np.unique(blind, axis=0)) == 2
    assert (got[3, 3] == (48, 56, 66)).all()


def test_window_shows_only_a_part(field):
    whole = pixels(
        heatmap_png(field, width=300, height=300, legend=False, landmarks=False, vmin=0.001, vmax=1)
    )
    part = pixels(
        heatmap_png(
            field, width=300, height=300, legend=False, landmarks=False, vmin=0.001, vmax=1, bbox=(1, 1, 3, 3)
        )
    )
    assert not np.array_equal(whole, part)
    assert (part != (48, 56, 66)).any(axis=-1).all()  # no wall in this window


def test_yawed_grid_is_drawn_in_the_map_frame(field):
    from dataclasses import replace

    frame = field.frame
    turned = replace(
        field, frame=type(frame)(frame.origin_x, frame.origin_y, np.pi / 2, *frame.as_tuple()[3:])
    )
    ny, nx = frame.shape
    got = pixels(
        heatmap_png(turned, width=4 * ny, height=4 * nx, legend=False, landmarks=False, vmin=0.001, vmax=1)
    )
    straight = pixels(
        heatmap_png(field, width=4 * nx, height=4 * ny, legend=False, landmarks=False, vmin=0.001, vmax=1)
    )
    # A quarter turn counter-clockwise of the picture, sampled inside coloured cells away from hatching.
    inside = np.rot90(straight)[30:40, 12:22]
    assert np.array_equal(got[30:40, 12:22], inside)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"metric": "beauty"}, "beauty"),
        ({"colormap": "jet"}, "jet"),
        ({"width": 4, "height": 4}, "4 × 4"),
        ({"width": 100_000, "height": 100_000}, "limit"),
        ({"bbox": (3, 3, 1, 1)}, "empty"),
        ({"bbox": (100, 100, 101, 101)}, "outside"),
        ({"bbox": (0, 0, float("nan"), 1)}, "empty"),
        ({"vmin": 2.0, "vmax": 1.0}, "empty"),
        ({"vmin": -1.0}, "positive"),
        ({"scale": "cubic"}, "cubic"),
    ],
)
def test_wrong_wishes_are_named(field, options, word):
    with pytest.raises(InvalidPicture, match=word):
        heatmap_png(field, **options)


def test_map_of_polygons_shows_floor_walls_and_landmarks():
    plan = FloorPlan((box(0, 0, 10, 6),), (box(4, 2, 6, 4),), (True,))
    world = World("w", plan, LandmarkSet(("a",), np.array([[4.0, 3.0]]), facing=np.array([np.pi])))
    got = pixels(map_png(world, max_size=500))
    assert got.shape == (300, 500, 3)
    assert (got[150, 250] == (48, 56, 66)).all()
    assert (got[20, 20] == (250, 250, 248)).all()
    assert (got[150, 200] == (214, 39, 40)).all()


@pytest.mark.parametrize(
    ("lo", "hi", "scale"), [(0.003, 4, "log"), (1e-6, 1e3, "log"), (0, 37, "linear"), (2, 2.5, "linear")]
)
def test_ticks_are_round_and_inside(lo, hi, scale):
    found = ticks(lo, hi, scale)
    assert 2 <= len(found) <= 10
    assert all(lo <= v <= hi * (1 + 1e-9) for v in found)


def test_color_range_of_an_empty_field_is_still_a_range():
    lo, hi = color_range(np.full(5, np.nan), None, None, "log")
    assert 0 < lo < hi


def test_view_keeps_the_aspect():
    view = fit_view((0, 0, 10, 5), 400, 400)
    assert (view.width, view.height, view.top) == (400, 200, 100)
    assert np.allclose(view.to_pixel([10, 5]), (400, 100))
    assert np.allclose(view.pixel_centres()[0, 0], (0.0125, 5 - 0.0125))


def test_one_side_is_enough():
    assert picture_size((0, 0, 20, 10), 400, None, 0, 1000) == (400, 200)
    assert picture_size((0, 0, 20, 10), None, 200, 0, 1000) == (400, 200)


def test_colormaps_are_complete_tables():
    for name, table in COLORMAPS.items():
        assert table.shape == (256, 3), name
        assert table.dtype == np.uint8
    assert np.array_equal(COLORMAPS["viridis_r"], COLORMAPS["viridis"][::-1])
