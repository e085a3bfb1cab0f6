"""CasADi smoothing: from a polyline to a fast trajectory with the same safety; the only import of casadi."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from functools import lru_cache

import casadi
import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.cost_space import CostSpace
from planner.curve import Curve, check_curve, curve_through, time_curve
from planner.example_space import example_space
from planner.offsets import OffsetModel
from planner.result import Trajectory
from planner.timing import at_rest, distinct_points, require_limits, time_polyline

#: A smoothed path never costs more than this share above the polyline that it replaces.
COST_SLACK = 0.03
#: Within this share the fastest smooth path is taken; above it, where nothing is within, the cheapest.
CLOSE_SLACK = 1e-3
# A path whose pieces turn less than this against the whole is a straight line, rad.
_STRAIGHT_RAD = 1e-6
# Weights of bending that are tried, as shares of the rate at the curvature where full speed is just possible.
_BENDS = (1e-4, 1e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
_FIRST_BEND = 4
_SPACING_M = 0.25
_LEAST_SPACING_M = 0.1
_MAX_STATIONS = 1500
_SIGMA_M = 0.4
_SIGMA_AGAIN_M = 0.15
_REPAIRS = 4
# Margin added where a chord misses its clearance: this much of what misses, and a little; in forbidden cells.
_WIDEN_SHARE = 1.5
_WIDEN_M = 0.003
_WIDEN_FORBIDDEN_M = 0.01
# Lower weights are not tried when the last one saved less than this share of the cost.
_LEAST_SAVING = 2e-4
# Added to the matrix, so that directions without any cost stay where they are.
_DAMPING = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class SmoothResult:
    """Outcome of :func:`smooth`.

    Attributes
    ----------
    ok
        Whether ``trajectory`` keeps clearance, cells, cost, speed and acceleration, as verified.
    trajectory
        The smooth one; where ``ok`` is False the polyline with stops at its corners.
    reason
        Why not, in words; empty when ok.
    stats
        ``cost`` (of the polyline of the samples), ``cost_limit``, ``programmes`` (quadratic programmes
        solved), ``seconds``; what is known.
    """

    ok: bool
    trajectory: Trajectory
    reason: str = ""
    stats: dict[str, float] = field(default_factory=dict)


def smooth(
    points: npt.ArrayLike,
    cost_space: CostSpace,
    *,
    max_speed: float,
    max_accel: float,
    deadline_at: float | None = None,
    cost_limit: float | None = None,
) -> SmoothResult:
    """Round a polyline's corners and time it, where clearance, forbidden cells and cost allow.

    Stations of a smooth reference line are moved along its normals inside a corridor. What is minimised is
    ``∫ rate ds + bend ∫ κ² ds`` (and a little change of curvature), by Gauss–Newton steps, each a quadratic
    programme with bounds that CasADi's piqp solves, and then by a search on the cells' exact rates. A C²
    spline through the stations is timed exactly under ``|v| ≤ max_speed`` and ``|a| ≤ max_accel``.

    Several weights ``bend`` are tried. Of the candidates that pass the checks, the fastest that costs at most
    1.001 times the polyline is returned; where there is none, because the polyline winds through cells as no
    smooth curve can, the cheapest that costs at most 1.03 times as much.

    Parameters
    ----------
    points
        Shape (K, 2), W, m: a valid path. Its ends are kept exactly.
    cost_space
        What is allowed, and at which cost.
    max_speed, max_accel
        Limits on the length of velocity and acceleration, m/s and m/s²; at rest at both ends.
    deadline_at
        ``time.monotonic()`` after which nothing new is begun, s; None: no limit.
    cost_limit
        The smooth path may not cost more than this either.

    Returns
    -------
    result
        Verified on dense chords (2 cm): every chord's exact clearance is at least the radius (less 1 µm)
        plus the bound ``κ l²/8`` of its distance from the curve, no chord enters a forbidden cell, and the
        polyline of the trajectory's samples is itself valid and within the cost limit.

    Raises
    ------
    InvalidProblem
        If the points are not finite or of another shape, or a limit is not positive.
    """
    began = time.monotonic()
    p = distinct_points(points)
    require_limits(max_speed, max_accel)
    cost = cost_space.line_cost(p)
    if not math.isfinite(cost):
        fallback = time_polyline(p, max_speed=max_speed, max_accel=max_accel)
        return SmoothResult(ok=False, trajectory=fallback, reason="the path itself is not allowed")
    limit = min((1.0 + COST_SLACK) * cost, math.inf if cost_limit is None else cost_limit)
    deadline = math.inf if deadline_at is None else deadline_at
    close = min((1.0 + CLOSE_SLACK) * cost, limit)
    search = _Search(cost_space, max_speed, max_accel, limits=(close, limit), deadline=deadline)
    if len(p) == 1 or _is_straight(p):
        search.offer_straight(p)
    else:
        search.run(p)
    stats = {"cost_limit": limit, "programmes": search.programmes, "seconds": time.monotonic() - began}
    best = search.best
    if best is None:
        fallback = time_polyline(p, max_speed=max_speed, max_accel=max_accel)
        return SmoothResult(ok=False, trajectory=fallback, reason=search.reason, stats=stats)
    return SmoothResult(ok=True, trajectory=best.trajectory, stats=stats | {"cost": best.cost})


def warm_up() -> None:
    """Compile or load the kernels and CasADi's solver, by one small smoothing."""
    space = example_space()
    smooth([[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]], space, max_speed=1.0, max_accel=1.0)


def _is_straight(p: FloatArray) -> bool:
    way = p[-1] - p[0]
    length = math.hypot(*way)
    if length == 0.0:
        return False
    d = np.diff(p, axis=0)
    along = d @ way / length
    across = np.abs(d[:, 0] * way[1] - d[:, 1] * way[0]) / length
    return bool(np.all(across <= _STRAIGHT_RAD * along))


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A verified trajectory and the cost of the polyline of its samples."""

    trajectory: Trajectory
    cost: float


class _Search:
    """Candidates for one path and the best of them so far."""

    def __init__(
        self,
        space: CostSpace,
        max_speed: float,
        max_accel: float,
        *,
        limits: tuple[float, float],
        deadline: float,
    ) -> None:
        self.best: _Candidate | None = None
        self.reason = "the deadline came first"
        self.programmes = 0.0
        self._space = space
        self._max_speed, self._max_accel = max_speed, max_accel
        self._close, self._limit = limits
        self._deadline = deadline

    def offer_straight(self, p: FloatArray) -> None:
        """A straight path needs no smoothing."""
        ends = p[[0, -1]] if len(p) > 1 else p
        cost = self._space.line_cost(ends)
        if cost > self._limit:
            self.reason = f"the path costs {cost:.4f}, allowed is {self._limit:.4f}"
            return
        still = at_rest(p[0])
        moving = time_polyline(ends, max_speed=self._max_speed, max_accel=self._max_accel)
        self.best = _Candidate(moving if len(p) > 1 else still, cost)

    def run(self, p: FloatArray) -> None:
        """Offsets from a line beside the path, then beside the result; at last closer stations."""
        length = float(np.hypot(*np.diff(p, axis=0).T).sum())
        spacing = float(np.clip(self._space.radius, _LEAST_SPACING_M, _SPACING_M))
        spacing = max(spacing, length / _MAX_STATIONS)
        first = OffsetModel(self._space, p, spacing=spacing, sigma=_SIGMA_M, solver=_solve_box)
        unit = first.mean_rate * (self._max_speed**2 / self._max_accel) ** 2
        path = first.optimise(_BENDS[_FIRST_BEND] * unit, self._is_late)
        self.programmes += first.n_solved
        self._sweep(path, spacing, unit)
        if self.best is None and not self._is_late():
            self._sweep(p, max(_LEAST_SPACING_M, length / _MAX_STATIONS), unit)

    def _sweep(self, path: FloatArray, spacing: float, unit: float) -> None:
        """Weights of bending upwards while that helps, else downwards until one fits; then one between."""
        model = OffsetModel(self._space, path, spacing=spacing, sigma=_SIGMA_AGAIN_M, solver=_solve_box)
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
            if not improved and cost > (1.0 - _LEAST_SAVING) * before:
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
        new = _Candidate(trajectory, cost)
        if best is None or self._rank(new) < self._rank(best):
            self.best = new
            return cost <= self._close
        return False

    def _rank(self, candidate: _Candidate) -> tuple[bool, float]:
        far = candidate.cost > self._close
        return far, candidate.cost if far else candidate.trajectory.duration


class _BoxProgramme:
    """Quadratic programmes of N unknowns with bounds and a banded matrix of half-width 3."""

    def __init__(self, n: int) -> None:
        column = np.repeat(np.arange(n), 7)
        row = column + np.tile(np.arange(-3, 4), n)
        inside = (row >= 0) & (row < n)
        row, column = row[inside], column[inside]
        self._first, self._diagonal = np.minimum(row, column), np.abs(row - column)
        self._pattern = casadi.Sparsity.triplet(n, n, row.tolist(), column.tolist())
        self._no_rows = casadi.DM(0, n)
        shape = {"h": self._pattern, "a": casadi.Sparsity(0, n)}
        self._conic = casadi.conic("box", "piqp", shape, {"error_on_fail": False, "print_time": False})

    def solve(self, band: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        values = band[self._first, self._diagonal] + _DAMPING * (self._diagonal == 0)
        h = casadi.DM(self._pattern, values)
        answer = self._conic(h=h, g=slope, a=self._no_rows, lbx=low, ubx=high)
        # A failed solve still holds numbers.
        if not self._conic.stats()["success"]:
            return np.zeros(len(slope))
        return np.clip(np.asarray(answer["x"]).ravel(), low, high)


@lru_cache(maxsize=64)
def _programme(n: int) -> _BoxProgramme:
    return _BoxProgramme(n)


def _solve_box(band: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """``min ½ xᵀ H x + gᵀ x`` with ``low ≤ x ≤ high``; no move when the solver fails."""
    return _programme(len(slope)).solve(band, slope, low, high)
