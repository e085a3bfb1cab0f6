"""Importer of Roh's logs: a rotating detector and four landmarks at known places, bearings in degrees.

``landmark.csv`` has the landmarks (x, y in m); each ``X<x>_Y<y>.csv`` the readings at one place, one scan per
line with a bearing for every landmark, in degrees, robot frame, counter-clockwise. The robot heads to +90°.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from localization.errors import LogFormatError
from localization.io.mrclam import table
from localization.logs import BearingLog, Sighting
from maps.arrays import FloatArray, IntArray
from maps.errors import MapError
from maps.landmarks import LandmarkSet

_PLACE = re.compile(r"^\(?X(-?\d+(?:\.\d+)?)[_,]Y(-?\d+(?:\.\d+)?)\)?\.csv$")
_HEADING = math.pi / 2


def read_roh(folder: str | Path) -> BearingLog:
    """All places of a folder, in the order of their names; the readings of one place are one block.

    Raises
    ------
    LogFormatError
        If there is no place, or a file is not such a file.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise LogFormatError(f"There is no folder '{folder}'.")
    positions = table(folder / "landmark.csv", 2)
    try:
        landmarks = LandmarkSet(tuple(str(i + 1) for i in range(len(positions))), positions)
    except MapError as error:
        raise LogFormatError(f"'{folder.name}': {error}") from error
    n = len(landmarks)
    bearing: list[FloatArray] = []
    reference: list[FloatArray] = []
    block: list[IntArray] = []
    for path in sorted(folder.iterdir()):
        match = _PLACE.match(path.name)
        if match is None:
            continue
        rows = np.radians(table(path, n))
        bearing.append(rows)
        reference.append(np.tile([float(match[1]), float(match[2]), _HEADING], (len(rows), 1)))
        block.append(np.full(len(rows), len(block)))
    if not bearing:
        raise LogFormatError(f"Folder '{folder.name}' has no file like X1.5_Y3.0.csv.")
    readings = np.concatenate(bearing)
    scans = len(readings)
    return BearingLog(
        "Roh",
        landmarks,
        np.repeat(np.arange(scans, dtype=np.float64), n),
        np.tile(np.arange(n), scans),
        readings.reshape(-1),
        np.repeat(np.concatenate(reference), n, axis=0),
        np.full(scans * n, Sighting.USABLE),
        np.repeat(np.concatenate(block), n),
    )
