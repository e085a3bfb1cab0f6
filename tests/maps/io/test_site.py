from __future__ import annotations

import json

import numpy as np
import pytest

from maps.check import check_world
from maps.errors import MapError
from maps.io.site import bundled_site, bundled_site_names, bundled_site_text
from maps.io.world_file import world_from_geojson, world_to_geojson


def test_both_sites_are_there():
    assert bundled_site_names() == ("mas97_room", "warehouse")
    with pytest.raises(MapError, match="mas97_room, warehouse"):
        bundled_site("../secret")


@pytest.mark.parametrize("name", ["mas97_room", "warehouse"])
def test_a_site_is_sound_and_its_export_the_same_world(name):
    world = bundled_site(name)
    assert world.name == name
    assert {f.severity for f in check_world(world).findings} <= {"info"}
    assert world_from_geojson(world_to_geojson(world)).content_hash() == world.content_hash()
    assert json.loads(bundled_site_text(name)) == json.loads(json.dumps(world_to_geojson(world)))


def test_sizes_and_landmarks_are_those_of_the_drawings():
    room, hall = bundled_site("mas97_room"), bundled_site("warehouse")
    x0, y0, x1, y1 = room.floor.free_space().bounds
    np.testing.assert_allclose([x0, y0, x1, y1], [0, 0, 15, 15], atol=1e-12)
    assert len(room.landmarks) >= 10
    x0, y0, x1, y1 = hall.floor.free_space().bounds
    np.testing.assert_allclose([x1 - x0, y1 - y0], [60, 40], atol=1.0)
    assert len(hall.landmarks) >= 60
    assert hall.landmarks.has_facing.all()
