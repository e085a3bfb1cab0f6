"""Floors of millions of cells at 0.05 m with landmarks on their walls: real ones, tiled, and an open hall."""

from __future__ import annotations

import math

import numpy as np

from maps.errors import SurepathError
from maps.grid import GridFrame, OccupancyGrid
from maps.io.load import load_world
from maps.landmarks import LandmarkSet
from maps.world import World
from tests.conftest import SHARED

RESOLUTION_M, STREETS_M = 0.05, 0.25
# The largest first: they fill the mosaic shelf by shelf.
MOSAIC = (
    "pal_hospital_with_aruco/map",
    "strands_kth/map",
    "strands_g4s/g4s_y2",
    "willow/willow-2010-02-18-0.10",
    "pal_office/map",
    "aws_warehouse_005/map",
    "mir/maze_virtual_walls",
    "nav2/tb3_sandbox",
    "f1tenth/columbia",
    "nav2/depot",
)


def hall(side, n_landmarks, seed=1):
    """An open hall with a pillar of 0.4 m every 10 m: much is seen from everywhere, the most there is to write."""
    opaque = np.zeros((side, side), dtype=bool)
    opaque[:2] = opaque[-2:] = True
    opaque[:, :2] = opaque[:, -2:] = True
    for row in range(100, side - 50, 200):
        for col in range(100, side - 50, 200):
            opaque[row : row + 8, col : col + 8] = True
    return _world("hall", ~opaque, opaque, n_landmarks, seed)


def plant(side, n_landmarks, seed=1):
    """The ipa production plant, repeated until the floor is full."""
    floor = load_world(SHARED / "landmark_maps" / "cob" / "ipa-production-plant").floor
    free, opaque = (_tiled(a, side) for a in (floor.free, floor.opaque))
    return _world("plant", free, opaque, n_landmarks, seed)


def mosaic(side, n_landmarks, seed=1):
    """Ten real maps side by side, cell by cell as they are."""
    free, opaque = (np.zeros((2000, 2000), dtype=bool) for _ in range(2))
    row = col = height = 0
    for name in MOSAIC:
        floor = load_world(SHARED / "ros_maps" / f"{name}.yaml").floor
        rows, cols = floor.frame.shape
        if col + cols > free.shape[1]:
            row, col, height = row + height, 0, 0
        free[row : row + rows, col : col + cols] = floor.free
        opaque[row : row + rows, col : col + cols] = floor.opaque
        col, height = col + cols, max(height, rows)
    return _world("mosaic", _tiled(free, side), _tiled(opaque, side), n_landmarks, seed)


def available():
    """Makers of floors by name, and the reason for those that are left out."""
    makers = {"plant": plant, "mosaic": mosaic, "hall": hall}
    if SHARED.is_dir():
        return makers, ""
    return {"hall": hall}, "plant and mosaic left out: the shared data folder is not beside this checkout"


def _tiled(cells, side):
    times = [math.ceil(side / n) for n in cells.shape]
    return np.tile(cells, times)[:side, :side]


def streets(name, n_landmarks, seed=1):
    """A street map of the MovingAI benchmarks, 0.25 m a cell."""
    lines = (SHARED / "movingai" / "cities" / f"{name}.map").read_text().split("\n")
    n_rows = int(lines[1].split()[1])
    free = np.array([[c in ".G" for c in line.strip()] for line in lines[4 : 4 + n_rows]])[::-1]
    return _world(name, free, ~free, n_landmarks, seed, STREETS_M)


def willow(n_landmarks, seed=1):
    """The map of Willow Garage, 0.1 m a cell."""
    floor = load_world(SHARED / "ros_maps" / "willow" / "willow-2010-02-18-0.10.yaml").floor
    return _world("willow", floor.free, floor.opaque, n_landmarks, seed, floor.frame.resolution)


def _world(name, free, opaque, n_landmarks, seed, resolution=RESOLUTION_M):
    """Landmarks on faces between wall and free space, half of them seen from in front only."""
    rng = np.random.default_rng(seed)
    frame = GridFrame(0.0, 0.0, 0.0, resolution, *free.shape)
    places, azimuths = [], []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        # A wall cell and the free cell beside it, in the direction of the sign.
        wall = [slice(None), slice(None)]
        beside = [slice(None), slice(None)]
        wall[axis] = slice(None, -1) if sign > 0 else slice(1, None)
        beside[axis] = slice(1, None) if sign > 0 else slice(None, -1)
        rows, cols = np.nonzero(opaque[tuple(wall)] & free[tuple(beside)])
        pick = rng.choice(len(rows), min(n_landmarks, len(rows)), replace=False)
        rows, cols = rows[pick].astype(float), cols[pick].astype(float)
        along = rng.uniform(0.0, 1.0, len(pick))
        # In the cut array the face is the upper side of the cell, whichever sign.
        places.append(
            np.column_stack([cols + along, rows + 1.0] if axis == 0 else [cols + 1.0, rows + along])
        )
        azimuths.append(
            np.full(len(pick), (math.pi / 2 if axis == 0 else 0.0) + (math.pi if sign < 0 else 0.0))
        )
    places, azimuths = np.concatenate(places), np.concatenate(azimuths)
    if len(places) < n_landmarks:
        raise SurepathError(f"Floor '{name}' has walls for {len(places)} landmarks only.")
    pick = rng.choice(len(places), n_landmarks, replace=False)
    facing = np.where(rng.random(n_landmarks) < 0.5, azimuths[pick], np.nan)
    landmarks = LandmarkSet(tuple(f"L{i}" for i in range(n_landmarks)), frame.to_world(places[pick]), facing)
    return World(name, OccupancyGrid(frame, free, opaque), landmarks)
