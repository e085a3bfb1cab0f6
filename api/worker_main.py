"""What runs inside a worker process: one task at a time, with word from and to the service meanwhile."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any

from maps.errors import SurepathError

_PROGRESS_S = 0.05


@dataclass(frozen=True, slots=True)
class Program:
    """What a worker can do. The service only names it (``module:NAME``): importing it is the worker's work.

    Attributes
    ----------
    warm_up
        Steps that are done once, in any order, before the worker says that it is ready. Workers begin with
        different ones, so that two of them, started together, share what has to be compiled.
    tasks
        By name: functions of a :class:`Channel` and keyword arguments. What they return, and every
        :class:`~maps.errors.SurepathError` they raise, goes back to the caller.
    """

    warm_up: tuple[Callable[[], None], ...]
    tasks: Mapping[str, Callable[..., Any]]


@dataclass(slots=True)
class Channel:
    """A task's line to the service.

    Attributes
    ----------
    memory
        Lives as long as the worker: what later tasks may use again.
    """

    _send: Callable[[str, Any], None]
    _stop: threading.Event
    memory: dict[str, Any]
    _last: float = field(default=0.0)

    def progress(self, done: int, total: int) -> None:
        """Say how far the task is; called too often, most calls are dropped, never the last one."""
        now = time.monotonic()
        if done >= total or now - self._last >= _PROGRESS_S:
            self._last = now
            self._send("progress", (done, total))

    def report(self, value: Any) -> None:
        """Hand over the best answer so far: it counts if the worker does not live to give a better one."""
        self._send("report", value)

    def cancelled(self) -> bool:
        """Whether nobody wants the result any more."""
        return self._stop.is_set()


def worker_main(line: Connection, program_name: str, number: int) -> None:
    """Serve tasks until the service hangs up or dies.

    Messages to the worker: ``("task", number, name, arguments)`` and ``("cancel", number)``. From it:
    ``("ready" | "progress" | "report" | "done" | "error" | "crash", payload)``.
    """
    # Ctrl-C goes to the whole group of processes; only the service decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    inbox: queue.SimpleQueue[tuple[int, str, dict[str, Any]]] = queue.SimpleQueue()
    cancelled: dict[int, threading.Event] = {}
    lock = threading.Lock()

    def send(kind: str, payload: Any) -> None:
        try:
            with lock:
                line.send((kind, payload))
        except OSError:
            os._exit(0)

    threading.Thread(target=_listen, args=(line, inbox, cancelled), daemon=True).start()
    try:
        module, name = program_name.split(":")
        program: Program = getattr(import_module(module), name)
        steps = program.warm_up
        first = number % max(1, len(steps))
        for step in (*steps[first:], *steps[:first]):
            step()
    except Exception as error:  # noqa: BLE001  (told to the service, which tries again later)
        send("crash", _words(error))
        return
    send("ready", os.getpid())
    memory: dict[str, Any] = {}
    while True:
        task, name, arguments = inbox.get()
        channel = Channel(send, cancelled[task], memory)
        try:
            result = program.tasks[name](channel, **arguments)
        except SurepathError as error:
            send(*_portable(error))
        except Exception as error:  # noqa: BLE001  (a bug or no memory: the service logs it and goes on)
            send("crash", _words(error))
        else:
            send("done", result)
        finally:
            del cancelled[task]
            arguments, result = {}, None  # nothing big is kept while the worker waits


def _listen(
    line: Connection,
    inbox: queue.SimpleQueue[tuple[int, str, dict[str, Any]]],
    cancelled: dict[int, threading.Event],
) -> None:
    while True:
        try:
            message = line.recv()
        except (EOFError, OSError):
            os._exit(0)  # the service is gone: so is every reason to go on
        if message[0] == "task":
            cancelled[message[1]] = threading.Event()
            inbox.put(message[1:])
        elif (event := cancelled.get(message[1])) is not None:
            event.set()


def _portable(error: SurepathError) -> tuple[str, Any]:
    """The error itself if it survives the way to the service, else its words."""
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301
    except Exception:  # noqa: BLE001
        return "crash", _words(error)
    return "error", error


def _words(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))
