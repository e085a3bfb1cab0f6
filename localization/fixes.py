"""Fixes: poses from bearings with covariances, and what became of those that have none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2 as chi2_distribution

from localization.errors import InvalidMeasurement
from localization.kernels import triangulation as kernel
from localization.sensors import Mount
from maps.arrays import BoolArray, FloatArray, frozen
from maps.se2 import wrap


def carried_to_robot(
    pose: FloatArray, covariance: FloatArray | None, mount: Mount
) -> tuple[FloatArray, FloatArray | None]:
    """Poses (..., 3) and covariances (..., 3, 3) of the robot from those of a sensor mounted on it.

    The lever arm turns with the heading's error: ``J = [[1, 0, o_y], [0, 1, -o_x], [0, 0, 1]]`` with the arm
    ``o`` in W.
    """
    theta = pose[..., 2] - mount.theta
    c, s = np.cos(theta), np.sin(theta)
    ox, oy = c * mount.x - s * mount.y, s * mount.x + c * mount.y
    carried = np.stack([pose[..., 0] - ox, pose[..., 1] - oy, wrap(theta)], axis=-1)
    if covariance is None:
        return carried, None
    jacobian = np.zeros(covariance.shape)
    jacobian[..., [0, 1, 2], [0, 1, 2]] = 1.0
    jacobian[..., 0, 2], jacobian[..., 1, 2] = oy, -ox
    moved = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    return carried, np.asarray(0.5 * (moved + np.swapaxes(moved, -1, -2)))


class FixStatus(IntEnum):
    """What became of a fix; everything but ``OK`` has no pose (NaN)."""

    OK = int(kernel.OK)
    #: Robot and landmarks on one circle or line, landmarks at one place, or the robot at a landmark.
    DEGENERATE = int(kernel.DEGENERATE)
    #: No pose sees the landmarks under these bearings.
    NO_POSE = int(kernel.NO_POSE)
    #: A number is not finite, or beyond 10⁵ rad, 10¹² m or 10¹² px.
    NOT_FINITE = int(kernel.NOT_FINITE)
    #: An image column that the camera does not have.
    OUTSIDE_IMAGE = int(kernel.OUTSIDE_IMAGE)
    #: Least squares: the information has no inverse.
    SINGULAR = 5
    #: Least squares: steps ran out.
    NO_CONVERGENCE = 6


@dataclass(frozen=True, slots=True, eq=False)
class Fixes:
    """N fixes of three bearings each; read-only arrays.

    Attributes
    ----------
    pose
        Shape (N, 3): x, y (m) and heading (rad in [-π, π)) in W; NaN unless the status is ``OK``.
    covariance
        Shape (N, 3, 3): first-order covariance of the pose (m², m·rad, rad²), NaN as the pose; None when no
        sigma was given.
    status
        Shape (N,): values of :class:`FixStatus`.
    reliability
        Shape (N,): 0 on the danger circle to 1, and 0 where landmarks coincide or the robot is at one; NaN
        where the input is not finite or outside the image.
    """

    pose: FloatArray
    covariance: FloatArray | None
    status: npt.NDArray[np.uint8]
    reliability: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(self.pose))
        object.__setattr__(self, "status", frozen(self.status, np.uint8))
        object.__setattr__(self, "reliability", frozen(self.reliability))
        if self.covariance is not None:
            object.__setattr__(self, "covariance", frozen(self.covariance))

    def __len__(self) -> int:
        return len(self.status)

    @property
    def ok(self) -> BoolArray:
        """Shape (N,): which fixes have a pose."""
        return np.asarray(self.status == FixStatus.OK)

    def count(self, status: FixStatus) -> int:
        """How many fixes ended so."""
        return int(np.count_nonzero(self.status == status))

    def of_robot(self, mount: Mount) -> Fixes:
        """Fixes of the robot's pose from those of a sensor mounted on it, with their covariances."""
        pose, covariance = carried_to_robot(self.pose, self.covariance, mount)
        return Fixes(pose, covariance, self.status, self.reliability)


@dataclass(frozen=True, slots=True, eq=False)
class PoseFix:
    """One fix of any number of bearings.

    Attributes
    ----------
    pose
        Shape (3,): x, y (m) and heading (rad in [-π, π)) in W; NaN unless the status is ``OK``.
    covariance
        Shape (3, 3): inverse of the information at the pose; NaN as the pose.
    status
        ``OK``, ``NO_POSE`` or ``DEGENERATE`` (no triplet gives a start), ``SINGULAR``, ``NO_CONVERGENCE``.
    chi2
        Weighted sum of squared residuals, with ``dof`` degrees of freedom; NaN without a start.
    steps
        Gauss-Newton steps tried.
    dof
        M - 3: bearings beyond those that a pose needs.

    Notes
    -----
    ``OK`` says that the steps ended, not that the bearings agree: see :attr:`p_value`,
    :meth:`is_consistent`. A misread landmark gives a pose too.
    """

    pose: FloatArray
    covariance: FloatArray
    status: FixStatus
    chi2: float
    steps: int
    dof: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(self.pose))
        object.__setattr__(self, "covariance", frozen(self.covariance))

    @property
    def p_value(self) -> float:
        """Probability that good bearings disagree at least so much: upper tail of χ² with ``dof`` degrees.

        1 for three bearings, which always agree; NaN without a pose.
        """
        if not self.converged:
            return math.nan
        return float(chi2_distribution.sf(self.chi2, self.dof)) if self.dof > 0 else 1.0

    def of_robot(self, mount: Mount) -> PoseFix:
        """The fix of the robot's pose from that of a sensor mounted on it, with its covariance."""
        pose, covariance = carried_to_robot(self.pose, self.covariance, mount)
        assert covariance is not None
        return replace(self, pose=pose, covariance=covariance)

    def is_consistent(self, level: float = 0.999) -> bool:
        """Whether there is a pose and its bearings agree as well as ``level`` of good ones do.

        Raises
        ------
        InvalidMeasurement
            If the level is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise InvalidMeasurement(f"Level is {level}; give a probability between 0 and 1, like 0.999.")
        return self.converged and self.p_value >= 1.0 - level

    @property
    def converged(self) -> bool:
        """Whether there is a pose."""
        return self.status == FixStatus.OK
