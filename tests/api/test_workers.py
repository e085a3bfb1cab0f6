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
from api.settings import Settings
from api.uploads import Upload
from api.worker_orders import MatrixOrder
from api.worker_process import DeadlineExceeded
from api.workers import Overloaded, TaskCrashed, WorkerDied, WorkerPool
from maps.errors import MapFormatError, MapTooLarge
from planner.errors import GoalOccupied, InvalidProblem
from planner.problem import PlanningProblem

PROGRAM = "tests.api.worker_programs:PROGRAM"
FIELD = Path("f_1.zarr")
ROOT = str(Path(__file__).parents[2])


@pytest.fixture(scope="module", autouse=True)
def workers_find_the_tests():
    sys.path.insert(0, ROOT)
    yield
    sys.path.remove(ROOT)


def problem(deadline=5.0):
    return PlanningProblem((0, 0), (1, 1), 0.2, deadline=deadline)


def many(deadline=5.0, client_ref=None):
    return MatrixOrder(((0.0, 0.0),), None, problem(), ("cost",), deadline, 1, client_ref)


def wait_for(condition, timeout=20.0):
    limit = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < limit, "it never happened"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def pool(workers_find_the_tests):
    made = WorkerPool(Settings(workers=2, max_queue=4, max_parse_s=0.5), program=PROGRAM)
    made.start()
    assert made.wait_ready(30)
    yield made
    made.close()


@pytest.fixture(autouse=True)
def whole(request):
    """Each test begins with all workers there."""
    if "pool" in request.fixturenames:
        made = request.getfixturevalue("pool")
        wait_for(lambda: len(pids(made)) == 2)


def pids(pool):
    with pool._crew._changed:
        return [w.process.pid for w in pool._crew._workers if w.state is worker_process.State.IDLE]


def gone(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_a_plan_comes_back_and_the_worker_that_knows_the_field_is_asked_again(pool):
    first = pool.plan(FIELD, problem())
    assert first["grid_cost"] == 3
    assert 4.0 < first["left"] <= 5.0
    assert {pool.plan(FIELD, problem())["pid"] for _ in range(4)} == {first["pid"]}


def test_mistakes_and_bugs_come_back_and_cost_no_worker(pool):
    before = sorted(pids(pool))
    with pytest.raises(GoalOccupied) as caught:
        pool.plan(FIELD, problem(), client_ref="wrong")
    assert caught.value.nearest_free == (1.0, 2.0)
    with pytest.raises(TaskCrashed, match="ZeroDivisionError"):
        pool.plan(FIELD, problem(), client_ref="bug")
    with pytest.raises(MapFormatError):
        pool.plan(Path("broken"), problem())
    assert sorted(pids(pool)) == before


def test_a_plan_that_hangs_answers_with_its_last_report(pool):
    before = pids(pool)
    began = time.monotonic()
    answer = pool.plan(FIELD, problem(0.4), client_ref="hang", warnings=["clamped"])
    took = time.monotonic() - began
    assert 0.6 < took < 0.4 + 0.5
    assert (answer["grid_cost"], answer["status"], len(answer["routes"])) == (2.0, "exact", 1)
    assert answer["warnings"] == ["clamped", "first", "The planner was stopped after the deadline."]
    assert (answer["field"], answer["client_ref"]) == ("f_1", "hang")
    assert answer["plan"].startswith("p_")
    assert len(pids(pool)) == 1, "one is left until the other is replaced"
    assert pool.ready
    assert pool.plan(FIELD, problem())["grid_cost"] == 3
    wait_for(lambda: len(pids(pool)) == 2)
    assert len(set(before) & set(pids(pool))) == 1, "the one that hung was killed"


def test_a_plan_that_is_only_late_costs_no_worker(pool):
    before = sorted(pids(pool))
    assert pool.plan(FIELD, problem(0.2), client_ref="late")["grid_cost"] == 1.0
    wait_for(lambda: len(pids(pool)) == 2)
    assert sorted(pids(pool)) == before
    assert pool.plan(FIELD, problem())["grid_cost"] == 3, "the late answer is not taken for another one's"


def test_a_plan_that_hangs_at_once_answers_without_a_route(pool):
    answer = pool.plan(FIELD, problem(0.1), client_ref="hang at once")
    assert (answer["status"], answer["routes"]) == ("timeout", [])


def test_a_worker_that_dies_answers_with_its_last_route_or_says_so(pool):
    with pytest.raises(WorkerDied):
        pool.plan(FIELD, problem(), client_ref="die")
    answer = pool.plan(FIELD, problem(), client_ref="die late")
    assert answer["grid_cost"] == 1.0
    assert "unexpectedly" in answer["warnings"][-1]


def test_questions_about_many_places_are_asked_in_workers(pool):
    first = pool.ask(FIELD, many())
    assert 4.0 < first["left"] <= 5.0
    assert pool.plan(FIELD, problem())["pid"] == first["pid"], "the worker that has the field"
    before = sorted(pids(pool))
    with pytest.raises(InvalidProblem, match="too many"):
        pool.ask(FIELD, many(client_ref="wrong"))
    with pytest.raises(Overloaded, match="still being read"):
        pool.ask(Path("slow"), many(0.1))
    wait_for(lambda: len(pids(pool)) == 2)
    with pytest.raises(DeadlineExceeded, match=r"within 0\.1 s"):
        pool.ask(FIELD, many(0.1, client_ref="late"))
    wait_for(lambda: len(pids(pool)) == 2)
    assert sorted(pids(pool)) == before


@pytest.mark.parametrize(("how", "error"), [("hang", DeadlineExceeded), ("die", WorkerDied)])
def test_a_question_that_hangs_or_kills_costs_one_worker(pool, how, error):
    before = pids(pool)
    began = time.monotonic()
    with pytest.raises(error):
        pool.ask(FIELD, many(0.3, client_ref=how))
    assert time.monotonic() - began < 0.3 + 0.5
    assert pool.ask(FIELD, many())["left"] > 0
    wait_for(lambda: len(set(pids(pool)) - set(before)) == 1)


def test_an_idle_worker_that_is_killed_is_replaced(pool):
    before = pids(pool)
    os.kill(before[0], signal.SIGKILL)
    wait_for(lambda: len(pids(pool)) == 2 and before[0] not in pids(pool))
    assert pool.plan(FIELD, problem())["grid_cost"] == 3


def test_ctrl_c_is_not_for_workers(pool):
    before = sorted(pids(pool))
    for pid in before:
        os.kill(pid, signal.SIGINT)
    time.sleep(0.2)
    assert pool.plan(FIELD, problem())["grid_cost"] == 3
    assert sorted(pids(pool)) == before


def test_a_field_that_is_read_too_slowly_is_there_next_time(pool):
    with pytest.raises(Overloaded, match="still being read"):
        pool.plan(Path("slow"), problem(0.1))
    wait_for(lambda: len(pids(pool)) == 2)
    before = sorted(pids(pool))
    assert pool.plan(Path("slow"), problem())["grid_cost"] == 3
    assert sorted(pids(pool)) == before, "nobody was killed for it"


def test_a_field_is_read_ahead(pool):
    began = time.monotonic()
    pool.prefetch(Path("slow"))
    pool.prefetch(Path("broken"))
    assert time.monotonic() - began < 0.3
    wait_for(lambda: len(pids(pool)) == 2)
    before = sorted(pids(pool))
    assert pool.plan(Path("slow"), problem())["grid_cost"] == 3
    assert sorted(pids(pool)) == before


def test_more_requests_than_workers_wait_their_turn_and_too_many_are_refused(pool):
    answers, refused = [], []

    def ask():
        try:
            answers.append(pool.plan(FIELD, problem(), client_ref="sleep"))
        except Overloaded as error:
            refused.append(str(error))

    threads = [threading.Thread(target=ask) for _ in range(9)]
    for thread in threads:
        thread.start()
        time.sleep(0.01)
    for thread in threads:
        thread.join()
    assert len(answers) == 6, "two at work, four waiting"
    assert len(refused) == 3
    assert all("SUREPATH_MAX_QUEUE" in text for text in refused)
    assert len({a["pid"] for a in answers}) == 2


def test_waiting_ends_at_the_deadline(pool):
    threads = [
        threading.Thread(target=pool.plan, args=(FIELD, problem()), kwargs={"client_ref": "sleep"})
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    time.sleep(0.05)
    with pytest.raises(Overloaded, match="before the deadline"):
        pool.plan(FIELD, problem(0.1))
    for thread in threads:
        thread.join()


def test_uploads_are_decoded_aside(pool):
    assert pool.parse(Upload(name="fine")) == "fine"
    with pytest.raises(MapTooLarge, match="SUREPATH_MAX_PARSE_S"):
        pool.parse(Upload(name="hang"))
    with pytest.raises(MapTooLarge):
        pool.parse(Upload(name="die"))


def test_close_ends_calls_and_processes():
    pool = WorkerPool(Settings(workers=2), program=PROGRAM)
    pool.start()
    assert pool.wait_ready(30)
    processes = pids(pool)
    raised = []

    def hang():
        try:
            pool.plan(FIELD, problem(), client_ref="hang at once")
        except WorkerDied as error:
            raised.append(error)

    thread = threading.Thread(target=hang)
    thread.start()
    wait_for(lambda: len(pids(pool)) == 1)
    began = time.monotonic()
    pool.close()
    pool.close()
    thread.join(5)
    assert time.monotonic() - began < 5
    assert len(raised) == 1
    assert all(gone(pid) for pid in processes)
    assert not pool.ready
    with pytest.raises(WorkerDied, match="stopping"):
        pool.plan(FIELD, problem())


def test_workers_that_cannot_start_are_tried_again_slowly():
    pool = WorkerPool(Settings(workers=2), program="tests.api.worker_programs:BROKEN")
    pool.start()
    try:
        wait_for(lambda: pool._crew._failures >= 2)
        assert not pool.ready
        assert not pool.wait_ready(0.01)
        assert pool._crew._started <= 4
    finally:
        pool.close()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_workers_end_when_the_service_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        "import sys, time\n"
        "from api.settings import Settings\n"
        "from api.workers import WorkerPool\n"
        "from pathlib import Path\n"
        "from planner.problem import PlanningProblem\n"
        "import threading\n"
        "if __name__ == '__main__':\n"
        f"    pool = WorkerPool(Settings(workers=2), program={PROGRAM!r})\n"
        "    pool.start()\n"
        "    assert pool.wait_ready(30)\n"
        "    hang = PlanningProblem((0, 0), (1, 1), 0.2, deadline=30)\n"
        "    threading.Thread(target=pool.plan, args=(Path('f_1.zarr'), hang),"
        " kwargs={'client_ref': 'hang at once'}, daemon=True).start()\n"
        "    time.sleep(0.3)\n"
        "    print(*[w.process.pid for w in pool._crew._workers], flush=True)\n"
        "    time.sleep(60)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": ROOT},
    )
    try:
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(workers) == 2
        assert not any(gone(pid) for pid in workers)
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()
    wait_for(lambda: all(gone(pid) for pid in workers), timeout=5)
