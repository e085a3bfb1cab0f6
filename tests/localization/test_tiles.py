"""Windows of cells."""

from __future__ import annotations

import numpy as np
import pytest

from localization.sensors import LASER
from localization.tiles import compute_tile, tile_windows
from localization.triplets import best_triplet, pack_masks
from maps.visibility import compute_visibility, visible_landmarks
from tests.worlds import world_from_ascii

DRAWING = """
    A.........B
    ...........
    .....##....
    ...........
    C.........D
"""


@pytest.mark.parametrize(
    ("shape", "tile"),
    [((1, 1), 1), ((5, 7), 1), ((5, 7), 3), ((5, 7), 128), ((128, 128), 128), ((129, 300), 128)],
)
def test_windows_cover_every_cell_once(shape, tile):
    count = np.zeros(shape, dtype=int)
    for window in tile_windows(shape, tile):
        assert count[window].size <= tile * tile
        count[window] += 1
    assert (count == 1).all()


def test_tile_of_a_window_is_the_window_of_the_whole():
    world = world_from_ascii(DRAWING)
    frame = world.grid_frame(0.25)
    visibility = compute_visibility(world, frame)
    windows = [(slice(None), slice(None)), (slice(2, 7), slice(3, 11))]
    tiles = []
    for w in windows:
        centres = frame.centres(*w)
        tiles.append(compute_tile(world, LASER, centres, world.floor.free_at(centres), visibility.masks(*w)))
    for name in ("covariance", "sigma_theta", "triplet", "pan", "n_visible"):
        np.testing.assert_array_equal(getattr(tiles[1], name), getattr(tiles[0], name)[windows[1]])
    assert tiles[0].triplet.dtype == np.int16


def test_tile_of_scattered_points():
    world = world_from_ascii(DRAWING)
    points = np.array([[0.4, 1.0], [3.0, 1.9], [5.0, 0.6]])
    masks = pack_masks(visible_landmarks(world, points))
    tile = compute_tile(world, LASER, points[None], np.ones((1, 3), dtype=bool), masks[None])
    for k, point in enumerate(points):
        choice = best_triplet(world, LASER, point)
        assert tuple(tile.triplet[0, k]) == choice.triplet
        assert tile.covariance[0, k].tolist() == choice.covariance.tolist()
