"""Robust statistics for calibration: weighted medians, non-negative shares of variance, block bootstrap."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import norm

from maps.arrays import BoolArray, FloatArray, IntArray

#: Residuals beyond so many sigmas are outliers.
GATE_SIGMAS = 3.0
#: Variance of a standard Gaussian cut off at the gate.
KEPT_VARIANCE = float(1.0 - 2.0 * GATE_SIGMAS * norm.pdf(GATE_SIGMAS) / (2.0 * norm.cdf(GATE_SIGMAS) - 1.0))
#: Standard deviation of a Gaussian over its median absolute deviation.
MAD_TO_SIGMA = 1.4826022185056018
#: Rounds between leaving out outliers and estimating again.
ROUNDS = 4
#: Smallest sigma that is believed, rad or m.
SIGMA_MIN = 1e-6


def shares_of_variance(
    columns: Sequence[FloatArray], squares: FloatArray, weights: FloatArray | None = None
) -> FloatArray:
    """Non-negative coefficients that explain ``squares`` (S,) by ``columns``; the best of every subset."""
    A = np.stack(list(columns), axis=1)
    W = np.ones(len(squares)) if weights is None else weights
    normal, right = (A * W[:, None]).T @ A, (A * W[:, None]).T @ squares
    best, least = np.zeros(A.shape[1]), 0.0
    for code in range(1, 2 ** A.shape[1]):
        chosen = [i for i in range(A.shape[1]) if code >> i & 1]
        part = normal[np.ix_(chosen, chosen)]
        scale = np.sqrt(np.diag(part))
        if not (scale > 0).all():
            continue
        if np.linalg.cond(part / np.outer(scale, scale)) > 1e12:
            continue
        x = np.zeros(A.shape[1])
        x[chosen] = np.linalg.solve(part, right[chosen])
        cost = float(x @ normal @ x - 2.0 * x @ right)
        if (x >= 0).all() and cost < least:
            best, least = x, cost
    return best


def robust_scale(reported: FloatArray, real: FloatArray) -> tuple[float, BoolArray]:
    """Factor from reported to real, least squares without outliers, and what was kept."""
    good = np.ones(len(real), dtype=np.bool_)
    factor = 1.0
    for _ in range(ROUNDS):
        factor = float(np.sum(reported[good] * real[good]) / np.sum(reported[good] ** 2))
        rest = real - factor * reported
        sigma = MAD_TO_SIGMA * float(np.median(np.abs(rest)))
        good = np.abs(rest) <= GATE_SIGMAS * max(sigma, SIGMA_MIN)
    return factor, good


def weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Value at which half of the weight is reached."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


def block_bootstrap(
    block: IntArray, statistic: Callable[[FloatArray], FloatArray], *, rng: np.random.Generator, n: int
) -> FloatArray:
    """Statistics (n, K) under random weights: every block counts as often as it is drawn."""
    _, number = np.unique(block, return_inverse=True)
    n_blocks = int(number.max()) + 1
    out = []
    for _ in range(n):
        times = np.bincount(rng.integers(0, n_blocks, n_blocks), minlength=n_blocks)
        out.append(statistic(times[number].astype(np.float64)))
    return np.array(out)
