"""Many plans at once, and paths that are given."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import Response

from api import answers_evaluations
from api.dependencies import Service_
from api.planning import plan_many
from api.routes.common import answer, problems
from api.routes.many import CODES, ask_field, trajectory_of_plan
from api.routes.places import require_limit
from api.schemas_evaluations import BatchIn, EvaluationIn
from api.worker_orders import EvaluationOrder, GivenPath

router = APIRouter(prefix="/v1", tags=["plans"])


@router.post(
    "/plans/batch",
    responses={
        200: answer(answers_evaluations.Batch, "Each item a plan or a problem."),
        **problems("malformed_body", "too_large", "unsupported_media", "limit_exceeded"),
    },
)
def make_plans(batch: BatchIn, request: Request, service: Service_) -> Response:
    """Several plans at once, as many at a time as there are workers.

    One that fails does not keep the others: it has a problem document in its place, whose pointers lead into
    the batch. Only a body that is none of this schema is refused as a whole.
    """
    settings = service.settings
    require_limit("plans", len(batch.plans), settings.max_batch, "SUREPATH_MAX_BATCH", "#/plans")
    body = plan_many(
        service,
        batch.plans,
        seconds=min(batch.deadline_s or settings.max_batch_s, settings.max_batch_s),
        instance=request.url.path,
        request_id=request.state.request_id,
    )
    return Response(body, media_type="application/json")


@router.post(
    "/evaluations",
    responses={
        200: answer(answers_evaluations.Evaluation, "Figures, waypoints, unmet bounds, differences."),
        **problems(*CODES),
    },
)
def evaluate(question: EvaluationIn, service: Service_) -> Response:
    """Score given paths as plans are scored: cost, length, duration, uncertainty, risk, bounds not kept.

    Two or more stand side by side: the differences are those to the first. A path need not be valid: where
    the robot does not fit it says so. Made by hand, by another planner, or driven: all the same.
    """
    deadline, warnings = question.deadline(service.settings.max_deadline_s)
    given = []
    for k, path in enumerate(question.paths):
        trajectory = path.to_trajectory(f"#/paths/{k}/trajectory")
        if path.plan is not None:
            planned = service.store.plan(path.plan).answer
            trajectory = trajectory_of_plan(planned, path.route, place=f"#/paths/{k}")
        points = tuple((p.x_m, p.y_m) for p in path.points or ())
        given.append(GivenPath(path.name or str(k), points, trajectory))
    order = EvaluationOrder(
        paths=tuple(given),
        problem=question.to_problem(),
        deadline=deadline,
        client_ref=question.client_ref,
        warnings=warnings,
    )
    return ask_field(service, question.field, question.map, order)
