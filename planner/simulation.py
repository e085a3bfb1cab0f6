"""Closed-loop simulation: many runs of a planned trajectory with odometry, bearings, filter and follower.

Every run starts where the robot is only known with some covariance. At each step a follower steers on what
the robot believes, odometry reports the step, and the truth is off by the odometry's noise. At each fix the
robot looks at the landmarks of its choice; if one of the three is not in sight of where it truly is, there is
no fix. Surveyed landmarks stand off their mapped places by one error per run. A run ends at a collision.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from localization.heading_field import HeadingField
from localization.motion import OdometryModel
from localization.propagation import fix_stations
from localization.sensors import Sensor, kernel_args
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.clearance import ClearanceIndex
from maps.sight import scene_args
from maps.world import World
from planner.choices import (
    Choices,
    Policy,
    checked_start,
    choices_of,
    planned_schedule,
    predicted_covariances,
    start_covariance,
)
from planner.errors import InvalidProblem
from planner.kernels import follower as follow
from planner.kernels import simulation as kernel
from planner.reference import Reference, Steering, reference_of
from planner.result import Trajectory
from planner.simulation_report import SimulationReport, report_of

MAX_RUNS = 100_000
DEFAULT_ODOMETRY = OdometryModel()
#: Stations along the path and runs whose tracks are kept, at most.
MAX_STATIONS = 120
MAX_TRACKS = 60
# Normals of the runs that one task holds at once, bytes.
_TASK_BYTES = 16 * 2**20
_MAX_TASK_RUNS = 64
# Corners are planned at this share of the turn rate, the rest is for corrections; likewise for speed.
_TURN_SHARE = 0.8
_SPEED_RESERVE = 1.25


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRobot:
    """How the simulated robot is built and driven.

    Attributes
    ----------
    radius
        Of its disc, m; ignored with a footprint.
    footprint
        Shape (K, 2): corners of a simple polygon in B, m; None for the disc.
    odometry
        Noise of its motion; the filter knows it.
    fix_rate
        Fixes per second, at most one per step.
    mode
        What the follower steers on: ``filter``, an EKF of odometry and bearings; ``fix``, the last fix alone,
        carried on by odometry.
    policy
        How landmarks are chosen, see :data:`planner.choices.Policy`.
    view_margin
        Of the choice, see :func:`planner.choices.choices_of`, rad.
    steering
        ``differential``: drives along its heading, backwards where the trajectory says so, and turns on the
        spot where the path has corners; ``holonomic``: drives in any direction, with the trajectory's
        headings or that of the first leg.
    min_turn_radius
        Of a differential steering that is a car's, m: it turns no sharper, corrections included. 0: none.
        A plan of larger arcs leaves room for corrections.
    start_covariance
        Shape (3, 3) of x, y, heading; None: that of a fix at the start.
    step
        Time between two commands, s.
    max_turn_rate
        rad/s.
    follow_length, follow_time
        Distance, m, and time, s, in which the follower takes back deviations across and along the path.

    Raises
    ------
    InvalidProblem
        If a number makes no sense.
    """

    radius: float = 0.35
    footprint: FloatArray | None = None
    odometry: OdometryModel = DEFAULT_ODOMETRY
    fix_rate: float = 5.0
    mode: Literal["filter", "fix"] = "filter"
    policy: Policy = "best_triplet"
    view_margin: float = 0.0
    steering: Steering = "differential"
    start_covariance: FloatArray | None = None
    step: float = 0.05
    max_turn_rate: float = 1.0
    min_turn_radius: float = 0.0
    follow_length: float = 0.5
    follow_time: float = 0.5

    def __post_init__(self) -> None:
        for name, known in (("mode", ("filter", "fix")), ("steering", ("differential", "holonomic"))):
            if getattr(self, name) not in known:
                raise InvalidProblem(f"The {name} is '{getattr(self, name)}'; use {' or '.join(known)}.")
        for name in ("fix_rate", "step", "max_turn_rate", "follow_length", "follow_time"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InvalidProblem(f"The {name} is {value}; it must be positive and finite.")
        for name, words in (("radius", "radius"), ("min_turn_radius", "smallest turning radius")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InvalidProblem(f"The {words} is {value} m; it must be ≥ 0 and finite.")
        if self.footprint is not None:
            corners = frozen(self.footprint)
            if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3:
                raise InvalidProblem(f"The footprint has shape {corners.shape}; give (K, 2), K ≥ 3.")
            if not np.isfinite(corners).all():
                raise InvalidProblem("The footprint has a coordinate that is not finite.")
            object.__setattr__(self, "footprint", corners)
        if self.start_covariance is not None:
            object.__setattr__(self, "start_covariance", frozen(checked_start(self.start_covariance)))

    @property
    def reach(self) -> float:
        """Largest distance of a part of the robot from its centre, m."""
        if self.footprint is None:
            return self.radius
        return float(np.hypot(*self.footprint.T).max())


def simulate(
    world: World,
    sensor: Sensor,
    trajectory: Trajectory,
    *,
    robot: SimulatedRobot,
    runs: int = 1000,
    rng: np.random.Generator,
    field: UncertaintyField | HeadingField | None = None,
    threads: int | None = None,
    stop: npt.NDArray[np.uint8] | None = None,
) -> SimulationReport:
    """Drive a trajectory many times.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    trajectory
        The motion as planned; a differential drive takes longer by its turns on the spot.
    robot
        How it drives and what it knows.
    runs
        1 to 100,000.
    rng
        Source of all noise; the same state gives the same report.
    field
        Where the robot looks up the best triplet of the cell that it believes to be in; None: the best
        triplet of the place where it should be.
    threads
        Default: one per core. The result does not depend on it.
    stop
        Shape (1,): another thread sets it to end early; the report is then of the first runs alone.

    Returns
    -------
    report
        Collisions by exact clearance of the true place, between steps as well; deviations, errors against
        predicted ellipses.

    Raises
    ------
    InvalidProblem
        If the question makes no sense.
    """
    if not 1 <= runs <= MAX_RUNS:
        raise InvalidProblem(f"The number of runs is {runs}; it must be from 1 to {MAX_RUNS}.")
    world.require_triangulation()
    reference = reference_of(
        trajectory,
        step=robot.step,
        steering=robot.steering,
        max_turn_rate=_TURN_SHARE * robot.max_turn_rate,
    )
    is_fix = fix_stations(reference.times, robot.fix_rate)
    choices = choices_of(
        world,
        sensor,
        reference=reference,
        is_fix=is_fix,
        policy=robot.policy,
        view_margin=robot.view_margin,
        field=field,
    )
    P0 = robot.start_covariance
    if P0 is None:
        P0 = start_covariance(world, sensor, reference.poses[0])
    predicted = predicted_covariances(
        planned_schedule(world, choices, reference),
        reference,
        np.array(P0),
        odometry=robot.odometry,
        steering=robot.steering,
        single_fixes=robot.mode == "fix",
    )
    stops = _stops(reference)
    args = _kernel_args(world, choices, reference, is_fix=is_fix, stops=stops, robot=robot, P0=np.array(P0))
    seeds = rng.integers(0, 2**63, size=runs)
    out = _drive(args, _draws(reference, is_fix, world), len(stops), seeds=seeds, threads=threads, stop=stop)
    P = predicted[stops]
    return report_of(reference, stops, np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], axis=-1), *out)


def _stops(reference: Reference) -> IntArray:
    """Steps of the stations: even along the way, first and last pose included."""
    ways = np.linspace(0.0, float(reference.s[-1]), MAX_STATIONS)
    steps = np.searchsorted(reference.s, ways - 1e-9)
    return np.unique(np.concatenate([steps, [len(reference) - 1]]))


def _draws(reference: Reference, is_fix: BoolArray, world: World) -> int:
    """Normals per run."""
    survey = bool((world.landmarks.sigma > 0).any())
    return int(kernel.draws_per_run(len(reference) - 1, int(is_fix.sum()), len(world.landmarks), survey))


def _kernel_args(
    world: World,
    choices: Choices,
    reference: Reference,
    *,
    is_fix: BoolArray,
    stops: IntArray,
    robot: SimulatedRobot,
    P0: FloatArray,
) -> tuple[object, ...]:
    """What the kernel takes between draws and outputs."""
    distances, turns = reference.increments(robot.steering)
    station = np.full(len(reference), -1, dtype=np.int64)
    station[stops] = np.arange(len(stops))
    follower = np.zeros(follow.N_FOLLOWER)
    follower[[follow.LENGTH, follow.TIME, follow.STEP]] = robot.follow_length, robot.follow_time, robot.step
    follower[follow.MAX_DISTANCE] = _SPEED_RESERVE * float(np.abs(distances).max())
    follower[follow.MAX_TURN] = robot.max_turn_rate * robot.step
    follower[follow.HOLONOMIC] = robot.steering == "holonomic"
    follower[follow.SINGLE_FIXES] = robot.mode == "fix"
    follower[follow.REACH] = robot.reach
    follower[follow.MIN_RADIUS] = robot.min_turn_radius
    sensor = choices.sensor
    survey = world.landmarks.sigma**2
    # Fresh writable arrays: read-only ones would compile the kernels a second time.
    return (
        np.array(reference.poses),
        distances,
        turns,
        is_fix,
        station,
        np.linalg.cholesky(P0),
        P0,
        follower,
        robot.odometry.kernel_args,
        np.empty((0, 2)) if robot.footprint is None else np.array(robot.footprint),
        sensor.mount.as_array(),
        kernel_args(sensor),
        np.array(world.landmarks.positions),
        survey,
        bool((survey > 0).any()),
        choices.table,
        choices.offsets,
        np.array(choices.triplets, dtype=np.int16),
        scene_args(world, min_range=sensor.min_range, max_range=sensor.max_range),
        tuple(np.array(a) for a in ClearanceIndex.from_world(world).arrays),
    )


def _drive(
    args: tuple[object, ...],
    draws: int,
    stations: int,
    *,
    seeds: IntArray,
    threads: int | None,
    stop: npt.NDArray[np.uint8] | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the kernel writes per run, per station and as tracks; one stream of normals per run."""
    runs = len(seeds)
    steps = len(args[0])  # type: ignore[arg-type]
    per_run = np.empty((runs, kernel.N_RUN))
    per_station = np.empty((runs, stations, kernel.N_STATION), dtype=np.float32)
    tracks = np.empty((min(runs, MAX_TRACKS), steps, 4))
    size = max(1, min(_MAX_TASK_RUNS, _TASK_BYTES // (8 * draws)))

    def task(first: int) -> int:
        """Drive some runs; returns how many."""
        if first > 0 and stop is not None and stop[0] != 0:
            return 0
        part = slice(first, min(first + size, runs))
        normals = np.empty((part.stop - part.start, draws))
        for row, seed in zip(normals, seeds[part].tolist(), strict=True):
            np.random.default_rng(seed).standard_normal(out=row)
        kernel.drive_runs(normals, *args, per_run[part], per_station[part], tracks[part])
        return len(normals)

    with ThreadPoolExecutor(max_workers=threads or os.cpu_count() or 1) as pool:
        driven = list(pool.map(task, range(0, runs, size)))
    # What was driven after a part that was left out is not the first of anything.
    done = sum(driven[: driven.index(0)]) if 0 in driven else runs
    return per_run[:done], np.asarray(per_station[:done]), tracks[:done]
