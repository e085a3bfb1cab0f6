"""From a question to a stored plan: one, or many at a time."""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from api.codec import to_json_bytes
from api.codec_records import order_to_json
from api.dependencies import Service
from api.errors import Problem
from api.schemas import PlanIn
from api.store_records import FieldNotReady, FieldStatus
from api.worker_process import DeadlineExceeded
from planner.problem import MIN_DEADLINE_S

log = logging.getLogger("surepath.batch")


def plan_one(service: Service, question: PlanIn, *, ends_at: float | None = None) -> bytes:
    """The answer of ``POST /v1/plans``, stored, as JSON.

    Parameters
    ----------
    service
        Store and workers.
    question
        What is asked.
    ends_at
        Time (:func:`time.monotonic`) that cuts the question's own deadline short; None: none does.

    Raises
    ------
    NotFound, FieldNotReady
        If there is no field to plan on.
    PlannerError
        If the question is wrong.
    WorkerError
        If no worker had an answer in time.
    StorageFull, StoreUnavailable
        If the answer cannot be kept.
    """
    settings = service.settings
    problem, warnings = question.to_problem(
        default_deadline=settings.default_deadline_s, max_deadline=settings.max_deadline_s
    )
    if ends_at is not None and (left := ends_at - time.monotonic()) < problem.deadline:
        if left < MIN_DEADLINE_S:
            raise DeadlineExceeded("The time for the batch was over before this plan's turn came.")
        said = f"deadline_s was {problem.deadline:g} s and is now {left:.2g} s: the batch's time ends then."
        problem, warnings = dataclasses.replace(problem, deadline=left), (*warnings, said)
    more = question.to_more()
    field = newest_field(service, question.map or "") if question.field is None else question.field
    path = service.store.field_path(service.store.ready_field(field).id)
    found = service.pool.plan(path, problem, more=more, client_ref=question.client_ref, warnings=warnings)
    return service.store.add_plan(found).body


def plan_many(
    service: Service, questions: Sequence[PlanIn], *, seconds: float, instance: str, request_id: str
) -> bytes:
    """The answer of ``POST /v1/plans/batch``: as many at a time as there are workers, in their order.

    Parameters
    ----------
    service, questions
        Whom to ask what.
    seconds
        For all together; those whose turn comes later have a problem in place of a plan.
    instance, request_id
        For the problems.
    """
    ends_at = time.monotonic() + seconds

    def item(k: int) -> tuple[bool, bytes]:
        try:
            return True, b'{"plan":' + plan_one(service, questions[k], ends_at=ends_at) + b',"problem":null}'
        except Exception as error:
            problem = _of_item(Problem.of_exception(error), k)
            if problem.status == 500:
                log.exception("item %d of a batch failed (request %s)", k, request_id)
            document = to_json_bytes(problem.document(instance, request_id))
            return False, b'{"plan":null,"problem":' + document + b"}"

    with ThreadPoolExecutor(max(1, service.settings.workers), thread_name_prefix="batch") as pool:
        items = list(pool.map(item, range(len(questions))))
    planned = sum(done for done, _ in items)
    head = f'"planned":{planned},"failed":{len(items) - planned},"items":['.encode()
    return b"{" + head + b",".join(body for _, body in items) + b"]}"


def _of_item(problem: Problem, k: int) -> Problem:
    """The problem with places that point into the batch."""

    def moved(entry: Any) -> dict[str, str]:
        pointer = entry.get("pointer", "")
        return {**entry, "pointer": f"#/plans/{k}{pointer[1:]}"} if pointer.startswith("#") else dict(entry)

    return dataclasses.replace(problem, errors=[moved(e) for e in problem.errors])


def newest_field(service: Service, name: str) -> str:
    """Id of the newest ready field of a map.

    Raises
    ------
    NotFound
        If there is no such map.
    FieldNotReady
        If it has no field that is ready.
    """
    record = service.store.map(name)
    fields = service.store.fields(record.id)
    ready = [f for f in fields if f.status is FieldStatus.READY]
    if ready:
        return max(ready, key=lambda f: (f.ended or f.created, f.id)).id
    job = next((f.job for f in fields if f.status is FieldStatus.RUNNING), None)
    failed = None if job or not fields else max(fields, key=lambda f: (f.ended or f.created, f.id))
    raise FieldNotReady(
        f"Map '{name}' has no field that is ready; "
        + ("wait for its job." if job else "POST one to /v1/fields.")
        + (f" The last one: {failed.error}" if failed else ""),
        job=job,
        order=order_to_json(failed) if failed else None,
    )
