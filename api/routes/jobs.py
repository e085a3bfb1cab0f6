"""Jobs: computations of fields."""

from __future__ import annotations

from fastapi import APIRouter
from starlette.responses import Response

from api import answers
from api.codec_records import job_to_json
from api.dependencies import Service_
from api.errors import JobEnded
from api.routes.common import answer, json_response, problems

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])


@router.get("", responses={200: answer(answers.Jobs, "Newest first."), **problems("store_unavailable")})
def list_jobs(service: Service_) -> Response:
    """All jobs, newest first."""
    return json_response({"jobs": [job_to_json(j) for j in reversed(service.store.jobs())]})


@router.get(
    "/{job}",
    responses={
        200: answer(answers.Job, "State and progress."),
        **problems("not_found", "store_unavailable"),
    },
)
def read_job(job: str, service: Service_) -> Response:
    """State and progress of a job: tiles done and in all, seconds left."""
    return json_response(job_to_json(service.store.job(job)))


@router.delete(
    "/{job}",
    responses={
        200: answer(answers.Job, "The dismissed job."),
        **problems("not_found", "job_ended", "store_unavailable"),
    },
)
def dismiss_job(job: str, service: Service_) -> Response:
    """Stop a job. Its field goes with it; order it again to start over."""
    if (record := service.store.job(job)).status.ended:
        raise JobEnded(f"Job '{job}' has ended already: {record.status.value}.")
    service.jobs.dismiss(job)
    return json_response(job_to_json(service.store.job(job)))
