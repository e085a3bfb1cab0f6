"""A pinhole camera's image columns and the bearings they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from localization.errors import BehindCamera, ColumnOutsideImage, InvalidSensor
from localization.numbers import as_numbers, is_number
from localization.sensors import PinholeSensor
from maps.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Camera:
    """Columns of an image: ``u = c - f tan ψ``, ψ counter-clockwise off the optical axis.

    Columns grow to the right as in every image, bearings to the left, hence the sign.

    Attributes
    ----------
    focal_px
        Focal length f, px.
    principal_px
        Column c of the optical axis, px.
    width_px
        Columns lie in [0, width]; None (the default) for an image without edges.

    Raises
    ------
    InvalidSensor
        If a number is impossible.
    """

    focal_px: float
    principal_px: float = 0.0
    width_px: float | None = None

    def __post_init__(self) -> None:
        for name in ("focal_px", "principal_px", "width_px"):
            value = getattr(self, name)
            if not is_number(value) and not (name == "width_px" and value is None):
                raise InvalidSensor(f"Camera {name} is {value!r}; it must be a number, px.")
        if not (math.isfinite(self.focal_px) and self.focal_px > 0):
            raise InvalidSensor(f"Camera focal_px is {self.focal_px}; it must be positive px and finite.")
        if not math.isfinite(self.principal_px):
            raise InvalidSensor(f"Camera principal_px is {self.principal_px}; it must be finite.")
        width = self.width_px
        if width is None:
            return
        if not (math.isfinite(width) and width > 0):
            raise InvalidSensor(f"Camera width_px is {width}; it must be positive px and finite, or None.")
        if not 0 <= self.principal_px <= width:
            raise InvalidSensor(
                f"Camera principal_px is {self.principal_px}; it must lie in the image, 0 to {width:g} px."
            )

    @classmethod
    def from_sensor(cls, sensor: PinholeSensor, *, principal_px: float | None = None) -> Camera:
        """The camera of a sensor: as wide as its field of view, axis in the middle unless said otherwise.

        Examples
        --------
        >>> from localization.sensors import MAS97_CAMERA
        >>> round(Camera.from_sensor(MAS97_CAMERA).width_px, 6)
        512.0
        """
        width = 2 * sensor.focal_px * math.tan(0.5 * sensor.field_of_view)
        return cls(sensor.focal_px, 0.5 * width if principal_px is None else principal_px, width)

    def inside(self, columns: npt.ArrayLike) -> BoolArray:
        """Whether columns (any shape), px, lie in the image, edges included; NaN does not."""
        u = np.asarray(columns, dtype=np.float64)
        if self.width_px is None:
            return np.asarray(np.isfinite(u))
        return np.asarray((u >= 0) & (u <= self.width_px))

    def bearings(self, columns: npt.ArrayLike) -> FloatArray:
        """Bearings off the optical axis, rad in (-π/2, π/2), of columns (any shape), px.

        Raises
        ------
        ColumnOutsideImage
            If a column is not in the image or not finite.
        """
        u = as_numbers(columns, "columns")
        if not (ok := self.inside(u)).all():
            limit = "finite" if self.width_px is None else f"from 0 to {self.width_px:g} px"
            raise ColumnOutsideImage(
                f"{np.count_nonzero(~ok)} of {u.size} image columns are outside, the first is "
                f"{u[~ok].flat[0]}; they must be {limit}."
            )
        return np.asarray(np.arctan((self.principal_px - u) / self.focal_px))

    def columns(self, bearings: npt.ArrayLike) -> FloatArray:
        """Columns, px, of bearings off the optical axis (any shape), rad; they may lie beside the image.

        Raises
        ------
        BehindCamera
            If a bearing is not within ±90° of the axis.
        """
        b = as_numbers(bearings, "bearings")
        if not (ok := np.cos(b) > 1e-12).all():  # also false for NaN
            raise BehindCamera(
                f"{np.count_nonzero(~ok)} of {b.size} bearings have no image column, the first is "
                f"{b[~ok].flat[0]} rad; they must lie within ±π/2 of the optical axis."
            )
        return np.asarray(self.principal_px - self.focal_px * np.tan(b))

    def bearing_sigma(self, columns: npt.ArrayLike, column_sigma_px: float) -> FloatArray:
        """Standard deviation of the bearings of columns, rad: ``σ_u cos²ψ / f`` (MATH §1).

        Raises
        ------
        ColumnOutsideImage
            If a column is not finite; beside the image it may lie.
        InvalidSensor
            If the sigma is negative or not finite.
        """
        u = as_numbers(columns, "columns")
        if not np.isfinite(u).all():
            raise ColumnOutsideImage(
                f"{np.count_nonzero(~np.isfinite(u))} of {u.size} image columns are not finite."
            )
        if not is_number(column_sigma_px) or not 0 <= column_sigma_px < math.inf:
            raise InvalidSensor(f"Camera column_sigma_px is {column_sigma_px}; it must be ≥ 0 px and finite.")
        t = (self.principal_px - u) / self.focal_px
        return np.asarray(column_sigma_px / (self.focal_px * (1.0 + t * t)))
