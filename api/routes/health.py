"""Whether the service is alive, ready, and what it is."""

from __future__ import annotations

from importlib.metadata import version

from fastapi import APIRouter
from starlette.responses import Response

from api import answers_status
from api.codec_plan import engine_version
from api.codec_records import metrics_to_json
from api.colormaps import COLORMAPS, DEFAULT_COLORMAP
from api.dependencies import Service_
from api.routes.common import answer, json_response, problems
from maps.errors import SurepathError

router = APIRouter(tags=["service"])
_LIBRARIES = ("numpy", "numba", "ompl", "casadi", "zarr", "fastapi")


@router.get("/healthz", responses={200: answer(answers_status.Alive, "The process answers.")})
def healthz() -> Response:
    """Whether the process is alive."""
    return json_response({"status": "ok", "checks": {}})


@router.get(
    "/readyz",
    responses={
        200: answer(answers_status.Alive, "Store and workers answer; every kernel is compiled."),
        503: answer(answers_status.Alive, "Not yet, or not any more; `checks` says which part."),
    },
)
def readyz(service: Service_) -> Response:
    """Whether requests will be served without waiting for a start or a compile."""
    try:
        service.store.check()
        store = True
    except SurepathError:
        store = False
    checks = {"store": store, "workers": bool(service.pool.ready)}
    ready = all(checks.values())
    body = {"status": "ready" if ready else "not_ready", "checks": checks}
    return json_response(body, status=200 if ready else 503)


@router.get(
    "/v1/status",
    responses={
        200: answer(answers_status.Status, "Versions, limits, workers."),
        **problems("store_unavailable"),
    },
)
def status(service: Service_) -> Response:
    """Versions, planners, every limit with the setting that moves it, and the state of the workers."""
    settings = service.settings
    return json_response(
        {
            "service": "surepath",
            "version": engine_version(),
            "versions": {name: version(name) for name in _LIBRARIES},
            "planners": ["grid_search", "ompl", "casadi"],
            "limits": settings.limits,
            "workers": {"count": settings.workers, "ready": bool(service.pool.ready)},
            "maps": len(service.store.maps()),
            "fields": len(service.store.fields()),
        }
    )


@router.get("/v1/colormaps", responses={200: answer(answers_status.ColorMaps, "Names."), **problems()})
def colormaps() -> Response:
    """Colour maps and metrics that heatmaps take."""
    return json_response(
        {"colormaps": sorted(COLORMAPS), "default": DEFAULT_COLORMAP, "metrics": metrics_to_json()},
        headers={"Cache-Control": "private, max-age=3600"},
    )
