"""Position covariances: the one place that symmetrises, and what is read off an ellipse."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray

#: 95 % quantile of χ² with two degrees of freedom, ``-2 ln 0.05`` (MATH §2).
CHI2_95 = -2.0 * math.log(0.05)
#: An eigenvalue may be negative by so much of the larger one: rounding, single precision included.
PSD_TOLERANCE = 1e-6


def _determinant(c: FloatArray) -> FloatArray:
    """Determinant of covariances (..., 3): NaN if they are none, 0 if only rounding keeps them from it."""
    xx, xy, yy = c[..., 0], c[..., 1], c[..., 2]
    det = xx * yy - xy * xy
    trace = xx + yy
    least = -PSD_TOLERANCE * trace
    possible = (det >= least * trace) & (xx >= least) & (yy >= least) & (trace >= 0.0)
    return np.where(possible, np.maximum(det, 0.0), np.nan)


def area95(covariance: npt.ArrayLike) -> FloatArray:
    """Area of the 95 % ellipse, ``π k² √det Σ``, m².

    Parameters
    ----------
    covariance
        Shape (..., 3): xx, xy, yy, m². NaN stays NaN; what is no covariance (a negative eigenvalue beyond
        ``PSD_TOLERANCE`` of the larger one) has no ellipse: NaN too.
    """
    return np.asarray(math.pi * CHI2_95 * np.sqrt(_determinant(np.asarray(covariance, dtype=np.float64))))


def r95(covariance: npt.ArrayLike) -> FloatArray:
    """Radius of the circle with the area of the 95 % ellipse, ``√(area/π)``, m; as :func:`area95`."""
    return np.asarray(np.sqrt(area95(covariance) / math.pi))


def max_eigenvalue(covariance: npt.ArrayLike) -> FloatArray:
    """Largest eigenvalue of covariances (..., 3): xx, xy, yy; m². NaN as :func:`area95`."""
    c = np.asarray(covariance, dtype=np.float64)
    return np.asarray(np.where(np.isnan(_determinant(c)), np.nan, _largest(c)))


def _largest(c: FloatArray) -> FloatArray:
    xx, xy, yy = c[..., 0], c[..., 1], c[..., 2]
    return np.asarray(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))


def ellipse95(covariance: npt.ArrayLike) -> FloatArray:
    """Semi-axes and direction of the 95 % ellipse.

    Parameters
    ----------
    covariance
        Shape (..., 3): xx, xy, yy, m².

    Returns
    -------
    ellipse
        Shape (..., 3): semi-major axis a, semi-minor axis b (m), azimuth of a (rad in [-π/2, π/2]); all NaN
        as :func:`area95`.
    """
    c = np.asarray(covariance, dtype=np.float64)
    det = _determinant(c)
    largest = np.where(np.isnan(det), np.nan, _largest(c))
    # det / largest keeps the small eigenvalue exact where the ellipse is thin.
    smallest = np.divide(det, largest, out=np.where(np.isnan(det), det, 0.0), where=largest > 0)
    azimuth = np.where(np.isnan(det), np.nan, 0.5 * np.arctan2(2 * c[..., 1], c[..., 0] - c[..., 2]))
    k = math.sqrt(CHI2_95)
    return np.stack([k * np.sqrt(largest), k * np.sqrt(smallest), azimuth], axis=-1)


def as_matrix(covariance: npt.ArrayLike) -> FloatArray:
    """Symmetric matrices (..., 2, 2) of covariances (..., 3): xx, xy, yy."""
    c = np.asarray(covariance, dtype=np.float64)
    return np.stack([np.stack([c[..., 0], c[..., 1]], -1), np.stack([c[..., 1], c[..., 2]], -1)], -2)
