"""Bodies of answers about one place of a map, for the OpenAPI document."""

from __future__ import annotations

from pydantic import Field

from api.answers_base import Answer


class PlaceAt(Answer):
    """A place in the map frame, m."""

    x_m: float
    y_m: float


class Ellipse95(Answer):
    """A 95 % ellipse: semi-axes, and the azimuth of the longer one."""

    a_m: float
    b_m: float
    theta_rad: float


class RankedTriplet(Answer):
    """Three landmarks and the fix that they give at the place."""

    triplet: list[str]
    area95_m2: float
    r95_m: float
    covariance: list[float] = Field(description="xx, xy, yy, m².")
    ellipse95: Ellipse95
    sigma_theta_rad: float
    pan_rad: float | None = Field(description="Optical axis relative to the pan head's zero.")
    validity: float | None = Field(description="Predicted share of fixes inside the 95 % ellipse.")
    valid: bool | None = Field(description="Whether validity is near enough to 0.95.")


class MissedTriplet(RankedTriplet):
    """A triplet that would rank with the best if all its landmarks could be measured."""

    blocking: dict[str, str] = Field(description="Landmark → status.")


class RankedLandmark(Answer):
    """A landmark as seen from the place."""

    id: str
    x_m: float
    y_m: float
    distance_m: float = Field(description="From the sensor.")
    bearing_rad: float = Field(description="From the sensor's zero direction.")
    status: str = Field(
        description="measurable, too_near, too_far, turned_away, hidden, muted or outside_view."
    )
    reason: str = Field(description="The status in words.")


class Ranking(Answer):
    """Why a place is good or bad."""

    place: PlaceAt = Field(description="Where the robot's centre is: of a field, the middle of its cell.")
    heading_rad: float
    criterion: str
    free: bool = Field(description="Whether a robot's centre can be there; if not, nothing is ranked.")
    reason: str | None = Field(
        description="Why there is no fix, or which triplet would be much better and what hides it; null: "
        "nothing to say."
    )
    triplets: list[RankedTriplet] = Field(description="Best first.")
    missed: list[MissedTriplet] = Field(description="Best first.")
    counts: dict[str, int] | None = Field(
        description="All triplets of the map by what becomes of them: fix, not_visible, not_in_one_view, "
        "degenerate; null: too many to count."
    )
    landmarks: list[RankedLandmark] = Field(description="All of the map, in its order.")


class AskedTriplet(Answer):
    """The one triplet that was asked about."""

    triplet: list[str]
    status: str = Field(description="fix, not_visible, not_in_one_view or degenerate.")
    rank: int | None = Field(description="null: gives no fix, or is not among the 10,000 best.")
    of: int | None = Field(description="How many triplets give a fix; null: too many to count.")
    blocking: dict[str, str]
    fix: RankedTriplet | None = Field(description="What it gives, or would give if it could be seen.")


class Triplets(Ranking):
    """The ranking at a pose."""

    map: str
    asked: AskedTriplet | None
