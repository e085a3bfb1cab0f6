"""The application: everything put together, started and stopped."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import asynccontextmanager
from types import FrameType

import uvicorn
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import BaseRoute, Match
from starlette.types import Scope

from api import docs_page, landing_page, openapi, page_files, page_parts
from api.dependencies import Service
from api.errors import Problem
from api.jobs import JobRunner
from api.middleware import Outermost
from api.routes import (
    evaluations,
    fields,
    health,
    heatmaps,
    jobs,
    landmarks,
    many,
    maps,
    places,
    plans,
    statistics,
    tiles,
)
from api.settings import Settings
from api.store import Store
from api.workers import WorkerPool
from localization.sensors import LASER
from maps.errors import SurepathError
from maps.io.site import bundled_site

log = logging.getLogger("surepath")

PRELOADED = "warehouse"
_GRACE_S = 20


def create_app(settings: Settings, *, pool: WorkerPool | None = None) -> FastAPI:
    """The service as an ASGI application; store, workers and jobs start with its lifespan.

    Parameters
    ----------
    settings
        Limits and places.
    pool
        Workers to use; started and closed with the application. Default: as many as the settings say.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service = await run_in_threadpool(_start, settings, pool)
        app.state.service = service
        try:
            yield
        finally:
            await run_in_threadpool(_stop, service)

    app = FastAPI(
        title="surepath",
        version=openapi.VERSION,
        summary=openapi.SUMMARY,
        description=openapi.DESCRIPTION,
        openapi_tags=openapi.TAGS,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        docs_url=None,
        redoc_url=None,
        openapi_url=None,
        lifespan=lifespan,
        redirect_slashes=False,
    )
    for module in (
        maps,
        landmarks,
        fields,
        heatmaps,
        statistics,
        tiles,
        evaluations,
        plans,
        many,
        places,
        jobs,
        health,
        openapi,
        docs_page,
        landing_page,
        page_files,
        page_parts,
    ):
        app.include_router(module.router)
    app.openapi = lambda: openapi.document(app)  # type: ignore[method-assign]
    for kind in (SurepathError, RequestValidationError, HTTPException):
        app.add_exception_handler(kind, _answer_error)
    app.add_middleware(
        Outermost,
        upload_path=maps.UPLOAD_PATH,
        max_upload=settings.max_upload_bytes,
        max_body=settings.max_body_bytes,
    )
    return app


def _answer_error(request: Request, error: Exception) -> Response:
    """The one exception handler."""
    problem = Problem.of_exception(error)
    if problem.code == "method_not_allowed":
        # The first route with this path knows its own methods only.
        allowed = methods_of(request.app.routes, request.scope)
        problem = dataclasses.replace(problem, headers={**problem.headers, "Allow": ", ".join(allowed)})
    if problem.status >= 500:
        log.warning("%s %s: %s", request.method, request.url.path, error)
    return problem.response(request.url.path, request.state.request_id)


def methods_of(routes: Iterable[BaseRoute], scope: Scope) -> list[str]:
    """Methods of an address: of all routes with the path of the first one that matches a request."""
    found = [(r, getattr(r, "path", "")) for r in _flat(routes) if r.matches(scope)[0] is not Match.NONE]
    methods: set[str] = set()
    for route, path in found:
        if path == found[0][1]:
            methods |= getattr(route, "methods", None) or set()
    return sorted(methods)


def _flat(routes: Iterable[BaseRoute]) -> Iterator[BaseRoute]:
    """Routes, those of included routers too: FastAPI keeps the routers."""
    for route in routes:
        router = getattr(route, "original_router", None)
        if router is None:
            yield route
        else:
            yield from _flat(router.routes)


def _start(settings: Settings, pool: WorkerPool | None) -> Service:
    store = Store(settings)
    workers = WorkerPool(settings) if pool is None else pool
    workers.start()
    jobs = JobRunner(store, workers, settings)
    jobs.start()
    service = Service(settings, store, workers, jobs)
    if settings.preload and not store.maps():
        _preload(service)
    return service


def _preload(service: Service) -> None:
    """The warehouse and its field: something to look at and to plan on from the first minute."""
    record, _ = service.store.add_map(bundled_site(PRELOADED), name=PRELOADED)
    service.jobs.submit_field(record.id, LASER, 0.1, 0.0)


def _stop(service: Service) -> None:
    service.jobs.stop()
    service.pool.close()
    service.store.close()


def serve(settings: Settings) -> None:
    """Run the service until it is told to stop.

    Raises
    ------
    StoreUnavailable
        If the data folder cannot be used.
    """
    Store(settings).close()  # a folder that cannot be used is said before anything starts
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s %(message)s")
    config = uvicorn.Config(
        create_app(settings),
        host=settings.host,
        port=settings.port,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=_GRACE_S,
        lifespan="on",
    )
    _Server(config).run()


class _Server(uvicorn.Server):
    """Ends event streams at the first signal; they would keep the server waiting otherwise."""

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop, at once what would go on for long."""
        service = getattr(getattr(self.config.app, "state", None), "service", None)
        if service is not None:
            service.stopping.set()
        super().handle_exit(sig, frame)
