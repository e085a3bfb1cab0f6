"""Jobs over HTTP."""

from __future__ import annotations

import json
import threading
import time
from contextlib import ExitStack
from functools import partial

from api import answers
from api.pace import Pace
from api.routes import jobs as routes
from tests.api.conftest import LASER, finish, problem_of


def _order(client) -> str:
    return client.post("/v1/fields", json={"map": "room", "sensor": LASER, "resolution_m": 0.5}).json()["job"]


def test_a_job_is_followed_to_its_end(client, room):
    job = _order(client)
    store = client.app.state.service.store
    waiting = client.get(f"/v1/jobs/{job}").json()
    answers.Job.model_validate(waiting)
    assert (waiting["status"], waiting["eta_s"]) == ("accepted", None)
    store.claim_job(job)
    store.set_progress(job, 1, 4)
    running = client.get(f"/v1/jobs/{job}").json()
    assert (running["status"], running["tiles"]) == ("running", {"done": 1, "total": 4})
    assert running["eta_s"] >= 0
    store.release_job(job, refund=True)
    finish(client, job)
    ended = client.get(f"/v1/jobs/{job}").json()
    answers.Job.model_validate(ended)
    assert (ended["status"], ended["eta_s"]) == ("successful", None)
    assert client.get("/v1/jobs").json()["jobs"] == [ended]
    problem_of(client.delete(f"/v1/jobs/{job}"), 409, "job_ended")


def test_a_job_can_be_dismissed_and_its_field_ordered_again(client, room):
    job = _order(client)
    assert client.delete(f"/v1/jobs/{job}").json()["status"] == "dismissed"
    another = _order(client)
    assert another != job


def test_unknown_jobs(client):
    problem_of(client.get("/v1/jobs/j_1"), 404, "not_found")
    problem_of(client.delete("/v1/jobs/j_1"), 404, "not_found")


def events_of(answer) -> list[dict]:
    """Server-sent events as a browser takes them apart."""
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"].startswith("text/event-stream")
    found = []
    for block in answer.text.split("\n\n"):
        parts = dict(line.split(": ", 1) for line in block.splitlines() if not line.startswith(":"))
        if "event" in parts:
            found.append({"kind": parts["event"], "id": parts["id"], "data": json.loads(parts["data"])})
    return found


def test_events_follow_a_job_to_its_end(client, room, monkeypatch):
    monkeypatch.setattr(routes, "POLL_S", 0.01)
    job = _order(client)
    store = client.app.state.service.store

    def work():
        for step in (
            lambda: store.claim_job(job),
            *(partial(store.set_progress, job, k, 4) for k in (1, 3, 4)),
        ):
            time.sleep(0.1)
            step()
        time.sleep(0.1)
        store.release_job(job, refund=True)
        finish(client, job)

    worker = threading.Thread(target=work)
    worker.start()
    events = events_of(client.get(f"/v1/jobs/{job}/events"))
    worker.join()
    assert [e["data"]["done"] for e in events if e["kind"] == "tile"][:4] == [1, 2, 3, 4]
    assert events[0]["data"]["status"] == "accepted"
    assert [e["kind"] for e in events].count("done") == 1
    last = events[-1]
    assert (last["kind"], last["data"]["status"]) == ("done", "successful")
    answers.Job.model_validate(last["data"])
    seen = client.get(f"/v1/jobs/{job}/events", headers={"last-event-id": last["id"]})
    assert (seen.status_code, seen.content) == (204, b""), "a browser must not come again"


def test_a_stream_goes_on_after_the_last_event(client, room):
    job = _order(client)
    store = client.app.state.service.store
    store.claim_job(job)
    store.set_progress(job, 6, 6)
    client.delete(f"/v1/jobs/{job}")
    events = events_of(client.get(f"/v1/jobs/{job}/events", headers={"last-event-id": "1-4-running"}))
    assert [(e["kind"], e["data"].get("done")) for e in events] == [("tile", 5), ("tile", 6), ("done", None)]
    assert events[-1]["data"]["status"] == "dismissed"
    nonsense = events_of(client.get(f"/v1/jobs/{job}/events", headers={"last-event-id": "yesterday"}))
    assert [e["kind"] for e in nonsense] == ["done"]


def test_streams_have_a_limit_and_give_their_place_back(client, room):
    job = _order(client)
    client.delete(f"/v1/jobs/{job}")
    service = client.app.state.service
    limit = service.settings.max_streams
    for _ in range(2 * limit):
        assert client.get(f"/v1/jobs/{job}/events").status_code == 200
    with ExitStack() as held:
        for _ in range(limit):
            held.enter_context(service.stream())
        problem = problem_of(client.get(f"/v1/jobs/{job}/events"), 503, "overloaded")
        assert "SUREPATH_MAX_STREAMS" in problem["detail"]
    problem_of(client.get("/v1/jobs/j_1/events"), 404, "not_found")
    assert client.get(f"/v1/jobs/{job}/events").status_code == 200


def test_a_service_that_stops_ends_its_streams(client, room, monkeypatch):
    monkeypatch.setattr(routes, "POLL_S", 0.01)
    job = _order(client)
    service, free = client.app.state.service, []

    def stop():
        until = time.monotonic() + 20
        while service._streams._value == service.settings.max_streams and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(0.1)  # the first event is on its way
        free.append(service._streams._value)
        service.stopping.set()

    threading.Thread(target=stop).start()
    events = events_of(client.get(f"/v1/jobs/{job}/events"))
    assert [e["kind"] for e in events] == ["progress"]
    assert free == [service.settings.max_streams - 1], "the place is taken as long as the stream lasts"


def test_a_silent_job_is_heard_from(client, room, monkeypatch):
    monkeypatch.setattr(routes, "POLL_S", 0.01)
    monkeypatch.setattr(routes, "PING_S", 0.05)
    job = _order(client)
    threading.Timer(0.3, client.app.state.service.stopping.set).start()
    assert client.get(f"/v1/jobs/{job}/events").text.count(": ping") >= 2


def test_the_time_left_is_that_of_the_runner(client, room, monkeypatch):
    job = _order(client)
    store, pace = client.app.state.service.store, Pace()
    store.claim_job(job)
    store.set_progress(job, 1, 4000)
    monkeypatch.setattr(client.app.state.service.jobs, "pace_of", lambda _: pace)
    pace.note(1, 4000, time.monotonic())
    assert client.get(f"/v1/jobs/{job}").json()["eta_s"] is None, "one step says nothing about the rest"
    monkeypatch.setattr(pace, "left", lambda _: 12.34)
    assert client.get(f"/v1/jobs/{job}").json()["eta_s"] == 12.3
