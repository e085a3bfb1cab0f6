"""Position covariances: the one place that symmetrises, and what is read off an ellipse."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray

#: 95 % quantile of χ² with two degrees of freedom, ``-2 ln 0.05`` (MATH §2).
CHI2_95 = -2.0 * math.log(0.05)


def area95(covariance: npt.ArrayLike) -> FloatArray:
    """Area of the 95 % ellipse, ``π k² √det Σ``, m².

    Parameters
    ----------
    covariance
        Shape (..., 3): xx, xy, yy, m². NaN stays NaN.
    """
    c = np.asarray(covariance, dtype=np.float64)
    det = c[..., 0] * c[..., 2] - c[..., 1] ** 2
    return np.asarray(math.pi * CHI2_95 * np.sqrt(np.maximum(det, 0.0)))


def r95(covariance: npt.ArrayLike) -> FloatArray:
    """Radius of the circle with the area of the 95 % ellipse, ``√(area/π)``, m; shapes as :func:`area95`."""
    return np.asarray(np.sqrt(area95(covariance) / math.pi))


def max_eigenvalue(covariance: npt.ArrayLike) -> FloatArray:
    """Largest eigenvalue of covariances (..., 3): xx, xy, yy; m²."""
    c = np.asarray(covariance, dtype=np.float64)
    mean = 0.5 * (c[..., 0] + c[..., 2])
    return np.asarray(mean + np.hypot(0.5 * (c[..., 0] - c[..., 2]), c[..., 1]))


def ellipse95(covariance: npt.ArrayLike) -> FloatArray:
    """Semi-axes and direction of the 95 % ellipse.

    Parameters
    ----------
    covariance
        Shape (..., 3): xx, xy, yy, m².

    Returns
    -------
    ellipse
        Shape (..., 3): semi-major axis a, semi-minor axis b (m), azimuth of a (rad in [-π/2, π/2]).
    """
    c = np.asarray(covariance, dtype=np.float64)
    xx, xy, yy = c[..., 0], c[..., 1], c[..., 2]
    mean, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    largest = mean + half
    det = np.maximum(xx * yy - xy**2, 0.0)
    # det / largest keeps the small eigenvalue exact where the ellipse is thin.
    smallest = np.divide(det, largest, out=np.zeros_like(det), where=largest > 0)
    smallest = np.where(np.isnan(largest), np.nan, smallest)
    k = math.sqrt(CHI2_95)
    return np.stack([k * np.sqrt(largest), k * np.sqrt(smallest), 0.5 * np.arctan2(2 * xy, xx - yy)], axis=-1)


def as_matrix(covariance: npt.ArrayLike) -> FloatArray:
    """Symmetric matrices (..., 2, 2) of covariances (..., 3): xx, xy, yy."""
    c = np.asarray(covariance, dtype=np.float64)
    return np.stack([np.stack([c[..., 0], c[..., 1]], -1), np.stack([c[..., 1], c[..., 2]], -1)], -2)
