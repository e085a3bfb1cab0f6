"""Jobs over HTTP."""

from __future__ import annotations

from api import answers
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
