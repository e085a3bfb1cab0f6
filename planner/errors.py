"""Errors of the planner: mistakes in the question. Outcomes are :class:`planner.result.PlanStatus`.

::

    SurepathError
    └── PlannerError
        ├── InvalidProblem       a number that makes no sense
        ├── StartOutsideMap, GoalOutsideMap, ViaOutsideMap
        └── StartOccupied, GoalOccupied, ViaOccupied    in an obstacle, or too close for the robot's radius
"""

from __future__ import annotations

from maps.errors import SurepathError


class PlannerError(SurepathError):
    """A planning question is wrong.

    Attributes
    ----------
    nearest_free
        Closest place (x, y) in W, m, where the robot fits; None where there is none.
    """

    def __init__(self, message: str, *, nearest_free: tuple[float, float] | None = None) -> None:
        super().__init__(message)
        self.nearest_free = nearest_free


class InvalidProblem(PlannerError):
    """A number in the question is impossible."""


class StartOutsideMap(PlannerError):
    """The start is not on the map."""


class GoalOutsideMap(PlannerError):
    """The goal is not on the map."""


class StartOccupied(PlannerError):
    """The robot does not fit at the start."""


class GoalOccupied(PlannerError):
    """The robot does not fit at the goal."""


class ViaOutsideMap(PlannerError):
    """A via point is not on the map."""


class ViaOccupied(PlannerError):
    """The robot does not fit at a via point."""
