"""Search over (x, y, heading): the cheapest way of a robot on a lattice of poses, exact on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray, IntArray
from planner.errors import InvalidProblem
from planner.kernels import lattice as kernel
from planner.primitives import Primitives, primitives_for
from planner.steering import PoseCurve, PoseSpace, Steering, shortest_curve

#: Poses that a lattice may have; memory is taken only for those that the search sees.
MAX_STATES = 400_000_000
# Poses of the lattice within this many cells and radii of an end are joined to it by one curve.
_REACH_CELLS = 3.0
_REACH_RADII = {"dubins": 2.0, "reeds_shepp": 1.0}
# Cells within reach in one direction of which all are joined; of twice as many every other one, and so on.
_REACH_STEPS = 12
# Curves that are more than this longer than the straight line, in radii, do not join.
_DETOUR_RADII = 1.0

Stop = npt.NDArray[np.uint8]


class Outcome(Enum):
    """How a search ended."""

    FOUND = "found"  #: the cheapest way on the lattice
    NO_WAY = "no_way"  #: the lattice has none
    STOPPED = "stopped"  #: the deadline came first


_OUTCOMES = {kernel.FOUND: Outcome.FOUND, kernel.NO_WAY: Outcome.NO_WAY, kernel.STOPPED: Outcome.STOPPED}


@dataclass(frozen=True, slots=True)
class End:
    """A start or goal: place (x, y) in W, m, and heading, rad; None: any."""

    x: float
    y: float
    heading: float | None = None

    def __post_init__(self) -> None:
        values = (self.x, self.y, 0.0 if self.heading is None else self.heading)
        if not all(map(math.isfinite, values)):
            raise InvalidProblem(f"The pose is ({self.x}, {self.y}, {self.heading}); all must be finite.")


@dataclass(frozen=True, slots=True, eq=False)
class LatticeWay:
    """Outcome of :func:`search_lattice`.

    Attributes
    ----------
    outcome
        How it ended.
    curve
        The way from pose to pose; None without one.
    cost
        Of the curve; inf without one.
    expanded
        Poses that the search looked at.
    to_go
        Shape (ny, nx): lower bound of the cost from a cell's centre to the goal, whatever the heading; None
        when it was not computed.
    """

    outcome: Outcome
    curve: PoseCurve | None
    cost: float
    expanded: int
    to_go: FloatArray | None


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Poses of the lattice that one curve joins to an end.

    Attributes
    ----------
    keys
        Shape (J,), ascending: ``(row · nx + col) · K + heading``.
    ends
        Shape (J, 3): the end's pose; its heading is the best one where any will do.
    costs
        Shape (J,): of the curve from or to it.
    gears
        Shape (J,): of the curve where it meets the lattice: 1, -1, or 0 where the robot does not drive.
    """

    keys: IntArray
    ends: FloatArray
    costs: FloatArray
    gears: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Poses (cell's centre, heading) of a cost space and the moves between them.

    Build it with :func:`lattice_for`.
    """

    space: PoseSpace
    primitives: Primitives

    @property
    def n_gears(self) -> int:
        """Gears that are told apart."""
        return 2 if self.space.steering.has_reverse else 1

    @property
    def n_states(self) -> int:
        """Poses times gears."""
        n_cells = int(np.prod(self.space.cost_space.frame.shape))
        return n_cells * len(self.primitives.headings) * self.n_gears

    def pose(self, keys: IntArray) -> FloatArray:
        """Poses (J, 3) in W of keys (J,)."""
        frame = self.space.cost_space.frame
        k = len(self.primitives.headings)
        cells = keys // k
        centres = self.space.cost_space.centre(cells // frame.n_cols, cells % frame.n_cols)
        return np.column_stack([centres, self.primitives.headings[keys % k] + frame.yaw])

    def joints(self, end: End, *, is_start: bool) -> Joints:
        """Poses near an end that the shortest curve joins to it where it is valid.

        For cars all poses within two radii, plus three cells, whose curve is at most one radius longer than
        the straight line; an end without heading takes the lattice's headings up to one step from
        the pose's own.
        """
        steering = self.space.steering
        frame = self.space.cost_space.frame
        headings = self.primitives.headings
        radius = steering.min_turn_radius if steering.is_car else 0.0
        reach = _REACH_CELLS * frame.resolution + _REACH_RADII.get(steering.kinematics, 0.0) * radius
        cells = self._cells_near(end, reach)
        n = len(headings)
        keys = (cells[:, None] * n + np.arange(n)).ravel()
        poses = self.pose(keys)
        away = np.hypot(poses[:, 0] - end.x, poses[:, 1] - end.y)
        limits = away + _DETOUR_RADII * radius if steering.is_car else away + 1e-9
        best = Joints(keys, poses, np.full(len(keys), np.inf), np.zeros(len(keys), dtype=np.int64))
        for shift in self._shifts(end):
            own = headings[(keys + shift) % n] + frame.yaw if end.heading is None else end.heading
            if not steering.is_car and end.heading is None:
                # Free to face the way from the beginning, or to stay as it came.
                own = np.arctan2(poses[:, 1] - end.y, poses[:, 0] - end.x) + (0.0 if is_start else math.pi)
                own = np.where(away < 1e-9, poses[:, 2], own)
            ends = np.column_stack(
                [np.broadcast_to([end.x, end.y], (len(keys), 2)), np.broadcast_to(own, len(keys))]
            )
            a, b = (ends, poses) if is_start else (poses, ends)
            table = self.space.steer_costs(a, b, max_length=limits)
            better = table[:, 0] < best.costs
            best.costs[better] = table[better, 0]
            best.ends[better] = ends[better]
            best.gears[better] = table[better, 2 if is_start else 1]
        ok = np.isfinite(best.costs)
        return Joints(keys[ok], best.ends[ok], best.costs[ok], best.gears[ok])

    def _shifts(self, end: End) -> tuple[int, ...]:
        return (0, 1, -1) if end.heading is None and self.space.steering.is_car else (0,)

    def _cells_near(self, end: End, reach: float) -> IntArray:
        space = self.space.cost_space
        row, col = (int(v) for v in space.frame.cell_at((end.x, end.y)))
        n = math.ceil(reach / space.frame.resolution)
        rows = np.arange(max(row - n, 0), min(row + n + 1, space.frame.n_rows))
        cols = np.arange(max(col - n, 0), min(col + n + 1, space.frame.n_cols))
        grid = np.stack(np.meshgrid(rows, cols, indexing="ij"), axis=-1).reshape(-1, 2)
        centres = space.centre(grid[:, 0], grid[:, 1])
        away = np.hypot(centres[:, 0] - end.x, centres[:, 1] - end.y)
        # On small cells every few of them will do, but for those next to the end.
        stride = max(1, n // _REACH_STEPS)
        chosen = ((grid - [row, col]) % stride == 0).all(axis=1)
        near = (away <= reach) & (chosen | (away <= _REACH_CELLS * space.frame.resolution))
        fits = space.centre_clearance[grid[:, 0], grid[:, 1]] >= space.need
        grid = grid[near & fits]
        return np.asarray(grid[:, 0] * space.frame.n_cols + grid[:, 1], dtype=np.int64)

    @property
    def move_args(self) -> tuple[object, ...]:
        """What the kernels of ``planner.kernels.lattice`` take last: moves, rates, clearance."""
        rates, *rest = self.space.kernel_args
        return (*self.primitives.arrays, rates, self.space.cost_space.centre_clearance, *rest)


def lattice_for(space: PoseSpace, *, n_headings: int = 16) -> Lattice:
    """The lattice of a space: cell centres times headings.

    Parameters
    ----------
    space
        What is allowed, and at which cost.
    n_headings
        8, 16 or 32.

    Raises
    ------
    InvalidProblem
        If the number of headings is another, or there would be more than ``MAX_STATES`` poses.
    """
    frame = space.cost_space.frame
    # What does not matter for the moves is left out, so that they are made once.
    s = space.steering
    price = 0.0 if s.is_car else s.turn_price
    moves = primitives_for(
        Steering(s.kinematics, s.min_turn_radius if s.is_car else 0.0, price),
        frame.resolution,
        frame.yaw,
        n_headings,
        len(space.rates),
    )
    lattice = Lattice(space, moves)
    if lattice.n_states > MAX_STATES:
        raise InvalidProblem(
            f"A lattice of {n_headings} headings on {frame.n_rows} × {frame.n_cols} cells has "
            f"{lattice.n_states} poses; at most {MAX_STATES} are searched: use fewer headings or "
            "larger cells."
        )
    return lattice


def joints_of(lattice: Lattice, start: End, goal: End) -> tuple[Joints, Joints]:
    """Poses that are joined to the start and to the goal."""
    return lattice.joints(start, is_start=True), lattice.joints(goal, is_start=False)


def search_lattice(
    lattice: Lattice,
    start: End,
    goal: End,
    *,
    stop: Stop | None = None,
    guess: FloatArray | None = None,
    joints: tuple[Joints, Joints] | None = None,
) -> LatticeWay:
    """Cheapest way from one pose to another over the lattice.

    One curve joins the start to the lattice, moves follow, one curve leads to the goal; or one curve leads
    straight there. A* on the exact costs of the same moves without headings.

    Parameters
    ----------
    lattice
        From :func:`lattice_for`.
    start, goal
        Ends anywhere on the grid.
    stop
        Shape (1,); another thread sets it to end the search.
    guess
        Shape (ny, nx): about what a cell costs to the goal; where it is too high the way may not be the
        cheapest, and where it is inf none is looked for. None: it is computed exactly, which takes longer
        than the search by a guess.
    joints
        Of start and goal, if they are known.

    Returns
    -------
    way
        ``FOUND``: no cheaper way of this form exists. ``NO_WAY``: none exists. ``STOPPED``: with the best way
        that was seen, if any.

    Notes
    -----
    [PKK09].
    """
    flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
    space = lattice.space
    direct, direct_cost = _direct(space, start, goal)
    first, last = joints or joints_of(lattice, start, goal)
    n = len(lattice.primitives.headings)
    args = lattice.move_args
    to_go = np.empty(space.cost_space.frame.shape)
    row, col = space.cost_space.frame.cell_at((start.x, start.y))
    guide = np.array([row, col, float(space.rates.min())])
    if guess is not None:
        to_go[:] = guess
    elif not kernel.costs_without_headings(
        last.keys // n, last.costs, first.keys // n, guide, direct_cost, flag, to_go, *args
    ):
        return LatticeWay(Outcome.STOPPED, direct, direct_cost, 0, None)
    seeds, seed_costs, of = _seeds(lattice, first)
    so_far = np.zeros(lattice.n_states)
    parent = np.zeros(lattice.n_states, dtype=np.int32)
    outcome, cost, at, expanded = kernel.search_poses(
        lattice.n_gears,
        space.steering.gear_price,
        seeds,
        seed_costs,
        last.keys,
        last.costs,
        last.gears,
        direct_cost,
        to_go,
        flag,
        so_far,
        parent,
        *args,
    )
    if at < 0:
        ended = Outcome.FOUND if direct is not None and outcome == kernel.NO_WAY else _OUTCOMES[outcome]
        return LatticeWay(ended, direct, direct_cost, expanded, to_go)
    arrays = lattice.primitives.arrays
    moves, begin = kernel.trace(
        at, lattice.n_gears, space.cost_space.frame.n_cols, parent, arrays[0], arrays[1]
    )
    k = of[int(np.flatnonzero(seeds == begin)[np.argmin(seed_costs[seeds == begin])])]
    j = int(np.searchsorted(last.keys, at // lattice.n_gears))
    ends = lattice.pose(np.array([first.keys[k], last.keys[j]]))
    parts = [
        shortest_curve(first.ends[k], ends[0], space.steering).parts,
        *(lattice.primitives.parts[p] for p in moves),
        shortest_curve(ends[1], last.ends[j], space.steering).parts,
    ]
    curve = PoseCurve(first.ends[k], np.concatenate(parts)).merged()
    return LatticeWay(_OUTCOMES[outcome], curve, float(cost), expanded, to_go)


def _direct(space: PoseSpace, start: End, goal: End) -> tuple[PoseCurve | None, float]:
    # One curve from end to end; free headings face the other end.
    towards = math.atan2(goal.y - start.y, goal.x - start.x)
    a = np.array([start.x, start.y, towards if start.heading is None else start.heading])
    b = np.array([goal.x, goal.y, towards if goal.heading is None else goal.heading])
    curve = shortest_curve(a, b, space.steering).merged()
    cost = space.cost(curve)
    return (curve, cost) if math.isfinite(cost) else (None, math.inf)


def _seeds(lattice: Lattice, first: Joints) -> tuple[IntArray, FloatArray, IntArray]:
    # States, costs and joints; where the robot has not moved yet, both gears are at hand.
    of = np.arange(len(first.keys))
    if lattice.n_gears == 1:
        return first.keys, first.costs, of
    ahead, back = of[first.gears >= 0], of[first.gears <= 0]
    keys = np.concatenate([2 * first.keys[ahead], 2 * first.keys[back] + 1])
    of = np.concatenate([ahead, back])
    return keys, first.costs[of], of
