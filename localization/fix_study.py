"""Fixes from the scans of a log against their reference poses: errors beside predicted covariances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from localization.consistency import nees
from localization.covariance import CHI2_95
from localization.kernels.fix import DEGENERATE
from localization.logs import BearingLog, expected_bearings
from localization.robust import GATE_SIGMAS, KEPT_VARIANCE, block_bootstrap
from localization.triangulation import locate, triangulate
from maps.arrays import FloatArray, IntArray, frozen
from maps.se2 import wrap

Choice = Literal["best", "random", "all"]
_DRAWS_PER_FIX = 40


@dataclass(frozen=True, slots=True, eq=False)
class ScanFixes:
    """One fix per scan.

    Attributes
    ----------
    error
        Shape (N, 2): fix minus reference, m; NaN where there is no fix.
    covariance
        Shape (N, 3): predicted at the reference pose, xx, xy, yy, m²; NaN where the geometry admits none.
    block
        Shape (N,): stretch of the log.
    """

    error: FloatArray
    covariance: FloatArray
    block: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "error", frozen(self.error))
        object.__setattr__(self, "covariance", frozen(self.covariance))
        object.__setattr__(self, "block", frozen(self.block, dtype=np.int64))


@dataclass(frozen=True, slots=True)
class FixSummary:
    """What scan fixes amount to.

    Attributes
    ----------
    n, n_failed
        Fixes, and scans that gave none.
    share, share_low, share_high
        Share inside the predicted 95 % ellipse, with 95 % bounds by bootstrap over the blocks.
    predicted_median, predicted_p95
        Of the distance from the truth by the predicted covariances, m.
    actual_median, actual_p95
        Of the distance from the reference, m.
    """

    n: int
    n_failed: int
    share: float
    share_low: float
    share_high: float
    predicted_median: float
    predicted_p95: float
    actual_median: float
    actual_p95: float


def scan_fixes(
    log: BearingLog,
    groups: Sequence[IntArray],
    bearings: FloatArray,
    variances: FloatArray,
    *,
    choice: Choice,
    rng: np.random.Generator,
) -> ScanFixes:
    """A fix from every scan of three or more landmarks.

    Parameters
    ----------
    log
        With reference poses.
    groups
        Scans: indices of sightings, each landmark once.
    bearings, variances
        Shape (S,): to be used, rad and rad².
    choice
        ``best``: the triplet with the smallest 95 % ellipse at the reference pose; ``random``: any triplet;
        ``all``: least squares over all bearings of the scan.
    rng
        For the random triplet.
    """
    usable = [g for g in groups if len(g) >= 3]
    reference = np.array([log.reference[g, :2].mean(axis=0) for g in usable]).reshape(-1, 2)
    block = np.array([log.block[g[0]] for g in usable], dtype=np.int64)
    error = np.full((len(usable), 2), np.nan)
    covariance = np.full((len(usable), 3), np.nan)
    places = log.landmarks.positions
    if choice == "all":
        for k, g in enumerate(usable):
            landmarks = places[log.landmark[g]]
            covariance[k] = _covariances(reference[k], landmarks[None], variances[g][None])[0]
            fix = locate(bearings[g], landmarks, np.sqrt(variances[g]))
            error[k] = fix.pose[:2] - reference[k]
        return ScanFixes(error, covariance, block)
    for size in sorted({len(g) for g in usable}):
        rows = np.array([k for k, g in enumerate(usable) if len(g) == size])
        scan = np.array([usable[k] for k in rows])
        triplets = np.array(list(itertools.combinations(range(size), 3)))
        if choice == "random":
            chosen = rng.integers(0, len(triplets), len(rows))
        else:
            sizes = np.stack(
                [
                    _determinant(reference[rows], places[log.landmark[scan[:, t]]], variances[scan[:, t]])
                    for t in triplets
                ],
                axis=1,
            )
            chosen = np.argmin(sizes, axis=1)
        picked = np.take_along_axis(scan, triplets[chosen], axis=1)
        landmarks = places[log.landmark[picked]]
        covariance[rows] = _covariances(reference[rows], landmarks, variances[picked])
        error[rows] = triangulate(bearings[picked], landmarks).pose[:, :2] - reference[rows]
    return ScanFixes(error, covariance, block)


def own_share(
    log: BearingLog, groups: Sequence[IntArray], bearings: FloatArray, variances: FloatArray
) -> float:
    """Share of the bearings' variance that is not common to a scan, without outliers.

    What all bearings of a scan have in common turns the heading of its fix and leaves the position alone.

    Parameters
    ----------
    log, groups, bearings, variances
        As for :func:`scan_fixes`; scans of two are enough. NaN if there is none.
    """
    expected, _ = expected_bearings(log.reference, log.landmarks.positions[np.maximum(log.landmark, 0)])
    x = wrap(bearings - expected) / np.sqrt(variances)
    squares, freedom = 0.0, 0
    for group in groups:
        members = x[group]
        members = members[np.abs(members) <= GATE_SIGMAS]
        if len(members) >= 2:
            squares += float(np.sum((members - members.mean()) ** 2))
            freedom += len(members) - 1
    return min(1.0, squares / freedom / KEPT_VARIANCE) if freedom else math.nan


def summarise(fixes: ScanFixes, *, rng: np.random.Generator) -> FixSummary:
    """Share inside the ellipses, and predicted beside actual quantiles of the position error.

    Parameters
    ----------
    fixes
        From :func:`scan_fixes`.
    rng
        For predicted errors (drawn from each covariance) and the bootstrap.
    """
    ok = np.isfinite(fixes.error[:, 0]) & np.isfinite(fixes.covariance[:, 0])
    n = int(np.sum(ok))
    if n == 0:
        return FixSummary(0, len(ok), *[math.nan] * 7)
    error, P = fixes.error[ok], fixes.covariance[ok]
    inside = (nees(error, P) <= CHI2_95).astype(np.float64)

    def share(weights: FloatArray) -> FloatArray:
        return np.array([np.sum(weights * inside) / np.sum(weights)])

    low, high = np.percentile(block_bootstrap(fixes.block[ok], share, rng=rng, n=500), [2.5, 97.5])
    z = rng.standard_normal((_DRAWS_PER_FIX, n, 2))
    a = np.sqrt(P[:, 0])
    b = P[:, 1] / a
    c = np.sqrt(np.maximum(P[:, 2] - b * b, 0.0))
    predicted = np.hypot(a * z[..., 0], b * z[..., 0] + c * z[..., 1])
    actual = np.hypot(error[:, 0], error[:, 1])
    p50, p95 = np.percentile(predicted, [50, 95])
    a50, a95 = np.percentile(actual, [50, 95])
    return FixSummary(
        n,
        len(ok) - n,
        float(np.mean(inside)),
        float(low),
        float(high),
        float(p50),
        float(p95),
        float(a50),
        float(a95),
    )


def _inverted(points: FloatArray, landmarks: FloatArray) -> FloatArray:
    d = landmarks - points[..., None, :]
    return np.asarray(d / np.sum(d * d, axis=-1, keepdims=True))


def _determinant(points: FloatArray, landmarks: FloatArray, variances: FloatArray) -> FloatArray:
    """Determinant (G,) of the covariance of triplets (G, 3, 2) seen from points (G, 2); inf without a fix."""
    g = _inverted(points, landmarks)
    e, f = g[:, 1] - g[:, 0], g[:, 2] - g[:, 0]
    d = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    v1, v2, v3 = variances.T
    ok = np.abs(d) > DEGENERATE * np.sum(g * g, axis=(1, 2))
    size = v1 * v2 + v1 * v3 + v2 * v3
    return np.asarray(np.divide(size, d * d, out=np.full(len(d), np.inf), where=ok))


def _covariances(points: FloatArray, landmarks: FloatArray, variances: FloatArray) -> FloatArray:
    """Covariances (G, 3): xx, xy, yy of fixes from landmarks (G, M, 2); NaN where there is none."""
    g = _inverted(np.broadcast_to(points, (len(landmarks), 2)), landmarks)
    w = 1.0 / variances
    q = np.stack([g[..., 1], -g[..., 0]], axis=-1)
    q = q - np.sum(w[..., None] * q, axis=1, keepdims=True) / np.sum(w, axis=1)[:, None, None]
    a, b, c = (np.sum(w * q[..., i] * q[..., j], axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
    size = np.sum(w * np.sum(g * g, axis=-1), axis=1)
    det = a * c - b * b
    ok = det > (DEGENERATE * size) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        out = np.stack([c / det, -b / det, a / det], axis=-1)
    return np.asarray(np.where(ok[:, None], out, np.nan))
