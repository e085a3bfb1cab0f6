"""Questions about one place of a map, inside a worker process: the map is read once, and asked many times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from api.codec_ranking import choice_to_json, ranking_to_json
from api.place_orders import RankingOrder
from api.store_files import read_world
from api.worker_main import Channel
from localization.errors import LocalizationError
from localization.ranking import TripletStatus, explain_place, one_triplet, triplet_status
from localization.sensors import LASER
from localization.triplets import MAX_RANKED
from maps.io.site import bundled_site
from maps.world import World

_WORLDS = "worlds"
#: Maps kept in memory; one of 64 M cells takes 200 MB.
_KEPT = 3


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
    LocalizationError
        If the place, the count or the triplet makes no sense.
    """
    world = world_of(channel, path)
    count = order.count if order.triplet is None else MAX_RANKED
    report = explain_place(
        world, order.sensor, order.place, heading=order.heading, count=count, criterion=order.criterion
    )
    if order.triplet is None:
        return {**ranking_to_json(world, order.sensor, report, order.criterion), "asked": None}
    three = indices_of(world, order.triplet)
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


def indices_of(world: World, names: tuple[str, ...]) -> tuple[int, int, int]:
    """Indices of three landmarks by their ids.

    Raises
    ------
    LocalizationError
        If one is not there.
    """
    known = {name: i for i, name in enumerate(world.landmarks.ids)}
    for name in names:
        if name not in known:
            raise LocalizationError(f"There is no landmark '{name[:40]}' on this map.")
    a, b, c = (known[name] for name in names)
    return a, b, c


PLACE_TASKS: dict[str, Callable[..., Any]] = {"rank": rank}


def warm_up() -> None:
    """Compile or load what questions about a place need."""
    explain_place(bundled_site("warehouse"), LASER, (30.0, 20.0), count=3)
