"""One line of sight at a time: the same answers as whole sets of them."""

import numpy as np
import pytest

from maps.io.site import bundled_site
from maps.sight import scene_args, visible_pairs
from maps.visibility import visible_landmarks
from tests.worlds import world_from_ascii

DRAWING = """
##########
#A...#..B#
#....#...#
#.C.....D#
#....#...#
#E...#..F#
##########
"""


@pytest.mark.parametrize("name", ["warehouse", "mas97_room", "ascii"])
@pytest.mark.parametrize(("low", "high"), [(0.0, np.inf), (2.0, 9.0)])
def test_pairs_see_what_visible_landmarks_sees(name, low, high):
    world = world_from_ascii(DRAWING) if name == "ascii" else bundled_site(name)
    rng = np.random.default_rng(5)
    x0, y0, x1, y1 = world.bounds
    points = rng.uniform([x0 - 1, y0 - 1], [x1 + 1, y1 + 1], (300, 2))
    expected = visible_landmarks(world, points, min_range=low, max_range=high)
    n = len(world.landmarks)
    at, index = np.divmod(np.arange(300 * n), n)
    seen = visible_pairs(points[at], index, scene_args(world, min_range=low, max_range=high))
    np.testing.assert_array_equal(seen.reshape(300, n), expected)
    assert 0 < expected.sum() < expected.size
