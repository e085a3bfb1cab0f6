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


class PoseAt(PlaceAt):
    """A pose in the map frame."""

    theta_rad: float


class Spread(Answer):
    """How a pose scatters."""

    covariance: list[float] = Field(description="xx, xy, yy (m²), xθ, yθ (m rad), θθ (rad²).")
    area95_m2: float
    ellipse95: Ellipse95
    sigma_theta_rad: float


class Bias(Answer):
    """Mean error; null without a fix."""

    x_m: float | None
    y_m: float | None
    theta_rad: float | None


class Cloud(Answer):
    """Fixes one by one, as columns of equal length."""

    x_m: list[float]
    y_m: list[float]
    theta_rad: list[float]
    inside: list[bool] = Field(description="In the predicted 95 % ellipse.")


class Fixes(Answer):
    """Simulated fixes at a pose; null where there is none."""

    map: str
    status: str = Field(description="ok, or no_fix: to first order there is none here, see reason.")
    reason: str | None = Field(description="Why there is no fix, or why its ellipse cannot be believed.")
    pose: PoseAt = Field(description="The true one.")
    estimator: str
    n: int
    seed: int
    landmarks: list[str] = Field(description="What was measured: three, or all in view.")
    pan_rad: float | None
    failures: dict[str, int] = Field(description="Measurements that gave no fix, by what became of them.")
    share_inside: float | None = Field(description="Of all n, in the predicted 95 % ellipse.")
    predicted_share: float | None = Field(description="What the field's validity predicts of it.")
    valid: bool | None = Field(description="Whether that is near enough to 0.95.")
    predicted: Spread | None = Field(description="To first order.")
    sample: Spread | None = Field(description="Of the fixes; null with fewer than two.")
    bias: Bias | None
    cloud: Cloud | None


class Residual(Answer):
    """What is left of a bearing when the pose is taken away."""

    landmark: str
    residual_rad: float
    sigma_rad: float
    ratio: float = Field(description="Residual over sigma.")


class Localized(Answer):
    """Where the robot is; null where that cannot be said."""

    map: str
    status: str = Field(
        description="ok; ambiguous: there is a pose, but the bearings contradict one another more than "
        "999 of 1000 good sets do; degenerate: there is none."
    )
    reason: str | None
    measured: int
    pose: PoseAt | None
    covariance: list[float] | None = Field(
        description="To first order: xx, xy, yy (m²), xθ, yθ (m rad), θθ (rad²)."
    )
    r95_m: float | None
    area95_m2: float | None
    ellipse95: Ellipse95 | None
    sigma_theta_rad: float | None
    free: bool | None = Field(description="Whether the robot's centre can be there.")
    chi2: float | None
    dof: int
    p_value: float | None = Field(
        description="Probability that good bearings disagree so much; 1 for three, which always agree."
    )
    residuals: list[Residual]
    suspects: list[str] = Field(description="Landmarks without which the others agree; from five on.")
