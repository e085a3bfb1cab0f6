"""PlanningProblem: all that a planner is given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from planner.errors import InvalidProblem

MAX_DEADLINE_S = 30.0
MIN_DEADLINE_S = 0.05


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
        ``shortest``: length. ``weighted``: ``∫ (1 + weight · r95) ds``.
    weight
        Extra metres accepted per metre driven at r95 = 1 m, 1/m (MATH §8).
    max_r95
        Never less certain than this, m; None: no bound. Holds cell by cell where there is a fix.
    blind_r95
        Cells without a fix: None forbids them; a number lets the path cross them at the cost of a place
        with this r95, m.
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
    objective: Literal["shortest", "weighted"] = "weighted"
    weight: float = 4.0
    max_r95: float | None = None
    blind_r95: float | None = None
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
        if self.objective not in {"shortest", "weighted"}:
            raise InvalidProblem(f"The objective is '{self.objective}'; use 'shortest' or 'weighted'.")
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

    @property
    def effective_weight(self) -> float:
        """Weight of r95 in the cost per metre: 0 for ``shortest``."""
        return self.weight if self.objective == "weighted" else 0.0
