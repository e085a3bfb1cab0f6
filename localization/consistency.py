"""Whether covariances keep their word: NEES and coverage, each with the bounds that chance allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import beta, chi2

from localization.errors import LocalizationError
from maps.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Coverage:
    """Share of errors inside their predicted regions.

    Attributes
    ----------
    inside, n
        How many of how many.
    low, high
        Confidence bounds of the share (Clopper and Pearson), for independent errors.
    level
        Of the confidence.
    """

    inside: int
    n: int
    low: float
    high: float
    level: float

    @property
    def share(self) -> float:
        """``inside / n``; NaN without errors."""
        return self.inside / self.n if self.n else math.nan

    def allows(self, probability: float) -> bool:
        """Whether the region may have this probability."""
        return self.low <= probability <= self.high


@dataclass(frozen=True, slots=True)
class MeanNees:
    """Mean of normalised estimation errors squared, and where it should be.

    Attributes
    ----------
    value
        The mean; NaN without errors.
    low, high
        Bounds for a consistent filter with independent errors.
    n, dof
        How many errors of how many numbers each.
    """

    value: float
    low: float
    high: float
    n: int
    dof: int

    @property
    def is_consistent(self) -> bool:
        """Whether the mean lies within the bounds."""
        return self.low <= self.value <= self.high


def nees(errors: npt.ArrayLike, covariances: npt.ArrayLike) -> FloatArray:
    """Normalised errors squared ``eᵀ P⁻¹ e``: χ² with n degrees of freedom if the covariances are true.

    Parameters
    ----------
    errors
        Shape (N, n); angles wrapped by the caller.
    covariances
        Shape (N, n, n), or (N, 3) as xx, xy, yy for n = 2.

    Returns
    -------
    nees
        Shape (N,). NaN where an error or covariance is NaN; inf where the covariance is not positive
        definite.

    Raises
    ------
    LocalizationError
        If the shapes do not fit.
    """
    e = np.asarray(errors, dtype=np.float64)
    P = np.asarray(covariances, dtype=np.float64)
    if e.ndim == 2 and e.shape[1] == 2 and P.shape == (len(e), 3):
        P = P[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    if e.ndim != 2 or P.shape != (*e.shape, e.shape[1]):
        raise LocalizationError(f"Errors {e.shape} and covariances {P.shape}; give (N, n) and (N, n, n).")
    out = np.full(len(e), np.nan)
    for i in np.flatnonzero(np.isfinite(e).all(axis=1) & np.isfinite(P).all(axis=(1, 2))):
        diagonal = np.diag(P[i])
        out[i] = math.inf
        if (diagonal > 0).all():
            scale = np.sqrt(diagonal)
            try:
                L = np.linalg.cholesky(P[i] / scale[:, None] / scale[None, :])
            except np.linalg.LinAlgError:
                continue
            white = np.linalg.solve(L, e[i] / scale)
            out[i] = white @ white
    return out


def mean_nees(values: npt.ArrayLike, dof: int, *, level: float = 0.95) -> MeanNees:
    """Mean of NEES values (N,) and where ``level`` of such means lie; NaN values are left out."""
    v = np.asarray(values, dtype=np.float64)
    v = v[~np.isnan(v)]
    n = len(v)
    if n == 0:
        return MeanNees(math.nan, math.nan, math.nan, 0, dof)
    low, high = chi2.ppf([0.5 - level / 2, 0.5 + level / 2], n * dof) / n
    return MeanNees(float(np.mean(v)), float(low), float(high), n, dof)


def coverage(values: npt.ArrayLike, dof: int, *, probability: float = 0.95, level: float = 0.95) -> Coverage:
    """Share of NEES values (N,) within the χ² quantile of ``probability``; NaN values are left out.

    Parameters
    ----------
    values
        From :func:`nees`.
    dof
        Numbers per error: 2 for positions, 3 for poses.
    probability
        Of the predicted region: 0.95 for the 95 % ellipse.
    level
        Of the confidence bounds.
    """
    v = np.asarray(values, dtype=np.float64)
    v = v[~np.isnan(v)]
    inside = int(np.sum(v <= chi2.ppf(probability, dof)))
    low, high = share_bounds(inside, len(v), level=level)
    return Coverage(inside, len(v), low, high, level)


def share_bounds(inside: int, n: int, *, level: float = 0.95) -> tuple[float, float]:
    """Bounds of Clopper and Pearson for a share of ``inside`` in ``n``; (0, 1) without trials."""
    tail = 0.5 - level / 2
    low = 0.0 if inside == 0 else float(beta.ppf(tail, inside, n - inside + 1))
    high = 1.0 if inside == n else float(beta.ppf(1 - tail, inside + 1, n - inside))
    return low, high
