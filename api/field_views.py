"""What of a field is shown: itself, or of one over headings one of them, the best, the worst, the mean."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from fastapi import Query

from api.codec_plan import number
from api.codec_records import point_to_json
from api.errors import InvalidRequest
from api.heading_view import view_of
from api.store_records import FieldRecord
from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField
from maps.se2 import wrap

if TYPE_CHECKING:
    from api.dependencies import Service

REDUCTIONS = ("best", "worst", "mean")
HeadingQuery = Annotated[
    str | None,
    Query(
        max_length=50,
        description="Of a field over headings: best (what the robot can have by turning; default), worst "
        "(what it can count on; a heading without a fix is the worst), mean (of the metric, over the "
        "headings with a fix), or an angle, rad: the nearest heading. Other fields take none.",
        examples=["best"],
    ),
]
_SAME_RAD = 1e-6


def normal_heading(record: FieldRecord, heading: str | None) -> str:
    """What a query's ``heading`` means for a field, the same for all words that mean the same.

    Returns
    -------
    name
        Empty for a field of one heading; else ``best``, ``worst``, ``mean`` or the number of a heading.

    Raises
    ------
    InvalidRequest
        If it is none of these, or the field has one heading only.
    """
    if record.headings == 1:
        if heading is not None:
            raise InvalidRequest(
                "This field holds for one heading; order one with headings to choose among them.",
                place="heading",
            )
        return ""
    if heading is None or heading in REDUCTIONS:
        return heading or "best"
    try:
        angle = float(heading)
    except ValueError:
        angle = math.nan
    if not math.isfinite(angle) or abs(angle) > 1e6:
        raise InvalidRequest(
            f"heading must be one of {', '.join(REDUCTIONS)}, or an angle in rad.", place="heading"
        )
    return str(round(angle / (2 * math.pi) * record.headings) % record.headings)


def shown_field(service: Service, record: FieldRecord, heading: str, metric: str) -> UncertaintyField:
    """The field that a picture or a figure is of; ``heading`` as of :func:`normal_heading`.

    Raises
    ------
    StoreUnavailable
        If its files cannot be read.
    """
    field = service.store.load_field(record.id)
    if not isinstance(field, HeadingField):
        return field
    if heading not in REDUCTIONS:
        return field.slices[int(heading)]
    key = f"{record.id}/{heading}" + (f"/{metric}" if heading == "mean" else "")
    return service.views.get(key, lambda: view_of(field, heading, metric))


def point_of(
    field: UncertaintyField | HeadingField, x: float, y: float, theta: float | None
) -> dict[str, Any]:
    """What a field says about a place (m in W), at a heading (rad; None: its own, or the best one there).

    Raises
    ------
    InvalidRequest
        If the field holds for another heading alone.
    """
    if not isinstance(field, HeadingField):
        differs = theta is not None and abs(float(wrap(theta - field.heading))) > _SAME_RAD
        if differs and field.sensor.depends_on_heading:
            raise InvalidRequest(
                f"This field holds for the heading {field.heading:g} rad alone; order one with headings.",
                place="theta_rad",
            )
        return point_to_json(field, x, y)
    first = point_to_json(field.slices[0], x, y)
    if first["cell"] is None:
        return first
    at = (np.asarray(first["cell"]["row"]), np.asarray(first["cell"]["column"]))
    areas = np.array([float(one.metric("area95_m2", at)) for one in field.slices])
    if theta is not None:
        chosen = field.at(theta)
    else:
        chosen = field.slices[int(np.nanargmin(areas)) if np.isfinite(areas).any() else 0]
    free = bool(field.free[at])
    profile = [
        {
            "theta_rad": float(one.heading),
            "state": "occupied" if not free else "fix" if math.isfinite(area) else "no_fix",
            "area95_m2": number(area),
            "r95_m": number(float(one.metric("r95_m", at))),
            "n_visible": int(one.n_visible[at]) if free else 0,
        }
        for one, area in zip(field.slices, areas.tolist(), strict=True)
    ]
    return {**point_to_json(chosen, x, y), "headings": profile}
