"""Floors, fields and pairs of places that the planning sections share; nothing is timed here."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import label

from localization.field_builder import build_field
from localization.sensors import LASER
from maps.io.load import load_world
from planner.context import PlanningContext
from planner.cost_to_go import GridGraph
from tests.benchmarks import floors
from tests.conftest import SHARED

RADIUS, WEIGHT, BLIND_R95 = 0.35, 5.0, 0.5
FLOORS = {
    "plant 2000": lambda: floors.plant(2000, 200),
    "hall 2000": lambda: floors.hall(2000, 200),
    "plant": lambda: load_world(SHARED / "landmark_maps" / "cob" / "ipa-production-plant"),
    "willow": lambda: floors.willow(150),
    "Berlin_1_512": lambda: floors.streets("Berlin_1_512", 150),
    "Boston_0_1024": lambda: floors.streets("Boston_0_1024", 300),
}
# Sides of cells, m, where they are not those of the floor's own grid.
CELLS = {"plant": 0.1}


@dataclass(frozen=True, eq=False)
class Case:
    """A context, its graph for the question and the one for the shortest route, and the pairs (start, goal)."""

    context: PlanningContext
    graph: GridGraph
    length: GridGraph
    pairs: list


@lru_cache(maxsize=1)
def case(name, n_pairs, seed=7):
    """A floor with seeded pairs of cell centres that the cells connect."""
    world = FLOORS[name]()
    resolution = CELLS.get(name) or world.floor.frame.resolution
    context = PlanningContext(build_field(world, LASER, resolution=resolution))
    graph = context.graph(radius=RADIUS, weight=WEIGHT, blind_rate=1.0 + WEIGHT * BLIND_R95)
    length = context.graph(radius=RADIUS, weight=0.0, blind_rate=1.0)
    # The plain connection of cells is the oracle of whether there is a path.
    labels, _ = label(graph.cost_space.passable, structure=np.ones((3, 3)))
    rows, cols = np.nonzero(graph.cost_space.passable)
    rng, pairs = np.random.default_rng(seed), []
    while len(pairs) < n_pairs:
        k = rng.integers(len(rows), size=2)
        if k[0] != k[1] and len(set(labels[rows[k], cols[k]])) == 1:
            centres = graph.cost_space.centre(rows[k], cols[k])
            pairs.append(tuple(tuple(float(v) for v in p) for p in centres))
    return Case(context, graph, length, pairs)


def available():
    """Names of the floors that can be made here."""
    return list(FLOORS) if SHARED.is_dir() else ["hall 2000"]


def ms(seconds):
    """Median and 95th percentile of seconds, in milliseconds."""
    p50, p95 = 1000 * np.percentile(seconds, [50, 95])
    return f"{p50:.1f} / {p95:.1f}"
