"""What the store holds, as plain values, and the errors it raises.

::

    SurepathError
    └── StoreError
        ├── NotFound           no such map, field, job or plan
        ├── InUse              something else needs what should be deleted
        ├── VersionChanged     a map has a newer version than the one that was changed
        ├── FieldNotReady      the field is still being computed, or its computation failed
        ├── StorageFull        the limit, or the disk, leaves no room
        └── StoreUnavailable   disk or database do not answer as they should
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from localization.method import FieldMethod
from localization.sensors import Sensor, sensor_from_dict
from maps.errors import SurepathError
from maps.grid import GridFrame


class StoreError(SurepathError):
    """The store cannot do what was asked."""


class NotFound(StoreError):
    """There is no such map, field, job or plan."""


class InUse(StoreError):
    """Something else still needs what should be deleted."""


class VersionChanged(StoreError):
    """A map has a newer version than the one that a change was made from.

    Attributes
    ----------
    newest
        Id of the newest version.
    """

    def __init__(self, message: str, *, newest: str | None = None) -> None:
        super().__init__(message)
        self.newest = newest


class FieldNotReady(StoreError):
    """A field that is not computed yet, or could not be.

    Attributes
    ----------
    job
        Id of the job that computes it, or that failed.
    order
        Body of ``POST /v1/fields`` that has it computed again; None while a job is at it.
    """

    def __init__(self, message: str, *, job: str | None = None, order: dict[str, Any] | None = None) -> None:
        super().__init__(message)
        self.job = job
        self.order = order


class StorageFull(StoreError):
    """No room is left within the limit or on the disk.

    Attributes
    ----------
    limit, requested, setting
        Bytes allowed in all, bytes needed in all, and what sets the limit; None when the disk itself is full.
    """

    def __init__(self, message: str, *, limit: int | None = None, requested: int | None = None) -> None:
        super().__init__(message)
        self.limit = limit
        self.requested = requested
        self.setting = None if limit is None else "SUREPATH_MAX_STORAGE_BYTES"


class StoreUnavailable(StoreError):
    """Disk or database do not answer as they should; trying again later may help."""


class FieldStatus(StrEnum):
    """State of a field."""

    RUNNING = "running"
    READY = "ready"
    FAILED = "failed"


class JobStatus(StrEnum):
    """State of a job, in the words of OGC API Processes."""

    ACCEPTED = "accepted"
    RUNNING = "running"
    SUCCESSFUL = "successful"
    FAILED = "failed"
    DISMISSED = "dismissed"

    @property
    def ended(self) -> bool:
        """Whether nothing will change any more."""
        return self not in {JobStatus.ACCEPTED, JobStatus.RUNNING}


@dataclass(frozen=True, slots=True)
class MapRecord:
    """A stored map version; times in s since 1970, lengths in m.

    Attributes
    ----------
    id
        ``m_`` + content hash.
    name
        The label it was stored under last.
    kind
        ``grid`` or ``polygons``.
    bounds
        ``(x_min, y_min, x_max, y_max)`` in W, m.
    resolution, shape
        Of a grid's cells: m and (rows, columns); None for polygons.
    free_area
        m².
    size
        Bytes on disk.
    parent
        Id of the version it was made from.
    """

    id: str
    name: str
    kind: str
    bounds: tuple[float, float, float, float]
    resolution: float | None
    shape: tuple[int, int] | None
    n_landmarks: int
    free_area: float
    size: int
    parent: str | None
    created: float


@dataclass(frozen=True, slots=True)
class FieldRecord:
    """A field, or the request for one.

    Attributes
    ----------
    id
        ``f_`` + content hash of map, sensor, grid, heading and method.
    sensor_values
        As of :func:`localization.sensors.sensor_to_dict`.
    frame
        Its cells.
    heading
        rad; 0 for sensors that do not depend on it, and over headings.
    headings
        How many evenly spaced ones from 0 on; 1: only ``heading``.
    estimator, criterion
        How its fixes are made, see :attr:`method`.
    field_format
        Version of its numbers and files; one of an earlier version is not read any more.
    size, checksum
        Bytes on disk and SHA-256 over its files; 0 and None until it is ready.
    job
        Id of the newest job that computes or computed it; None once it is of an earlier version.
    error
        Why it failed.
    """

    id: str
    map_id: str
    sensor_values: dict[str, Any]
    frame: GridFrame
    heading: float
    headings: int
    estimator: str
    criterion: str
    field_format: int
    status: FieldStatus
    size: int
    checksum: str | None
    job: str | None
    error: str | None
    created: float
    ended: float | None

    @property
    def sensor(self) -> Sensor:
        """The sensor itself."""
        return sensor_from_dict(self.sensor_values)

    @property
    def method(self) -> FieldMethod:
        """How its fixes are made."""
        return FieldMethod(self.estimator, self.criterion)  # type: ignore[arg-type]  # it checks itself

    @property
    def resolution(self) -> float:
        """Side of a cell, m."""
        return self.frame.resolution


@dataclass(frozen=True, slots=True)
class JobRecord:
    """The computation of a field.

    Attributes
    ----------
    done, total
        Tiles; both 0 until the work is cut into tiles.
    attempts
        How often a worker took it up.
    error
        Why it failed.
    created, started, ended
        s since 1970.
    """

    id: str
    field_id: str
    status: JobStatus
    done: int
    total: int
    attempts: int
    error: str | None
    created: float
    started: float | None
    ended: float | None


@dataclass(frozen=True, slots=True)
class PlanRecord:
    """A stored answer to a planning request; ``body`` is its JSON, encoded once."""

    id: str
    field_id: str
    body: bytes
    created: float

    @property
    def answer(self) -> dict[str, Any]:
        """The answer as values."""
        values: dict[str, Any] = json.loads(self.body)
        return values
