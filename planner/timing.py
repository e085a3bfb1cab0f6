"""Motion in time along a path: stop at every corner of a polyline, or the fastest along a smooth curve."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.errors import InvalidProblem
from planner.result import Trajectory

#: Samples of a trajectory lie at most this far apart, s, unless that makes more than ``MAX_SAMPLES``.
SAMPLE_S = 0.05
MAX_SAMPLES = 6000
#: Points nearer than this are one, m.
COINCIDENT_M = 1e-9
#: Corners that turn less than this are driven through, rad: a jump of the velocity by less than 1e-6 of it.
STRAIGHT_RAD = 1e-6


def time_polyline(points: npt.ArrayLike, *, max_speed: float, max_accel: float) -> Trajectory:
    """Fastest motion along a polyline: straight at full acceleration, at rest at both ends and every corner.

    A point that moves along a polyline under a bound of its acceleration has to stop where the direction
    changes, so this is the shortest time for exactly this path. Every stretch between two stops of length L
    has a trapezoidal profile, or a triangular one where ``L < max_speed² / max_accel``.

    Parameters
    ----------
    points
        Shape (K, 2), W, m, K ≥ 1; points that coincide count once.
    max_speed, max_accel
        Limits, m/s and m/s².

    Returns
    -------
    trajectory
        Exact at its samples, which hold every stop and every change of phase; a sample where the
        acceleration jumps has the value that holds after it (the last sample: before it). One sample
        when all points coincide.

    Raises
    ------
    InvalidProblem
        If the points are not finite or not of this shape, or a limit is not positive.
    """
    p = distinct_points(points)
    require_limits(max_speed, max_accel)
    if len(p) == 1:
        return at_rest(p[0])
    stops = p[_stop_indices(p)]
    lengths = np.hypot(*np.diff(stops, axis=0).T)
    total = float(np.sum([trapezoid_time(length, max_speed, max_accel) for length in lengths]))
    dt = sample_spacing(total)
    pieces = []
    clock = 0.0
    for a, b, length in zip(stops[:-1], stops[1:], lengths, strict=True):
        direction = ((b - a) / length)[None, :]
        t, s, v, acc = trapezoid(float(length), max_speed, max_accel, dt)
        table = np.column_stack(
            [clock + t, a + s[:, None] * direction, v[:, None] * direction, acc[:, None] * direction]
        )
        # The stop itself is the first sample of the next stretch.
        pieces.append(table[:-1])
        clock += float(t[-1])
    table[-1, 1:3] = stops[-1]
    samples = np.concatenate([*pieces, table[-1:]])
    return Trajectory(samples[:, 0], samples[:, 1:3], samples[:, 3:5], samples[:, 5:7])


def at_rest(point: FloatArray) -> Trajectory:
    """The trajectory that stays where it is: one sample."""
    zero = np.zeros((1, 2))
    return Trajectory(np.zeros(1), point.reshape(1, 2), zero, zero)


def sample_spacing(duration: float) -> float:
    """Time between samples of a trajectory of this duration, s."""
    return max(SAMPLE_S, duration / MAX_SAMPLES)


def distinct_points(points: npt.ArrayLike) -> FloatArray:
    """Points (K, 2) without those that coincide with the one before; the last one always stays.

    Raises
    ------
    InvalidProblem
        If there is none, a coordinate is not finite, or the shape is wrong.
    """
    p = np.array(points, dtype=np.float64, order="C")
    if p.ndim != 2 or p.shape[1] != 2 or len(p) == 0:
        raise InvalidProblem(f"A path has shape {p.shape}; give at least one point, (K, 2).")
    if not np.isfinite(p).all():
        raise InvalidProblem("A point of the path has a coordinate that is not finite.")
    kept = [p[0]]
    for q in p[1:]:
        if math.hypot(q[0] - kept[-1][0], q[1] - kept[-1][1]) > COINCIDENT_M:
            kept.append(q)
    if len(kept) > 1:
        kept[-1] = p[-1]
    return np.array(kept)


def require_limits(max_speed: float, max_accel: float) -> None:
    """Refuse limits that no motion can keep.

    Raises
    ------
    InvalidProblem
        If one is not positive and finite.
    """
    for name, value, unit in (("max_speed", max_speed, "m/s"), ("max_accel", max_accel, "m/s²")):
        if not (math.isfinite(value) and value > 0):
            raise InvalidProblem(f"The {name} is {value} {unit}; it must be positive and finite.")


def _stop_indices(p: FloatArray) -> list[int]:
    d = np.diff(p, axis=0)
    cross = d[:-1, 0] * d[1:, 1] - d[:-1, 1] * d[1:, 0]
    dot = (d[:-1] * d[1:]).sum(axis=1)
    turns = np.abs(np.arctan2(cross, dot)) > STRAIGHT_RAD
    return [0, *(1 + np.flatnonzero(turns)), len(p) - 1]


def _phases(length: float, max_speed: float, max_accel: float) -> tuple[float, float]:
    # Seconds of acceleration (as long as braking) and of constant speed.
    if length * max_accel <= max_speed * max_speed:
        return math.sqrt(length / max_accel), 0.0
    return max_speed / max_accel, length / max_speed - max_speed / max_accel


def trapezoid_time(length: float, max_speed: float, max_accel: float) -> float:
    """Least time from rest to rest over a length, s."""
    ramp, cruise = _phases(length, max_speed, max_accel)
    return 2.0 * ramp + cruise


def trapezoid(
    length: float, max_speed: float, max_accel: float, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Time, way, speed and acceleration, each (K,), of the fastest motion from rest to rest over a length."""
    ramp, cruise = _phases(length, max_speed, max_accel)
    up = np.linspace(0.0, ramp, math.ceil(ramp / dt) + 1)
    flat = np.linspace(0.0, cruise, math.ceil(cruise / dt) + 1)[:-1]
    rise = 0.5 * max_accel * up**2
    speed = max_accel * ramp
    t = np.concatenate([up[:-1], ramp + flat, 2.0 * ramp + cruise - up[::-1]])
    s = np.concatenate([rise[:-1], rise[-1] + speed * flat, length - rise[::-1]])
    v = np.concatenate([max_accel * up[:-1], np.full(len(flat), speed), max_accel * up[::-1]])
    n_up, n_flat = len(up) - 1, len(flat)
    a = np.concatenate([np.full(n_up, max_accel), np.zeros(n_flat), np.full(len(up), -max_accel)])
    return t, s, v, a
