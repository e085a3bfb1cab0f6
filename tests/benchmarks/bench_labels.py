"""Label searches: bounds on the metres without a fix, and paths by fused belief beside the real filter."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np

from localization.field_builder import build_field
from localization.sensors import LASER, MAS97_CAMERA
from maps import sites
from maps.io.load import load_world
from planner.context import PlanningContext
from planner.fused_belief import FilterModel, FusedField
from planner.fused_search import FusedQuestion, fused_path
from planner.fused_verify import straight_lines
from planner.label_search import blind_path
from tests.conftest import SHARED

TITLE = "Label searches: 20 seeded pairs (0.1 m, radius 0.35 m, filter at 10 Hz and 1 m/s)"
PAIRS, RADIUS = 20, 0.35
START = np.diag([0.005**2, 0.005**2, math.radians(0.3) ** 2])
FUSED = {
    "fused, shortest": {},
    "fused, weight 4 per m": {"objective": "weighted", "weight": 4.0},
    "fused, minimax": {"objective": "minimax"},
    "fused, collision ≤ 1 %": {"max_collision_probability": 0.01},
}


def pairs(graph, has_fix, rng):
    """Pairs of cell centres with a fix that a grid path connects."""
    rows, cols = np.nonzero(graph.cost_space.passable & has_fix)
    found = []
    while len(found) < PAIRS:
        i, j = rng.integers(len(rows), size=2)
        ends = graph.cost_space.centre(rows[[i, j]], cols[[i, j]])
        start, goal = (tuple(float(v) for v in p) for p in ends)
        if i != j and graph.costs_to(goal).path_from(start)[1] is not None:
            found.append((start, goal))
    return found


def row(site, name, graph, ends, search, real=None, harms=()):
    """One line of the table; ``search`` answers a pair, ``real`` gives the filter's worst r95 along points."""
    search(*ends[0])
    seconds, outcomes, longer, corners, lines = [], {}, [], [], []
    for start, goal in ends:
        began = time.thread_time()
        path = search(start, goal)
        seconds.append(time.thread_time() - began)
        outcomes[path.status] = outcomes.get(path.status, 0) + 1
        length = np.hypot(*np.diff(path.points, axis=0).T).sum()
        longer.append(length / graph.costs_to(goal).path_from(start)[0] - 1)
        if real is not None:
            corners.append(real(path.points) / path.worst_r95)
            lines.append(real(straight_lines(path.points, graph.cost_space, harms=harms)) / path.worst_r95)
    p50, p95 = 1000 * np.percentile(seconds, [50, 95])
    return {
        "site": site,
        "cells": int(graph.cost_space.passable.sum()),
        "question": name,
        "p50 / p95 [ms]": f"{p50:.0f} / {p95:.0f}",
        "outcomes": ", ".join(f"{n} {status}" for status, n in sorted(outcomes.items())),
        "longer than shortest, mean": f"{100 * np.mean(longer):.1f} %",
        "filter / search, worst r95: on the grid p50": f"{np.median(corners):.2f}" if corners else "",
        "largest": f"{max(corners):.2f}" if corners else "",
        "on lines p50": f"{np.median(lines):.2f}" if lines else "",
        "on lines largest": f"{max(lines):.2f}" if lines else "",
    }


def rows_of(site, context):
    """All questions on one field."""
    graph = context.graph(radius=RADIUS, weight=0.0, blind_rate=1.0)
    fused, model = FusedField.from_field(context.field), FilterModel()
    known, harms = fused.has_fix, fused.harms
    ends = pairs(graph, known, np.random.default_rng(7))
    out = []
    for bound in (5.0, 10.0):

        def blind(start, goal, bound=bound):
            return blind_path(graph, known, start, goal, max_blind_distance=bound)

        out.append(row(site, f"at most {bound:g} m without a fix", graph, ends, blind))
    for name, options in FUSED.items():

        def search(start, goal, options=options):
            return fused_path(graph, fused, model, FusedQuestion(start, goal, START, **options))

        def real(points):
            return fused.along(points, START, model).r95.max()

        out.append(row(site, name, graph, ends, search, real, harms))
    return out


def run():
    world = load_world(Path(sites.__file__).parent / "warehouse.geojson")
    out = []
    for name, sensor in (("laser", LASER), ("camera", MAS97_CAMERA)):
        out += rows_of(f"warehouse, {name}", PlanningContext(build_field(world, sensor, resolution=0.1)))
    site = SHARED / "landmark_maps" / "cob" / "ipa-production-plant"
    if site.is_dir():
        out += rows_of("plant, laser", PlanningContext(build_field(load_world(site), LASER, resolution=0.1)))
    return out
