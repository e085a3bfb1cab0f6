"""From pose to pose under a robot's kinematics: lattice, shortest curves, RRT*."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray, IntArray
from planner import sampling_se2
from planner.clock import flag_at
from planner.cost_space import CostSpace
from planner.cost_to_go import GridGraph
from planner.example_space import example_space
from planner.fillet import filleted
from planner.lattice import End, Lattice, LatticeWay, Outcome, joints_of, lattice_for, search_lattice
from planner.pose_reason import why_no_way
from planner.pose_shorten import PART_M, shorten_poses
from planner.steering import CurveSamples, PoseCurve, PoseSpace, Steering

# Share of the time left at which shortening ends and sampling begins.
_SHORTEN_SHARE = 0.5
# From so many cells on the cheapest way takes seconds; share of the time left that its search may take.
_MANY_CELLS = 300_000
_PROOF_SHARE = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class PosePath:
    """Answer of :func:`plan_poses`.

    Attributes
    ----------
    outcome
        ``FOUND``, ``NO_WAY`` (on the lattice; ``reason`` says more) or ``STOPPED``.
    curve
        The way as arcs, lines and turns in place; None without one.
    samples
        Poses along it with gears, curvature and arc length; None without one.
    cost
        ``∫ rate ds`` and the prices of manoeuvres along the curve; inf without one.
    lattice_cost
        Cost of the cheapest way on the lattice; never below ``cost``; inf without one.
    is_exact
        Whether that is proven: no cheaper way exists on the lattice.
    planner
        Stages that shaped the way, e.g. ``lattice+shorten+ompl``.
    reason
        Why there is no way, in words; empty when there is one.
    to_go
        Shape (ny, nx): lower bound of the lattice's cost from a cell to the goal; None when it is not known.
    stats
        ``expanded`` poses, seconds per stage.
    """

    outcome: Outcome
    curve: PoseCurve | None
    samples: CurveSamples | None
    cost: float
    lattice_cost: float
    is_exact: bool
    planner: str
    reason: str = ""
    to_go: FloatArray | None = None
    stats: dict[str, float] = field(default_factory=dict)

    @property
    def poses(self) -> FloatArray:
        """Poses (K, 3): x, y, θ in W, m and rad; empty without a way."""
        return np.empty((0, 3)) if self.samples is None else self.samples.poses

    @property
    def gears(self) -> IntArray:
        """Shape (K,): 1 forwards, -1 backwards, 0 turning in place, of the motion that leads to a pose."""
        return np.empty(0, dtype=np.int64) if self.samples is None else self.samples.gear

    @property
    def length(self) -> float:
        """Way driven, m; inf without one."""
        return math.inf if self.curve is None else self.curve.length


def plan_poses(
    cost_space: CostSpace,
    start_pose: tuple[float, float, float | None],
    goal_pose: tuple[float, float, float | None],
    *,
    steering: Steering,
    heading_rates: FloatArray | None = None,
    n_headings: int = 16,
    deadline_at: float = math.inf,
    stop: npt.NDArray[np.uint8] | None = None,
    seed: int = 0,
    refine: int = 0,
    is_explained: bool = True,
) -> PosePath:
    """Cheapest way of a robot from a pose to a pose that can be found until a deadline.

    Parameters
    ----------
    cost_space
        Cells, clearance, radius, and the rates where ``heading_rates`` is None.
    start_pose, goal_pose
        (x, y, θ) in W, m and rad; θ None: any heading. On the grid and free: see ``planner.ends``.
    steering
        Kinematics, turning radius, prices of manoeuvres.
    heading_rates
        Shape (H, ny, nx), 1/m: from :func:`planner.steering.heading_rates`. A holonomic robot then faces
        the way that it drives.
    n_headings
        Of the lattice: 8, 16 or 32.
    deadline_at
        ``time.monotonic()`` at which the best so far is returned, s.
    stop
        Shape (1,); another thread sets it to end the search.
    seed, refine
        Of the samples of RRT*, and how many may be drawn; 0 skips it, as do robots that turn in place.
    is_explained
        Whether to look for the reason where there is no way, which takes further searches.

    Returns
    -------
    path
        Never dearer than the lattice's way.

    Raises
    ------
    InvalidProblem
        If a number is impossible.
    """
    space = PoseSpace(cost_space, cost_space.rate[None] if heading_rates is None else heading_rates, steering)
    start, goal = End(*start_pose), End(*goal_pose)
    stats: dict[str, float] = {}
    began = time.monotonic()
    lattice = lattice_for(space, n_headings=n_headings)
    with flag_at(deadline_at, stop) as flag:
        way = _way_of_lattice(lattice, start, goal, deadline_at, flag)
        stats["lattice_s"] = time.monotonic() - began
        stats["expanded"] = float(way.expanded)
        if way.curve is None:
            reason = ""
            if way.outcome is Outcome.STOPPED:
                reason = "The deadline came before any way was found."
            elif is_explained:
                reason = why_no_way(space, start, goal, stop=flag)
            return PosePath(
                way.outcome, None, None, math.inf, math.inf, False, "lattice", reason, way.to_go, stats
            )
    return _improved(space, way, start, goal, stats, deadline_at, seed, refine)


def _way_of_lattice(
    lattice: Lattice, start: End, goal: End, deadline_at: float, flag: npt.NDArray[np.uint8]
) -> LatticeWay:
    """The cheapest way; on many cells first one that is quick to find, which stands where the time ends."""
    space = lattice.space.cost_space
    if space.rate.size < _MANY_CELLS or not math.isfinite(deadline_at):
        return search_lattice(lattice, start, goal, stop=flag)
    graph = GridGraph.from_cost_space(space)
    guess = graph.costs_to((goal.x, goal.y), stop=flag).cost
    joints = joints_of(lattice, start, goal)
    quick = search_lattice(lattice, start, goal, stop=flag, guess=guess, joints=joints)
    now = time.monotonic()
    with flag_at(now + _PROOF_SHARE * max(deadline_at - now, 0.0)) as until:
        way = search_lattice(lattice, start, goal, stop=until, joints=joints)
    if way.outcome is not Outcome.STOPPED or way.cost <= quick.cost:
        return way
    return replace(quick, outcome=Outcome.STOPPED, to_go=None)


def warm_up() -> None:
    """Compile or load the kernels of all kinds of robots, by small searches."""
    plain = example_space()
    robots = [Steering("differential", turn_price=0.1), Steering("dubins", 0.3), Steering("reeds_shepp", 0.3)]
    for steering in robots:
        for n_bins in (1, 2):
            rates = np.repeat(plain.rate[None], n_bins, axis=0)
            plan_poses(
                plain, (0.5, 0.5, 0.0), (2.3, 2.3, 1.5), steering=steering, heading_rates=rates, refine=20
            )


def _improved(
    space: PoseSpace,
    way: LatticeWay,
    start: End,
    goal: End,
    stats: dict[str, float],
    deadline_at: float,
    seed: int,
    refine: int,
) -> PosePath:
    assert way.curve is not None
    stages = ["lattice"]
    began = time.monotonic()
    best, cost = way.curve, space.cost(way.curve)
    until = deadline_at
    if refine > 0 and space.steering.is_car and math.isfinite(deadline_at):
        until = began + _SHORTEN_SHARE * max(deadline_at - began, 0.0)
    shorter, shorter_cost = shorten_poses(
        best,
        space,
        deadline_at=until,
        free_start=start.heading is None,
        free_goal=goal.heading is None,
    )
    stats["shorten_s"] = time.monotonic() - began
    if shorter_cost < cost:
        best, cost = shorter, shorter_cost
        stages.append("shorten")
    if not space.steering.is_car:
        rounded, rounded_cost = filleted(best, space, cost, most=way.cost)
        if rounded.turned < best.turned:
            best, cost = rounded, rounded_cost
            stages.append("fillet")
    if refine > 0 and space.steering.is_car and way.to_go is not None:
        found, about = sampling_se2.refine_poses_with_ompl(
            space, best, cost_to_go=way.to_go, samples=refine, deadline_at=deadline_at, seed=seed
        )
        stats["ompl_s"], stats["samples"] = about["seconds"], about["samples"]
        if about["cost"] + PART_M * (len(found.parts) - len(best.parts)) < cost:
            best, cost = found, about["cost"]
            stages.append("ompl")
    return PosePath(
        way.outcome,
        best,
        best.sample(),
        cost,
        max(way.cost, cost),
        way.outcome is Outcome.FOUND,
        "+".join(stages),
        "",
        way.to_go,
        stats,
    )
