"""Measurements of known landmarks with reference poses from CSV files, as a calibration takes them.

The first line names the columns, separated by commas, semicolons or tabs; other names are refused.

- ``t_s``: time, s.
- ``landmark`` (or ``id``): as in the file of landmarks; others count as misread.
- ``bearing_deg`` or ``bearing_rad``: counter-clockwise from the sensor's zero direction, which is the optical
  axis of a camera; or ``column_px``: image column, growing to the right.
- ``pan_deg`` or ``pan_rad``, if wanted: of the optical axis from the mount's direction.
- ``range_m``, if wanted: measured distance, compared with the reference.
- ``x_m``, ``y_m`` and ``theta_deg`` or ``theta_rad``: where the robot was; empty without a reference. Or in a
  second file with these and ``t_s``, between whose lines poses are interpolated.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from localization.camera import Camera
from localization.errors import LogFormatError
from localization.logs import MAX_GAP_S, BearingLog, Sighting, blocks_of, interpolated
from localization.sensors import CENTRE, Mount
from maps.arrays import FloatArray, frozen
from maps.errors import MapError
from maps.io.strict import decode, read_bytes
from maps.landmarks import LandmarkSet
from maps.se2 import wrap

MAX_LOG_BYTES = 256 * 2**20
#: Sightings of so many seconds may share errors.
BLOCK_S = 10.0
_DEG = math.pi / 180
#: name in the file -> (what it is, factor to SI)
_COLUMNS = {
    "t_s": ("t_s", 1.0),
    "landmark": ("landmark", 1.0),
    "id": ("landmark", 1.0),
    "bearing_deg": ("bearing", _DEG),
    "bearing_rad": ("bearing", 1.0),
    "column_px": ("column_px", 1.0),
    "pan_deg": ("pan", _DEG),
    "pan_rad": ("pan", 1.0),
    "range_m": ("range_m", 1.0),
    "x_m": ("x_m", 1.0),
    "y_m": ("y_m", 1.0),
    "theta_deg": ("theta", _DEG),
    "theta_rad": ("theta", 1.0),
}
_POSE = ("x_m", "y_m", "theta")


@dataclass(frozen=True, slots=True, eq=False)
class SightingsFile:
    """What a file of measurements holds.

    Attributes
    ----------
    log
        Bearings and, as references, poses of the sensor: of a camera's axis where there is a pan.
    ranges
        Shape (S,): measured distances, m; NaN where there is none.
    """

    log: BearingLog
    ranges: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges", frozen(self.ranges))


def read_sightings(
    path: str | Path,
    landmarks: LandmarkSet,
    *,
    poses: str | Path | None = None,
    camera: Camera | None = None,
    mount: Mount = CENTRE,
    block_s: float = BLOCK_S,
    max_gap: float = MAX_GAP_S,
) -> SightingsFile:
    """Measurements from a CSV file.

    Parameters
    ----------
    path
        As the module says.
    landmarks
        What was seen.
    poses
        Second file with the reference poses; None if they are in the first.
    camera
        Which bearings columns stand for.
    mount
        Where the sensor sits on the robot whose poses the references are.
    block_s
        Length of the stretches taken as independent, s.
    max_gap
        Poses of the second file further apart than this are not interpolated, s.

    Raises
    ------
    LogFormatError
        If a file is missing or not such a file; the message names the line.
    """
    for name, value in (("Block length", block_s), ("Largest gap", max_gap)):
        if not 0 < value < math.inf:
            raise LogFormatError(f"{name} is {value} s; it must be positive and finite.")
    name = Path(path).name
    content = _table(path, text=("landmark",))
    content.require("t_s", "landmark")
    measured = [what for what in ("bearing", "column_px") if what in content.names]
    if len(measured) != 1:
        raise LogFormatError(
            f"'{name}' needs one of bearing_deg, bearing_rad and column_px in its first line."
        )
    content.complete("t_s", *measured)
    order = np.argsort(content.values["t_s"], kind="stable")
    time = content.values["t_s"][order]
    n = len(time)
    bearing = _bearings(content, measured[0], camera)[order]
    track = np.empty((0, 4))
    if poses is None:
        content.require(*_POSE)
        robot = np.stack([content.values[what] for what in _POSE], axis=-1)[order]
        partial = np.isnan(robot).any(axis=1) & ~np.isnan(robot).all(axis=1)
        if partial.any():
            line = content.lines[order[np.flatnonzero(partial)[0]]]
            raise LogFormatError(f"'{name}', line {line}: give x_m, y_m and theta, or none of them.")
    else:
        if any(what in content.names for what in _POSE):
            raise LogFormatError(f"'{name}' has reference poses of its own; leave '{Path(poses).name}' out.")
        track = _track(poses)
        robot = interpolated(track, time, max_gap)
    pan = content.values["pan"][order] if "pan" in content.names else np.zeros(n)
    content.complete(*[what for what in ("pan",) if what in content.names])
    index_of = {name: i for i, name in enumerate(landmarks.ids)}
    landmark = np.array([index_of.get(content.labels[k], -1) for k in order], dtype=np.int64)
    outcome = np.full(n, Sighting.USABLE, dtype=np.int64)
    outcome[np.isnan(robot[:, 0])] = Sighting.NO_REFERENCE
    outcome[landmark < 0] = Sighting.MISREAD
    log = BearingLog(
        name,
        landmarks,
        time,
        landmark,
        bearing,
        _of_sensor(robot, mount, pan),
        outcome,
        blocks_of(time, block_s),
        np.empty((0, 3)),
        track,
    )
    ranges = content.values["range_m"][order] if "range_m" in content.names else np.full(n, np.nan)
    return SightingsFile(log, ranges)


def _of_sensor(robot: FloatArray, mount: Mount, pan: FloatArray) -> FloatArray:
    """Poses (S, 3) of a sensor from those of its robot."""
    c, s = np.cos(robot[:, 2]), np.sin(robot[:, 2])
    x = robot[:, 0] + c * mount.x - s * mount.y
    y = robot[:, 1] + s * mount.x + c * mount.y
    theta = robot[:, 2] + mount.theta + pan
    return np.stack([x, y, np.where(np.isnan(theta), theta, wrap(np.nan_to_num(theta)))], axis=-1)


def _bearings(content: _Table, what: str, camera: Camera | None) -> FloatArray:
    values = content.values[what]
    if what == "bearing":
        return wrap(values)
    if camera is None:
        raise LogFormatError(f"'{content.source}' has image columns; say which camera made them.")
    outside = np.flatnonzero(~camera.inside(values))
    if len(outside):
        k = outside[0]
        raise LogFormatError(
            f"'{content.source}', line {content.lines[k]}: column {values[k]:g} px is not in the image, "
            f"0 to {camera.width_px:g} px."
        )
    return camera.bearings(values)


def _track(path: str | Path) -> FloatArray:
    content = _table(path, only=("t_s", *_POSE))
    content.require("t_s", *_POSE)
    content.complete("t_s", *_POSE)
    track = np.stack([content.values[what] for what in ("t_s", *_POSE)], axis=-1)
    back = np.flatnonzero(np.diff(track[:, 0]) < 0)
    if len(back):
        line = content.lines[back[0] + 1]
        raise LogFormatError(f"'{content.source}', line {line}: time goes back; sort the poses by t_s.")
    return track


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    source: str
    names: list[str]
    values: dict[str, FloatArray]
    labels: list[str]
    lines: list[int]

    def require(self, *names: str) -> None:
        for name in names:
            if name not in self.names:
                given = {"theta": "theta_deg or theta_rad"}.get(name, name)
                raise LogFormatError(f"'{self.source}' lacks the column {given}; its first line names them.")

    def complete(self, *names: str) -> None:
        for name in names:
            missing = np.flatnonzero(np.isnan(self.values[name]))
            if len(missing):
                raise LogFormatError(f"'{self.source}', line {self.lines[missing[0]]}: {name} is missing.")


def _table(path: str | Path, *, text: tuple[str, ...] = (), only: tuple[str, ...] | None = None) -> _Table:
    """Columns by what they are; empty cells are NaN."""
    source = Path(path).name
    try:
        content = decode(read_bytes(path, limit=MAX_LOG_BYTES, what="log"), f"'{source}'")
    except MapError as error:
        raise LogFormatError(str(error)) from error
    head = content.lstrip().split("\n", 1)[0]
    reader = csv.reader(
        io.StringIO(content, newline=""), delimiter=max(";\t,", key=head.count), skipinitialspace=True
    )
    names: list[str] = []
    factors: list[float] = []
    columns: list[list[float]] = []
    labels: list[str] = []
    lines: list[int] = []
    try:
        for cells in reader:
            row = [cell.strip() for cell in cells]
            where = f"'{source}', line {reader.line_num}"
            if not any(row) or row[0].startswith("#"):
                continue
            if not names:
                names, factors = _header(row, where, only)
                columns = [[] for _ in names]
                continue
            if len(row) != len(names):
                raise LogFormatError(f"{where} has {len(row)} values, the header has {len(names)}.")
            lines.append(reader.line_num)
            for k, cell in enumerate(row):
                if names[k] in text:
                    labels.append(cell)
                else:
                    columns[k].append(_number(cell, f"{where}: {names[k]}") * factors[k])
    except csv.Error as error:
        raise LogFormatError(f"'{source}', line {reader.line_num} is not valid CSV: {error}.") from error
    if not lines:
        raise LogFormatError(f"'{source}' holds no measurements below a first line that names the columns.")
    values = {n: np.array(c) for n, c in zip(names, columns, strict=True) if n not in text}
    return _Table(source, names, values, labels, lines)


def _header(row: list[str], where: str, only: tuple[str, ...] | None) -> tuple[list[str], list[float]]:
    names, factors = [], []
    for cell in row:
        name = cell.lower()
        known = [k for k, (what, _) in _COLUMNS.items() if only is None or what in only]
        if name not in known:
            raise LogFormatError(
                f"{where} has {cell[:40]!r}, which is not allowed; allowed: {', '.join(known)}."
            )
        what, factor = _COLUMNS[name]
        if what in names:
            raise LogFormatError(f"{where} gives {what} in two columns; give it once.")
        names.append(what)
        factors.append(factor)
    return names, factors


def _number(cell: str, where: str) -> float:
    if not cell:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise LogFormatError(f"{where} is {cell[:40]!r}; it must be a finite number.")
    return value
