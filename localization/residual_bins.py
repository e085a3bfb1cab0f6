"""Residuals of a calibration by range or bearing: what depends on it, with confidence intervals."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from localization.robust import MAD_TO_SIGMA, weighted_median
from maps.arrays import FloatArray, IntArray

#: Fewer sightings make no bin.
MIN_PER_BIN = 10


@dataclass(frozen=True, slots=True)
class ResidualBin:
    """Residuals of sightings within one range of a quantity.

    Attributes
    ----------
    low, high
        Of the quantity, m or rad.
    n
        Sightings.
    bias, sigma
        Median and robust standard deviation, rad.
    bias_low, bias_high, sigma_low, sigma_high
        Confidence intervals by bootstrap over the blocks of the log; NaN if all sightings are of one block.
    """

    low: float
    high: float
    n: int
    bias: float
    sigma: float
    bias_low: float = math.nan
    bias_high: float = math.nan
    sigma_low: float = math.nan
    sigma_high: float = math.nan


class ResidualBins:
    """The bins of one quantity that hold enough sightings.

    Parameters
    ----------
    at
        Shape (S,): the quantity, m or rad.
    x
        Shape (S,): residuals, rad.
    edges
        Of the bins, ascending.
    block
        Shape (S,): blocks of the log.
    """

    def __init__(self, at: FloatArray, x: FloatArray, edges: Sequence[float], *, block: IntArray) -> None:
        self._x = x
        self._bins: list[tuple[float, float, IntArray]] = []
        self._single: list[bool] = []
        for low, high in itertools.pairwise(edges):
            mine = np.flatnonzero((at >= low) & (at < high))
            if len(mine) >= MIN_PER_BIN:
                self._bins.append((low, high, mine))
                self._single.append(len(np.unique(block[mine])) < 2)

    def statistics(self, weights: FloatArray) -> FloatArray:
        """Weighted median and robust sigma (2 per bin) of the residuals; NaN in a bin without weight."""
        out = np.full(2 * len(self._bins), np.nan)
        for k, (_, _, mine) in enumerate(self._bins):
            w = weights[mine]
            if w.any():
                middle = weighted_median(self._x[mine], w)
                spread = weighted_median(np.abs(self._x[mine] - middle), w)
                out[2 * k : 2 * k + 2] = middle, MAD_TO_SIGMA * spread
        return out

    def summary(self, draws: FloatArray, *, level: float) -> tuple[ResidualBin, ...]:
        """The bins, with intervals from :meth:`statistics` under random weights, shape (n, 2 per bin)."""
        tail = 100 * (0.5 - level / 2)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # no draw may have reached a bin
            low, high = np.nanpercentile(draws, [tail, 100 - tail], axis=0)
        out = []
        for k, (begin, end, mine) in enumerate(self._bins):
            x = self._x[mine]
            middle = float(np.median(x))
            sigma = MAD_TO_SIGMA * float(np.median(np.abs(x - middle)))
            bounds = [math.nan] * 4
            if not self._single[k]:
                bounds = [float(v[2 * k + i]) for i in (0, 1) for v in (low, high)]
            out.append(ResidualBin(begin, end, len(mine), middle, sigma, *bounds))
        return tuple(out)
