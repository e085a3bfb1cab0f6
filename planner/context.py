"""PlanningContext: what is computed once for a field and used by every plan on it."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from shapely import Polygon

from localization import covariance as cov
from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, frozen
from maps.clearance import ClearanceIndex
from planner.background import Background, Keep, Make
from planner.clock import Stopped
from planner.cost_space import cost_space_for
from planner.cost_to_go import CostToGo, GridGraph, Place
from planner.extras import NO_EXTRAS, Extras, cost_factors, forbidden_cells, judged_covariance
from planner.footprint import Footprint, fitting_headings
from planner.fused_belief import FusedField
from planner.obstacles import Obstacles
from planner.pair_search import GridPath, InformedCells, PairSearch
from planner.pivots import COUNT, Pivots
from planner.risk import Stop, risky_cells

#: Memory for graphs, for costs to go and for pivots, bytes each.
CACHE_BYTES = 256_000_000

T = TypeVar("T")


class _Cache:
    """Values by key, the least recently used dropped first. Callers hold the lock of the context."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._entries: OrderedDict[Hashable, tuple[object, int]] = OrderedDict()

    def get(self, key: Hashable) -> object | None:
        """The value, or None."""
        if key not in self._entries:
            return None
        self._entries.move_to_end(key)
        return self._entries[key][0]

    def put(self, key: Hashable, value: object, size: int) -> None:
        """Keep a value; the newest stays even when it alone is above the limit."""
        self._entries[key] = (value, size)
        self._entries.move_to_end(key)
        while len(self._entries) > 1 and sum(n for _, n in self._entries.values()) > self._limit:
            self._entries.popitem(last=False)

    def __len__(self) -> int:
        return len(self._entries)


class PlanningContext:
    """A field made ready for planning: clearance, and caches of cost spaces and costs to go.

    Everything costly that does not depend on the question is computed here, before any deadline runs.
    May be used by several threads at a time.

    Parameters
    ----------
    field
        The uncertainty field; its frame is the planning grid. Over headings: plans drive by the heading of
        travel, and everything that knows no headings counts on the best one.
    cache_bytes
        Memory for the graphs and, as much again each, for costs to go and for pivots, bytes.
    """

    def __init__(self, field: UncertaintyField | HeadingField, *, cache_bytes: int = CACHE_BYTES) -> None:
        #: The field over headings, if it is one, as planning counts on it.
        self.headings = field.trusted() if isinstance(field, HeadingField) else None
        if isinstance(field, HeadingField):
            field = field.reduced("best")
        #: What planning counts on: where first order fails the ellipses are enlarged, or there is no fix.
        self.field = field.trusted()
        self.r95: FloatArray = frozen(self.field.r95)
        self.clearance = ClearanceIndex.from_world(field.world)
        self.centre_clearance: FloatArray = frozen(self.clearance.at_centres(field.frame))
        #: The same field on smaller cells, kept by :func:`planner.narrow.refined`.
        self.finer: PlanningContext | None = None
        self._lock = threading.Lock()
        self._graphs = _Cache(cache_bytes)
        self._costs = _Cache(cache_bytes)
        self._pivots = _Cache(cache_bytes)
        self._pairs = PairSearch()
        self._limit = cache_bytes
        #: Makes pivots and costs to go while others plan.
        self.background = Background(self)

    def graph(
        self,
        *,
        radius: float,
        weight: float,
        max_r95: float | None = None,
        blind_rate: float | None = None,
        extras: Extras = NO_EXTRAS,
    ) -> GridGraph:
        """Planning grid for a robot and a question; see :func:`planner.cost_space.cost_space_for`."""

        def build() -> tuple[GridGraph, int]:
            forbidden, factor = self._of_extras(extras, radius)
            space = cost_space_for(
                self.field.frame,
                self.field.free,
                self.r95,
                self.clearance,
                self.centre_clearance,
                radius=radius,
                weight=weight,
                max_r95=max_r95,
                blind_rate=blind_rate,
                forbidden=forbidden,
                factor=factor,
            )
            graph = GridGraph.from_cost_space(space)
            return graph, graph.half.nbytes + space.rate.nbytes + space.passable.nbytes

        return self._cached(self._graphs, (radius, weight, max_r95, blind_rate, extras), build)

    def obstacles(self, avoid: tuple[Polygon, ...] = ()) -> Obstacles:
        """Walls and areas to avoid, W, m, as obstacles of one kind."""

        def build() -> tuple[Obstacles, int]:
            made = Obstacles.of(self, avoid)
            return made, made.centre_clearance.nbytes if avoid else 0

        return self._cached(self._costs, ("obstacles", avoid), build)

    def fused(self, *, stop: npt.NDArray[np.uint8] | None = None) -> FusedField | None:
        """Information of one fix in every cell, for searches by the filter's belief.

        None when another thread set ``stop`` (1,) before it was ready; then it is made in the background, for
        the next one who asks.
        """
        field, flag = self.field, np.zeros(1, dtype=np.uint8) if stop is None else stop
        made = self._cached(self._costs, "fused", lambda: _with_size(FusedField.unless_stopped(field, flag)))
        if made is None:
            self.background.add(
                "fused", lambda stop: FusedField.unless_stopped(field, stop), PlanningContext._keep_fused
            )
        return made

    def _keep_fused(self, made: FusedField | None) -> None:
        if made is not None:
            with self._lock:
                self._costs.put("fused", made, _with_size(made)[1])

    def values_of(self, name: str) -> FloatArray:
        """Shape (ny, nx): what a bound, ``max_r95_m`` or ``max_ellipse95_m``, is compared with."""
        if name == "max_r95_m":
            return self.r95

        def build() -> tuple[FloatArray, int]:
            values: FloatArray = frozen(cov.ellipse95(self.field.covariance)[..., 0])
            return values, values.nbytes

        return self._cached(self._costs, name, build)

    def risky(
        self, limit: float, *, radius: float, blind_r95: float | None, stop: Stop | None = None
    ) -> BoolArray:
        """Cells (ny, nx) whose collision probability exceeds a limit, as of ``planner.risk.risky_cells``.

        When ``stop`` ends it early they are judged in the background, for who asks again.
        """
        key = ("risky", limit, radius, blind_r95)
        field, clearance, room = self.field, self.clearance, self.centre_clearance

        def judged(flag: Stop | None) -> BoolArray:
            covariance = judged_covariance(field, blind_r95)
            return risky_cells(
                clearance, field.frame, room, covariance, radius=radius, limit=limit, stop=flag
            )

        def judged_later(flag: Stop) -> BoolArray | None:
            with suppress(Stopped):
                return judged(flag)
            return None

        def keep(owner: PlanningContext, cells: BoolArray | None) -> None:
            if cells is not None:
                owner.keep_risky(cells, limit, radius=radius, blind_r95=blind_r95)

        def build() -> tuple[BoolArray, int]:
            cells: BoolArray = frozen(judged(stop), np.bool_)
            return cells, cells.nbytes

        try:
            return self._cached(self._costs, key, build)
        except Stopped:
            self.background.add(key, judged_later, keep)
            raise

    def keep_risky(self, cells: BoolArray, limit: float, *, radius: float, blind_r95: float | None) -> None:
        """Keep the answer of :meth:`risky` that was found otherwise."""
        with self._lock:
            self._costs.put(("risky", limit, radius, blind_r95), frozen(cells, np.bool_), cells.nbytes)

    def fits(
        self, footprint: Footprint, margin: float, count: int, *, stop: npt.NDArray[np.uint8] | None = None
    ) -> BoolArray | None:
        """Cells (count, ny, nx) that an outline fits at headings 0, 2π/count, …, W; None when stopped.

        Parameters
        ----------
        footprint
            The outline.
        margin
            Room beyond it, m.
        count
            Number of headings.
        stop
            Shape (1,); another thread sets it to end early. What is cut short is not kept.
        """
        grown = Footprint(footprint.corners, footprint.discs + np.array([0.0, 0.0, margin]))

        def build() -> tuple[BoolArray | None, int]:
            found = fitting_headings(
                grown,
                self.clearance,
                self.field.frame,
                self.centre_clearance - margin,
                2 * math.pi / count * np.arange(count),
                stop=stop,
            )
            return found, -1 if found is None else found.nbytes

        return self._cached(self._costs, ("fits", grown.key, count), build)

    def _of_extras(self, extras: Extras, radius: float) -> tuple[BoolArray | None, FloatArray | None]:
        """Cells that extras close, and factors of cost."""
        if extras == NO_EXTRAS:
            return None, None

        def build() -> tuple[tuple[BoolArray | None, FloatArray | None], int]:
            made = forbidden_cells(extras, self, radius), cost_factors(extras, self.field.frame)
            return made, sum(a.nbytes for a in made if a is not None)

        return self._cached(self._costs, (extras, radius), build)

    def costs_to(
        self, graph: GridGraph, goal: Place, *, stop: npt.NDArray[np.uint8] | None = None
    ) -> CostToGo:
        """Cost from every cell to a goal, from the cache when it was asked before.

        Parameters
        ----------
        graph
            From :meth:`graph`.
        goal
            (x, y) in W, m.
        stop
            Shape (1,); another thread sets it to end the search early. What is cut short is not kept.
        """

        def build() -> tuple[CostToGo, int]:
            found = graph.costs_to(goal, stop=stop)
            return found, found.nbytes if found.is_complete else -1

        return self._cached(self._costs, (id(graph), goal), build, lambda found: found.graph is graph)

    def path(
        self,
        graph: GridGraph,
        start: Place,
        goal: Place,
        *,
        margin: float = 0.0,
        stop: npt.NDArray[np.uint8] | None = None,
    ) -> GridPath:
        """Cheapest grid path: the same whether costs to the goal and pivots are known yet or not.

        From the second search of a graph on, its pivots are made in the background, and the costs to a goal
        when that is asked for the second time.

        Parameters
        ----------
        graph
            From :meth:`graph`.
        start, goal
            (x, y) in W, m.
        margin
            Above 0: also the cells with a path that is dearer by at most this share, unless costs to the goal
            are known; :meth:`informed_cells` gives the same.
        stop
            Shape (1,); another thread sets it to end the search early.
        """
        known = self._known_costs(graph, goal)
        if known is not None:
            return GridPath(*known.path_from(start))
        pivots = self._known_pivots(graph)
        found = self._pairs.path(graph, start, goal, margin=margin, pivots=pivots, stop=stop)
        if self.background.is_again(id(graph)) and pivots is None:
            self.background.add(id(graph), *self._pivots_of(graph))
        if self.background.is_again((id(graph), goal)):
            self.background.add(
                (id(graph), goal), lambda flag: graph.costs_to(goal, stop=flag), PlanningContext._keep_costs
            )
        return found

    def informed_cells(
        self,
        graph: GridGraph,
        start: Place,
        goal: Place,
        limit: float,
        *,
        stop: npt.NDArray[np.uint8] | None = None,
    ) -> InformedCells | None:
        """Cells through which a grid path of at most ``limit`` leads; None when the search was stopped."""
        return self._pairs.informed_cells(
            graph,
            start,
            goal,
            limit,
            to_go=self._known_costs(graph, goal),
            pivots=self._known_pivots(graph),
            stop=stop,
        )

    def prepare(self, graph: GridGraph) -> None:
        """Make the pivots of a graph now rather than in the background; nothing if they are at hand."""
        if self._known_pivots(graph) is None:
            make, keep = self._pivots_of(graph)
            keep(self, make(np.zeros(1, dtype=np.uint8)))

    def _pivots_of(self, graph: GridGraph) -> tuple[Make, Keep]:
        # Those of two graphs fit: of the question, and of the shortest route beside it.
        count = min(COUNT, self._limit // (4 * len(graph.half)))

        def keep(owner: PlanningContext, pivots: Pivots | None) -> None:
            if pivots is not None:
                with owner._lock:
                    owner._pivots.put(id(graph), (graph, pivots), pivots.nbytes)

        return lambda flag: Pivots.build(graph, count=count, stop=flag), keep

    def _known_pivots(self, graph: GridGraph) -> Pivots | None:
        with self._lock:
            known: tuple[GridGraph, Pivots] | None = self._pivots.get(id(graph))  # type: ignore[assignment]
        return known[1] if known is not None and known[0] is graph else None

    def _known_costs(self, graph: GridGraph, goal: Place) -> CostToGo | None:
        with self._lock:
            known = self._costs.get((id(graph), goal))
        return known if isinstance(known, CostToGo) and known.graph is graph else None

    def _keep_costs(self, found: CostToGo) -> None:
        if found.is_complete:
            with self._lock:
                self._costs.put((id(found.graph), found.goal), found, found.nbytes)

    def _cached(
        self,
        cache: _Cache,
        key: Hashable,
        build: Callable[[], tuple[T, int]],
        fits: Callable[[T], bool] = lambda _: True,
    ) -> T:
        with self._lock:
            value = cache.get(key)
        if value is not None and fits(value):  # type: ignore[arg-type]
            return value  # type: ignore[return-value]
        # Two threads may build the same value: both are right, the later one stays.
        built, size = build()
        if size >= 0:
            with self._lock:
                cache.put(key, built, size)
        return built


def _with_size(fused: FusedField | None) -> tuple[FusedField | None, int]:
    """With the bytes that it takes; -1: not to be kept."""
    return fused, -1 if fused is None else fused.padded.nbytes + fused.widening.nbytes
