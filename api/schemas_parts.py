"""Parts of questions about ways: places, robots, objectives, bounds, areas."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from shapely import Polygon

from api.questions import FRONT_COUNT, MAX_FRONT, MAX_ROUTES, AlternativesAsked, FrontAsked
from api.schemas_base import Finite, NotNegative, Positive, Request
from localization.motion import OdometryModel
from planner.problem import MAX_CORNERS


class PlaceIn(Request):
    """A place in the map frame."""

    x_m: Finite = Field(examples=[4.0])
    y_m: Finite = Field(examples=[4.0])


class PoseIn(PlaceIn):
    """A place, and the robot's heading there if it matters."""

    theta_rad: Finite | None = Field(default=None, description="Heading, rad; null: any.")
    theta_deg: Finite | None = Field(default=None, description="The same in degrees; give at most one.")

    @model_validator(mode="after")
    def _check_angle(self) -> Self:
        if self.theta_deg is not None and self.theta_rad is not None:
            raise ValueError("give theta_rad or theta_deg, not both")
        return self

    @property
    def heading(self) -> float | None:
        """rad; None: any."""
        return self.theta_rad if self.theta_deg is None else math.radians(self.theta_deg)


class StartIn(PoseIn):
    """Where the robot is, and for ``fused`` how well it knows that."""

    covariance: Annotated[list[Finite], Field(min_length=6, max_length=6)] | None = Field(
        default=None,
        description="For fused: xx, xy, yy (m²), xθ, yθ (m rad), θθ (rad²); null: that of one fix there.",
    )

    def as_tuple(self) -> tuple[float, float, float, float, float, float] | None:
        """The covariance's six numbers."""
        if self.covariance is None:
            return None
        xx, xy, yy, xt, yt, tt = self.covariance
        return xx, xy, yy, xt, yt, tt


class OdometryIn(Request):
    """Noise of the robot's motion: standard deviations after 1 m, or after a turn of 1 rad."""

    distance_sigma_m: NotNegative = Field(default=0.02, description="Of the distance after 1 m, m.")
    turn_sigma_rad: NotNegative = Field(default=0.03, description="Of the turn after 1 rad, rad.")
    drift_sigma_rad: NotNegative = Field(default=0.01, description="Of the heading after 1 m, rad.")
    slip_sigma_m: NotNegative = Field(default=0.0, description="Of the sideways slip after 1 m, m.")

    def to_model(self) -> OdometryModel:
        """The model."""
        return OdometryModel(
            self.distance_sigma_m, self.turn_sigma_rad, self.drift_sigma_rad, self.slip_sigma_m
        )


PanRate = Annotated[float, Field(allow_inf_nan=False, ge=1e-6, le=1e6)]


class RobotIn(Request):
    """A disc or an outline, and how it moves."""

    radius_m: NotNegative = Field(
        default=0.0,
        description="Radius of the disc, m; without effect where there is a footprint.",
        examples=[0.35],
    )
    footprint: Annotated[list[PlaceIn], Field(min_length=3, max_length=100)] | None = Field(
        default=None, description="Corners of the outline in the robot's frame, m: x ahead, y to the left."
    )
    kinematics: Literal["holonomic", "differential", "dubins", "reeds_shepp"] = Field(
        default="holonomic",
        description="differential turns in place; dubins drives forwards on arcs, reeds_shepp backwards too.",
    )
    min_turn_radius_m: NotNegative = Field(
        default=0.0, description="Of arcs, m; needed by dubins, reeds_shepp."
    )
    max_turn_accel_rad_s2: Positive | None = Field(
        default=None, description="Change of the turn rate, rad/s²; null: no limit."
    )
    max_speed_m_s: Finite = Field(default=1.2, ge=0.001, le=50, description="Largest speed, m/s.")
    max_accel_m_s2: Finite = Field(default=0.8, ge=0.001, le=50, description="Largest acceleration, m/s².")
    max_turn_rate_rad_s: Finite = Field(
        default=1.0, ge=0.001, le=100, description="Largest turn rate, rad/s; for headings and fused."
    )
    fix_rate_hz: Finite = Field(default=10.0, ge=0.001, le=1e4, description="Fixes per second; for fused.")
    odometry: OdometryIn = OdometryIn()
    pan_rate_deg_s: PanRate | None = Field(default=None, description="Of a pan head, °/s; for schedules.")
    pan_rate_rad_s: PanRate | None = Field(
        default=None, description="The same in rad/s; neither: it turns at once."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.footprint is None and "radius_m" not in self.model_fields_set:
            raise ValueError("give radius_m or footprint")
        if self.pan_rate_deg_s is not None and self.pan_rate_rad_s is not None:
            raise ValueError("give pan_rate_deg_s or pan_rate_rad_s, not both")
        return self

    @property
    def corners(self) -> tuple[tuple[float, float], ...] | None:
        """Of the footprint."""
        return None if self.footprint is None else tuple((c.x_m, c.y_m) for c in self.footprint)

    @property
    def pan_rate(self) -> float:
        """Of the pan head, rad/s; inf: at once."""
        if self.pan_rate_deg_s is not None:
            return math.radians(self.pan_rate_deg_s)
        return math.inf if self.pan_rate_rad_s is None else self.pan_rate_rad_s


class ObjectiveIn(Request):
    """What the path shall minimise."""

    kind: Literal["shortest", "weighted", "minimax", "pareto"] = Field(
        default="weighted",
        description="shortest: length. weighted: cost per metre 1 + weight · r95. "
        "minimax: the smallest worst r95, then length. pareto: routes from the shortest to the surest, of "
        "which none is both longer and less certain than another.",
    )
    uncertainty_weight_per_m: NotNegative = Field(
        default=4.0,
        description="Extra metres accepted per metre driven at r95 = 1 m; for weighted only.",
    )
    covariance: Literal["fix", "fused"] = Field(
        default="fix",
        description="Whose uncertainty counts, in bounds too: fix: of one fix at each place. "
        "fused: of the filter (odometry and fixes) along the path.",
    )
    against: Literal["worst", "mean"] | None = Field(
        default=None, description="For pareto: worst (default) or mean r95 against length."
    )
    count: Annotated[int, Field(ge=2, le=MAX_FRONT)] | None = Field(
        default=None, description="For pareto: routes at most (default 8)."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind != "pareto" and (self.against is not None or self.count is not None):
            raise ValueError("against and count belong to kind pareto")
        return self

    def to_front(self) -> FrontAsked | None:
        """The front that is asked for."""
        if self.kind != "pareto":
            return None
        return FrontAsked(self.against or "worst", FRONT_COUNT if self.count is None else self.count)


class AlternativesIn(Request):
    """Routes that differ, the best one first."""

    count: int = Field(default=3, ge=1, le=MAX_ROUTES, description="Routes at most, the best one included.")
    max_cost_factor: Finite = Field(
        default=1.4, ge=1, le=100, description="A route costs at most this times the best one."
    )
    max_share: Finite = Field(
        default=0.6,
        ge=0,
        lt=1,
        description="Part of a route's length that may run within the robot's width of routes before it.",
    )

    def to_asked(self) -> AlternativesAsked:
        """The same for the planner."""
        return AlternativesAsked(self.count, self.max_cost_factor, self.max_share)


class ConstraintsIn(Request):
    """What the path must keep; bounds that cannot be kept are raised as little as possible and named."""

    max_r95_m: Positive | None = Field(
        default=None, description="Never less certain than this where there is a fix, m; null: no bound."
    )
    max_ellipse95_m: Positive | None = Field(
        default=None, description="Semi-major axis of the 95 % ellipse, m; null: no bound."
    )
    max_collision_probability: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        default=None,
        description="Of every pose, from covariance and clearance, by a bound that knows the direction of "
        "the error; null: no bound.",
        examples=[0.001],
    )
    max_blind_distance_m: NotNegative | None = Field(
        default=None, description="Longest stretch without a fix, m; null: no bound."
    )
    blind_r95_m: NotNegative | None = Field(
        default=None,
        description=(
            "Cells without a usable fix: null forbids them; a number lets the path cross them "
            "at the cost of a place with this r95, m."
        ),
    )


Position = Annotated[list[Finite], Field(min_length=2, max_length=2)]
Ring = Annotated[list[Position], Field(min_length=3)]


class PolygonIn(Request):
    """A polygon as in GeoJSON, in metres of the map frame: an outer ring, then rings of holes."""

    type: Literal["Polygon"]
    coordinates: Annotated[
        list[
            Annotated[list[Annotated[list[Finite], Field(min_length=2, max_length=2)]], Field(min_length=3)]
        ],
        Field(min_length=1, max_length=100),
    ] = Field(examples=[[[[30.0, 10.0], [34.0, 10.0], [34.0, 14.0], [30.0, 10.0]]]])

    @model_validator(mode="after")
    def _check(self) -> Self:
        if sum(len(ring) for ring in self.coordinates) > MAX_CORNERS:
            raise ValueError(f"a polygon may have at most {MAX_CORNERS} corners")
        return self

    def to_polygon(self) -> Polygon:
        """The polygon, m; the planner refuses one that crosses itself."""
        return Polygon(self.coordinates[0], self.coordinates[1:])


class AreaIn(Request):
    """An area in which driving costs more, or less."""

    polygon: PolygonIn
    factor: Annotated[float, Field(ge=0.01, le=1000)] = Field(
        description="Of the cost per metre; where areas overlap, factors multiply.", examples=[2.0]
    )
