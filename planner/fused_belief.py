"""What a filter knows along a path on a field: information of the fixes per cell, and the real filter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from dataclasses import field as default

import numpy as np
import numpy.typing as npt

from localization.motion import OdometryModel
from localization.propagation import PathBelief, propagate
from localization.schedule import all_visible_schedule, drive_along, schedule_of_triplets
from localization.sensors import OmnidirectionalSensor, PinholeFixedSensor, Sensor
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, frozen
from planner.errors import InvalidProblem
from planner.kernels.fused_field import fix_information


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
    padded
        Shape ((ny + 2)(nx + 2), 6): :attr:`information` with a row and a column of zeros on every side, as
        searches take it.
    widening
        Shape (ny, nx): factor of the bearing variances that gives the field's ellipse, 1 where first order
        holds; NaN where the cell's covariance is not that of one triplet.
    has_fix
        Shape (ny, nx): cells in which a fix updates the filter.
    """

    field: UncertaintyField
    padded: FloatArray
    widening: FloatArray
    has_fix: BoolArray = default(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "padded", frozen(self.padded))
        object.__setattr__(self, "widening", frozen(self.widening))
        object.__setattr__(self, "has_fix", frozen(self.information[..., 5] > 0, np.bool_))

    @classmethod
    def from_field(cls, field: UncertaintyField) -> FusedField:
        """Information of a field's fixes.

        ``Σ hᵀ h / v`` over the bearings of the cell's triplet, ``h`` their gradients in x, y and heading
        (MAS97 eq. 2 with the heading kept), divided by a factor where the field's ellipse is wider than the
        triplet's (see :meth:`UncertaintyField.trusted`). Where a cell names no triplet, position and heading
        of its fix count as independent.
        """
        made = cls.unless_stopped(field, np.zeros(1, dtype=np.uint8))
        if made is None:
            raise AssertionError("nobody stops it")
        return made

    @classmethod
    def unless_stopped(cls, field: UncertaintyField, stop: npt.NDArray[np.uint8]) -> FusedField | None:
        """:meth:`from_field`; None when another thread set ``stop`` (1,) before it was ready."""
        f, landmarks, sensor = field.frame, field.world.landmarks, field.sensor
        ny, nx = f.shape
        padded, widening = np.empty(((ny + 2) * (nx + 2), 6)), np.empty((ny, nx))
        complete = fix_information(
            field.triplet,
            field.covariance,
            field.sigma_theta,
            field.pan,
            np.array([f.origin_x, f.origin_y, math.cos(f.yaw), math.sin(f.yaw), f.resolution]),
            landmarks.positions,
            landmarks.sigma**2,
            _numbers(sensor, field.heading),
            padded,
            widening,
            stop,
        )
        if not complete:
            return None
        for array in (padded, widening):
            array.flags.writeable = False
        return cls(field, padded, widening)

    @property
    def information(self) -> FloatArray:
        """Shape (ny, nx, 6): xx, xy, yy, xθ, yθ, θθ of the inverse covariance of a fix; zero without one."""
        ny, nx = self.field.frame.shape
        return self.padded.reshape(ny + 2, nx + 2, 6)[1:-1, 1:-1]

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


def fix_covariance_in(field: UncertaintyField, row: int, col: int) -> FloatArray:
    """Covariance (3, 3) of one fix in a cell that has one, m², m rad, rad²: as of :class:`FusedField`."""
    f, landmarks = field.frame, field.world.landmarks
    corner = f.to_world(np.array([float(col), float(row)]))
    padded, widening = np.empty((9, 6)), np.empty((1, 1))
    one = np.s_[row : row + 1, col : col + 1]
    fix_information(
        field.triplet[one],
        field.covariance[one],
        field.sigma_theta[one],
        field.pan[one],
        np.array([*corner, math.cos(f.yaw), math.sin(f.yaw), f.resolution]),
        landmarks.positions,
        landmarks.sigma**2,
        _numbers(field.sensor, field.heading),
        padded,
        widening,
        np.zeros(1, dtype=np.uint8),
    )
    return np.asarray(np.linalg.inv(as_matrices(padded[4])))


def as_matrices(packed: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 3, 3) of xx, xy, yy, xθ, yθ, θθ (..., 6)."""
    return np.asarray(packed[..., [[0, 1, 3], [1, 2, 4], [3, 4, 5]]])


def as_packed(matrix: FloatArray) -> FloatArray:
    """xx, xy, yy, xθ, yθ, θθ (..., 6) of symmetric matrices (..., 3, 3)."""
    return np.asarray(matrix[..., [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])


def _numbers(sensor: Sensor, heading: float) -> FloatArray:
    """The numbers that ``fix_information`` takes for a sensor when the robot has a heading, rad."""
    x, y = sensor.mount.offset(heading)
    if isinstance(sensor, OmnidirectionalSensor):
        on_axis, is_pinhole = sensor.bearing_sigma, 0.0
    else:
        on_axis, is_pinhole = sensor.column_sigma_px / sensor.focal_px, 1.0
    axis = heading + sensor.mount.theta
    return np.array([x, y, axis, on_axis**2, sensor.bearing_floor**2, is_pinhole])
