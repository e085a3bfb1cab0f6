"""ETags, If-None-Match, and a small memory for finished answers."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable

from fastapi import Request
from starlette.responses import Response

#: What a name holds for good may be kept for good.
IMMUTABLE = "private, max-age=31536000, immutable"
HOUR = "private, max-age=3600"
REVALIDATE = "no-cache"


def etag_of(*parts: object) -> str:
    """Strong entity tag (without quotes) of everything that an answer depends on."""
    return hashlib.sha256("\x1f".join(map(repr, parts)).encode()).hexdigest()[:32]


def matches(request: Request, tag: str) -> bool:
    """Whether the client holds this entity already (weak comparison, as RFC 9110 wants for GET)."""
    given = request.headers.get("if-none-match", "")
    return any(part.strip().removeprefix("W/") in {f'"{tag}"', "*"} for part in given.split(","))


def if_match(request: Request) -> Callable[[str], bool] | None:
    """What If-Match says of a tag (strong comparison, RFC 9110); None if there is no such header."""
    given = request.headers.get("if-match")
    if given is None:
        return None
    parts = {part.strip() for part in given.split(",")}
    return lambda tag: "*" in parts or f'"{tag}"' in parts


def conditional(request: Request, tag: str, cache_control: str, make: Callable[[], Response]) -> Response:
    """304 without a body if the client holds the entity, else what ``make`` gives, with its tag."""
    answer = Response(status_code=304) if matches(request, tag) else make()
    answer.headers["ETag"] = f'"{tag}"'
    answer.headers["Cache-Control"] = cache_control
    return answer


class BytesCache:
    """Finished answers by key, the least recently used leaving first; safe between threads.

    Parameters
    ----------
    limit
        Bytes kept in all.

    Examples
    --------
    >>> kept = BytesCache(limit=3)
    >>> kept.put("a", b"xx"); kept.put("b", b"yy")
    >>> kept.get("a") is None, kept.get("b")
    (True, b'yy')
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._size = 0
        self._lock = threading.Lock()

    def get(self, key: str) -> bytes | None:
        """What was put under this key, if it is still here."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
            return self._kept.get(key)

    def put(self, key: str, value: bytes) -> None:
        """Keep a value; one larger than the limit is not kept."""
        with self._lock:
            if len(value) > self._limit:
                return
            self._size += len(value) - len(self._kept.pop(key, b""))
            self._kept[key] = value
            while self._size > self._limit:
                _, gone = self._kept.popitem(last=False)
                self._size -= len(gone)
