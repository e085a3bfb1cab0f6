"""A service on a tiny world, without worker processes."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import api.app
from api import worker_places, worker_questions
from api.codec import parse_json, plan_to_json
from api.codec_plan import FieldLabel
from api.finding import find
from api.place_orders import PLACE_TASK_OF
from api.questions import NOTHING_MORE, Found
from api.settings import Settings
from api.store_files import write_field
from api.worker_orders import TASK_OF
from localization.heading_field import HeadingField
from localization.method import BEST_AREA
from maps.io.world_file import world_from_geojson
from planner.context import PlanningContext
from planner.errors import GoalOccupied
from tests.api.answers_by_hand import plan_by_hand
from tests.api.clients import TestClient
from tests.fields import synthetic_field

ROOM = {
    "type": "FeatureCollection",
    "name": "room",
    "features": [
        {
            "type": "Feature",
            "properties": {"kind": "floor"},
            "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]]},
        },
        {
            "type": "Feature",
            "properties": {"kind": "obstacle", "opaque": True},
            "geometry": {"type": "Polygon", "coordinates": [[[3, 2], [5, 2], [5, 4], [3, 4], [3, 2]]]},
        },
        *(
            {
                "type": "Feature",
                "properties": {"kind": "landmark", "id": name},
                "geometry": {"type": "Point", "coordinates": place},
            }
            for name, place in (("A", [0, 0]), ("B", [8, 0]), ("C", [8, 6]), ("D", [0, 6]))
        ),
    ],
}
LASER = {"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "max_range_m": 30.0}


class InlinePool:
    """Does in the request what workers do, as far as the routes can tell."""

    ready = True

    def __init__(self) -> None:
        self.store = None

    def start(self) -> None:
        pass

    def close(self) -> None:
        pass

    def parse(self, upload):
        return world_from_geojson(parse_json(upload.world), name=upload.name)

    def plan(self, field_path, problem, *, more=NOTHING_MORE, client_ref=None, warnings=()):
        if problem.goal == (4.0, 3.0):
            raise GoalOccupied("The goal is inside an obstacle.", nearest_free=(2.0, 3.0))
        field = self.store.load_field(field_path.stem)
        if more == NOTHING_MORE:
            found = Found.of(plan_by_hand(problem.start, problem.goal))
        else:
            found = find(replace(problem, refine=0), PlanningContext(field), more)
        return plan_to_json(
            found, field, problem=problem, more=more, client_ref=client_ref, warnings=warnings
        )

    def ask(self, field_path, order):
        field = self.store.load_field(field_path.stem)
        over = field if isinstance(field, HeadingField) else None
        ready = worker_questions.Ready(PlanningContext(field), FieldLabel.of(field), 0, over)
        channel = SimpleNamespace(memory={"fields": {field_path.name: ready}})
        task = worker_questions.TASKS[TASK_OF[type(order)]]
        return task(channel, field_path, order, time.monotonic() + order.deadline)

    def ask_map(self, map_path, order):
        task = worker_places.PLACE_TASKS[PLACE_TASK_OF[type(order)]]
        return task(SimpleNamespace(memory={}), map_path, order)


class IdleJobs:
    """Takes orders and leaves them to the test."""

    def __init__(self, store, pool, *_):
        self.store = store
        pool.store = store

    def start(self) -> None:
        pass

    def stop(self) -> None:
        pass

    def submit_field(self, map_id, sensor, resolution, heading, *, method=BEST_AREA, headings=1):
        return self.store.add_field_request(
            map_id, sensor, resolution, heading, method=method, headings=headings
        )

    def pace_of(self, job_id):
        return None

    def dismiss(self, job_id):
        return self.store.dismiss_job(job_id)


def small_settings(folder) -> Settings:
    """Limits that tests can reach."""
    return Settings(data_dir=folder, preload=False, max_body_bytes=100_000, max_deadline_s=10.0)


@pytest.fixture
def client(tmp_path, monkeypatch):
    """A service of its own."""
    monkeypatch.setattr(api.app, "JobRunner", IdleJobs)
    with TestClient(api.app.create_app(small_settings(tmp_path / "data"), pool=InlinePool())) as running:
        yield running


@pytest.fixture(scope="session")
def gallery(tmp_path_factory):
    """A service with a room and a ready field that nobody changes: for tests that only read."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(api.app, "JobRunner", IdleJobs)
        app = api.app.create_app(small_settings(tmp_path_factory.mktemp("gallery")), pool=InlinePool())
        running = TestClient(app)
        running.__enter__()
    # The patch ends here: other modules start real services while this one lives.
    try:
        map_id = running.post("/v1/maps", json=ROOM).json()["map"]
        yield SimpleNamespace(client=running, **vars(ready_field(running, map_id)))
    finally:
        running.__exit__(None, None, None)


@pytest.fixture
def room(client):
    """The id of an uploaded room."""
    return client.post("/v1/maps", json=ROOM).json()["map"]


def certain_at_the_left(x, y):
    """Standard deviation of a field, m: nothing below y = 1 m."""
    return np.where(y > 1.0, 0.02 + 0.01 * x, np.nan)


def finish(client, job_id: str, sigma=certain_at_the_left) -> None:
    """What a worker does with a job: a field by hand, written and committed."""
    store = client.app.state.service.store
    job = store.claim_job(job_id)
    record = store.field(job.field_id)
    field = synthetic_field(
        store.world(record.map_id),
        record.resolution,
        sigma,
        record.sensor,
    )
    staged = store.staging_path(job.id)
    size, checksum = write_field(field, staged)
    store.set_progress(job.id, 1, 1)
    assert store.commit_field(job.id, staged, size=size, checksum=checksum)


def ready_field(client, map_id: str, sigma=certain_at_the_left) -> SimpleNamespace:
    """Ids of a map and its ready field."""
    ordered = client.post("/v1/fields", json={"map": map_id, "sensor": LASER, "resolution_m": 0.5}).json()
    finish(client, ordered["job"], sigma)
    return SimpleNamespace(map=map_id, id=ordered["field"], path=f"/v1/fields/{ordered['field']}")


@pytest.fixture
def field(client, room):
    """Ids of a room and its ready field: certain at the left, blind below y = 1 m."""
    return ready_field(client, room)


def problem_of(answer, status: int, code: str) -> dict:
    """The problem document of an answer that must be one."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    document = answer.json()
    assert document["code"] == code, document
    assert document["status"] == status
    assert document["request_id"] == answer.headers["x-request-id"]
    return document
