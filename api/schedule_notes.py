"""What a schedule of landmarks warns of: time without a fix that the route's own figures do not show."""

from __future__ import annotations

import math
from collections.abc import Callable

from planner.landmark_plan import Gap, LandmarkPlan

#: How many times faster a pan head is tried.
FACTORS = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
# Less than half a station's cell is no contradiction, m.
_LEAST = 0.1


def schedule_notes(
    plan: LandmarkPlan,
    number: int,
    *,
    blind: float,
    max_r95: float | None = None,
    max_blind: float | None = None,
    faster: Callable[[float], LandmarkPlan] | None = None,
) -> list[str]:
    """Warnings, in words a person can act on.

    Parameters
    ----------
    plan
        The schedule.
    number
        Of its route, from 1.
    blind
        Metres without a fix of the route's own figures, for which the camera turns at once.
    max_r95, max_blind
        Bounds that were asked for, m: r95, and the longest stretch without a fix.
    faster
        The schedule of a pan head that many times as fast: the same as that of a robot as many times slower,
        as only turns per metre count.
    """
    notes = []
    lost = plan.blind - max(blind, plan.unavoidable)
    longest = max(plan.gaps, key=lambda gap: gap.metres, default=None)
    is_over = longest is not None and max_blind is not None and longest.metres > max_blind + _LEAST
    if longest is not None and (lost > _LEAST or is_over):
        notes.append(_blind_note(plan, number, blind, longest))
        if is_over:
            notes[-1] += f" That is more than the bound of {max_blind:g} m."
        if faster is not None and math.isfinite(plan.pan_rate):
            notes[-1] += _remedy(plan, faster, max_blind)
    worst = plan.max_r95
    if max_r95 is not None and worst is not None and worst > max_r95 * (1 + 1e-6):
        at = next(x for x in plan.fixes if x.max_r95 == worst)
        notes.append(
            f"On route {number} the scheduled landmarks give r95 up to {worst:.3f} m, between {at.start:.1f} "
            f"and {at.end:.1f} m: more than the bound of {max_r95:g} m, which holds for the best ones."
        )
    return notes


def _blind_note(plan: LandmarkPlan, number: int, blind: float, longest: Gap) -> str:
    parts = []
    if plan.turning >= _LEAST / 2:
        parts.append(f"{plan.turning:.1f} m ({plan.turning_seconds:.1f} s) while its pan head turns")
    if (rest := plan.blind - plan.turning) >= _LEAST / 2:
        parts.append(f"{rest:.1f} m with no three landmarks in reach that are worth it")
    who, but = "the robot", ""
    if math.isfinite(plan.pan_rate):
        who = f"a camera that pans at {math.degrees(plan.pan_rate):g}°/s"
        but = ", as if it turned at once"
    return (
        f"On route {number} {who} is without a fix for {plan.blind:.1f} m ({plan.blind_seconds:.1f} s): "
        f"{', '.join(parts)}. The figures of the route say {blind:.1f} m{but}. The longest part is "
        f"{longest.metres:.1f} m, from {longest.start:.1f} to {longest.end:.1f} m ({longest.t_start:.1f} to "
        f"{longest.t_end:.1f} s)."
    )


def _remedy(plan: LandmarkPlan, faster: Callable[[float], LandmarkPlan], max_blind: float | None) -> str:
    """How much faster the head must be to halve what is lost, and to keep the bound."""
    lost = plan.blind - plan.unavoidable
    for factor in FACTORS:
        other = faster(factor)
        longest = max((gap.metres for gap in other.gaps), default=0.0)
        if other.blind - other.unavoidable > 0.5 * lost:
            continue
        if max_blind is None or longest <= max_blind + _LEAST:
            rate = math.degrees(plan.pan_rate * factor)
            speed = 100 / factor
            return f" At {rate:.3g}°/s, or at {speed:.3g} % of the speed, {other.blind:.1f} m would be left."
    return f" A pan head {FACTORS[-1]:g} times as fast would not do either."
