"""From a polyline to a motion: smooth as a whole, or in parts with a stop between them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maps.arrays import FloatArray
from planner import smoothing
from planner.cost_space import CostSpace
from planner.result import Trajectory
from planner.timing import time_polyline

# Parts shorter than this, m, are not divided further: the robot stops at their corners.
_SHORTEST_PART_M = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Outcome of :func:`move_along`.

    Attributes
    ----------
    trajectory
        The motion.
    is_smooth
        Whether at least a part of it was smoothed.
    n_stops
        Places where the robot stops between start and goal.
    reason
        Why it stops there; empty when it does not.
    """

    trajectory: Trajectory
    is_smooth: bool
    n_stops: int
    reason: str


def move_along(
    points: FloatArray,
    cost_space: CostSpace,
    *,
    max_speed: float,
    max_accel: float,
    cost_limit: float,
    deadline_at: float,
    other_way: Callable[[], FloatArray | None] = lambda: None,
) -> Motion:
    """Smooth a path; where that is not possible, its halves, and so on, with stops between the parts.

    Parameters
    ----------
    points
        Shape (K, 2), W, m: a valid path.
    cost_space
        What is allowed, and at which cost.
    max_speed, max_accel
        Limits, m/s and m/s².
    cost_limit
        The whole may not cost more; at least the cost of the polyline.
    deadline_at
        ``time.monotonic()`` after which the rest keeps its corners, s.
    other_way
        Asked once, when the path cannot be smoothed as a whole: another path to smooth instead.
    """
    parts: list[Trajectory] = []
    spare = max(cost_limit - cost_space.line_cost(points), 0.0)
    waiting = [points]
    is_smooth = False
    reason = ""
    while waiting:
        part = waiting.pop()
        if len(part) > 2 and time.monotonic() >= deadline_at:
            reason = reason or "the deadline came first"
            parts.append(time_polyline(part, max_speed=max_speed, max_accel=max_accel))
            continue
        cost = cost_space.line_cost(part)
        smoothed = smoothing.smooth(
            part,
            cost_space,
            max_speed=max_speed,
            max_accel=max_accel,
            cost_limit=cost + spare,
            # What fails takes longest: leave time for its halves.
            deadline_at=0.5 * (time.monotonic() + deadline_at),
        )
        final = cost_space.line_cost(smoothed.trajectory.points)
        if smoothed.ok and final <= cost + spare:
            spare -= max(final - cost, 0.0)
            is_smooth = is_smooth or len(part) > 2
            parts.append(smoothed.trajectory)
            continue
        if not reason and time.monotonic() < deadline_at:
            reason = smoothed.reason
            other = other_way()
            if other is not None and cost_space.line_cost(other) <= cost_limit:
                spare = cost_limit - cost_space.line_cost(other)
                waiting = [other]
                continue
        reason = reason or smoothed.reason
        halves = _halves(part)
        if halves is None:
            parts.append(time_polyline(part, max_speed=max_speed, max_accel=max_accel))
        else:
            waiting.extend(reversed(halves))
    trajectory = _joined(parts)
    speed = np.hypot(*np.asarray(trajectory.velocity).T)
    n_stops = int(np.count_nonzero(speed[1:-1] == 0.0))
    return Motion(trajectory, is_smooth, n_stops, reason if n_stops else "")


def _halves(points: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    # Cut at the corner that is nearest to the middle.
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    if len(points) < 3 or arc[-1] < _SHORTEST_PART_M:
        return None
    k = 1 + int(np.argmin(np.abs(arc[1:-1] - 0.5 * arc[-1])))
    return points[: k + 1], points[k:]


def _joined(parts: list[Trajectory]) -> Trajectory:
    if len(parts) == 1:
        return parts[0]
    begins = np.concatenate([[0.0], np.cumsum([p.duration for p in parts])])
    last = len(parts) - 1
    columns = []
    for k, part in enumerate(parts):
        table = np.column_stack([begins[k] + part.t, part.points, part.velocity, part.acceleration])
        # The stop between two parts is the first sample of the later one.
        columns.append(table if k == last else table[:-1])
    table = np.concatenate(columns)
    return Trajectory(table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5:7])


def stops_in_words(motion: Motion, name: str) -> str | None:
    """What to tell about a motion that stops on its way; None when it does not."""
    if not motion.n_stops:
        return None
    places = "one place" if motion.n_stops == 1 else f"{motion.n_stops} places"
    return f"The {name} stops at {places} where it could not be smoothed ({motion.reason})."


def least_limit(cost: float, grid_cost: float | None) -> float:
    """What a smoothed path may cost: little more than the polyline, never more than the grid path."""
    limit = cost * (1.0 + smoothing.COST_SLACK)
    return max(cost, limit if grid_cost is None else min(limit, grid_cost))
