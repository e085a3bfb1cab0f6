"""Fields as figures: percentiles and histograms, of windows and areas, and windows as JSON."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request
from starlette.responses import Response

from api import answers_fields
from api.caching import HOUR, conditional, etag_of
from api.dependencies import Service_
from api.errors import InvalidRequest
from api.field_statistics import statistics
from api.field_views import HeadingQuery, normal_heading, shown_field
from api.field_window import cells_of, window_to_json
from api.render import default_scale
from api.routes.common import NOT_MODIFIED, answer, json_response, problems
from api.routes.heatmaps import METRIC, Metric, numbers_of, window_of
from api.schemas_statistics import (
    DEFAULT_BINS,
    DEFAULT_PERCENTILES,
    MAX_BINS,
    MAX_PERCENTILES,
    StatisticsIn,
)
from api.settings import LimitExceeded
from localization.uncertainty_field import METRICS

router = APIRouter(prefix="/v1/fields", tags=["heatmaps"])
#: Part of every tag: changes when the same question gives other figures.
FIGURES = 1
BBoxText = Annotated[
    str | None,
    Query(
        max_length=200,
        description="Window x_min,y_min,x_max,y_max, m; default: all.",
        examples=["4,10,20,14"],
    ),
]


def _percentiles(text: str | None) -> tuple[float, ...]:
    if text is None:
        return DEFAULT_PERCENTILES
    found = numbers_of(text, min(text.count(",") + 1, MAX_PERCENTILES), "percentiles")
    if not all(0 <= p <= 100 for p in found):
        raise InvalidRequest("percentiles must be numbers from 0 to 100.", place="percentiles")
    return tuple(found)


@router.get(
    "/{field}/statistics",
    responses={
        200: answer(answers_fields.FieldStatistics, "Figures over the free cells."),
        **NOT_MODIFIED,
        **problems("not_found", "field_not_ready", "invalid_picture", "store_unavailable"),
    },
)
def field_statistics(
    field: str,
    request: Request,
    service: Service_,
    metric: Annotated[Metric, METRIC] = "area95_m2",
    bbox: BBoxText = None,
    percentiles: Annotated[
        str | None,
        Query(max_length=1000, description="As in 5,50,95; default: 1,5,25,50,75,95,99.", examples=["50,95"]),
    ] = None,
    bins: Annotated[int, Query(ge=1, le=MAX_BINS, description="Of the histogram.")] = DEFAULT_BINS,
    scale: Annotated[
        Literal["log", "linear"] | None,
        Query(description="Of the histogram; default: linear for n_visible and validity, else log."),
    ] = None,
    heading: HeadingQuery = None,
) -> Response:
    """Percentiles, histogram, and the share of free cells with a fix and with one that can be believed.

    Of a field with more cells than `max_statistics_cells` every n-th of both axes counts: see `step`.
    """
    record = service.store.ready_field(field)
    window = None if bbox is None else window_of(numbers_of(bbox, 4, "bbox"))
    asked = _percentiles(percentiles)
    axis = default_scale(metric) if scale is None else scale
    which = normal_heading(record, heading)

    def make() -> Response:
        with service.turn():
            values = shown_field(service, record, which, metric)
            found = statistics(
                values,
                metric,
                bbox=window,
                percentiles=asked,
                bins=bins,
                scale=axis,
                most_cells=service.settings.max_statistics_cells,
            )
        return json_response({"field": record.id, **found})

    tag = etag_of("statistics", FIGURES, record.id, metric, window, asked, bins, axis, which)
    return conditional(request, tag, HOUR, make)


@router.post(
    "/{field}/statistics",
    responses={
        200: answer(answers_fields.AreaStatistics, "Figures of each area."),
        **problems(
            "malformed_body",
            "not_found",
            "field_not_ready",
            "too_large",
            "unsupported_media",
            "invalid_geometry",
            "store_unavailable",
        ),
    },
)
def area_statistics(field: str, question: StatisticsIn, service: Service_) -> Response:
    """The same figures for each of several areas: aisles, docks, a zone before and after a change."""
    if question.metric not in METRICS:
        raise InvalidRequest(f"metric must be one of {', '.join(METRICS)}.", place="#/metric")
    record = service.store.ready_field(field)
    which = normal_heading(record, question.heading)
    scale = default_scale(question.metric) if question.scale is None else question.scale
    with service.turn():
        values = shown_field(service, record, which, question.metric)
        found = [
            statistics(
                values,
                question.metric,
                area=area.to_polygon(),
                percentiles=question.percentiles,
                bins=question.bins,
                scale=scale,
                most_cells=max(1, service.settings.max_statistics_cells // len(question.areas)),
            )
            for area in question.areas
        ]
    return json_response({"field": record.id, "areas": found})


@router.get(
    "/{field}/heatmap.json",
    responses={
        200: answer(answers_fields.Window, "Values in rows. Row 0: lowest y."),
        **NOT_MODIFIED,
        **problems("not_found", "field_not_ready", "invalid_picture", "limit_exceeded", "store_unavailable"),
    },
)
def heatmap_values(
    field: str,
    request: Request,
    service: Service_,
    metric: Annotated[Metric, METRIC] = "area95_m2",
    bbox: BBoxText = None,
    max_size: Annotated[
        int,
        Query(ge=1, le=16_384, description="Values along the longer side at most; of more cells every n-th."),
    ] = 400,
    heading: HeadingQuery = None,
) -> Response:
    """A metric over a window as rows of numbers, for pages and scripts without numpy."""
    record = service.store.ready_field(field)
    which = normal_heading(record, heading)
    window = None if bbox is None else window_of(numbers_of(bbox, 4, "bbox"))
    cells = cells_of(record.frame, window, max_side=max_size)
    rows, cols = (len(range(*s.indices(n))) for s, n in zip(cells.slices, record.frame.shape, strict=True))
    if rows * cols > (limit := service.settings.max_json_cells):
        raise LimitExceeded(
            f"The window has {rows} × {cols} values, the limit is {limit} (SUREPATH_MAX_JSON_CELLS); "
            "give a smaller max_size or window.",
            limit=limit,
            requested=rows * cols,
            setting="SUREPATH_MAX_JSON_CELLS",
            place="max_size",
        )

    def make() -> Response:
        with service.turn():
            values = shown_field(service, record, which, metric)
            body = window_to_json(values, metric, cells)
        return json_response({"field": record.id, **body})

    return conditional(request, etag_of("heatmap.json", FIGURES, record.id, metric, cells, which), HOUR, make)
