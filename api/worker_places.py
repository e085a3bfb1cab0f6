"""Questions about one place of a map, inside a worker process: the map is read once, and asked many times."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

from api.codec_ranking import choice_to_json, ranking_to_json
from api.fix_clouds import simulated
from api.localizing import indices_of, localize
from api.place_orders import FixesOrder, LocalizeOrder, RankingOrder, SnapOrder
from api.store_files import read_world
from api.worker_main import Channel
from localization.method import Estimator
from localization.ranking import TripletStatus, explain_place, one_triplet, triplet_status
from localization.sensors import LASER, MAS97_CAMERA, Sensor
from localization.triplets import MAX_RANKED
from maps.arrays import FloatArray
from maps.clearance import ClearanceIndex
from maps.grid import GridFrame
from maps.io.site import bundled_site
from maps.se2 import wrap
from maps.world import World

_WORLDS = "worlds"
#: Maps kept in memory; one of 64 M cells takes 200 MB.
_KEPT = 3
_CLEARANCE = "clearance"
#: Cells of the grid on which the nearest place is looked for.
_SNAP_CELLS = 250_000


def world_of(channel: Channel, path: Path) -> World:
    """A map, from memory if it was asked for lately.

    Raises
    ------
    StoreUnavailable
        If its file cannot be read.
    """
    kept: dict[str, World] = channel.memory.setdefault(_WORLDS, {})
    world = kept.pop(path.name, None)
    if world is None:
        world = read_world(path)
    kept[path.name] = world  # the newest is last
    while len(kept) > _KEPT:
        del kept[next(iter(kept))]
    return world


def rank(channel: Channel, path: Path, order: RankingOrder) -> dict[str, Any]:
    """Triplets at a place, ranked; of a single triplet also its rank, or what keeps it out.

    Raises
    ------
    InvalidRequest, LocalizationError
        If the place, the count or the triplet makes no sense.
    """
    world = world_of(channel, path)
    count = order.count if order.triplet is None else MAX_RANKED
    report = explain_place(
        world, order.sensor, order.place, heading=order.heading, count=count, criterion=order.criterion
    )
    if order.triplet is None:
        return {**ranking_to_json(world, order.sensor, report, order.criterion), "asked": None}
    a, b, c = indices_of(world, order.triplet, "#/triplet").tolist()
    three = (a, b, c)
    status = triplet_status(world, order.sensor, order.place, three, heading=order.heading)
    choice = one_triplet(world, order.sensor, order.place, three, heading=order.heading)
    place = next((k for k, c in enumerate(report.ranked, start=1) if set(c.triplet) == set(three)), None)
    answer = ranking_to_json(world, order.sensor, report, order.criterion)
    for name in ("triplets", "missed"):
        answer[name] = answer[name][: order.count]
    answer["asked"] = {
        "triplet": list(order.triplet),
        "status": status.value,
        "rank": place,
        "of": None if report.counts is None else report.counts[TripletStatus.FIX],
        "blocking": {world.landmarks.ids[i]: s.value for i, s in report.blocking(three).items()},
        "fix": None if choice is None else choice_to_json(world, choice),
    }
    return answer


def snap(channel: Channel, path: Path, order: SnapOrder) -> dict[str, Any]:
    """The nearest place at which a robot fits; the answer of ``GET /v1/maps/{map}/snap``."""
    index, frame, clearance = _clearance_of(channel, path)
    found = index.nearest_free([order.place], order.radius, frame=frame, centre_clearance=clearance)
    answer: dict[str, Any] = {
        "asked": dict(zip(("x_m", "y_m"), order.place, strict=True)),
        "radius_m": order.radius,
        "pose": None,
        "moved_m": None,
        "clearance_m": None,
    }
    if found is not None:
        x, y = found[0].tolist()
        theta = None if order.heading is None else float(wrap(order.heading))
        answer["pose"] = {"x_m": x, "y_m": y, "theta_rad": theta}
        answer["moved_m"] = math.hypot(x - order.place[0], y - order.place[1])
        answer["clearance_m"] = float(index.distance(found)[0])
    return answer


def _clearance_of(channel: Channel, path: Path) -> tuple[ClearanceIndex, GridFrame, FloatArray]:
    """A map's boundary, and the clearance of a coarse grid, from memory if they were asked for lately."""
    kept: dict[str, tuple[ClearanceIndex, GridFrame, FloatArray]] = channel.memory.setdefault(_CLEARANCE, {})
    ready = kept.pop(path.name, None)
    if ready is None:
        world = world_of(channel, path)
        index = ClearanceIndex.from_world(world)
        x0, y0, x1, y1 = world.bounds
        frame = world.grid_frame(max(math.sqrt((x1 - x0) * (y1 - y0) / _SNAP_CELLS), 1e-3))
        ready = index, frame, index.at_centres(frame, threads=1)
    kept[path.name] = ready
    while len(kept) > _KEPT:
        del kept[next(iter(kept))]
    return ready


def fixes(channel: Channel, path: Path, order: FixesOrder) -> dict[str, Any]:
    """Simulated fixes; errors as of :func:`api.fix_clouds.simulated`."""
    return simulated(world_of(channel, path), order)


def locate(channel: Channel, path: Path, order: LocalizeOrder) -> dict[str, Any]:
    """A pose from measurements; errors as of :func:`api.localizing.localize`."""
    return localize(world_of(channel, path), order)


PLACE_TASKS: dict[str, Callable[..., Any]] = {"rank": rank, "snap": snap, "fixes": fixes, "localize": locate}


def warm_up() -> None:
    """Compile or load what questions about a place need."""
    world = bundled_site("warehouse")
    explain_place(world, LASER, (30.0, 20.0), count=3)
    ClearanceIndex.from_world(world).distance([(30.0, 20.0)])
    sensors: tuple[Sensor, ...] = (LASER, MAS97_CAMERA)
    estimators: tuple[Estimator, ...] = get_args(Estimator)
    for sensor, estimator in itertools.product(sensors, estimators):
        simulated(world, FixesOrder((30.0, 20.0), 0.0, sensor, estimator, None, 3, 0, 3, 1.0))
