"""The time of one plan: what is left, and a flag that ends a compiled search when nothing is."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

# Deadlines further away than this, s, are none.
_LONGEST_S = 1e6


class Stopped(Exception):
    """A flag ended a computation that has nothing to show before it is done; caught inside the planner."""


@contextmanager
def flag_at(deadline_at: float, flag: npt.NDArray[np.uint8] | None = None) -> Iterator[npt.NDArray[np.uint8]]:
    """Shape (1,): becomes 1 at a ``time.monotonic()``, for kernels that run without the interpreter's lock.

    A flag that is given is used, so that another thread can set it earlier.
    """
    if flag is None:
        flag = np.zeros(1, dtype=np.uint8)
    left = deadline_at - time.monotonic()
    if left <= 0:
        flag[0] = 1
    if left <= 0 or left > _LONGEST_S:
        yield flag
        return

    timer = threading.Timer(left, flag.__setitem__, (0, 1))
    timer.daemon = True
    timer.start()
    try:
        yield flag
    finally:
        timer.cancel()
        timer.join()


class Clock:
    """Time since a plan began, its deadline, and the seconds that each stage took.

    Parameters
    ----------
    deadline
        Seconds for the whole plan.
    """

    def __init__(self, deadline: float) -> None:
        self.began = time.monotonic()
        self.deadline = deadline
        self.seconds: dict[str, float] = {}

    @property
    def elapsed(self) -> float:
        """Seconds since the plan began."""
        return time.monotonic() - self.began

    def at(self, share: float = 1.0) -> float:
        """``time.monotonic()`` at which a share of the time is over, s."""
        return self.began + share * self.deadline

    def is_over(self, share: float = 1.0) -> bool:
        """Whether a share of the time is over."""
        return time.monotonic() >= self.at(share)

    @property
    def stats(self) -> dict[str, float]:
        """Seconds of the stages and in all, by name with the unit."""
        return {f"{name}_s": seconds for name, seconds in self.seconds.items()} | {"total_s": self.elapsed}

    def quiet(self) -> Clock:
        """Another with the same time, whose stages are not counted here."""
        other = Clock(self.deadline)
        other.began = self.began
        return other

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the seconds spent inside to a stage."""
        began = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.monotonic() - began

    @contextmanager
    def stop_flag(
        self, flag: npt.NDArray[np.uint8] | None = None, *, share: float = 1.0
    ) -> Iterator[npt.NDArray[np.uint8]]:
        """Shape (1,): becomes 1 when a share of the time is over, for kernels that run without the lock.

        A flag that is given is used, so that another thread can set it earlier.
        """
        with flag_at(self.at(share), flag) as given:
            yield given
