"""Bodies of answers about batches of plans and given paths, for the OpenAPI document."""

from __future__ import annotations

from pydantic import Field

from api.answers import Problem
from api.answers_base import Answer
from api.answers_plan import Plan, Risk, Uncertainty, Unmet, Waypoint


class BatchItem(Answer):
    """A plan, or why there is none; the other one is null."""

    plan: Plan | None
    problem: Problem | None = Field(description="As the question alone would have been answered.")


class Batch(Answer):
    """Plans in the order of the questions."""

    planned: int
    failed: int
    items: list[BatchItem]


class Evaluated(Answer):
    """A given path with its figures."""

    name: str
    status: str = Field(
        description="ok; risk_unmet: a bound fails, see unmet; occupied: the robot does not fit somewhere."
    )
    covariance: str
    cost: float | None = Field(
        description="null: not valid, or it drives without a fix and blind_r95_m is not given."
    )
    length_m: float | None
    duration_s: float | None
    min_clearance_m: float | None = Field(description="Below 0: so much room is missing.")
    uncertainty: Uncertainty
    risk: Risk
    path: list[Waypoint]
    unmet: list[Unmet]


class Difference(Answer):
    """Figures of a path minus those of the first; null where one has none."""

    name: str
    against: str
    cost: float | None
    length_m: float | None
    duration_s: float | None
    min_clearance_m: float | None
    mean_r95_m: float | None
    max_r95_m: float | None
    max_area95_m2: float | None
    max_ellipse95_m: float | None
    blind_m: float | None


class Evaluation(Answer):
    """Given paths, scored."""

    map: str
    field: str
    engine: str
    client_ref: str | None
    paths: list[Evaluated] = Field(description="In their order.")
    differences: list[Difference] = Field(description="Of every path but the first.")
    warnings: list[str]
