"""OMPL: a search that starts from a path at hand and looks for a cheaper one; the only import of ompl."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from maps.arrays import FloatArray
from planner.cost_space import CostSpace
from planner.example_space import example_space
from planner.kernels.line_cost import motion_cost
from planner.pair_search import InformedCells
from planner.timing import distinct_points

#: An 8-connected path costs at most this many times what the best path among the same cells does.
OCTILE_EXCESS = 1.0 / math.cos(math.pi / 8.0)
# Longest edge that is added to the tree, m.
_RANGE_M = 6.0
# The tree looks at this share of the neighbours that theory asks for: the warm start makes up for it.
_REWIRE = 0.3
# Draws of cells by u ** this, cells sorted by what a path through them costs: cheap places come more often.
_GREED = 2.0
_CHUNK = 1024
# The cost is looked at after so many samples; a gain below this share counts as none.
_LOOK_EVERY = 8
_LEAST_GAIN = 1e-4
_LEVELS = 65_000


def refine_with_ompl(
    cost_space: CostSpace,
    start: tuple[float, float],
    goal: tuple[float, float],
    warm_path: npt.ArrayLike,
    *,
    cells: InformedCells,
    samples: int,
    deadline_at: float,
    seed: int,
    patience: int | None = None,
) -> tuple[FloatArray, dict[str, float]]:
    """Look for a cheaper path with RRT* over the plane.

    The tree first grows along the warm path; then every sample lies in a cell through which a cheaper path
    may lead. Motions are costed and checked exactly. Samples are drawn here, not by OMPL, so that the answer
    depends on ``seed`` and ``samples`` alone, unless the deadline strikes.

    Parameters
    ----------
    cost_space
        What is allowed, and at which cost.
    start, goal
        (x, y) in W, m: the ends of the warm path.
    warm_path
        Shape (K, 2), W, m: a valid path.
    cells
        Through which a cheaper path may lead.
    samples
        How many samples are drawn at most; 0 returns the warm path.
    deadline_at
        ``time.monotonic()`` at which the search stops, s.
    seed
        Of the samples.
    patience
        The search ends after so many samples in a row that gained next to nothing; None: never.

    Returns
    -------
    path
        Shape (K, 2), W, m: the cheaper of the path found and the warm path, by ``CostSpace.line_cost``.
    stats
        ``samples`` drawn, ``cost``, ``warm_cost``, ``cells`` drawn from, ``seconds``.

    Raises
    ------
    InvalidProblem
        If the warm path has no point or one that is not finite.

    Notes
    -----
    [KF11] (RRT*), [GSB14] (drawing only from where a better path can be).
    """
    began = time.monotonic()
    warm = distinct_points(warm_path)
    warm_cost = cost_space.line_cost(warm)
    stats = {"samples": 0.0, "warm_cost": warm_cost, "cost": warm_cost, "cells": 0.0, "seconds": 0.0}
    if samples <= 0 or len(warm) < 2 or began >= deadline_at or not math.isfinite(warm_cost):
        return warm, stats
    if len(cells.through) == 0:
        return warm, stats
    # Small integers are sorted ten times faster than floats.
    least = float(cells.through.min())
    span = max(float(cells.through.max()) - least, 1e-300)
    level = ((cells.through - least) * (_LEVELS / span)).astype(np.uint16)
    order = np.argsort(level, kind="stable")
    stats["cells"] = float(len(order))
    drawn = _draws(cost_space, cells.rows[order], cells.cols[order], samples, np.random.default_rng(seed))
    path, used = _grow(cost_space, start, goal, warm, drawn, _Patience(warm_cost, patience, deadline_at))
    stats["samples"] = float(used)
    if path is not None:
        cost = cost_space.line_cost(path)
        if cost < warm_cost:
            warm, stats["cost"] = path, cost
    stats["seconds"] = time.monotonic() - began
    return warm, stats


def warm_up() -> None:
    """Compile or load the kernels and start OMPL, by one small search."""
    space = example_space()
    rows, cols = np.nonzero(space.passable)
    refine_with_ompl(
        space,
        (0.5, 0.5),
        (2.5, 2.5),
        [[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]],
        cells=InformedCells(rows, cols, np.full(len(rows), 6.0)),
        samples=20,
        deadline_at=math.inf,
        seed=0,
    )


def _draws(
    space: CostSpace,
    rows: npt.NDArray[np.int64],
    cols: npt.NDArray[np.int64],
    samples: int,
    rng: np.random.Generator,
) -> Iterator[tuple[float, float]]:
    # So many places, uniform in cells, of which the first come more often.
    for first in range(0, samples, _CHUNK):
        u = rng.random((_CHUNK, 3))[: samples - first]
        k = np.minimum((u[:, 0] ** _GREED * len(rows)).astype(np.int64), len(rows) - 1)
        places = space.frame.to_world(np.column_stack([cols[k] + u[:, 1], rows[k] + u[:, 2]]))
        yield from map(tuple, places.tolist())


def _along(path: FloatArray) -> Iterator[tuple[float, float]]:
    # The points of a path after its first, none further from the one before than the tree can reach.
    for a, b in itertools.pairwise(path):
        n = math.ceil(math.hypot(*(b - a)) / (0.999 * _RANGE_M))
        for k in range(1, n + 1):
            x, y = a + (b - a) * (k / n) if k < n else b
            yield float(x), float(y)


def _grow(
    space: CostSpace,
    start: tuple[float, float],
    goal: tuple[float, float],
    warm: FloatArray,
    drawn: Iterator[tuple[float, float]],
    patience: _Patience,
) -> tuple[FloatArray | None, int]:
    # The path of the tree after all draws or at the deadline, and how many draws were used.
    ou.setLogLevel(ou.LOG_NONE)
    plane = ob.RealVectorStateSpace(2)
    plane.setBounds(_bounds(space))
    info = ob.SpaceInformation(plane)
    info.setStateValidityChecker(_Validity(info, space))
    info.setMotionValidator(_Motions(info, space))
    info.setup()
    question = ob.ProblemDefinition(info)
    first = plane.allocState()
    first[0], first[1] = start
    question.addStartState(first)
    feed = _Feed(info, goal, [*_along(warm)], drawn)
    question.setGoal(feed)
    question.setOptimizationObjective(_Cost(info, space))
    planner = og.RRTstar(info)
    planner.setProblemDefinition(question)
    # Every sample comes from the feed.
    planner.setGoalBias(1.0)
    planner.setRange(_RANGE_M)
    planner.setRewireFactor(_REWIRE)
    planner.setup()
    stop = ob.PlannerTerminationCondition(
        lambda: feed.is_empty or patience.is_over(feed.n_drawn, lambda: float(planner.bestCost().value()))
    )
    status = planner.solve(stop)
    used = feed.n_drawn
    if status.getStatus() != ob.PlannerStatus.EXACT_SOLUTION:
        return None, used
    states = question.getSolutionPath().getStates()
    return distinct_points([(s[0], s[1]) for s in states]), used


class _Patience:
    """Ends a search at its deadline, or when many samples in a row have gained next to nothing."""

    def __init__(self, cost: float, samples: int | None, deadline_at: float) -> None:
        self._best = cost
        self._samples = math.inf if samples is None else samples
        self._deadline_at = deadline_at
        self._last = 0
        self._next = _LOOK_EVERY

    def is_over(self, n_drawn: int, cost: Callable[[], float]) -> bool:
        """Whether to stop after so many samples; ``cost`` tells the best so far."""
        if n_drawn >= self._next:
            self._next = n_drawn + _LOOK_EVERY
            now = cost()
            if now < self._best * (1.0 - _LEAST_GAIN):
                self._best, self._last = now, n_drawn
        return n_drawn - self._last >= self._samples or time.monotonic() >= self._deadline_at


def _bounds(space: CostSpace) -> Any:
    x0, y0, x1, y1 = space.frame.bounds()
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(0, x0)
    bounds.setLow(1, y0)
    bounds.setHigh(0, x1)
    bounds.setHigh(1, y1)
    return bounds


class _Validity(ob.StateValidityChecker):  # type: ignore[misc]
    """Whether the robot may stand somewhere."""

    def __init__(self, info: Any, space: CostSpace) -> None:
        super().__init__(info)
        self._args = space.kernel_args

    def isValid(self, state: Any) -> bool:  # noqa: N802
        return bool(motion_cost(state[0], state[1], state[0], state[1], *self._args) < math.inf)


class _Motions(ob.MotionValidator):  # type: ignore[misc]
    """Whether the robot may go straight."""

    def __init__(self, info: Any, space: CostSpace) -> None:
        super().__init__(info)
        self._args = space.kernel_args

    def checkMotion(self, a: Any, b: Any, *_: Any) -> bool:  # noqa: N802
        return bool(motion_cost(a[0], a[1], b[0], b[1], *self._args) < math.inf)


class _Cost(ob.OptimizationObjective):  # type: ignore[misc]
    """Exact cost of straight motions."""

    def __init__(self, info: Any, space: CostSpace) -> None:
        super().__init__(info)
        self._args = space.kernel_args

    def isSymmetric(self) -> bool:  # noqa: N802
        return True

    def stateCost(self, _state: Any) -> Any:  # noqa: N802
        return ob.Cost(0.0)

    def motionCost(self, a: Any, b: Any) -> Any:  # noqa: N802
        return ob.Cost(motion_cost(a[0], a[1], b[0], b[1], *self._args))


class _Feed(ob.GoalSampleableRegion):  # type: ignore[misc]
    """The goal, which OMPL lets name samples: the warm path first, then what was drawn."""

    def __init__(
        self,
        info: Any,
        goal: tuple[float, float],
        first: list[tuple[float, float]],
        drawn: Iterator[tuple[float, float]],
    ) -> None:
        super().__init__(info)
        self.setThreshold(1e-9)
        self._goal = goal
        self._places = itertools.chain(first, drawn)
        self._ahead = next(self._places, None)
        self._n_first = len(first)
        self._n_given = 0

    @property
    def is_empty(self) -> bool:
        return self._ahead is None

    @property
    def n_drawn(self) -> int:
        return max(0, self._n_given - self._n_first)

    def distanceGoal(self, state: Any) -> float:  # noqa: N802
        return math.hypot(state[0] - self._goal[0], state[1] - self._goal[1])

    def sampleGoal(self, state: Any) -> None:  # noqa: N802
        if self._ahead is None:
            state[0], state[1] = self._goal
            return
        state[0], state[1] = self._ahead
        self._ahead = next(self._places, None)
        self._n_given += 1

    def maxSampleCount(self) -> int:  # noqa: N802
        return 1_000_000_000

    def couldSample(self) -> bool:  # noqa: N802
        return True
