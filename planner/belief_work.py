"""What plans over (place, uncertainty) share: the path without bounds, and from lines to a motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray, FloatArray
from planner.any_angle import shorten
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_space import CostSpace
from planner.cost_to_go import GridGraph
from planner.kernels.line_cost import polyline_pieces
from planner.label_search import LabelPath, Stop
from planner.motion import move_along
from planner.problem import PlanningProblem
from planner.result import Route, Trajectory, Unmet
from planner.smoothing import COST_SLACK
from planner.timing import time_polyline

#: Parts of the deadline at which searches and shaping end: the rest is for what follows.
SEARCH_SHARE, SHAPE_SHARE = 0.75, 0.9
# A smooth way may leave the blind cells of its lines by so many cells; tried one after the other.
_FENCE_CELLS = (1, 0)


class BeliefWork(ABC):
    """One question in the making.

    Parameters
    ----------
    problem, context, clock
        The question, the field, the time.
    """

    #: Where it is searched, and what was found; set by :meth:`search`.
    graph: GridGraph
    found: LabelPath

    def __init__(self, problem: PlanningProblem, context: PlanningContext, clock: Clock) -> None:
        self.problem, self.context, self.clock = problem, context, clock
        self.has_fix: BoolArray = context.field.has_fix
        #: The shortest way whatever the bounds, (M, 2), W, m; None without one, or until it is known.
        self.plain: FloatArray | None = None

    @property
    def free_graph(self) -> GridGraph:
        """Of lengths (and areas) alone, without bounds."""
        p = self.problem
        return self.context.graph(
            radius=p.radius, weight=0.0, blind_rate=1.0, extras=p.extras.without_bounds()
        )

    def search_plain(self, stop: Stop) -> None:
        """Search the shortest way whatever the bounds."""
        graph = self.free_graph
        found = self.context.path(graph, self.problem.start, self.problem.goal, stop=stop)
        if found.points is not None:
            self.plain, _ = shorten(found.points, graph.cost_space, deadline_at=self.clock.at(SHAPE_SHARE))

    @abstractmethod
    def search(self, stop: Stop) -> LabelPath:
        """Search; sets ``graph`` and ``found``."""

    @abstractmethod
    def route(self) -> tuple[Route, list[str]]:
        """The route that the search's path became, and the stages that shaped it."""

    @abstractmethod
    def of_plain(self, points: FloatArray) -> Route:
        """The route along the shortest way, with stops at its corners."""

    @property
    @abstractmethod
    def is_ready(self) -> bool:
        """Whether bounds can be judged."""

    @abstractmethod
    def told(self, route: Route) -> Route:
        """A route made otherwise, with this question's uncertainty and cost."""

    @abstractmethod
    def prefers(self, other: Route, route: Route) -> bool:
        """Whether another route is better by bounds and objective."""

    @abstractmethod
    def unmet(self, route: Route, *, searched: bool = True) -> tuple[Unmet, ...]:
        """Bounds that a route does not keep; without a search nothing is said of what is possible."""

    def smoothed(self, points: FloatArray, space: CostSpace) -> Trajectory | None:
        """Lines as a smooth trajectory, if smoothing succeeds."""
        motion = move_along(
            points,
            space,
            max_speed=self.problem.max_speed,
            max_accel=self.problem.max_accel,
            cost_limit=(1.0 + COST_SLACK) * space.line_cost(points),
            deadline_at=self.clock.at(SHAPE_SHARE),
            other_way=lambda: None,
        )
        return motion.trajectory if motion.is_smooth else None

    def timed(self, points: npt.ArrayLike) -> Trajectory:
        """Lines driven with stops at their corners."""
        return time_polyline(points, max_speed=self.problem.max_speed, max_accel=self.problem.max_accel)

    def spaces(self, points: FloatArray) -> Iterator[CostSpace]:
        """Where lines (M, 2) may be smoothed: the search's space, then without blind cells away from them.

        Free of such a fence a smooth way may be shorter, or lose its fixes; within the last one it can lose
        none that the lines have.
        """
        space = self.graph.cost_space
        yield space
        pieces = polyline_pieces(space.frame.to_grid(points), space.rate)
        ny, nx = space.frame.shape
        for cells in _FENCE_CELLS:
            near = np.zeros((ny, nx), dtype=np.bool_)
            for dr, dc in product(range(-cells, cells + 1), repeat=2):
                for first in (0, 2):
                    rows, cols = pieces[:, first : first + 2].astype(np.int64).T
                    near[np.clip(rows + dr, 0, ny - 1), np.clip(cols + dc, 0, nx - 1)] = True
            yield replace(space, rate=np.where(near | self.has_fix, space.rate, np.inf))
