"""The pool of worker processes: fields, plans and uploads are computed there, never in the service.

One worker is always kept for plans and uploads, so that computing fields never blocks them. A worker that
dies, or that is still at a plan 0.25 s after its deadline, is replaced.
"""

from __future__ import annotations

import dataclasses
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Pipe, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from api.codec_plan import seal
from api.settings import Settings
from api.worker_orders import FieldOrder, UploadLimits
from api.worker_process import State, TaskCrashed, TimedOut, Worker, WorkerDied, WorkerError
from localization.errors import Cancelled
from maps.errors import MapTooLarge
from maps.world import World
from planner.problem import PlanningProblem

if TYPE_CHECKING:
    from api.uploads import Upload

__all__ = ["FieldOrder", "Overloaded", "TaskCrashed", "WorkerDied", "WorkerError", "WorkerPool"]

log = logging.getLogger("surepath.workers")

PROGRAM = "api.worker_tasks:PROGRAM"
#: After its deadline a plan has so long to hand over what it has, s.
KILL_AFTER_S = 0.25
_LONGEST_PAUSE_S = 30.0


class Overloaded(WorkerError):
    """Every worker is busy and enough requests wait already, or none got free in time."""


class WorkerPool:
    """Worker processes, each with one task at a time.

    Parameters
    ----------
    settings
        Number of workers, length of the queue, limits of uploads.
    program
        What the workers run, as ``module:NAME`` of a :class:`api.worker_main.Program`.
    """

    def __init__(self, settings: Settings, *, program: str = PROGRAM) -> None:
        self._settings = settings
        self._program = program
        self._size = max(2, settings.workers)
        #: How many fields may be computed at a time. Each one uses every core, at low priority.
        self.build_slots = max(1, self._size // 4)
        self._workers: list[Worker] = []
        self._waiting: deque[object] = deque()
        self._builds = 0
        self._started = 0
        self._failures = 0
        self._warm = False  # the first worker is: the kernels are compiled
        self._ready = False
        self._closed = False
        self._changed = threading.Condition()
        self._wake_reader, self._wake_writer = Pipe(duplex=False)
        self._supervisor = threading.Thread(target=self._supervise, name="worker-supervisor", daemon=True)

    def start(self) -> None:
        """Start the first worker; the others follow when it has compiled the kernels. Returns at once."""
        self._supervisor.start()

    @property
    def ready(self) -> bool:
        """Whether all workers were warm once, and one is there now."""
        with self._changed:
            return (
                self._ready and not self._closed and any(w.state is not State.STARTING for w in self._workers)
            )

    def wait_ready(self, timeout: float) -> bool:
        """Wait until :attr:`ready`; False if it takes longer than ``timeout`` s."""
        with self._changed:
            return self._changed.wait_for(lambda: self._ready or self._closed, timeout) and self.ready

    def close(self) -> None:
        """End every worker at once; calls that wait for one raise WorkerDied."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            workers = list(self._workers)
            self._changed.notify_all()
        for worker in workers:
            worker.kill()
        self._wake()
        if self._supervisor.is_alive():
            self._supervisor.join(10.0)
        for worker in workers:
            worker.process.join(5.0)
        with self._changed:
            # Whoever has a busy one lets go of it himself.
            idle = [w for w in self._workers if w.state is not State.BUSY]
            self._workers = [w for w in self._workers if w.state is State.BUSY]
        for worker in idle:
            worker.reap()

    # --- requests ---------------------------------------------------------------------------------

    def plan(
        self,
        field_path: Path,
        problem: PlanningProblem,
        *,
        client_ref: str | None = None,
        warnings: Sequence[str] = (),
    ) -> dict[str, Any]:
        """Answer of ``POST /v1/plans``, at most 0.5 s after the problem's deadline.

        Waiting for a worker and reading the field count. A worker that is late is killed, and its last
        report is the answer, with a warning.

        Parameters
        ----------
        field_path
            Folder of a ready field.
        problem
            The question.
        client_ref, warnings
            As of :func:`api.codec.plan_to_json`.

        Raises
        ------
        PlannerError
            If the question is wrong.
        FieldFormatError
            If the field cannot be read.
        Overloaded
            If no worker got free, or the field could not be read, before the deadline.
        WorkerDied
            If the worker died before it had an answer.
        """
        ends_at = time.monotonic() + problem.deadline
        with self._turn(ends_at, prefer=field_path.name) as turn:
            self._load(turn, field_path, ends_at)
            reports: list[dict[str, Any]] = []
            arguments = {
                "path": field_path,
                "problem": problem,
                "ends_at": ends_at,
                "client_ref": client_ref,
                "warnings": tuple(warnings),
            }
            try:
                answer: dict[str, Any] = turn.worker.ask(
                    "plan", arguments, ends_at=ends_at + KILL_AFTER_S, on_report=reports.append
                )
            except TimedOut:
                turn.spoilt = True
                if not reports:
                    raise WorkerDied("The worker hung before it could answer; try again.") from None
                return _with_warning(reports[-1], "The planner was stopped after the deadline.")
            except WorkerDied:
                turn.spoilt = True
                if not (reports and reports[-1]["routes"]):
                    raise
                return _with_warning(reports[-1], "The planner ended unexpectedly.")
            return answer

    def _load(self, turn: _Turn, path: Path, ends_at: float) -> None:
        arguments = {"path": path, "keep_bytes": self._settings.cache_bytes}
        try:
            turn.worker.loaded = turn.worker.ask("load", arguments, ends_at=ends_at)
        except TimedOut:
            # Reading goes on, so that the next plan finds the field there.
            turn.detached = True
            raise Overloaded(
                "The field is still being read by the planner; try again, or with a longer deadline."
            ) from None

    def parse(self, upload: Upload) -> World:
        """Decode an upload, in a worker and under a limit of memory.

        Raises
        ------
        DocumentError, MapError, LimitExceeded
            If it is not a map, or too large.
        MapTooLarge
            Also if decoding takes too long or kills the worker.
        Overloaded
            If no worker got free.
        """
        limits = UploadLimits(
            pixels=self._settings.max_image_pixels,
            landmarks=self._settings.max_landmarks,
            memory=self._settings.max_parse_bytes,
        )
        parts = {f.name: getattr(upload, f.name) for f in dataclasses.fields(upload)}
        ends_at = time.monotonic() + self._settings.max_parse_s
        with self._turn(ends_at) as turn:
            try:
                world: World = turn.worker.ask("parse", {"parts": parts, "limits": limits}, ends_at=ends_at)
            except (TimedOut, WorkerDied) as error:
                turn.spoilt = True
                if self._closed:
                    raise
                raise MapTooLarge(
                    f"The map could not be decoded within {self._settings.max_parse_s:g} s "
                    "(SUREPATH_MAX_PARSE_S) and the memory allowed; send a smaller one."
                ) from error
            return world

    def build(
        self,
        order: FieldOrder,
        *,
        on_progress: Callable[[int, int], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> tuple[int, str]:
        """Compute a field into a folder; returns its bytes and checksum.

        Waits for a free worker as long as it takes.

        Raises
        ------
        Cancelled
            If ``cancelled()`` said so before it was done.
        WorkerDied
            If the worker died, or had to be killed because it did not stop.
        SurepathError
            Whatever :func:`localization.field_builder.build_field` raises.
        """
        with self._turn(None, build=True, cancelled=cancelled) as turn:
            result: tuple[int, str] = turn.worker.ask(
                "build", {"order": order}, on_progress=on_progress, cancelled=cancelled
            )
            return result

    # --- turns ------------------------------------------------------------------------------------

    @contextmanager
    def _turn(
        self,
        ends_at: float | None,
        *,
        build: bool = False,
        prefer: str = "",
        cancelled: Callable[[], bool] | None = None,
    ) -> Iterator[_Turn]:
        turn = _Turn(self._acquire(ends_at, build=build, prefer=prefer, cancelled=cancelled))
        try:
            yield turn
        except (WorkerDied, TimedOut):
            turn.spoilt = True
            raise
        finally:
            if build:
                with self._changed:
                    self._builds -= 1
            if turn.spoilt:
                self._discard(turn.worker)
            elif turn.detached:
                threading.Thread(target=self._finish, args=(turn.worker,), daemon=True).start()
            else:
                self._release(turn.worker)

    def _acquire(
        self, ends_at: float | None, *, build: bool, prefer: str, cancelled: Callable[[], bool] | None
    ) -> Worker:
        ticket = object()
        with self._changed:
            if not build:
                if len(self._waiting) >= self._settings.max_queue:
                    raise Overloaded(
                        f"{len(self._waiting)} requests wait for a worker already (limit "
                        f"{self._settings.max_queue}, SUREPATH_MAX_QUEUE); try again in a moment."
                    )
                self._waiting.append(ticket)
            try:
                while True:
                    if self._closed:
                        raise WorkerDied("The service is stopping.")
                    if cancelled is not None and cancelled():
                        raise Cancelled("The field was cancelled before it began.")
                    mine = self._builds < self.build_slots if build else self._waiting[0] is ticket
                    if mine and (worker := self._choose(prefer, build=build)) is not None:
                        worker.state = State.BUSY
                        self._builds += build
                        return worker
                    left = 0.2 if ends_at is None else ends_at - time.monotonic()
                    if left <= 0:
                        raise Overloaded("No worker got free before the deadline; try again in a moment.")
                    self._changed.wait(left)
            finally:
                if not build:
                    self._waiting.remove(ticket)
                    self._changed.notify_all()  # the next in the queue

    def _choose(self, prefer: str, *, build: bool) -> Worker | None:
        idle = [w for w in self._workers if w.state is State.IDLE and w.process.is_alive()]
        if build:
            # Planning contexts stay where they are.
            return min(idle, key=lambda w: len(w.loaded), default=None)
        return next((w for w in idle if prefer in w.loaded), idle[0] if idle else None)

    def _release(self, worker: Worker) -> None:
        with self._changed:
            worker.state = State.IDLE
            self._changed.notify_all()

    def _finish(self, worker: Worker) -> None:
        """Wait for a task that nobody waits for any more."""
        while True:
            try:
                kind, payload = worker.receive(1.0)
            except WorkerDied:
                self._discard(worker)
                return
            if kind in {"done", "error", "crash"}:
                worker.loaded = payload if kind == "done" else worker.loaded
                self._release(worker)
                return

    def _discard(self, worker: Worker) -> None:
        worker.reap()
        with self._changed:
            if worker in self._workers:
                self._workers.remove(worker)
            closed = self._closed
        if not closed:
            log.warning("worker %s ended or was killed; it is replaced", worker.process.pid)
        self._wake()

    # --- supervision ------------------------------------------------------------------------------

    def _wake(self) -> None:
        with suppress(OSError):
            self._wake_writer.send_bytes(b"!")

    def _supervise(self) -> None:
        """Start workers, note when they are warm, replace idle ones that die."""
        pause_until = 0.0
        while not self._closed:
            now = time.monotonic()
            with self._changed:
                missing = self._size - len(self._workers)
                starting = [w for w in self._workers if w.state is State.STARTING]
                idle = [w for w in self._workers if w.state is State.IDLE]
            if missing and now >= pause_until and (self._warm or not starting):
                self._spawn(missing if self._warm else 1)
                continue
            lines = {w.line: w for w in starting}
            ends = {w.process.sentinel: w for w in (*starting, *idle)}
            timeout = max(0.0, pause_until - now) if missing and not starting else 1.0
            for event in wait([self._wake_reader, *lines, *ends], timeout or 0.05):
                if event is self._wake_reader:
                    self._wake_reader.recv_bytes()
                elif (worker := lines.get(event)) is not None:  # type: ignore[call-overload]
                    if not self._hear(worker):
                        pause_until = time.monotonic() + min(_LONGEST_PAUSE_S, 0.5 * 2**self._failures)
                        self._failures += 1
                else:
                    self._lost(ends[event])  # type: ignore[index]

    def _spawn(self, count: int) -> None:
        for _ in range(count):
            self._started += 1
            worker = Worker(self._program, self._started)
            with self._changed:
                self._workers.append(worker)
                if self._closed:
                    worker.kill()

    def _hear(self, worker: Worker) -> bool:
        """The first word of a starting worker: that it is warm, or why it cannot be."""
        try:
            kind, payload = worker.receive(0.0)
        except WorkerDied as error:
            kind, payload = "crash", str(error)
        if kind == "nothing":
            return True
        if kind != "ready":
            if not self._closed:
                log.error("a worker could not start: %s", payload)
            self._discard(worker)
            return False
        with self._changed:
            worker.state = State.IDLE
            self._warm = True
            self._failures = 0
            warm = [w for w in self._workers if w.state is not State.STARTING]
            self._ready = self._ready or len(warm) >= self._size
            self._changed.notify_all()
        return True

    def _lost(self, worker: Worker) -> None:
        """An idle worker's process ended; if somebody took it meanwhile, he will notice himself."""
        with self._changed:
            if worker.state is not State.IDLE:
                return
            worker.state = State.BUSY
        self._discard(worker)


@dataclasses.dataclass(slots=True)
class _Turn:
    """A worker while a request has it, and what is to become of it afterwards."""

    worker: Worker
    spoilt: bool = False
    detached: bool = False


def _with_warning(answer: dict[str, Any], warning: str) -> dict[str, Any]:
    return seal({**answer, "warnings": [*answer["warnings"], warning]})
