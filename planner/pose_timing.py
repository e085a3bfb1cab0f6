"""Motion in time along ways of arcs, lines and turns in place, under limits of driving and of turning."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.arrays import FloatArray, frozen
from maps.se2 import wrap
from planner.curve import Curve, motion_on_curve
from planner.errors import InvalidProblem
from planner.kernels import pose_timing as kernel
from planner.kernels.timing import motion_at, station_times
from planner.ramps import Rows, rows_of, with_ramps
from planner.result import Trajectory
from planner.steering import PoseCurve, PoseSpace
from planner.timing import SAMPLE_S, require_limits, sample_spacing, trapezoid, trapezoid_time

# Stations lie at most this far apart, m.
_STATION_M = 0.02
_MOST_STATIONS = 20_000
# Planned this share below the limits of speed of turning and of acceleration, which bulge between stations.
_MARGIN = 2e-3
# Turns in place smaller than this take no time, rad.
_SAME_RAD = 1e-7
# Ramps are laid out for these shares of the speed that arcs allow.
_RAMP_SPEEDS = (1.0, 0.75, 0.5)


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What a motion keeps.

    Attributes
    ----------
    max_speed, max_accel
        m/s; m/s², of the length of the acceleration vector.
    max_turn_rate, max_turn_accel
        rad/s and rad/s²; inf: no limit, then turns in place take no time.

    Raises
    ------
    InvalidProblem
        If one is not positive, or one of the first two is not finite.
    """

    max_speed: float
    max_accel: float
    max_turn_rate: float = math.inf
    max_turn_accel: float = math.inf

    def __post_init__(self) -> None:
        require_limits(self.max_speed, self.max_accel)
        for name, unit in (("max_turn_rate", "rad/s"), ("max_turn_accel", "rad/s²")):
            value = getattr(self, name)
            if not value > 0:
                raise InvalidProblem(f"The {name} is {value} {unit}; it must be positive.")


@dataclass(frozen=True, slots=True, eq=False)
class PoseTrajectory:
    """A way in time, on a fine grid.

    Attributes
    ----------
    t
        Shape (K,): s, ascending from 0.
    poses
        Shape (K, 3): x, y, θ in W, m and rad in [-π, π).
    speed
        Shape (K,): along the heading, m/s; negative backwards.
    acceleration
        Shape (K,): its rate, m/s².
    turn_rate, turn_acceleration
        Shape (K,): of the heading, rad/s and rad/s².

    Where accelerations jump, samples have the values after it (the last: before it).
    """

    t: FloatArray
    poses: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    turn_rate: FloatArray
    turn_acceleration: FloatArray

    def __post_init__(self) -> None:
        for name in ("t", "poses", "speed", "acceleration", "turn_rate", "turn_acceleration"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def duration(self) -> float:
        """Seconds from start to goal."""
        return float(self.t[-1])

    def to_trajectory(self) -> Trajectory:
        """The motion of the robot's centre, and its heading."""
        along = np.column_stack([np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])])
        across = np.column_stack([-along[:, 1], along[:, 0]])
        velocity = self.speed[:, None] * along
        turning = (self.speed * self.turn_rate)[:, None] * across
        acceleration = self.acceleration[:, None] * along + turning
        return Trajectory(self.t, self.poses[:, :2], velocity, acceleration, self.poses[:, 2])


def time_poses(curve: PoseCurve, limits: MotionLimits, *, ramps: FloatArray | None = None) -> PoseTrajectory:
    """Fastest motion along a way from rest to rest.

    The robot stops to change gear and to turn in place. Where the curvature jumps, the angular acceleration
    of a robot that moves would be infinite: with a finite ``max_turn_accel`` it stops there too, unless the
    curvature changes gradually: see :func:`planner.ramps.with_ramps`.

    Parameters
    ----------
    curve
        The way.
    limits
        What it keeps, everywhere: also between samples.
    ramps
        Shape (N, 4): the same way with gradual changes of curvature, from :func:`planner.ramps.with_ramps`.

    Notes
    -----
    [BDG85] with limits of the angular acceleration at both ends of every interval.
    """
    runs = rows_of(curve, ramps, stop_at_jumps=math.isfinite(limits.max_turn_accel))
    return _joined(curve.start, [_timed(run, limits) for run in runs])


def drive(
    curve: PoseCurve, space: PoseSpace, limits: MotionLimits
) -> tuple[PoseTrajectory, FloatArray | None]:
    """The fastest motion found along a way: stopping where the curvature jumps, or with ramps there.

    Parameters
    ----------
    curve
        A valid way.
    space
        What is allowed.
    limits
        What the motion keeps.

    Returns
    -------
    trajectory, ramps
        And the rows of the ramped way, see :func:`planner.ramps.with_ramps`; None where it is
        the way itself.
    """
    best, chosen = time_poses(curve, limits), None
    largest = curve.max_curvature
    if largest == 0.0 or math.isinf(limits.max_turn_accel):
        return best, chosen
    top = min(limits.max_speed, limits.max_turn_rate / largest, math.sqrt(limits.max_accel / largest))
    for share in _RAMP_SPEEDS:
        ramps = with_ramps(curve, space, speed=share * top, max_turn_accel=limits.max_turn_accel)
        if ramps is None:
            continue
        found = time_poses(curve, limits, ramps=ramps)
        if found.duration < best.duration:
            best, chosen = found, ramps
    return best, chosen


def time_smooth_curve(
    curve: Curve,
    limits: MotionLimits,
    *,
    start_heading: float | None = None,
    goal_heading: float | None = None,
) -> PoseTrajectory:
    """Fastest motion along a smooth curve of a robot that faces its way, after a turn in place to it.

    Parameters
    ----------
    curve
        From :func:`planner.curve.curve_through`.
    limits
        What it keeps.
    start_heading, goal_heading
        Before and after, rad; None: that of the curve.
    """
    steps = np.diff(curve.s)
    b = np.empty(len(curve.s))
    _profile(np.column_stack([curve.kappa[:-1], curve.kappa[1:]]), steps, limits, b)
    times = np.empty(len(b))
    station_times(b, steps, times)
    total = float(times[-1])
    t = np.linspace(0.0, total, math.ceil(total / sample_spacing(total)) + 1)
    s, v, a = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
    motion_at(t, times, b, steps, curve.s, s, v, a)
    v[-1], s[-1] = 0.0, curve.s[-1]
    points, heading, kappa, twist = motion_on_curve(curve, s)
    rate = kappa * v
    table = np.column_stack([t, points, np.unwrap(heading), v, a, rate, twist * v**2 + kappa * a])
    table = _stretched(table, limits)
    first, last = float(heading[0]), float(heading[-1])
    runs = [table]
    if start_heading is not None:
        runs.insert(
            0, _turn(np.array([*points[0], start_heading]), float(wrap(first - start_heading)), limits)
        )
    if goal_heading is not None:
        runs.append(_turn(np.array([*points[-1], last]), float(wrap(goal_heading - last)), limits))
    return _joined(runs[0][0, 1:4], runs)


def _timed(run: Rows, limits: MotionLimits) -> FloatArray:
    # Time, pose, speed, acceleration, turn rate and acceleration of one run from rest to rest.
    if run.turn != 0.0:
        return _turn(run.start, run.turn, limits)
    ways = np.abs(run.rows[:, 0])
    step = max(_STATION_M, float(ways.sum()) / _MOST_STATIONS)
    counts = np.maximum(np.ceil(ways / step - 1e-9), 4).astype(np.int64)
    table = np.empty((int(counts.sum()) + 1, 6))
    kernel.stations(run.start, run.rows, counts, table)
    steps = np.diff(table[:, 3])
    b = np.empty(len(table))
    _profile(table[:-1, 4:6], steps, limits, b)
    times = np.empty(len(b))
    station_times(b, steps, times)
    total = float(times[-1])
    t = np.linspace(0.0, total, math.ceil(total / sample_spacing(total)) + 1)
    s, v, a = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
    motion_at(t, times, b, steps, table[:, 3], s, v, a)
    v[-1], s[-1] = 0.0, table[-1, 3]
    gear = float(np.sign(run.rows[0, 0]))
    poses = np.empty((len(t), 4))
    kernel.poses_at(s, gear, table, poses)
    kappa = poses[:, 3]
    which = np.clip(np.searchsorted(table[:, 3], s, side="right") - 1, 0, len(steps) - 1)
    twist = (table[which, 5] - table[which, 4]) / steps[which]
    # κ is over the signed way: backwards the heading turns the other way.
    rate = gear * v * kappa
    turning = gear * (twist * v**2 + kappa * a)
    return np.column_stack([t, poses[:, :3], gear * v, gear * a, rate, turning])


def _profile(kappa: FloatArray, steps: FloatArray, limits: MotionLimits, out: FloatArray) -> None:
    share = 1.0 - _MARGIN
    kernel.turning_profile(
        np.ascontiguousarray(kappa),
        steps,
        limits.max_speed,
        share * limits.max_accel,
        share * limits.max_turn_rate,
        share * limits.max_turn_accel,
        out,
    )


def _stretched(table: FloatArray, limits: MotionLimits) -> FloatArray:
    # Slower by what the spline bulges between its stations, so that limits hold for samples and between them.
    t, _, _, theta, v, a, rate, turning = table.T
    if len(t) < 2:
        return table
    dt = np.diff(t)
    moved = np.hypot(*np.diff(table[:, 1:3], axis=0).T) / dt
    over = [
        max(v.max(), moved.max()) / limits.max_speed,
        max(np.abs(rate).max(), np.abs(np.diff(theta) / dt).max()) / limits.max_turn_rate,
        math.sqrt(max(np.hypot(a, v * rate).max(), np.abs(np.diff(v) / dt).max()) / limits.max_accel),
        math.sqrt(max(np.abs(turning).max(), np.abs(np.diff(rate) / dt).max()) / limits.max_turn_accel),
    ]
    factor = max(1.0, *over) * (1.0 + 1e-12)
    return np.asarray(table / np.array([1.0 / factor, 1, 1, 1, factor, factor**2, factor, factor**2]))


def _turn(pose: FloatArray, angle: float, limits: MotionLimits) -> FloatArray:
    # A turn in place from rest to rest: a trapezoid of the turn rate.
    rate, accel = limits.max_turn_rate, limits.max_turn_accel
    if abs(angle) < _SAME_RAD or (math.isinf(rate) and math.isinf(accel)):
        return np.array([[0.0, pose[0], pose[1], pose[2] + angle, 0.0, 0.0, 0.0, 0.0]])
    if math.isinf(accel):
        n = math.ceil(abs(angle) / rate / SAMPLE_S) + 1
        s = np.linspace(0.0, abs(angle), n)
        t, v, a = s / rate, np.full(n, rate), np.zeros(n)
    else:
        dt = sample_spacing(trapezoid_time(abs(angle), rate, accel))
        t, s, v, a = trapezoid(abs(angle), rate, accel, dt)
    n = len(t)
    sign = math.copysign(1.0, angle)
    still = np.zeros((n, 2))
    places = np.broadcast_to(pose[:2], (n, 2))
    return np.column_stack([t, places, pose[2] + sign * s, still, sign * v, sign * a])


def _joined(start: FloatArray, runs: list[FloatArray]) -> PoseTrajectory:
    clock = 0.0
    columns: list[FloatArray] = []
    for run in runs:
        moved = run.copy()
        moved[:, 0] += clock
        clock = float(moved[-1, 0])
        # The stop between two runs is the first sample of the later one.
        if columns:
            columns[-1] = columns[-1][:-1]
        columns.append(moved)
    table = np.concatenate(columns) if columns else np.array([[0.0, *start, 0.0, 0.0, 0.0, 0.0]])
    return PoseTrajectory(table[:, 0], np.column_stack([table[:, 1:3], wrap(table[:, 3])]), *table[:, 4:].T)
