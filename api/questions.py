"""What a plan may be asked for beside one route, and what comes back: routes with their marks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from planner.errors import InvalidProblem
from planner.result import PlanResult, Route

if TYPE_CHECKING:
    from planner.landmark_plan import LandmarkPlan

#: The planner's own limits; the service knows them without loading it.
MAX_ROUTES = 10
MAX_FRONT = 50
FRONT_COUNT = 8


@dataclass(frozen=True, slots=True)
class AlternativesAsked:
    """Up to ``count`` routes that differ; as of :func:`planner.alternatives.find_alternatives`."""

    count: int = 3
    max_cost_factor: float = 1.4
    max_share: float = 0.6


@dataclass(frozen=True, slots=True)
class FrontAsked:
    """Up to ``count`` routes of a front; as of :func:`planner.pareto.pareto_front`."""

    against: Literal["worst", "mean"] = "worst"
    count: int = FRONT_COUNT


@dataclass(frozen=True, slots=True)
class More:
    """What is asked for beside the route of a plan.

    Attributes
    ----------
    alternatives, front
        Several routes instead of one; not both.
    schedule
        Whether each route says which landmarks to look at where.
    pan_rate
        Of the pan head, rad/s, for the schedule; inf: it turns at once.

    Raises
    ------
    InvalidProblem
        If they do not go together.
    """

    alternatives: AlternativesAsked | None = None
    front: FrontAsked | None = None
    schedule: bool = False
    pan_rate: float = math.inf

    def __post_init__(self) -> None:
        if self.alternatives is not None and self.front is not None:
            raise InvalidProblem(
                "A front is several routes already; leave the alternatives out, or ask for another objective."
            )

    @property
    def most_routes(self) -> int:
        """How many routes there may be in the answer."""
        if self.front is not None:
            return self.front.count
        return 1 if self.alternatives is None else self.alternatives.count


NOTHING_MORE = More()


@dataclass(frozen=True, slots=True)
class FrontPlace:
    """Where a route stands on its front.

    Attributes
    ----------
    against
        ``worst`` or ``mean``.
    r95
        Worst or mean r95, m; stretches without a fix count as ``blind_r95``.
    setting
        Bound on r95, m, or weight, 1/m, for a plan of its own; None: without a bound.
    """

    against: Literal["worst", "mean"]
    r95: float
    setting: float | None


@dataclass(frozen=True, slots=True, eq=False)
class ListedRoute:
    """A route of an answer.

    Attributes
    ----------
    route
        The way and its figures.
    share
        Part of its length within the robot's width of the routes before it; None: no alternatives asked for.
    front
        Its place on the front; None: no front asked for.
    schedule
        When to look where; None: not asked for, or there was no time.
    """

    route: Route
    share: float | None = None
    front: FrontPlace | None = None
    schedule: LandmarkPlan | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a plan found: the result of its first route, and all routes."""

    result: PlanResult
    routes: tuple[ListedRoute, ...]

    @classmethod
    def of(cls, result: PlanResult) -> Found:
        """A result alone."""
        return cls(result, () if result.route is None else (ListedRoute(result.route),))
