"""Travel: a robot and what its ways may cost, for questions about many places at once."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from shapely import Polygon

from maps.clearance import TOUCH_M
from planner.context import PlanningContext
from planner.cost_to_go import GridGraph, Place
from planner.problem import PlanningProblem, blind_rate_of


@dataclass(frozen=True, slots=True)
class Travel:
    """A holonomic disc, the cost of its ways, and bounds that they keep; as in a ``PlanningProblem``.

    Attributes
    ----------
    radius
        Of the robot's disc, m.
    weight
        Extra metres per metre driven at r95 = 1 m, 1/m; 0: costs are lengths.
    max_r95, max_ellipse95, max_collision_probability
        Bounds on every cell of a way, m, m, and of one pose; None: no bound.
    blind_r95
        Cells without a fix: None forbids them; a number lets ways cross them at the cost of this r95, m.
    avoid, areas
        Polygons not to enter, and polygons with factors of the cost per metre.
    max_speed, max_accel
        For durations, m/s and m/s².

    Raises
    ------
    InvalidProblem
        If a number is not finite or out of its range.
    """

    radius: float
    weight: float = 4.0
    max_r95: float | None = None
    max_ellipse95: float | None = None
    max_collision_probability: float | None = None
    blind_r95: float | None = None
    avoid: tuple[Polygon, ...] = ()
    areas: tuple[tuple[Polygon, float], ...] = ()
    max_speed: float = 1.2
    max_accel: float = 0.8

    def __post_init__(self) -> None:
        checked = self.problem((0.0, 0.0), (0.0, 0.0))
        object.__setattr__(self, "avoid", checked.avoid)
        object.__setattr__(self, "areas", checked.areas)

    def problem(self, start: Place, goal: Place) -> PlanningProblem:
        """The plan between two places for the same robot, costs and bounds."""
        return PlanningProblem(
            start,
            goal,
            self.radius,
            objective="weighted",
            weight=self.weight,
            max_r95=self.max_r95,
            blind_r95=self.blind_r95,
            max_ellipse95=self.max_ellipse95,
            max_collision_probability=self.max_collision_probability,
            avoid=self.avoid,
            areas=self.areas,
            max_speed=self.max_speed,
            max_accel=self.max_accel,
        )

    def graph(self, context: PlanningContext, *, by_length: bool = False) -> GridGraph:
        """Planning grid under all bounds; ``by_length``: costs are lengths, whatever weight and areas."""
        extras = self.problem((0.0, 0.0), (0.0, 0.0)).extras
        weight = 0.0 if by_length else self.weight
        return context.graph(
            radius=self.radius,
            weight=weight,
            max_r95=self.max_r95,
            blind_rate=blind_rate_of(weight, self.blind_r95, self.max_r95, self.max_ellipse95),
            extras=extras.without_areas() if by_length else extras,
        )


class PlaceStatus(Enum):
    """What became of a place in a question about many."""

    OK = "ok"  #: it was used
    OUTSIDE_MAP = "outside_map"  #: it is not on the map
    OCCUPIED = "occupied"  #: the robot does not fit there
    FORBIDDEN = "forbidden"  #: the robot fits, but bounds or areas forbid to be there
    NOT_SEARCHED = "not_searched"  #: the deadline or a stop came first


def place_status(place: Place, graph: GridGraph, context: PlanningContext) -> PlaceStatus:
    """Whether a way can begin or end at a place (x, y) in W, m."""
    if not bool(context.field.frame.contains(place)):
        return PlaceStatus.OUTSIDE_MAP
    if float(context.clearance.distance([place])[0]) < max(graph.cost_space.radius - TOUCH_M, TOUCH_M):
        return PlaceStatus.OCCUPIED
    cells, _ = graph.connect(place)
    return PlaceStatus.OK if len(cells) else PlaceStatus.FORBIDDEN
