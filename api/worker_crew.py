"""Keeps a number of worker processes alive and warm, and hands them out one at a time."""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Pipe, wait

from api.worker_orders import Loaded
from api.worker_process import State, TimedOut, Worker, WorkerDied, WorkerError
from localization.errors import Cancelled

log = logging.getLogger("surepath.workers")

_LONGEST_PAUSE_S = 30.0
#: So many workers compile the kernels; the others would only compile the same ones again.
_FIRST = 2


class Overloaded(WorkerError):
    """Every worker is busy and enough requests wait already, or none got free in time."""


@dataclass(slots=True)
class Turn:
    """A worker while somebody has it, and what is to become of it afterwards.

    Attributes
    ----------
    spoilt
        It is killed and replaced.
    detached
        Nobody waits for its answer any more; it is free when it is done, or killed when it takes longer
        than ``patience``, s.
    """

    worker: Worker
    spoilt: bool = False
    detached: bool = False
    patience: float = 1.0


class WorkerCrew:
    """Worker processes, each with one task at a time.

    Parameters
    ----------
    size
        How many; at least two, so that one is always kept from building fields.
    max_queue
        How many requests may wait.
    program
        What the workers run, as ``module:NAME`` of a :class:`api.worker_main.Program`.
    """

    def __init__(self, size: int, max_queue: int, program: str) -> None:
        self._size = max(2, size)
        self._max_queue = max_queue
        self._program = program
        #: How many fields may be computed at a time. Each one uses every core, at low priority.
        self.build_slots = max(1, self._size // 4)
        self._workers: list[Worker] = []
        self._waiting: deque[object] = deque()
        self._builds = 0
        self._started = 0
        self._failures = 0
        self._warm = False  # some worker is: the kernels are compiled
        self._ready = False
        self._closed = False
        self._changed = threading.Condition()
        self._wake_reader, self._wake_writer = Pipe(duplex=False)
        self._supervisor = threading.Thread(target=self._supervise, name="worker-supervisor", daemon=True)

    def start(self) -> None:
        """Start two workers; the others follow when the kernels are compiled. Returns at once."""
        self._supervisor.start()

    @property
    def ready(self) -> bool:
        """Whether all workers were warm once, and one is there now."""
        with self._changed:
            there = any(w.state is not State.STARTING for w in self._workers)
            return self._ready and there and not self._closed

    @property
    def closed(self) -> bool:
        """Whether :meth:`close` was called."""
        return self._closed

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
        self._wake_writer.close()
        self._wake_reader.close()

    # --- turns ------------------------------------------------------------------------------------

    @contextmanager
    def turn(
        self,
        ends_at: float | None,
        *,
        build: bool = False,
        prefer: str = "",
        cancelled: Callable[[], bool] | None = None,
    ) -> Iterator[Turn]:
        """A worker for the time of a ``with`` block.

        Parameters
        ----------
        ends_at
            Time (:func:`time.monotonic`) until which to wait for one; None: as long as it takes.
        build
            Whether it is for computing a field: does not queue with requests, and never takes the last
            worker that they could have.
        prefer
            Key of what the worker should have in memory.
        cancelled
            Asked while waiting; true ends it.

        Raises
        ------
        Overloaded
            If too many wait already, or none got free in time.
        Cancelled
            If ``cancelled()`` said so.
        WorkerDied
            If the crew is closed.
        """
        turn = Turn(self._acquire(ends_at, build=build, prefer=prefer, cancelled=cancelled))
        try:
            yield turn
        except (WorkerDied, TimedOut):
            turn.spoilt = not turn.detached
            raise
        finally:
            if build:
                with self._changed:
                    self._builds -= 1
            if turn.spoilt:
                self._discard(turn.worker)
            elif turn.detached:
                threading.Thread(target=self._finish, args=(turn,), daemon=True).start()
            else:
                self._release(turn.worker)

    def _acquire(
        self, ends_at: float | None, *, build: bool, prefer: str, cancelled: Callable[[], bool] | None
    ) -> Worker:
        ticket = object()
        with self._changed:
            if not build:
                if len(self._waiting) >= self._max_queue:
                    raise Overloaded(
                        f"{len(self._waiting)} requests wait for a worker already (limit "
                        f"{self._max_queue}, SUREPATH_MAX_QUEUE); try again in a moment."
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

    def _finish(self, turn: Turn) -> None:
        """Wait for a task that nobody waits for any more."""
        ends_at = time.monotonic() + turn.patience
        while (left := ends_at - time.monotonic()) > 0:
            try:
                kind, payload = turn.worker.receive(min(left, 1.0))
            except WorkerDied:
                break
            if kind in {"done", "error", "crash"}:
                if isinstance(payload, Loaded):
                    turn.worker.loaded = payload.kept
                self._release(turn.worker)
                return
        self._discard(turn.worker)

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
        # Children of this thread are born deaf to Ctrl-C. The tracker would lift the block: it comes first.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        pause_until = 0.0
        while not self._closed:
            now = time.monotonic()
            with self._changed:
                missing = self._size - len(self._workers)
                starting = [w for w in self._workers if w.state is State.STARTING]
                idle = [w for w in self._workers if w.state is State.IDLE]
            count = missing if self._warm else min(missing, _FIRST - len(starting))
            if count > 0 and now >= pause_until:
                self._spawn(count)
                continue
            lines = {w.line: w for w in starting}
            ends = {w.process.sentinel: w for w in (*starting, *idle)}
            timeout = max(0.0, pause_until - now) if count > 0 else 1.0
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
