"""What routes are given: the running service, and turns at drawing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated

from fastapi import Depends, Request

from api.caching import BytesCache
from api.errors import Busy
from api.jobs import JobRunner
from api.lru import LruCache
from api.settings import Settings
from api.store import Store
from api.store_base import field_bytes
from api.workers import WorkerPool
from localization.uncertainty_field import UncertaintyField

_PICTURES_BYTES = 64_000_000
_WAIT_S = 20.0


@dataclass
class Service:
    """Everything that lives as long as the service.

    Attributes
    ----------
    settings, store, pool, jobs
        Limits; maps, fields and plans; worker processes; computations of fields.
    pictures
        Finished PNGs by entity tag.
    views
        Best, worst and mean of fields over headings.
    stopping
        Set when the service is told to stop: whoever would go on for long ends then.
    """

    settings: Settings
    store: Store
    pool: WorkerPool
    jobs: JobRunner
    pictures: BytesCache = field(default_factory=lambda: BytesCache(_PICTURES_BYTES))
    views: LruCache[UncertaintyField] = field(init=False)
    stopping: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self._turns = threading.BoundedSemaphore(max(2, self.settings.workers))
        self.views = LruCache(self.settings.cache_bytes // 4, field_bytes)
        self._streams = threading.BoundedSemaphore(self.settings.max_streams)

    @contextmanager
    def turn(self) -> Iterator[None]:
        """One of few places at the processor: bounds the memory that pictures take together.

        Raises
        ------
        Busy
            If none gets free within 20 s.
        """
        if not self._turns.acquire(timeout=_WAIT_S):
            raise Busy("Too many pictures are being drawn; try again in a moment.")
        try:
            yield
        finally:
            self._turns.release()

    @contextmanager
    def stream(self) -> Iterator[None]:
        """One of the places for event streams.

        Raises
        ------
        Busy
            If all are taken.
        """
        if not self._streams.acquire(blocking=False):
            raise Busy(
                f"{self.settings.max_streams} event streams are open already, the limit "
                "(SUREPATH_MAX_STREAMS); ask GET /v1/jobs/{job} from time to time instead."
            )
        try:
            yield
        finally:
            self._streams.release()


def running_service(request: Request) -> Service:
    """The service that a request came to."""
    service: Service = request.app.state.service
    return service


Service_ = Annotated[Service, Depends(running_service)]
