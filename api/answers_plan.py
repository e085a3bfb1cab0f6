"""Bodies of answers about plans, for the OpenAPI document."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.answers import Place
from api.answers_base import Answer
from api.answers_schedule import ScheduleFigures, Stretch


class Uncertainty(Answer):
    """Uncertainty along a route; null where the whole route is blind."""

    mean_r95_m: float | None
    max_r95_m: float | None
    max_area95_m2: float | None
    max_ellipse95_m: float | None
    blind_m: float = Field(description="Metres without a fix, in all.")
    longest_blind_m: float = Field(description="The longest stretch without a fix.")
    worst_at_m: float | None = Field(description="Arc length of the worst place.")


class Risk(Answer):
    """Largest collision probability of the waypoints; null where the whole route is blind."""

    max_collision_probability: float | None = Field(description="Bound that knows the error's direction.")
    max_collision_bound: float | None = Field(description="Coarser: exp(-c² / (2 λ_max)), c the clearance.")


class Waypoint(Answer):
    """A place of the path with all that planning counts on there; null where blind.

    Where the field is not valid the covariance is larger than the field's, or there is none.
    """

    x_m: float
    y_m: float
    theta_rad: float | None
    s_m: float | None
    t_s: float | None
    covariance: list[float] | None
    covariance_of: str | None = Field(
        description="fix: one fix here; fused: the filter, with a fix here; dead_reckoning: the last fix (or "
        "the belief at the start) and odometry since, told with max_blind_distance_m and for fused."
    )
    r95_m: float | None
    sigma_max_m: float | None
    ellipse95: dict[str, float] | None
    triplet: list[str] | None = Field(description="null where blind, and on fields of all_visible.")
    pan_rad: float | None
    clearance_m: float | None
    collision_probability: float | None = Field(description="Of this pose, by one fix; an upper bound.")


class Motion(Answer):
    """A moment of the trajectory."""

    t_s: float
    x_m: float
    y_m: float
    vx_m_s: float
    vy_m_s: float
    ax_m_s2: float
    ay_m_s2: float
    theta_rad: float | None = Field(description="Heading of the robot; null where it plays no part.")


class Baseline(Answer):
    """A route to compare with: where it runs and what it costs."""

    covariance: str = Field(description="fix: of one fix at each place; fused: of the filter along it.")
    cost: float | None
    length_m: float | None
    duration_s: float | None
    min_clearance_m: float | None
    uncertainty: Uncertainty
    risk: Risk
    path: list[Waypoint]


class FrontPlace(Answer):
    """Where a route stands on its front, and how to ask for it alone."""

    against: str = Field(description="worst or mean.")
    r95_m: float | None = Field(description="Worst or mean r95; stretches without a fix as blind_r95_m.")
    max_r95_m: float | None = Field(
        description="Bound under which a shortest path is this one; null: without a bound, or against mean."
    )
    uncertainty_weight_per_m: float | None = Field(
        description="Weight under which the cheapest path is this one; null against worst."
    )


class Route(Baseline):
    """One way to go, in time."""

    trajectory: list[Motion]
    share: float | None = Field(
        description="Part of its length within the robot's width of the routes before it; null where no "
        "alternatives were asked for."
    )
    front: FrontPlace | None = Field(description="null where no front was asked for.")
    schedule: list[Stretch] | None = Field(
        description="In order, without gaps; null where it was not asked for, or time was short."
    )
    schedule_figures: ScheduleFigures | None = Field(
        description="null without a schedule. The route's own uncertainty is that of the best triplet "
        "everywhere, as if a pan head turned at once."
    )


class Unmet(Answer):
    """A bound that the returned route does not keep."""

    bound: str
    limit: float | None = Field(description="What was asked: m, or a probability.")
    value: float | None = Field(description="What the route has.")
    place: Place
    smallest_possible: float | None = Field(description="The smallest bound that has a path.")
    message: str


class Blocked(Answer):
    """What keeps the robot from the goal: where the widest way between start and goal is narrowest."""

    place: Place = Field(
        description="Midway between both sides; where every way is closed, where that is thinnest."
    )
    radius_m: float = Field(description="What the robot needs on both sides; of an outline: at least.")
    largest_radius_m: float | None = Field(description="No larger disc passes; 0: every way is closed.")
    between: list[str] = Field(
        description="What is on the two sides: wall, or avoid/ and the index of an area to avoid."
    )
    avoid: list[int] = Field(description="Indices of the areas to avoid that block the way.")
    largest_radius_without_avoid_m: float | None = Field(
        description="The same without these areas; null without any, or where it is not known."
    )


class Plan(Answer):
    """Answer to a planning question."""

    plan: str = Field(description="Id: p_ and a hash of this answer.")
    status: str = Field(
        description="exact, approximate, risk_unmet, timeout or no_path: outcomes, not errors."
    )
    map: str
    field: str
    planner: str
    engine: str
    client_ref: str | None
    request: dict[str, Any] = Field(description="The question, every default filled in.")
    routes: list[Route] = Field(description="The best first, then alternatives by cost; a front by length.")
    shortest_baseline: Baseline | None = Field(description="Shortest route of the robot, to compare with.")
    grid_cost: float | None = Field(
        description="Of the optimal path on the grid (8 directions) for the same question, by its objective; "
        "null where none was proven."
    )
    gap: float | None = Field(
        description="Cost of the first route over grid_cost, minus 1; below 0 where smoothing made it "
        "cheaper than any path on the grid. null where grid_cost is, or the route has no cost."
    )
    unmet: list[Unmet]
    blocked: Blocked | None = Field(description="Where there is no path and it is known; else null.")
    warnings: list[str]
