"""A reference line beside a polyline, and how far a path may leave it to either side."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from maps.arrays import FloatArray, frozen
from planner.cost_space import CostSpace
from planner.kernels.corridor import corridor as search_corridor

_FINE_M = 0.05
_REACH_M = 1.5
_SEARCH_M = 0.4
# Where two halves of a station's neighbourhood agree on less than this, the station's own interval counts, m.
_LEAST_OVERLAP_M = 0.02
# Neighbouring stations stay this share of their distance apart, so that normals do not cross.
_LEAST_ADVANCE = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Corridor:
    """Stations on a reference line with the offsets that are allowed at each.

    Attributes
    ----------
    centre, normal
        Shape (N, 2): places in W, m, and unit normals to the left.
    low, anchor, high
        Shape (N,), m: ``low ≤ anchor ≤ high``; all 0 at both ends.
    """

    centre: FloatArray
    normal: FloatArray
    low: FloatArray
    anchor: FloatArray
    high: FloatArray

    def __post_init__(self) -> None:
        for name in ("centre", "normal", "low", "anchor", "high"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Points every half station of a smooth line, and where the path that it stands for lies beside it.

    Attributes
    ----------
    centre, normal
        Shape (2 N - 1, 2): places in W, m, and unit normals to the left; even rows are the stations.
    beside
        Shape (2 N - 1,), m: offset of the path from the line.
    """

    centre: FloatArray
    normal: FloatArray
    beside: FloatArray


def resample(points: FloatArray, n: int) -> FloatArray:
    """Points (n + 1, 2) at equal arc lengths along a polyline (K, 2)."""
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, s[-1], n + 1)
    return np.column_stack([np.interp(at, s, points[:, 0]), np.interp(at, s, points[:, 1])])


def reference_along(path: FloatArray, *, spacing: float, sigma: float) -> Reference:
    """A line near a path with its corners rounded.

    The path is resampled finely and averaged with a Gaussian over arc length; both ends are kept by
    point reflection.

    Parameters
    ----------
    path
        Shape (K, 2), W, m.
    spacing
        Wanted distance of the stations, m; at least four intervals are made.
    sigma
        Of the Gaussian, m.
    """
    length = float(np.hypot(*np.diff(path, axis=0).T).sum())
    n_fine = max(16, math.ceil(length / _FINE_M))
    fine = resample(path, n_fine)
    width = min(sigma / (length / n_fine), n_fine / 8.0)
    pad = min(n_fine, math.ceil(4.0 * width))
    head = 2.0 * fine[0] - fine[pad:0:-1]
    tail = 2.0 * fine[-1] - fine[-2 : -pad - 2 : -1]
    smooth = gaussian_filter1d(np.concatenate([head, fine, tail]), width, axis=0)[pad:-pad]
    smooth[0], smooth[-1] = fine[0], fine[-1]
    n = 2 * max(4, math.ceil(length / spacing))
    centre = resample(smooth, n)
    tangent = np.gradient(centre, axis=0)
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-12)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return Reference(centre, normal, _beside(centre, normal, smooth, fine, length / n_fine))


def _beside(
    centre: FloatArray, normal: FloatArray, smooth: FloatArray, fine: FloatArray, spacing: float
) -> FloatArray:
    # Where the normals meet the path: from the point of the same share of the way, one secant step each.
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(smooth, axis=0).T))])
    at = np.interp(np.linspace(0.0, s[-1], len(centre)), s, np.arange(len(fine), dtype=np.float64))
    tangent = np.column_stack([normal[:, 1], -normal[:, 0]])
    index = np.arange(len(fine), dtype=np.float64)
    for _ in range(3):
        place = np.column_stack([np.interp(at, index, fine[:, 0]), np.interp(at, index, fine[:, 1])])
        ahead = ((centre - place) * tangent).sum(axis=1)
        at = np.clip(at + ahead / spacing, 0.0, len(fine) - 1.0)
    place = np.column_stack([np.interp(at, index, fine[:, 0]), np.interp(at, index, fine[:, 1])])
    beside = ((place - centre) * normal).sum(axis=1)
    return np.asarray(np.clip(beside, -_REACH_M, _REACH_M))


def corridor_around(reference: Reference, space: CostSpace, margin: FloatArray) -> Corridor:
    """Interval of allowed offsets at every station.

    Parameters
    ----------
    reference
        2 N - 1 half stations.
    space
        What is allowed.
    margin
        Shape (N,), m: extra clearance and extra distance from forbidden cells at each station.
    """
    m = len(reference.beside)
    half = np.interp(np.arange(m) / 2.0, np.arange(len(margin)), margin)
    low, anchor, high = np.empty(m), np.empty(m), np.empty(m)
    search_corridor(
        reference.centre,
        reference.normal,
        reference.beside,
        half,
        _SEARCH_M,
        _REACH_M,
        low,
        anchor,
        high,
        *space.kernel_args,
    )
    lo, hi = low[::2].copy(), high[::2].copy()
    # The half stations before and after narrow a station's interval where something is left.
    for target, half_at in ((slice(1, None), slice(1, m, 2)), (slice(None, -1), slice(1, m, 2))):
        new_lo = np.maximum(lo[target], low[half_at])
        new_hi = np.minimum(hi[target], high[half_at])
        fits = new_hi - new_lo >= _LEAST_OVERLAP_M
        lo[target] = np.where(fits, new_lo, lo[target])
        hi[target] = np.where(fits, new_hi, hi[target])
    start = np.clip(anchor[::2], lo, hi)
    for array in (lo, start, hi):
        array[0] = array[-1] = 0.0
    centre, normal = reference.centre[::2], reference.normal[::2]
    lo, hi = _keep_normals_apart(centre, normal, lo, start, hi)
    return Corridor(centre, normal, lo, start, hi)


def _keep_normals_apart(
    centre: FloatArray, normal: FloatArray, low: FloatArray, start: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    step = np.diff(centre, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    tangent = step / np.maximum(length, 1e-12)[:, None]
    lean_a = (normal[:-1] * tangent).sum(axis=1)
    lean_b = (normal[1:] * tangent).sum(axis=1)
    for _ in range(30):
        crossing = np.zeros(len(low), dtype=np.bool_)
        for bound in (low, high):
            advance = length + bound[1:] * lean_b - bound[:-1] * lean_a
            close = advance < _LEAST_ADVANCE * length
            crossing[1:] |= close
            crossing[:-1] |= close
        if not crossing.any():
            break
        low = np.where(crossing, start + 0.85 * (low - start), low)
        high = np.where(crossing, start + 0.85 * (high - start), high)
    return low, high
