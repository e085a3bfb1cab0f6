"""Jobs: fields are computed in the background, reported, dismissed, and taken up again after a stop."""

from __future__ import annotations

import logging
import math
import threading
import time

from api.pace import Pace
from api.settings import LimitExceeded, Settings
from api.store import FieldRecord, JobRecord, JobStatus, Store, StoreUnavailable
from api.worker_process import WorkerError
from api.workers import FieldOrder, TaskCrashed, WorkerPool
from localization.errors import Cancelled, InvalidSensor
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import Sensor
from maps.errors import SurepathError
from maps.world import World

__all__ = ["MAX_ATTEMPTS", "JobRunner"]

log = logging.getLogger("surepath.jobs")

#: A job whose worker dies so often is given up.
MAX_ATTEMPTS = 3
#: Memory of a cell while its field is computed: the field, its visibility, and copies on the way.
BUILD_BYTES_PER_CELL = 120
_PROGRESS_S = 0.25
_STOP_S = 10.0
_PAUSE_S = 1.0


class JobRunner:
    """Threads that take accepted jobs from the store and have workers do them.

    Parameters
    ----------
    store, pool
        Where fields are kept, and who computes them.
    settings
        Limits of fields, threads of a computation.
    """

    def __init__(self, store: Store, pool: WorkerPool, settings: Settings) -> None:
        self._store = store
        self._pool = pool
        self._settings = settings
        self._changed = threading.Condition()
        self._dismissed: set[str] = set()
        self._current: set[str] = set()
        self._paces: dict[str, Pace] = {}
        self._stopping = False
        self._news = False
        self._threads = [
            threading.Thread(target=self._run, name=f"job-runner-{k}", daemon=True)
            for k in range(pool.build_slots)
        ]

    def start(self) -> None:
        """Take up what was left, and whatever is submitted from now on."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Stop computing; unfinished jobs wait in the store for the next start. Takes a few seconds."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        ends_at = time.monotonic() + _STOP_S
        for thread in self._threads:
            if thread.is_alive():
                thread.join(max(0.0, ends_at - time.monotonic()))

    def submit_field(
        self,
        map_id: str,
        sensor: Sensor,
        resolution: float,
        heading: float = 0.0,
        *,
        method: FieldMethod = BEST_AREA,
        headings: int = 1,
    ) -> tuple[FieldRecord, JobRecord | None]:
        """Ask for a field; the same content is never computed twice.

        Parameters
        ----------
        map_id
            Of a stored map.
        sensor, resolution, heading, method
            As of :func:`localization.field_builder.build_field`: m, rad.
        headings
            How many evenly spaced headings; 1: ``heading`` alone.

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
        TooFewLandmarks, InvalidGeometry
            If the map or the resolution admits no field.
        InvalidSensor
            If it sees the same at every heading, and several are wanted.
        LimitExceeded
            If the field would be too large.
        StorageFull
            If there would be no room for it.
        """
        world = self._store.world(map_id)
        world.require_triangulation()
        if headings > 1 and not sensor.depends_on_heading:
            raise InvalidSensor("This sensor sees the same at every heading; leave headings out.")
        self._require_size(world, resolution, headings)
        found = self._store.add_field_request(
            map_id, sensor, resolution, heading, method=method, headings=headings
        )
        with self._changed:
            self._news = True
            self._changed.notify_all()
        return found

    def _require_size(self, world: World, resolution: float, headings: int) -> None:
        if not (math.isfinite(resolution) and resolution > 0):
            return  # the frame will say it better
        x0, y0, x1, y1 = world.bounds
        cells = math.ceil((x1 - x0) / resolution) * math.ceil((y1 - y0) / resolution) * headings
        by_memory = self._settings.max_field_bytes // BUILD_BYTES_PER_CELL
        limit = min(self._settings.max_field_cells, by_memory)
        if cells <= limit:
            return
        name = "max_field_bytes" if limit == by_memory else "max_field_cells"
        setting = f"SUREPATH_{name.upper()}"
        enough = resolution * math.sqrt(cells / limit) * 1.01
        raise LimitExceeded(
            f"At {resolution:g} m the field of '{world.name}' has {cells} cells"
            f"{f' at {headings} headings' if headings > 1 else ''}, the limit is {limit} "
            f"({setting}); use a resolution of {enough:.2g} m or more.",
            limit=limit,
            requested=cells,
            setting=setting,
        )

    def dismiss(self, job_id: str) -> JobRecord:
        """End a job; if it is running, its worker stops within seconds. Ended jobs stay as they are.

        Raises
        ------
        NotFound
            If there is none.
        """
        record = self._store.dismiss_job(job_id)
        with self._changed:
            if job_id in self._current:
                self._dismissed.add(job_id)
                self._changed.notify_all()
        return record

    def pace_of(self, job_id: str) -> Pace | None:
        """The pace of a job that is computed here."""
        return self._paces.get(job_id)

    # --- the threads ------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._stopping:
            try:
                job = self._take()
                if job is None:
                    with self._changed:
                        # Submissions wake this thread; the timeout is for what another one put back.
                        self._changed.wait_for(lambda: self._stopping or self._news, 0.5)
                        self._news = False
                    continue
                try:
                    self._do(job)
                finally:
                    with self._changed:
                        self._current.discard(job.id)
                        self._dismissed.discard(job.id)
                        self._paces.pop(job.id, None)
            except Exception:
                log.exception("the job runner goes on after an error")
                time.sleep(1.0)

    def _take(self) -> JobRecord | None:
        for waiting in self._store.jobs(JobStatus.ACCEPTED):
            with self._changed:
                self._current.add(waiting.id)
            if (job := self._store.claim_job(waiting.id)) is not None:
                return job
            with self._changed:
                self._current.discard(waiting.id)
        return None

    def _cancelled(self, job_id: str) -> bool:
        return self._stopping or job_id in self._dismissed

    def _do(self, job: JobRecord) -> None:
        staged = self._store.staging_path(job.id)
        pace = self._paces[job.id] = Pace()
        try:
            field = self._store.field(job.field_id)
            order = FieldOrder(
                field_id=field.id,
                map_path=self._store.map_path(field.map_id),
                target=staged,
                sensor=field.sensor,
                resolution=field.resolution,
                heading=field.heading,
                headings=field.headings,
                method=field.method,
                threads=self._settings.workers,
                max_cells=self._settings.max_field_cells,
            )
            size, checksum = self._pool.build(
                order,
                on_progress=_Noter(self._store, job.id, pace),
                cancelled=lambda: self._cancelled(job.id),
            )
            if self._store.commit_field(job.id, staged, size=size, checksum=checksum):
                self._pool.prefetch(self._store.field_path(field.id))
        except Cancelled:
            self._put_back(job, "The job was cancelled.", its_fault=False)
        except (WorkerError, StoreUnavailable) as error:
            self._put_back(job, str(error), its_fault=not self._stopping)
        except SurepathError as error:
            self._store.fail_job(job.id, str(error))
        except TaskCrashed:
            log.exception("job %s crashed", job.id)
            self._store.fail_job(job.id, "The computation failed; the log of the service says why.")
        finally:
            self._store.discard_staged(staged)

    def _put_back(self, job: JobRecord, reason: str, *, its_fault: bool) -> None:
        """A dismissed job has ended in the store already; any other waits for its next attempt."""
        if its_fault and job.attempts >= MAX_ATTEMPTS:
            self._store.fail_job(job.id, f"Given up after {job.attempts} attempts: {reason}")
            return
        if its_fault:
            with self._changed:
                # What killed one worker may be about to kill the next: give it time to pass.
                self._changed.wait_for(lambda: self._cancelled(job.id), _PAUSE_S)
        self._store.release_job(job.id, refund=not its_fault)


class _Noter:
    """Writes progress to the store, not more often than four times a second."""

    def __init__(self, store: Store, job_id: str, pace: Pace) -> None:
        self._store = store
        self._job_id = job_id
        self._pace = pace
        self._last = -math.inf

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if done >= total or now - self._last >= _PROGRESS_S:
            self._last = now
            self._pace.note(done, total, now)
            try:
                self._store.set_progress(self._job_id, done, total)
            except SurepathError as error:
                log.warning("progress of job %s could not be noted: %s", self._job_id, error)
