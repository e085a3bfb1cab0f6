"""Fig. 7 of MAS97: the best triplet with free pan against an arbitrary one in a camera forced forward."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from localization.sensors import MAS97_CAMERA
from localization.triplets import MAX_RANKED, TripletChoice, best_triplet, rank_triplets
from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.world import World

#: Ends of the diagonal path, W, m.
PATH = ((1.0, 1.0), (14.0, 14.0))
STEP_M = 0.1
N_DRIVES = 1000


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean over drives, and the bounds of the middle 90 %."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class PathStudy:
    """Two ways to choose triplets along a path of N places, the second in D drives.

    Attributes
    ----------
    points
        Shape (N, 2): W, m.
    s
        Shape (N,): length from the start, m.
    best
        Best triplet with free pan; None without a fix.
    forward
        Per place, every triplet that gives a fix in the camera forced forward, smallest ellipse first.
    drawn
        Shape (D, N): which of ``forward`` a drive takes, each with the same chance; -1 without one.
    kept
        Shape (D, N): the same for drives that draw anew only when their triplet leaves the view.
    """

    points: FloatArray
    s: FloatArray
    best: tuple[TripletChoice | None, ...]
    forward: tuple[tuple[TripletChoice, ...], ...]
    drawn: IntArray
    kept: IntArray

    def __post_init__(self) -> None:
        for name, dtype in (("points", float), ("s", float), ("drawn", np.int64), ("kept", np.int64)):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype))

    @property
    def best_areas(self) -> FloatArray:
        """Shape (N,): area of the best triplet's ellipse, m²; NaN without a fix."""
        return np.array([math.nan if c is None else c.area95 for c in self.best])

    @property
    def forward_areas(self) -> FloatArray:
        """Shape (N, K): areas of the triplets in the camera forced forward, m²; NaN beyond the last."""
        out = np.full((len(self.forward), max(1, *map(len, self.forward))), np.nan)
        for row, choices in zip(out, self.forward, strict=True):
            row[: len(choices)] = [c.area95 for c in choices]
        return out

    @property
    def compared(self) -> BoolArray:
        """Shape (N,): where both have a fix; means and worst cases are over these places."""
        return np.array([bool(c) for c in self.forward]) & np.isfinite(self.best_areas)

    @property
    def mean_best(self) -> float:
        """Mean area of the best triplet, m²."""
        return float(self.best_areas[self.compared].mean())

    @property
    def mean_best_forward(self) -> float:
        """Mean area of the best triplet that the camera forced forward sees, m²."""
        return float(self.forward_areas[self.compared, 0].mean())

    def means(self, *, kept: bool = False) -> FloatArray:
        """Shape (D,): mean area along each drive, m²."""
        return np.asarray(self._areas(kept).mean(axis=1))

    def reduction(self, *, kept: bool = False) -> Spread:
        """Mean area of a drive over that of the best triplets."""
        return spread(self.means(kept=kept) / self.mean_best)

    def worst(self, *, kept: bool = False) -> tuple[FloatArray, FloatArray]:
        """Per drive, shape (D,): its largest area, and the area of the best triplet at that place, m²."""
        areas = self._areas(kept)
        return areas.max(axis=1), self.best_areas[self.compared][areas.argmax(axis=1)]

    def typical_drive(self, *, kept: bool = False) -> int:
        """The drive whose mean area is nearest to that of all drives."""
        means = self.means(kept=kept)
        return int(np.argmin(np.abs(means - means.mean())))

    def _areas(self, kept: bool) -> FloatArray:  # noqa: FBT001
        on = np.flatnonzero(self.compared)
        choice = (self.kept if kept else self.drawn)[:, on]
        return np.asarray(self.forward_areas[on, choice])


def spread(values: FloatArray) -> Spread:
    """Mean, 5th and 95th percentile."""
    low, high = (float(v) for v in np.percentile(values, [5, 95]))
    return Spread(float(np.mean(values)), low, high)


def study_path(room: World, *, drives: int = N_DRIVES, rng: np.random.Generator) -> PathStudy:
    """Triplets along the diagonal of the room.

    Parameters
    ----------
    room
        A room whose diagonal :data:`PATH` is free.
    drives
        How many arbitrary drives to draw.
    rng
        Source of their choices.
    """
    start, end = np.array(PATH)
    length = float(np.hypot(*(end - start)))
    heading = math.atan2(*(end - start)[::-1])
    s = np.linspace(0.0, length, round(length / STEP_M) + 1)
    points = start + s[:, None] / length * (end - start)
    ahead = replace(MAS97_CAMERA, pan_min=0.0, pan_max=0.0)
    best = tuple(best_triplet(room, MAS97_CAMERA, p, heading=heading) for p in points)
    forward = tuple(tuple(rank_triplets(room, ahead, p, heading=heading, count=MAX_RANKED)) for p in points)
    drawn = _draws([len(choices) for choices in forward], drives, rng)
    return PathStudy(points, s, best, forward, drawn, _kept(forward, drawn))


def _draws(counts: Sequence[int], drives: int, rng: np.random.Generator) -> IntArray:
    """Shape (drives, len(counts)): a uniform index below each count; -1 where it is 0."""
    n = np.array(counts)
    index = np.floor(rng.random((drives, len(n))) * n).astype(np.int64)
    return np.where(n > 0, index, -1)


def _kept(forward: Sequence[Sequence[TripletChoice]], drawn: IntArray) -> IntArray:
    """Drives that stay with a triplet while it is in view and else take the one that was drawn."""
    out = np.full_like(drawn, -1)
    for row, draws in zip(out, drawn, strict=True):
        held: tuple[int, int, int] | None = None
        for place, choices in enumerate(forward):
            if not choices:
                held = None
                continue
            names = [c.triplet for c in choices]
            row[place] = names.index(held) if held in names else draws[place]
            held = names[row[place]]
    return out
