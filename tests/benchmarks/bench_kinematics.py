"""Ways from pose to pose in the warehouse: time, success, and cost above a robot that may drive sideways."""

from __future__ import annotations

import math
import time

import numpy as np

from localization.field_builder import build_field
from localization.sensors import LASER
from maps.io.site import bundled_site
from planner.any_angle import shorten
from planner.context import PlanningContext
from planner.lattice import End, Outcome, lattice_for, search_lattice
from planner.pose_plan import warm_up
from planner.pose_shorten import shorten_poses
from planner.pose_timing import MotionLimits, drive
from planner.sampling_se2 import refine_poses_with_ompl
from planner.steering import PoseSpace, Steering

TITLE = (
    "Kinematics: 20 seeded pairs of poses in the warehouse (0.1 m, radius 0.3 m, 16 headings; processor time)"
)
PAIRS = 20
RADIUS, WEIGHT = 0.3, 4.0
LIMITS = MotionLimits(1.2, 0.8, 1.0, 2.0)
ROBOTS = {
    "differential": Steering("differential", turn_price=0.3),
    "Dubins 0.8 m": Steering("dubins", 0.8),
    "Reeds–Shepp 0.8 m": Steering("reeds_shepp", 0.8, gear_price=0.5),
    "Reeds–Shepp 1.5 m": Steering("reeds_shepp", 1.5, gear_price=0.5),
}
SAMPLES = 300


def taken(seconds, stage, function, *args, **options):
    """Result of a call; its processor time goes to a stage."""
    began = time.process_time()
    result = function(*args, **options)
    seconds.setdefault(stage, []).append(time.process_time() - began)
    return result


def ms(values):
    """Median and 95th percentile of seconds, in milliseconds."""
    p50, p95 = 1000 * np.percentile(values, [50, 95])
    return f"{p50:.0f} / {p95:.0f}"


def percent(values):
    """Median and largest of ratios, above 1."""
    return f"{100 * (np.median(values) - 1):.2f} / {100 * (max(values) - 1):.2f} %"


def pairs(graph, rng):
    """Pairs of poses whose places a grid path connects, and the cost of the any-angle path between them."""
    space = graph.cost_space
    # A car has room to leave.
    rows, cols = np.nonzero(space.passable & (space.centre_clearance > 2 * RADIUS))
    found = []
    while len(found) < PAIRS:
        i, j = rng.integers(len(rows), size=2)
        headings = rng.uniform(-np.pi, np.pi, 2)
        start, goal = (tuple(p) for p in space.centre(rows[[i, j]], cols[[i, j]]))
        path = graph.costs_to(goal).path_from(start)[1]
        if np.hypot(*np.subtract(start, goal)) > 3.0 and path is not None:
            found.append(((*start, headings[0]), (*goal, headings[1]), shorten(path, space)[1]))
    return found


def run():
    context = PlanningContext(build_field(bundled_site("warehouse"), LASER, resolution=0.1))
    warm_up()
    graph = context.graph(radius=RADIUS, weight=WEIGHT, blind_rate=1 + WEIGHT * 0.5)
    space = graph.cost_space
    ends = pairs(graph, np.random.default_rng(11))
    out = []
    for name, steering in ROBOTS.items():
        poses = PoseSpace(space, space.rate[None], steering)
        lattice = lattice_for(poses)
        seconds: dict[str, list[float]] = {}
        above, gain, by_ompl, stops = [], [], 0, 0
        for start, goal, holonomic in ends:
            way = taken(seconds, "lattice", search_lattice, lattice, End(*start), End(*goal))
            if way.outcome is not Outcome.FOUND:
                continue
            curve, cost = taken(seconds, "shorten", shorten_poses, way.curve, poses)
            if cost > way.cost * (1 + 1e-6):
                raise AssertionError(f"A way costs {cost}, that of the lattice {way.cost}.")
            if steering.is_car:
                options = {"samples": SAMPLES, "deadline_at": math.inf, "seed": 1, "cost_to_go": way.to_go}
                curve, found = taken(seconds, "ompl", refine_poses_with_ompl, poses, curve, **options)
                by_ompl += found["cost"] < 0.999 * cost
                cost = found["cost"]
            above.append(cost / holonomic)
            gain.append(way.cost / cost)
            timed, _ = taken(seconds, "motion", drive, curve, poses, LIMITS)
            stops += int(np.count_nonzero(np.hypot(timed.speed, timed.turn_rate)[1:-1] < 1e-9))
        out.append(
            {
                "robot": name,
                "found": f"{len(above)} of {len(ends)}",
                "lattice p50 / p95 [ms]": ms(seconds["lattice"]),
                "shorten": ms(seconds["shorten"]),
                f"OMPL, {SAMPLES} samples": ms(seconds["ompl"]) if steering.is_car else "–",
                "motion": ms(seconds["motion"]),
                "above holonomic p50 / largest": percent(above),
                "lattice above final": percent(gain),
                "OMPL gains 0.1 %": by_ompl if steering.is_car else "–",
                "stops per way": f"{stops / max(len(above), 1):.1f}",
            }
        )
    return out
