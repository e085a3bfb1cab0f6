"""PlanResult: what a planner answers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from maps.arrays import BoolArray, FloatArray, IntArray, frozen


class PlanStatus(Enum):
    """Outcome of a plan."""

    EXACT = "exact"  #: bounds met; optimal on the planning grid, then improved
    APPROXIMATE = "approximate"  #: bounds met; not proven
    RISK_UNMET = "risk_unmet"  #: no path keeps the bounds; the best effort is returned
    TIMEOUT = "timeout"  #: deadline hit; the best so far, if any, is returned
    NO_PATH = "no_path"  #: proven: start and goal are not connected for this robot


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A polyline with everything that is known at its waypoints; recomputed from the path itself.

    Attributes
    ----------
    points
        Shape (N, 2): (x, y) in W, m.
    s
        Shape (N,): arc length from the start, m.
    heading
        Shape (N,): direction of travel, rad in [-π, π).
    covariance
        Shape (N, 3): xx, xy, yy, m²; NaN where blind, unless dead reckoning is told.
    r95
        Shape (N,): m; as the covariance.
    triplet
        Shape (N, 3), int16: landmark indices, -1 where blind.
    pan
        Shape (N,): optical axis relative to the direction of travel (for a field that depends on the heading:
        to the heading that it was computed for), rad; NaN where blind or without a pan head.
    clearance
        Shape (N,): distance from the robot's centre to the nearest obstacle, minus its radius, m.
    collision_probability, collision_bound
        Shape (N,): probability of touching something by the error of one fix: bound that knows the error's
        direction, and the coarser ``exp(-c² / (2 λ_max))`` (:mod:`planner.risk`); both hold. NaN where blind.
    kind
        Whose the covariance is: ``fix``, of one fix; ``fused``, of the filter's belief, which is never blind.
    has_fix
        Shape (N,): whether there is a fix; elsewhere a covariance is of dead reckoning since the last one.
        None: where r95 is finite.
    """

    points: FloatArray
    s: FloatArray
    heading: FloatArray
    covariance: FloatArray
    r95: FloatArray
    triplet: IntArray
    pan: FloatArray
    clearance: FloatArray
    collision_probability: FloatArray
    collision_bound: FloatArray
    kind: str = "fix"
    has_fix: BoolArray | None = None

    def __post_init__(self) -> None:
        known = np.isfinite(self.r95) if self.has_fix is None else self.has_fix
        object.__setattr__(self, "has_fix", frozen(known, np.bool_))
        for name in ("points", "s", "heading", "covariance", "r95", "pan", "clearance"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("collision_probability", "collision_bound"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "triplet", frozen(self.triplet, np.int16))


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path in time, on a fine grid.

    Attributes
    ----------
    t
        Shape (K,): s, ascending from 0.
    points
        Shape (K, 2): (x, y) in W, m.
    velocity
        Shape (K, 2): m/s.
    acceleration
        Shape (K, 2): m/s².
    heading
        Shape (K,): of the robot, rad in [-π, π); None where it plays no part.
    """

    t: FloatArray
    points: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    heading: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("t", "points", "velocity", "acceleration"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.heading is not None:
            object.__setattr__(self, "heading", frozen(self.heading))

    @property
    def duration(self) -> float:
        """Seconds from start to goal."""
        return float(self.t[-1])


@dataclass(frozen=True, slots=True)
class RouteSummary:
    """Figures of one route; lengths in m, areas in m², times in s.

    ``cost`` is the objective's integral along the path, bounds left aside; inf where it drives without a fix
    and the question has no ``blind_r95``. Means are per metre driven over the part with a
    fix; ``blind`` is the length without one, ``longest_blind`` that of the longest stretch without one;
    ``worst_at`` the arc length where r95 is largest.
    ``mean_r95`` and the other figures of uncertainty are None when the whole route is blind. The collision
    figures are the largest of the waypoints with a fix.
    """

    cost: float
    length: float
    duration: float
    mean_r95: float | None
    max_r95: float | None
    max_area95: float | None
    max_ellipse95: float | None
    worst_at: float | None
    blind: float
    min_clearance: float
    max_collision_probability: float | None = None
    max_collision_bound: float | None = None
    longest_blind: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """One way to go: waypoints, motion in time, figures."""

    path: Path
    trajectory: Trajectory
    summary: RouteSummary


@dataclass(frozen=True, slots=True)
class Unmet:
    """A bound that the returned route does not keep.

    Attributes
    ----------
    bound
        Name of the constraint: ``max_r95_m``, ``max_ellipse95_m``, ``max_collision_probability``, ``blind``.
    limit, value
        What was asked and what the route has (m, or a probability); for ``blind`` 0 and the length without a
        fix.
    place
        (x, y) in W, m, of the worst point; for ``blind`` of the first without a fix.
    smallest_possible
        The smallest bound for which a path exists; None if none does.
    message
        The same in words.
    """

    bound: str
    limit: float
    value: float
    place: tuple[float, float]
    smallest_possible: float | None
    message: str


@dataclass(frozen=True, slots=True)
class Blockage:
    """What keeps a robot from the goal: the narrowest place of the widest way.

    Attributes
    ----------
    place
        (x, y) in W, m: midway between its sides; where every way is closed, where that is thinnest.
    radius
        What the robot needs on both sides, m: its radius, or that of the largest disc in its outline.
    largest_radius
        No disc that is larger passes, m; 0 where every way is closed.
    between
        What is on its two sides: 0 a wall, or the number, from 1, of an area to avoid.
    areas
        Numbers of the areas to avoid that block the way; empty when none does.
    radius_without_areas
        The same as ``largest_radius`` without these areas, m; None without areas, or when it is not known.
    """

    place: tuple[float, float]
    radius: float
    largest_radius: float
    between: tuple[int, int]
    areas: tuple[int, ...] = ()
    radius_without_areas: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult:
    """Answer to a :class:`~planner.problem.PlanningProblem`.

    Attributes
    ----------
    status
        Outcome.
    route
        The best route found; None if there is none.
    shortest
        The shortest route for the same robot, whatever its uncertainty; None if there is none.
    grid_cost
        Cost of the optimal 8-connected grid path under the same objective and constraints (or the smallest
        possible bound), of the search over beliefs where that found it; None without one, where it is not
        known to be optimal, or where it has to go without a fix though that is forbidden.
    planner
        Which stages shaped the route, e.g. ``grid_search+ompl+casadi``.
    unmet, warnings
        What was not reached, and what the caller should know.
    blocked
        Where there is no path: what blocks the way, if it is known.
    """

    status: PlanStatus
    route: Route | None
    shortest: Route | None
    grid_cost: float | None
    planner: str
    unmet: tuple[Unmet, ...] = ()
    warnings: tuple[str, ...] = ()
    stats: dict[str, float] = field(default_factory=dict)
    blocked: Blockage | None = None

    @property
    def gap(self) -> float | None:
        """By how much the route costs more than ``grid_cost``, as a share; below 0 it costs less.

        The optimal grid path turns by 45° only: a route that is smoothed well is cheaper. None without both.
        """
        if self.route is None or self.grid_cost is None or not self.grid_cost > 0.0:
            return None
        gap = self.route.summary.cost / self.grid_cost - 1.0
        return gap if math.isfinite(gap) else None
