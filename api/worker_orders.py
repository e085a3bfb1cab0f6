"""What the service asks of its workers, and what they say of themselves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from api.codec_plan import FieldLabel
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import Sensor


@dataclass(frozen=True, slots=True)
class FieldOrder:
    """A field to compute.

    Attributes
    ----------
    field_id
        What the result must be.
    map_path, target
        Where the map is read and the field is written.
    sensor, resolution, heading, method
        As of :func:`localization.field_builder.build_field`.
    threads, max_cells
        Limits.
    """

    field_id: str
    map_path: Path
    target: Path
    sensor: Sensor
    resolution: float
    heading: float
    threads: int
    max_cells: int
    method: FieldMethod = BEST_AREA


@dataclass(frozen=True, slots=True)
class UploadLimits:
    """How large a decoded map may be: cells, landmarks, and bytes while it is decoded."""

    pixels: int
    landmarks: int
    memory: int


@dataclass(frozen=True, slots=True)
class Loaded:
    """A field that a worker has ready.

    Attributes
    ----------
    label
        Ids and landmarks.
    kept
        Names of all fields that the worker has in memory now.
    """

    label: FieldLabel
    kept: frozenset[str]
