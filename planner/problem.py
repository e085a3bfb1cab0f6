"""PlanningProblem: all that a planner is given."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import shapely
from shapely import Polygon

from localization.motion import OdometryModel
from maps.arrays import FloatArray
from planner.errors import InvalidProblem
from planner.extras import Extras
from planner.footprint import Footprint
from planner.steering import Steering

MAX_DEADLINE_S = 30.0
MIN_DEADLINE_S = 0.05
MAX_VIA = 50
MAX_AREAS = 200
MAX_CORNERS = 10_000
OBJECTIVES = ("shortest", "weighted", "minimax")


def blind_rate_of(weight: float, blind_r95: float | None, *limits: float | None) -> float | None:
    """Cost per metre in cells without a fix, None where they are closed.

    Parameters
    ----------
    weight
        Of r95, 1/m.
    blind_r95
        What stands for r95 there, m; None closes them.
    limits
        Bounds on r95 or on the ellipse's semi-major axis (equal for a circle), m: one below ``blind_r95``
        closes them, too.
    """
    if blind_r95 is None or any(limit is not None and blind_r95 > limit for limit in limits):
        return None
    return 1.0 + weight * blind_r95


@dataclass(frozen=True, slots=True)
class PlanningProblem:
    """One question to the planner: a holonomic disc from start to goal.

    Attributes
    ----------
    start, goal
        (x, y) in W, m.
    radius
        Radius of the robot's disc, m.
    objective
        ``shortest``: length. ``weighted``: ``∫ (1 + weight · r95) ds``. ``minimax``: smallest worst r95,
        then shortest.
    weight
        Extra metres accepted per metre driven at r95 = 1 m, 1/m (MATH §8).
    max_r95
        Never less certain than this, m; None: no bound. Holds cell by cell; cells without a fix are judged
        by ``blind_r95``.
    blind_r95
        Cells without a fix: None forbids them; a number, m, makes them count as places with this r95, in
        costs and in bounds.
    max_ellipse95
        The semi-major axis of the 95 % ellipse stays at or below this, m; None: no bound. As ``max_r95``.
    max_collision_probability
        Of one pose, by the direction-aware bound of :mod:`planner.risk`; None: no bound. Places without a
        fix are judged by ``blind_r95``.
    max_blind_distance
        Longest stretch without a fix, m; None: no bound. Blind cells may then be crossed even without
        ``blind_r95``.
    covariance
        Whose uncertainty counts in objective and bounds: ``fix``, one fix at each place; ``fused``, the
        filter's belief along the path (odometry and fixes).
    odometry, fix_rate
        For ``fused``: noise of the motion, and fixes per second.
    start_covariance
        For ``fused``: xx, xy, yy (m²), xθ, yθ (m rad), θθ (rad²) at the start; None: of one fix there.
    avoid
        Polygons (W, m) that the robot's body must not enter.
    areas
        Polygons with factors of the cost per metre, 0.01 to 1000; where they overlap factors multiply.
    via
        Places (x, y) in W, m, to pass in this order; the robot stops there.
    kinematics
        ``holonomic``; ``differential``, which turns in place; ``dubins`` and ``reeds_shepp``, which drive
        arcs of ``min_turn_radius`` (m), the latter backwards too.
    start_heading, goal_heading
        Of the robot at the ends, rad; None: any.
    footprint
        Corners (x, y) of the robot's outline in its own frame, m; None: a disc of ``radius``, which counts
        only then.
    turn_rate, max_turn_accel
        Largest turn rate, rad/s, and its change, rad/s².
    max_speed, max_accel
        Limits of the trajectory, m/s and m/s².
    deadline
        Time for the whole plan, s; what is found until then is returned.
    seed
        Of the sampling planner: the same question with the same seed has the same answer.
    refine
        Samples the sampling planner may draw; 0 skips it.

    Raises
    ------
    InvalidProblem
        If a number is not finite or out of its range.
    """

    start: tuple[float, float]
    goal: tuple[float, float]
    radius: float
    objective: Literal["shortest", "weighted", "minimax"] = "weighted"
    weight: float = 4.0
    max_r95: float | None = None
    blind_r95: float | None = None
    max_ellipse95: float | None = None
    max_collision_probability: float | None = None
    max_blind_distance: float | None = None
    covariance: Literal["fix", "fused"] = "fix"
    odometry: OdometryModel = field(default_factory=OdometryModel)
    fix_rate: float = 10.0
    turn_rate: float = 1.0
    start_covariance: tuple[float, float, float, float, float, float] | None = None
    kinematics: Literal["holonomic", "differential", "dubins", "reeds_shepp"] = "holonomic"
    min_turn_radius: float = 0.0
    start_heading: float | None = None
    goal_heading: float | None = None
    footprint: tuple[tuple[float, float], ...] | None = None
    max_turn_accel: float = math.inf
    avoid: tuple[Polygon, ...] = ()
    areas: tuple[tuple[Polygon, float], ...] = ()
    via: tuple[tuple[float, float], ...] = ()
    max_speed: float = 1.2
    max_accel: float = 0.8
    deadline: float = 2.0
    seed: int = 0
    refine: int = 2000

    def __post_init__(self) -> None:
        for name in ("start", "goal"):
            x, y = getattr(self, name)
            if not (math.isfinite(x) and math.isfinite(y)):
                raise InvalidProblem(f"The {name} is ({x}, {y}) m; both must be finite.")
            object.__setattr__(self, name, (float(x), float(y)))
        via = tuple((float(x), float(y)) for x, y in self.via)
        for k, place in enumerate(via):
            if not all(math.isfinite(v) for v in place):
                raise InvalidProblem(f"Via point {k + 1} is {place} m; both must be finite.")
        object.__setattr__(self, "via", via)
        if len(via) > MAX_VIA:
            raise InvalidProblem(f"There are {len(via)} via points; the limit is {MAX_VIA}.")
        if self.objective not in OBJECTIVES:
            names = ", ".join(f"'{name}'" for name in OBJECTIVES)
            raise InvalidProblem(f"The objective is '{self.objective}'; use one of {names}.")
        self._check_areas()
        self._check_belief()
        self._check_robot()
        self._require("max_ellipse95", lo=0.0, hi=1e6, unit="m", exclusive=True)
        p = self.max_collision_probability
        if p is not None and not 0 < p < 1:
            raise InvalidProblem(f"The max_collision_probability is {p}; it must be between 0 and 1.")
        self._require("radius", lo=0.0, hi=50.0, unit="m")
        self._require("weight", lo=0.0, hi=1e6, unit="1/m")
        self._require("max_r95", lo=0.0, hi=1e6, unit="m", exclusive=True)
        self._require("blind_r95", lo=0.0, hi=1e6, unit="m")
        self._require("max_speed", lo=0.0, hi=50.0, unit="m/s", exclusive=True)
        self._require("max_accel", lo=0.0, hi=50.0, unit="m/s²", exclusive=True)
        self._require("deadline", lo=MIN_DEADLINE_S, hi=MAX_DEADLINE_S, unit="s")
        if not 0 <= self.seed < 2**31:
            raise InvalidProblem(f"The seed is {self.seed}; it must be in [0, 2³¹).")
        if not 0 <= self.refine <= 10_000_000:
            raise InvalidProblem(f"refine is {self.refine}; it must be in [0, 10⁷].")

    def _require(self, name: str, *, lo: float, hi: float, unit: str, exclusive: bool = False) -> None:
        value = getattr(self, name)
        if value is None:
            return
        low_ok = value > lo if exclusive else value >= lo
        if not (math.isfinite(value) and low_ok and value <= hi):
            rule = f"above {lo:g}" if exclusive else f"at least {lo:g}"
            raise InvalidProblem(
                f"The {name} is {value} {unit}; it must be {rule} and at most {hi:g} {unit}."
            )

    def _check_robot(self) -> None:
        Steering(self.kinematics, self.min_turn_radius)  # refuses what makes no sense
        if not self.max_turn_accel > 0:
            raise InvalidProblem(f"The max_turn_accel is {self.max_turn_accel} rad/s²; it must be positive.")
        for name in ("start_heading", "goal_heading"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise InvalidProblem(f"The {name} is {value} rad; it must be finite.")
        if self.footprint is not None:
            corners = tuple((float(x), float(y)) for x, y in self.footprint)
            object.__setattr__(self, "footprint", corners)
            Footprint.of(corners)

    @property
    def has_pose(self) -> bool:
        """Whether headings matter: of the ends, of the kinematics, or of the outline."""
        ends = self.start_heading is not None or self.goal_heading is not None
        return ends or self.kinematics != "holonomic" or self.footprint is not None

    @property
    def inner_radius(self) -> float:
        """Clearance without which the robot fits nowhere, m: its radius, or what its outline has inside."""
        return self.radius if self.footprint is None else Footprint.of(self.footprint).inscribed_radius

    @property
    def robot_in_words(self) -> str:
        """The robot that is asked for, as messages name it."""
        if self.footprint is None:
            return f"a robot of radius {self.radius:g} m"
        (x0, y0), (x1, y1) = np.min(self.footprint, axis=0), np.max(self.footprint, axis=0)
        return f"a robot with an outline of {x1 - x0:g} m × {y1 - y0:g} m"

    @property
    def faces_its_way(self) -> bool:
        """Whether it is a disc that can turn in place."""
        return self.kinematics in {"holonomic", "differential"} and self.footprint is None

    def _check_belief(self) -> None:
        if self.covariance not in {"fix", "fused"}:
            raise InvalidProblem(f"The covariance is '{self.covariance}'; use 'fix' or 'fused'.")
        self._require("max_blind_distance", lo=0.0, hi=1e6, unit="m")
        self._require("fix_rate", lo=0.0, hi=1e4, unit="Hz", exclusive=True)
        self._require("turn_rate", lo=0.0, hi=100.0, unit="rad/s", exclusive=True)
        if self.start_covariance is None:
            return
        numbers = tuple(float(v) for v in self.start_covariance)
        if len(numbers) != 6 or not all(math.isfinite(v) for v in numbers):
            raise InvalidProblem(f"The start_covariance is {numbers}; give six finite numbers.")
        object.__setattr__(self, "start_covariance", numbers)
        matrix = self.start_matrix
        if matrix is not None and np.linalg.eigvalsh(matrix).min() < 0:
            raise InvalidProblem(f"The start_covariance {numbers} is none: it has a negative axis.")

    def _check_areas(self) -> None:
        object.__setattr__(self, "avoid", tuple(self.avoid))
        object.__setattr__(self, "areas", tuple((p, float(f)) for p, f in self.areas))
        polygons = [*self.avoid, *(p for p, _ in self.areas)]
        if len(polygons) > MAX_AREAS:
            raise InvalidProblem(f"There are {len(polygons)} areas; the limit is {MAX_AREAS}.")
        for k, polygon in enumerate(polygons):
            what = f"avoid area {k + 1}" if k < len(self.avoid) else f"area {k - len(self.avoid) + 1}"
            if polygon.is_empty or not polygon.is_valid:
                why = "it is empty" if polygon.is_empty else shapely.is_valid_reason(polygon)
                raise InvalidProblem(f"The {what} is no simple polygon: {why}.")
            if shapely.get_num_coordinates(polygon) > MAX_CORNERS:
                raise InvalidProblem(f"The {what} has more than {MAX_CORNERS} corners.")
        for k, (_, factor) in enumerate(self.areas):
            if not 0.01 <= factor <= 1000:
                raise InvalidProblem(f"The factor of area {k + 1} is {factor}; it must be from 0.01 to 1000.")

    @property
    def start_matrix(self) -> FloatArray | None:
        """``start_covariance`` as a matrix (3, 3)."""
        if self.start_covariance is None:
            return None
        xx, xy, yy, xt, yt, tt = self.start_covariance
        return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])

    @property
    def extras(self) -> Extras:
        """Bounds and areas beside ``max_r95`` and the weight."""
        probability = self.max_collision_probability
        blind = self.blind_r95 if probability is not None else None
        return Extras(self.max_ellipse95, probability, blind, self.avoid, self.areas)

    @property
    def effective_weight(self) -> float:
        """Weight of r95 in the cost per metre: 0 for ``shortest``."""
        return self.weight if self.objective == "weighted" else 0.0
