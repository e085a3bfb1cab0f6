"""Fields as tiles, and the legend that all of them share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Path, Query, Request
from pydantic import BaseModel, ConfigDict
from starlette.responses import Response

from api import answers_fields
from api.caching import HOUR, IMMUTABLE, conditional, etag_of
from api.canvas import InvalidPicture
from api.codec_records import bounds_to_json
from api.colormaps import COLORMAPS, DEFAULT_COLORMAP
from api.dependencies import Service, Service_
from api.field_views import HeadingQuery, normal_heading, shown_field
from api.legend import legend_png, legend_to_json
from api.render import LEAST_HEIGHT, default_scale
from api.routes.common import NOT_MODIFIED, answer, binary, json_response, problems
from api.routes.heatmaps import (
    METRIC,
    RENDERER,
    ColormapName,
    Metric,
    Scale,
    limits_of,
    rescale_query,
)
from api.store_records import FieldRecord, NotFound
from api.tiles import TILE_PX, Pyramid, tile_npy, tile_png, whole_range
from localization.uncertainty_field import UncertaintyField

router = APIRouter(prefix="/v1/fields", tags=["heatmaps"])
_PICTURE = problems("not_found", "field_not_ready", "invalid_picture", "store_unavailable")
_Zoom = Annotated[int, Path(ge=0, le=40, description="0: the whole map.")]
_Index = Annotated[int, Path(ge=0, lt=2**40)]
Renderer = Annotated[
    int | None,
    Query(ge=0, lt=2**31, description=f"{RENDERER}, the renderer: the answer may be kept for good then."),
]


class Colours(BaseModel):
    """How a metric is coloured, normalised."""

    model_config = ConfigDict(frozen=True)

    metric: str
    colormap: str
    limits: tuple[float, float] | None
    scale: str
    heading: str | None

    def query(self, limits: tuple[float, float]) -> str:
        """As a query that names everything, the renderer too."""
        parts = {
            "metric": self.metric,
            "colormap_name": self.colormap,
            "rescale": f"{limits[0]!r},{limits[1]!r}",
            "scale": self.scale,
        }
        if self.heading is not None:
            parts["heading"] = self.heading
        return urlencode({**parts, "v": RENDERER}, safe=",")

    def query_of_values(self) -> str:
        """The part of the query that values depend on."""
        heading = {} if self.heading is None else {"heading": self.heading}
        return urlencode({"metric": self.metric, **heading, "v": RENDERER})


def colours(
    metric: Annotated[Metric, METRIC] = "area95_m2",
    colormap_name: ColormapName = DEFAULT_COLORMAP,
    rescale: Annotated[str | None, rescale_query("whole field")] = None,
    scale: Scale = None,
    heading: HeadingQuery = None,
) -> Colours:
    """The colours that the query asks for.

    Raises
    ------
    InvalidRequest, InvalidPicture
        If the range is none, or there is no such colour map.
    """
    if colormap_name not in COLORMAPS:
        raise InvalidPicture(f"Unknown colour map '{colormap_name}'; use one of {', '.join(COLORMAPS)}.")
    return Colours(
        metric=metric,
        colormap=colormap_name,
        limits=limits_of(rescale),
        scale=default_scale(metric) if scale is None else scale,
        heading=heading,
    )


Colours_ = Annotated[Colours, Depends(colours)]


def kept_for(renderer: int | None) -> str:
    """Cache-Control of a picture: for good if the address names this renderer."""
    return IMMUTABLE if renderer == RENDERER else HOUR


def _ready(service: Service, field: str, asked: Colours) -> tuple[FieldRecord, tuple[object, ...]]:
    """The field, and everything that its colours depend on, normalised: a part of every tag."""
    record = service.store.ready_field(field)
    if asked.metric == "validity" and record.estimator == "all_visible":
        raise InvalidPicture("Validity is not known for fixes of all landmarks in view; draw another metric.")
    parts = {**asked.model_dump(), "heading": normal_heading(record, asked.heading)}
    return record, (record.id, *parts.items())


def _shown(service: Service, record: FieldRecord, asked: Colours) -> UncertaintyField:
    return shown_field(service, record, normal_heading(record, asked.heading), asked.metric)


@router.get(
    "/{field}/legend.json",
    responses={200: answer(answers_fields.Legend, "Ends, ticks, colours."), **NOT_MODIFIED, **_PICTURE},
)
def legend_values(
    field: str, request: Request, service: Service_, asked: Colours_, v: Renderer = None
) -> Response:
    """The colour scale of a field as values: of tiles, and of heatmaps with the same `rescale`."""
    record, key = _ready(service, field, asked)

    def make() -> Response:
        values = _shown(service, record, asked)
        limits = whole_range(values, asked.metric, asked.limits, asked.scale)
        body = legend_to_json(asked.metric, asked.colormap, limits, asked.scale)
        return json_response({"field": record.id, **body})

    return conditional(request, etag_of("legend", key, RENDERER, "json"), kept_for(v), make)


@router.get(
    "/{field}/legend.png",
    response_class=Response,
    responses={200: binary("image/png", "A colour bar with ticks and unit."), **NOT_MODIFIED, **_PICTURE},
)
def legend_picture(
    field: str,
    request: Request,
    service: Service_,
    asked: Colours_,
    height: Annotated[int, Query(ge=LEAST_HEIGHT, le=2000, description="px.")] = 400,
    v: Renderer = None,
) -> Response:
    """The colour bar of a field, as it stands beside heatmaps."""
    record, key = _ready(service, field, asked)
    tag = etag_of("legend", key, height, RENDERER, "png")

    def make(values: UncertaintyField) -> bytes:
        limits = whole_range(values, asked.metric, asked.limits, asked.scale)
        doubtful = bool((values.has_fix & ~values.is_valid).any())
        return legend_png(asked.metric, asked.colormap, limits, asked.scale, height=height, doubtful=doubtful)

    return conditional(request, tag, kept_for(v), lambda: _picture(service, record, asked, tag, make))


def _picture(
    service: Service,
    record: FieldRecord,
    asked: Colours,
    tag: str,
    make: Callable[[UncertaintyField], bytes],
) -> Response:
    png = service.pictures.get(tag)
    if png is None:
        with service.turn():
            png = make(_shown(service, record, asked))
        service.pictures.put(tag, png)
    return Response(png, media_type="image/png")


@router.get(
    "/{field}/tilejson.json",
    responses={
        200: answer(answers_fields.TileJson, "Addresses, zooms, places."),
        **NOT_MODIFIED,
        **_PICTURE,
    },
)
def tilejson(
    field: str, request: Request, service: Service_, asked: Colours_, v: Renderer = None
) -> Response:
    """Where the tiles of a field are. Their addresses name the ends of the colours: all tiles share them."""
    record, key = _ready(service, field, asked)

    def make() -> Response:
        values = _shown(service, record, asked)
        limits = whole_range(values, asked.metric, asked.limits, asked.scale)
        here, query = f"/v1/fields/{record.id}", asked.query(limits)
        tile = f"{here}/tiles/{{z}}/{{x}}/{{y}}"
        pyramid = Pyramid.of(record.frame)
        return json_response(
            {
                "tilejson": "3.0.0",
                "name": f"{asked.metric} of {record.id}",
                "scheme": "xyz",
                "tiles": [f"{tile}.png?{query}"],
                "arrays": [f"{tile}.npy?{asked.query_of_values()}"],
                "minzoom": 0,
                "maxzoom": pyramid.max_zoom,
                "tile_size": TILE_PX,
                "pixel_m": [pyramid.pixel(z) for z in range(pyramid.max_zoom + 1)],
                "extent": bounds_to_json(pyramid.window(0, 0, 0)),
                "legend": f"{here}/legend.json?{query}",
                "rescale": list(limits),
            }
        )

    return conditional(request, etag_of("tilejson", key, asked.heading, RENDERER), kept_for(v), make)


def _require_tile(record: FieldRecord, z: int, x: int, y: int) -> None:
    pyramid = Pyramid.of(record.frame)
    if not pyramid.has(z, x, y):
        raise NotFound(
            f"There is no tile {z}/{x}/{y}; zooms go from 0 to {pyramid.max_zoom}, x and y from 0 to 2^z - 1."
        )


@router.get(
    "/{field}/tiles/{z}/{x}/{y}.png",
    response_class=Response,
    responses={
        200: binary("image/png", "256 × 256 px, clear where there is no free floor. Top row: highest y."),
        **NOT_MODIFIED,
        **_PICTURE,
    },
)
def tile_picture(
    field: str,
    z: _Zoom,
    x: _Index,
    y: _Index,
    request: Request,
    service: Service_,
    asked: Colours_,
    v: Renderer = None,
) -> Response:
    """A tile of a field: x to the right, y down. Zoom 0: the whole map; the largest: a pixel is a cell."""
    record, key = _ready(service, field, asked)
    _require_tile(record, z, x, y)
    tag = etag_of("tile", key, z, x, y, RENDERER, "png")

    def make(values: UncertaintyField) -> bytes:
        limits = whole_range(values, asked.metric, asked.limits, asked.scale)
        return tile_png(
            values,
            (z, x, y),
            metric=asked.metric,
            colormap=asked.colormap,
            limits=limits,
            scale=asked.scale,
        )

    return conditional(request, tag, kept_for(v), lambda: _picture(service, record, asked, tag, make))


@router.get(
    "/{field}/tiles/{z}/{x}/{y}.npy",
    response_class=Response,
    responses={
        200: binary("application/octet-stream", "numpy array (256, 256), float32; NaN: no value."),
        **NOT_MODIFIED,
        **problems("not_found", "field_not_ready", "store_unavailable"),
    },
)
def tile_array(
    field: str,
    z: _Zoom,
    x: _Index,
    y: _Index,
    request: Request,
    service: Service_,
    metric: Annotated[Metric, METRIC] = "area95_m2",
    heading: HeadingQuery = None,
    v: Renderer = None,
) -> Response:
    """The values of a tile. Row 0: lowest y."""
    record = service.store.ready_field(field)
    _require_tile(record, z, x, y)
    which = normal_heading(record, heading)

    def make() -> Response:
        with service.turn():
            body = tile_npy(shown_field(service, record, which, metric), (z, x, y), metric)
        return Response(body, media_type="application/octet-stream")

    tag = etag_of("tile", record.id, z, x, y, metric, which, RENDERER, "npy")
    return conditional(request, tag, kept_for(v), make)
