"""Worlds drawn in ASCII: ``#`` wall, ``.`` free, ``?`` unknown, capital letters landmarks, ``s g`` places."""

from __future__ import annotations

import numpy as np

from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World


def world_from_ascii(drawing: str, resolution: float = 0.5, **landmark_options) -> World:
    """Top line is the highest y; letters stand at cell centres on free cells."""
    lines = [line.strip() for line in drawing.strip().splitlines()][::-1]
    n_rows, n_cols = len(lines), len(lines[0])
    assert all(len(line) == n_cols for line in lines), "ragged drawing"
    chars = np.array([list(line) for line in lines])
    frame = GridFrame(0.0, 0.0, 0.0, resolution, n_rows, n_cols)
    floor = OccupancyGrid(frame, ~np.isin(chars, ["#", "?"]), chars == "#", chars == "?")
    where = {c: (k % n_cols, k // n_cols) for k, c in enumerate(chars.ravel()) if c.isupper()}
    ids = tuple(sorted(where))
    xy = [((where[i][0] + 0.5) * resolution, (where[i][1] + 0.5) * resolution) for i in ids]
    return World("ascii", floor, LandmarkSet(ids, np.array(xy).reshape(-1, 2), **landmark_options))


def place_in_ascii(drawing: str, letter: str, resolution: float = 0.5) -> tuple[float, float]:
    """Centre of the cell that holds a letter, m."""
    lines = [line.strip() for line in drawing.strip().splitlines()][::-1]
    for row, line in enumerate(lines):
        if letter in line:
            return ((line.index(letter) + 0.5) * resolution, (row + 0.5) * resolution)
    raise KeyError(letter)
