"""What happened to a job since somebody looked."""

from __future__ import annotations

import itertools

import pytest

from api.job_events import Seen, events_since, place_of
from api.store_records import JobRecord, JobStatus


def job(done, status=JobStatus.RUNNING, attempts=1):
    return JobRecord("j_1", "f_1", status, done, 9, attempts, None, 0.0, 0.0, None)


def told(seen, now):
    return [(e.id, e.kind) for e in events_since(seen, now, {})]


def test_the_first_look_tells_the_state_alone():
    assert told(None, job(4)) == [("1-4-running", "progress")]


def test_tiles_are_told_one_by_one_then_the_state():
    assert told(Seen(1, 2, "running"), job(4)) == [
        ("1-3-running", "tile"),
        ("1-4-running", "tile"),
        ("1-4-running", "progress"),
    ]
    assert told(Seen(1, 4, "running"), job(4)) == []


def test_the_end_comes_last_and_once():
    ended = job(5, JobStatus.SUCCESSFUL)
    assert told(Seen(1, 4, "running"), ended) == [("1-5-running", "tile"), ("1-5-successful", "done")]
    assert told(place_of(ended), ended) == []


def test_a_job_that_began_anew_is_told_from_its_first_tile():
    for seen in (Seen(1, 7, "running"), Seen(2, 5, "running")):
        assert told(seen, job(2, attempts=2))[:2] == [("2-1-running", "tile"), ("2-2-running", "tile")]


@pytest.mark.parametrize("cuts", [(), (1,), (1, 2, 3), (2, 5), (0, 1, 2, 3, 4, 5, 6)])
def test_nothing_is_lost_or_told_twice_whenever_the_line_is_cut(cuts):
    life = [
        job(0, JobStatus.ACCEPTED, 0), job(0), job(2), job(3), job(3), job(7), job(9), job(9, JobStatus.SUCCESSFUL)
    ]  # fmt: skip
    seen, tiles = None, []
    for k, now in enumerate(life):
        for event in events_since(seen, now, {}):
            last = event.id
            if event.kind == "tile":
                tiles.append(event.data["done"])
        # Cut: all that is left of the past is the id of the last event.
        seen = Seen.of_id(last) if k in cuts else place_of(now)
    assert tiles == list(range(1, 10))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1",
        "1-2",
        "1-2-sleeping",
        "-1-2-running",
        "1-2-running\n",
        "9" * 50 + "-1-running",
        "1-1-running;",
    ],
)
def test_other_ids_name_no_place(text):
    assert Seen.of_id(text) is None


def test_ids_are_places():
    for attempt, done, status in itertools.product((0, 3), (0, 12), JobStatus):
        seen = Seen(attempt, done, status.value)
        assert Seen.of_id(seen.id) == seen
