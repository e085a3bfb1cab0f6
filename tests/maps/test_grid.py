from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maps.errors import InvalidGeometry
from maps.grid import MAX_CELLS, GridFrame, OccupancyGrid
from tests.worlds import world_from_ascii

frames = st.builds(
    GridFrame,
    st.floats(-1e3, 1e3),
    st.floats(-1e3, 1e3),
    st.floats(-4, 4),
    st.floats(0.01, 10),
    st.integers(1, 40),
    st.integers(1, 40),
)


@given(frames, st.floats(-50, 50), st.floats(-50, 50))
def test_world_and_grid_coordinates_are_inverse(frame, x, y):
    np.testing.assert_allclose(
        frame.to_grid(frame.to_world([x, y])), [x, y], atol=1e-9 * 1e3 / frame.resolution
    )


@given(frames, st.data())
def test_a_cell_holds_its_centre(frame, data):
    row, col = data.draw(st.integers(0, frame.n_rows - 1)), data.draw(st.integers(0, frame.n_cols - 1))
    centre = frame.centres()[row, col]
    np.testing.assert_array_equal(frame.cell_at(centre), [row, col])
    assert frame.contains(centre)
    np.testing.assert_array_equal(frame.centres(slice(row, row + 1), slice(col, col + 1))[0, 0], centre)


@given(frames)
def test_bounds_hold_all_corners(frame):
    x0, y0, x1, y1 = frame.bounds()
    centres = frame.centres().reshape(-1, 2)
    assert (centres.min(axis=0) > [x0, y0]).all()
    assert (centres.max(axis=0) < [x1, y1]).all()
    if frame.yaw == 0:
        np.testing.assert_allclose([x1 - x0, y1 - y0], [frame.width_m, frame.height_m])


@given(frames, st.floats(0.05, 5))
def test_resampling_covers_and_does_not_waste(frame, resolution):
    other = frame.resampled(resolution)
    assert other.resolution == resolution
    assert (other.origin_x, other.origin_y, other.yaw) == (frame.origin_x, frame.origin_y, frame.yaw)
    for new, old in ((other.width_m, frame.width_m), (other.height_m, frame.height_m)):
        assert old - 2e-6 * resolution <= new <= max(old, 0) + resolution


def test_a_turned_frame_by_hand():
    frame = GridFrame(10, 20, math.pi / 2, 0.5, 4, 6)
    # Columns run up, rows run to the left.
    np.testing.assert_allclose(frame.to_world([6, 0]), [10, 23])
    np.testing.assert_allclose(frame.to_world([0, 4]), [8, 20])
    np.testing.assert_array_equal(frame.cell_at([9.9, 20.1]), [0, 0])
    np.testing.assert_allclose(frame.bounds(), [8, 20, 10, 23])
    assert frame.shape == (4, 6)
    assert not frame.contains([10.1, 20.1])
    assert GridFrame(*frame.as_tuple()) == frame


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"resolution": 0}, "resolution is 0"),
        ({"resolution": -1}, "resolution is -1"),
        ({"resolution": math.nan}, "resolution is nan"),
        ({"origin_x": math.inf}, "origin_x is inf"),
        ({"origin_y": 2e7}, "origin_y is 2"),
        ({"yaw": math.nan}, "yaw is nan"),
        ({"n_rows": 0}, "0 rows"),
        ({"n_cols": -3}, "-3 columns"),
        ({"n_rows": MAX_CELLS, "n_cols": 2}, f"limit is {MAX_CELLS}"),
    ],
)
def test_impossible_frames_are_named(change, says):
    good = {"origin_x": 0, "origin_y": 0, "yaw": 0, "resolution": 1, "n_rows": 2, "n_cols": 2}
    with pytest.raises(InvalidGeometry, match=says):
        GridFrame(**good | change)


@pytest.mark.parametrize("resolution", [0, -1, math.nan, math.inf])
def test_resampling_needs_a_resolution(resolution):
    with pytest.raises(InvalidGeometry, match="resolution"):
        GridFrame(0, 0, 0, 1, 2, 2).resampled(resolution)


FLOOR = world_from_ascii("##?\n#..\n...", resolution=1.0).floor


def test_points_on_borders_need_all_their_cells():
    # Row 0 is the lowest line.
    free = {
        (0.5, 0.5): 1,
        (1.0, 0.5): 1,
        (1.5, 1.0): 1,
        (0.5, 1.0): 0,
        (1.0, 1.0): 0,
        (2.0, 1.5): 1,
        (2.5, 2.0): 0,
    }
    free |= {(0.0, 0.5): 0, (3.0, 0.5): 0, (-1.0, 0.5): 0, (2.5, 0.0): 0, (2.999, 0.001): 1}
    for point, expected in free.items():
        assert FLOOR.free_at(point) == bool(expected), point
    opaque = {
        (0.5, 1.5): 1,
        (1.0, 1.5): 1,
        (1.0, 1.0): 1,
        (1.5, 2.0): 1,
        (2.0, 2.5): 1,
        (2.5, 2.5): 0,
        (-1, -1): 0,
        (0.0, 2.5): 1,
    }
    for point, expected in opaque.items():
        assert FLOOR.opaque_at(point) == bool(expected), point
    np.testing.assert_array_equal(FLOOR.free_at(np.array([[[0.5, 0.5]], [[0.5, 1.5]]])), [[True], [False]])


def test_a_point_within_rounding_of_a_border_is_on_it():
    assert not FLOOR.free_at([1.0 + 1e-12, 1.5])
    assert FLOOR.free_at([1.0 + 1e-6, 1.5])


def test_edges_enclose_the_cells(rng):
    for _ in range(20):
        mask = rng.random((7, 9)) < 0.5
        grid = OccupancyGrid(GridFrame(3, -2, 0, 0.5, 7, 9), mask, ~mask)
        edges = grid.free_edges()
        # Green's theorem cannot be used on loose edges: compare lengths instead, cell side by cell side.
        padded = np.pad(mask, 1).astype(int)
        sides = np.abs(np.diff(padded, axis=0)).sum() + np.abs(np.diff(padded, axis=1)).sum()
        assert np.hypot(*(edges[:, 2:] - edges[:, :2]).T).sum() == pytest.approx(sides * 0.5)
        middles = (edges[:, :2] + edges[:, 2:]) / 2
        along = edges[:, 2:] - edges[:, :2]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None] * 0.01
        assert (grid.free_at(middles + normal) != grid.free_at(middles - normal))[
            np.hypot(*along.T) < 0.51
        ].all()


def test_edges_of_a_turned_grid_by_hand():
    grid = OccupancyGrid(GridFrame(1, 1, math.pi / 2, 2, 1, 1), [[True]], [[False]])
    corners = {tuple(np.round(p, 9) + 0.0) for e in grid.free_edges() for p in (e[:2], e[2:])}
    assert corners == {(1, 1), (1, 3), (-1, 1), (-1, 3)}
    assert len(grid.opaque_edges()) == 0
    assert grid.free_area_m2 == 4


def test_masks_must_fit_the_frame_and_cannot_be_changed():
    frame = GridFrame(0, 0, 0, 1, 2, 3)
    with pytest.raises(InvalidGeometry, match=r"opaque has shape \(3, 2\), its frame \(2, 3\)"):
        OccupancyGrid(frame, np.ones((2, 3)), np.ones((3, 2)))
    grid = OccupancyGrid(frame, np.ones((2, 3), dtype=bool), np.zeros((2, 3), dtype=bool))
    assert not grid.unknown.any()
    with pytest.raises(ValueError, match="read-only"):
        grid.free[0, 0] = False
    again = pickle.loads(pickle.dumps(grid))
    assert again.content_hash() == grid.content_hash()


def test_the_hash_sees_every_mask_and_the_frame():
    frame = GridFrame(0, 0, 0, 1, 2, 2)
    none = np.zeros((2, 2), dtype=bool)
    one = none.copy()
    one[1, 0] = True
    grids = [
        OccupancyGrid(frame, none, none, none),
        OccupancyGrid(frame, one, none, none),
        OccupancyGrid(frame, none, one, none),
        OccupancyGrid(frame, none, none, one),
        OccupancyGrid(GridFrame(0, 0, 1e-9, 1, 2, 2), none, none, none),
    ]
    assert len({g.content_hash() for g in grids}) == 5
