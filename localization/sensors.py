"""Sensor models: what is measured, how well, how far, in which direction."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

import numpy as np

from localization.errors import InvalidSensor
from localization.kernels.fix import CENTRED_FREE, CENTRED_LIMITED, OMNIDIRECTIONAL, OPTIMAL
from maps.arrays import FloatArray, digest

# Squares of squares of smaller numbers vanish in floating point.
_SIGMA_MIN = 1e-12


def _require(ok: bool, name: str, value: float, rule: str) -> None:  # noqa: FBT001
    if not ok:
        raise InvalidSensor(f"Sensor {name} is {value}; it must be {rule}.")


def _check_range(min_range: float, max_range: float) -> None:
    _require(math.isfinite(min_range) and min_range >= 0, "min_range", min_range, "≥ 0 m and finite")
    _require(max_range > min_range, "max_range", max_range, f"above min_range ({min_range:g} m)")


@dataclass(frozen=True, slots=True)
class OmnidirectionalSensor:
    """A scanner that measures bearings all around with constant noise (laser on reflectors).

    Attributes
    ----------
    bearing_sigma
        Standard deviation of a bearing, rad.
    min_range, max_range
        A landmark is seen from ``min_range`` to ``max_range``, m; infinity allowed for the latter.

    Raises
    ------
    InvalidSensor
        If a number is impossible.
    """

    bearing_sigma: float
    min_range: float = 0.0
    max_range: float = math.inf

    def __post_init__(self) -> None:
        s = self.bearing_sigma
        _require(_SIGMA_MIN <= s < math.pi, "bearing_sigma", s, f"from {_SIGMA_MIN:g} to π rad")
        _check_range(self.min_range, self.max_range)

    @property
    def kind(self) -> str:
        """``omnidirectional``."""
        return "omnidirectional"

    @property
    def depends_on_heading(self) -> bool:
        """Whether the field changes when the robot turns: never."""
        return False


@dataclass(frozen=True, slots=True)
class PinholePanSensor:
    """A pinhole camera on a pan head (MAS97 §2): columns ``u = f tan ψ``, ψ off the optical axis.

    Attributes
    ----------
    field_of_view
        Full opening angle F of the camera, rad, below π.
    focal_px
        Focal length f, px.
    column_sigma_px
        Standard deviation of an image column, px; a bearing has ``σ_u cos²ψ / f``.
    pan_min, pan_max
        Limits of the optical axis relative to the robot's heading, rad, ``-π ≤ min ≤ max ≤ π``.
        A full turn (the default) makes the field independent of the heading.
    min_range, max_range
        A landmark is seen from ``min_range`` to ``max_range``, m.
    pan_policy
        ``centred``: axis on the middle of the triplet's span (cut by the limits), as in MAS97;
        ``optimal``: the axis within reach that minimises the ellipse's area.

    Raises
    ------
    InvalidSensor
        If a number is impossible.
    """

    field_of_view: float
    focal_px: float
    column_sigma_px: float
    pan_min: float = -math.pi
    pan_max: float = math.pi
    min_range: float = 0.0
    max_range: float = math.inf
    pan_policy: Literal["centred", "optimal"] = "centred"

    def __post_init__(self) -> None:
        fov = self.field_of_view
        _require(
            math.isfinite(fov) and 0 < fov < math.pi, "field_of_view", fov, "positive and below π rad (180°)"
        )
        for name in ("focal_px", "column_sigma_px"):
            value = getattr(self, name)
            _require(math.isfinite(value) and value > 0, name, value, "positive px and finite")
        sigma = self.column_sigma_px / self.focal_px
        rule = f"from {_SIGMA_MIN:g} to π: it is the bearing's sigma on the axis, rad"
        _require(_SIGMA_MIN <= sigma < math.pi, "column_sigma_px / focal_px", sigma, rule)
        lo, hi = self.pan_min, self.pan_max
        eps = 1e-9
        _require(-math.pi - eps <= lo <= math.pi + eps, "pan_min", lo, "within ±π rad (±180°)")
        _require(lo <= hi <= math.pi + eps, "pan_max", hi, f"between pan_min ({lo:g}) and π rad (180°)")
        if self.pan_policy not in {"centred", "optimal"}:
            raise InvalidSensor(f"Sensor pan_policy is '{self.pan_policy}'; use 'centred' or 'optimal'.")
        _check_range(self.min_range, self.max_range)

    @property
    def kind(self) -> str:
        """``pinhole_pan``."""
        return "pinhole_pan"

    @property
    def has_free_pan(self) -> bool:
        """Whether the axis reaches every direction."""
        return self.pan_max - self.pan_min >= 2 * math.pi - 1e-9

    @property
    def depends_on_heading(self) -> bool:
        """Whether the field changes when the robot turns."""
        return not self.has_free_pan


Sensor = OmnidirectionalSensor | PinholePanSensor
_KINDS: dict[str, type[Sensor]] = {"omnidirectional": OmnidirectionalSensor, "pinhole_pan": PinholePanSensor}

#: MAS97's camera: 512 columns over a field of view of 53.13° (6 mm lens, 6 mm chip), σ_u = 5 px.
MAS97_CAMERA = PinholePanSensor(field_of_view=2 * math.atan(0.5), focal_px=512.0, column_sigma_px=5.0)
#: A navigation laser on reflectors: 0.1° and 30 m.
LASER = OmnidirectionalSensor(bearing_sigma=math.radians(0.1), max_range=30.0)
PRESETS: dict[str, Sensor] = {"mas97": MAS97_CAMERA, "laser": LASER}


def kernel_args(sensor: Sensor, heading: float = 0.0) -> FloatArray:
    """The numbers that ``localization.kernels`` take for a sensor.

    Parameters
    ----------
    sensor
        Any sensor.
    heading
        Of the robot, rad; pan angles are relative to it.

    Returns
    -------
    args
        Shape (7,): mode, variance of a bearing on the optical axis (rad²), field of view, pan_min, pan_max,
        heading (rad), cosine of the field of view (-2: all around).
    """
    if isinstance(sensor, OmnidirectionalSensor):
        return np.array([OMNIDIRECTIONAL, sensor.bearing_sigma**2, 2 * math.pi, 0.0, 0.0, heading, -2.0])
    if sensor.pan_policy == "optimal":
        mode = OPTIMAL
    else:
        mode = CENTRED_FREE if sensor.has_free_pan else CENTRED_LIMITED
    variance = (sensor.column_sigma_px / sensor.focal_px) ** 2
    view = sensor.field_of_view
    return np.array([mode, variance, view, sensor.pan_min, sensor.pan_max, heading, math.cos(view)])


def sensor_to_dict(sensor: Sensor) -> dict[str, Any]:
    """Plain values (SI, radians) with a ``kind``; infinity becomes ``None`` so that JSON can hold it."""
    values = {k: (None if v == math.inf else v) for k, v in asdict(sensor).items()}
    return {"kind": sensor.kind, **values}


def sensor_from_dict(values: dict[str, Any]) -> Sensor:
    """Inverse of :func:`sensor_to_dict`.

    Raises
    ------
    InvalidSensor
        If the kind or a name is unknown, or a number impossible.
    """
    rest = dict(values)
    kind = rest.pop("kind", None)
    if kind not in _KINDS:
        raise InvalidSensor(f"Sensor kind is {kind!r}; use one of {sorted(_KINDS)}.")
    cls = _KINDS[kind]
    known = {f.name for f in fields(cls)}
    if unknown := sorted(set(rest) - known):
        raise InvalidSensor(f"A sensor of kind '{kind}' has no {unknown[0]!r}; it has {sorted(known)}.")
    if "max_range" in rest and rest["max_range"] is None:
        rest["max_range"] = math.inf
    return cls(**rest)


def sensor_hash(sensor: Sensor) -> str:
    """SHA-256 (hex) of a sensor's kind and numbers."""
    values = sensor_to_dict(sensor)
    return digest("sensor", *(part for key in sorted(values) for part in (key, values[key])))
