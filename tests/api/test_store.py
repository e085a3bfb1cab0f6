from __future__ import annotations

import sqlite3
import threading

import numpy as np
import pytest

from api import store_fields, store_files
from api.lru import LruCache
from api.settings import Settings
from api.store import (
    FieldNotReady,
    FieldStatus,
    InUse,
    JobStatus,
    NotFound,
    StorageFull,
    Store,
    StoreUnavailable,
)
from localization.method import FieldMethod
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA
from localization.uncertainty_field import FIELD_FORMAT
from maps.errors import InvalidGeometry
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

ROOM = """
    ########
    #A....B#
    #......#
    #..C...#
    ########
"""
OTHER = """
    ########
    #A....B#
    #...#..#
    #..C...#
    ########
"""


@pytest.fixture
def settings(tmp_path):
    return Settings(data_dir=tmp_path / "data")


@pytest.fixture
def open_store(settings):
    opened = []

    def open_one(**changes):
        for store in opened:
            store.close()
        opened.append(Store(settings.model_copy(update=changes)))
        return opened[-1]

    yield open_one
    for store in opened:
        store.close()


def compute(store, job_id):
    """What a worker does: the field in a staging folder."""
    job = store.claim_job(job_id) or store.job(job_id)
    record = store.field(job.field_id)
    staged = store.staging_path(job.id)
    field = synthetic_field(store.world(record.map_id), record.resolution, sensor=record.sensor)
    return staged, *store_files.write_field(field, staged)


def ready_field(store, drawing=ROOM):
    record, _ = store.add_map(world_from_ascii(drawing))
    field, job = store.add_field_request(record.id, LASER, 0.5)
    staged, size, checksum = compute(store, job.id)
    assert store.commit_field(job.id, staged, size=size, checksum=checksum)
    return store.field(field.id)


def all_files(store):
    return sorted(
        str(p.relative_to(store.data_dir))
        for p in store.data_dir.rglob("*")
        if p.is_file() and not p.name.startswith("surepath.db")
    )


def test_a_map_is_kept_once_whatever_its_names(open_store):
    store = open_store()
    world = world_from_ascii(ROOM)
    first, created = store.add_map(world, name="hall")
    again, created_again = store.add_map(world, name="the hall")
    assert (created, created_again) == (True, False)
    assert first.id == again.id == "m_" + world.content_hash()
    assert (again.name, again.n_landmarks, again.shape, again.kind) == ("the hall", 3, (5, 8), "grid")
    assert [m.id for m in store.maps()] == [first.id]
    for name in (first.id, "hall", "the hall"):
        assert store.map(name).id == first.id


def test_a_name_moves_to_the_newest_map(open_store):
    store = open_store()
    store.add_map(world_from_ascii(ROOM), name="hall")
    second, _ = store.add_map(world_from_ascii(OTHER), name="hall")
    assert store.map("hall").id == second.id
    store.delete_map(second.id)
    with pytest.raises(NotFound, match="hall"):
        store.map("hall")


def test_maps_survive_a_new_start(open_store):
    world = world_from_ascii(ROOM)
    record, _ = open_store().add_map(world)
    store = open_store()
    assert store.maps() == [record]
    assert store.world(record.id).content_hash() == world.content_hash()
    assert store.world("ascii") is store.world(record.id), "read once, then from memory"


def test_a_damaged_map_file_is_said(open_store):
    record, _ = open_store().add_map(world_from_ascii(ROOM))
    store = open_store()
    store.map_path(record.id).write_bytes(b"PK broken")
    with pytest.raises(StoreUnavailable, match="damaged"):
        store.world(record.id)


def test_what_is_missing_is_named(open_store):
    store = open_store()
    for read, word in (
        (store.map, "m_1"),
        (store.world, "m_1"),
        (store.delete_map, "m_1"),
        (store.field, "f_1"),
        (store.load_field, "f_1"),
        (store.delete_field, "f_1"),
        (store.job, "j_1"),
        (store.dismiss_job, "j_1"),
        (store.plan, "p_1"),
    ):
        with pytest.raises(NotFound, match=word):
            read(word)
    with pytest.raises(NotFound):
        store.add_field_request("m_1", LASER, 0.5)


def test_a_field_request_is_idempotent(open_store):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM))
    field, job = store.add_field_request(record.id, LASER, 0.5)
    assert (field.status, job.status, job.field_id) == (FieldStatus.RUNNING, JobStatus.ACCEPTED, field.id)
    # An omnidirectional sensor does not care for the heading.
    assert store.add_field_request("ascii", LASER, 0.5, heading=1.0) == (field, job)
    other, _ = store.add_field_request(record.id, MAS97_CAMERA, 0.5)
    assert other.id != field.id
    with pytest.raises(FieldNotReady) as caught:
        store.load_field(field.id)
    assert caught.value.job == job.id
    with pytest.raises(InvalidGeometry):
        store.add_field_request(record.id, LASER, float("nan"))
    assert len(store.fields()) == len(store.jobs()) == 2


def test_each_method_has_a_field_of_its_own(open_store):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM))
    plain, _ = store.add_field_request(record.id, LASER, 0.5)
    method = FieldMethod("all_visible", "trace")
    other, _ = store.add_field_request(record.id, LASER, 0.5, method=method)
    assert plain.id != other.id
    assert (plain.method, other.method) == (FieldMethod(), method)
    assert open_store().field(other.id).method == method


def test_a_committed_field_is_read_and_its_request_answered(open_store):
    store = open_store()
    record = ready_field(store)
    field = store.load_field(record.id)
    assert record.id == "f_" + field.content_hash()
    assert (record.size, record.checksum) == store_files.measure(store.field_path(record.id))
    assert record.resolution == 0.5
    assert record.sensor == LASER
    assert store.add_field_request(record.map_id, LASER, 0.5) == (record, None)
    assert store.job(record.job).status is JobStatus.SUCCESSFUL
    assert store.used_bytes() > record.size
    again = open_store()
    assert again.field(record.id) == record
    assert again.load_field(record.id).content_hash() == field.content_hash()


def test_fields_hold_their_map_until_they_go(open_store):
    store = open_store()
    record = ready_field(store)
    with pytest.raises(InUse, match=record.id):
        store.delete_map(record.map_id)
    store.delete_field(record.id)
    with pytest.raises(NotFound):
        store.load_field(record.id)
    store.delete_map(record.map_id)
    assert store.maps() == store.fields() == []
    assert store.used_bytes() == 0
    assert all_files(store) == ["lock"]


def test_a_running_field_is_not_deleted(open_store):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM))
    field, job = store.add_field_request(record.id, LASER, 0.5)
    with pytest.raises(InUse, match=job.id):
        store.delete_field(field.id)
    with pytest.raises(InUse):
        store.delete_map(record.id)


def test_a_crash_between_file_and_row_shows_nothing(open_store, monkeypatch):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM))
    field, job = store.add_field_request(record.id, LASER, 0.5)
    staged, size, checksum = compute(store, job.id)
    moved = []

    def move_and_die(source, target):
        store_files.move(source, target)
        moved.append(target)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(store_fields, "move", move_and_die)
        with pytest.raises(KeyboardInterrupt):
            store.commit_field(job.id, staged, size=size, checksum=checksum)
    assert moved[0].is_dir()
    assert store.field(field.id).status is FieldStatus.RUNNING
    store = open_store()
    assert not moved[0].exists(), "what no row knows is removed on start"
    waiting = store.job(job.id)
    assert (waiting.status, waiting.attempts) == (JobStatus.ACCEPTED, 0)
    staged, size, again = compute(store, job.id)
    assert again == checksum, "the second run has the same bytes"
    assert store.commit_field(job.id, staged, size=size, checksum=again)


def test_a_crash_while_a_map_is_stored_shows_nothing(open_store, monkeypatch):
    store = open_store()
    with monkeypatch.context() as patch:
        patch.setattr("api.store_maps._row", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            store.add_map(world_from_ascii(ROOM))
    assert store.maps() == []
    assert len(all_files(store)) == 2
    store = open_store()
    assert all_files(store) == ["lock"]
    assert store.add_map(world_from_ascii(ROOM))[1]


def test_leftovers_go_and_what_rows_know_stays(open_store):
    store = open_store()
    record = ready_field(store)
    (store.data_dir / "staging" / "j_1.zarr").mkdir()
    (store.data_dir / "fields" / "f_1.zarr").mkdir()
    (store.data_dir / "maps" / ".m_1.npz.tmp").write_bytes(b"half")
    store = open_store()
    names = {p.name for folder in ("staging", "fields", "maps") for p in (store.data_dir / folder).iterdir()}
    assert names == {f"{record.map_id}.npz", f"{record.id}.zarr"}


def test_a_field_whose_files_are_gone_is_built_again(open_store):
    store = open_store()
    record = ready_field(store)
    store_files.remove(store.field_path(record.id))
    with pytest.raises(StoreUnavailable):
        store.load_field(record.id)
    store = open_store()
    with pytest.raises(FieldNotReady, match="missing"):
        store.load_field(record.id)
    field, job = store.add_field_request(record.map_id, LASER, 0.5)
    assert (field.id, job.status) == (record.id, JobStatus.ACCEPTED)


def test_jobs_go_their_way(open_store):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM))
    field, job = store.add_field_request(record.id, LASER, 0.5)
    assert store.claim_job(job.id).attempts == 1
    assert store.claim_job(job.id) is None, "taken"
    store.set_progress(job.id, 3, 8)
    assert (store.job(job.id).done, store.job(job.id).total) == (3, 8)
    store.release_job(job.id, refund=False)
    assert store.claim_job(job.id).attempts == 2
    store.fail_job(job.id, "No more.")
    assert store.field(field.id).error == "No more."
    with pytest.raises(FieldNotReady, match="No more"):
        store.load_field(field.id)
    assert store.dismiss_job(job.id).status is JobStatus.FAILED, "ended jobs stay as they are"
    _, second = store.add_field_request(record.id, LASER, 0.5)
    assert second.id != job.id
    assert store.dismiss_job(second.id).status is JobStatus.DISMISSED
    assert store.field(field.id).status is FieldStatus.FAILED
    store.delete_map(record.id)
    assert [j.id for j in store.jobs(JobStatus.FAILED, JobStatus.DISMISSED)] == [job.id, second.id]


def test_a_dismissed_job_commits_nothing(open_store):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM))
    field, job = store.add_field_request(record.id, LASER, 0.5)
    staged, size, checksum = compute(store, job.id)
    store.dismiss_job(job.id)
    assert not store.commit_field(job.id, staged, size=size, checksum=checksum)
    assert not staged.exists()
    assert store.field(field.id).status is FieldStatus.FAILED


def test_the_storage_limit_holds_and_changes_nothing(open_store):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM))
    store = open_store(max_storage_bytes=store.used_bytes())
    before = all_files(store)
    with pytest.raises(StorageFull, match="SUREPATH_MAX_STORAGE_BYTES") as caught:
        store.add_map(world_from_ascii(OTHER))
    assert caught.value.limit < caught.value.requested
    with pytest.raises(StorageFull):
        store.add_field_request(record.id, LASER, 0.5)
    with pytest.raises(StorageFull):
        store.add_plan({"plan": "p_1", "field": "f_1"})
    assert all_files(store) == before
    assert store.fields() == store.jobs() == []
    assert not store.add_map(world_from_ascii(ROOM))[1], "what is there needs no room"


def test_a_full_disk_is_said_and_leaves_nothing(open_store, monkeypatch):
    store = open_store()

    def full(_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(store_files.os, "fsync", full)
        with pytest.raises(StorageFull, match="disk is full"):
            store.add_map(world_from_ascii(ROOM))
    assert store.maps() == []
    assert all_files(store) == ["lock"]


def test_a_locked_database_is_said(open_store, settings, monkeypatch):
    monkeypatch.setattr("api.store_schema.BUSY_TIMEOUT_S", 0)
    store = open_store()
    other = sqlite3.connect(settings.data_dir / "surepath.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    try:
        with pytest.raises(StoreUnavailable, match="locked"):
            store.add_map(world_from_ascii(ROOM))
    finally:
        other.close()
    assert store.add_map(world_from_ascii(ROOM))[1]


def test_one_process_at_a_time(open_store, settings, tmp_path):
    store = open_store()
    with pytest.raises(StoreUnavailable, match="Another process"):
        Store(settings)
    store.check()
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(StoreUnavailable, match="data folder"):
        Store(Settings(data_dir=blocked / "data"))


def test_a_newer_database_is_refused(open_store, settings):
    open_store().close()
    database = sqlite3.connect(settings.data_dir / "surepath.db")
    with database:
        database.execute("UPDATE info SET schema_version = 99")
    database.close()
    with pytest.raises(StoreUnavailable, match="newer version"):
        Store(settings)


def _make_version_1(database):
    """What version 1 left behind: fields without method and format."""
    with database:
        for column in ("estimator", "criterion", "field_format", "headings"):
            database.execute(f"ALTER TABLE fields DROP COLUMN {column}")
        database.execute("UPDATE info SET schema_version = 1")


def test_a_data_folder_of_version_1_opens(open_store, settings):
    store = open_store()
    ready = ready_field(store)
    waiting, job = store.add_field_request(ready.map_id, MAS97_CAMERA, 0.5)
    plan = store.add_plan({"plan": "p_1", "field": ready.id, "status": "exact"})
    store.close()
    database = sqlite3.connect(settings.data_dir / "surepath.db")
    _make_version_1(database)
    database.close()
    for _ in range(2):  # the second start finds what the first one made of it
        store = open_store()
        assert store.map("ascii").id == ready.map_id
        assert store.plan("p_1") == plan
        for field in (ready, waiting):
            old = store.field(field.id)
            assert (old.method, old.field_format, old.status) == (FieldMethod(), 1, FieldStatus.FAILED)
            with pytest.raises(FieldNotReady, match=r"earlier version.* POST /v1/fields") as caught:
                store.load_field(field.id)
            assert caught.value.job is None
            assert caught.value.order["map"] == ready.map_id
            assert caught.value.order["sensor"]["kind"] == field.sensor.kind
        assert store.job(job.id).status is JobStatus.FAILED
        assert not list((store.data_dir / "fields").iterdir()), "files that nobody can read are gone"
    store.delete_map(ready.map_id)
    assert store.fields() == []


def test_a_data_folder_of_version_2_opens_with_its_fields(open_store, settings):
    store = open_store()
    ready = ready_field(store)
    before = store.load_field(ready.id).covariance
    store.close()
    database = sqlite3.connect(settings.data_dir / "surepath.db")
    with database:
        database.execute("ALTER TABLE fields DROP COLUMN headings")
        database.execute("UPDATE info SET schema_version = 2")
    database.close()
    store = open_store()
    assert (store.field(ready.id), store.field(ready.id).headings) == (ready, 1)
    np.testing.assert_array_equal(store.load_field(ready.id).covariance, before)


def test_a_field_over_headings_is_another_one_and_needs_more_room(open_store):
    store = open_store()
    record, _ = store.add_map(world_from_ascii(ROOM), name="r")
    one, _ = store.add_field_request(record.id, FORWARD_CAMERA, 0.5)
    many, job = store.add_field_request(record.id, FORWARD_CAMERA, 0.5, headings=8)
    assert one.id != many.id
    assert (one.headings, many.headings) == (1, 8)
    assert store.add_field_request(record.id, FORWARD_CAMERA, 0.5, headings=8)[1].id == job.id


def test_a_field_of_another_format_is_retired(open_store, settings):
    store = open_store()
    record = ready_field(store)
    store.close()
    database = sqlite3.connect(settings.data_dir / "surepath.db")
    with database:
        database.execute("UPDATE fields SET field_format = ?", (FIELD_FORMAT - 1,))
    database.close()
    store = open_store()
    with pytest.raises(FieldNotReady, match="earlier version"):
        store.load_field(record.id)
    # The same content under this program has its own row again.
    field, job = store.add_field_request(record.map_id, LASER, 0.5)
    assert (field.field_format, field.status, job.status) == (
        FIELD_FORMAT,
        FieldStatus.RUNNING,
        JobStatus.ACCEPTED,
    )


def test_the_database_is_set_up_to_survive(open_store):
    store = open_store()
    with store._read() as connection:
        found = [
            connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "busy_timeout", "foreign_keys")
        ]
    assert found == ["wal", 2, 5000, 1]


def test_plans_are_kept_bounded_and_for_a_week(open_store, monkeypatch):
    store = open_store(max_plans=2)
    for k in range(3):
        monkeypatch.setattr("api.store.now", lambda k=k: 1000.0 + k)
        store.add_plan({"plan": f"p_{k}", "field": "f_1", "status": "exact"})
    assert store.plan("p_2").answer == {"plan": "p_2", "field": "f_1", "status": "exact"}
    store.plan("p_1")
    with pytest.raises(NotFound):
        store.plan("p_0")
    monkeypatch.setattr("api.store.now", lambda: 1000.0 + 8 * 86400)
    with pytest.raises(NotFound, match="7 days"):
        store.plan("p_2")


def test_many_threads_ask_for_one_field(open_store):
    store = open_store()
    world = world_from_ascii(ROOM)
    found, errors = [], []
    start = threading.Barrier(8)

    def ask():
        try:
            start.wait()
            record, created = store.add_map(world)
            field, job = store.add_field_request(record.id, LASER, 0.5)
            found.append((created, field.id, job.id))
        except Exception as error:  # noqa: BLE001
            errors.append(error)

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    assert sum(created for created, _, _ in found) == 1
    assert len({pair[1:] for pair in found}) == 1


def test_the_cache_loads_once_and_forgets_the_oldest():
    cache = LruCache(10, cost=len)
    loads = []

    def load(value):
        loads.append(value)
        return value

    for key in ("aaaa", "bbbb", "aaaa", "cccc"):
        assert cache.get(key, lambda key=key: load(key)) == key
    assert loads == ["aaaa", "bbbb", "cccc"]
    assert "bbbb" not in cache
    assert "aaaa" in cache
    cache.get("x" * 50, lambda: "x" * 50)
    assert "x" * 50 in cache, "one value is kept whatever it costs"
    with pytest.raises(ZeroDivisionError):
        cache.get("fails", lambda: 1 // 0)
    cache.drop("aaaa")
    assert "aaaa" not in cache
