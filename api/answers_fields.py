"""Bodies of answers about a whole field: legends, tiles, statistics; for the OpenAPI document."""

from __future__ import annotations

from pydantic import Field

from api.answers_base import Answer


class Tick(Answer):
    """A mark of a colour bar."""

    value: float
    position: float = Field(description="0 at the start of the scale, 1 at its end.")


class Legend(Answer):
    """What the colours mean."""

    field: str
    metric: str
    unit: str
    meaning: str
    colormap_name: str
    scale: str = Field(description="log or linear.")
    rescale: list[float] = Field(description="Ends of the colours; beyond them values have the end's colour.")
    ticks: list[Tick]
    colors: list[str] = Field(description="256 colours #rrggbb, from the start of the scale to its end.")


class TileBounds(Answer):
    """What all tiles together cover, m."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float


class TileJson(Answer):
    """Where tiles are and what they show (after TileJSON 3.0, with metres of the map in place of degrees)."""

    tilejson: str
    name: str
    scheme: str = Field(description="xyz: y counts down from the top.")
    tiles: list[str] = Field(description="Addresses with {z}, {x} and {y}: PNG.")
    arrays: list[str] = Field(description="The same as npy.")
    minzoom: int
    maxzoom: int = Field(description="There a pixel is a cell.")
    tile_size: int = Field(description="px.")
    pixel_m: list[float] = Field(description="Side of a pixel for each zoom.")
    extent: TileBounds = Field(description="Of the one tile of zoom 0; its upper left corner is the map's.")
    legend: str = Field(description="Address of the legend.")
    rescale: list[float] = Field(description="Ends of the colours of all tiles.")


class Percentile(Answer):
    """A percentile."""

    percent: float
    value: float | None


class Histogram(Answer):
    """How many values lie between edges, the upper edge of the last bin included."""

    scale: str
    edges: list[float]
    counts: list[int]
    outside: int = Field(description="Values in no bin: on a log scale those of 0.")


class Statistics(Answer):
    """Figures over free cells."""

    metric: str
    unit: str
    meaning: str
    cells: int = Field(description="Free cells that counted.")
    step: int = Field(description="Every so many-th cell of both axes counted; 1: all.")
    free_area_m2: float
    share_with_fix: float | None = Field(description="Of the free cells; null: there are none.")
    share_valid: float | None = Field(
        description="Of the free cells: with a fix whose ellipse can be believed; null for all_visible."
    )
    with_value: int = Field(description="Cells in which the metric has a value; the rest is about them.")
    min: float | None
    mean: float | None
    max: float | None
    percentiles: list[Percentile]
    histogram: Histogram


class FieldStatistics(Statistics):
    """Figures of a field, or a window of it."""

    field: str


class AreaStatistics(Answer):
    """Figures of areas, in the order of the request."""

    field: str
    areas: list[Statistics]


class FirstCell(Answer):
    """Centre of a cell, m."""

    x_m: float
    y_m: float


class Window(Answer):
    """A metric over a window of cells."""

    field: str
    metric: str
    unit: str
    first: FirstCell = Field(description="Centre of the first cell: row 0, column 0.")
    step_m: float = Field(description="From one value to the next, along rows and columns.")
    yaw_rad: float = Field(description="Of the columns' direction in the map.")
    rows: int
    columns: int
    values: list[list[float | None]] = Field(
        description="Rows, the first has the lowest y; six digits, null without a value."
    )
