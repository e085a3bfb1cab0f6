"""A cache that forgets what was not used for longest, bounded by bytes, safe among threads."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class LruCache(Generic[T]):
    """Values by key; one thread loads a value while the others that want it wait.

    Parameters
    ----------
    limit
        Sum of the costs of what is kept, bytes; one value is kept whatever it costs.
    cost
        Bytes of a value.
    """

    def __init__(self, limit: int, cost: Callable[[T], int]) -> None:
        self._limit = limit
        self._cost = cost
        self._values: OrderedDict[str, tuple[T, int]] = OrderedDict()
        self._loading: dict[str, threading.Lock] = {}
        self._lock = threading.Lock()

    def get(self, key: str, load: Callable[[], T]) -> T:
        """The value of a key, loaded if it is not there; whatever ``load`` raises passes through."""
        with self._lock:
            if (found := self._values.get(key)) is not None:
                self._values.move_to_end(key)
                return found[0]
            gate = self._loading.setdefault(key, threading.Lock())
        with gate:
            with self._lock:
                if (found := self._values.get(key)) is not None:
                    self._values.move_to_end(key)
                    return found[0]
            try:
                value = load()
                self._put(key, value)
            finally:
                with self._lock:
                    self._loading.pop(key, None)
            return value

    def _put(self, key: str, value: T) -> None:
        with self._lock:
            self._values[key] = (value, self._cost(value))
            while len(self._values) > 1 and sum(c for _, c in self._values.values()) > self._limit:
                self._values.popitem(last=False)

    def drop(self, key: str) -> None:
        """Forget a key."""
        with self._lock:
            self._values.pop(key, None)

    def __contains__(self, key: str) -> bool:
        with self._lock:
            return key in self._values
