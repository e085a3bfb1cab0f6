"""Extended Kalman filter of a pose: predict with odometry, update with bearings or with a fix."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from localization.belief import PoseBelief, require_covariance
from localization.errors import LocalizationError, NotPositiveDefinite
from localization.kernels import ekf as kernel
from localization.motion import OdometryModel, check_increment
from localization.numbers import as_numbers
from localization.sensors import CENTRE, Mount
from maps.arrays import BoolArray, FloatArray, frozen
from maps.se2 import wrap

#: Larger sigmas (rad, m) say nothing, and their squares would leave the range of numbers.
MAX_SIGMA = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class Update:
    """A belief after measurements, and how well they agreed with it.

    Attributes
    ----------
    posterior
        The belief with every accepted measurement.
    innovations
        Measurement minus prediction: shape (M,) rad for bearings, (2,) or (3,) m, m, rad for a fix.
    normalised
        Innovation² over its predicted variance, χ² if consistent: shape (M,) with one degree of freedom each
        for bearings; shape (1,) with as many as the fix has numbers.
    accepted
        As ``normalised``: whether it was within the gate. A rejected measurement changes nothing.
    """

    posterior: PoseBelief
    innovations: FloatArray
    normalised: FloatArray
    accepted: BoolArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "innovations", frozen(self.innovations))
        object.__setattr__(self, "normalised", frozen(self.normalised))
        object.__setattr__(self, "accepted", frozen(self.accepted, dtype=np.bool_))


def gate_quantile(gate: float | None, dof: int) -> float:
    """χ² quantile of a gate (probability that a good measurement passes); inf for ``None``.

    Raises
    ------
    LocalizationError
        If the probability is not between 0 and 1.
    """
    if gate is None:
        return math.inf
    if not 0 < gate < 1:
        raise LocalizationError(f"Gate is {gate}; give a probability between 0 and 1, like 0.999, or None.")
    return float(chi2.ppf(gate, dof))


def predict(belief: PoseBelief, motion: OdometryModel, *, distance: float, turn: float) -> PoseBelief:
    """Belief after the odometry reported an arc: ``P' = F P Fᵀ + Q``.

    Parameters
    ----------
    belief
        Before the step.
    motion
        Noise of the odometry.
    distance, turn
        What it reported, m and rad.

    Raises
    ------
    LocalizationError
        If a number is not finite.
    """
    check_increment(distance, turn)
    mean, P = belief.mean.copy(), belief.covariance.copy()
    kernel.predict(mean, P, float(distance), float(turn), motion.kernel_args)
    return PoseBelief(mean, P, "prediction")


def update_with_bearings(
    belief: PoseBelief,
    bearings: npt.ArrayLike,
    landmarks: npt.ArrayLike,
    *,
    sigma: npt.ArrayLike,
    survey_sigma: npt.ArrayLike = 0.0,
    gate: float | None = None,
    mount: Mount = CENTRE,
) -> Update:
    """Belief after bearings of known landmarks, as one joint update in Joseph form.

    Parameters
    ----------
    belief
        Before the measurement.
    bearings
        Shape (M,): rad, from the sensor's zero, counter-clockwise. NaN is a missing measurement.
    landmarks
        Shape (M, 2): where the landmarks stand, W, m.
    sigma
        Standard deviation of each bearing, rad: one number or shape (M,).
    survey_sigma
        Standard deviation of the landmarks' places, m: one number or shape (M,).
    gate
        Probability with which a good bearing passes; a bearing outside is left out. ``None``: all count.
    mount
        Where the sensor sits on the robot.

    Returns
    -------
    update
        A bearing of a landmark within a millimetre of the mean, or NaN, is not accepted; its innovation is
        NaN.

    Raises
    ------
    LocalizationError
        If shapes or numbers are impossible.
    """
    z = as_numbers(bearings, "bearings")
    p = as_numbers(landmarks, "landmarks")
    if z.ndim != 1 or p.shape != (len(z), 2):
        raise LocalizationError(f"{z.shape} bearings but {p.shape} landmarks; give (M,) and (M, 2).")
    if np.isinf(z).any() or not np.isfinite(p).all():
        raise LocalizationError("Bearings must be finite or NaN, and landmarks finite.")
    s = as_numbers(sigma, "Sigma")
    survey = as_numbers(survey_sigma, "Survey sigma")
    if s.shape not in {(), z.shape} or not ((s > 0) & (s <= MAX_SIGMA)).all():
        raise LocalizationError(
            f"Sigma is {sigma!r}; it must be positive, up to {MAX_SIGMA:g}, one number or one per bearing."
        )
    if survey.shape not in {(), z.shape} or not ((survey >= 0) & (survey <= MAX_SIGMA)).all():
        raise LocalizationError(f"Survey sigma is {survey_sigma!r}; it must be from 0 to {MAX_SIGMA:g} m.")
    innovations, normalised, accepted = np.empty(len(z)), np.empty(len(z)), np.empty(len(z), dtype=np.bool_)
    mean, P = belief.mean.copy(), belief.covariance.copy()
    variances = np.broadcast_to(s * s, z.shape).copy()
    survey = np.broadcast_to(survey * survey, z.shape).copy()
    limit = gate_quantile(gate, 1)
    kernel.update_bearings(
        mean, P, mount.as_array(), z, p, variances, survey, limit, innovations, normalised, accepted
    )
    return Update(PoseBelief(mean, P, "posterior"), innovations, normalised, accepted)


def update_with_fix(
    belief: PoseBelief,
    fix: npt.ArrayLike,
    covariance: npt.ArrayLike,
    *,
    gate: float | None = None,
    mount: Mount = CENTRE,
) -> Update:
    """Belief after a fix of the pose or of the position alone, in Joseph form.

    Parameters
    ----------
    belief
        Before the measurement.
    fix
        Shape (3,): x, y (m), heading (rad); or shape (2,): x, y.
    covariance
        Shape (3, 3) or (2, 2), positive definite.
    gate
        Probability with which a good fix passes; outside it is left out. ``None``: it counts in any case.
    mount
        Where on the robot the sensor sits whose pose or position the fix is; by default at its centre, as the
        fixes of ``triangulate`` and ``locate`` with a mount are. The innovation is of the sensor's pose.

    Raises
    ------
    LocalizationError
        If shapes or numbers are impossible.
    NotPositiveDefinite
        If the fix has no covariance, or a singular one.
    """
    z = as_numbers(fix, "fix")
    if z.shape not in {(2,), (3,)} or not np.isfinite(z).all():
        raise LocalizationError(
            f"Fix is {fix!r}; give two or three finite numbers (m, m, rad). No fix, no update."
        )
    n = len(z)
    R = require_covariance(covariance, n, "a fix")
    mean, P = belief.mean.copy(), belief.covariance.copy()
    ox, oy = mount.offset(float(mean[2]))
    innovation = z - (mean + np.array([ox, oy, mount.theta]))[:n]
    # A turn moves a sensor off the centre.
    H = np.array([[1.0, 0.0, -oy], [0.0, 1.0, ox], [0.0, 0.0, 1.0]])[:n]
    if n == 3:
        innovation[2] = wrap(innovation[2])
    # With R = L Lᵀ the rows of L⁻¹ H have independent noise of variance 1. Units are scaled away first.
    scale = np.sqrt(np.where(np.diag(R) > 0, np.diag(R), 1.0))
    try:
        L = scale[:, None] * np.linalg.cholesky(R / scale[:, None] / scale[None, :])
        S = H @ P @ H.T + R
        size = np.sqrt(np.diag(S))
        white = np.linalg.solve(np.linalg.cholesky(S / size[:, None] / size[None, :]), innovation / size)
    except np.linalg.LinAlgError:
        raise NotPositiveDefinite(
            f"The covariance of a fix is {R.tolist()}; it must be positive definite to be used."
        ) from None
    normalised = float(white @ white)
    accepted = normalised <= gate_quantile(gate, n)
    if accepted:
        rows = np.linalg.solve(L, H)
        kernel.update_rows(
            mean, P, rows, np.linalg.solve(L, innovation), np.ones(n), np.ones(n, dtype=np.bool_)
        )
    return Update(PoseBelief(mean, P, "posterior"), innovation, np.array([normalised]), np.array([accepted]))
