"""Robots that cannot drive sideways: shortest curves between poses, and what curves cost in a field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray, IntArray, frozen
from maps.se2 import wrap
from planner.cost_space import CostArrays, CostSpace
from planner.errors import InvalidProblem
from planner.kernels import steering as kernel

Kinematics = Literal["holonomic", "differential", "dubins", "reeds_shepp"]

#: What a robot can do, as the kernels number it. Where headings count, a holonomic robot faces its way.
KINDS: dict[str, int] = {
    "holonomic": kernel.TURNING,
    "differential": kernel.TURNING,
    "dubins": kernel.DUBINS,
    "reeds_shepp": kernel.REEDS_SHEPP,
}
# Samples of a curve lie no further apart than this, m and rad.
_STEP_M = 0.05
_STEP_RAD = 0.1


@dataclass(frozen=True, slots=True)
class Steering:
    """How a robot moves, and what its manoeuvres cost beside the way.

    Attributes
    ----------
    kinematics
        ``holonomic`` and ``differential`` drive straight and turn in place; ``dubins`` drives forwards on
        arcs; ``reeds_shepp`` backwards too.
    min_turn_radius
        Smallest radius of an arc, m; counts for the last two only.
    turn_price
        Cost of turning in place, metres per radian; 0 for a holonomic robot.
    gear_price
        Cost of a change between forwards and backwards, m.

    Raises
    ------
    InvalidProblem
        If the kind is unknown, a car has no positive radius, or a number is not finite or negative.
    """

    kinematics: Kinematics
    min_turn_radius: float = 0.0
    turn_price: float = 0.0
    gear_price: float = 0.0

    def __post_init__(self) -> None:
        if self.kinematics not in KINDS:
            raise InvalidProblem(
                f"The kinematics are '{self.kinematics}'; use one of {', '.join(map(repr, KINDS))}."
            )
        for name, unit in (("min_turn_radius", "m"), ("turn_price", "m/rad"), ("gear_price", "m")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InvalidProblem(f"The {name} is {value} {unit}; it must be finite and not negative.")
        if self.is_car and self.min_turn_radius <= 0:
            raise InvalidProblem(
                f"The min_turn_radius is {self.min_turn_radius} m; a robot with the kinematics "
                f"'{self.kinematics}' needs a positive one."
            )

    @property
    def kind(self) -> int:
        """Number of the kinematics in the kernels."""
        return KINDS[self.kinematics]

    @property
    def is_car(self) -> bool:
        """Whether the curvature is bounded."""
        return self.kind != kernel.TURNING

    @property
    def has_reverse(self) -> bool:
        """Whether it drives backwards."""
        return self.kind == kernel.REEDS_SHEPP


@dataclass(frozen=True, slots=True, eq=False)
class PoseCurve:
    """A way of arcs, straight lines and turns in place.

    Attributes
    ----------
    start
        Shape (3,): pose x, y, θ in W, m and rad.
    parts
        Shape (N, 3): signed way, m (negative: backwards), curvature, 1/m (positive: to the left), turn in
        place, rad. Either the way or the turn is 0.
    """

    start: FloatArray
    parts: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen(self.start))
        object.__setattr__(self, "parts", frozen(np.reshape(self.parts, (-1, 3))))

    @property
    def length(self) -> float:
        """Way driven, m."""
        return float(np.abs(self.parts[:, 0]).sum())

    @property
    def max_curvature(self) -> float:
        """Largest curvature, 1/m."""
        return float(np.abs(self.parts[:, 1]).max(initial=0.0))

    @property
    def turned(self) -> float:
        """Turns in place, rad."""
        return float(np.abs(self.parts[:, 2]).sum())

    @property
    def gear_changes(self) -> int:
        """How often it changes between forwards and backwards."""
        gears = np.sign(self.parts[self.parts[:, 0] != 0, 0])
        return int(np.count_nonzero(np.diff(gears)))

    def joints(self) -> FloatArray:
        """Poses (N + 1, 3) between the parts, from start to end; θ in [-π, π)."""
        poses = np.empty((len(self.parts) + 1, 6))
        kernel.sample_parts(self.start, self.parts, np.ones(len(self.parts), dtype=np.int64), poses)
        out = poses[:, :3]
        out[:, 2] = wrap(out[:, 2])
        return out

    def sample(self, step: float = _STEP_M) -> CurveSamples:
        """Poses at most ``step`` m (and 0.1 rad) apart; both ends of every part are among them."""
        way, turn = np.abs(self.parts[:, 0]), np.abs(self.parts[:, 2])
        angle = turn + way * np.abs(self.parts[:, 1])
        counts = np.maximum(np.ceil(np.maximum(way / step, angle / _STEP_RAD) - 1e-9), 1).astype(np.int64)
        table = np.empty((int(counts.sum()) + 1, 6))
        kernel.sample_parts(self.start, self.parts, counts, table)
        # A sample belongs to the part before it, the first one to the first part.
        part = table[:, 4].astype(np.int64)
        if len(self.parts) == 0:
            kappa, gear = np.zeros(1), np.ones(1, dtype=np.int64)
        else:
            kappa = self.parts[part, 1]
            gear = np.sign(self.parts[part, 0]).astype(np.int64)
        poses = table[:, :3].copy()
        poses[:, 2] = wrap(poses[:, 2])
        return CurveSamples(poses, table[:, 3], kappa, gear, part)

    def merged(self) -> PoseCurve:
        """The same with neighbouring parts of one curvature and gear, or two turns, made one."""
        out: list[FloatArray] = []
        for part in self.parts:
            if np.abs(part[[0, 2]]).max() < 1e-9:
                continue
            if out:
                last = out[-1]
                turns = last[0] == 0 and part[0] == 0
                arcs = last[0] * part[0] > 0 and abs(last[1] - part[1]) < 1e-9
                if turns or arcs:
                    out[-1] = np.array([last[0] + part[0], last[1], last[2] + part[2]])
                    continue
            out.append(part.copy())
        return PoseCurve(self.start, np.array(out).reshape(-1, 3))


@dataclass(frozen=True, slots=True, eq=False)
class CurveSamples:
    """Places along a :class:`PoseCurve`.

    Attributes
    ----------
    poses
        Shape (K, 3): x, y, θ in W, m and rad in [-π, π).
    s
        Shape (K,): way driven so far, m.
    curvature
        Shape (K,): of the part that ends or goes on there, 1/m.
    gear
        Shape (K,): 1 forwards, -1 backwards, 0 turning in place.
    part
        Shape (K,): index of the part.
    """

    poses: FloatArray
    s: FloatArray
    curvature: FloatArray
    gear: IntArray
    part: IntArray

    def __post_init__(self) -> None:
        for name in ("poses", "s", "curvature"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("gear", "part"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class PoseSpace:
    """A cost space seen by a robot with a heading.

    Attributes
    ----------
    cost_space
        Cells, clearance, radius; its rate is the smallest over the headings.
    rates
        Shape (H, ny, nx), 1/m: cost per metre at robot headings 0, 2π/H, … in W; inf: forbidden there.
    steering
        How the robot moves.
    """

    cost_space: CostSpace
    rates: FloatArray
    steering: Steering

    def __post_init__(self) -> None:
        rates = frozen(self.rates)
        if rates.ndim != 3 or len(rates) == 0 or rates.shape[1:] != self.cost_space.frame.shape:
            raise InvalidProblem(
                f"The rates have shape {rates.shape}; give (H, ny, nx) on the planning grid "
                f"{self.cost_space.frame.shape}."
            )
        # NaN fails too.
        if not bool((rates > 0).all()):
            raise InvalidProblem("A rate is not positive; every rate must be above 0 or inf.")
        object.__setattr__(self, "rates", rates)

    @property
    def kernel_args(self) -> CostArrays:
        """What the kernels take after the motion: rates, transform, need, arrays of the clearance."""
        return (self.rates, *self.cost_space.kernel_args[1:])

    def cost(self, curve: PoseCurve) -> float:
        """``∫ rate ds`` and the prices of manoeuvres; inf where the curve is not valid."""
        s = self.steering
        parts = curve.parts
        return float(
            kernel.curve_cost(
                curve.start, parts, len(parts), s.turn_price, s.gear_price, math.inf, *self.kernel_args
            )
        )

    def steer_costs(
        self, starts: npt.ArrayLike, goals: npt.ArrayLike, *, max_length: float | FloatArray = math.inf
    ) -> FloatArray:
        """Costs of shortest curves between poses (N, 3), which broadcast.

        Returns
        -------
        table
            Shape (N, 3): cost, inf where the curve is not valid or longer than ``max_length``; first and
            last gear.
        """
        a, b = np.broadcast_arrays(np.asarray(starts, dtype=np.float64), np.asarray(goals, dtype=np.float64))
        a, b = (np.ascontiguousarray(v).reshape(-1, 3) for v in (a, b))
        limits = np.ascontiguousarray(np.broadcast_to(np.asarray(max_length, dtype=np.float64), len(a)))
        out = np.empty((len(a), 3))
        s = self.steering
        kernel.steer_costs(
            s.kind, s.min_turn_radius, a, b, s.turn_price, s.gear_price, limits, out, *self.kernel_args
        )
        return out


def shortest_curve(start: npt.ArrayLike, goal: npt.ArrayLike, steering: Steering) -> PoseCurve:
    """Shortest curve between two poses where nothing is in the way.

    Parameters
    ----------
    start, goal
        Shape (3,): x, y, θ in W, m and rad.
    steering
        How the robot moves; its prices do not count.

    Raises
    ------
    InvalidProblem
        If a pose is not finite.

    Notes
    -----
    [Dub57] with the formulas of [SL01]; [RS90], all 48 words.
    """
    a, b = (np.array(v, dtype=np.float64).reshape(3) for v in (start, goal))
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise InvalidProblem(f"The poses are {a.tolist()} and {b.tolist()}; all numbers must be finite.")
    parts = np.zeros((5, 3))
    n, _ = kernel.steer(steering.kind, a, b, steering.min_turn_radius, parts)
    return PoseCurve(a, parts[:n])
