"""A path as sideways offsets from a reference line: its cost, and Gauss–Newton steps inside the corridor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maps.arrays import FloatArray
from planner.corridor import corridor_around, reference_along
from planner.cost_space import CostSpace
from planner.kernels.offsets import path_cost, place, quadratic_model, rate_along_normals, relax, turns

#: ``min ½ xᵀ H x + gᵀ x``, ``low ≤ x ≤ high``: takes H as diagonals (N, 4), ``[i, k]`` = H[i, i + k], then g,
#: low and high (N,).
BoxSolver = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]

# Weight of the change of curvature, as a share of that of bending times m².
_TWIST = 0.06
_MARGIN_M = 0.002
_TRUST_M = 0.5
_STEPS = 8
_SHRINK = 0.4
_TRIALS = 4
# A step that gains less than this share of the cost is the last.
_SETTLED = 1e-5
_LEAST_SPREAD_M = 0.1
# Humps of 2 h + 1 stations that are moved sideways, wide ones first, by so many metres.
_HUMPS = (4, 2, 1)
_SHIFTS_M = np.array([0.06, -0.06, 0.02, -0.02])


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """A path of N stations and what its cost is made of."""

    points: FloatArray
    chord: FloatArray
    kappa: FloatArray
    rates: FloatArray
    cost: float


class OffsetModel:
    """Stations beside a path, their corridor, and the offsets that are being improved.

    Parameters
    ----------
    space
        What is allowed, and at which cost.
    path
        Shape (K, 2), W, m: lies in what is allowed.
    spacing
        Of the stations, m.
    sigma
        Of the smoothing that makes the reference line, m.
    solver
        For the quadratic programmes.
    """

    def __init__(
        self, space: CostSpace, path: FloatArray, *, spacing: float, sigma: float, solver: BoxSolver
    ) -> None:
        self._space = space
        self._solver = solver
        self._rate, self._transform = space.kernel_args[:2]
        self._reference = reference_along(path, spacing=spacing, sigma=sigma)
        self._margin = np.full((len(self._reference.beside) + 1) // 2, _MARGIN_M)
        self._corridor = corridor_around(self._reference, space, self._margin)
        self._step_m = float(np.hypot(*(self._corridor.centre[1] - self._corridor.centre[0])))
        self.offset: FloatArray = self._corridor.anchor.copy()
        #: Quadratic programmes solved so far.
        self.n_solved = 0

    @property
    def n_stations(self) -> int:
        """Number of stations, both ends included."""
        return len(self._margin)

    @property
    def mean_rate(self) -> float:
        """Mean cost per metre at the stations, 1/m."""
        return float(self._rates(self.offset)[:, 0].mean())

    def widen(self, where: FloatArray, more: FloatArray) -> None:
        """Ask for more margin around places along the path and search the corridor again.

        Parameters
        ----------
        where
            Shape (M,): shares of the way in [0, 1].
        more
            Shape (M,): margin to add there, m; the largest counts where several meet.
        """
        n = self.n_stations
        added = np.zeros(n)
        first = np.floor(where * (n - 1)).astype(np.int64) - 1
        for shift in range(4):
            np.maximum.at(added, np.clip(first + shift, 0, n - 1), more)
        self._margin = self._margin + added
        self._corridor = corridor_around(self._reference, self._space, self._margin)
        self.offset = np.clip(self.offset, self._corridor.low, self._corridor.high)

    def optimise(self, bend: float, is_late: Callable[[], bool] = lambda: False) -> FloatArray:
        """Improve the offsets by steps with a box of trust and a line search.

        Parameters
        ----------
        bend
            Weight of ``∫ κ² ds``, m.
        is_late
            Asked before every step; when True the best so far stands.

        Returns
        -------
        points
            Shape (N, 2), W, m: the stations' places.
        """
        state = self._evaluate(self.offset, bend)
        trust = _TRUST_M
        for _ in range(_STEPS):
            if is_late():
                break
            move = self._move(state, bend, trust)
            share = 1.0
            trial = self._evaluate(self.offset + move, bend)
            for _ in range(_TRIALS - 1):
                if trial.cost < state.cost:
                    break
                share *= _SHRINK
                trial = self._evaluate(self.offset + share * move, bend)
            gain = state.cost - trial.cost
            if gain <= 0.0:
                break
            self.offset = self.offset + share * move
            state = trial
            trust *= 1.5 if share == 1.0 else 0.5
            if gain < _SETTLED * state.cost:
                break
        return state.points

    def polish(self, bend: float, is_late: Callable[[], bool] = lambda: False) -> FloatArray:
        """Improve the offsets by the exact cost of the cells, which the smooth model of the rate only nears.

        Humps of some stations are moved sideways wherever that lowers ``∫ rate ds + bend ∫ κ² ds``.

        Parameters
        ----------
        bend, is_late
            As for :meth:`optimise`.

        Returns
        -------
        points
            Shape (N, 2), W, m: the stations' places.
        """
        c = self._corridor
        points = np.empty_like(c.centre)
        offset = self.offset.copy()
        place(c.centre, c.normal, offset, points)
        for half in _HUMPS:
            if is_late():
                break
            relax(
                c.centre,
                c.normal,
                c.low,
                c.high,
                _SHIFTS_M,
                half,
                bend,
                _TWIST * bend,
                self._step_m,
                offset,
                points,
                self._rate,
                self._transform,
            )
        self.offset = offset
        return points

    def _rates(self, offset: FloatArray) -> FloatArray:
        out = np.empty((len(offset), 3))
        spread = max(_LEAST_SPREAD_M, self._space.frame.resolution)
        c = self._corridor
        rate_along_normals(c.centre, c.normal, offset, spread, out, self._rate, self._transform)
        return out

    def _evaluate(self, offset: FloatArray, bend: float) -> _State:
        n = len(offset)
        points, chord, kappa = np.empty((n, 2)), np.empty(n - 1), np.empty(n)
        place(self._corridor.centre, self._corridor.normal, offset, points)
        turns(points, chord, kappa)
        rates = self._rates(offset)
        return _State(
            points,
            chord,
            kappa,
            rates,
            float(path_cost(chord, kappa, rates, bend, _TWIST * bend, self._step_m)),
        )

    def _move(self, state: _State, bend: float, trust: float) -> FloatArray:
        n = self.n_stations
        slope, band, rows = np.empty(n), np.empty((n, 4)), np.empty((n, 4))
        c = self._corridor
        quadratic_model(
            state.points,
            c.normal,
            state.chord,
            state.kappa,
            state.rates,
            bend,
            _TWIST * bend,
            self._step_m,
            slope,
            band,
            rows,
        )
        low = np.clip(c.low - self.offset, -trust, 0.0)
        high = np.clip(c.high - self.offset, 0.0, trust)
        self.n_solved += 1
        return self._solver(band, slope, low, high)
