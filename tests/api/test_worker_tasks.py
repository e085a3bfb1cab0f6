"""The real tasks: in this process where that is quick, and once through real workers."""

from __future__ import annotations

import io
import json
import sys
import threading
import time

import numpy as np
import pytest
from PIL import Image

from api import worker_questions, worker_tasks
from api.codec import DocumentError
from api.jobs import JobRunner
from api.questions import NOTHING_MORE
from api.settings import LimitExceeded, Settings
from api.store import JobStatus, Store
from api.store_files import read_field, write_field, write_world
from api.uploads import Upload
from api.worker_main import Channel
from api.worker_orders import FieldOrder, UploadLimits
from api.workers import WorkerPool
from localization.errors import Cancelled, LocalizationError
from localization.field_builder import build_field, build_heading_field
from localization.heading_field import HeadingField, heading_field_hash
from localization.method import FieldMethod
from localization.sensors import FORWARD_CAMERA, LASER
from localization.uncertainty_field import field_hash
from maps.errors import MapFormatError, MapTooLarge
from maps.io.site import bundled_site
from maps.io.world_file import world_to_geojson
from planner.errors import GoalOutsideMap
from planner.problem import PlanningProblem
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
    ############
    #A........B#
    #....#.....#
    #....#.....#
    #..........#
    #C........D#
    ############
"""
YAML = "image: hall.png\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
CSV = b"id,x,y\nA,0.75,0.75\nB,4.75,0.75\nC,0.75,2.75\n"
ROOMY = UploadLimits(pixels=10_000, landmarks=100, memory=2**31)


class Line:
    def __init__(self):
        self.sent = []
        self.stop = threading.Event()
        self.memory = {}

    def channel(self):
        return Channel(lambda kind, payload: self.sent.append((kind, payload)), self.stop, self.memory)


def order(tmp_path, **changes):
    world = world_from_ascii(ROOM)
    write_world(world, tmp_path / "map.npz")
    values = {
        "field_id": "f_" + field_hash(world, LASER, world.grid_frame(0.5), 0.0),
        "map_path": tmp_path / "map.npz",
        "target": tmp_path / "field.zarr",
        "sensor": LASER,
        "resolution": 0.5,
        "heading": 0.0,
        "threads": 2,
        "max_cells": 1000,
    }
    return FieldOrder(**(values | changes))


def png(rows=7, cols=12):
    pixels = np.full((rows, cols), 254, dtype=np.uint8)
    pixels[0] = pixels[-1] = 0
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def parse(limits=ROOMY, **parts):
    upload = Upload(**parts)
    fields = {name: getattr(upload, name) for name in upload.__dataclass_fields__}
    return worker_tasks.parse(Line().channel(), fields, limits)


def test_a_built_field_equals_the_engine(tmp_path):
    line = Line()
    size, checksum = worker_tasks.build(line.channel(), order(tmp_path))
    made = read_field(tmp_path / "field.zarr")
    direct = build_field(world_from_ascii(ROOM), LASER, resolution=0.5)
    np.testing.assert_array_equal(made.covariance, direct.covariance)
    np.testing.assert_array_equal(made.triplet, direct.triplet)
    assert size > 0
    assert line.sent[-1][0] == "progress"
    assert line.sent[-1][1][0] == line.sent[-1][1][1]
    again = tmp_path / "again"
    again.mkdir()
    assert write_field(made, again / "field.zarr") == (size, checksum), "same content, same bytes"


def test_a_field_over_headings_is_built(tmp_path):
    world = world_from_ascii(ROOM)
    name = "f_" + heading_field_hash(world, FORWARD_CAMERA, world.grid_frame(0.5), 4)
    line = Line()
    worker_tasks.build(
        line.channel(), order(tmp_path, field_id=name, sensor=FORWARD_CAMERA, headings=4, max_cells=4000)
    )
    made = read_field(tmp_path / "field.zarr")
    assert isinstance(made, HeadingField)
    direct = build_heading_field(world, FORWARD_CAMERA, resolution=0.5, headings=4)
    for one, other in zip(made.slices, direct.slices, strict=True):
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert line.sent[-1][1][0] == line.sent[-1][1][1]


def test_a_field_is_built_by_the_method_that_was_ordered(tmp_path):
    world, method = world_from_ascii(ROOM), FieldMethod("all_visible", "trace")
    name = "f_" + field_hash(world, LASER, world.grid_frame(0.5), method=method)
    worker_tasks.build(Line().channel(), order(tmp_path, field_id=name, method=method))
    made = read_field(tmp_path / "field.zarr")
    assert made.method == method
    assert (made.triplet == -1).all()
    assert made.has_fix.any()
    with pytest.raises(LocalizationError, match="order it again"):
        worker_tasks.build(Line().channel(), order(tmp_path, method=method))


def test_a_build_stops_when_told_and_refuses_what_was_not_ordered(tmp_path):
    line = Line()
    line.stop.set()
    with pytest.raises(Cancelled):
        worker_tasks.build(line.channel(), order(tmp_path))
    with pytest.raises(LocalizationError, match="order it again"):
        worker_tasks.build(Line().channel(), order(tmp_path, field_id="f_other"))
    assert not (tmp_path / "field.zarr").exists()


def test_contexts_are_kept_by_use_and_memory(tmp_path):
    line = Line()
    for name in ("a", "b"):
        write_field(synthetic_field(world_from_ascii(ROOM)), tmp_path / name)
    one = 7 * 12 * 100 + 2 * 32 * 2**20

    def load(name, limit):
        return worker_questions.load(line.channel(), tmp_path / name, limit).kept

    assert load("a", 2 * one) == {"a"}
    kept = line.memory["fields"]["a"]
    assert load("b", 2 * one) == {"a", "b"}
    assert load("a", 2 * one) == {"a", "b"}
    assert line.memory["fields"]["a"] is kept
    assert load("a", one) == {"a"}


def test_a_plan_is_encoded_with_the_question_as_asked(tmp_path):
    line = Line()
    write_field(synthetic_field(world_from_ascii(ROOM), 0.25), tmp_path / "f")
    worker_questions.load(line.channel(), tmp_path / "f", 10**9)
    problem = PlanningProblem((1.6, 1.6), (4.4, 1.6), 0.1, deadline=5.0, refine=0)
    answer = worker_questions.plan(
        line.channel(), tmp_path / "f", problem, NOTHING_MORE, time.monotonic() + 2.0, "ref", ("clamped",)
    )
    assert answer["status"] in {"exact", "approximate"}
    assert answer["request"]["deadline_s"] == 5.0
    assert (answer["client_ref"], answer["warnings"][0]) == ("ref", "clamped")
    assert {kind for kind, _ in line.sent} <= {"report"}
    assert all(found.routes for _, found in line.sent)
    json.dumps(answer, allow_nan=False)
    outside = PlanningProblem((1.6, 1.6), (99.0, 1.6), 0.1)
    with pytest.raises(GoalOutsideMap):
        worker_questions.plan(
            line.channel(), tmp_path / "f", outside, NOTHING_MORE, time.monotonic() + 2.0, None, ()
        )


def test_uploads_become_worlds():
    world = parse(image=png(), meta=YAML, landmarks=CSV, landmark_format="csv")
    assert (world.name, world.floor.frame.shape, world.landmarks.ids) == ("hall", (7, 12), ("A", "B", "C"))
    assert parse(image=png(), meta=YAML, name="named").name == "named"


def test_a_world_file_comes_through_unchanged():
    site = bundled_site("mas97_room")
    again = parse(world=json.dumps(world_to_geojson(site)).encode(), name="room")
    assert again.content_hash() == site.content_hash()
    assert again.name == "room"


@pytest.mark.parametrize(
    ("parts", "error"),
    [
        ({"world": b"{"}, DocumentError),
        ({"world": b'{"a": NaN}'}, DocumentError),
        ({"world": b"{}"}, MapFormatError),
        ({"image": b"GIF89a", "meta": YAML}, MapFormatError),
        ({"image": png(), "meta": "image: ["}, MapFormatError),
    ],
)
def test_what_is_not_a_map_is_refused(parts, error):
    with pytest.raises(error):
        parse(**parts)


def test_limits_of_uploads_name_their_setting():
    with pytest.raises(LimitExceeded, match="84 pixels") as caught:
        parse(UploadLimits(pixels=50, landmarks=9, memory=2**31), image=png(), meta=YAML)
    assert caught.value.setting == "SUREPATH_MAX_IMAGE_PIXELS"
    with pytest.raises(LimitExceeded) as caught:
        parse(
            UploadLimits(pixels=500, landmarks=2, memory=2**31),
            image=png(),
            meta=YAML,
            landmarks=CSV,
            landmark_format="csv",
        )
    assert caught.value.setting == "SUREPATH_MAX_LANDMARKS"


def test_the_main_job_through_real_workers(tmp_path):
    settings = Settings(data_dir=tmp_path, workers=2, max_parse_bytes=30_000_000)
    store, pool = Store(settings), WorkerPool(settings)
    runner = JobRunner(store, pool, settings)
    pool.start()
    try:
        assert pool.wait_ready(240)
        runner.start()
        upload = Upload(image=png(), meta=YAML, landmarks=CSV, landmark_format="csv", name="hall")
        record, _ = store.add_map(pool.parse(upload), name=upload.name)
        field, job = runner.submit_field(record.id, LASER, 0.25)
        limit = time.monotonic() + 30
        while not store.job(job.id).status.ended and time.monotonic() < limit:
            time.sleep(0.02)
        assert store.job(job.id).status is JobStatus.SUCCESSFUL
        problem = PlanningProblem((1.5, 1.5), (4.5, 1.5), 0.2, deadline=5.0)
        answers = [pool.plan(store.field_path(field.id), problem) for _ in range(2)]
        assert answers[0]["status"] in {"exact", "approximate"}
        assert answers[0] == answers[1], "same request, same answer"
        assert answers[0]["field"] == field.id
        assert store.add_plan(answers[0]) == store.plan(answers[0]["plan"])
        assert store.plan(answers[0]["plan"]).answer == answers[0]
        if sys.platform == "linux":
            large = b"P5 7000 7000 255 " + bytes(49_000_000)
            with pytest.raises(MapTooLarge, match="SUREPATH_MAX_PARSE_BYTES"):
                pool.parse(Upload(image=large, meta=YAML))
            assert pool.parse(upload).landmarks.ids == ("A", "B", "C"), "the limit is lifted again"
    finally:
        runner.stop()
        pool.close()
        store.close()
