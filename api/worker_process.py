"""The service's end of one worker process."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from enum import Enum
from multiprocessing.context import SpawnContext
from typing import Any

from api.worker_main import worker_main
from maps.errors import SurepathError

_POLL_S = 0.1
#: A task that was cancelled may take so long to notice.
CANCEL_GRACE_S = 5.0


class WorkerError(SurepathError):
    """A worker process could not do its task, through no fault of the request."""


class WorkerDied(WorkerError):
    """A worker process ended in the middle of its task."""


class TimedOut(WorkerError):
    """A task was not done in time; its worker is still at it."""


class DeadlineExceeded(WorkerError):
    """A question had no answer at its deadline, not even a part of one."""


class TaskCrashed(RuntimeError):
    """A bug showed itself in a task; the message is the worker's traceback."""


class State(Enum):
    """What a worker is doing."""

    STARTING = "starting"
    IDLE = "idle"
    BUSY = "busy"


class Worker:
    """A worker process and the line to it. Whoever has it BUSY is the only one to talk on the line.

    Attributes
    ----------
    state
        Guarded by the pool's lock.
    loaded
        Keys of what the worker has in memory, as it said last.
    """

    def __init__(self, program: str, number: int) -> None:
        context = SpawnContext()
        self.line, far_end = context.Pipe()
        self.process = context.Process(
            target=worker_main, args=(far_end, program, number), name=f"surepath-worker-{number}", daemon=True
        )
        self.process.start()
        far_end.close()  # so that its death is the end of the line
        self.state = State.STARTING
        self.loaded: frozenset[str] = frozenset()
        self._numbers = itertools.count()

    def ask(
        self,
        task: str,
        arguments: dict[str, Any],
        *,
        ends_at: float | None = None,
        on_progress: Callable[[int, int], None] | None = None,
        on_report: Callable[[Any], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> Any:
        """Have a task done, and wait for it.

        Parameters
        ----------
        ends_at
            Time (:func:`time.monotonic`) at which to give up.
        on_progress, on_report
            Called with what the task says meanwhile.
        cancelled
            Asked ten times a second; once true, the task is told and has 5 s to end.

        Raises
        ------
        WorkerDied
            If the process ended.
        TimedOut
            If it did not answer in time; it must not be asked anything else.
        TaskCrashed
            If a bug showed itself.
        SurepathError
            Whatever the task raised.
        """
        number = next(self._numbers)
        self._send(("task", number, task, arguments))
        told = False
        while True:
            wait = 1.0 if cancelled is None else _POLL_S
            if ends_at is not None and (wait := min(wait, ends_at - time.monotonic())) <= 0:
                raise TimedOut(f"The task '{task}' was not done in time.")
            kind, payload = self.receive(wait)
            if kind == "done":
                return payload
            if kind == "error":
                raise payload
            if kind == "crash":
                raise TaskCrashed(payload)
            if kind == "progress" and on_progress is not None:
                on_progress(*payload)
            elif kind == "report" and on_report is not None:
                on_report(payload)
            if not told and cancelled is not None and cancelled():
                told = True
                self._send(("cancel", number))
                ends_at = time.monotonic() + CANCEL_GRACE_S

    def receive(self, wait: float) -> tuple[str, Any]:
        """The next message, or ``("nothing", None)`` after ``wait`` s.

        Raises
        ------
        WorkerDied
            If the process ended.
        """
        try:
            if not self.line.poll(wait):
                return "nothing", None
            message: tuple[str, Any] = self.line.recv()
        except (EOFError, OSError) as error:
            raise WorkerDied("The worker process ended unexpectedly.") from error
        return message

    def _send(self, message: tuple[Any, ...]) -> None:
        try:
            self.line.send(message)
        except OSError as error:
            raise WorkerDied("The worker process ended unexpectedly.") from error

    def kill(self) -> None:
        """End the process, whatever it is doing; a call that waits for it ends with WorkerDied."""
        self.process.kill()

    def reap(self, timeout: float = 5.0) -> None:
        """Wait until the process is gone and let go of what belongs to it. Only its owner calls this."""
        self.process.kill()
        self.process.join(timeout)
        self.line.close()
