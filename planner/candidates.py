"""Smooth candidates for one polyline: weights of bending tried in turn, each verified, the best kept."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from maps.arrays import FloatArray
from planner.cost_space import CostSpace
from planner.curve import Curve, check_curve, curve_through, time_curve
from planner.offsets import BoxSolver, OffsetModel
from planner.result import Trajectory
from planner.timing import at_rest, time_polyline

# A path whose pieces turn less than this against the whole is a straight line, rad.
_STRAIGHT_RAD = 1e-6
# Weights of bending that are tried, as shares of the rate at the curvature where full speed is just possible,
# or that of a circle of this radius, m, if it is narrower.
_BENDS = (1e-4, 1e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
_WIDEST_M = 2.0
_FIRST_BEND = 4
_SPACING_M = 0.25
_LEAST_SPACING_M = 0.1
_MAX_STATIONS = 1500
_SIGMA_M = 0.4
_SIGMA_AGAIN_M = 0.15
_REPAIRS = 3
# Margin added where a chord misses its clearance: this much of what misses, and a little; in forbidden cells.
_WIDEN_SHARE = 1.5
_WIDEN_M = 0.003
_WIDEN_FORBIDDEN_M = 0.01
# Lower weights are not tried when the last one saved less than this share of the cost.
_LEAST_SAVING = 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A verified trajectory and the cost of the polyline of its samples."""

    trajectory: Trajectory
    cost: float


class CandidateSearch:
    """Candidates for one path and the best of them so far.

    Parameters
    ----------
    space
        What is allowed, and at which cost.
    max_speed, max_accel
        Limits of the motion, m/s and m/s².
    limits
        Two costs: up to the first the fastest candidate counts, up to the second the cheapest.
    deadline
        ``time.monotonic()`` after which nothing new is begun, s.
    solver
        For the quadratic programmes.
    """

    def __init__(
        self,
        space: CostSpace,
        max_speed: float,
        max_accel: float,
        *,
        limits: tuple[float, float],
        deadline: float,
        solver: BoxSolver,
    ) -> None:
        self.best: Candidate | None = None
        self.reason = "the deadline came first"
        self.programmes = 0.0
        #: Shape (2,), W, m: where the last curve that failed its checks missed most; None if none did.
        self.trouble: FloatArray | None = None
        self._space = space
        self._solver = solver
        self._max_speed, self._max_accel = max_speed, max_accel
        self._close, self._limit = limits
        self._deadline = deadline

    def _straight(self, p: FloatArray) -> None:
        # A straight path needs no smoothing.
        ends = p[[0, -1]] if len(p) > 1 else p
        cost = self._space.line_cost(ends)
        if cost > self._limit:
            self.reason = f"the path costs {cost:.4f}, allowed is {self._limit:.4f}"
            return
        still = at_rest(p[0])
        moving = time_polyline(ends, max_speed=self._max_speed, max_accel=self._max_accel)
        self.best = Candidate(moving if len(p) > 1 else still, cost)

    def run(self, p: FloatArray) -> None:
        """Try offsets from a line beside the path, then beside the result; at last closer stations.

        Parameters
        ----------
        p
            Shape (K, 2), W, m: a valid path, its points distinct.
        """
        if len(p) == 1 or _is_straight(p):
            self._straight(p)
            return
        length = float(np.hypot(*np.diff(p, axis=0).T).sum())
        spacing = float(np.clip(self._space.radius, _LEAST_SPACING_M, _SPACING_M))
        spacing = max(spacing, length / _MAX_STATIONS)
        first = OffsetModel(self._space, p, spacing=spacing, sigma=_SIGMA_M, solver=self._solver)
        unit = first.mean_rate * min(self._max_speed**2 / self._max_accel, _WIDEST_M) ** 2
        path = first.optimise(_BENDS[_FIRST_BEND] * unit, self._is_late)
        self.programmes += first.n_solved
        self._sweep(path, spacing, unit)
        if self.best is None and not self._is_late():
            self._sweep(p, max(_LEAST_SPACING_M, length / _MAX_STATIONS), unit)

    def _sweep(self, path: FloatArray, spacing: float, unit: float) -> None:
        """Weights of bending upwards while that helps, else downwards until one fits; then one between."""
        model = OffsetModel(self._space, path, spacing=spacing, sigma=_SIGMA_AGAIN_M, solver=self._solver)
        last = _BENDS[_FIRST_BEND] * unit
        cost, improved = self._try_bend(model, last)
        for share in _BENDS[_FIRST_BEND + 1 :] if improved else _BENDS[_FIRST_BEND - 1 :: -1]:
            bend = share * unit
            if self._is_late():
                break
            before = cost
            cost, fits = self._try_bend(model, bend)
            if fits != improved:
                self._try_bend(model, math.sqrt(bend * last))
                break
            if not improved and not cost < (1.0 - _LEAST_SAVING) * before:
                break
            last = bend
        self.programmes += model.n_solved

    def _is_late(self) -> bool:
        return time.monotonic() >= self._deadline

    def _try_bend(self, model: OffsetModel, bend: float) -> tuple[float, bool]:
        """Optimise, repair what misses its clearance, offer the result.

        Its cost (inf when it is not valid), and whether it became the best and is close to the polyline's.
        """
        for attempt in range(1 + _REPAIRS):
            if self._is_late():
                break
            model.optimise(bend, self._is_late)
            curve = curve_through(model.polish(bend, self._is_late))
            check = check_curve(curve, self._space)
            if check.is_valid:
                return check.cost, self._offer(curve, check.cost)
            self.reason = check.complaint()
            worst = int(np.argmax(check.deficit + check.forbidden))
            self.trouble = np.asarray(curve.points[worst])
            if attempt < _REPAIRS:
                missing = np.where(
                    check.forbidden, _WIDEN_FORBIDDEN_M, np.maximum(_WIDEN_SHARE * check.deficit, 0.0)
                )
                bad = np.flatnonzero(missing > 0.0)
                model.widen(curve.s[bad] / curve.length, missing[bad] + _WIDEN_M)
        return math.inf, False

    def _offer(self, curve: Curve, cost: float) -> bool:
        """Take a valid curve if it is the best so far; whether it is, and close to the polyline's cost."""
        best = self.best
        ceiling = self._limit if best is None else max(best.cost, self._close)
        if cost > ceiling:
            self.reason = f"the smooth path costs {cost:.4f}, allowed is {ceiling:.4f}"
            return False
        trajectory = time_curve(curve, max_speed=self._max_speed, max_accel=self._max_accel)
        cost = self._space.line_cost(trajectory.points)
        if cost > self._limit:
            self.reason = f"the samples of the smooth path cost {cost:.4f}, allowed is {self._limit:.4f}"
            return False
        new = Candidate(trajectory, cost)
        if best is None or self._rank(new) < self._rank(best):
            self.best = new
            return cost <= self._close
        return False

    def _rank(self, candidate: Candidate) -> tuple[bool, float]:
        far = candidate.cost > self._close
        return far, candidate.cost if far else candidate.trajectory.duration


def _is_straight(p: FloatArray) -> bool:
    way = p[-1] - p[0]
    length = math.hypot(*way)
    if length == 0.0:
        return False
    d = np.diff(p, axis=0)
    along = d @ way / length
    across = np.abs(d[:, 0] * way[1] - d[:, 1] * way[0]) / length
    return bool(np.all(across <= _STRAIGHT_RAD * along))
