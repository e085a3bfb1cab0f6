"""Importer of the UTIAS multi-robot logs (MRCLAM): raw folders, and the pooled ``mrclamN.mat``.

Raw: whitespace columns with ``#`` headers. A measurement has a barcode, which ``Barcodes.dat`` turns into a
subject: 1 to 5 are robots, 6 to 20 landmarks. Barcodes in no table are misread. Reference poses come from
motion capture with gaps. Files may be gzipped.
"""

from __future__ import annotations

import gzip
import math
import zlib
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from localization.errors import LogFormatError
from localization.logs import BearingLog, Sighting, blocks_at_jumps, blocks_of, interpolated
from maps.arrays import FloatArray, IntArray
from maps.errors import MapError
from maps.landmarks import LandmarkSet

_N_ROBOTS = 5
# What a file that is not, or not quite, a MATLAB file makes its reader raise.
_BROKEN = (
    MatReadError,
    OSError,
    ValueError,
    TypeError,
    NotImplementedError,
    IndexError,
    zlib.error,
    MemoryError,
)
_MAX_BYTES = 256 * 1024 * 1024
#: Sightings of 10 s share what the motion did to them.
BLOCK_S = 10.0
#: Poses of a pooled file up to such a step apart belong to one standstill, with nearly the same readings, m.
JUMP_M = 0.05


def read_mrclam_run(folder: str | Path, robot: int) -> BearingLog:
    """One robot's run of a raw data set.

    Parameters
    ----------
    folder
        With ``Barcodes.dat``, ``Landmark_Groundtruth.dat`` and the robot's ``Measurement``, ``Odometry`` and
        ``Groundtruth`` (or ``Groundtruth_first_part.csv``), each perhaps with ``.gz``.
    robot
        1 to 5.

    Returns
    -------
    log
        Every line of the measurements, each with its outcome.

    Raises
    ------
    LogFormatError
        If a file is missing or not such a file.
    """
    folder = Path(folder)
    codes = table(_file(folder, "Barcodes.dat"), 2)
    subject_of = {int(code): int(subject) for subject, code in codes}
    if len(subject_of) != len(codes):
        raise LogFormatError(f"{folder.name}/Barcodes.dat: a barcode stands for two subjects.")
    ground = table(_file(folder, "Landmark_Groundtruth.dat"), 5)
    landmarks = _landmarks(
        folder.name, ground[:, 0], ground[:, 1:3], np.sqrt(0.5 * np.sum(ground[:, 3:] ** 2, axis=1))
    )
    index_of = {int(subject): i for i, subject in enumerate(ground[:, 0])}
    measured = table(_file(folder, f"Robot{robot}_Measurement.dat"), 4)
    measured = measured[np.argsort(measured[:, 0], kind="stable")]
    odometry = table(_file(folder, f"Robot{robot}_Odometry.dat"), 3)
    track = table(
        _file(folder, f"Robot{robot}_Groundtruth.dat", f"Robot{robot}_Groundtruth_first_part.csv"), 4
    )
    subjects = np.array([subject_of.get(int(code), -1) for code in measured[:, 1]], dtype=np.int64)
    landmark = np.array([index_of.get(int(s), -1) for s in subjects], dtype=np.int64)
    reference = interpolated(track, measured[:, 0])
    outcome = np.full(len(measured), Sighting.USABLE, dtype=np.int64)
    outcome[np.isnan(reference[:, 0])] = Sighting.NO_REFERENCE
    outcome[landmark < 0] = Sighting.MISREAD
    outcome[(subjects >= 1) & (subjects <= _N_ROBOTS)] = Sighting.ROBOT
    return BearingLog(
        f"{folder.name} robot {robot}",
        landmarks,
        measured[:, 0],
        landmark,
        measured[:, 3],
        reference,
        outcome,
        blocks_of(measured[:, 0], BLOCK_S),
        odometry,
        track,
    )


def read_mrclam_mat(path: str | Path) -> BearingLog:
    """The pooled poses of ``mrclamN.mat``: bearings that belong to one pose have one time, its number.

    Parameters
    ----------
    path
        MATLAB file with ``landmark`` (id, x, y), ``groundtruth`` (pose number, x, y, heading) and
        ``measurement`` (pose number, landmark id, range, bearing).

    Raises
    ------
    LogFormatError
        If the file is missing or not such a file.
    """
    path = Path(path)
    try:
        content = loadmat(str(path), variable_names=["landmark", "groundtruth", "measurement"])
    except _BROKEN as error:
        raise LogFormatError(f"'{path.name}' cannot be read as a MATLAB file: {error}") from error
    ground = _matrix(content, "landmark", 3, path.name)
    poses = _matrix(content, "groundtruth", 4, path.name)
    measured = _matrix(content, "measurement", 4, path.name)
    landmarks = _landmarks(path.name, ground[:, 0], ground[:, 1:], np.zeros(len(ground)))
    index_of = {int(k): i for i, k in enumerate(ground[:, 0])}
    pose_of = {int(k): i for i, k in enumerate(poses[:, 0])}
    measured = measured[np.argsort(measured[:, 0], kind="stable")]
    landmark = np.array([index_of.get(int(k), -1) for k in measured[:, 1]], dtype=np.int64)
    at = np.array([pose_of.get(int(k), -1) for k in measured[:, 0]], dtype=np.int64)
    outcome = np.full(len(measured), Sighting.USABLE, dtype=np.int64)
    outcome[at < 0] = Sighting.NO_REFERENCE
    outcome[landmark < 0] = Sighting.MISREAD
    reference = np.where(at[:, None] >= 0, poses[np.maximum(at, 0), 1:], np.nan)
    return BearingLog(
        path.name,
        landmarks,
        measured[:, 0],
        landmark,
        measured[:, 3],
        reference,
        outcome,
        blocks_at_jumps(reference, JUMP_M),
    )


def table(path: Path, columns: int, *, separator: str | None = None) -> FloatArray:
    """Numbers (N, columns) of a text file, perhaps gzipped; ``#`` lines and the header of a csv are skipped.

    Raises
    ------
    LogFormatError
        If a line has another number of columns, or something that is not a finite number; the line is named.
    """
    name = path.name.removesuffix(".gz")
    if name.endswith(".csv"):
        separator = ","
    rows: list[list[float]] = []
    for number, line in enumerate(_text(path).splitlines(), 1):
        text = line.strip()
        if not text or text.startswith("#") or (separator and not rows and text[0].isalpha()):
            continue
        words = text.split(separator)
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = [math.nan]
        if len(row) != columns or not all(math.isfinite(v) for v in row):
            raise LogFormatError(f"{name}, line {number}: {text[:60]!r} is not {columns} finite numbers.")
        rows.append(row)
    if not rows:
        raise LogFormatError(f"{name} holds no numbers.")
    return np.array(rows)


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
        if path.suffix == ".gz":
            with gzip.open(path, "rb") as stream:
                raw = stream.read(_MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise LogFormatError(f"'{path.name}' cannot be read: {error}") from error
    if len(raw) > _MAX_BYTES:
        raise LogFormatError(f"'{path.name}' has more than {_MAX_BYTES} bytes.")
    return raw.decode("utf-8", errors="replace")


def _file(folder: Path, *names: str) -> Path:
    for name in names:
        for candidate in (folder / name, folder / f"{name}.gz"):
            if candidate.is_file():
                return candidate
    raise LogFormatError(f"Folder '{folder.name}' has no {names[0]}, nor {names[0]}.gz.")


def _matrix(content: dict[str, object], name: str, columns: int, source: str) -> FloatArray:
    value = np.asarray(content.get(name))
    if value.ndim != 2 or value.shape[1] != columns or value.dtype.kind not in "fiu":
        raise LogFormatError(
            f"'{source}': '{name}' has shape {value.shape}; it must be numbers (N, {columns})."
        )
    out = np.asarray(value, dtype=np.float64)
    if not np.isfinite(out).all():
        row = int(np.argwhere(~np.isfinite(out))[0, 0])
        raise LogFormatError(f"'{source}': row {row + 1} of '{name}' has a number that is not finite.")
    return out


def _landmarks(
    source: str, ids: FloatArray | IntArray, positions: FloatArray, sigma: FloatArray
) -> LandmarkSet:
    try:
        return LandmarkSet(tuple(str(int(k)) for k in ids), positions, sigma=sigma)
    except MapError as error:
        raise LogFormatError(f"'{source}': {error}") from error
