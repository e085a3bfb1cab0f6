"""Cost, length, duration and uncertainty between many places, by one search per source or per target."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from maps.arrays import BoolArray, FloatArray, frozen
from planner.clock import Clock
from planner.context import PlanningContext
from planner.cost_to_go import CostToGo, Place
from planner.errors import InvalidProblem
from planner.example_context import example_context
from planner.kernels.matrix import way_figures
from planner.narrow import components, refined
from planner.travel import PlaceStatus, Travel, place_status

#: Places per side; both together are bounded by the product.
MAX_PLACES = 2000
MAX_PAIRS = 250_000
MAX_DEADLINE_S = 3600.0
_LAYERS = ("cost", "length", "mean_r95", "worst_r95", "blind")
_WORDS = {
    PlaceStatus.OUTSIDE_MAP: "is outside the map",
    PlaceStatus.OCCUPIED: "is too close to an obstacle for the robot",
    PlaceStatus.FORBIDDEN: "is where bounds, areas or missing fixes forbid to be",
    PlaceStatus.NOT_SEARCHED: "was not searched: the time was over",
}


@dataclass(frozen=True, slots=True, eq=False)
class CostMatrix:
    """Figures of the best grid path of every pair; each of shape (N, M), NaN where there is none.

    Attributes
    ----------
    sources, targets
        Shape (N, 2) and (M, 2), W, m.
    cost
        ``∫ (1 + weight · r95) ds`` with the factors of areas, over the cheapest 8-connected path between
        the cells of both places, or over the straight line where that is cheaper: at most 8.3 % above the
        cost of a path in any direction where the cost per metre is even.
    length
        Of that path, m.
    duration
        s: the length as one straight motion from rest to rest at ``max_speed`` and ``max_accel``
        (a trapezoid of speed), without slowing down in curves.
    mean_r95, worst_r95
        Along the part with a fix, m; NaN where no part has one.
    blind
        Length without a fix, m.
    source_status, target_status
        What became of each place; all figures of one that is not ``OK`` are NaN.
    warnings
        The same in words, and how many pairs have no way.
    stats
        ``searches`` and ``total_s``.
    """

    sources: FloatArray
    targets: FloatArray
    cost: FloatArray
    length: FloatArray
    duration: FloatArray
    mean_r95: FloatArray
    worst_r95: FloatArray
    blind: FloatArray
    source_status: tuple[PlaceStatus, ...]
    target_status: tuple[PlaceStatus, ...]
    warnings: tuple[str, ...] = ()
    stats: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("sources", "targets", "duration", *_LAYERS):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def is_complete(self) -> bool:
        """Whether every place that can be used was searched."""
        return PlaceStatus.NOT_SEARCHED not in self.source_status + self.target_status


def cost_matrix(
    context: PlanningContext,
    sources: npt.ArrayLike,
    targets: npt.ArrayLike | None = None,
    *,
    travel: Travel,
    deadline: float = 60.0,
    stop: npt.NDArray[np.uint8] | None = None,
    workers: int | None = None,
) -> CostMatrix:
    """What it costs a robot to drive from each source to each target.

    Ways can be driven in both directions at the same cost, so there is one search from each place of the
    smaller side, whatever the size of the other.

    Parameters
    ----------
    context
        The field.
    sources, targets
        Shape (N, 2) and (M, 2), W, m; no targets: the sources, and the matrix is symmetric.
    travel
        Robot, cost per metre, bounds, speed.
    deadline
        Time for all, s. When it is over, places that were not searched are marked so.
    stop
        Shape (1,): another thread sets it to end early; it is set at the deadline, too.
    workers
        Threads; None: one per core.

    Returns
    -------
    matrix
        Places where the robot cannot be have a status and NaN; they do not keep others from being answered.
        Pairs without a way that is proven not to exist are searched again on finer cells, as a plan is, where
        the map is small enough.

    Raises
    ------
    InvalidProblem
        If places are not finite or of another shape, or too many, or the deadline or workers not positive.
    """
    rows = _places("sources", sources)
    same = targets is None
    cols = rows if targets is None else _places("targets", targets)
    if len(rows) * len(cols) > MAX_PAIRS:
        raise InvalidProblem(f"There are {len(rows)} × {len(cols)} pairs; the limit is {MAX_PAIRS}.")
    if not 0 < deadline <= MAX_DEADLINE_S:
        raise InvalidProblem(f"The deadline is {deadline} s; it must be above 0 and at most 3600 s.")
    if workers is not None and workers < 1:
        raise InvalidProblem(f"There are {workers} workers; there must be at least one.")
    clock = Clock(deadline)
    ends = [[(float(x), float(y)) for x, y in side] for side in (rows, cols)]
    flip = len(cols) < len(rows)
    wanted = np.ones((min(map(len, ends)), max(map(len, ends))), dtype=np.bool_)
    if same:
        wanted = np.triu(wanted)
    begins, others = ends[::-1] if flip else ends
    work = _Work(context, travel, begins, others, wanted)
    with clock.stop_flag(stop) as flag:
        workers = workers or os.cpu_count() or 1
        work.run(flag, workers)
        finer = refined(context) if flag[0] == 0 and (missing := work.unproven()).any() else None
        if finer is not None:
            again = _Work(finer, travel, work.begins, work.ends, missing)
            again.run(flag, workers)
            work.add(again, missing)
    if same:
        work.mirror()
    status = [work.begin_status, work.begin_status if same else work.end_status]
    if flip:
        status.reverse()
    layers = {name: layer.T if flip else layer for name, layer in zip(_LAYERS, work.out, strict=True)}
    return CostMatrix(
        sources=rows,
        targets=cols,
        duration=trapezoid_duration(layers["length"], travel.max_speed, travel.max_accel),
        source_status=tuple(status[0]),
        target_status=tuple(status[1]),
        warnings=tuple(_warnings(ends, status, layers["cost"], same=same)),
        stats={"searches": float(work.searches), "total_s": clock.elapsed},
        **layers,
    )


def warm_up() -> None:
    """Compile or load what a matrix needs, by a small one in a made-up room."""
    cost_matrix(example_context(), [(1.0, 1.0), (5.0, 5.0)], travel=Travel(0.2))


def trapezoid_duration(length: FloatArray, max_speed: float, max_accel: float) -> FloatArray:
    """Shortest time, s, of a straight motion from rest to rest; NaN stays.

    ``L / v + v / a``, or ``2 √(L / a)`` where the length does not allow the full speed.
    """
    ramps = max_speed**2 / max_accel
    full = length / max_speed + max_speed / max_accel
    return np.asarray(np.where(length < ramps, 2.0 * np.sqrt(length / max_accel), full))


class _Work:
    """Rows of the matrix: a search from each place of the smaller side, walked back from each of the other.

    ``wanted`` (n, m) says which pairs are asked for.
    """

    def __init__(
        self,
        context: PlanningContext,
        travel: Travel,
        begins: list[Place],
        ends: list[Place],
        wanted: BoolArray,
    ) -> None:
        self.context = context
        self.radius, self.avoid = travel.radius, travel.avoid
        self.graph = travel.graph(context)
        self.begins, self.ends, self.wanted = begins, ends, wanted
        self.begin_status, self.end_status = (
            [place_status(place, self.graph, context) for place in side] for side in (begins, ends)
        )
        self.out = np.full((len(_LAYERS), len(begins), len(ends)), np.nan)
        self.searches = 0
        self.lock = threading.Lock()

    def run(self, stop: npt.NDArray[np.uint8], workers: int) -> None:
        """Fill the rows, several at a time."""
        ends_ok = np.array([s is PlaceStatus.OK for s in self.end_status])
        todo = [k for k, s in enumerate(self.begin_status) if s is PlaceStatus.OK and self.wanted[k].any()]
        columns = [np.flatnonzero(self.wanted[k] & ends_ok).tolist() for k in todo]
        if not todo:
            return
        with ThreadPoolExecutor(min(workers, len(todo))) as pool:
            rows = pool.map(lambda k, js: self.row(k, js, stop), todo, columns)
            for k, done in zip(todo, rows, strict=True):
                if not done:
                    self.begin_status[k] = PlaceStatus.NOT_SEARCHED

    def row(self, k: int, columns: list[int], stop: npt.NDArray[np.uint8]) -> bool:
        """Fill a row; False, and nothing filled, when it was stopped."""
        if stop[0] != 0:
            return False
        found = None
        if any(self.ends[j] != self.begins[k] for j in columns):
            found = self.graph.costs_to(self.begins[k], stop=stop)
            with self.lock:
                self.searches += 1
            if not found.is_complete:
                return False
        for j in columns:
            if stop[0] != 0:
                self.out[:, k] = np.nan
                return False
            self.out[:, k, j] = self.pair(self.begins[k], self.ends[j], found)
        return True

    def unproven(self) -> BoolArray:
        """Pairs without a way for which a passage too narrow for the cells may be the reason."""
        can_be = {PlaceStatus.OK, PlaceStatus.FORBIDDEN}
        ok = [np.array([s in can_be for s in side]) for side in (self.begin_status, self.end_status)]
        missing: BoolArray = self.wanted & ok[0][:, None] & ok[1] & np.isnan(self.out[0])
        if not missing.any():
            return missing
        ends = (self.begins, self.ends)
        a, b = ([side[k] for k in np.flatnonzero(use)] for side, use in zip(ends, ok, strict=True))
        part = components(self.context, self.radius, a + b, self.avoid)
        missing[np.ix_(*ok)] &= part[: len(a), None] == part[len(a) :]
        return missing

    def add(self, finer: _Work, pairs: BoolArray) -> None:
        """Take over what was found on finer cells for some pairs."""
        self.out[:, pairs] = finer.out[:, pairs]
        self.searches += finer.searches
        for mine, theirs in (
            (self.begin_status, finer.begin_status),
            (self.end_status, finer.end_status),
        ):
            for k, state in enumerate(theirs):
                if state is PlaceStatus.NOT_SEARCHED or mine[k] is PlaceStatus.FORBIDDEN:
                    mine[k] = state

    def pair(self, begin: Place, end: Place, found: CostToGo | None) -> tuple[float, ...]:
        """Cost, length, mean and worst r95, blind length of the best way between two places."""
        line = np.array([end, begin])
        straight = self.graph.cost_space.line_cost(line)
        cost, points = np.inf, None
        if found is not None and begin != end:
            cost, points = found.path_from(end)
        if np.isfinite(straight) and straight <= cost:
            cost, points = straight, line
        if points is None:
            return (np.nan,) * len(_LAYERS)
        frame, r95 = self.context.field.frame, self.context.r95
        length, integral, blind, worst = way_figures(frame.to_grid(points), r95)
        if length == 0.0:
            here = float(r95[tuple(frame.cell_at(end))])
            return cost, 0.0, here, here, 0.0
        mean = integral / (length - blind) if length > blind else np.nan
        return cost, length * frame.resolution, mean, worst, blind * frame.resolution

    def mirror(self) -> None:
        """Fill what lies below the diagonal of a matrix of one set of places."""
        low = np.tril_indices(len(self.begins), -1)
        for layer in self.out:
            layer[low] = layer.T[low]


def _places(name: str, values: npt.ArrayLike) -> FloatArray:
    p = np.array(values, dtype=np.float64, ndmin=2)
    if p.ndim != 2 or p.shape[1] != 2 or len(p) == 0:
        raise InvalidProblem(f"The {name} have the shape {p.shape}; give (N, 2), N ≥ 1.")
    if len(p) > MAX_PLACES:
        raise InvalidProblem(f"There are {len(p)} {name}; the limit is {MAX_PLACES}.")
    bad = np.flatnonzero(~np.isfinite(p).all(axis=1))
    if len(bad):
        x, y = p[bad[0]]
        raise InvalidProblem(f"Place {bad[0] + 1} of the {name} is ({x}, {y}) m; both must be finite.")
    return p


def _warnings(
    ends: Sequence[list[Place]], status: Sequence[list[PlaceStatus]], cost: FloatArray, *, same: bool
) -> list[str]:
    out = []
    kinds = ("Place",) if same else ("Source", "Target")
    for kind, side, states in zip(kinds, ends, status, strict=False):
        for k, ((x, y), state) in enumerate(zip(side, states, strict=True)):
            if state is not PlaceStatus.OK:
                out.append(f"{kind} {k + 1} at ({x:g}, {y:g}) m {_WORDS[state]}.")
    ok = [np.array([s is PlaceStatus.OK for s in side]) for side in status]
    lost = int(np.isnan(cost[np.ix_(*ok)]).sum())
    if lost:
        out.append(f"{lost} of {ok[0].sum() * ok[1].sum()} pairs have no way under the bounds.")
    return out
