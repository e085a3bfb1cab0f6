"""Fields in the store, and the jobs that compute them."""

from __future__ import annotations

import secrets
import uuid
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from api import store_schema as db
from api.codec_records import order_to_json
from api.store_base import JOBS_KEPT_S, now, plain
from api.store_files import move, read_field, remove, remove_all_but
from api.store_maps import MapShelf
from api.store_records import (
    FieldNotReady,
    FieldRecord,
    FieldStatus,
    InUse,
    JobRecord,
    JobStatus,
    NotFound,
    StoreUnavailable,
)
from localization.errors import FieldFormatError
from localization.heading_field import HeadingField, heading_field_hash
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import Sensor, sensor_to_dict
from localization.uncertainty_field import FIELD_FORMAT, UncertaintyField, field_hash
from maps.grid import GridFrame
from maps.se2 import wrap

#: What a cell takes before compression: seven variables and the area.
BYTES_PER_CELL = 61
_OUTDATED = "It is of an earlier version of surepath, whose numbers are not those of this one."
_LIVE = (JobStatus.ACCEPTED.value, JobStatus.RUNNING.value)


class FieldShelf(MapShelf):
    """Fields by content; each is requested, computed by a job, and never changes once ready."""

    def field_path(self, field_id: str) -> Path:
        """Folder of a ready field."""
        return self._fields_dir / f"{field_id}.zarr"

    def staging_path(self, job_id: str) -> Path:
        """A fresh folder name where a job writes its field before it is committed."""
        return self._staging_dir / f"{job_id}.{uuid.uuid4().hex[:8]}.zarr"

    def discard_staged(self, staged: Path) -> None:
        """Remove what a job left in its staging folder: whole, in parts, or nothing at all."""
        for path in self._staging_dir.iterdir():
            if staged.name in path.name:
                remove(path)

    def add_field_request(
        self,
        map_id: str,
        sensor: Sensor,
        resolution: float,
        heading: float = 0.0,
        *,
        method: FieldMethod = BEST_AREA,
        headings: int = 1,
    ) -> tuple[FieldRecord, JobRecord | None]:
        """Ask for a field, or one over several headings. The same content is never computed twice.

        Returns
        -------
        field
            New, or the one that is there.
        job
            The new job, or the one that is at it; None when the field is ready.

        Raises
        ------
        NotFound
            If there is no such map.
        StorageFull
            If there would be no room for it.
        """
        world = self.world(map_id)
        map_id = "m_" + world.content_hash()
        frame = world.grid_frame(resolution)
        heading = float(wrap(heading)) if sensor.depends_on_heading and headings == 1 else 0.0
        if headings == 1:
            field_id = "f_" + field_hash(world, sensor, frame, heading, method=method)
        else:
            field_id = "f_" + heading_field_hash(world, sensor, frame, headings, method=method)
        with self._write() as connection:
            row = connection.execute(sa.select(db.fields).where(db.fields.c.id == field_id)).first()
            if row is None or row.status == FieldStatus.FAILED.value:
                # The map may have been deleted since it was read.
                if connection.execute(sa.select(db.maps.c.id).where(db.maps.c.id == map_id)).first() is None:
                    raise NotFound(f"There is no map '{map_id}'; GET /v1/maps lists them.")
                wanted = BYTES_PER_CELL * frame.n_rows * frame.n_cols * headings
                self._require_room(connection, wanted, f"a field of {frame.n_rows} × {frame.n_cols} cells")
                job_id = self._insert_job(connection, field_id)
                values: dict[str, Any] = {
                    "map_id": map_id,
                    "sensor_values": sensor_to_dict(sensor),
                    "frame": list(frame.as_tuple()),
                    "heading": heading,
                    "headings": headings,
                    "estimator": method.estimator,
                    "criterion": method.criterion,
                    "field_format": FIELD_FORMAT,
                    "status": FieldStatus.RUNNING.value,
                    "size": 0,
                    "checksum": None,
                    "job": job_id,
                    "error": None,
                    "created": now(),
                    "ended": None,
                }
                if row is None:
                    connection.execute(sa.insert(db.fields).values(id=field_id, **values))
                else:
                    connection.execute(
                        sa.update(db.fields).where(db.fields.c.id == field_id).values(**values)
                    )
        field = self.field(field_id)
        job = self.job(field.job) if field.job and field.status is not FieldStatus.READY else None
        return field, job

    @staticmethod
    def _insert_job(connection: sa.Connection, field_id: str) -> str:
        job_id = "j_" + secrets.token_hex(12)
        status = JobStatus.ACCEPTED.value
        new = {"id": job_id, "field_id": field_id, "status": status, "created": now()}
        connection.execute(sa.insert(db.jobs).values(done=0, total=0, attempts=0, **new))
        return job_id

    def field(self, field_id: str) -> FieldRecord:
        """A field, ready or not.

        Raises
        ------
        NotFound
            If nobody ever asked for it.
        """
        with self._read() as connection:
            row = connection.execute(sa.select(db.fields).where(db.fields.c.id == field_id)).first()
        if row is None:
            raise NotFound(f"There is no field '{field_id[:100]}'; POST /v1/fields computes one.")
        return _field(row)

    def fields(self, map_id: str | None = None) -> list[FieldRecord]:
        """Every field, or those of one map; oldest first."""
        query = sa.select(db.fields).order_by(db.fields.c.created, db.fields.c.id)
        if map_id is not None:
            query = query.where(db.fields.c.map_id == map_id)
        with self._read() as connection:
            return [_field(row) for row in connection.execute(query).all()]

    def ready_field(self, field_id: str) -> FieldRecord:
        """A field that can be read.

        Raises
        ------
        NotFound
            If nobody ever asked for it.
        FieldNotReady
            If it is still being computed, failed, or is of an earlier version.
        """
        record = self.field(field_id)
        if record.status is FieldStatus.RUNNING:
            raise FieldNotReady(
                f"Field '{field_id}' is still being computed; wait for job {record.job}.", job=record.job
            )
        if record.status is FieldStatus.FAILED:
            raise FieldNotReady(
                f"Field '{field_id}' is not there: {record.error} Order it again: POST /v1/fields.",
                job=record.job,
                order=order_to_json(record),
            )
        return record

    def load_field(self, field_id: str) -> UncertaintyField | HeadingField:
        """The field itself, from memory if it was read lately.

        Raises
        ------
        NotFound, FieldNotReady
            As :meth:`ready_field`.
        StoreUnavailable
            If its files cannot be read.
        """
        record = self.ready_field(field_id)
        try:
            return self._fields.get(record.id, lambda: read_field(self.field_path(record.id)))
        except (FieldFormatError, OSError) as error:
            self.ready_field(field_id)  # deleted meanwhile: say so
            raise StoreUnavailable(
                f"Field '{field_id}' cannot be read: {error} Delete and rebuild it."
            ) from error

    def delete_field(self, field_id: str) -> None:
        """Remove a field.

        Raises
        ------
        NotFound
            If there is none.
        InUse
            If it is being computed.
        """
        with self._lock:
            record = self.field(field_id)
            if record.status is FieldStatus.RUNNING:
                raise InUse(f"Field '{field_id}' is being computed; dismiss job {record.job} first.")
            with self._write() as connection:
                connection.execute(sa.delete(db.fields).where(db.fields.c.id == record.id))
            self._fields.drop(record.id)
            remove(self.field_path(record.id))

    def commit_field(self, job_id: str, staged: Path, *, size: int, checksum: str) -> bool:
        """Make a computed field visible and end its job, both at once.

        Parameters
        ----------
        job_id
            The job that computed it.
        staged
            Where it lies, written and on the disk; on success it moves into the store.
        size, checksum
            As :func:`api.store_files.write_field` returned them.

        Returns
        -------
        bool
            False if the job was dismissed meanwhile; the files are gone then.

        Raises
        ------
        StorageFull, StoreUnavailable
            If it cannot be kept. The field stays invisible.
        """
        with self._lock:
            job = self.job(job_id)
            if job.status is not JobStatus.RUNNING:
                remove(staged)
                return False
            with self._read() as connection:
                self._require_room(connection, size, f"field '{job.field_id}'")
            # File first, row second: a crash in between leaves a file that no row knows, removed on start.
            move(staged, self.field_path(job.field_id))
            with self._write() as connection:
                ended = now()
                ready = {"status": FieldStatus.READY.value, "size": size, "checksum": checksum, "error": None}
                connection.execute(
                    sa.update(db.fields).where(db.fields.c.id == job.field_id).values(ended=ended, **ready)
                )
                connection.execute(
                    sa.update(db.jobs)
                    .where(db.jobs.c.id == job_id)
                    .values(status=JobStatus.SUCCESSFUL.value, ended=ended, error=None, done=db.jobs.c.total)
                )
        return True

    def job(self, job_id: str) -> JobRecord:
        """A job.

        Raises
        ------
        NotFound
            If there is none; ended jobs are forgotten after 30 days.
        """
        with self._read() as connection:
            row = connection.execute(sa.select(db.jobs).where(db.jobs.c.id == job_id)).first()
        if row is None:
            raise NotFound(f"There is no job '{job_id[:100]}'; ended jobs are kept for 30 days.")
        return _job(row)

    def jobs(self, *statuses: JobStatus) -> list[JobRecord]:
        """Jobs in one of these states (none given: all), oldest first."""
        query = sa.select(db.jobs).order_by(db.jobs.c.created, db.jobs.c.id)
        if statuses:
            query = query.where(db.jobs.c.status.in_([s.value for s in statuses]))
        with self._read() as connection:
            return [_job(row) for row in connection.execute(query).all()]

    def claim_job(self, job_id: str) -> JobRecord | None:
        """Take an accepted job up (one more attempt); None if it is not to be had any more."""
        change = (
            sa.update(db.jobs)
            .where(db.jobs.c.id == job_id, db.jobs.c.status == JobStatus.ACCEPTED.value)
            .values(status=JobStatus.RUNNING.value, attempts=db.jobs.c.attempts + 1, started=now())
        )
        with self._write() as connection:
            taken = connection.execute(change).rowcount == 1
        return self.job(job_id) if taken else None

    def release_job(self, job_id: str, *, refund: bool) -> None:
        """Put a running job back; ``refund`` when the attempt was not its fault."""
        attempts = db.jobs.c.attempts - 1 if refund else db.jobs.c.attempts
        change = {"status": JobStatus.ACCEPTED.value, "done": 0, "attempts": attempts}
        mine = (db.jobs.c.id == job_id, db.jobs.c.status == JobStatus.RUNNING.value)
        with self._write() as connection:
            connection.execute(sa.update(db.jobs).where(*mine).values(**change))

    def set_progress(self, job_id: str, done: int, total: int) -> None:
        """Note how far a running job is, in tiles."""
        mine = (db.jobs.c.id == job_id, db.jobs.c.status == JobStatus.RUNNING.value)
        with self._write() as connection:
            connection.execute(sa.update(db.jobs).where(*mine).values(done=done, total=total))

    def fail_job(self, job_id: str, error: str) -> None:
        """End a job that cannot be done, and its field with it; ended jobs stay as they are."""
        self._end(job_id, JobStatus.FAILED, error)

    def dismiss_job(self, job_id: str) -> JobRecord:
        """End a job on request; one that has ended stays as it is.

        Raises
        ------
        NotFound
            If there is none.
        """
        self.job(job_id)
        self._end(job_id, JobStatus.DISMISSED, "The job was dismissed.")
        return self.job(job_id)

    def _end(self, job_id: str, status: JobStatus, error: str) -> None:
        values = {"status": status.value, "error": error[:2000], "ended": now()}
        live = (db.jobs.c.id == job_id, db.jobs.c.status.in_(_LIVE))
        failed = {"status": FieldStatus.FAILED.value, "error": error[:2000], "ended": values["ended"]}
        with self._write() as connection:
            if connection.execute(sa.update(db.jobs).where(*live).values(**values)).rowcount:
                connection.execute(sa.update(db.fields).where(db.fields.c.job == job_id).values(**failed))

    def _recover_fields(self) -> None:
        """After a crash or a stop: files that no row knows go, jobs that were running wait again."""
        self._retire_fields()
        remove_all_but(self._staging_dir, set())
        ready = [f for f in self.fields() if f.status is FieldStatus.READY]
        remove_all_but(self._fields_dir, {self.field_path(f.id).name for f in ready})
        lost = [f.id for f in ready if not self.field_path(f.id).is_dir()]
        gone = {"status": FieldStatus.FAILED.value, "size": 0, "error": "Its files are missing."}
        for job in self.jobs(JobStatus.RUNNING):
            self.release_job(job.id, refund=True)
        with self._write() as connection:
            connection.execute(sa.update(db.fields).where(db.fields.c.id.in_(lost)).values(**gone))
            old = db.jobs.c.ended < now() - JOBS_KEPT_S
            connection.execute(sa.delete(db.jobs).where(old))

    def _retire_fields(self) -> None:
        """Fields, and orders, of an earlier version are failed ones: what they name is computed no more."""
        mine = (db.fields.c.field_format != FIELD_FORMAT, db.fields.c.status != FieldStatus.FAILED.value)
        ended = {"error": _OUTDATED, "ended": now()}
        failed = {"status": FieldStatus.FAILED.value, "size": 0, "checksum": None, "job": None, **ended}
        with self._write() as connection:
            old = sa.select(db.fields.c.id).where(*mine)
            waiting = (db.jobs.c.field_id.in_(old), db.jobs.c.status.in_(_LIVE))
            connection.execute(
                sa.update(db.jobs).where(*waiting).values(status=JobStatus.FAILED.value, **ended)
            )
            connection.execute(sa.update(db.fields).where(*mine).values(**failed))


def _field(row: Any) -> FieldRecord:
    values = plain(row)
    values["frame"] = GridFrame(*values["frame"])
    values["status"] = FieldStatus(values["status"])
    return FieldRecord(**values)


def _job(row: Any) -> JobRecord:
    values = plain(row)
    values["status"] = JobStatus(values["status"])
    return JobRecord(**values)
