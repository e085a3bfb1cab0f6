"""Tiles of a field."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from shapely.geometry import box

from api.colormaps import COLORMAPS
from api.layers import position
from api.tiles import TILE_PX, Pyramid, tile_npy, tile_png, whole_range
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame
from maps.landmarks import LandmarkSet
from maps.world import World
from tests.fields import synthetic_field


@pytest.fixture(scope="module")
def field():
    """300 × 520 cells: two zooms above the whole; a block that is no floor; no fix at the right."""
    floor = FloorPlan((box(-1, 2, 25, 17),), (box(4, 5, 6, 9),), (True,))
    marks = LandmarkSet(("A", "B", "C"), np.array([[0.0, 3.0], [24.0, 3.0], [12.0, 16.0]]))
    return synthetic_field(
        World("hall", floor, marks), 0.05, lambda x, y: np.where(x > 24, np.nan, 0.01 + 0.002 * x + 0.001 * y)
    )


def array(field, z, x, y, metric="sigma_max_m"):
    return np.load(io.BytesIO(tile_npy(field, (z, x, y), metric)))


def picture(field, z, x, y):
    png = tile_png(
        field, (z, x, y), metric="sigma_max_m", colormap="viridis", limits=(0.01, 0.1), scale="log"
    )
    return np.asarray(Image.open(io.BytesIO(png)))


def whole(field, z, part):
    """All tiles of a zoom, top row first."""
    return np.vstack([np.hstack([part(field, z, x, y) for x in range(2**z)]) for y in range(2**z)])


def test_at_the_largest_zoom_a_pixel_is_a_cell(field):
    pyramid = Pyramid.of(field.frame)
    assert (field.frame.shape, pyramid.max_zoom, pyramid.pixel(2)) == ((300, 520), 2, 0.05)
    assert pyramid.pixel(0) == pytest.approx(0.2)
    together = whole(field, 2, lambda *at: array(*at)[::-1])
    values = field.metric("sigma_max_m")[::-1]
    np.testing.assert_array_equal(together[:300, :520], values.astype(np.float32))
    assert np.isnan(together[300:]).all()
    assert np.isnan(together[:, 520:]).all()


def test_zoom_0_shows_the_whole_map(field):
    shown = array(field, 0, 0, 0)
    assert shown.shape == (TILE_PX, TILE_PX)
    x, y = Pyramid.of(field.frame).places(0, 0, 0)[::-1][-40, 60]
    row, col = field.frame.cell_at((x, y))
    assert shown[-40, 60] == np.float32(field.metric("sigma_max_m")[row, col])
    assert np.isfinite(shown).sum() * 0.2**2 == pytest.approx(
        np.isfinite(field.metric("sigma_max_m")).sum() * 0.05**2, rel=0.03
    )


def test_pictures_have_the_colours_of_the_values_and_are_clear_elsewhere(field):
    shown = whole(field, 2, picture)
    values = field.metric("sigma_max_m")[::-1]
    for row, col in [(10, 10), (150, 300), (299, 479)]:
        t = position(values[row, col], (0.01, 0.1), "log")
        assert tuple(shown[row, col]) == (*COLORMAPS["viridis"][int(t * 255 + 0.5)], 255)
    free = field.free[::-1]
    np.testing.assert_array_equal(shown[:300, :520, 3] == 255, free)
    assert not shown[300:, :, 3].any()


def test_the_hatching_goes_on_from_tile_to_tile(field):
    """As if the picture had been drawn as one."""
    shown = whole(field, 2, picture)[:300, 505:520, :3].astype(int)
    dark = shown.sum(axis=2) < 3 * 240
    rows, cols = np.nonzero(dark)
    assert set((rows + cols + 505) % 8) == {0, 1}
    assert dark.mean() == pytest.approx(0.25, abs=0.02)


def test_all_tiles_share_the_ends_of_the_colours(field):
    low, high = whole_range(field, "sigma_max_m", None, "log")
    values = field.metric("sigma_max_m")
    assert (low, high) == pytest.approx(np.nanpercentile(values, [1, 99]), rel=0.01)
    assert whole_range(field, "sigma_max_m", (0.02, 0.5), "log") == (0.02, 0.5)


@pytest.mark.parametrize(
    ("z", "x", "y", "there"), [(0, 0, 0, True), (2, 3, 3, True), (2, 4, 0, False), (3, 0, 0, False)]
)
def test_which_tiles_there_are(field, z, x, y, there):
    assert Pyramid.of(field.frame).has(z, x, y) is there


def test_a_turned_grid_is_covered():
    frame = GridFrame(3.0, -2.0, 0.7, 0.1, 200, 300)
    pyramid = Pyramid.of(frame)
    x0, y0, x1, y1 = pyramid.window(0, 0, 0)
    inner = frame.bounds()
    assert (x0, y1) == pytest.approx((inner[0], inner[3]), abs=1e-6)
    assert y0 <= inner[1]
    assert x1 >= inner[2]
