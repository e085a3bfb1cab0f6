"""When to look where: the triplet of every stretch of a trajectory, and what it costs to be late."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from localization import covariance as cov
from localization.ranking import LandmarkStatus, landmark_statuses
from localization.sensors import PinholePanSensor, Sensor, kernel_args
from localization.tiles import compute_tile
from localization.triplets import pack_masks
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.se2 import wrap
from maps.visibility import visible_landmarks
from maps.world import World
from planner.errors import InvalidProblem
from planner.kernels.landmark_schedule import fixes_along, schedule
from planner.result import Trajectory

#: Stations along the path, m.
SPACING_M = 0.2
# Candidates beyond this many (those that are best least often) are left out.
_MAX_CANDIDATES = 150
_ALONG = 0.5


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of the path on which one triplet is looked at.

    Attributes
    ----------
    start, end
        Arc lengths, m.
    t_start, t_end
        Times, s.
    triplet
        Indices into ``world.landmarks``; None: dead reckoning.
    pan_start, pan_end
        Where a pan head looks at both ends, relative to its zero, rad; None without one or a fix.
    mean_r95, max_r95
        Of single fixes along the stretch, m; None without a fix.
    turn_from
        Time at which the pan head must begin to turn to be there in time, s; None without one.
    usable_after
        How much further than ``end`` the triplet still gives a fix, m.
    late_r95
        Worst r95 if the switch at ``end`` comes half a metre late, m; None: no fix then, or no switch.
    """

    start: float
    end: float
    t_start: float
    t_end: float
    triplet: tuple[int, int, int] | None
    pan_start: float | None
    pan_end: float | None
    mean_r95: float | None
    max_r95: float | None
    turn_from: float | None
    usable_after: float
    late_r95: float | None


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkPlan:
    """The schedule of a trajectory.

    Attributes
    ----------
    stretches
        In order; they cover the path.
    s, t
        Shape (K,): stations, m and s.
    r95, best_r95
        Shape (K,): with the scheduled triplet and with the best at each station, m; NaN without a fix.
    """

    stretches: tuple[Stretch, ...]
    s: FloatArray
    t: FloatArray
    r95: FloatArray
    best_r95: FloatArray

    def __post_init__(self) -> None:
        for name in ("s", "t", "r95", "best_r95"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def n_switches(self) -> int:
        """How often the triplet changes."""
        return max(0, len(self.stretches) - 1)


def schedule_landmarks(
    world: World,
    sensor: Sensor,
    trajectory: Trajectory,
    *,
    switch_cost: float = 0.05,
    pan_rate: float = math.inf,
    blind_r95: float = 1.0,
) -> LandmarkPlan:
    """Choose the triplet of every stretch of a trajectory.

    The choice minimises ``∫ r95 ds`` plus ``switch_cost`` per switch (hysteresis), by dynamic programming
    over stations 0.2 m apart and all triplets that are best at some station: exact for these candidates.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    trajectory
        The motion; without headings the robot looks where it drives.
    switch_cost
        What a switch must gain at least, as r95 times way, m².
    pan_rate
        Of the pan head, rad/s; it turns without a fix where it cannot be there in time.
    blind_r95
        What stands for r95 without a fix, m.

    Raises
    ------
    InvalidProblem
        If a number is impossible.
    """
    for name, value, least in (("switch_cost", switch_cost, 0.0), ("blind_r95", blind_r95, 0.0)):
        if not (math.isfinite(value) and value >= least):
            raise InvalidProblem(f"The {name} is {value}; it must be finite and at least {least:g}.")
    if not pan_rate > 0:
        raise InvalidProblem(f"The pan_rate is {pan_rate} rad/s; it must be positive (infinity: at once).")
    s, t, poses = stations_of(trajectory)
    offsets = np.array([sensor.mount.offset(h) for h in poses[:, 2]])
    seen = _seen(world, sensor, poses, offsets)
    triplets = _candidates(world, sensor, poses, seen)
    n, m = len(s), len(triplets)
    covariance, sigma, pan = np.full((n, m, 3), np.nan), np.full((n, m), np.nan), np.full((n, m), np.nan)
    positions, survey = world.landmarks.positions, world.landmarks.sigma**2
    args = kernel_args(sensor, 0.0)
    fixes_along(poses, offsets, args, positions, survey, seen, triplets, covariance, sigma, pan)
    r95 = cov.r95(covariance)
    lengths = np.gradient(s) if n > 1 else np.zeros(1)
    seconds = np.diff(t, prepend=t[0])
    choice = np.empty(n, dtype=np.int64)
    cost = np.where(np.isfinite(r95), r95, np.inf)
    rate = pan_rate if isinstance(sensor, PinholePanSensor) else math.inf
    schedule(cost, pan, lengths, seconds, switch_cost, blind_r95, rate, choice)
    padded = np.concatenate([r95, np.full((n, 1), np.nan)], axis=1)
    chosen = padded[np.arange(n), choice]
    best = np.min(cost, axis=1, initial=np.inf)
    stretches = _stretches(s, t, choice, triplets, pan, padded, rate)
    return LandmarkPlan(stretches, s, t, chosen, np.where(np.isfinite(best), best, np.nan))


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


def _candidates(world: World, sensor: Sensor, poses: FloatArray, seen: BoolArray) -> IntArray:
    """Triplets (C, 3) that are best at some station, most frequent first."""
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
    found, counts = np.unique(best[best[:, 0] >= 0], axis=0, return_counts=True)
    order = np.argsort(-counts, kind="stable")[:_MAX_CANDIDATES]
    return np.ascontiguousarray(found[order]).reshape(-1, 3)


def _stretches(
    s: FloatArray,
    t: FloatArray,
    choice: IntArray,
    triplets: IntArray,
    pan: FloatArray,
    r95: FloatArray,
    pan_rate: float,
) -> tuple[Stretch, ...]:
    m = len(triplets)
    begins = np.concatenate([[0], np.flatnonzero(np.diff(choice)) + 1])
    ends = np.concatenate([begins[1:] - 1, [len(s) - 1]])
    out: list[Stretch] = []
    for number, (a, b) in enumerate(zip(begins.tolist(), ends.tolist(), strict=True)):
        c = int(choice[a])
        is_last = number == len(begins) - 1
        # A stretch ends half way to the next one's first station.
        start = 0.0 if a == 0 else 0.5 * float(s[a - 1] + s[a])
        end = float(s[-1]) if is_last else 0.5 * float(s[b] + s[b + 1])
        t_start = float(np.interp(start, s, t))
        t_end = float(np.interp(end, s, t))
        if c == m:
            out.append(Stretch(start, end, t_start, t_end, None, None, None, None, None, None, 0.0, None))
            continue
        values = r95[a : b + 1, c]
        ahead = r95[b + 1 :, c]
        lost = np.flatnonzero(~np.isfinite(ahead))
        reach = int(lost[0]) if len(lost) else len(ahead)
        late = r95[b + 1 : int(np.searchsorted(s, end + _ALONG, side="right")), c]
        p0, p1 = float(pan[a, c]), float(pan[b, c])
        turn_from = None
        if number > 0 and not math.isnan(p0):
            before = int(choice[a - 1])
            turn = abs(float(wrap(p0 - pan[a - 1, before]))) if before < m else math.nan
            turn_from = t_start - turn / pan_rate if math.isfinite(turn) else None
        out.append(
            Stretch(
                start,
                end,
                t_start,
                t_end,
                (int(triplets[c, 0]), int(triplets[c, 1]), int(triplets[c, 2])),
                None if math.isnan(p0) else p0,
                None if math.isnan(p1) else p1,
                float(values.mean()),
                float(values.max()),
                turn_from,
                max(0.0, float(s[b + reach]) - end) if reach else 0.0,
                None if is_last or len(late) == 0 or not np.isfinite(late).all() else float(late.max()),
            )
        )
    return tuple(out)
