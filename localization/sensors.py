"""Sensor models: what is measured, how well, how far, in which direction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

import numpy as np

from localization.errors import InvalidSensor
from localization.kernels.fix import (
    AREA,
    CENTRED_FREE,
    CENTRED_LIMITED,
    FIXED,
    MAX_AXIS,
    OMNIDIRECTIONAL,
    OPTIMAL,
    TRACE,
)
from localization.numbers import is_number
from maps.arrays import FloatArray, digest

# Squares of squares of smaller numbers vanish in floating point.
_SIGMA_MIN = 1e-12
_TURN = 2 * math.pi
# A robot's arm is metres long; more is a mistake in the units.
_LEVER_MAX = 100.0

Criterion = Literal["area", "max_axis", "trace"]
#: What makes one triplet better than another: area or major axis of the ellipse, or sum of the variances.
CRITERIA: dict[str, float] = {"area": AREA, "max_axis": MAX_AXIS, "trace": TRACE}


def _check_types(sensor: Any, *, but: Sequence[str] = ()) -> None:
    """Raise :class:`InvalidSensor` unless every field is a number, and the mount a mount."""
    for field in fields(sensor):
        value = getattr(sensor, field.name)
        if field.name == "mount":
            if not isinstance(value, Mount):
                raise InvalidSensor(f"Sensor mount is {value!r}; it must be a Mount.")
        elif field.name not in but and not is_number(value):
            raise InvalidSensor(f"Sensor {field.name} is {value!r}; it must be a number.")


def _require(ok: bool, name: str, value: float, rule: str) -> None:  # noqa: FBT001
    if not ok:
        raise InvalidSensor(f"Sensor {name} is {value}; it must be {rule}.")


def _check_range(min_range: float, max_range: float) -> None:
    _require(math.isfinite(min_range) and min_range >= 0, "min_range", min_range, "≥ 0 m and finite")
    _require(max_range > min_range, "max_range", max_range, f"above min_range ({min_range:g} m)")


def _check_floor(floor: float) -> None:
    _require(0 <= floor < math.pi, "bearing_floor", floor, "from 0 to π rad")


@dataclass(frozen=True, slots=True)
class Mount:
    """Where a sensor sits on the robot: pose of S in B.

    Attributes
    ----------
    x, y
        Of the sensor, ahead and to the left of the robot's centre, m.
    theta
        Where the sensor's zero direction points, from the robot's heading, rad.

    Raises
    ------
    InvalidSensor
        If a number is not finite, or the arm is longer than 100 m.
    """

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    def __post_init__(self) -> None:
        _check_types(self)
        for name in ("x", "y", "theta"):
            value = getattr(self, name)
            _require(math.isfinite(value), f"mount.{name}", value, "finite")
        _require(self.lever <= _LEVER_MAX, "mount arm", self.lever, f"at most {_LEVER_MAX:g} m")

    @property
    def lever(self) -> float:
        """Distance from the robot's centre, m."""
        return math.hypot(self.x, self.y)

    def as_array(self) -> FloatArray:
        """Shape (3,): x, y, theta."""
        return np.array([self.x, self.y, self.theta])

    def offset(self, heading: float) -> tuple[float, float]:
        """From the robot's centre to the sensor, W, m, when the robot has this heading, rad."""
        c, s = math.cos(heading), math.sin(heading)
        return c * self.x - s * self.y, s * self.x + c * self.y


CENTRE = Mount()


@dataclass(frozen=True, slots=True)
class OmnidirectionalSensor:
    """A scanner that measures bearings all around with constant noise (laser on reflectors).

    Attributes
    ----------
    bearing_sigma
        Standard deviation of a bearing, rad.
    min_range, max_range
        A landmark is seen from ``min_range`` to ``max_range``, m; infinity allowed for the latter.
    bearing_floor
        Second, constant part of a bearing's standard deviation, rad; the variances add.
    muted
        Sectors in which nothing is seen, as (begin, end), rad from the sensor's zero direction,
        counter-clockwise from begin to end.
    mount
        Where the sensor sits on the robot.

    Raises
    ------
    InvalidSensor
        If a number is impossible.
    """

    bearing_sigma: float
    min_range: float = 0.0
    max_range: float = math.inf
    bearing_floor: float = 0.0
    muted: Sequence[tuple[float, float]] = ()
    mount: Mount = CENTRE

    def __post_init__(self) -> None:
        _check_types(self, but=("muted",))
        s = self.bearing_sigma
        _require(_SIGMA_MIN <= s < math.pi, "bearing_sigma", s, f"from {_SIGMA_MIN:g} to π rad")
        _check_range(self.min_range, self.max_range)
        _check_floor(self.bearing_floor)
        object.__setattr__(self, "muted", _sectors(self.muted))
        for begin, end in self.muted:
            for value in (begin, end):
                _require(abs(value) <= _TURN, "muted sector", value, "within ±2π rad (±360°)")
            _require(
                _width(begin, end) > 0, "muted sector", end, f"apart from where it begins ({begin:g} rad)"
            )

    @property
    def kind(self) -> str:
        """``omnidirectional``."""
        return "omnidirectional"

    @property
    def depends_on_heading(self) -> bool:
        """Whether the field changes when the robot turns."""
        return bool(self.muted) or self.mount.lever > 0


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
        Limits of the optical axis relative to the mount's direction, rad, ``-π ≤ min ≤ max ≤ π``.
        A full turn (the default) makes the field independent of the heading.
    min_range, max_range
        A landmark is seen from ``min_range`` to ``max_range``, m.
    pan_policy
        ``centred``: axis on the middle of the triplet's span (cut by the limits), as in MAS97;
        ``optimal``: the axis within reach that minimises the ellipse's area (of the sensor's position).
    bearing_floor
        Constant part of a bearing's standard deviation, rad; the variances add.
    mount
        Where the pan head sits on the robot; pan angles count from the mount's direction.

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
    bearing_floor: float = 0.0
    mount: Mount = CENTRE

    def __post_init__(self) -> None:
        _check_camera(self)
        lo, hi = self.pan_min, self.pan_max
        eps = 1e-9
        _require(-math.pi - eps <= lo <= math.pi + eps, "pan_min", lo, "within ±π rad (±180°)")
        _require(lo <= hi <= math.pi + eps, "pan_max", hi, f"between pan_min ({lo:g}) and π rad (180°)")
        if self.pan_policy not in ("centred", "optimal"):
            raise InvalidSensor(f"Sensor pan_policy is '{self.pan_policy}'; use 'centred' or 'optimal'.")

    @property
    def kind(self) -> str:
        """``pinhole_pan``."""
        return "pinhole_pan"

    @property
    def has_free_pan(self) -> bool:
        """Whether the axis reaches every direction."""
        return self.pan_max - self.pan_min >= _TURN - 1e-9

    @property
    def depends_on_heading(self) -> bool:
        """Whether the field changes when the robot turns."""
        return not self.has_free_pan or self.mount.lever > 0


@dataclass(frozen=True, slots=True)
class PinholeFixedSensor:
    """A pinhole camera fixed to the robot: what it sees depends on the robot's heading.

    Attributes
    ----------
    field_of_view, focal_px, column_sigma_px
        As for :class:`PinholePanSensor`.
    min_range, max_range
        A landmark is seen from ``min_range`` to ``max_range``, m.
    bearing_floor
        Constant part of a bearing's standard deviation, rad; the variances add.
    mount
        Where the camera sits on the robot; its optical axis is the mount's direction.

    Raises
    ------
    InvalidSensor
        If a number is impossible.
    """

    field_of_view: float
    focal_px: float
    column_sigma_px: float
    min_range: float = 0.0
    max_range: float = math.inf
    bearing_floor: float = 0.0
    mount: Mount = CENTRE

    def __post_init__(self) -> None:
        _check_camera(self)

    @property
    def kind(self) -> str:
        """``pinhole_fixed``."""
        return "pinhole_fixed"

    @property
    def depends_on_heading(self) -> bool:
        """Whether the field changes when the robot turns: always."""
        return True


def _sectors(muted: Any) -> tuple[tuple[float, float], ...]:
    try:
        sectors = [tuple(sector) for sector in muted]
    except TypeError:
        sectors = [()]
    if not all(len(s) == 2 and all(is_number(v) for v in s) for s in sectors):
        raise InvalidSensor(f"Sensor muted is {muted!r}; it must be sectors (begin, end), rad.")
    return tuple((float(begin), float(end)) for begin, end in sectors)


def _check_camera(camera: PinholeSensor) -> None:
    _check_types(camera, but=("pan_policy",))
    fov = camera.field_of_view
    _require(
        math.isfinite(fov) and 0 < fov < math.pi, "field_of_view", fov, "positive and below π rad (180°)"
    )
    for name in ("focal_px", "column_sigma_px"):
        value = getattr(camera, name)
        _require(math.isfinite(value) and value > 0, name, value, "positive px and finite")
    sigma = camera.column_sigma_px / camera.focal_px
    rule = f"from {_SIGMA_MIN:g} to π: it is the bearing's sigma on the axis, rad"
    _require(_SIGMA_MIN <= sigma < math.pi, "column_sigma_px / focal_px", sigma, rule)
    _check_range(camera.min_range, camera.max_range)
    _check_floor(camera.bearing_floor)


def _width(begin: float, end: float) -> float:
    """Width of a sector, counter-clockwise, rad, below a full turn."""
    return (end - begin) % _TURN


Sensor = OmnidirectionalSensor | PinholePanSensor | PinholeFixedSensor
PinholeSensor = PinholePanSensor | PinholeFixedSensor
_KINDS: dict[str, type[Sensor]] = {
    "omnidirectional": OmnidirectionalSensor,
    "pinhole_pan": PinholePanSensor,
    "pinhole_fixed": PinholeFixedSensor,
}

#: MAS97's camera: 512 columns over a field of view of 53.13° (6 mm lens, 6 mm chip), σ_u = 5 px.
MAS97_CAMERA = PinholePanSensor(field_of_view=2 * math.atan(0.5), focal_px=512.0, column_sigma_px=5.0)
#: A navigation laser on reflectors: 0.1° and 30 m.
LASER = OmnidirectionalSensor(bearing_sigma=math.radians(0.1), max_range=30.0)
#: MAS97's camera without its pan head, looking ahead.
FORWARD_CAMERA = PinholeFixedSensor(field_of_view=2 * math.atan(0.5), focal_px=512.0, column_sigma_px=5.0)
PRESETS: dict[str, Sensor] = {"mas97": MAS97_CAMERA, "laser": LASER, "forward": FORWARD_CAMERA}


def kernel_args(sensor: Sensor, heading: float = 0.0, criterion: str = "area") -> FloatArray:
    """The numbers that ``localization.kernels`` take for a sensor.

    Parameters
    ----------
    sensor
        Any sensor.
    heading
        Of the robot, rad.
    criterion
        Key of :data:`CRITERIA`.

    Returns
    -------
    args
        Shape (13 + 2 S,) with S muted sectors; the positions are named in ``localization.kernels.fix``.

    Raises
    ------
    InvalidSensor
        If the criterion is unknown.
    """
    if criterion not in CRITERIA:
        raise InvalidSensor(f"Unknown criterion '{criterion}'; use one of {', '.join(CRITERIA)}.")
    muted: list[float] = []
    pan_min = pan_max = 0.0
    if isinstance(sensor, OmnidirectionalSensor):
        mode, variance, view, cos_view = OMNIDIRECTIONAL, sensor.bearing_sigma**2, _TURN, -2.0
        for begin, end in sensor.muted:
            muted += [begin, _width(begin, end)]
    else:
        variance = (sensor.column_sigma_px / sensor.focal_px) ** 2
        view = sensor.field_of_view
        if isinstance(sensor, PinholeFixedSensor):
            mode, cos_view = FIXED, -2.0
        else:
            cos_view = math.cos(view)
            pan_min, pan_max = sensor.pan_min, sensor.pan_max
            if sensor.pan_policy == "optimal":
                mode = OPTIMAL
            else:
                mode = CENTRED_FREE if sensor.has_free_pan else CENTRED_LIMITED
    mount = sensor.mount
    ox, oy = mount.offset(heading)
    args = [mode, variance, view, pan_min, pan_max, heading + mount.theta, cos_view]
    args += [sensor.bearing_floor**2, CRITERIA[criterion], mount.lever, -oy, ox, 0.5 * len(muted), *muted]
    return np.array(args)


def sensor_to_dict(sensor: Sensor) -> dict[str, Any]:
    """Plain values (SI, radians) with a ``kind``; infinity becomes ``None`` so that JSON can hold it."""
    values: dict[str, Any] = {k: (None if v == math.inf else v) for k, v in asdict(sensor).items()}
    if "muted" in values:
        values["muted"] = [list(sector) for sector in values["muted"]]
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
    try:
        if "mount" in rest:
            rest["mount"] = Mount(**rest["mount"])
        return cls(**rest)
    except (TypeError, ValueError) as error:
        raise InvalidSensor(f"The sensor of kind '{kind}' is incomplete or malformed: {error}.") from error


def sensor_hash(sensor: Sensor) -> str:
    """SHA-256 (hex) of a sensor's kind and numbers."""
    values = sensor_to_dict(sensor)
    mount = values.pop("mount")
    values |= {f"mount.{key}": value for key, value in mount.items()}
    values["muted"] = np.array([x for sector in values.pop("muted", []) for x in sector], dtype=np.float64)
    return digest("sensor", *(part for key in sorted(values) for part in (key, values[key])))
