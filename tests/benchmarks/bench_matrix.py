"""Matrices on floors of 2000 × 2000 cells, against a plan's grid search per pair."""

from __future__ import annotations

import time

import numpy as np
from scipy.ndimage import label

from planner.context import PlanningContext
from planner.matrix import cost_matrix, warm_up
from planner.travel import Travel
from tests.benchmarks import floors
from tests.fields import synthetic_field

TITLE = "Matrix: 50 × 50 places on 2000 × 2000 cells of 0.05 m (radius 0.3 m, weight 4 per m)"
SIDE, PLACES, PAIRS = 2000, 50, 10
TRAVEL = Travel(0.3)


def smooth_sigma(x, y):
    """Some field with hills: its values do not change the size of the search."""
    return 0.03 + 0.02 * np.sin(x / 3) * np.cos(y / 2)


def connected_places(graph, count, rng):
    """Cell centres in the largest connected part."""
    parts, _ = label(graph.cost_space.passable, structure=np.ones((3, 3)))
    rows, cols = np.nonzero(parts == 1 + np.argmax(np.bincount(parts.ravel())[1:]))
    pick = rng.integers(len(rows), size=count)
    return graph.cost_space.centre(rows[pick], cols[pick]), len(rows)


def run():
    warm_up()
    out = []
    for name, make in floors.available()[0].items():
        context = PlanningContext(
            synthetic_field(make(SIDE, PLACES), floors.RESOLUTION_M, smooth_sigma), cache_bytes=1
        )
        graph = TRAVEL.graph(context)
        places, n_cells = connected_places(graph, 2 * PLACES, np.random.default_rng(3))
        times = {}
        for workers in (1, 2):
            began, cpu = time.perf_counter(), time.process_time()
            matrix = cost_matrix(
                context, places[:PLACES], places[PLACES:], travel=TRAVEL, deadline=600.0, workers=workers
            )
            times[workers] = time.perf_counter() - began, time.process_time() - cpu
        began = time.perf_counter()
        for k in range(PAIRS):
            cost, _ = graph.costs_to(tuple(places[PLACES + k])).path_from(tuple(places[k]))
            if not matrix.cost[k, k] <= cost * (1 + 1e-9):
                raise AssertionError(f"A pair costs {matrix.cost[k, k]} in the matrix, {cost} alone.")
        alone = (time.perf_counter() - began) / PAIRS * PLACES**2
        out.append(
            {
                "floor": name,
                "cells": n_cells,
                "pairs with a way": f"{100 * np.isfinite(matrix.cost).mean():.0f} %",
                "searches": int(matrix.stats["searches"]),
                "1 thread [s]": f"{times[1][0]:.1f}",
                "2 threads [s]": f"{times[2][0]:.1f}",
                "processor time of 2 [s]": f"{times[2][1]:.1f}",
                "a search per pair, from 10 pairs [s]": f"{alone:.0f}",
            }
        )
    return out
