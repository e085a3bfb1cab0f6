"""How long a job will still take, from its pace lately."""

from __future__ import annotations

import threading
from collections import deque

#: The pace is that of the last seconds, or of this share of the whole time if that is longer.
_WINDOW_S = 5.0
_WINDOW_SHARE = 0.3
#: Nothing is said from less.
_LEAST_S = 0.5


class Pace:
    """Progress of a job over time; safe between threads.

    Waiting for a worker and a slow start do not count for long, and while nothing gets done the time left
    grows: an estimate that stands still while the job does would be a lie.

    Examples
    --------
    >>> pace = Pace()
    >>> for second in range(11):
    ...     pace.note(10 * second, 200, at=second)
    >>> pace.left(at=10)
    10.0
    >>> pace.left(at=15)  # five seconds later nothing more was done: the pace is half of what it was
    20.0
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._notes: deque[tuple[float, int]] = deque()
        self._began = 0.0
        self._total = 0

    def note(self, done: int, total: int, at: float) -> None:
        """What is done at a time, s."""
        with self._lock:
            if not self._notes:
                self._began = at
            self._notes.append((at, done))
            self._total = total
            window = max(_WINDOW_S, _WINDOW_SHARE * (at - self._began))
            while len(self._notes) > 2 and self._notes[1][0] <= at - window:
                self._notes.popleft()

    def left(self, at: float) -> float | None:
        """Seconds from a time to the end; None: not known, also when only the writing is left."""
        with self._lock:
            if len(self._notes) < 2:
                return None
            (first_at, first), (_, done) = self._notes[0], self._notes[-1]
            took = at - first_at
            if took < _LEAST_S or done <= first or done >= self._total:
                return None
            return (self._total - done) * took / (done - first)
