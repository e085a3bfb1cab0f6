"""Closed-loop runs of a 60 m trajectory, for several robots; beside them one run in plain Python."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from localization.field_builder import build_field
from localization.sensors import LASER, MAS97_CAMERA
from maps.clearance import ClearanceIndex
from maps.io.site import bundled_site
from maps.visibility import visible_landmarks
from planner.choices import choices_of
from planner.reference import reference_of
from planner.simulation import SimulatedRobot, _draws, fix_stations, simulate
from planner.timing import time_polyline
from tests import oracles

TITLE = "Simulation: closed-loop runs of a trajectory of 60 m in the warehouse"
RUNS = 1000
WAY = [[1.0, 9.2], [57.0, 9.2], [57.0, 13.2]]
SHAPE = np.array([[0.4, 0.25], [-0.4, 0.25], [-0.4, -0.25], [0.4, -0.25]])


def run() -> list[dict[str, object]]:
    world = bundled_site("warehouse")
    trajectory = time_polyline(WAY, max_speed=1.2, max_accel=0.8)
    field = build_field(world, LASER, resolution=0.1)
    start = np.diag([0.02, 0.02, 0.01]) ** 2
    camera = replace(MAS97_CAMERA, max_range=30.0)
    cases = {
        "laser, filter": (LASER, SimulatedRobot(start_covariance=start)),
        "laser, single fixes at 20 Hz": (
            LASER,
            SimulatedRobot(start_covariance=start, mode="fix", fix_rate=20.0),
        ),
        "laser, holonomic": (LASER, SimulatedRobot(start_covariance=start, steering="holonomic")),
        "laser, polygon": (LASER, SimulatedRobot(start_covariance=start, footprint=SHAPE)),
        "camera on a pan head": (camera, SimulatedRobot(start_covariance=start, view_margin=0.03)),
    }
    rows: list[dict[str, object]] = []
    for name, (sensor, robot) in cases.items():
        own = field if sensor is LASER else None

        def drive(runs: int, threads: int | None = None, robot=robot, sensor=sensor, own=own):
            rng = np.random.default_rng(0)
            return simulate(
                world, sensor, trajectory, robot=robot, runs=runs, rng=rng, field=own, threads=threads
            )

        drive(2)  # compiled
        began, cpu = time.perf_counter(), time.process_time()
        report = drive(RUNS)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
        rows.append(
            {
                "robot": name,
                "steps": len(report.reference),
                f"{RUNS} runs, wall [s]": f"{wall:.2f}",
                "processor time [s]": f"{cpu:.2f}",
                "per run [ms]": f"{1e3 * cpu / RUNS:.2f}",
                "collisions": report.collisions,
                "inside own 95 % ellipse": f"{100 * report.coverage.share:.1f} %",
                "NEES": f"{report.nees.value:.2f}",
            }
        )
    rows.append(_plain(world, trajectory, start))
    return rows


def _plain(world, trajectory, start) -> dict[str, object]:
    """One run of the first robot by the tests' twin."""
    robot = SimulatedRobot(start_covariance=start)
    reference = reference_of(trajectory, step=robot.step, max_turn_rate=0.8)
    is_fix = fix_stations(reference.times, robot.fix_rate)
    choices = choices_of(world, LASER, reference=reference, is_fix=is_fix, policy="best_triplet")
    draw = np.random.default_rng(0).standard_normal(_draws(reference, is_fix, world))
    walls = ClearanceIndex.from_world(world).segments
    cpu = time.process_time()
    oracles.driven_once(
        draw, reference.poses, is_fix, lambda k, _: list(choices.planned[k]), world, LASER, robot, start,
        lambda place, i: bool(visible_landmarks(world, [place], max_range=30.0)[0, i]), walls,
    )  # fmt: skip
    cpu = time.process_time() - cpu
    blank = dict.fromkeys(("collisions", "inside own 95 % ellipse", "NEES"), "")
    return {
        "robot": "laser, filter: one run in plain Python",
        "steps": len(reference),
        f"{RUNS} runs, wall [s]": "",
        "processor time [s]": f"{cpu:.2f}",
        "per run [ms]": f"{1e3 * cpu:.0f}",
        **blank,
    }
