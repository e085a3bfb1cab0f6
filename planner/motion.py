"""From a polyline to a motion: smooth as a whole, or in parts with a stop between them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maps.arrays import FloatArray
from planner import smoothing
from planner.any_angle import with_fewer_corners
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
        Asked once, when the robot has to stop on the way: another path, taken if that is faster.
    """
    limits = _Limits(cost_space, max_speed, max_accel, deadline_at)
    best = limits.smooth(points, cost_limit)
    if _stops(best.trajectory) and time.monotonic() < deadline_at:
        other = other_way()
        if other is not None and cost_space.line_cost(other) <= cost_limit:
            second = limits.smooth(other, cost_limit)
            if second.trajectory.duration < best.trajectory.duration:
                points, best = other, second
    trajectory, is_smooth, reason = best.trajectory, best.ok and len(points) > 2, best.reason
    if not best.ok:
        points = with_fewer_corners(points, cost_space, cost_limit)
        trajectory, is_smooth = limits.in_parts(points, cost_limit)
    n_stops = _stops(trajectory)
    return Motion(trajectory, is_smooth, n_stops, reason if n_stops else "")


@dataclass(frozen=True, slots=True, eq=False)
class _Limits:
    """What a motion has to keep."""

    space: CostSpace
    max_speed: float
    max_accel: float
    deadline_at: float

    def smooth(self, points: FloatArray, cost_limit: float) -> smoothing.SmoothResult:
        """Smooth a path; ok only if its cost is indeed within the limit."""
        found = smoothing.smooth(
            points,
            self.space,
            max_speed=self.max_speed,
            max_accel=self.max_accel,
            cost_limit=cost_limit,
            deadline_at=self.deadline_at,
        )
        if found.ok and self.space.line_cost(found.trajectory.points) > cost_limit:
            return smoothing.SmoothResult(
                ok=False, trajectory=self.stopping(points), reason="it costs too much"
            )
        return found

    def stopping(self, points: FloatArray) -> Trajectory:
        """The polyline with stops at its corners."""
        return time_polyline(points, max_speed=self.max_speed, max_accel=self.max_accel)

    def in_parts(self, points: FloatArray, cost_limit: float) -> tuple[Trajectory, bool]:
        """Smooth the halves of a path, or their halves, and so on; and whether that helped anywhere."""
        spare = max(cost_limit - self.space.line_cost(points), 0.0)
        parts: list[Trajectory] = []
        is_smooth = False
        halves = _halves(points)
        waiting = [points] if halves is None else [*reversed(halves)]
        while waiting:
            part = waiting.pop()
            cost = self.space.line_cost(part)
            found = None
            if halves is not None and time.monotonic() < self.deadline_at:
                found = self.smooth(part, cost + spare)
            if found is not None and found.ok:
                spare -= max(self.space.line_cost(found.trajectory.points) - cost, 0.0)
                is_smooth = is_smooth or len(part) > 2
                parts.append(found.trajectory)
            elif found is None or (smaller := _halves(part)) is None:
                parts.append(self.stopping(part))
            else:
                waiting.extend(reversed(smaller))
        return _joined(parts), is_smooth


def _stops(trajectory: Trajectory) -> int:
    speed = np.hypot(*np.asarray(trajectory.velocity).T)
    return int(np.count_nonzero(speed[1:-1] == 0.0))


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
