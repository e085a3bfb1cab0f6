"""Smoothing of any-angle paths of 20 to 100 m: time, success verified densely, and what it gains."""

from __future__ import annotations

import math
import time

import numpy as np

from planner.annotate import annotate
from planner.any_angle import shorten
from planner.motion import least_limit
from planner.plan import _move, warm_up
from planner.problem import PlanningProblem
from planner.timing import time_polyline
from tests.benchmarks.planning import BLIND_R95, RADIUS, WEIGHT, available, case, ms

PAIRS = 100
SHORTEST_M, LONGEST_M = 20.0, 100.0
SPEED, ACCEL = 1.2, 0.8
TITLE = (
    f"Smoothing: paths of {SHORTEST_M:g} to {LONGEST_M:g} m among {PAIRS} seeded pairs ({SPEED:g} m/s, {ACCEL:g} m/s²; "
    "p50 / p95, processor time)"
)
# Motions are checked so many times as densely as they are sampled; what rounding may take.
DENSE, SLACK = 8, 1e-6


def run():
    warm_up()
    return [row for name in available() if (row := _row(name)) is not None]


def _row(name):
    it = case(name, PAIRS)
    space = it.graph.cost_space
    seconds, faster, surer, stops = [], [], [], []
    n_smooth = n_valid = 0
    for start, goal in it.pairs:
        problem = PlanningProblem(
            start,
            goal,
            RADIUS,
            weight=WEIGHT,
            blind_r95=BLIND_R95,
            deadline=30.0,
            max_speed=SPEED,
            max_accel=ACCEL,
        )
        way = _way(it, start, goal)
        points, cost = shorten(way.points, space)
        length = float(np.hypot(*np.diff(points, axis=0).T).sum())
        if not SHORTEST_M <= length <= LONGEST_M:
            continue
        began = time.thread_time()
        motion = _move(points, cost, way, problem, math.inf)
        seconds.append(time.thread_time() - began)
        corners = time_polyline(points, max_speed=SPEED, max_accel=ACCEL)
        n_smooth += motion.is_smooth or len(points) == 2
        n_valid += _is_valid(motion.trajectory, space, least_limit(cost, way.grid_cost))
        stops.append(motion.n_stops)
        faster.append(1 - motion.trajectory.duration / corners.duration)
        a, b = (annotate(t, it.context, space).summary for t in (corners, motion.trajectory))
        if a.mean_r95 and b.mean_r95:
            surer.append(1 - b.mean_r95 / a.mean_r95)
    if not seconds:
        return None
    return {
        "floor": name,
        "paths": len(seconds),
        "smoothing [ms]": ms(seconds),
        "smooth": f"{100 * n_smooth / len(seconds):.1f} %",
        "valid, checked densely": f"{100 * n_valid / len(seconds):.1f} %",
        "without a stop": f"{100 * np.mean(np.array(stops) == 0):.0f} %",
        "time saved p50, most": f"{100 * np.median(faster):.0f} %, {100 * max(faster):.0f} %",
        "mean r95 saved p50, least, most": (
            f"{100 * np.median(surer):.1f} %, {100 * min(surer):.1f} %, {100 * max(surer):.1f} %"
        ),
    }


def _way(it, start, goal):
    """The grid's path with what smoothing asks for."""
    from planner.grid_search import Way

    found = it.context.path(it.graph, start, goal)
    return Way(it.graph, found.points, found.cost)


def _is_valid(trajectory, space, limit):
    """Whether places between the samples keep clearance and cells, and samples speed and acceleration."""
    t = np.asarray(trajectory.t)
    fine = np.interp(np.arange(DENSE * (len(t) - 1) + 1) / DENSE, np.arange(len(t)), t)
    # Cubic between samples: the motion that a controller with these states drives.
    k = np.clip(np.searchsorted(t, fine, side="right") - 1, 0, len(t) - 2)
    h = np.maximum(np.diff(t), 1e-12)[k]
    u = ((fine - t[k]) / h)[:, None]
    p, v = np.asarray(trajectory.points), np.asarray(trajectory.velocity)
    h = h[:, None]
    places = (
        (1 + 2 * u) * (1 - u) ** 2 * p[k]
        + u * (1 - u) ** 2 * h * v[k]
        + u**2 * (3 - 2 * u) * p[k + 1]
        + u**2 * (u - 1) * h * v[k + 1]
    )
    clear = space.clearance.distance(places).min() >= space.radius - 1e-4
    slow = np.hypot(*v.T).max() <= SPEED * (1 + 1e-3)
    gentle = np.hypot(*np.asarray(trajectory.acceleration).T).max() <= ACCEL * (1 + 1e-2)
    return bool(clear and slow and gentle and space.line_cost(p) <= limit * (1 + SLACK))
