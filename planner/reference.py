"""A trajectory as poses at even times: what a follower is to be at when, turns on the spot included."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from localization.motion import increments_between
from localization.schedule import Drive
from maps.arrays import FloatArray, frozen
from planner.errors import InvalidProblem
from planner.result import Trajectory
from planner.timing import COINCIDENT_M, STRAIGHT_RAD

Steering = Literal["differential", "holonomic"]
#: More steps than this are refused: nobody simulates a day.
MAX_STEPS = 200_000
# Slower than this the robot stands, m/s.
_STANDS = 1e-6
# Sine of the angle between motion and heading from which a robot moves sideways: half a right angle.
_SIDEWAYS = math.sin(math.pi / 4)


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Poses to be at, step by step.

    Attributes
    ----------
    step
        Time between two of them, s.
    poses
        Shape (K, 3): x, y (m), heading (rad) in W, at the times 0, step, 2 step, …
    s
        Shape (K,): way along the path, m.
    """

    step: float
    poses: FloatArray
    s: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "poses", frozen(self.poses))
        object.__setattr__(self, "s", frozen(self.s))

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def times(self) -> FloatArray:
        """Shape (K,): s."""
        return np.asarray(np.arange(len(self.poses)) * self.step, dtype=np.float64)

    @property
    def drive(self) -> Drive:
        """The same as stations of :mod:`localization.schedule`."""
        return Drive(self.poses, self.times)

    def increments(self, steering: Steering) -> tuple[FloatArray, FloatArray]:
        """Distances and turns, (K - 1,) each, from pose to pose: arcs, or straight for ``holonomic``."""
        distances, turns = increments_between(self.poses)
        if steering == "holonomic":
            distances = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        return np.array(distances), np.array(turns)


def reference_of(
    trajectory: Trajectory,
    *,
    step: float,
    steering: Steering = "differential",
    max_turn_rate: float = 1.0,
) -> Reference:
    """Poses along a trajectory at even times.

    A motion with headings is driven as it says, backwards too. One without: a differential drive looks where
    it drives, and where the trajectory stops and goes on in another direction, it turns on the spot, which
    takes time that the trajectory does not have; a holonomic robot keeps the heading of its first leg. Where
    it would turn faster than it can, time is stretched.

    Parameters
    ----------
    trajectory
        The motion; at least two samples at different places.
    step
        Time between poses, s.
    steering
        How the robot moves.
    max_turn_rate
        Of a differential drive, rad/s.

    Raises
    ------
    InvalidProblem
        If the trajectory does not move, jumps, is to move sideways with wheels that cannot, or takes more
        than :data:`MAX_STEPS` steps.
    """
    t, points, headings = _knots(trajectory)
    if trajectory.heading is not None:
        t, points, headings = np.array(trajectory.t), np.array(trajectory.points), _headings(trajectory)
        if steering == "differential":
            _refuse_sideways(trajectory)
    elif steering == "holonomic":
        headings = np.full(len(t), headings[0])
    durations = np.maximum(np.diff(t), np.abs(np.diff(headings)) / max_turn_rate)
    clock = np.concatenate([[0.0], np.cumsum(durations)])
    count = math.ceil(clock[-1] / step - 1e-9)
    if not count <= MAX_STEPS:
        raise InvalidProblem(
            f"The trajectory takes {clock[-1]:.0f} s, that is {count} steps of {step:g} s; "
            f"the limit is {MAX_STEPS}."
        )
    at = np.minimum(np.arange(count + 1) * step, clock[-1])
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    columns = [np.interp(at, clock, values) for values in (*points.T, headings, s)]
    columns[2] = columns[2] - 2 * math.pi * np.floor((columns[2] + math.pi) / (2 * math.pi))
    return Reference(step, np.column_stack(columns[:3]), columns[3])


def fitting_steering(trajectory: Trajectory) -> Steering:
    """How a robot has to move to follow: ``holonomic`` where it moves sideways, else ``differential``."""
    return "holonomic" if _sideways_at(trajectory) is not None else "differential"


def _sideways_at(trajectory: Trajectory) -> float | None:
    """First time at which more than :data:`_SIDEWAYS` of the motion is across the heading, s."""
    if trajectory.heading is None:
        return None
    d, heading = np.diff(trajectory.points, axis=0), np.unwrap(trajectory.heading)
    middle, way = 0.5 * (heading[1:] + heading[:-1]), np.hypot(*d.T)
    across = np.abs(d[:, 1] * np.cos(middle) - d[:, 0] * np.sin(middle))
    found = np.flatnonzero((way > COINCIDENT_M) & (across > _SIDEWAYS * way))
    return float(trajectory.t[found[0]]) if len(found) else None


def _refuse_sideways(trajectory: Trajectory) -> None:
    if (at := _sideways_at(trajectory)) is not None:
        raise InvalidProblem(
            f"The trajectory moves sideways at {at:.1f} s, which a differential drive cannot; "
            "use steering holonomic."
        )


def _headings(trajectory: Trajectory) -> FloatArray:
    """Its own headings, unwrapped."""
    heading = np.array(trajectory.heading, dtype=np.float64)
    if heading.shape != np.shape(trajectory.t) or not np.isfinite(heading).all():
        raise InvalidProblem("The trajectory has a heading that is not finite, or not one per sample.")
    return np.asarray(np.unwrap(heading))


def _knots(trajectory: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, places and unwrapped headings; two knots at one time where the robot turns on the spot."""
    t, p, v = (
        np.asarray(a, dtype=np.float64) for a in (trajectory.t, trajectory.points, trajectory.velocity)
    )
    if not all(np.isfinite(a).all() for a in (t, p, v)) or (np.diff(t) < 0).any():
        raise InvalidProblem("The trajectory has a number that is not finite, or times that do not ascend.")
    d = np.diff(p, axis=0)
    moves = np.hypot(*d.T) > COINCIDENT_M if len(d) else np.zeros(0, dtype=np.bool_)
    if not moves.any():
        raise InvalidProblem("The trajectory stays where it is; there is nothing to drive.")
    # Where nothing moves the direction is that of the leg before, at the start that of the first leg.
    leg = np.maximum.accumulate(np.where(moves, np.arange(len(d)), -1))
    leg[leg < 0] = np.flatnonzero(moves)[0]
    along = np.arctan2(d[leg, 1], d[leg, 0])
    fast = np.hypot(*v.T) > _STANDS
    driven = np.arctan2(v[:, 1], v[:, 0])
    before = np.where(fast, driven, np.concatenate([along[:1], along]))
    after = np.where(fast, driven, np.concatenate([along, along[-1:]]))
    corner = np.abs(np.sin(0.5 * (after - before))) > 0.5 * STRAIGHT_RAD
    index = np.repeat(np.arange(len(t)), np.where(corner, 2, 1))
    second = np.concatenate([[False], np.diff(index) == 0])
    headings = np.unwrap(np.where(second, after[index], before[index]))
    return t[index], p[index], headings
