from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from api import worker_process
from api.jobs import MAX_ATTEMPTS, JobRunner
from api.settings import LimitExceeded, Settings
from api.store import FieldStatus, JobStatus, NotFound, StorageFull, Store
from api.workers import WorkerPool
from localization.errors import InvalidSensor
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA
from maps.errors import InvalidGeometry, TooFewLandmarks
from tests.worlds import world_from_ascii

ROOT = str(Path(__file__).parents[2])
PROGRAM = "tests.api.worker_programs:PROGRAM"
ROOM = """
    ########
    #A....B#
    #......#
    #..C...#
    ########
"""
WARM_S = 30


def wait_for(condition, timeout=20.0):
    limit = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < limit, "it never happened"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def pool():
    sys.path.insert(0, ROOT)
    made = WorkerPool(Settings(workers=2), program=PROGRAM)
    made.start()
    assert made.wait_ready(WARM_S)
    yield made
    made.close()
    sys.path.remove(ROOT)


class Service:
    """Store and runner on one folder; files beside it tell the workers what to do."""

    def __init__(self, folder, pool, **limits):
        self.settings = Settings(data_dir=folder / "data", workers=2, **limits)
        self.pool = pool
        self.runner = None
        self.begin()

    def begin(self):
        self.store = Store(self.settings)
        self.flags = self.store.data_dir
        self.runner = JobRunner(self.store, self.pool, self.settings)
        self.runner.start()
        self.map, _ = self.store.add_map(world_from_ascii(ROOM))

    def end(self):
        self.runner.stop()
        self.store.close()

    def order(self, sensor=LASER, resolution=0.5):
        return self.runner.submit_field(self.map.id, sensor, resolution)

    def flag(self, name):
        (self.flags / name).touch()

    def unflag(self, name):
        (self.flags / name).unlink()

    def wait(self, job, *statuses):
        wait_for(lambda: self.store.job(job.id).status in statuses)
        return self.store.job(job.id)

    def builds(self):
        log = self.flags / "built"
        return log.read_text().split() if log.exists() else []

    def staging(self):
        return list((self.flags / "staging").iterdir())


@pytest.fixture
def service(tmp_path, pool, monkeypatch):
    monkeypatch.setattr("api.jobs._PAUSE_S", 0.05)
    made = Service(tmp_path, pool)
    yield made
    made.end()


def test_a_field_is_computed_once(service):
    field, job = service.order()
    done = service.wait(job, JobStatus.SUCCESSFUL)
    assert (done.done, done.total, done.attempts, done.error) == (20, 20, 1, None)
    assert done.created <= done.started <= done.ended
    ready = service.store.field(field.id)
    assert ready.status is FieldStatus.READY
    assert (
        service.store.load_field(field.id).world.content_hash()
        == service.store.world(service.map.id).content_hash()
    )
    assert service.order() == (ready, None)
    assert service.builds() == [field.id]
    assert service.staging() == []


def test_many_threads_order_one_field(service):
    found = []
    threads = [threading.Thread(target=lambda: found.append(service.order())) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({field.id for field, _ in found}) == 1
    assert len({job.id for _, job in found if job is not None}) == 1
    service.wait(service.store.jobs()[0], JobStatus.SUCCESSFUL)
    assert len(service.builds()) == 1


def test_progress_is_written_down_while_it_runs(service):
    service.flag("hold")
    field, job = service.order()
    wait_for(lambda: service.store.job(job.id).total == 20)
    running = service.store.job(job.id)
    assert running.status is JobStatus.RUNNING
    assert 0 <= running.done <= 10
    assert service.order()[1].id == job.id
    assert service.store.field(field.id).status is FieldStatus.RUNNING
    service.unflag("hold")
    service.wait(job, JobStatus.SUCCESSFUL)


def test_a_running_job_is_dismissed_and_can_be_ordered_again(service):
    service.flag("hold")
    field, job = service.order()
    wait_for(lambda: service.store.job(job.id).total == 20)
    assert service.runner.dismiss(job.id).status is JobStatus.DISMISSED
    wait_for(lambda: not service.runner._current)
    assert service.store.field(field.id).status is FieldStatus.FAILED
    service.unflag("hold")
    _, second = service.order()
    assert second.id != job.id
    service.wait(second, JobStatus.SUCCESSFUL)
    assert service.store.job(job.id).status is JobStatus.DISMISSED
    assert service.runner.dismiss(second.id).status is JobStatus.SUCCESSFUL, "ended jobs stay"
    with pytest.raises(NotFound):
        service.runner.dismiss("j_1")


def test_a_job_that_does_not_listen_is_killed(service, monkeypatch):
    monkeypatch.setattr(worker_process, "CANCEL_GRACE_S", 0.2)
    service.flag("deaf")
    _, job = service.order()
    wait_for(lambda: service.store.job(job.id).total == 20)
    began = time.monotonic()
    service.runner.dismiss(job.id)
    wait_for(lambda: not service.runner._current)
    assert time.monotonic() - began < 3
    assert service.store.job(job.id).status is JobStatus.DISMISSED
    service.unflag("deaf")
    service.wait(service.order()[1], JobStatus.SUCCESSFUL)


def test_a_waiting_job_is_dismissed_before_it_begins(service):
    service.flag("hold")
    _, first = service.order()
    wait_for(lambda: service.store.job(first.id).status is JobStatus.RUNNING)
    field, second = service.order(MAS97_CAMERA)
    service.runner.dismiss(second.id)
    service.unflag("hold")
    service.wait(first, JobStatus.SUCCESSFUL)
    assert service.store.job(second.id).status is JobStatus.DISMISSED
    assert field.id not in service.builds()


def test_a_killed_worker_costs_an_attempt_only(service):
    service.flag("die")
    _, job = service.order()
    wait_for(lambda: service.store.job(job.id).attempts == 2)
    service.unflag("die")
    done = service.wait(job, JobStatus.SUCCESSFUL, JobStatus.FAILED)
    assert done.status is JobStatus.SUCCESSFUL
    assert done.attempts in {2, 3}
    assert service.staging() == []


def test_three_dead_workers_end_a_job(service):
    service.flag("die")
    field, job = service.order()
    failed = service.wait(job, JobStatus.FAILED)
    assert failed.attempts == MAX_ATTEMPTS
    assert "3 attempts" in failed.error
    assert service.store.field(field.id).error == failed.error
    wait_for(lambda: service.staging() == [])
    service.unflag("die")
    service.wait(service.order()[1], JobStatus.SUCCESSFUL)


@pytest.mark.parametrize(
    ("flag", "words"), [("refuse", "never"), ("bug", "log of the service"), ("odd", "log of the service")]
)
def test_mistakes_and_bugs_fail_at_once(service, flag, words):
    service.flag(flag)
    _, job = service.order()
    failed = service.wait(job, JobStatus.FAILED)
    assert failed.attempts == 1
    assert words in failed.error


def test_a_stop_puts_the_job_back_and_the_next_start_does_it(service):
    service.flag("hold")
    field, job = service.order()
    wait_for(lambda: service.store.job(job.id).total == 20)
    service.end()
    service.begin()
    again = service.store.job(job.id)
    assert again.status in {JobStatus.ACCEPTED, JobStatus.RUNNING}
    service.unflag("hold")
    done = service.wait(job, JobStatus.SUCCESSFUL)
    assert done.attempts == 1, "a stop is no fault of the job"
    assert service.store.field(field.id).status is FieldStatus.READY


def test_orders_that_make_no_sense_leave_no_trace(tmp_path, pool):
    service = Service(tmp_path, pool, max_field_cells=100)
    try:
        with pytest.raises(LimitExceeded, match="SUREPATH_MAX_FIELD_CELLS") as caught:
            service.order(resolution=0.1)
        assert (caught.value.limit, caught.value.requested) == (100, 1000)
        with pytest.raises(InvalidGeometry):
            service.order(resolution=0.0)
        with pytest.raises(NotFound):
            service.runner.submit_field("m_1", LASER, 0.5)
        empty, _ = service.store.add_map(world_from_ascii(ROOM.replace("A", ".")))
        with pytest.raises(TooFewLandmarks):
            service.runner.submit_field(empty.id, LASER, 0.5)
        with pytest.raises(InvalidSensor, match="every heading"):
            service.runner.submit_field(service.map.id, LASER, 0.5, headings=4)
        with pytest.raises(LimitExceeded, match="at 20 headings"):
            service.runner.submit_field(service.map.id, FORWARD_CAMERA, 0.4, headings=20)
        assert service.store.fields() == service.store.jobs() == []
    finally:
        service.end()


def test_memory_limits_a_field(tmp_path, pool):
    service = Service(tmp_path, pool, max_field_bytes=5000)
    try:
        with pytest.raises(LimitExceeded, match="SUREPATH_MAX_FIELD_BYTES"):
            service.order(resolution=0.1)
        service.wait(service.order()[1], JobStatus.SUCCESSFUL)
    finally:
        service.end()


def test_a_field_that_does_not_fit_fails_its_job(service, monkeypatch):
    service.flag("hold")
    _, job = service.order()
    wait_for(lambda: service.store.job(job.id).total == 20)

    def full(*_):
        raise StorageFull("No room.", limit=1, requested=2)

    monkeypatch.setattr(service.store, "_require_room", full)
    service.unflag("hold")
    assert service.wait(job, JobStatus.FAILED).error == "No room."
    wait_for(lambda: service.staging() == [])


KILLED = f"""
import sys, time
from pathlib import Path
from api.jobs import JobRunner
from api.settings import Settings
from api.store import Store
from api.workers import WorkerPool
from localization.sensors import LASER
from tests.worlds import world_from_ascii
if __name__ == "__main__":
    settings = Settings(data_dir=Path(sys.argv[1]), workers=2)
    store = Store(settings)
    (store.data_dir / "hold").touch()
    pool = WorkerPool(settings, program={PROGRAM!r})
    pool.start()
    runner = JobRunner(store, pool, settings)
    runner.start()
    world = world_from_ascii('''{ROOM}''')
    field, job = runner.submit_field(store.add_map(world)[0].id, LASER, 0.5)
    while store.job(job.id).total == 0:
        time.sleep(0.01)
    print(job.id, field.id, flush=True)
    time.sleep(60)
"""


def test_a_killed_service_takes_its_job_up_again(tmp_path, pool):
    script = tmp_path / "service.py"
    script.write_text(KILLED)
    command = [sys.executable, str(script), str(tmp_path / "data")]
    victim = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": ROOT}
    )
    try:
        job_id, field_id = victim.stdout.readline().split()
    finally:
        os.kill(victim.pid, signal.SIGKILL)
        victim.wait()
        victim.stdout.close()
    (tmp_path / "data" / "staging" / f"{job_id}.half.zarr").mkdir()
    service = Service(tmp_path, pool)
    try:
        assert service.store.job(job_id).status in {JobStatus.ACCEPTED, JobStatus.RUNNING}
        service.unflag("hold")
        done = service.wait(service.store.job(job_id), JobStatus.SUCCESSFUL)
        assert done.attempts == 1
        assert service.builds() == [field_id]
        assert service.staging() == []
        assert service.store.load_field(field_id)
    finally:
        service.end()
