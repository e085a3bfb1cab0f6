"""How the fixes of a field are made: by which landmarks, and what counts as good."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from localization.errors import LocalizationError
from localization.sensors import CRITERIA, Criterion

Estimator = Literal["best_triplet", "all_visible"]
#: What a fix is made of: the best triplet (MAS97 §4.4), or every landmark in view by least squares.
ESTIMATORS: dict[str, float] = {"best_triplet": 0.0, "all_visible": 1.0}


@dataclass(frozen=True, slots=True)
class FieldMethod:
    """How a field's fixes are made.

    Attributes
    ----------
    estimator
        ``best_triplet`` or ``all_visible``.
    criterion
        What is smallest: ``area`` or ``max_axis`` of the 95 % ellipse, or ``trace`` of the covariance. For
        ``best_triplet`` a pan head with the policy ``optimal`` minimises the area whatever the criterion,
        which then only ranks; for ``all_visible`` it minimises the criterion itself.

    Raises
    ------
    LocalizationError
        If a name is unknown.
    """

    estimator: Estimator = "best_triplet"
    criterion: Criterion = "area"

    def __post_init__(self) -> None:
        for name, known in (("estimator", ESTIMATORS), ("criterion", CRITERIA)):
            value = getattr(self, name)
            if value not in known:
                raise LocalizationError(f"Unknown {name} '{value}'; use one of {', '.join(known)}.")


BEST_AREA = FieldMethod()
