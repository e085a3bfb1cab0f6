"""Stretches of a landmark schedule: what is looked at, when the pan head turns, where there is no fix."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.arrays import BoolArray, FloatArray, IntArray, frozen
from maps.se2 import wrap
from planner.kernels.landmark_schedule import share_of_halves, turn_between
from planner.landmark_plan import Kind, Stretch

#: What "late" means, s.
LATE_S = 1.0
# Shorter is nothing, s.
_INSTANT = 1e-9
# Less is not waited for: the head turns that much slower, s.
_WAIT = 0.1

#: A look: station and candidate.
Look = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Triplets that may be looked at along a path.

    Attributes
    ----------
    s, t
        Shape (K,): stations, m and s.
    triplets
        Shape (C, 3): indices into ``world.landmarks``.
    r95, best_r95
        Shape (K, C) and (K,): of one fix, m; NaN without. The best is that of a head that turns at once.
    pan
        Shape (K, C): where a pan head looks, from its zero, rad; NaN without one or without a fix. From
        station to station it turns no faster than it can, unless it loses the three from view.
    pan_rate
        Of the head, rad/s; inf: it turns at once, or there is none.
    is_endless
        Whether the head turns all the way round: it takes the shorter way.
    """

    s: FloatArray
    t: FloatArray
    triplets: IntArray
    r95: FloatArray
    best_r95: FloatArray
    pan: FloatArray
    pan_rate: float
    is_endless: bool

    def __post_init__(self) -> None:
        for name in ("s", "t", "r95", "best_r95", "pan"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "triplets", frozen(self.triplets, dtype=np.int64))

    @property
    def borders(self) -> FloatArray:
        """Shape (K + 1,): arc lengths between which each station stands for its cell, m."""
        return np.concatenate([self.s[:1], 0.5 * (self.s[1:] + self.s[:-1]), self.s[-1:]])

    def time_at(self, s: FloatArray) -> FloatArray:
        """Times at arc lengths, s."""
        return np.asarray(np.interp(s, self.s, self.t))

    def metres(self, t_start: float, t_end: float) -> float:
        """What is driven from one time to another, m."""
        a, b = np.interp([t_start, t_end], self.t, self.s)
        return max(0.0, float(b - a))

    def seconds(self, a: Look, b: Look) -> float:
        """How long the head turns from one look to another, s."""
        return float(turn_between(self.pan[a], self.pan[b], self.is_endless)) / self.pan_rate


def stretches_of(candidates: Candidates, looks: list[Look]) -> tuple[Stretch, ...]:
    """Stretches of a schedule.

    A turn begins when the use of one triplet ends, and what is left of a gap after it is waited for with the
    head at its new angle. Where the cells without a look are too short for it, it takes the same share of the
    half cells at both sides.

    Parameters
    ----------
    candidates
        What may be looked at.
    looks
        Stations and the triplets that are looked at there, ascending; between them there is time to turn.
    """
    return _Rows(candidates).of(looks)


class _Rows:
    """The stretches of one path."""

    def __init__(self, candidates: Candidates) -> None:
        self.seen = candidates
        self.borders = candidates.borders
        self.border_times = candidates.time_at(candidates.borders)

    def of(self, looks: list[Look]) -> tuple[Stretch, ...]:
        """All stretches, in order."""
        t = self.seen.t
        runs = self._used(_runs(looks))
        if not runs:
            return (self._row("blind", float(t[0]), float(t[-1])),)
        out: list[Stretch] = []
        for number, run in enumerate(runs):
            begin, end = self._use(runs, number)
            if number == 0:
                out += self._between(float(t[0]), begin, 0.0, None, run[0])
            following = None
            if number + 1 < len(runs):
                after = self._use(runs, number + 1)
                following = (runs[number + 1][0], *after)
            before = runs[number - 1][-1] if number else None
            out.append(self._fix(run, begin, end, before, following))
            if following is not None:
                look, begin_next, _ = following
                out += self._between(end, begin_next, self.seen.seconds(run[-1], look), run[-1], look)
            else:
                out += self._between(end, float(t[-1]), 0.0, run[-1], run[-1])
        return tuple(out)

    def _used(self, runs: list[list[Look]]) -> list[list[Look]]:
        """Without those for which turning there and on leaves no time."""
        kept = list(runs)
        number = 0
        while number < len(kept):
            begin, end = self._use(kept, number)
            if end - begin <= _INSTANT and len(self.seen.s) > 1:
                del kept[number]
                number = max(0, number - 1)
            else:
                number += 1
        return kept

    def _use(self, runs: list[list[Look]], number: int) -> tuple[float, float]:
        """When a run begins and ends."""
        run, t, borders = runs[number], self.seen.t, self.border_times
        (first, _), (last, _) = run[0], run[-1]
        begin, end = float(borders[first]), float(borders[last + 1])
        if number:
            share = self._share(runs[number - 1][-1], run[0])
            begin += share * (float(t[first]) - begin)
        if number + 1 < len(runs):
            share = self._share(run[-1], runs[number + 1][0])
            end -= share * (end - float(t[last]))
        return begin, end

    def _share(self, a: Look, b: Look) -> float:
        share = share_of_halves(a[0], b[0], self.seen.seconds(a, b), self.seen.t, self.border_times)
        return min(1.0, float(share))

    def _between(
        self, t_start: float, t_end: float, seconds: float, before: Look | None, after: Look
    ) -> list[Stretch]:
        """From one use to the next: turning, then waiting."""
        out = []
        there = min(t_end, t_start + seconds)
        if t_end - there <= _WAIT:
            there = t_end
        if before is not None and seconds > _INSTANT:
            out.append(self._row("turning", t_start, there, before, after))
            t_start = there
        if t_end - t_start > _INSTANT:
            out.append(self._row("blind", t_start, t_end, after, after))
        return out

    def _row(
        self, kind: Kind, t_start: float, t_end: float, a: Look | None = None, b: Look | None = None
    ) -> Stretch:
        """A stretch without a fix."""
        start, end = np.interp([t_start, t_end], self.seen.t, self.seen.s).tolist()
        first, last = self._pan(a), self._pan(b)
        pan = () if first is None or last is None else ((t_start, first), (t_end, last))
        return Stretch(kind, start, end, t_start, t_end, None, first, last, pan)

    def _fix(
        self,
        run: list[Look],
        begin: float,
        end: float,
        before: Look | None,
        following: tuple[Look, float, float] | None,
    ) -> Stretch:
        """A stretch with a fix, from what was looked at before to what follows (with its begin and end)."""
        seen, c = self.seen, run[0][1]
        first, last = run[0][0], run[-1][0]
        r95 = seen.r95[first : last + 1, c]
        weights = self._overlap(begin, end)[first : last + 1]
        start, stop = np.interp([begin, end], seen.t, seen.s).tolist()
        pan = tuple(
            (float(t), angle)
            for t, look in zip([begin, *seen.t[first : last + 1], end], [run[0], *run, run[-1]], strict=True)
            if (angle := self._pan(look)) is not None
        )
        has_pan = len(pan) > 0
        held = self._held(run[-1])
        after = np.flatnonzero(~held[last + 1 :])
        reach = last + int(after[0]) if len(after) else len(held) - 1
        late_r95, late_blind = (
            (None, None) if following is None else self._late(run[-1], end, held, *following)
        )
        return Stretch(
            "fix",
            start,
            stop,
            begin,
            end,
            (int(seen.triplets[c, 0]), int(seen.triplets[c, 1]), int(seen.triplets[c, 2])),
            pan[0][1] if has_pan else None,
            pan[-1][1] if has_pan else None,
            pan,
            float(np.average(r95, weights=weights)) if weights.sum() > 0 else float(r95.mean()),
            float(r95.max()),
            begin - self.seen.seconds(before, run[0]) if has_pan and before is not None else None,
            max(0.0, float(seen.s[reach]) - stop),
            late_r95,
            late_blind,
        )

    def _held(self, look: Look) -> BoolArray:
        """Shape (K,): stations from the look on to which its triplet can be followed, with a fix."""
        station, c = look
        held = np.zeros(len(self.seen.s), dtype=np.bool_)
        held[: station + 1] = True
        for k in range(station + 1, len(held)):
            seconds = float(self.seen.t[k] - self.seen.t[k - 1])
            if math.isnan(self.seen.r95[k, c]) or self.seen.seconds((k - 1, c), (k, c)) > seconds + _INSTANT:
                break
            held[k] = True
        return held

    def _late(
        self, look: Look, end: float, held: BoolArray, after: Look, begin_next: float, end_next: float
    ) -> tuple[float | None, float]:
        """Worst r95 of another second on a triplet, and how many metres more there are without a fix."""
        seen = self.seen
        leave = min(end + LATE_S, float(seen.t[-1]))
        metres = self._overlap(end, leave)
        lost = float(metres[~held].sum())
        begin = max(begin_next, min(leave + self.seen.seconds(look, after), end_next))
        more = lost + seen.metres(leave, begin) - seen.metres(end, begin_next)
        values = seen.r95[metres > 0, look[1]]
        is_seen = len(values) > 0 and bool(held[metres > 0].all())
        return (float(values.max()) if is_seen else None), max(0.0, more)

    def _overlap(self, t_start: float, t_end: float) -> FloatArray:
        """Shape (K,): metres of each station's cell that are driven between two times."""
        start, end = np.interp([t_start, t_end], self.seen.t, self.seen.s)
        low, high = np.maximum(self.borders[:-1], start), np.minimum(self.borders[1:], end)
        return np.asarray(np.maximum(0.0, high - low))

    def _pan(self, look: Look | None) -> float | None:
        """Angle of the head, wrapped; None without one."""
        if look is None or math.isnan(self.seen.pan[look]):
            return None
        angle = float(self.seen.pan[look])
        return float(wrap(angle)) if self.seen.is_endless else angle


def _runs(looks: list[Look]) -> list[list[Look]]:
    """Looks at one triplet from station to station."""
    runs: list[list[Look]] = []
    for station, c in looks:
        if runs and runs[-1][-1] == (station - 1, c):
            runs[-1].append((station, c))
        else:
            runs.append([(station, c)])
    return runs
