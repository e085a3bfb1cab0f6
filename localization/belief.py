"""What is believed about a pose: mean and covariance, and whether it is a prior, prediction or posterior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from localization.errors import LocalizationError, NotPositiveDefinite
from localization.numbers import as_numbers
from maps.arrays import FloatArray, frozen
from maps.se2 import wrap

BeliefKind = Literal["prior", "prediction", "posterior"]
_KINDS = ("prior", "prediction", "posterior")
#: Rounding allowed in the correlation matrix of a covariance that is called positive semidefinite.
PSD_TOLERANCE = 1e-9


def is_positive_semidefinite(covariance: npt.ArrayLike) -> bool:
    """Whether a matrix (n, n) is finite, symmetric and positive semidefinite, up to rounding.

    Judged by a Cholesky factorization of the correlation matrix, so that m² and rad² need no common scale.
    """
    P = np.asarray(covariance, dtype=np.float64)
    if P.ndim != 2 or P.shape[0] != P.shape[1] or not np.isfinite(P).all():
        return False
    diagonal = np.diag(P)
    if (diagonal < 0).any():
        return False
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    R = P / scale[:, None] / scale[None, :]
    if np.abs(R - R.T).max(initial=0.0) > PSD_TOLERANCE:
        return False
    try:
        np.linalg.cholesky(0.5 * (R + R.T) + PSD_TOLERANCE * np.eye(len(P)))
    except np.linalg.LinAlgError:
        return False
    return True


def require_covariance(covariance: npt.ArrayLike, n: int, what: str) -> FloatArray:
    """A symmetric copy (n, n) of a covariance.

    Raises
    ------
    NotPositiveDefinite
        If it has another shape, or is not finite, symmetric and positive semidefinite.
    """
    P = as_numbers(covariance, f"The covariance of {what}", NotPositiveDefinite)
    if P.shape != (n, n):
        raise NotPositiveDefinite(f"The covariance of {what} has shape {P.shape}; give ({n}, {n}).")
    if not is_positive_semidefinite(P):
        raise NotPositiveDefinite(
            f"The covariance of {what} is {P.tolist()}; "
            "it must be finite, symmetric and positive semidefinite."
        )
    return np.asarray(0.5 * (P + P.T))


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """Gaussian belief about the pose of the robot.

    Attributes
    ----------
    mean
        Shape (3,): x, y (m), heading (rad, wrapped), in W.
    covariance
        Shape (3, 3): of x, y and heading; m², m rad, rad².
    kind
        ``prior`` before anything, ``prediction`` after odometry, ``posterior`` after a measurement.

    Raises
    ------
    LocalizationError
        If the mean is not three finite numbers or the kind unknown.
    NotPositiveDefinite
        If the covariance is none.
    """

    mean: FloatArray
    covariance: FloatArray
    kind: BeliefKind = "prior"

    def __post_init__(self) -> None:
        mean = as_numbers(self.mean, "The mean", LocalizationError).copy()
        if mean.shape != (3,) or not np.isfinite(mean).all():
            raise LocalizationError(
                f"The mean is {self.mean!r}; it must be three finite numbers (m, m, rad)."
            )
        mean[2] = wrap(mean[2])
        if self.kind not in _KINDS:
            raise LocalizationError(f"A belief of kind {self.kind!r} is unknown; use one of {list(_KINDS)}.")
        object.__setattr__(self, "mean", frozen(mean))
        object.__setattr__(self, "covariance", frozen(require_covariance(self.covariance, 3, "a belief")))

    def __reduce__(self) -> tuple[type[PoseBelief], tuple[object, ...]]:
        return (PoseBelief, (self.mean, self.covariance, self.kind))

    @classmethod
    def from_sigmas(
        cls, mean: npt.ArrayLike, *, position: float, heading: float, kind: BeliefKind = "prior"
    ) -> PoseBelief:
        """Belief with independent errors: standard deviation per axis (m) and of the heading (rad)."""
        variances = [position**2, position**2, heading**2]
        return cls(np.asarray(mean, dtype=np.float64), np.diag(variances), kind)

    @property
    def position_covariance(self) -> FloatArray:
        """Shape (3,): xx, xy, yy, m², as :mod:`localization.covariance` takes it."""
        P = self.covariance
        return np.array([P[0, 0], P[0, 1], P[1, 1]])

    @property
    def sigma_theta(self) -> float:
        """Standard deviation of the heading, rad."""
        return float(np.sqrt(self.covariance[2, 2]))

    @property
    def area95(self) -> float:
        """Area of the 95 % ellipse of the position, m²."""
        return float(cov.area95(self.position_covariance))

    @property
    def r95(self) -> float:
        """Radius of the circle with that area, m."""
        return float(cov.r95(self.position_covariance))

    def error_of(self, pose: npt.ArrayLike) -> FloatArray:
        """Mean minus a pose (3,), heading wrapped: shape (3,), m, m, rad."""
        error = np.asarray(self.mean - np.asarray(pose, dtype=np.float64))
        error[2] = wrap(error[2])
        return error
