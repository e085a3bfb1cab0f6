from __future__ import annotations

import pickle

import pytest
from shapely.geometry import box

from maps.errors import LandmarkOutsideMap, MapFormatError, SurepathError, TooFewLandmarks
from maps.floor_plan import FloorPlan
from maps.landmarks import LandmarkSet
from maps.world import World, default_resolution
from tests.worlds import place_in_ascii, world_from_ascii

FLOOR = FloorPlan((box(0, 0, 10, 5),))


def world(*xy, name="hall"):
    return World(name, FLOOR, LandmarkSet(tuple(f"L{i}" for i in range(len(xy))), list(xy) if xy else [[]]))


def test_landmarks_may_stand_in_walls_but_not_outside_the_map():
    assert len(world((-0.5, 0), (10.5, 5.5)).landmarks) == 2
    for xy in ((-0.51, 0), (10.51, 0), (5, -0.51), (5, 5.51)):
        with pytest.raises(
            LandmarkOutsideMap, match=r"'L1' at .* is outside the map, which spans x 0 … 10 m, y 0 … 5 m"
        ):
            world((1, 1), xy)


def test_three_landmarks_are_needed_for_a_fix():
    world((1, 1), (2, 2), (3, 1)).require_triangulation()
    with pytest.raises(TooFewLandmarks, match="'hall' has 2 landmarks; a fix needs 3"):
        world((1, 1), (2, 2)).require_triangulation()
    assert issubclass(TooFewLandmarks, SurepathError)


def test_names_are_labels_and_not_content():
    one = world((1, 1))
    assert one.renamed("other").name == "other"
    assert one.renamed("other").content_hash() == one.content_hash()
    assert one.with_landmarks(LandmarkSet.empty()).content_hash() != one.content_hash()
    assert pickle.loads(pickle.dumps(one)).content_hash() == one.content_hash()
    for name in ("", "a\nb", "x" * 201):
        with pytest.raises(MapFormatError, match="printable"):
            world(name=name)


def test_resolutions_suit_the_size():
    sizes = {5: 0.05, 30: 0.05, 60: 0.1, 130: 0.2, 400: 0.5, 5000: 0.5}
    for side, expected in sizes.items():
        big = World("w", FloorPlan((box(0, 0, side, side),)), LandmarkSet.empty())
        assert default_resolution(big) == expected
    assert world().grid_frame(0.5).shape == (10, 20)
    assert world().bounds == (0, 0, 10, 5)


def test_drawn_worlds_lie_as_drawn():
    drawing = "#A#\n.s.\n?.B"
    drawn = world_from_ascii(drawing, resolution=2.0)
    assert drawn.landmarks.ids == ("A", "B")
    assert drawn.landmarks.positions.tolist() == [[3, 5], [5, 1]]
    assert place_in_ascii(drawing, "s", 2.0) == (3, 3)
    assert drawn.floor.opaque.tolist() == [[False] * 3, [False] * 3, [True, False, True]]
    assert drawn.floor.free.sum() == 6
    assert drawn.floor.unknown[0, 0]
