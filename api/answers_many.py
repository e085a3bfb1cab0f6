"""Bodies of answers to questions about many places and to simulations, for the OpenAPI document."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from api.answers import Place
from api.answers_base import Answer

Row = list[float | None]


class PlaceUsed(Place):
    """A place of a matrix, and whether it could be used."""

    status: str = Field(description="ok, outside_map, occupied, forbidden or not_searched.")


class Unreachable(Answer):
    """A pair without figures."""

    source: int
    target: int
    status: str = Field(description="no_path, or the status of the place that cannot be used.")


class _Head(Answer):
    map: str
    field: str
    engine: str
    client_ref: str | None
    warnings: list[str]


class Matrix(_Head):
    """Figures of the best way from every source (row) to every target; null where there is none."""

    status: str = Field(
        description="complete: every pair has figures. partial: some have none, see unreachable. timeout: "
        "some places were not searched before the deadline."
    )
    sources: list[PlaceUsed]
    targets: list[PlaceUsed]
    cost: list[Row] | None = Field(description="∫ (1 + weight · r95) ds. Figures not asked for are null.")
    length_m: list[Row] | None
    duration_s: list[Row] | None = Field(description="As one straight motion from rest to rest.")
    mean_r95_m: list[Row] | None = Field(description="Along the part with a fix.")
    worst_r95_m: list[Row] | None
    blind_m: list[Row] | None = Field(description="Length without a fix.")
    unreachable: list[Unreachable]


class RegionProperties(Answer):
    """What the area is within reach of."""

    place: Place
    measure: str = Field(description="cost, length or time.")
    limit: float | None = Field(description="null: whatever is connected.")
    area_m2: float
    is_complete: bool


class MultiPolygon(Answer):
    """GeoJSON in m of the map frame; exterior rings counter-clockwise."""

    type: Literal["MultiPolygon"]
    coordinates: list[list[list[list[float]]]]


class RegionFeature(Answer):
    """GeoJSON."""

    type: Literal["Feature"]
    properties: RegionProperties
    geometry: MultiPolygon


class Region(_Head):
    """The area within reach: GeoJSON in m of the map frame."""

    type: Literal["FeatureCollection"]
    features: list[RegionFeature]
    status: str = Field(description="complete, or timeout: a part of the area.")


class Share(Answer):
    """A share with its confidence bounds (Clopper and Pearson)."""

    share: float | None
    low: float | None
    high: float | None
    level: float


class Collisions(Share):
    """Runs that touch something."""

    count: int
    places: list[dict[str, float]] = Field(description="x_m, y_m of the true centre, s_m along the path.")


class Quantiles(Answer):
    """Over the runs."""

    median_m: float | None
    q95_m: float | None
    max_m: float | None


class Coverage(Answer):
    """Share of errors inside 95 % ellipses: the robot's own, and the predicted ones."""

    claimed: Share
    predicted: Share


class Nees(Answer):
    """Mean normalised squared error of the pose; 3 and between the bounds if the filter is consistent."""

    mean: float | None
    low: float | None
    high: float | None
    dof: int


class Blind(Answer):
    """Driving without fixes."""

    time_share: float | None = Field(description="Share of fixes that were due and did not come.")
    longest: Quantiles


class Ellipse(Answer):
    """A 95 % ellipse."""

    a_m: float
    b_m: float
    theta_rad: float


class Station(Answer):
    """A place along the path, over the runs that get there; null where none does."""

    s_m: float | None
    t_s: float | None
    x_m: float | None
    y_m: float | None
    theta_rad: float | None
    runs: int
    deviation_median_m: float | None = Field(description="Of the true place from the path.")
    deviation_q95_m: float | None
    deviation_max_m: float | None
    error_median_m: float | None = Field(description="Between believed and true place.")
    error_q95_m: float | None
    predicted_r95_m: float | None
    sample_r95_m: float | None
    predicted_ellipse95: Ellipse
    inside_claimed: float | None
    inside_predicted: float | None
    nees: float | None
    displaced_collision: float | None = Field(
        description="Share of runs that would touch something here if the robot believed to be on its path."
    )
    displaced_collision_low: float | None
    displaced_collision_high: float | None


class Simulation(_Head):
    """What came of many closed-loop runs."""

    status: str = Field(description="complete, or timeout: the runs that were done by the deadline.")
    plan: str | None
    runs: int
    runs_asked: int
    seed: int
    robot: dict[str, Any] = Field(description="As it was driven.")
    length_m: float | None
    duration_s: float | None = Field(description="With turns on the spot.")
    collisions: Collisions
    worst_deviation: Quantiles
    goal_error: Quantiles
    rms_error_m: float | None
    ellipse95: Coverage
    nees: Nees
    blind: Blind
    stations: list[Station]
