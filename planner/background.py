"""Work that only makes later answers quicker: one job at a time, in a thread that gives way to all others."""

from __future__ import annotations

import os
import sys
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
import numpy.typing as npt

#: Makes a value; ends early, with whatever, when the flag (1,) is set.
Make = Callable[[npt.NDArray[np.uint8]], Any]
#: Takes the owner and the value.
Keep = Callable[[Any, Any], object]

_LOWEST_PRIORITY = 19
# So many questions are remembered to know which are asked again.
_REMEMBERED = 1000


class Background:
    """Jobs of one owner, done in order by a thread that lives as long as there are any.

    Parameters
    ----------
    owner
        Held weakly: when nobody else holds it, what is running is stopped and the rest is dropped.
    """

    def __init__(self, owner: object) -> None:
        self._lock = threading.Lock()
        self._jobs: OrderedDict[Hashable, tuple[Make, Keep]] = OrderedDict()
        self._asked: OrderedDict[Hashable, None] = OrderedDict()
        self._thread: threading.Thread | None = None
        self._stop = stop = np.zeros(1, dtype=np.uint8)
        self._owner = weakref.ref(owner, lambda _: stop.__setitem__(0, 1))

    def is_again(self, question: Hashable) -> bool:
        """Whether a question was asked before, among the last ones; it is remembered."""
        with self._lock:
            known = question in self._asked
            self._asked[question] = None
            self._asked.move_to_end(question)
            if len(self._asked) > _REMEMBERED:
                self._asked.popitem(last=False)
            return known

    def add(self, key: Hashable, make: Make, keep: Keep) -> None:
        """Make a value some time and hand it to the owner; what waits or runs under the key is not repeated.

        ``make`` must not refer to the owner.
        """
        with self._lock:
            if key in self._jobs:
                return
            self._jobs[key] = (make, keep)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="surepath-background", daemon=True)
                self._thread.start()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until nothing is left to do; whether that came within ``timeout`` s."""
        with self._lock:
            thread = self._thread
        if thread is None:
            return True
        thread.join(timeout)
        return not thread.is_alive()

    def _run(self) -> None:
        if sys.platform == "linux":
            # There, threads have priorities of their own.
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOWEST_PRIORITY)
        while True:
            with self._lock:
                if not self._jobs or self._stop[0]:
                    self._jobs.clear()
                    self._thread = None
                    return
                key, (make, keep) = next(iter(self._jobs.items()))
            value = make(self._stop)
            owner = self._owner()
            if owner is not None:
                keep(owner, value)
            del owner, value
            with self._lock:
                self._jobs.pop(key, None)
