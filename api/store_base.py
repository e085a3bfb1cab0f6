"""What every shelf of the store stands on: folder, lock, database, errors, room that is left."""

from __future__ import annotations

import fcntl
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa
from sqlalchemy import exc

from api import store_schema as db
from api.lru import LruCache
from api.settings import Settings
from api.store_files import disk
from api.store_records import StorageFull, StoreUnavailable
from localization.heading_field import HeadingField
from localization.uncertainty_field import LAYERS, UncertaintyField
from maps.floor_plan import FloorPlan
from maps.world import World

DAY_S = 86400.0
PLANS_KEPT_S = 7 * DAY_S
JOBS_KEPT_S = 30 * DAY_S


class StoreBase:
    """An opened data folder; one process at a time holds it.

    Parameters
    ----------
    settings
        Folder (made if it is missing), limits, memory for what was read lately.

    Raises
    ------
    StoreUnavailable
        If the folder cannot be used, is held by another process, or was written by a newer version.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.data_dir = settings.data_dir.expanduser().absolute()
        self._maps_dir = self.data_dir / "maps"
        self._fields_dir = self.data_dir / "fields"
        self._staging_dir = self.data_dir / "staging"
        # Files and rows change together: one change at a time within this process.
        self._lock = threading.RLock()
        self._worlds: LruCache[World] = LruCache(settings.cache_bytes, _world_bytes)
        self._fields: LruCache[UncertaintyField | HeadingField] = LruCache(settings.cache_bytes, field_bytes)
        with disk(f"use the data folder '{self.data_dir}'"):
            for folder in (self._maps_dir, self._fields_dir, self._staging_dir):
                folder.mkdir(parents=True, exist_ok=True)
            self._held = (self.data_dir / "lock").open("a")
        try:
            self._hold()
            with self._database():
                self._engine = db.open_engine(self.data_dir / "surepath.db")
        except BaseException:
            self._held.close()
            raise
        self._write_engine = self._engine.execution_options(write=True)

    def _hold(self) -> None:
        try:
            fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise StoreUnavailable(
                f"Another process uses the data folder '{self.data_dir}'; stop it or choose another folder."
            ) from error

    def close(self) -> None:
        """Let go of the folder."""
        self._engine.dispose()
        self._held.close()

    @contextmanager
    def _database(self) -> Iterator[None]:
        try:
            yield
        except exc.SQLAlchemyError as error:
            cause = getattr(error, "orig", None) or error
            if isinstance(cause, sqlite3.Error) and cause.sqlite_errorcode == sqlite3.SQLITE_FULL:
                raise StorageFull("The disk is full: the database cannot grow. Free some space.") from error
            raise StoreUnavailable(f"The database does not answer: {cause}.") from error

    @contextmanager
    def _read(self) -> Iterator[sa.Connection]:
        with self._database(), self._engine.begin() as connection:
            yield connection

    @contextmanager
    def _write(self) -> Iterator[sa.Connection]:
        with self._lock, self._database(), self._write_engine.begin() as connection:
            yield connection

    def check(self) -> None:
        """Read one row, for readiness probes.

        Raises
        ------
        StoreUnavailable
            If the database does not answer.
        """
        with self._read() as connection:
            connection.execute(sa.select(db.info.c.schema_version)).scalar_one()

    def used_bytes(self) -> int:
        """Bytes of all maps, fields and plans."""
        with self._read() as connection:
            return _used(connection)

    def _require_room(self, connection: sa.Connection, wanted: int, what: str) -> None:
        limit = self._settings.max_storage_bytes
        needed = _used(connection) + wanted
        if needed > limit:
            raise StorageFull(
                f"No room for {what}: {needed} bytes would be stored, the limit is {limit} "
                "(SUREPATH_MAX_STORAGE_BYTES). Delete fields or maps, or raise the limit.",
                limit=limit,
                requested=needed,
            )


def _used(connection: sa.Connection) -> int:
    sums = [
        sa.select(sa.func.coalesce(sa.func.sum(table.c.size), 0)).scalar_subquery()
        for table in (db.maps, db.fields, db.plans)
    ]
    return int(connection.execute(sa.select(sums[0] + sums[1] + sums[2])).scalar_one())


def _world_bytes(world: World) -> int:
    floor = world.floor
    if isinstance(floor, FloorPlan):
        return 200 * sum(len(p.exterior.coords) for p in (*floor.floor, *floor.obstacles)) + 1000
    return floor.free.nbytes + floor.opaque.nbytes + floor.unknown.nbytes


def field_bytes(field: UncertaintyField | HeadingField) -> int:
    """Memory of a field's arrays."""
    if isinstance(field, HeadingField):
        return sum(field_bytes(one) for one in field.slices)
    return field.free.nbytes + sum(int(getattr(field, name).nbytes) for name in LAYERS)


def now() -> float:
    """Seconds since 1970."""
    return time.time()


def plain(row: Any) -> dict[str, Any]:
    """A row's columns by name."""
    return dict(row._mapping)  # noqa: SLF001  (the documented accessor of SQLAlchemy)
