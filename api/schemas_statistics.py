"""Body of a question about the figures of areas."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from api.schemas_base import Request
from api.schemas_parts import PolygonIn
from planner.problem import MAX_AREAS

Percent = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]
DEFAULT_PERCENTILES = (1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0)
MAX_PERCENTILES = 100
MAX_BINS = 1000
DEFAULT_BINS = 32
_AISLE: dict[str, Any] = {
    "type": "Polygon",
    "coordinates": [[[4, 10], [20, 10], [20, 14], [4, 14], [4, 10]]],
}


class StatisticsIn(Request):
    """Figures of a metric for each of several areas."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"metric": "r95_m", "areas": [_AISLE], "percentiles": [50.0, 95.0]}]}
    )

    metric: str = Field(default="area95_m2", max_length=50, description="See GET /v1/colormaps.")
    areas: list[PolygonIn] = Field(
        min_length=1, max_length=MAX_AREAS, description="Cells whose centre lies inside count."
    )
    percentiles: list[Percent] = Field(
        default=list(DEFAULT_PERCENTILES), min_length=1, max_length=MAX_PERCENTILES
    )
    bins: int = Field(default=DEFAULT_BINS, ge=1, le=MAX_BINS, description="Of the histogram.")
    heading: str | None = Field(
        default=None,
        max_length=50,
        description="Of a field over headings: best (default), worst, mean, or an angle in rad.",
    )
    scale: Literal["log", "linear"] | None = Field(
        default=None,
        description="Of the histogram; default: linear for n_visible and validity, else log.",
    )
