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
from planner.candidates import Candidate, CandidateSearch
from planner.cost_space import CostSpace
from planner.example_space import example_space
from planner.pieces import cut_around, joined
from planner.result import Trajectory
from planner.timing import distinct_points, require_limits, time_polyline

#: A smoothed path never costs more than this share above the polyline that it replaces.
COST_SLACK = 0.03
#: Within this share the fastest smooth path is taken; above it, where nothing is within, the cheapest.
CLOSE_SLACK = 1e-3
# Where a path cannot be smoothed, this much of it to both sides of the trouble stays as it is, m.
_CUT_M = 0.5
# So many times parts of parts are cut.
_CUTS = 4
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
        Why not, or why the trajectory stops on the way; empty when it is smooth from start to goal.
    stats
        ``cost`` (of the polyline of the samples), ``cost_limit``, ``cuts`` (places that allow no smooth way:
        a metre around each is driven as it is, with stops), ``programmes`` (quadratic programmes solved),
        ``seconds``; what is known.
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
    smooth curve can, the cheapest that costs at most 1.03 times as much. Where some place allows no smooth
    way at all, as a passage without width between two forbidden cells, the path is cut there: the parts
    before and after are smoothed, half a metre to both sides stays as it is.

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
    fallback = time_polyline(p, max_speed=max_speed, max_accel=max_accel)
    if not math.isfinite(cost):
        return SmoothResult(ok=False, trajectory=fallback, reason="the path itself is not allowed")
    limit = min((1.0 + COST_SLACK) * cost, math.inf if cost_limit is None else cost_limit)
    deadline = math.inf if deadline_at is None else deadline_at
    task = _Task(cost_space, max_speed, max_accel, deadline)
    best, reason = task.solve(p, cost, limit, _CUTS)
    stats = {"cost_limit": limit, "programmes": task.programmes, "seconds": time.monotonic() - began}
    if best is None:
        return SmoothResult(ok=False, trajectory=fallback, reason=reason, stats=stats)
    stats |= {"cost": best.cost, "cuts": float(task.cuts)}
    return SmoothResult(ok=True, trajectory=best.trajectory, reason=reason, stats=stats)


def warm_up() -> None:
    """Compile or load the kernels and CasADi's solver, by one small smoothing."""
    space = example_space()
    smooth([[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]], space, max_speed=1.0, max_accel=1.0)


@dataclass(slots=True, eq=False)
class _Task:
    """A robot in a cost space, and what was done for it."""

    space: CostSpace
    max_speed: float
    max_accel: float
    deadline: float
    programmes: float = 0.0
    cuts: int = 0

    def solve(self, p: FloatArray, cost: float, limit: float, cuts_left: int) -> tuple[Candidate | None, str]:
        """The best motion along a polyline, or None; and why it is None or in pieces."""
        search = CandidateSearch(
            self.space,
            self.max_speed,
            self.max_accel,
            limits=(min((1.0 + CLOSE_SLACK) * cost, limit), limit),
            deadline=self.deadline,
            solver=_solve_box,
        )
        search.run(p)
        self.programmes += search.programmes
        if search.best is not None:
            return search.best, ""
        if search.trouble is None or cuts_left == 0:
            return None, search.reason
        before, middle, after = cut_around(p, search.trouble, _CUT_M)
        self.cuts += 1
        motions = [
            *([] if before is None else [self._part(before, cuts_left - 1)]),
            time_polyline(middle, max_speed=self.max_speed, max_accel=self.max_accel),
            *([] if after is None else [self._part(after, cuts_left - 1)]),
        ]
        whole = joined(motions)
        cost = self.space.line_cost(whole.points)
        return Candidate(whole, cost) if cost <= limit else None, search.reason

    def _part(self, p: FloatArray, cuts_left: int) -> Trajectory:
        cost = self.space.line_cost(p)
        best, _ = self.solve(p, cost, (1.0 + COST_SLACK) * cost, cuts_left)
        if best is None:
            return time_polyline(p, max_speed=self.max_speed, max_accel=self.max_accel)
        return best.trajectory


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
