"""Corners at which a robot would stop and turn, rounded by arcs on which it drives on."""

from __future__ import annotations

import math

import numpy as np

from maps.arrays import FloatArray
from planner.steering import PoseCurve, PoseSpace

# Radii that are tried, m: the largest that fits gives the fastest motion.
_RADII = (4.0, 2.0, 1.0, 0.5, 0.25, 0.12)
# An arc may cost more than its corner by this share of the whole way: it spares a stop.
_SHARE = 0.002
# Turns closer than this to a half turn stay, rad.
_SHARPEST = math.pi - 0.2
_STRAIGHT = 1e-12


def filleted(
    curve: PoseCurve, space: PoseSpace, cost: float, *, most: float = math.inf
) -> tuple[PoseCurve, float]:
    """The way with arcs for the turns in place between straight lines, where they are valid and cheap.

    Parameters
    ----------
    curve
        Of a robot that turns in place and faces its way.
    space
        What is allowed, and what it costs.
    cost
        Of the curve.
    most
        What the answer may cost.

    Returns
    -------
    curve, cost
        The same where no corner can be rounded.
    """
    parts = curve.parts.copy()
    allowed = _SHARE * cost
    for k in range(1, len(parts) - 1):
        if not _is_corner(parts, k):
            continue
        room = min(_room(parts, k - 1), _room(parts, k + 1))
        turn = float(parts[k, 2])
        for radius in _RADII:
            cut = radius * math.tan(0.5 * abs(turn))
            if cut > room:
                continue
            tried = parts.copy()
            tried[k - 1, 0] -= cut
            tried[k + 1, 0] -= cut
            tried[k] = radius * abs(turn), math.copysign(1.0 / radius, turn), 0.0
            other = PoseCurve(curve.start, tried)
            price = space.cost(other)
            if price <= min(cost + allowed, most):
                parts, cost = tried, price
                break
    return PoseCurve(curve.start, parts).merged(), cost


def _is_corner(parts: FloatArray, k: int) -> bool:
    """Whether part k turns in place between two straight lines forwards."""
    around = parts[[k - 1, k + 1]]
    lines = bool((around[:, 0] > 0).all() and (np.abs(around[:, 1]) < _STRAIGHT).all())
    return lines and 0 < abs(parts[k, 2]) < _SHARPEST


def _room(parts: FloatArray, k: int) -> float:
    """What a corner may take of the line k: half of it where there is another corner at its other end."""
    corners = [j for j in (k - 1, k + 1) if 0 < j < len(parts) - 1 and _is_corner(parts, j)]
    return float(parts[k, 0]) / max(len(corners), 1)
