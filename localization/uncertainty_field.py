"""The sensory uncertainty field (Takeda, Facchinetti, Latombe 1994) as a value."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from localization import covariance as cov
from localization.errors import LocalizationError
from localization.kernels.coverage import NOMINAL_SHARE, VALID_TOLERANCE
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import Sensor, sensor_hash
from maps.arrays import BoolArray, FloatArray, IntArray, digest, frozen
from maps.grid import GridFrame
from maps.world import World

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

#: Changes when the same world, sensor and parameters would give other numbers or another layout.
FIELD_FORMAT = 2

#: Predicted share of fixes in the 95 % ellipse below which a cell counts as one without a fix: there, cells
#: begin in which more than one measurement in twenty gives none, so that no radius holds 95 %.
USABLE_SHARE = 0.85

METRICS: dict[str, tuple[str, str]] = {
    "area95_m2": ("m²", "area of the 95 % ellipse of the best triplet"),
    "r95_m": ("m", "radius of the circle with the area of the 95 % ellipse"),
    "ellipse95_m": ("m", "semi-major axis of the 95 % ellipse"),
    "sigma_max_m": ("m", "largest standard deviation of the position in any direction"),
    "sigma_rms_m": ("m", "root of the mean of the two position variances"),
    "sigma_theta_rad": ("rad", "standard deviation of the heading"),
    "n_visible": ("", "landmarks in view"),
    "validity": ("", "predicted share of fixes inside the 95 % ellipse"),
}

#: The arrays of a field that say how good a fix is, beside ``free``.
LAYERS = ("covariance", "sigma_theta", "triplet", "pan", "n_visible", "validity")


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyField:
    """For every cell, the best visible landmark triplet and the covariance that it gives.

    Attributes
    ----------
    world, sensor
        What the field was computed from.
    frame
        Cells; ``shape = (n_rows, n_cols)``, row 0 is the lowest y of the frame.
    heading
        Heading of the robot, rad, for which the field holds (0 and irrelevant for sensors that do not depend
        on it, and where headings were reduced).
    free
        Shape (ny, nx), bool: the cell's centre lies in free space. Other cells hold NaN, -1 and 0.
    covariance
        Shape (ny, nx, 3): xx, xy, yy of the robot's centre in W, m²; NaN where there is no fix.
    sigma_theta
        Shape (ny, nx), rad: standard deviation of the heading.
    triplet
        Shape (ny, nx, 3), int16: ascending indices into ``world.landmarks``; -1 where there is no fix, and
        for every landmark in view together (``all_visible``).
    pan
        Shape (ny, nx), rad: optical axis relative to the pan head's zero; NaN without a fix or a pan head.
    n_visible
        Shape (ny, nx), int16: landmarks that can be measured: in range, facing, line of sight, not in a muted
        sector, within a fixed camera's view.
    validity
        Shape (ny, nx), float32: predicted share of fixes inside the 95 % ellipse, 0.95 where first order
        holds; NaN where there is no fix or it is not known (``all_visible``).
    method
        Estimator and criterion.
    reduction
        ``best`` or ``worst`` heading of several, see :class:`localization.heading_field.HeadingField`;
        empty for a single one.
    """

    world: World
    sensor: Sensor
    frame: GridFrame
    heading: float
    free: BoolArray
    covariance: FloatArray
    sigma_theta: FloatArray
    triplet: IntArray
    pan: FloatArray
    n_visible: IntArray
    validity: npt.NDArray[np.float32]
    method: FieldMethod = BEST_AREA
    reduction: str = ""

    def __post_init__(self) -> None:
        shape = self.frame.shape
        expected = {
            "free": (np.bool_, shape),
            "covariance": (np.float64, (*shape, 3)),
            "sigma_theta": (np.float64, shape),
            "triplet": (np.int16, (*shape, 3)),
            "pan": (np.float64, shape),
            "n_visible": (np.int16, shape),
            "validity": (np.float32, shape),
        }
        for name, (dtype, want) in expected.items():
            array = frozen(getattr(self, name), dtype)
            if array.shape != want:
                raise LocalizationError(f"Field {name} has shape {array.shape}, expected {want}.")
            object.__setattr__(self, name, array)

    @property
    def has_fix(self) -> BoolArray:
        """Shape (ny, nx): whether there is a fix."""
        return np.isfinite(self.covariance[..., 0])

    @property
    def is_valid(self) -> BoolArray:
        """Shape (ny, nx): whether there is a fix whose 95 % ellipse holds what it says (MAS97 §5.2).

        False where the predicted share is off by more than ``VALID_TOLERANCE``: such a fix is uncertain.
        """
        return np.asarray(self.has_fix & ~is_off(self.validity))

    @property
    def area95(self) -> FloatArray:
        """Shape (ny, nx), m²; NaN without a fix."""
        return cov.area95(self.covariance)

    @property
    def r95(self) -> FloatArray:
        """Shape (ny, nx), m; NaN without a fix."""
        return cov.r95(self.covariance)

    def trusted(self) -> UncertaintyField:
        """The field as planning may count on it: nowhere more certain than fixes are.

        Where first order fails and the predicted share p is at least ``USABLE_SHARE``, the ellipse's area is
        enlarged by ``(ln 0.05 / ln (1 - p))²`` (a Gaussian that leaves out so much would need the root of
        that factor; simulated fixes, whose tails are heavier, need up to the whole). Below there is no fix
        to count on. Such cells have no validity. A field that is valid everywhere is returned as it is.
        """
        doubtful = self.has_fix & ~self.is_valid
        return trusted_where(doubtful, self) if doubtful.any() else self

    def __reduce__(self) -> tuple[type[UncertaintyField], tuple[object, ...]]:
        return (UncertaintyField, tuple(getattr(self, f.name) for f in fields(self)))

    def metric(self, name: str, at: tuple[IntArray, IntArray] | None = None) -> FloatArray:
        """One of :data:`METRICS`; NaN where it is not defined.

        Parameters
        ----------
        name
            Key of :data:`METRICS`.
        at
            Rows and columns of the cells wanted, any shape; None: every cell, shape (ny, nx).

        Raises
        ------
        LocalizationError
            If the metric is unknown.
        """
        if name not in METRICS:
            raise LocalizationError(f"Unknown metric '{name}'; use one of {', '.join(METRICS)}.")
        index = (slice(None), slice(None)) if at is None else at
        if name == "sigma_theta_rad":
            return np.asarray(self.sigma_theta[index])
        if name == "n_visible":
            return np.where(self.free[index], self.n_visible[index].astype(np.float64), np.nan)
        if name == "validity":
            return self.validity[index].astype(np.float64)
        return _OF_COVARIANCE[name](self.covariance[index])

    def content_hash(self) -> str:
        """SHA-256 (hex) of everything the numbers depend on: world, sensor, grid, heading, method, format."""
        made = field_hash(self.world, self.sensor, self.frame, self.heading, method=self.method)
        return digest("reduced", made, self.reduction) if self.reduction else made


_OF_COVARIANCE: dict[str, Callable[[FloatArray], FloatArray]] = {
    "area95_m2": cov.area95,
    "r95_m": cov.r95,
    "ellipse95_m": lambda c: cov.ellipse95(c)[..., 0],
    "sigma_max_m": lambda c: np.asarray(np.sqrt(cov.max_eigenvalue(c))),
    "sigma_rms_m": lambda c: np.asarray(np.sqrt(0.5 * (c[..., 0] + c[..., 2]))),
}


_Layers = TypeVar("_Layers", bound="DataclassInstance")


def trusted_where(doubtful: BoolArray, layers: _Layers) -> _Layers:
    """Layers as :meth:`UncertaintyField.trusted` has them; ``doubtful`` says where that matters."""
    share = layers.validity[doubtful].astype(np.float64)  # type: ignore[attr-defined]
    usable = share >= USABLE_SHARE
    # Above the nominal share the ellipse is too large, which harms nobody.
    scale = np.maximum(math.log(1.0 - NOMINAL_SHARE) / np.log(1.0 - np.where(usable, share, 0.5)), 1.0)
    out = {name: getattr(layers, name).copy() for name in LAYERS if name != "n_visible"}
    out["covariance"][doubtful] *= np.where(usable, scale**2, np.nan)[:, None]
    out["sigma_theta"][doubtful] *= np.where(usable, scale, np.nan)
    out["pan"][doubtful] = np.where(usable, out["pan"][doubtful], np.nan)
    out["triplet"][doubtful] = np.where(usable[:, None], out["triplet"][doubtful], -1)
    out["validity"][doubtful] = np.nan
    return replace(layers, **out)


def is_off(validity: npt.NDArray[np.float32]) -> BoolArray:
    """Whether predicted shares are off by more than the tolerance; False for NaN, where nothing is said."""
    return np.asarray(np.abs(validity - np.float32(NOMINAL_SHARE)) > np.float32(VALID_TOLERANCE))


def field_hash(
    world: World,
    sensor: Sensor,
    frame: GridFrame,
    heading: float = 0.0,
    *,
    method: FieldMethod = BEST_AREA,
    n_headings: int = 1,
) -> str:
    """Content hash of the field that these inputs give, known before it is computed."""
    parts = (sensor_hash(sensor), *frame.as_tuple(), heading, n_headings, method.estimator, method.criterion)
    return digest("field", float(FIELD_FORMAT), world.content_hash(), *parts)
