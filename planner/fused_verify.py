"""The real filter on the path that a fused search found, its zigzags drawn straight.

The search drives every corner of the grid; a robot drives lines. Here the filter of
:mod:`localization.propagation` runs along the lines that would be driven, what it says is reported, and of
several ways to draw them the best by its word is taken.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from localization.propagation import PathBelief
from maps.arrays import FloatArray, frozen
from planner.any_angle import shorten
from planner.cost_space import CostSpace
from planner.cost_to_go import CostToGo, GridGraph
from planner.fused_belief import FilterModel, FusedField
from planner.fused_judge import ROUNDING, Judge, Judged
from planner.fused_search import OPTIMISTIC_PLAY, FusedQuestion, SearchSettings, fused_path
from planner.kernels.straight_lines import line_ends
from planner.label_search import LabelPath, Stop

# Largest distance of a grid path from its lines that is tried, cells, until the bounds are kept.
_WITHIN_CELLS = (1.0, 0.5, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedPath:
    """A path by fused belief with what the filter says along it.

    Attributes
    ----------
    path
        What the search found, on the grid.
    judged
        The lines that are driven, with what the filter says along them; None without a path.
    """

    path: LabelPath
    judged: Judged | None

    @property
    def points(self) -> FloatArray:
        """Shape (M, 2), W, m: the lines that are driven; M = 0 without a path."""
        return frozen(np.empty((0, 2))) if self.judged is None else self.judged.points

    @property
    def belief(self) -> PathBelief | None:
        """The filter along them; None without a path."""
        return None if self.judged is None else self.judged.belief

    @property
    def excess(self) -> float:
        """Largest ratio of what the filter says to a bound; 0 without bounds, inf without a path."""
        return math.inf if self.judged is None else self.judged.excess

    @property
    def is_kept(self) -> bool:
        """Whether the filter keeps all bounds asked for, even if the search thought them unmet."""
        return self.judged is not None and self.judged.is_kept


def verified_path(
    graph: GridGraph,
    fused: FusedField,
    model: FilterModel,
    question: FusedQuestion,
    *,
    to_go: CostToGo | None = None,
    settings: SearchSettings | None = None,
    stop: Stop | None = None,
    deadline_at: float = math.inf,
) -> VerifiedPath:
    """Best path by fused belief, with the real filter on the lines that are driven.

    The search counts more turns than the lines have: what keeps its bounds should keep them when driven.
    Where it finds nothing, or the filter disagrees, it is repeated with turns on the grid passed over
    (``OPTIMISTIC_PLAY``), and the better of both is returned. Parameters and errors are those of
    :func:`planner.fused_search.fused_path`; after ``deadline_at``, a ``time.monotonic()``, the lines are
    those that are at hand.
    """
    flag = np.zeros(1, dtype=np.uint8) if stop is None else stop
    costs = graph.costs_to(question.goal, stop=flag) if to_go is None else to_go
    given = question.covariance
    start = fused.fix_covariance(question.start) if given is None else np.asarray(given, dtype=np.float64)
    asked = replace(question, covariance=start)
    first = settings or SearchSettings()
    judge = Judge(graph.cost_space, fused, model, asked)

    def search(chosen: SearchSettings) -> VerifiedPath:
        path = fused_path(graph, fused, model, asked, to_go=costs, settings=chosen, stop=flag)
        return VerifiedPath(path, _lines(judge, path, deadline_at) if path.has_path else None)

    found = search(first)
    if found.is_kept or found.path.status in {"no_path", "stopped"}:
        return found
    second = search(replace(first, play=OPTIMISTIC_PLAY))
    if second.judged is None or found.judged is None or not second.path.is_complete:
        return found
    return second if second.judged.is_better_than(found.judged) else found


def _lines(judge: Judge, path: LabelPath, deadline_at: float) -> Judged:
    """The best lines for a path: pulled taut, or along it, closer and closer until the filter agrees."""
    space = judge.space
    taut, _ = shorten(path.points, space, deadline_at=deadline_at)
    best = judge(taut)
    for cells in _WITHIN_CELLS:
        if (_is_as_good(best, path) and cells < _WITHIN_CELLS[0]) or time.monotonic() >= deadline_at:
            break
        lines = straight_lines(
            path.points, space, within=cells * space.frame.resolution, harms=judge.fused.harms
        )
        other = judge(lines)
        best = other if other.is_better_than(best) else best
    return best


def _is_as_good(judged: Judged, path: LabelPath) -> bool:
    """Whether the lines keep the bounds and are no worse by the objective than the search's own path."""
    if judged.worst_r95 > path.worst_r95 * (1 + ROUNDING) and len(judged.objective) > 1:
        return False
    return judged.is_kept and judged.cost <= path.cost * (1 + ROUNDING)


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
    layers = np.array(harms).reshape(len(harms), *cost_space.frame.shape)
    kept = np.empty(len(p), dtype=np.int64)
    count = line_ends(p, limit, layers, kept, *cost_space.kernel_args)
    return p[kept[:count]]
