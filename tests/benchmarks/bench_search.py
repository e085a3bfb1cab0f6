"""Searches between two places against those of other packages, on one cost grid; processor time of one thread."""

from __future__ import annotations

import importlib
import time

import numpy as np
from skimage.graph import MCP_Geometric

from planner.pair_search import PairSearch
from planner.pivots import Pivots
from tests.benchmarks.planning import RADIUS, WEIGHT, available, case, ms

PAIRS = 100
TITLE = f"Grid search: {PAIRS} seeded pairs (radius {RADIUS:g} m, weight {WEIGHT:g} per m; p50 / p95, processor time)"
# The slow ones are asked for the first pairs only.
FEW, FEWEST = 10, 2


def run():
    return [_row(name) for name in available()]


def _row(name):
    it = case(name, PAIRS)
    space = it.graph.cost_space
    cells = [space.frame.cell_at(pair) for pair in it.pairs]
    pivots, made = _timed(lambda: Pivots.build(it.graph))
    pairs = PairSearch()
    pairs.path(it.graph, *it.pairs[0])  # work arrays

    def ours(k, some=pivots):
        return pairs.path(it.graph, *it.pairs[k], pivots=some).cost

    rivals = _rivals(space, cells)
    times, costs = {}, {}
    for rival, (search, n) in {
        "ours": (ours, PAIRS),
        "plain": (lambda k: ours(k, None), PAIRS),
        **rivals,
    }.items():
        done = [_timed(lambda k=k, search=search: search(k)) for k in range(min(n, PAIRS))]
        costs[rival], times[rival] = ([d[i] for d in done] for i in (0, 1))
    error = np.abs(np.array(costs["ours"]) / np.array(costs["MCP_Geometric"]) - 1).max()
    if error > 1e-9 or costs["ours"] != costs["plain"]:
        raise AssertionError(f"{name}: costs differ from those of MCP_Geometric by {error:.1e}.")

    def ratio(rival):
        if rival not in times:
            return "not installed"
        n = len(times[rival])
        few = "" if n == PAIRS else f" (of {n})"
        return f"{ms(times[rival])}, {np.median(times[rival]) / np.median(times['ours'][:n]):.0f} ×{few}"

    return {
        "floor": name,
        "passable cells": f"{int(space.passable.sum()):,}",
        "pivots [s]": f"{made:.1f}",
        "ours [ms]": ms(times["ours"]),
        "without pivots": ms(times["plain"]),
        **{rival: ratio(rival) for rival in ("MCP_Geometric", "pyastar2d", "tcod A*", "scikit-fmm")},
        "cost − MCP, largest": f"{error:.0e}",
    }


def _rivals(space, cells):
    """Searches by pair number and how many pairs they get; those that are installed."""
    rate, passable = space.rate, space.passable
    priced = np.where(passable, space.frame.resolution * rate, -1.0)
    light = np.where(passable, rate, np.inf).astype(np.float32)
    zero = np.where(passable, rate, 0.0).astype(np.float32)

    def mcp(k):
        start, goal = (tuple(int(v) for v in c) for c in cells[k])
        return float(MCP_Geometric(priced).find_costs([goal], [start])[0][start])

    found = {"MCP_Geometric": (mcp, PAIRS)}
    if (astar := _module("pyastar2d")) is not None:
        # It counts a diagonal move like a straight one.
        def two_d(k):
            return astar.astar_path(light, *(tuple(int(v) for v in c) for c in cells[k]), allow_diagonal=True)

        found["pyastar2d"] = (two_d, PAIRS)
    if (tcod := _module("tcod.path")) is not None:

        def roguelike(k):
            (r0, c0), (r1, c1) = cells[k]
            return tcod.AStar(zero, diagonal=2**0.5).get_path(int(r0), int(c0), int(r1), int(c1))

        found["tcod A*"] = (roguelike, FEW)
    if (fmm := _module("skfmm")) is not None:
        # All cells at a time; the wave does not stop at the start.
        def marching(k):
            phi = np.ma.MaskedArray(np.ones(rate.shape), ~passable)
            phi[tuple(int(v) for v in cells[k][1])] = -1.0
            return fmm.travel_time(phi, 1.0 / np.where(passable, rate, 1.0), dx=space.frame.resolution)

        found["scikit-fmm"] = (marching, FEWEST)
    return found


def _module(name):
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _timed(job):
    began = time.thread_time()
    found = job()
    return found, time.thread_time() - began
