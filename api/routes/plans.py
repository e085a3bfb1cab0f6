"""Plans: ask for a path, read it again, look at it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from starlette.responses import Response

from api import answers_plan
from api.caching import HOUR, conditional, etag_of
from api.dependencies import Service_
from api.field_views import normal_heading, shown_field
from api.plan_picture import plan_png
from api.planning import plan_one
from api.routes.common import NOT_MODIFIED, answer, binary, problems
from api.schemas import PlanIn

RENDERER = 3

router = APIRouter(prefix="/v1/plans", tags=["plans"])


@router.post(
    "",
    responses={
        200: answer(answers_plan.Plan, "The best path found, or that there is none: see `status`."),
        **problems(
            "malformed_body",
            "not_found",
            "field_not_ready",
            "too_large",
            "unsupported_media",
            "start_outside_map",
            "goal_outside_map",
            "start_occupied",
            "goal_occupied",
            "storage_full",
            "store_unavailable",
        ),
    },
)
def make_plan(question: PlanIn, service: Service_) -> Response:
    """Plan a path on which the robot knows where it is, beside the shortest one.

    `exact`: bounds met, optimal on the planning grid, then improved. `approximate`: bounds met, not proven.
    `risk_unmet`: no path keeps the bounds; the best effort, and in `unmet` what it misses and the smallest
    bound that is possible. `timeout`: the best until the deadline. `no_path`: there is none.
    """
    return Response(plan_one(service, question), media_type="application/json")


@router.get(
    "/{plan}",
    responses={
        200: answer(answers_plan.Plan, "The answer as it was given."),
        **NOT_MODIFIED,
        **problems("not_found", "store_unavailable"),
    },
)
def read_plan(plan: str, request: Request, service: Service_) -> Response:
    """A plan by its id."""
    record = service.store.plan(plan)
    return conditional(
        request, etag_of(record.id), HOUR, lambda: Response(record.body, media_type="application/json")
    )


@router.get(
    "/{plan}/picture.png",
    response_class=Response,
    responses={
        200: binary("image/png", "Map, field, both routes, 95 % ellipses, landmarks used."),
        **NOT_MODIFIED,
        **problems("not_found", "field_not_ready", "invalid_picture", "store_unavailable"),
    },
)
def plan_picture(
    plan: str,
    request: Request,
    service: Service_,
    width: Annotated[int, Query(ge=64, le=4096, description="Width of the picture, px.")] = 1500,
) -> Response:
    """The plan as a picture over its field."""
    record = service.store.plan(plan)
    tag = etag_of(record.id, width, RENDERER, "plan.png")

    def make() -> Response:
        png = service.pictures.get(tag)
        if png is None:
            of = service.store.ready_field(record.field_id)
            with service.turn():
                field = shown_field(service, of, normal_heading(of, None), "area95_m2")
                png = plan_png(field, record.answer, width=width)
            service.pictures.put(tag, png)
        return Response(png, media_type="image/png")

    return conditional(request, tag, HOUR, make)
