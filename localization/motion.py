"""Odometry of a differential drive: motion along arcs, noise that grows with distance and turn."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from localization.errors import LocalizationError
from localization.kernels.ekf import moved, odometry_variances
from maps.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class OdometryModel:
    """Noise of odometry that reports a distance and a turn per step.

    Variances are proportional to what was driven, so that steps may be cut into smaller ones:
    ``var(distance) = distance_sigma² |d|``, ``var(turn) = turn_sigma² |w| + drift_sigma² |d|``,
    ``var(sideways) = slip_sigma² |d|``. A robot that stands still loses nothing.

    Attributes
    ----------
    distance_sigma
        Standard deviation of the distance after 1 m, m (m/√m).
    turn_sigma
        Standard deviation of the turn after 1 rad, rad (rad/√rad).
    drift_sigma
        Standard deviation of the heading after 1 m straight ahead, rad (rad/√m).
    slip_sigma
        Standard deviation of the sideways slip after 1 m, m (m/√m).

    Raises
    ------
    LocalizationError
        If a number is negative or not finite.
    """

    distance_sigma: float = 0.02
    turn_sigma: float = 0.03
    drift_sigma: float = 0.01
    slip_sigma: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not (math.isfinite(value) and value >= 0):
                raise LocalizationError(f"Odometry {f.name} is {value}; it must be ≥ 0 and finite.")

    @property
    def kernel_args(self) -> FloatArray:
        """Shape (4,): the variances that ``localization.kernels.ekf`` takes."""
        return np.array([self.distance_sigma**2, self.turn_sigma**2, self.drift_sigma**2, self.slip_sigma**2])


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A step of the robot with its derivatives.

    Attributes
    ----------
    pose
        Shape (3,): where the step leads, x, y (m), heading (rad).
    transition_matrix
        F, shape (3, 3): derivative with respect to the pose before.
    noise_gain
        G, shape (3, 3): derivative with respect to distance, turn and sideways slip.
    process_noise
        Q, shape (3, 3): ``G diag(variances) Gᵀ``.
    """

    pose: FloatArray
    transition_matrix: FloatArray
    noise_gain: FloatArray
    process_noise: FloatArray


def move(pose: npt.ArrayLike, *, distance: float, turn: float, model: OdometryModel | None = None) -> Motion:
    """Pose after an arc of length ``distance`` that turns by ``turn``.

    ``x' = x + d sinc(w/2) cos(θ + w/2)``, ``y'`` with the sine, ``θ' = θ + w``.

    Parameters
    ----------
    pose
        Shape (3,): x, y (m), heading (rad), in W.
    distance
        Length of the arc, m; negative backwards.
    turn
        Change of the heading, rad, counter-clockwise positive.
    model
        Noise; ``None`` for none.

    Raises
    ------
    LocalizationError
        If a number is not finite.
    """
    out = np.array(pose, dtype=np.float64)
    if out.shape != (3,) or not np.isfinite(out).all():
        raise LocalizationError(f"Pose is {pose!r}; it must be three finite numbers (m, m, rad).")
    check_increment(distance, turn)
    F, G, variances = np.empty((3, 3)), np.empty((3, 3)), np.zeros(3)
    moved(out, float(distance), float(turn), F, G)
    if model is not None:
        odometry_variances(float(distance), float(turn), model.kernel_args, variances)
    return Motion(out, F, G, (G * variances) @ G.T)


def check_increment(distance: float, turn: float) -> None:
    """Raise :class:`LocalizationError` unless both are finite numbers."""
    if not (math.isfinite(distance) and math.isfinite(turn)):
        raise LocalizationError(
            f"Odometry reports a distance of {distance} m and a turn of {turn} rad; both must be finite."
        )


def wheel_increments(
    left: npt.ArrayLike, right: npt.ArrayLike, *, track: float
) -> tuple[FloatArray, FloatArray]:
    """Distances (m) and turns (rad) of a differential drive whose wheels rolled ``left`` and ``right``, m.

    Parameters
    ----------
    left, right
        Same shape: how far each wheel rolled, m.
    track
        Distance between the wheels, m.

    Raises
    ------
    LocalizationError
        If the track is not positive, shapes disagree or a number is not finite.
    """
    if not (math.isfinite(track) and track > 0):
        raise LocalizationError(f"Track is {track} m; it must be positive and finite.")
    a, b = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
    if a.shape != b.shape or not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise LocalizationError(
            f"Wheels rolled {a.shape} and {b.shape} numbers; give as many of each, all finite (m)."
        )
    return np.asarray(0.5 * (a + b)), np.asarray((b - a) / track)


def increments_between(poses: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Odometry that a robot would report on arcs through poses (K, 3): distances (K-1,) m, turns (K-1,) rad.

    The distance is signed by the direction of travel; what an arc cannot do (sideways steps) is left out.

    Raises
    ------
    LocalizationError
        If the shape is wrong or a number is not finite.
    """
    p = np.asarray(poses, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or not np.isfinite(p).all():
        raise LocalizationError(f"Poses have shape {p.shape}; give (K, 3), all finite (m, m, rad).")
    step = np.diff(p[:, :2], axis=0)
    turn = np.diff(p[:, 2])
    turn = turn - 2 * math.pi * np.round(turn / (2 * math.pi))
    phi = p[:-1, 2] + 0.5 * turn
    chord = step[:, 0] * np.cos(phi) + step[:, 1] * np.sin(phi)
    return np.asarray(chord / np.sinc(0.5 * turn / math.pi)), np.asarray(turn)
