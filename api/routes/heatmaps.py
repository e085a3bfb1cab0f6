"""Fields as pictures and arrays."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, Query, Request
from pydantic import BaseModel, ConfigDict
from starlette.responses import Response

from api.caching import HOUR, conditional, etag_of
from api.canvas import BBox, InvalidPicture, check_bbox, picture_size
from api.colormaps import COLORMAPS, DEFAULT_COLORMAP
from api.dependencies import Service_
from api.errors import InvalidRequest
from api.field_views import HeadingQuery, normal_heading, shown_field
from api.render import BAR_WIDTH, default_scale, heatmap_png, room_for_bar
from api.routes.common import NOT_MODIFIED, binary, problems
from api.settings import LimitExceeded
from localization.uncertainty_field import METRICS

router = APIRouter(prefix="/v1/fields", tags=["heatmaps"])

#: Part of every tag: changes when the same question gives another picture.
RENDERER = 2
_MAX_SIDE = 16_384
_LARGEST = 1e9
_SMALLEST_WINDOW_M = 0.01
METRIC = Query(description=f"One of {', '.join(METRICS)}.")
ColormapName = Annotated[str, Query(max_length=50, description=f"One of {', '.join(COLORMAPS)}.")]
Scale = Annotated[
    Literal["log", "linear"] | None,
    Query(description="Of the colours; default: linear for n_visible and validity, else log."),
]
if TYPE_CHECKING:
    Metric = str
else:  # the engine's list is the only one; a checker cannot read a Literal made at run time
    Metric = Literal[tuple(METRICS)]
Side = Annotated[int | None, Query(ge=16, le=_MAX_SIDE)]


class Picture(BaseModel):
    """Everything a heatmap is asked for, normalised."""

    model_config = ConfigDict(frozen=True)

    metric: str
    width: int | None
    height: int | None
    max_size: int
    bbox: BBox | None
    colormap: str
    vmin: float | None
    vmax: float | None
    scale: str
    legend: bool
    landmarks: bool
    heading: str | None


def rescale_query(of: str) -> Any:
    """The parameter of the ends of the colours; ``of`` says whose percentiles are the default."""
    return Query(
        max_length=100,
        description="Ends of the colours as min,max in the metric's unit; default: 1st and 99th "
        f"percentile of the {of}.",
        examples=["0.001,1"],
    )


def picture(
    metric: Annotated[Metric, METRIC] = "area95_m2",
    width: Annotated[Side, Query(description="Width with the colour bar, px.")] = None,
    height: Annotated[Side, Query(description="Height, px; a missing side follows from the other.")] = None,
    max_size: Annotated[
        int, Query(ge=16, le=_MAX_SIDE, description="Longer side when neither is given, px.")
    ] = 1200,
    bbox: Annotated[
        str | None, Query(max_length=200, description="Window x_min,y_min,x_max,y_max, m; default: all.")
    ] = None,
    colormap_name: ColormapName = DEFAULT_COLORMAP,
    rescale: Annotated[str | None, rescale_query("window")] = None,
    scale: Scale = None,
    legend: Annotated[bool, Query(description="Colour bar at the right.")] = True,
    landmarks: Annotated[bool, Query(description="Dots for landmarks.")] = True,
    heading: HeadingQuery = None,
) -> Picture:
    """The picture that the query asks for.

    Raises
    ------
    InvalidRequest, InvalidPicture
        If a list of numbers is not one, or makes no picture.
    """
    limits = limits_of(rescale)
    window = None if bbox is None else window_of(numbers_of(bbox, 4, "bbox"))
    return Picture(
        metric=metric,
        width=width,
        height=height,
        max_size=max_size,
        bbox=window,
        colormap=colormap_name,
        vmin=None if limits is None else limits[0],
        vmax=None if limits is None else limits[1],
        scale=default_scale(metric) if scale is None else scale,
        legend=legend,
        landmarks=landmarks,
        heading=heading,
    )


def limits_of(rescale: str | None) -> tuple[float, float] | None:
    """Ends of the colours; None if they were not given.

    Raises
    ------
    InvalidRequest, InvalidPicture
        If they are not two numbers, or not in order.
    """
    if rescale is None:
        return None
    low, high = numbers_of(rescale, 2, "rescale")
    if not 1e-9 * max(abs(low), abs(high)) < high - low:
        raise InvalidPicture(f"The colour range {low:g} … {high:g} is empty; give min,max with min < max.")
    return low, high


def numbers_of(text: str, count: int, name: str) -> list[float]:
    """Comma-separated numbers of a query.

    Raises
    ------
    InvalidRequest
        If they are not ``count`` finite ones.
    """
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) != count or not all(math.isfinite(v) and abs(v) <= _LARGEST for v in found):
        raise InvalidRequest(
            f"{name} must be {count} finite numbers with commas between them, none beyond 1e9.", place=name
        )
    return found


def window_of(values: list[float]) -> BBox:
    """A window of four numbers, m.

    Raises
    ------
    InvalidPicture
        If it is empty or too thin.
    """
    x0, y0, x1, y1 = values
    if not (x1 - x0 >= _SMALLEST_WINDOW_M and y1 - y0 >= _SMALLEST_WINDOW_M):
        raise InvalidPicture(
            f"The window {x0:g},{y0:g},{x1:g},{y1:g} is empty; give x_min,y_min,x_max,y_max in m, "
            f"each side at least {_SMALLEST_WINDOW_M:g} m."
        )
    if not 1e-3 <= (y1 - y0) / (x1 - x0) <= 1e3:
        raise InvalidPicture(f"The window {x0:g},{y0:g},{x1:g},{y1:g} is too thin for a picture.")
    return (x0, y0, x1, y1)


def _size(asked: Picture, bounds: BBox, limit: int) -> dict[str, int]:
    """Width and height, within the limit of pixels, that leave room for the colour bar.

    Raises
    ------
    InvalidPicture
        If the size asked for leaves none.
    LimitExceeded
        If there are more pixels than the limit.
    """
    extra = BAR_WIDTH if asked.legend else 0
    window = check_bbox(asked.bbox, bounds)
    width, height = picture_size(window, asked.width, asked.height, extra, asked.max_size)
    if width * height > limit:
        raise LimitExceeded(
            f"The picture would have {width} × {height} px, the limit is {limit} in all.",
            limit=limit,
            requested=width * height,
            setting="SUREPATH_MAX_HEATMAP_PIXELS",
        )
    if asked.legend:
        width, height = room_for_bar(width, height, (asked.width, asked.height))
    return {"width": width, "height": height}


@router.get(
    "/{field}/heatmap.png",
    response_class=Response,
    responses={
        200: binary("image/png", "The picture. Top row: highest y. Hatched: no fix."),
        **NOT_MODIFIED,
        **problems("not_found", "field_not_ready", "invalid_picture", "limit_exceeded", "store_unavailable"),
    },
)
def heatmap(
    field: str, request: Request, service: Service_, asked: Annotated[Picture, Depends(picture)]
) -> Response:
    """Heatmap of a metric over the floor, with a colour bar in its unit."""
    record = service.store.ready_field(field)
    asked = asked.model_copy(update={"heading": normal_heading(record, asked.heading)})
    tag = etag_of(record.id, asked.model_dump(), RENDERER, "image/png")

    def make() -> Response:
        png = service.pictures.get(tag)
        if png is None:
            with service.turn():
                values = shown_field(service, record, asked.heading or "", asked.metric)
                size = _size(asked, values.frame.bounds(), service.settings.max_heatmap_pixels)
                png = heatmap_png(values, **{**asked.model_dump(exclude={"heading"}), **size})
            service.pictures.put(tag, png)
        return Response(png, media_type="image/png")

    return conditional(request, tag, HOUR, make)


@router.get(
    "/{field}/heatmap.npy",
    response_class=Response,
    responses={
        200: binary("application/octet-stream", "numpy array (rows, columns), float64; NaN: no value."),
        **NOT_MODIFIED,
        **problems("not_found", "field_not_ready", "store_unavailable"),
    },
)
def heatmap_array(
    field: str,
    request: Request,
    service: Service_,
    metric: Annotated[Metric, METRIC] = "area95_m2",
    heading: HeadingQuery = None,
) -> Response:
    """The metric of every cell as a numpy file. Row 0: lowest y."""
    record = service.store.ready_field(field)
    which = normal_heading(record, heading)

    def make() -> Response:
        with service.turn():
            values = shown_field(service, record, which, metric)
            out = io.BytesIO()
            np.save(out, values.metric(metric), allow_pickle=False)
        name = f'attachment; filename="{metric}.npy"'
        return Response(
            out.getvalue(), media_type="application/octet-stream", headers={"Content-Disposition": name}
        )

    return conditional(request, etag_of(record.id, metric, which, RENDERER, "npy"), HOUR, make)
