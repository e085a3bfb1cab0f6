"""Paths by what the filter knows: label search over (cell, covariance), so that a path may fetch a fix first.

A label is a cell with the filter's covariance of x, y and heading there, carried along the moves by the
filter's own equations (odometry out, the information of the cell's fix in, at the fix rate). Of two labels of
a cell one is kept only if it is cheaper or its uncertainty lower by some percent (augmented states, MATH §7).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from localization import covariance as cov
from localization.belief import require_covariance
from maps.arrays import FloatArray, IntArray
from planner.cost_to_go import CostToGo, GridGraph, Place
from planner.errors import InvalidProblem
from planner.fused_belief import FilterModel, FusedField, as_matrices, as_packed
from planner.kernels.belief import advance, turned
from planner.kernels.fused import (
    ANCHOR,
    BY_COST,
    BY_EXCESS,
    BY_R95,
    DIRECTION,
    DRIVEN,
    METRES,
    MOST,
    fused_labels,
)
from planner.kernels.labels import EXHAUSTED, FOUND
from planner.label_search import LabelPath, Stop, blind_lines, kept_points, longest_stretch, without_path

FusedObjective = Literal["shortest", "weighted", "minimax"]

#: Play that takes alternations of two neighbouring directions of the grid for a straight line, rad.
OPTIMISTIC_PLAY = math.pi / 8

# A bound of 0 m without a fix: what rounding leaves of it, m.
_LEAST_BLIND = 1e-6
_ROUNDING = 1e-9
# Share of the tolerance of labels in searches for the smallest bound.
_CLOSER = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class FusedQuestion:
    """What a path is wanted for, in terms of the fused belief.

    Attributes
    ----------
    start, goal
        (x, y) in W, m.
    covariance
        Shape (3, 3): belief in x, y and heading at the start; None: that of one fix there.
    heading
        Of the robot at the start, rad; None: that of the first move.
    objective, weight
        ``shortest``: the graph's own cost; ``weighted``: that times ``1 + weight · r95``; ``minimax``: the
        smallest worst r95, then the graph's cost. r95 of the fused belief, m; weight in 1/m.
    max_r95, max_ellipse95
        Never less certain than this, m; None: no bound. Hold at the start, too.
    max_collision_probability
        Of one pose, by ``exp(-c² / (2 λ_max))`` (MATH §8) with the clearance beyond the radius at the centre
        of the cell; None: no bound.
    max_blind_distance
        Longest stretch in cells without a fix, m; None: no bound.

    Raises
    ------
    InvalidProblem
        If a number is out of its range.
    """

    start: Place
    goal: Place
    covariance: FloatArray | None = None
    heading: float | None = None
    objective: FusedObjective = "shortest"
    weight: float = 0.0
    max_r95: float | None = None
    max_ellipse95: float | None = None
    max_collision_probability: float | None = None
    max_blind_distance: float | None = None

    def __post_init__(self) -> None:
        if self.objective not in {"shortest", "weighted", "minimax"}:
            raise InvalidProblem(f"The objective '{self.objective}' is unknown.")
        if not (math.isfinite(self.weight) and self.weight >= 0):
            raise InvalidProblem(f"The weight is {self.weight} 1/m; it must be at least 0 and finite.")
        for name in ("max_r95", "max_ellipse95"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InvalidProblem(f"The {name} is {value} m; it must be positive.")
        p = self.max_collision_probability
        if p is not None and not 0 < p < 1:
            raise InvalidProblem(f"The max_collision_probability is {p}; it must be between 0 and 1.")
        if self.max_blind_distance is not None and not self.max_blind_distance >= 0:
            raise InvalidProblem(
                f"The max_blind_distance is {self.max_blind_distance} m; it must be at least 0."
            )


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """How closely labels are told apart.

    Attributes
    ----------
    ratio
        A dearer label of a cell is kept if its r95, or its uncertainty with the heading's, is below this
        share of the cheaper one's; 1: if it is lower at all.
    arm
        Lever that turns the heading's uncertainty into metres when uncertainties are compared, m.
    play
        Changes of direction within this do not count as turns, rad. 0: every corner of the grid path is
        driven, which is more than a line between the grid's directions needs. :data:`OPTIMISTIC_PLAY` takes
        such lines as straight, and with them turns that the robot does make.
    max_labels
        The search gives up with more.
    """

    ratio: float = 0.97
    arm: float = 5.0
    play: float = 0.0
    max_labels: int = 5_000_000


@dataclass(frozen=True, slots=True, eq=False)
class _Bounds:
    """What the kernel keeps: r95 (m), variance per cell (n,) m², metres without a fix."""

    max_r95: float
    largest: FloatArray
    max_blind: float

    def times(self, factor: float) -> _Bounds:
        return _Bounds(self.max_r95 * factor, self.largest * factor**2, self.max_blind * factor)


def fused_path(
    graph: GridGraph,
    fused: FusedField,
    model: FilterModel,
    question: FusedQuestion,
    *,
    to_go: CostToGo | None = None,
    settings: SearchSettings | None = None,
    stop: Stop | None = None,
) -> LabelPath:
    """Best 8-connected path by the fused belief, which is carried along it.

    When the bounds cannot be kept, the path that needs the smallest common factor on all of them (on lengths;
    a probability p becomes ``p^(1/factor²)``), the cheapest such one: status ``bound_unmet``, the factor in
    ``excess``.

    Parameters
    ----------
    graph
        Of a cost space without weight, in which cells without a fix are passable.
    fused, model
        Information of the fixes, on the graph's cells; motion and fix rate.
    question
        What is wanted.
    to_go
        Cost to go of the graph to the goal, where it is at hand.
    settings, stop
        Dominance of labels; shape (1,), another thread sets it to end the search early.

    Raises
    ------
    InvalidProblem
        If no covariance is given and there is no fix at the start, or the cells differ.
    NotPositiveDefinite
        If the covariance is none.
    """
    if fused.field.frame.as_tuple() != graph.cost_space.frame.as_tuple():
        raise InvalidProblem("The field and the planning grid have different cells.")
    flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
    costs = graph.costs_to(question.goal, stop=flag) if to_go is None else to_go
    search = _FusedSearch(graph, fused, model, question, costs, settings or SearchSettings(), flag)
    if not search.is_connected:
        return without_path(is_complete=flag[0] == 0)
    bounds = search.bounds()
    if question.objective == "minimax":
        found = search.run(BY_R95, bounds)
        if found.has_path and found.status == "found":
            worst = found.worst_r95
            tight = replace(bounds, max_r95=min(bounds.max_r95, worst * (1 + _ROUNDING)))
            return search.cheaper_of(search.run(BY_COST, tight), found)
    else:
        found = search.run(BY_COST, bounds)
    if found.status != "no_path":
        return found
    least = search.run(BY_EXCESS, bounds)
    if least.status != "found":
        return least
    factor = max(search.worst, 1.0)
    if factor == 1.0:
        return least  # bounds that the coarser labels of the first search only just missed
    path = search.cheaper_of(search.run(BY_COST, bounds.times(factor * (1 + _ROUNDING))), least)
    return replace(path, status="bound_unmet", excess=factor)


class _FusedSearch:
    """One question on one graph."""

    def __init__(
        self,
        graph: GridGraph,
        fused: FusedField,
        model: FilterModel,
        question: FusedQuestion,
        to_go: CostToGo,
        settings: SearchSettings,
        stop: Stop,
    ) -> None:
        self.graph, self.question, self.to_go, self.settings, self.stop = (
            graph, question, to_go, settings, stop,
        )  # fmt: skip
        given = question.covariance
        self.first = require_covariance(
            fused.fix_covariance(question.start) if given is None else given, 3, "the start"
        )
        self.start_r95 = float(cov.r95(as_packed(self.first)[:3]))
        self.information = fused.padded
        self.blind = np.asarray(self.information[:, 5] <= 0).astype(np.uint8)
        self.noise, self.period = model.odometry.kernel_args, model.period
        self.starts, start_costs = graph.connect(question.start)
        lines = blind_lines(graph, fused.has_fix, question.start, self.starts)
        offsets = graph.centres(self.starts) - np.asarray(question.start)
        lengths = np.hypot(offsets[:, 0], offsets[:, 1])
        directions = np.where(lengths > 0, np.arctan2(offsets[:, 1], offsets[:, 0]), np.nan)
        columns = [self.starts, start_costs, lengths, directions, [v.last for v in lines]]
        self.start_rows = np.array(columns, dtype=np.float64).T.reshape(-1, 5)
        self.goal_lines = blind_lines(graph, fused.has_fix, question.goal, to_go.seeds)
        columns = [to_go.seeds, to_go.seed_costs, [v.first for v in self.goal_lines]]
        self.goal_rows = np.array(columns, dtype=np.float64).T.reshape(-1, 3)
        self.worst = math.inf

    @property
    def is_connected(self) -> bool:
        """Whether the goal can be reached at all."""
        costs = self.to_go.padded[self.starts]
        return len(costs) > 0 and bool(np.isfinite(costs).any())

    def bounds(self) -> _Bounds:
        """The question's bounds as the kernel takes them."""
        q, space = self.question, self.graph.cost_space
        largest = np.full(len(self.graph.half), np.inf)
        if q.max_ellipse95 is not None:
            largest[:] = q.max_ellipse95**2 / cov.CHI2_95
        if q.max_collision_probability is not None:
            ny, nx = space.frame.shape
            room = np.zeros((ny + 2, nx + 2))
            room[1:-1, 1:-1] = np.maximum(space.centre_clearance - space.radius, 0.0)
            largest = np.minimum(largest, room.ravel() ** 2 / (-2.0 * math.log(q.max_collision_probability)))
        blind = math.inf if q.max_blind_distance is None else max(q.max_blind_distance, _LEAST_BLIND)
        return _Bounds(math.inf if q.max_r95 is None else q.max_r95, np.maximum(largest, 1e-300), blind)

    def run(self, mode: int, bounds: _Bounds) -> LabelPath:
        """One search; ``worst`` becomes what was minimised."""
        q, s = self.question, self.settings
        kept = mode == BY_EXCESS or self.start_r95 <= bounds.max_r95 * (1 + _ROUNDING)
        if not kept:
            return without_path(is_complete=True)
        heading = math.nan if q.heading is None else q.heading
        first = np.array([*as_packed(self.first), 0.0, heading])
        # What can be reached at all is asked more closely than what it costs.
        ratio = s.ratio if mode == BY_COST else 1.0 - _CLOSER * (1.0 - s.ratio)
        weight = q.weight if q.objective == "weighted" else 0.0
        outcome, cost, self.worst, walked, labels, _ = fused_labels(
            self.graph.half, self.blind, self.graph.width, 0.5 * self.graph.cost_space.frame.resolution,
            self.information, bounds.largest, self.to_go.padded, self.start_rows, first, self.goal_rows,
            self.noise, self.period, weight, bounds.max_r95, bounds.max_blind * (1 + _ROUNDING), mode,
            ratio, s.arm, s.play, s.max_labels, self.stop,
        )  # fmt: skip
        if len(walked) == 0:
            return without_path(is_complete=outcome == EXHAUSTED)
        return self._path(walked, labels, float(cost), is_complete=outcome == FOUND)

    def cheaper_of(self, path: LabelPath, other: LabelPath) -> LabelPath:
        """The one that was found, or the cheaper of both."""
        return path if path.status == "found" and path.cost <= other.cost else other

    def _path(self, walked: IntArray, labels: FloatArray, cost: float, *, is_complete: bool) -> LabelPath:
        graph, q = self.graph, self.question
        at = int(walked[-1])
        k = int(np.argmin(np.where(self.to_go.seeds == at, self.to_go.seed_costs, np.inf)))
        way = np.asarray(q.goal) - graph.centres(walked[-1:])[0]
        d = float(np.hypot(*way))
        P, most = labels[-1, :6].copy(), 0.0
        if d > 0:
            ux, uy = way / d
            turn, _ = turned(
                math.atan2(uy, ux), labels[-1, DIRECTION], labels[-1, ANCHOR], self.settings.play
            )
            J = self.information[at]
            _, most, _ = advance(P, ux, uy, d, turn, labels[-1, DRIVEN], J, J, self.noise, self.period)
        metres = labels[:, METRES]
        last = float(metres[-1]) + self.goal_lines[k].first
        points = np.concatenate([[q.start], graph.centres(walked), [q.goal]])
        covariance = np.concatenate([[self.first], as_matrices(labels[:, :6]), as_matrices(P[None])])
        keep = kept_points(points)
        return LabelPath(
            "found" if is_complete else "stopped",
            is_complete=is_complete,
            points=points[keep],
            cost=cost,
            blind=np.concatenate([[0.0], metres, [last if self.blind[at] else 0.0]])[keep],
            longest_blind=max(longest_stretch(graph, self.blind, walked, metres), last),
            excess=1.0,
            covariance=covariance[keep],
            worst_r95=float(max(self.start_r95, labels[:, MOST].max(), most)),
        )
