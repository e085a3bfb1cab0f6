"""The real filter on the path that a fused search found, its zigzags drawn straight.

The search drives every corner of the grid; a robot drives lines. Here the filter of
:mod:`localization.propagation` runs along the lines that would be driven, and what it says is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from localization.propagation import PathBelief
from maps.arrays import FloatArray, frozen
from planner.cost_space import CostSpace
from planner.cost_to_go import CostToGo, GridGraph
from planner.fused_belief import FilterModel, FusedField
from planner.fused_search import OPTIMISTIC_PLAY, FusedQuestion, SearchSettings, fused_path
from planner.kernels.line_cost import motion_rate_cost
from planner.label_search import LabelPath, Stop, line_stretches
from planner.risk import collision_risk

# Largest distance of a grid path from its lines that is tried, cells, until the bounds are kept.
_WITHIN_CELLS = (1.0, 0.5, 0.0)
# Points of a grid path that one straight line may stand for.
_WINDOW = 400
# So many points in a row that do not fit end a line.
_PATIENCE = 8
# Means along a line may be larger by this than along the part of the path that it stands for.
_MORE_HARM = 1.02
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedPath:
    """A path by fused belief with what the filter says along it.

    Attributes
    ----------
    path
        What the search found, on the grid.
    points
        Shape (M, 2), W, m: the lines that are driven, within a cell of the grid path; M = 0 without a path.
    belief
        The filter along them; None without a path.
    excess
        Largest ratio of what the filter says to a bound (on lengths; of probabilities p to the bound q:
        ``√(ln q / ln p)``): at most 1 where the bounds are kept. 0 without bounds, inf without a path.
    longest_blind
        Longest stretch in cells without a fix, m.
    """

    path: LabelPath
    points: FloatArray
    belief: PathBelief | None
    excess: float
    longest_blind: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))

    @property
    def is_kept(self) -> bool:
        """Whether the filter keeps all bounds asked for, even if the search thought them unmet."""
        return self.excess <= 1.0 + _ROUNDING


def verified_path(
    graph: GridGraph,
    fused: FusedField,
    model: FilterModel,
    question: FusedQuestion,
    *,
    to_go: CostToGo | None = None,
    settings: SearchSettings | None = None,
    stop: Stop | None = None,
) -> VerifiedPath:
    """Best path by fused belief, with the real filter on the lines that are driven.

    The search counts more turns than the lines have: what keeps its bounds should keep them when driven.
    Where it finds nothing, or the filter disagrees, it is repeated with turns on the grid passed over
    (``OPTIMISTIC_PLAY``), and of both paths the one with the smaller excess over the bounds is returned.
    Parameters and errors are those of :func:`planner.fused_search.fused_path`.
    """
    flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
    costs = graph.costs_to(question.goal, stop=flag) if to_go is None else to_go
    given = question.covariance
    start = fused.fix_covariance(question.start) if given is None else np.asarray(given, dtype=np.float64)
    asked = replace(question, covariance=start)
    first = settings or SearchSettings()

    def search(chosen: SearchSettings) -> VerifiedPath:
        path = fused_path(graph, fused, model, asked, to_go=costs, settings=chosen, stop=flag)
        return _checked(graph, fused, model, asked, path)

    found = search(first)
    if found.is_kept or found.path.status in {"no_path", "stopped"}:
        return found
    second = search(replace(first, play=OPTIMISTIC_PLAY))
    return second if second.path.is_complete and second.excess < found.excess else found


def _checked(
    graph: GridGraph, fused: FusedField, model: FilterModel, question: FusedQuestion, path: LabelPath
) -> VerifiedPath:
    if not path.has_path:
        return VerifiedPath(path, np.empty((0, 2)), None, math.inf, math.inf)
    space, best = graph.cost_space, None
    for cells in _WITHIN_CELLS:
        within = cells * space.frame.resolution
        points = straight_lines(path.points, space, within=within, harms=fused.harms)
        belief = fused.along(points, np.asarray(question.covariance), model)
        blind = line_stretches(space.frame, fused.has_fix, points).longest
        found = VerifiedPath(path, points, belief, _excess(space, question, belief, blind), blind)
        if best is None or found.excess < best.excess:
            best = found
        if best.is_kept:
            break
    return best  # type: ignore[return-value]  # the loop runs


def _excess(space: CostSpace, question: FusedQuestion, belief: PathBelief, blind: float) -> float:
    """Largest ratio to a bound; see :class:`VerifiedPath`."""
    q, ratios = question, [0.0]
    if q.max_r95 is not None:
        ratios.append(float(belief.r95.max()) / q.max_r95)
    if q.max_ellipse95 is not None:
        ratios.append(float(cov.ellipse95(belief.position_covariance)[:, 0].max()) / q.max_ellipse95)
    if q.max_blind_distance is not None and blind > 0:
        ratios.append(blind / q.max_blind_distance if q.max_blind_distance > 0 else math.inf)
    if q.max_collision_probability is not None:
        ratios.append(_collision_ratio(space, belief, q.max_collision_probability))
    return max(ratios)


def _collision_ratio(space: CostSpace, belief: PathBelief, bound: float) -> float:
    """``√(ln q / ln p)`` of the largest rigorous probability p along the belief and the bound q."""
    places = belief.drive.poses[:, :2]
    risk = collision_risk(space.clearance, places, belief.position_covariance, space.radius)
    largest = float(risk.rigorous.max())
    if largest <= 0.0:
        return 0.0
    return math.inf if largest >= 1.0 else math.sqrt(math.log(bound) / math.log(largest))


def straight_lines(
    points: npt.ArrayLike,
    cost_space: CostSpace,
    *,
    within: float | None = None,
    harms: tuple[FloatArray, ...] = (),
) -> FloatArray:
    """Straight lines along a grid path: as long as they are valid and its points lie close to them.

    Parameters
    ----------
    points
        Shape (K, 2), W, m: a valid path. Its ends stay.
    cost_space
        What is allowed.
    within
        Largest distance of the path's points from their line, m; None: one cell.
    harms
        Shape (ny, nx) each: the mean of none of them along a line may be more than 2 % above that along the
        part of the path that it stands for.

    Returns
    -------
    points
        Shape (M, 2): some of the points given.
    """
    p = np.array(points, dtype=np.float64, order="C").reshape(-1, 2)
    limit = cost_space.frame.resolution if within is None else within
    transform = cost_space.transform
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(p, axis=0).T))])
    sums = [
        np.concatenate([[0.0], np.cumsum([motion_rate_cost(*a, *b, h, transform) for a, b in pairwise(p)])])
        for h in harms
    ]

    def stands_for(i: int, j: int) -> bool:
        if not (_is_close(p[i : j + 1], limit) and math.isfinite(cost_space.line_cost(p[[i, j]]))):
            return False
        more = _MORE_HARM * math.dist(p[i], p[j]) / (arc[j] - arc[i])
        return all(
            motion_rate_cost(*p[i], *p[j], h, transform) <= more * (total[j] - total[i]) + _ROUNDING
            for h, total in zip(harms, sums, strict=True)
        )

    kept, last = [0], len(p) - 1
    while kept[-1] < last:
        i = kept[-1]
        best, missed = i + 1, 0
        for j in range(i + 2, min(i + _WINDOW, last) + 1):
            if stands_for(i, j):
                best, missed = j, 0
            else:
                missed += 1
                if missed > _PATIENCE:
                    break
        kept.append(best)
    return p[kept]


def _is_close(p: FloatArray, limit: float) -> bool:
    """Whether all points (K, 2) lie within about a distance of the line from the first to the last."""
    way = p[-1] - p[0]
    length = math.hypot(*way)
    between = p[1:-1] - p[0]
    if length == 0.0:
        return False
    across = np.abs(between[:, 0] * way[1] - between[:, 1] * way[0])
    along = between @ way
    ahead = (along >= -limit * length) & (along <= (length + limit) * length)
    return bool(ahead.all()) and bool(across.max(initial=0.0) <= limit * length)
