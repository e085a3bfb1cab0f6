"""What a filter knows along a path on a field: information of the fixes per cell, and the real filter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from dataclasses import field as default

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from localization.motion import OdometryModel
from localization.propagation import PathBelief, propagate
from localization.schedule import all_visible_schedule, drive_along, schedule_of_triplets
from localization.sensors import OmnidirectionalSensor, PinholeFixedSensor
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, frozen
from planner.errors import InvalidProblem

# Areas of ellipses that differ by no more than this are those of the triplet itself.
_SAME = 1e-6


@dataclass(frozen=True, slots=True)
class FilterModel:
    """How the robot moves and how often it measures.

    Attributes
    ----------
    odometry
        Noise of the motion.
    fix_rate
        Fixes per second; infinity for one per cell that is entered.
    speed, turn_rate
        m/s and rad/s, for what happens between fixes.

    Raises
    ------
    InvalidProblem
        If a number is not positive, or a speed not finite.
    """

    odometry: OdometryModel = default(default_factory=OdometryModel)
    fix_rate: float = 10.0
    speed: float = 1.0
    turn_rate: float = 1.0

    def __post_init__(self) -> None:
        if not self.fix_rate > 0:
            raise InvalidProblem(f"The fix rate is {self.fix_rate} Hz; it must be positive.")
        for name, unit in (("speed", "m/s"), ("turn_rate", "rad/s")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InvalidProblem(f"The {name} is {value} {unit}; it must be positive and finite.")

    @property
    def period(self) -> float:
        """Metres between fixes; 0 for one per cell that is entered."""
        return self.speed / self.fix_rate


@dataclass(frozen=True, slots=True, eq=False)
class FusedField:
    """Information of one fix in every cell; made by :meth:`from_field`.

    Attributes
    ----------
    field
        The field, as planning trusts it.
    information
        Shape (ny, nx, 6): xx, xy, yy, xθ, yθ, θθ of the inverse covariance of a fix; zero without one.
    widening
        Shape (ny, nx): factor of the bearing variances that gives the field's ellipse, 1 where first order
        holds; NaN where the cell's covariance is not that of one triplet.
    """

    field: UncertaintyField
    information: FloatArray
    widening: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "information", frozen(self.information))
        object.__setattr__(self, "widening", frozen(self.widening))

    @classmethod
    def from_field(cls, field: UncertaintyField) -> FusedField:
        """Information of a field's fixes.

        ``Σ hᵀ h / v`` over the bearings of the cell's triplet, ``h`` their gradients in x, y and heading
        (MAS97 eq. 2 with the heading kept), divided by a factor where the field's ellipse is wider than the
        triplet's (see :meth:`UncertaintyField.trusted`). Where a cell names no triplet, position and heading
        of its fix count as independent.
        """
        J, area = _of_triplets(field)
        has_fix = field.has_fix
        with np.errstate(divide="ignore", invalid="ignore"):
            widening = field.area95 / area
        known = has_fix & np.isfinite(widening) & (widening > 1.0 - _SAME)
        widening = np.where(known, np.maximum(widening, 1.0), np.nan)
        information = np.where(known[..., None], J / widening[..., None], 0.0)
        plain = has_fix & ~known
        information[plain] = _independent(field.covariance[plain], field.sigma_theta[plain])
        return cls(field, information, widening)

    @property
    def has_fix(self) -> BoolArray:
        """Shape (ny, nx): cells in which a fix updates the filter."""
        return np.asarray(self.information[..., 5] > 0)

    @property
    def harms(self) -> tuple[FloatArray, FloatArray]:
        """Shape (ny, nx) each: 1 in cells without a fix, and r95 of one fix, m, 0 without."""
        known = self.has_fix
        return (
            frozen(np.where(known, 0.0, 1.0)),
            frozen(np.where(known, np.nan_to_num(self.field.r95, nan=0.0), 0.0)),
        )

    def fix_covariance(self, place: tuple[float, float]) -> FloatArray:
        """Covariance (3, 3) of one fix at a place, m², m rad, rad².

        Raises
        ------
        InvalidProblem
            If there is no fix in its cell.
        """
        row, col = (int(v) for v in self.field.frame.cell_at(place))
        ny, nx = self.field.frame.shape
        if not (0 <= row < ny and 0 <= col < nx and self.has_fix[row, col]):
            raise InvalidProblem(
                f"There is no fix at ({place[0]:.2f}, {place[1]:.2f}) m; give the covariance there."
            )
        return np.asarray(np.linalg.inv(as_matrices(self.information[row, col])))

    def along(self, points: npt.ArrayLike, start: npt.ArrayLike, model: FilterModel) -> PathBelief:
        """The filter's covariances along a polyline, turning on the spot at its corners.

        The real bearings of each cell's triplet are folded in where the robot is, at the times of the fix
        rate: see :func:`localization.propagation.propagate`.

        Parameters
        ----------
        points
            Shape (K, 2), W, m.
        start
            Covariance (3, 3) at the first point.
        model
            Motion and fix rate; the stations are a cell or the way between two fixes apart.
        """
        frame, sensor, world = self.field.frame, self.field.sensor, self.field.world
        step = min(frame.resolution, model.speed / model.fix_rate if math.isfinite(model.fix_rate) else 1.0)
        drive = drive_along(points, speed=model.speed, turn_rate=model.turn_rate, spacing=max(step, 0.02))
        ny, nx = frame.shape
        row, col = np.clip(frame.cell_at(drive.poses[:, :2]), 0, [ny - 1, nx - 1]).T
        if isinstance(sensor, (OmnidirectionalSensor, PinholeFixedSensor)) and self._is_all_visible:
            schedule = all_visible_schedule(world, sensor, drive)
        else:
            schedule = schedule_of_triplets(drive, self.field.triplet[row, col], world.landmarks, sensor)
            wider = np.nan_to_num(self.widening[row, col], nan=1.0)
            schedule = replace(schedule, variances=schedule.variances * wider[:, None])
        return propagate(drive, schedule, start, odometry=model.odometry, fix_rate=model.fix_rate)

    @property
    def _is_all_visible(self) -> bool:
        return self.field.method.estimator == "all_visible"


def as_matrices(packed: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 3, 3) of xx, xy, yy, xθ, yθ, θθ (..., 6)."""
    return np.asarray(packed[..., [[0, 1, 3], [1, 2, 4], [3, 4, 5]]])


def as_packed(matrix: FloatArray) -> FloatArray:
    """xx, xy, yy, xθ, yθ, θθ (..., 6) of symmetric matrices (..., 3, 3)."""
    return np.asarray(matrix[..., [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])


def _of_triplets(field: UncertaintyField) -> tuple[FloatArray, FloatArray]:
    """Information (ny, nx, 6) of each cell's triplet and the area of its 95 % ellipse (ny, nx), m²."""
    shape = field.frame.shape
    J, area = np.zeros((*shape, 6)), np.full(shape, np.nan)
    triplet = field.triplet.astype(np.int64)
    ok = field.has_fix & (triplet >= 0).all(axis=-1) & (triplet < len(field.world.landmarks)).all(axis=-1)
    if not ok.any():
        return J, area
    sensor, landmarks = field.sensor, field.world.landmarks
    index = triplet[ok]
    arm = sensor.mount.offset(field.heading)
    to = landmarks.positions[index] - (field.frame.centres()[ok] + arm)[:, None, :]
    r2 = np.sum(to * to, axis=-1)
    h = np.stack([to[..., 1] / r2, -to[..., 0] / r2, np.zeros_like(r2)], axis=-1)
    h[..., 2] = h[..., 1] * arm[0] - h[..., 0] * arm[1] - 1.0
    variance = landmarks.sigma[index] ** 2 / r2 + sensor.bearing_floor**2
    if isinstance(sensor, OmnidirectionalSensor):
        variance = variance + sensor.bearing_sigma**2
    else:
        axis = field.heading + sensor.mount.theta + np.nan_to_num(field.pan[ok], nan=0.0)
        off = np.arctan2(to[..., 1], to[..., 0]) - axis[:, None]
        variance = variance + (sensor.column_sigma_px / sensor.focal_px) ** 2 * np.cos(off) ** 4
    M = np.einsum("nki,nkj->nij", h / variance[..., None], h)
    J[ok] = as_packed(M)
    # Of the position: the Schur complement of the heading.
    S = M[:, :2, :2] - M[:, :2, 2:] * M[:, 2:, :2] / M[:, 2:, 2:]
    det = np.maximum(S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] ** 2, 0.0)
    with np.errstate(divide="ignore"):
        area[ok] = math.pi * cov.CHI2_95 / np.sqrt(det)
    return J, area


def _independent(covariance: FloatArray, sigma_theta: FloatArray) -> FloatArray:
    """Information (N, 6) of fixes with covariances (N, 3) and independent headings (N,)."""
    det = covariance[:, 0] * covariance[:, 2] - covariance[:, 1] ** 2
    zero = np.zeros(len(det))
    columns = [covariance[:, 2] / det, -covariance[:, 1] / det, covariance[:, 0] / det]
    return np.stack([*columns, zero, zero, 1.0 / sigma_theta**2], axis=-1)
