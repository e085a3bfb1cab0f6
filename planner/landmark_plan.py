"""LandmarkPlan: when to look where along a trajectory, and what that comes to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Literal

import numpy as np

from maps.arrays import FloatArray, frozen

Kind = Literal["fix", "turning", "blind"]


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of the path on which one triplet is looked at, or none.

    Attributes
    ----------
    kind
        ``fix``: the triplet is looked at. ``turning``: the pan head turns to the next. ``blind``: neither, no
        triplet that it could be turned to in time gives a fix that is worth it.
    start, end
        Arc lengths, m.
    t_start, t_end
        Times, s.
    triplet
        Indices into ``world.landmarks``; None without a fix.
    pan_start, pan_end
        Where a pan head looks at both ends, from its zero, rad; None without one.
    pan
        ``(t, pan)`` in s and rad: where it looks from station to station; the angles between are on the way.
    mean_r95, max_r95
        Of single fixes along the stretch, m; None without a fix.
    turn_from
        The latest time at which the pan head must begin to turn to be there at ``t_start``, s; None without a
        head, without a fix, and for the first triplet, to which it is turned before the start.
    usable_after
        How much further than ``end`` the triplet still gives a fix, m.
    late_r95
        Worst r95 if the triplet is looked at for another second, m; None: no fix for a part of it, or nothing
        to be late for.
    late_blind
        How many metres more are driven without a fix if the head leaves this triplet a second later and turns
        as fast as before; None: nothing to be late for.
    """

    kind: Kind
    start: float
    end: float
    t_start: float
    t_end: float
    triplet: tuple[int, int, int] | None = None
    pan_start: float | None = None
    pan_end: float | None = None
    pan: tuple[tuple[float, float], ...] = ()
    mean_r95: float | None = None
    max_r95: float | None = None
    turn_from: float | None = None
    usable_after: float = 0.0
    late_r95: float | None = None
    late_blind: float | None = None


@dataclass(frozen=True, slots=True)
class Gap:
    """A part of the path without a fix, whatever the reason: arc lengths (m) and times (s)."""

    start: float
    end: float
    t_start: float
    t_end: float

    @property
    def metres(self) -> float:
        """Its length, m."""
        return self.end - self.start


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkPlan:
    """The schedule of a trajectory; its figures are of what is really looked at.

    Attributes
    ----------
    stretches
        In order; they cover the path.
    s, t
        Shape (K,): stations, m and s.
    r95, best_r95
        Shape (K,): with the scheduled triplet and with the best at each station, m; NaN without a fix.
    pan_rate
        Of the pan head, rad/s; inf: it turns at once, or there is none.
    """

    stretches: tuple[Stretch, ...]
    s: FloatArray
    t: FloatArray
    r95: FloatArray
    best_r95: FloatArray
    pan_rate: float = math.inf

    def __post_init__(self) -> None:
        for name in ("s", "t", "r95", "best_r95"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def fixes(self) -> tuple[Stretch, ...]:
        """Stretches on which a triplet is looked at."""
        return tuple(x for x in self.stretches if x.kind == "fix")

    @property
    def n_switches(self) -> int:
        """How often the triplet changes."""
        return sum(a.triplet != b.triplet for a, b in pairwise(self.fixes))

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Parts without a fix, in order."""
        out = []
        for is_fix, group in groupby(self.stretches, key=lambda x: x.kind == "fix"):
            parts = list(group)
            if not is_fix:
                out.append(Gap(parts[0].start, parts[-1].end, parts[0].t_start, parts[-1].t_end))
        return tuple(out)

    @property
    def blind(self) -> float:
        """Metres without a fix."""
        return sum(gap.metres for gap in self.gaps)

    @property
    def blind_seconds(self) -> float:
        """Seconds without a fix."""
        return sum(gap.t_end - gap.t_start for gap in self.gaps)

    @property
    def turning(self) -> float:
        """Metres without a fix because the pan head turns."""
        return sum(x.end - x.start for x in self.stretches if x.kind == "turning")

    @property
    def turning_seconds(self) -> float:
        """Seconds without a fix because the pan head turns."""
        return sum(x.t_end - x.t_start for x in self.stretches if x.kind == "turning")

    @property
    def unavoidable(self) -> float:
        """Metres on which no triplet at all gives a fix, however fast the head."""
        borders = np.concatenate([self.s[:1], 0.5 * (self.s[1:] + self.s[:-1]), self.s[-1:]])
        return float(np.diff(borders)[np.isnan(self.best_r95)].sum())

    @property
    def mean_r95(self) -> float | None:
        """Per metre with a fix, m; None without any."""
        metres = sum(x.end - x.start for x in self.fixes)
        if not metres > 0:
            return self.max_r95
        return sum(x.mean_r95 * (x.end - x.start) for x in self.fixes if x.mean_r95 is not None) / metres

    @property
    def max_r95(self) -> float | None:
        """The worst, m; None without a fix."""
        return max((x.max_r95 for x in self.fixes if x.max_r95 is not None), default=None)
