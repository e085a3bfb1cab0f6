"""Motions of a robot that faces its way: a planned motion timed anew, with turns in place at its stops."""

from __future__ import annotations

import itertools
import math

import numpy as np

from maps.arrays import FloatArray
from planner.cost_space import CostSpace
from planner.curve import check_curve, curve_through
from planner.pose_timing import MotionLimits, PoseTrajectory, time_smooth_curve
from planner.result import Trajectory

# Slower than this the robot rests, m/s.
_REST = 1e-6
# Samples closer than this are one place, m; closer than that they say nothing about the direction.
_SAME_M = 1e-9
_SPACING_M = 0.05
# The curve through samples of a smooth motion leaves that motion by less than this, m.
_PLAY_M = 1e-5


def faced(
    trajectory: Trajectory,
    space: CostSpace,
    limits: MotionLimits,
    *,
    start_heading: float | None = None,
    goal_heading: float | None = None,
) -> PoseTrajectory | None:
    """The motion of a robot that turns in place and faces its way, along a motion that knows no heading.

    Where the motion rests, at its ends and at corners, the robot turns; elsewhere it keeps the limits of its
    turn rate and of the rate's change by driving slower.

    Parameters
    ----------
    trajectory
        Valid in ``space``.
    space
        What is allowed.
    limits
        What the new motion keeps.
    start_heading, goal_heading
        Before and after, rad; None: that of the way.

    Returns
    -------
    motion
        None where the smooth curve through the motion's places is not valid.
    """
    parts = _parts(trajectory)
    if not parts:
        heading = goal_heading if goal_heading is not None else (start_heading or 0.0)
        pose = np.array([[*np.asarray(trajectory.points)[0], heading]])
        zero = np.zeros(1)
        return PoseTrajectory(zero, pose, zero, zero, zero, zero)
    curves = [curve_through(points) for points in parts]
    checks = [check_curve(curve, space) for curve in curves]
    if not all(math.isfinite(check.cost) and check.worst <= _PLAY_M for check in checks):
        return None
    first = [math.atan2(*(curve.points[1] - curve.points[0])[::-1]) for curve in curves]
    out = []
    for k, curve in enumerate(curves):
        begin = start_heading if k == 0 else None
        end = goal_heading if k == len(curves) - 1 else first[k + 1]
        out.append(time_smooth_curve(curve, limits, start_heading=begin, goal_heading=end))
    return _joined(out)


def _parts(trajectory: Trajectory) -> list[FloatArray]:
    """Places (N, 2) of the stretches between rests, at least 5 cm apart; N ≥ 2."""
    points = np.asarray(trajectory.points)
    speed = np.hypot(*np.asarray(trajectory.velocity).T)
    rests = np.flatnonzero(speed <= _REST)
    cuts = sorted({0, len(points) - 1, *rests.tolist()})
    out = []
    for a, b in itertools.pairwise(cuts):
        part = points[a : b + 1]
        steps = np.hypot(*np.diff(part, axis=0).T)
        arc = np.concatenate([[0.0], np.cumsum(steps)])
        if arc[-1] <= _SAME_M:
            continue
        keep = [0]
        for i in range(1, len(part)):
            if arc[i] - arc[keep[-1]] >= _SPACING_M:
                keep.append(i)
        if keep[-1] != len(part) - 1:
            # The end itself rather than a sample just before it.
            if len(keep) > 1 and arc[-1] - arc[keep[-1]] < 0.5 * _SPACING_M:
                keep.pop()
            keep.append(len(part) - 1)
        out.append(part[keep])
    return out


def _joined(parts: list[PoseTrajectory]) -> PoseTrajectory:
    """One motion after the other."""
    names = ("poses", "speed", "acceleration", "turn_rate", "turn_acceleration")
    times, began = [], 0.0
    for k, part in enumerate(parts):
        times.append(np.asarray(part.t)[1 if k else 0 :] + began)
        began += part.duration
    columns = {
        name: np.concatenate([np.asarray(getattr(p, name))[1 if k else 0 :] for k, p in enumerate(parts)])
        for name in names
    }
    return PoseTrajectory(np.concatenate(times), **columns)
