"""Jobs: computations of fields."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Iterator
from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Depends, Header
from fastapi.sse import KEEPALIVE_COMMENT, EventSourceResponse, format_sse_event
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from api import answers
from api.codec import to_json_bytes
from api.codec_records import job_to_json
from api.dependencies import Service, Service_
from api.errors import JobEnded
from api.job_events import Event, Seen, events_since, place_of
from api.routes.common import answer, json_response, problems
from api.store_records import JobRecord
from maps.errors import SurepathError

log = logging.getLogger("surepath.events")

#: How often the state of a job is looked at, and what is sent when nothing happens, s.
POLL_S = 0.25
PING_S = 15.0
_RETRY_MS = 2000
#: In the words of OpenAPI 3.2, as FastAPI has them for its own streams.
_EVENT: dict[str, Any] = {
    "type": "object",
    "required": ["event", "data", "id"],
    "properties": {
        "event": {"enum": ["progress", "tile", "done"]},
        "id": {"type": "string"},
        "data": {
            "type": "string",
            "contentMediaType": "application/json",
            "contentSchema": {
                "anyOf": [
                    {"$ref": "#/components/schemas/Job"},
                    {
                        "type": "object",
                        "properties": {"done": {"type": "integer"}, "total": {"type": "integer"}},
                        "required": ["done", "total"],
                    },
                ]
            },
        },
    },
}

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])


@router.get("", responses={200: answer(answers.Jobs, "Newest first."), **problems("store_unavailable")})
def list_jobs(service: Service_) -> Response:
    """All jobs, newest first."""
    return json_response({"jobs": [_body(service, j) for j in reversed(service.store.jobs())]})


@router.get(
    "/{job}",
    responses={
        200: answer(answers.Job, "State and progress."),
        **problems("not_found", "store_unavailable"),
    },
)
def read_job(job: str, service: Service_) -> Response:
    """State and progress of a job: tiles done and in all, seconds left."""
    return json_response(_body(service, service.store.job(job)))


def _body(service: Service, record: JobRecord) -> dict[str, Any]:
    return job_to_json(record, service.jobs.pace_of(record.id))


def _place(service: Service_) -> Iterator[None]:
    """A place for a stream, as long as it lasts."""
    with service.stream():
        yield


@router.get(
    "/{job}/events",
    response_class=Response,  # a generator as the route itself could not answer 204
    dependencies=[Depends(_place)],
    responses={
        200: {
            "description": "`progress` and `done` carry the job, as GET /v1/jobs/{job} gives it; `tile` "
            "carries `done` and `total`.",
            "content": {"text/event-stream": {"itemSchema": _EVENT}},
        },
        204: {"description": "The client has seen the end already; nothing will follow."},
        **problems("not_found", "store_unavailable"),
    },
)
def job_events(
    job: str,
    service: Service_,
    last_event_id: Annotated[
        str | None,
        Header(max_length=100, description="Id of the last event that was seen: the stream goes on there."),
    ] = None,
) -> Response:
    """A job as server-sent events: `tile` for each one done, `progress` after them, `done` at the end.

    A stream that was cut goes on without a gap when it sends the id of its last event, as browsers do. At
    most `max_streams` are open at a time (100).
    """
    record = service.store.job(job)
    seen = None if last_event_id is None else Seen.of_id(last_event_id)
    if seen is not None and seen.ended and seen == place_of(record):
        # What tells browsers not to come again.
        return Response(status_code=204)
    # Proxies that buffer would hold events back.
    return EventSourceResponse(_stream(service, job, seen), headers={"X-Accel-Buffering": "no"})


async def _stream(service: Service, job: str, seen: Seen | None) -> AsyncIterator[bytes]:
    silent = 0.0
    yield format_sse_event(retry=_RETRY_MS)
    while not service.stopping.is_set():
        try:
            record, events = await run_in_threadpool(_news, service, job, seen)
        except SurepathError as error:
            # Too late for a status; the client comes again and is told where it asks.
            log.warning("the events of job %s end: %s", job, error)
            return
        if events:
            silent = 0.0
            # One piece: a client that gets the events gets all of them.
            yield b"".join(map(_wire, events))
        seen = place_of(record)
        if seen.ended:
            return
        await anyio.sleep(POLL_S)
        silent += POLL_S
        if silent >= PING_S:
            silent = 0.0
            yield KEEPALIVE_COMMENT


def _news(service: Service, job: str, seen: Seen | None) -> tuple[JobRecord, list[Event]]:
    record = service.store.job(job)
    return record, list(events_since(seen, record, _body(service, record)))


def _wire(event: Event) -> bytes:
    return format_sse_event(data_str=to_json_bytes(event.data).decode(), event=event.kind, id=event.id)


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
