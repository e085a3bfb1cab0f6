"""When to look where: the triplet of every stretch of a trajectory, and what it costs to be late."""

from __future__ import annotations

import math

import numpy as np

from localization import covariance as cov
from localization.ranking import LandmarkStatus, landmark_statuses
from localization.sensors import MAS97_CAMERA, PinholePanSensor, Sensor, kernel_args
from localization.tiles import compute_tile
from localization.triplets import pack_masks
from maps.arrays import BoolArray, FloatArray, IntArray
from maps.se2 import wrap
from maps.visibility import visible_landmarks
from maps.world import World
from planner.errors import InvalidProblem
from planner.example_context import example_context
from planner.kernels.landmark_schedule import best_by_direction, fixes_along, fixes_off_axis, follow, schedule
from planner.landmark_plan import LandmarkPlan
from planner.result import Trajectory
from planner.stretches import Candidates, stretches_of
from planner.timing import time_polyline

#: Stations along the path, m.
SPACING_M = 0.2
#: What a switch must gain, m².
SWITCH_COST = 0.05
#: What stands for r95 without a fix, m.
BLIND_R95 = 1.0
# Candidates beyond this many (those that are best least often) are left out.
_MAX_CANDIDATES = 600
# A head that takes its time to turn has a choice in each of these sectors of its angle, among the landmarks
# nearest by.
_N_SECTORS = 12
_MAX_NEAR = 24
# No fix counts at least as much as this many times the best one.
_POOREST = 2.0


def schedule_landmarks(
    world: World,
    sensor: Sensor,
    trajectory: Trajectory,
    *,
    switch_cost: float = SWITCH_COST,
    pan_rate: float = math.inf,
    blind_r95: float = BLIND_R95,
) -> LandmarkPlan:
    """Choose the triplet of every stretch of a trajectory: :func:`choose` among :func:`candidates_along`.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    trajectory
        The motion; without headings the robot looks where it drives.
    pan_rate
        Of the pan head, rad/s; inf: it turns at once. Other sensors have none.
    switch_cost, blind_r95
        As of :func:`choose`.

    Raises
    ------
    InvalidProblem
        If a number is impossible.
    """
    for name, value in (("switch_cost", switch_cost), ("blind_r95", blind_r95)):
        if not (math.isfinite(value) and value >= 0):
            raise InvalidProblem(f"The {name} is {value}; it must be finite and at least 0.")
    if not pan_rate > 0:
        raise InvalidProblem(f"The pan_rate is {pan_rate} rad/s; it must be positive (infinity: at once).")
    candidates = candidates_along(world, sensor, trajectory, pan_rate=pan_rate)
    return choose(candidates, switch_cost=switch_cost, blind_r95=blind_r95)


def candidates_along(
    world: World, sensor: Sensor, trajectory: Trajectory, *, pan_rate: float = math.inf
) -> Candidates:
    """All triplets that are best at some station of a trajectory, with their fixes and pan angles.

    For a pan head that takes its time: also those that are best in a twelfth of its angles.
    A head that follows a triplet no faster than ``pan_rate`` may look beside its middle, as long as all three
    are in view; the fix is the one from there.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    trajectory
        The motion; without headings the robot looks where it drives.
    pan_rate
        Of the pan head, rad/s; inf: it turns at once.
    """
    s, t, poses = stations_of(trajectory)
    offsets = np.array([sensor.mount.offset(h) for h in poses[:, 2]])
    seen = _seen(world, sensor, poses, offsets)
    best_ones = _best_triplets(world, sensor, poses, seen)
    positions, survey = world.landmarks.positions, world.landmarks.sigma**2
    args = kernel_args(sensor, 0.0)
    rate = float(pan_rate) if isinstance(sensor, PinholePanSensor) else math.inf
    if math.isfinite(rate):
        near = np.empty((len(s), _N_SECTORS, 3), dtype=np.int64)
        best_by_direction(poses, offsets, args, positions, survey, seen, _MAX_NEAR, near)
        best_ones = np.concatenate([best_ones, near.reshape(-1, 3)])
    triplets = _most_frequent(best_ones)
    n, m = len(s), len(triplets)
    covariance, own, slack = np.full((n, m, 3), np.nan), np.full((n, m), np.nan), np.full((n, m, 2), np.nan)
    fixes_along(poses, offsets, args, positions, survey, seen, triplets, covariance, own, slack)
    best = np.min(
        np.where(np.isfinite(covariance[..., 0]), cov.r95(covariance), np.inf), axis=1, initial=np.inf
    )
    best[np.isinf(best)] = np.nan
    is_endless = not isinstance(sensor, PinholePanSensor) or sensor.has_free_pan
    pan = own.copy()
    if math.isfinite(rate):
        follow(own, slack, is_endless, t, rate, pan)
        fixes_off_axis(poses, offsets, args, positions, survey, triplets, own, pan, covariance)
    return Candidates(s, t, triplets, cov.r95(covariance), best, pan, rate, is_endless)


def choose(
    candidates: Candidates,
    *,
    switch_cost: float = SWITCH_COST,
    blind_r95: float = BLIND_R95,
) -> LandmarkPlan:
    """The schedule that minimises ``∫ r95 ds`` plus ``switch_cost`` per switch (hysteresis).

    Shortest path over the looks (station, triplet), stations 0.2 m apart: exact for the candidates. The pan
    head follows a triplet that is looked at; from one to another it turns as fast as it can, and there is no
    fix meanwhile. Through a stretch without a fix it keeps its angle or turns to the next one: that costs
    nothing as far as it fits. Before the start it is turned to the first.

    Parameters
    ----------
    candidates
        What may be looked at where.
    switch_cost
        What a switch must gain at least, as r95 times way, m².
    blind_r95
        What stands for r95 without a fix, m; where the best fix has more than half of it, twice that. A fix
        counts as no more, however poor.
    """
    s, t, r95, pan = candidates.s, candidates.t, candidates.r95, candidates.pan
    n, rate = len(s), candidates.pan_rate
    best, borders = candidates.best_r95, candidates.borders
    # A fix must be worth more than none, also where even the best is poor.
    blind = np.where(np.isfinite(best), np.maximum(blind_r95, _POOREST * best), blind_r95)
    cost = np.where(np.isfinite(r95), np.minimum(r95, blind[:, None]), np.inf)
    halves = np.column_stack([s - borders[:-1], borders[1:] - s])
    station, chosen = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    count, _ = schedule(
        cost, blind, pan, candidates.is_endless, halves, t, candidates.time_at(borders), switch_cost, rate,
        station, chosen,
    )  # fmt: skip
    looks = list(zip(station[:count].tolist(), chosen[:count].tolist(), strict=True))
    looked = np.full(n, np.nan)
    looked[station[:count]] = r95[station[:count], chosen[:count]]
    return LandmarkPlan(stretches_of(candidates, looks), s, t, looked, best, rate)


def stations_of(trajectory: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Arc lengths (K,), times (K,) and poses (K, 3) of stations at most 0.2 m apart along a trajectory."""
    points = np.asarray(trajectory.points)
    steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.empty(0)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(2, math.ceil(arc[-1] / SPACING_M) + 1) if arc[-1] > 0 else 1
    s = np.linspace(0.0, arc[-1], count)
    moving = np.concatenate([[True], steps > 0])
    at, places, times = arc[moving], points[moving], np.asarray(trajectory.t)[moving]
    x, y = np.interp(s, at, places[:, 0]), np.interp(s, at, places[:, 1])
    if trajectory.heading is not None:
        heading = np.interp(s, at, np.unwrap(np.asarray(trajectory.heading))[moving])
    else:
        heading = np.arctan2(np.gradient(y), np.gradient(x)) if count > 1 else np.zeros(1)
    return s, np.interp(s, at, times), np.column_stack([x, y, np.asarray(wrap(heading))])


def _seen(world: World, sensor: Sensor, poses: FloatArray, offsets: FloatArray) -> BoolArray:
    """Shape (K, N): landmarks that can be measured at each station."""
    at = poses[:, :2] + offsets
    seen = visible_landmarks(world, at, min_range=sensor.min_range, max_range=sensor.max_range)
    if not sensor.depends_on_heading or isinstance(sensor, PinholePanSensor):
        return seen
    for k, place in enumerate(at):
        statuses = landmark_statuses(world, sensor, place, float(poses[k, 2]))
        seen[k] = [status is LandmarkStatus.MEASURABLE for status in statuses]
    return seen


def _best_triplets(world: World, sensor: Sensor, poses: FloatArray, seen: BoolArray) -> IntArray:
    """Shape (K, 3): the best triplet at each station, -1 for none."""
    masks = pack_masks(seen)[:, None, :]
    free = np.ones((len(poses), 1), dtype=np.bool_)
    centres = np.ascontiguousarray(poses[:, None, :2])
    best = np.full((len(poses), 3), -1, dtype=np.int64)
    if sensor.depends_on_heading:
        for k in range(len(poses)):
            one = slice(k, k + 1)
            heading = float(poses[k, 2])
            tile = compute_tile(world, sensor, centres[one], free[one], masks[one], heading=heading)
            best[k] = tile.triplet[0, 0]
    else:
        best[:] = compute_tile(world, sensor, centres, free, masks).triplet[:, 0]
    return best


def _most_frequent(triplets: IntArray) -> IntArray:
    """The different ones (C, 3) among triplets (N, 3), most frequent first."""
    found, counts = np.unique(triplets[triplets[:, 0] >= 0], axis=0, return_counts=True)
    order = np.argsort(-counts, kind="stable")[:_MAX_CANDIDATES]
    return np.ascontiguousarray(found[order]).reshape(-1, 3)


def warm_up() -> None:
    """Compile or load what schedules need, by small ones in a made-up room."""
    world = example_context().field.world
    line = time_polyline(np.array([[1.0, 1.0], [5.0, 1.0]]), max_speed=1.0, max_accel=1.0)
    for pan_rate in (1.0, math.inf):
        schedule_landmarks(world, MAS97_CAMERA, line, pan_rate=pan_rate)
