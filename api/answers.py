"""Bodies of answers, for the OpenAPI document. Encoders write them; tests hold the two together."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.answers_base import Answer
from api.answers_places import Ranking


class Problem(Answer):
    """An error (RFC 9457), sent as application/problem+json."""

    type: str = Field(description="Address of the code's explanation.", examples=["/docs/problems#not_found"])
    title: str
    status: int
    code: str = Field(description="Stable; read this, not the words.", examples=["not_found"])
    detail: str = Field(description="What is wrong: value, limit, what to do.")
    instance: str = Field(description="Path of the request.")
    request_id: str
    errors: list[dict[str, str]] = Field(
        description="Places: pointer (JSON pointer into the body) or parameter, and detail."
    )
    hint: dict[str, Any] = Field(
        description="What would help: nearest_free; job to wait for; map, the newest version; order, a body "
        "for POST /v1/fields."
    )
    limit: float | None
    requested: float | None
    setting: str | None = Field(description="Environment variable that moves the limit.")


class Place(Answer):
    """A place in the map frame, m."""

    x_m: float
    y_m: float


class Pose(Place):
    """A place, and a heading if one was given."""

    theta_rad: float | None


class Bounds(Answer):
    """A window of the map frame, m."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float


class Shape(Answer):
    """Size of a grid."""

    rows: int
    columns: int


class Map(Answer):
    """A map version; it never changes."""

    map: str = Field(description="Id: m_ and a hash of floor and landmarks.")
    name: str
    kind: str = Field(description="grid or polygons.")
    bounds: Bounds
    resolution_m: float | None = Field(description="Of a grid's cells.")
    shape: Shape | None
    landmarks: int
    free_area_m2: float
    size_bytes: int
    parent: str | None
    created: str = Field(description="UTC, RFC 3339.")
    links: dict[str, str]


class Finding(Answer):
    """One remark of the map check."""

    severity: str
    code: str
    message: str


class MapUploaded(Map):
    """The map that was uploaded, and what may cause trouble."""

    findings: list[Finding]


class MapEdited(MapUploaded):
    """A map with other landmarks."""

    landmarks_etag: str = Field(description="ETag of its landmarks: If-Match of the next change.")


class Snapped(Answer):
    """Where a robot fits."""

    map: str
    asked: Place
    radius_m: float
    pose: Pose | None = Field(description="null: the robot fits nowhere.")
    moved_m: float | None = Field(description="From what was asked for; 0: the robot fits there.")
    clearance_m: float | None = Field(description="Distance of the pose from the nearest obstacle.")


class Maps(Answer):
    """All maps."""

    maps: list[Map]


class Landmark(Answer):
    """A landmark in the map frame."""

    id: str
    x_m: float
    y_m: float
    facing_rad: float | None = Field(description="Outward normal; null: seen from all sides.")
    half_angle_rad: float
    sigma_m: float = Field(description="Standard deviation of the survey.")


class Landmarks(Answer):
    """The landmarks of a map."""

    map: str
    landmarks: list[Landmark]


class Tiles(Answer):
    """Progress of a field."""

    done: int
    total: int = Field(description="0 until the work is cut into tiles.")


class FieldOrdered(Answer):
    """What became of an order for a field."""

    field: str
    job: str | None = Field(description="null: the field was there already.")
    status: str
    tiles: Tiles
    links: dict[str, str]


class UncertaintyField(Answer):
    """A field."""

    field: str = Field(description="Id: f_ and a hash of map, sensor, grid, heading and method.")
    map: str
    status: str = Field(description="running, ready or failed.")
    sensor: dict[str, Any] = Field(description="In rad; what POST /v1/fields takes.")
    resolution_m: float
    heading_rad: float
    headings: int = Field(description="Evenly spaced from 0 on; 1: heading_rad alone.")
    estimator: str = Field(description="best_triplet or all_visible.")
    criterion: str = Field(description="area, max_axis or trace.")
    origin: dict[str, float] = Field(description="Outer corner of cell (0, 0) and yaw of the grid.")
    shape: Shape
    bounds: Bounds
    metrics: dict[str, dict[str, str]] = Field(description="Name → unit and meaning.")
    size_bytes: int
    checksum: str | None
    job: str | None
    error: str | None
    created: str
    ended: str | None
    links: dict[str, str]


class Fields(Answer):
    """All fields."""

    fields: list[UncertaintyField]


class Job(Answer):
    """The computation of a field."""

    job: str
    field: str
    status: str = Field(description="accepted, running, successful, failed or dismissed.")
    tiles: Tiles
    attempts: int
    error: str | None
    eta_s: float | None = Field(
        description="Seconds left at the pace lately; null: not known, also while the field is written."
    )
    created: str
    started: str | None
    ended: str | None
    links: dict[str, str]


class Jobs(Answer):
    """All jobs, newest first."""

    jobs: list[Job]


class HeadingAt(Answer):
    """A place at one of the headings of a field."""

    theta_rad: float
    state: str = Field(description="fix, no_fix or occupied.")
    area95_m2: float | None
    r95_m: float | None
    n_visible: int


class PointValue(Answer):
    """What the field says about one place."""

    field: str
    x_m: float
    y_m: float
    cell: dict[str, int] | None = Field(description="row and column; null outside the grid.")
    state: str = Field(description="fix, no_fix, occupied or outside.")
    reason: str | None = Field(
        description="Why there is no value, or why it cannot be believed (valid is false), in words."
    )
    metrics: dict[str, float | None]
    covariance: list[float] | None = Field(description="xx, xy, yy, m².")
    ellipse95: dict[str, float] | None
    validity: float | None = Field(
        description="Predicted share of fixes inside the 95 % ellipse; null without a fix, and for "
        "all_visible, where it is not known."
    )
    valid: bool | None = Field(description="Whether validity is near enough to 0.95; null where it is null.")
    triplet: list[str] | None = Field(
        description="Ids of the best three landmarks; null without a fix, and for all_visible, where the fix "
        "is made of every landmark in view."
    )
    pan_rad: float | None = Field(description="Optical axis relative to the heading.")
    n_visible: int
    heading_rad: float = Field(description="For which all this holds; of a field over headings one of them.")
    headings: list[HeadingAt] | None = Field(
        description="What each heading gives here; null for a field of one heading, and outside."
    )
    ranking: Ranking | None = Field(
        description="At the middle of the cell, where `ranking` asks for it; null otherwise, and outside."
    )
