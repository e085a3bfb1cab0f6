"""The bundled sites: drawn as stated, landmarks on walls, good and bad places where they are meant to be."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import shapely

from localization.field_builder import build_field
from localization.sensors import LASER, MAS97_CAMERA
from maps.io.site import bundled_site, bundled_site_names, bundled_site_text
from maps.visibility import buried_landmarks, compute_visibility

TOOL = Path(__file__).parents[2] / "tools" / "draw_sites.py"
SITES = ("mas97_room", "warehouse")


def test_the_tool_draws_what_is_bundled():
    spec = importlib.util.spec_from_file_location("draw_sites", TOOL)
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    for drawing in (tool.mas97_room(), tool.warehouse()):
        assert drawing.text() == bundled_site_text(drawing.name)


@pytest.mark.parametrize("name", SITES)
def test_landmarks_stand_on_walls_and_are_seen(name):
    assert name in bundled_site_names()
    world = bundled_site(name)
    assert world.name == name
    opaque = world.floor.see_through().boundary
    for landmark, place in zip(world.landmarks.ids, world.landmarks.positions, strict=True):
        assert opaque.distance(shapely.Point(place)) < 1e-9, landmark
    away = np.column_stack([np.cos(world.landmarks.facing), np.sin(world.landmarks.facing)])
    before = world.landmarks.positions + 0.05 * away
    assert not world.floor.opaque_at(before).any()
    assert not buried_landmarks(world).any()
    counts = compute_visibility(world, world.grid_frame(0.25)).runs.counts()
    assert (counts * 0.25**2 > 5.0).all()


def test_the_room_is_that_of_the_paper():
    world = bundled_site("mas97_room")
    x0, y0, x1, y1 = world.floor.free_space().bounds
    assert (x0, y0, x1, y1) == (0.0, 0.0, 15.0, 15.0)
    p = world.landmarks.positions
    on_outer_wall = (np.isin(p[:, 0], [0.0, 15.0]) | np.isin(p[:, 1], [0.0, 15.0])).sum()
    assert on_outer_wall >= 10
    # The camera finds its way along most of a free diagonal; some places have no fix.
    t = np.linspace(1.0, 14.0, 261)
    diagonal = np.column_stack([t, t])
    free = world.floor.free_space()
    assert free.buffer(-0.3).covers(shapely.LineString(diagonal))
    field = build_field(world, MAS97_CAMERA, resolution=0.1)
    r95 = field.metric("r95_m")
    row, col = field.frame.cell_at(diagonal).T
    along = r95[row, col]
    assert np.isfinite(along).mean() > 0.9
    assert 0.1 < np.nanmedian(along) < 1.0
    inside = field.free
    blind = ~np.isfinite(r95[inside])
    assert 0.05 < blind.mean() < 0.3


def test_the_warehouse_has_good_bad_and_blind_places():
    world = bundled_site("warehouse")
    assert len(world.landmarks) >= 60
    x0, y0, x1, y1 = world.floor.free_space().bounds
    assert x1 - x0 == pytest.approx(60.0, abs=0.5)
    assert y1 - y0 == pytest.approx(40.0, abs=0.5)
    assert world.floor.free_space().geom_type == "Polygon"
    field = build_field(world, LASER, resolution=0.2)
    r95 = field.metric("r95_m")
    blind = ~np.isfinite(r95) & field.free
    assert 0.05 < blind.sum() / field.free.sum() < 0.3

    def within(x_low, y_low, x_high, y_high):
        x, y = np.moveaxis(field.frame.centres(), -1, 0)
        return (x > x_low) & (x < x_high) & (y > y_low) & (y < y_high) & field.free

    # The aisles between the racks, from south to north: bad, good, blind, good.
    aisles = [within(10.0, y + 1.2, 30.0, y + 4.0) for y in (14.8, 20.0, 25.2, 30.4)]
    assert [bool(blind[a].mean() > 0.5) for a in aisles] == [False, False, True, False]
    typical = [np.nanmedian(r95[a]) for a in (aisles[0], aisles[1], aisles[3])]
    assert typical[0] > 0.1
    assert max(typical[1:]) < 0.03
    assert np.nanmedian(r95[within(10.0, 11.0, 50.0, 13.0)]) < 0.03
