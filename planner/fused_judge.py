"""What a filter says of a way to drive: how far it goes towards each bound, and what it costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from localization.propagation import PathBelief
from maps.arrays import FloatArray, frozen
from planner.cost_space import CostSpace
from planner.cost_to_go import Place
from planner.fused_belief import FilterModel, FusedField
from planner.fused_search import FusedQuestion
from planner.kernels.line_cost import motion_rate_cost
from planner.label_search import line_stretches
from planner.risk import collision_risk

#: Bounds may be exceeded by this share: what rounding leaves of them.
ROUNDING = 1e-6
# Worst r95 that differ by less than this count as equal, m.
_EQUAL_M = 1e-6


@dataclass(frozen=True, slots=True)
class Reached:
    """How far a way goes towards one bound.

    Attributes
    ----------
    bound
        Name of the constraint, as in answers.
    asked, value
        The bound, and the way's worst value: m, or a probability.
    ratio
        Of lengths ``value / asked``, of probabilities ``√(ln asked / ln value)``: at most 1 where it is kept.
    place, at
        Where it is worst (for ``max_blind_distance_m``: where the longest stretch begins): (x, y) in W, m,
        and metres from the start.
    """

    bound: str
    asked: float
    value: float
    ratio: float
    place: Place
    at: float

    @property
    def is_kept(self) -> bool:
        """Whether the way keeps the bound."""
        return self.ratio <= 1.0 + ROUNDING


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A way with what the filter says along it; made by :class:`Judge`.

    Attributes
    ----------
    points
        Shape (M, 2), W, m: the lines that are driven.
    belief
        The filter along them.
    along
        Shape (K,): metres driven at each station of the belief.
    cost
        ``∫ rate · (1 + weight · r95) ds``, the rate that of areas; for ``minimax`` without r95.
    reached
        One entry for each bound that is asked for.
    objective
        What is minimised, in the order of importance.
    """

    points: FloatArray
    belief: PathBelief
    along: FloatArray
    cost: float
    reached: tuple[Reached, ...]
    objective: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        object.__setattr__(self, "along", frozen(self.along))

    @property
    def excess(self) -> float:
        """Largest ratio to a bound; 0 without bounds."""
        return max((r.ratio for r in self.reached), default=0.0)

    @property
    def is_kept(self) -> bool:
        """Whether all bounds are kept."""
        return self.excess <= 1.0 + ROUNDING

    @property
    def worst_r95(self) -> float:
        """Largest r95 on the way, m."""
        return float(self.belief.r95.max())

    def is_better_than(self, other: Judged) -> bool:
        """Whether it breaks the bounds by less, or keeps them as well and is better by the objective."""
        return self._order < other._order

    @property
    def _order(self) -> tuple[float, ...]:
        return (0.0 if self.is_kept else self.excess, *self.objective)


class Judge:
    """The filter's word on ways of one question.

    Parameters
    ----------
    space
        What is allowed, at which rate per metre.
    fused, model
        Information of the fixes; motion and fix rate.
    question
        Objective, bounds and the covariance at the start, which has to be given.
    """

    def __init__(
        self, space: CostSpace, fused: FusedField, model: FilterModel, question: FusedQuestion
    ) -> None:
        self.space, self.fused, self.model, self.question = space, fused, model, question
        self._start: FloatArray = np.asarray(question.covariance, dtype=np.float64)

    def __call__(self, points: npt.ArrayLike) -> Judged:
        """Judge the lines through points (M, 2), W, m."""
        p = np.array(points, dtype=np.float64, order="C").reshape(-1, 2)
        belief = self.fused.along(p, self._start, self.model)
        at = belief.drive.poses[:, :2]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(at, axis=0).T))])
        r95, q = belief.r95, self.question
        rate, transform = self.space.rate, self.space.transform
        rates = np.array([motion_rate_cost(*a, *b, rate, transform) for a, b in pairwise(at)])
        weight = q.weight if q.objective == "weighted" else 0.0
        cost = float(rates @ (1.0 + 0.5 * weight * (r95[1:] + r95[:-1])))
        objective: tuple[float, ...] = (cost,)
        if q.objective == "minimax":
            objective = (round(float(r95.max()) / _EQUAL_M) * _EQUAL_M, cost)
        return Judged(p, belief, along, cost, self._reached(p, belief, along), objective)

    def _reached(self, points: FloatArray, belief: PathBelief, along: FloatArray) -> tuple[Reached, ...]:
        q, out = self.question, []

        def worst(name: str, asked: float, values: FloatArray) -> Reached:
            k = int(np.argmax(values))
            value = float(values[k])
            x, y = belief.drive.poses[k, :2].tolist()
            ratio = probability_ratio(value, asked) if name == _PROBABILITY else value / asked
            return Reached(name, asked, value, ratio, (x, y), float(along[k]))

        if q.max_r95 is not None:
            out.append(worst("max_r95_m", q.max_r95, belief.r95))
        if q.max_ellipse95 is not None:
            ellipse = cov.ellipse95(belief.position_covariance)[:, 0]
            out.append(worst("max_ellipse95_m", q.max_ellipse95, ellipse))
        if q.max_collision_probability is not None:
            at = belief.drive.poses[:, :2]
            risk = collision_risk(self.space.clearance, at, belief.position_covariance, self.space.radius)
            out.append(worst(_PROBABILITY, q.max_collision_probability, risk.tight))
        if q.max_blind_distance is not None:
            out.append(self._longest_blind(points, q.max_blind_distance))
        return tuple(out)

    def _longest_blind(self, points: FloatArray, asked: float) -> Reached:
        lines = line_stretches(self.space.frame, self.fused.has_fix, points)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        at = lines.longest_from
        place = (float(np.interp(at, arc, points[:, 0])), float(np.interp(at, arc, points[:, 1])))
        ratio = 0.0 if lines.longest <= ROUNDING else math.inf
        if asked > 0:
            ratio = lines.longest / asked
        return Reached("max_blind_distance_m", asked, lines.longest, ratio, place, at)


_PROBABILITY = "max_collision_probability"


def probability_ratio(value: float, bound: float) -> float:
    """``√(ln bound / ln value)``: the factor on lengths that a probability above its bound stands for."""
    if value <= 0.0:
        return 0.0
    return math.inf if value >= 1.0 else math.sqrt(math.log(bound) / math.log(value))
