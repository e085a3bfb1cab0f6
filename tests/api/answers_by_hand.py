"""A plan made by hand, for tests of what surrounds planning."""

from __future__ import annotations

import numpy as np

from planner.result import Path, PlanResult, PlanStatus, Route, RouteSummary, Trajectory, Unmet


def straight_route(start, goal, *, blind: bool = False, all_visible: bool = False) -> Route:
    """Three waypoints on a line, one metre per second."""
    points = np.linspace(start, goal, 3)
    length = float(np.hypot(*(points[-1] - points[0])))
    path = Path(
        points=points,
        s=np.linspace(0.0, length, 3),
        heading=np.zeros(3),
        covariance=np.full((3, 3), np.nan) if blind else np.tile([0.01, 0.002, 0.02], (3, 1)),
        r95=np.full(3, np.nan if blind else 0.3),
        triplet=np.full((3, 3), -1) if blind or all_visible else np.tile([0, 1, 2], (3, 1)),
        pan=np.full(3, np.nan),
        clearance=np.array([0.3, 0.4, 0.2]),
        collision_probability=np.full(3, np.nan if blind else 1e-4),
        collision_bound=np.full(3, np.nan if blind else 1e-3),
    )
    still = np.zeros((3, 2))
    trajectory = Trajectory(t=np.linspace(0.0, length, 3), points=points, velocity=still, acceleration=still)
    figures = [None] * 5 if blind else [0.3, 0.3, 0.28, 0.4, length / 2]
    return Route(
        path, trajectory, RouteSummary(1.2 * length, length, length, *figures, length if blind else 0.0, 0.2)
    )


def plan_by_hand(start, goal, *, blind: bool = False, all_visible: bool = False) -> PlanResult:
    """A result that misses a bound and has something to say."""
    route = straight_route(start, goal, blind=blind, all_visible=all_visible)
    unmet = Unmet("max_r95_m", 0.1, 0.3, tuple(route.path.points[1]), None, "too uncertain")
    return PlanResult(
        PlanStatus.RISK_UNMET, route, route, 2.6, "grid_search", (unmet,), ("note",), {"seconds": 1.0}
    )
