"""Programs for workers under test: quick to start, and bad on request."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np

from api.codec_plan import FieldLabel
from api.questions import Found
from api.store_files import read_world, write_field
from api.worker_main import Program
from api.worker_orders import Loaded
from api.worker_process import WorkerError
from localization.errors import Cancelled, InvalidSensor
from maps.errors import MapFormatError
from planner.errors import GoalOccupied, InvalidProblem
from planner.result import Path as Path2D
from planner.result import PlanResult, PlanStatus, Route, RouteSummary, Trajectory
from tests.fields import synthetic_field


def nothing():
    pass


def result(n, route=True):
    made = PlanResult(
        PlanStatus.EXACT, flat_route() if route else None, None, float(n), "test", warnings=("first",)
    )
    return Found.of(made)


def flat_route():
    points = np.array([[0.0, 0.0], [1.0, 0.0]])
    none, zero = np.full(2, np.nan), np.zeros((2, 2))
    path = Path2D(
        points, points[:, 0], none, np.full((2, 3), np.nan), none, np.full((2, 3), -1), none, none, none, none
    )
    summary = RouteSummary(1.0, 1.0, 1.0, None, None, None, None, None, 1.0, 1.0)
    return Route(path, Trajectory(points[:, 0], points, zero, zero), summary)


def load(channel, path, keep_bytes):
    if path.name == "slow":
        time.sleep(0.6)
    if path.name == "broken":
        raise MapFormatError("not a field")
    loaded = channel.memory.setdefault("loaded", set())
    loaded.add(path.name)
    return Loaded(FieldLabel("m_1", "f_1", ("A", "B", "C")), frozenset(loaded))


def plan(channel, path, problem, more, ends_at, client_ref, warnings):
    assert path.name in channel.memory["loaded"]
    match client_ref:
        case "hang":
            channel.report(result(1))
            channel.report(result(2))
            time.sleep(3600)
        case "late":
            channel.report(result(1))
            time.sleep(problem.deadline + 0.4)
        case "hang at once":
            time.sleep(3600)
        case "die":
            channel.report(result(1, route=False))
            os.kill(os.getpid(), signal.SIGKILL)
        case "die late":
            channel.report(result(1))
            os.kill(os.getpid(), signal.SIGKILL)
        case "wrong":
            raise GoalOccupied("occupied", nearest_free=(1.0, 2.0))
        case "bug":
            return 1 // 0
        case "sleep":
            time.sleep(0.3)
    return {"grid_cost": 3, "pid": os.getpid(), "left": ends_at - time.monotonic()}


def matrix(channel, path, order, ends_at):
    assert path.name in channel.memory["loaded"]
    match order.client_ref:
        case "hang":
            time.sleep(3600)
        case "late":
            time.sleep(order.deadline + 0.4)
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "wrong":
            raise InvalidProblem("too many")
    return {"pid": os.getpid(), "left": ends_at - time.monotonic()}


def parse(channel, parts, limits):
    if parts["name"] == "memory":
        bytearray(10 * limits.memory)
    if parts["name"] == "hang":
        time.sleep(3600)
    if parts["name"] == "die":
        os._exit(9)
    return parts["name"]


class Odd(WorkerError):
    """Cannot be pickled back: its constructor wants more."""

    def __init__(self, *, needed):
        super().__init__("odd")


def build(channel, order):
    """Twenty steps, as fast or as slow as files beside the map say."""
    flags = order.map_path.parent.parent
    world = read_world(order.map_path)
    for step in range(21):
        if channel.cancelled():
            raise Cancelled("stopped")
        channel.progress(step, 20)
        if step == 10 and (flags / "die").exists():
            write_field(synthetic_field(world, order.resolution, sensor=order.sensor), order.target)
            os.kill(os.getpid(), signal.SIGKILL)
        if step == 10 and (flags / "refuse").exists():
            raise InvalidSensor("never")
        if step == 10 and (flags / "bug").exists():
            return 1 // 0
        if step == 10 and (flags / "odd").exists():
            raise Odd(needed=1)
        while step == 10 and (flags / "hold").exists():
            if channel.cancelled():
                raise Cancelled("stopped")
            time.sleep(0.01)
        while step == 10 and (flags / "deaf").exists():
            time.sleep(0.01)
    with Path(flags / "built").open("a") as log:
        log.write(order.field_id + "\n")
    return write_field(synthetic_field(world, order.resolution, sensor=order.sensor), order.target)


def broken_warm_up():
    raise RuntimeError("no kernels here")


TASKS = {"build": build, "load": load, "plan": plan, "matrix": matrix, "parse": parse}
PROGRAM = Program((nothing,), TASKS)
BROKEN = Program((nothing, broken_warm_up), TASKS)
