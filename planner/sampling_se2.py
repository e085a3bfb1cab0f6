"""OMPL for cars: RRT* over poses, from a way at hand to a cheaper one."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou
from scipy.spatial import cKDTree

from maps.arrays import FloatArray
from planner.example_space import example_space
from planner.kernels.pose_chain import pose_link_cost
from planner.kernels.sampling import through_cost
from planner.pose_shorten import chain, cut, shorten_poses
from planner.steering import PoseCurve, PoseSpace, Steering, shortest_curve

_SPACES = {"dubins": ob.DubinsStateSpace, "reeds_shepp": ob.ReedsSheppStateSpace}
# Longest edge that is added to the tree, m, and poses of the warm way, closer than that.
_RANGE_M = 6.0
_WARM_M = 2.0
# As in planner.sampling.
_REWIRE = 0.3
_GREED = 2.0
_CHUNK = 512
# Headings: this share lies around that of the way at hand, so far; the others anywhere.
_NEAR_SHARE = 0.7
_NEAR_RAD = 0.5

Pose = tuple[float, float, float]


def refine_poses_with_ompl(
    space: PoseSpace,
    warm: PoseCurve,
    *,
    cost_to_go: FloatArray,
    samples: int,
    deadline_at: float,
    seed: int,
) -> tuple[PoseCurve, dict[str, float]]:
    """Look for a cheaper way of a car with RRT* over Dubins or Reeds–Shepp curves.

    The tree first grows along the warm way; then samples lie where a cheaper one may lead. Curves are costed
    and checked by our kernels, samples drawn here, so that the answer depends on ``seed`` and ``samples``
    alone, unless the deadline strikes.

    Parameters
    ----------
    space
        What is allowed, at which cost, for which car.
    warm
        A valid way.
    cost_to_go
        Shape (ny, nx): lower bound of the cost from a cell to the goal, inf where there is no way.
    samples
        How many poses are drawn; 0 returns the warm way.
    deadline_at
        ``time.monotonic()`` at which the search stops, s.
    seed
        Of the samples.

    Returns
    -------
    curve
        The cheaper of the way found and the warm one, by ``PoseSpace.cost``.
    stats
        ``samples`` drawn, ``cost``, ``warm_cost``, ``seconds``.

    Notes
    -----
    [KF11] (RRT*), [Dub57], [RS90]. Gear changes between two curves count in the end only, not in the tree.
    """
    began = time.monotonic()
    cost = space.cost(warm)
    stats = {"samples": 0.0, "warm_cost": cost, "cost": cost, "seconds": 0.0}
    if samples <= 0 or began >= deadline_at or not space.steering.is_car or not math.isfinite(cost):
        return warm, stats
    cells = _informed(space, warm, cost_to_go, cost)
    if len(cells) == 0 or len(warm.parts) == 0:
        return warm, stats
    drawn = _draws(space, warm, cells, samples, np.random.default_rng(seed))
    poses, used = _grow(space, warm, drawn, deadline_at)
    stats["samples"] = float(used)
    best = warm
    if poses is not None:
        found = chain(poses, space)
        value = space.cost(found)
        # The tree knows nothing of parts: only a way that is cheaper than the warm one is made shorter still.
        if value < cost:
            found, value = shorten_poses(found, space, deadline_at=deadline_at)
            best, stats["cost"] = found, value
    stats["seconds"] = time.monotonic() - began
    return best, stats


def warm_up() -> None:
    """Compile or load the kernels and start OMPL, by two small searches."""
    plain = example_space()
    for kinematics in _SPACES:
        space = PoseSpace(plain, plain.rate[None], Steering(kinematics, 0.3))  # type: ignore[arg-type]
        warm = shortest_curve((0.5, 0.5, 0.0), (2.3, 2.3, 1.5), space.steering)
        refine_poses_with_ompl(
            space, warm, cost_to_go=np.ones(plain.frame.shape), samples=20, deadline_at=math.inf, seed=0
        )


def _informed(space: PoseSpace, warm: PoseCurve, cost_to_go: FloatArray, cost: float) -> FloatArray:
    # Columns and rows (M, 2) of the cells through which a cheaper way may lead, the best first.
    plain = space.cost_space
    through = np.empty(plain.frame.shape)
    places = np.array([warm.start[0], warm.start[1], 0.0])
    least = float(space.rates.min())
    through_cost(cost_to_go, cost_to_go, places, least, plain.transform, through)
    through[plain.centre_clearance < plain.need] = np.inf
    rows, cols = np.nonzero(through <= cost)
    order = np.argsort(through[rows, cols], kind="stable")
    return np.column_stack([cols, rows])[order].astype(np.float64)


def _draws(
    space: PoseSpace, warm: PoseCurve, cells: FloatArray, samples: int, rng: np.random.Generator
) -> Iterator[Pose]:
    known = warm.sample(0.2).poses
    tree = cKDTree(known[:, :2])
    for first in range(0, samples, _CHUNK):
        n = min(_CHUNK, samples - first)
        u = rng.random((_CHUNK, 5))[:n]
        spread = rng.normal(size=_CHUNK)[:n] * _NEAR_RAD
        k = np.minimum((u[:, 0] ** _GREED * len(cells)).astype(np.int64), len(cells) - 1)
        places = space.cost_space.frame.to_world(cells[k] + u[:, 1:3])
        _, nearest = tree.query(places)
        anywhere = 2.0 * math.pi * u[:, 4]
        headings = np.where(u[:, 3] < _NEAR_SHARE, known[nearest, 2] + spread, anywhere)
        headings = np.arctan2(np.sin(headings), np.cos(headings))
        yield from map(tuple, np.column_stack([places, headings]).tolist())


def _grow(
    space: PoseSpace, warm: PoseCurve, drawn: Iterator[Pose], deadline_at: float
) -> tuple[FloatArray | None, int]:
    # Poses of the tree's best way after all draws or at the deadline, and how many draws were used.
    ou.setLogLevel(ou.LOG_NONE)
    states = _SPACES[space.steering.kinematics](space.steering.min_turn_radius)
    x0, y0, x1, y1 = space.cost_space.frame.bounds()
    bounds = ob.RealVectorBounds(2)
    for axis, low, high in ((0, x0, x1), (1, y0, y1)):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    states.setBounds(bounds)
    info = ob.SpaceInformation(states)
    info.setStateValidityChecker(_Validity(info, space))
    info.setMotionValidator(_Motions(info, space))
    info.setup()
    question = ob.ProblemDefinition(info)
    # Few poses: nearest ones are sought by a distance that for Dubins curves is another one back.
    way = np.array([warm.start, *(piece.joints()[-1] for piece in cut(warm, _WARM_M))])
    poses: list[Pose] = [(x, y, theta) for x, y, theta in way.tolist()]
    first = states.allocState()
    _set(first, poses[0])
    question.addStartState(first)
    feed = _Feed(info, poses[-1], poses[1:], drawn)
    question.setGoal(feed)
    question.setOptimizationObjective(_Cost(info, space))
    planner = og.RRTstar(info)
    planner.setProblemDefinition(question)
    planner.setGoalBias(1.0)
    planner.setRange(_RANGE_M)
    planner.setRewireFactor(_REWIRE)
    planner.setup()
    stop = ob.PlannerTerminationCondition(lambda: feed.is_empty or time.monotonic() >= deadline_at)
    status = planner.solve(stop)
    used = feed.n_drawn
    if status.getStatus() != ob.PlannerStatus.EXACT_SOLUTION:
        return None, used
    found = np.array([_get(s) for s in question.getSolutionPath().getStates()])
    found[[0, -1]] = way[[0, -1]]
    return found, used


def _set(state: Any, pose: tuple[float, ...]) -> None:
    state.setX(float(pose[0]))
    state.setY(float(pose[1]))
    state.setYaw(float(pose[2]))


def _get(state: Any) -> Pose:
    return state.getX(), state.getY(), state.getYaw()


class _Curves:
    """Cost of the curve between two states, by one kernel."""

    def __init__(self, space: PoseSpace) -> None:
        s = space.steering
        self._robot = (s.kind, s.min_turn_radius, s.turn_price, s.gear_price)
        self._args = space.kernel_args

    def __call__(self, a: Any, b: Any) -> float:
        return float(pose_link_cost(*_get(a), *_get(b), *self._robot, *self._args))


class _Validity(ob.StateValidityChecker):  # type: ignore[misc]
    """Whether the robot may stand somewhere: curves say more."""

    def __init__(self, info: Any, space: PoseSpace) -> None:
        super().__init__(info)
        self._space = space.cost_space

    def isValid(self, state: Any) -> bool:  # noqa: N802
        place = (state.getX(), state.getY())
        return bool(math.isfinite(self._space.motion_costs(place, place)[0]))


class _Motions(ob.MotionValidator):  # type: ignore[misc]
    """Whether the robot may go along the shortest curve."""

    def __init__(self, info: Any, space: PoseSpace) -> None:
        super().__init__(info)
        self._cost = _Curves(space)

    def checkMotion(self, a: Any, b: Any, *_: Any) -> bool:  # noqa: N802
        return self._cost(a, b) < math.inf


class _Cost(ob.OptimizationObjective):  # type: ignore[misc]
    """Exact cost of shortest curves."""

    def __init__(self, info: Any, space: PoseSpace) -> None:
        super().__init__(info)
        self._cost = _Curves(space)

    def isSymmetric(self) -> bool:  # noqa: N802
        return False

    def stateCost(self, _state: Any) -> Any:  # noqa: N802
        return ob.Cost(0.0)

    def motionCost(self, a: Any, b: Any) -> Any:  # noqa: N802
        return ob.Cost(self._cost(a, b))


class _Feed(ob.GoalSampleableRegion):  # type: ignore[misc]
    """The goal, which OMPL lets name samples: the warm way's poses first, then what was drawn."""

    def __init__(self, info: Any, goal: Pose, first: list[Pose], drawn: Iterator[Pose]) -> None:
        super().__init__(info)
        self.setThreshold(1e-9)
        self._goal = goal
        self._poses = itertools.chain(first, drawn)
        self._ahead = next(self._poses, None)
        self._n_first = len(first)
        self._n_given = 0

    @property
    def is_empty(self) -> bool:
        return self._ahead is None

    @property
    def n_drawn(self) -> int:
        return max(0, self._n_given - self._n_first)

    def distanceGoal(self, state: Any) -> float:  # noqa: N802
        x, y, theta = _get(state)
        gx, gy, gtheta = self._goal
        return math.hypot(x - gx, y - gy) + abs(math.remainder(theta - gtheta, 2.0 * math.pi))

    def sampleGoal(self, state: Any) -> None:  # noqa: N802
        if self._ahead is None:
            _set(state, self._goal)
            return
        _set(state, self._ahead)
        self._ahead = next(self._poses, None)
        self._n_given += 1

    def maxSampleCount(self) -> int:  # noqa: N802
        return 1_000_000_000

    def couldSample(self) -> bool:  # noqa: N802
        return True
