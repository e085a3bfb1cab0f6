from __future__ import annotations

import json

import numpy as np
import pytest
from shapely.geometry import Polygon, box

from maps.errors import InvalidGeometry, MapFormatError
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.io.bundle import pack_world, unpack_world
from maps.landmarks import LandmarkSet
from maps.world import World


def marks(n: int) -> LandmarkSet:
    rng = np.random.default_rng(n)
    facing = np.where(np.arange(n) % 2 == 0, np.nan, rng.uniform(-3, 3, n))
    return LandmarkSet(
        tuple(f"é{i}" for i in range(n)),
        rng.uniform(0.1, 0.9, (n, 2)),
        facing,
        np.full(n, 1.2),
        rng.random(n),
    )


def grid_world() -> World:
    rng = np.random.default_rng(1)
    frame = GridFrame(-1.5, 0.25, 0.3, 0.37, 9, 14)
    return World(
        "g", OccupancyGrid(frame, *(rng.random((3, 9, 14)) < 0.4)), LandmarkSet(("a",), [[0.0, 2.0]])
    )


def plan_world() -> World:
    ring = Polygon(
        box(0, 0, 7, 7).exterior, [box(1, 1, 2, 2).exterior.coords, box(3, 3, 4, 4).exterior.coords]
    )
    floor = FloorPlan((ring, box(10, 0, 11, 1)), (box(5, 5, 6, 6), box(0.1, 0.1, 0.2, 0.3)), (True, False))
    return World("Halle ß", floor, marks(5))


@pytest.mark.parametrize(
    "world", [grid_world(), plan_world(), grid_world().with_landmarks(LandmarkSet.empty())]
)
def test_a_world_survives_packing_without_loss(world):
    meta, arrays = pack_world(world)
    again = unpack_world(json.loads(json.dumps(meta)), {k: np.array(v) for k, v in arrays.items()})
    assert again.content_hash() == world.content_hash()
    assert again.name == world.name
    assert again.landmarks.ids == world.landmarks.ids
    np.testing.assert_array_equal(again.landmarks.facing, world.landmarks.facing)
    assert type(again.floor) is type(world.floor)
    assert again.bounds == world.bounds


def test_a_plan_without_obstacles_survives():
    world = World("w", FloorPlan((box(0, 0, 1, 1),)), LandmarkSet.empty())
    assert unpack_world(*pack_world(world)).content_hash() == world.content_hash()


@pytest.mark.parametrize("key", ["format", "kind", "landmark_ids", "name", "n_floors"])
def test_a_missing_member_is_named(key):
    meta, arrays = pack_world(plan_world())
    del meta[key]
    with pytest.raises(MapFormatError, match="format" if key == "format" else key):
        unpack_world(meta, arrays)


@pytest.mark.parametrize("world", [grid_world(), plan_world()])
def test_a_missing_array_is_named(world):
    meta, arrays = pack_world(world)
    for key in arrays:
        with pytest.raises(MapFormatError, match=key):
            unpack_world(meta, {k: v for k, v in arrays.items() if k != key})


def test_damage_is_an_error_of_the_map_layer():
    meta, arrays = pack_world(plan_world())
    with pytest.raises(MapFormatError, match="format 2"):
        unpack_world(meta | {"format": 2}, arrays)
    with pytest.raises(MapFormatError, match="kind"):
        unpack_world(meta | {"kind": "cloud"}, arrays)
    with pytest.raises(MapFormatError):
        unpack_world([], arrays)
    with pytest.raises(MapFormatError):
        unpack_world(meta, arrays | {"vertices": arrays["vertices"][:3]})
    meta, arrays = pack_world(grid_world())
    with pytest.raises(InvalidGeometry):
        unpack_world(meta, arrays | {"free": arrays["free"][1:]})
    with pytest.raises(MapFormatError):
        unpack_world(meta | {"frame": [1, 2]}, arrays)
