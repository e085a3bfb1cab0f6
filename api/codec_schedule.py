"""Schedules of landmarks as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planner.landmark_plan import LandmarkPlan, Stretch

_DIGITS = 9


def schedule_to_json(plan: LandmarkPlan, names: Sequence[str]) -> list[dict[str, Any]]:
    """Stretches of a schedule in order, with the landmarks' ids; places in nanometres.

    Parameters
    ----------
    plan
        The schedule of a route.
    names
        Ids of the world's landmarks.
    """
    return [_stretch(stretch, names) for stretch in plan.stretches]


def schedule_figures(plan: LandmarkPlan) -> dict[str, Any]:
    """What a schedule comes to: switches, r95 of what is looked at, metres and seconds without a fix."""
    return {
        "switches": plan.n_switches,
        "mean_r95_m": _rounded(plan.mean_r95),
        "max_r95_m": _rounded(plan.max_r95),
        "blind_m": _rounded(plan.blind),
        "blind_s": _rounded(plan.blind_seconds),
        "turning_m": _rounded(plan.turning),
        "turning_s": _rounded(plan.turning_seconds),
        "longest_blind_m": _rounded(max((gap.metres for gap in plan.gaps), default=0.0)),
        "pan_rate_rad_s": _rounded(plan.pan_rate) if math.isfinite(plan.pan_rate) else None,
    }


def _stretch(stretch: Stretch, names: Sequence[str]) -> dict[str, Any]:
    triplet = stretch.triplet
    return {
        "kind": stretch.kind,
        "s_start_m": _rounded(stretch.start),
        "s_end_m": _rounded(stretch.end),
        "t_start_s": _rounded(stretch.t_start),
        "t_end_s": _rounded(stretch.t_end),
        "triplet": None if triplet is None else [names[k] for k in triplet],
        "pan_start_rad": _rounded(stretch.pan_start),
        "pan_end_rad": _rounded(stretch.pan_end),
        "pan": [{"t_s": _rounded(t), "pan_rad": _rounded(pan)} for t, pan in stretch.pan],
        "mean_r95_m": _rounded(stretch.mean_r95),
        "max_r95_m": _rounded(stretch.max_r95),
        "turn_from_s": _rounded(stretch.turn_from),
        "usable_after_m": _rounded(stretch.usable_after),
        "late_r95_m": _rounded(stretch.late_r95),
        "late_blind_m": _rounded(stretch.late_blind),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, _DIGITS)
