"""The program of the service's workers: fields and uploads here, questions in their own module."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from api import finding, worker_places, worker_questions
from api.codec import parse_json
from api.settings import LimitExceeded
from api.store_files import read_world, write_field
from api.worker_main import Channel, Program
from api.worker_orders import FieldOrder, UploadLimits
from localization import field_builder
from localization.errors import LocalizationError
from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField
from maps.errors import MapTooLarge
from maps.io.landmark_files import parse_landmarks
from maps.io.map_server import grid_from_image, parse_map_yaml
from maps.io.world_file import world_from_geojson
from maps.landmarks import LandmarkSet
from maps.world import World

T = TypeVar("T")
_LOW_PRIORITY = 10


def build(channel: Channel, order: FieldOrder) -> tuple[int, str]:
    """Compute a field and write it; returns its bytes and checksum.

    Raises
    ------
    SurepathError
        As of :func:`localization.field_builder.build_field`.
    LocalizationError
        If the result is not what was ordered: the map or the program changed meanwhile.
    """
    world = read_world(order.map_path)
    common: dict[str, Any] = {
        "resolution": order.resolution,
        "method": order.method,
        "threads": order.threads,
        "progress": channel.progress,
        "cancelled": channel.cancelled,
        "max_cells": order.max_cells,
    }

    def work() -> UncertaintyField | HeadingField:
        if order.headings > 1:
            return field_builder.build_heading_field(world, order.sensor, headings=order.headings, **common)
        return field_builder.build_field(world, order.sensor, heading=order.heading, **common)

    field = _in_background(work)
    if (made := "f_" + field.content_hash()) != order.field_id:
        raise LocalizationError(
            f"Field '{made}' was computed, '{order.field_id}' was ordered; order it again."
        )
    return write_field(field, order.target)


def _in_background(work: Callable[[], T]) -> T:
    """Do work, with the threads that it starts, when nothing more urgent wants the processor."""

    def lower() -> None:
        if (
            sys.platform == "linux"
        ):  # elsewhere priority belongs to whole processes and cannot be raised again
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOW_PRIORITY)

    with ThreadPoolExecutor(1, initializer=lower) as pool:
        return pool.submit(work).result()


def parse(channel: Channel, parts: dict[str, Any], limits: UploadLimits) -> World:  # noqa: ARG001
    """Decode an upload (the fields of :class:`api.uploads.Upload`) under a limit of memory.

    Raises
    ------
    DocumentError, MapError
        If it is not a map.
    MapTooLarge, LimitExceeded
        If it is too large, or wants too much memory.
    """
    with _memory_limit(limits.memory):
        try:
            world = _world_of(parts)
        except MemoryError:
            raise MapTooLarge(
                f"Decoding the map wants more than {limits.memory} bytes of memory "
                "(SUREPATH_MAX_PARSE_BYTES); send a smaller one."
            ) from None
    cells = getattr(world.floor, "free", None)
    for size, limit, what, setting in (
        (0 if cells is None else cells.size, limits.pixels, "pixels", "SUREPATH_MAX_IMAGE_PIXELS"),
        (len(world.landmarks), limits.landmarks, "landmarks", "SUREPATH_MAX_LANDMARKS"),
    ):
        if size > limit:
            raise LimitExceeded(
                f"The map has {size} {what}, the limit is {limit}.",
                limit=limit,
                requested=size,
                setting=setting,
            )
    return world


def _world_of(parts: dict[str, Any]) -> World:
    name = parts["name"]
    if parts["world"] is not None:
        return world_from_geojson(parse_json(parts["world"], what="map"), name=name)
    landmarks = LandmarkSet.empty()
    if parts["landmarks"] is not None:
        landmarks = parse_landmarks(parts["landmarks"], format=parts["landmark_format"])
    meta = parse_map_yaml(parts["meta"])
    floor = grid_from_image(
        parts["image"],
        meta,
        unknown_is_free=parts["unknown_is_free"],
        unknown_is_opaque=parts["unknown_is_opaque"],
    )
    return World(name or Path(meta.image).stem, floor, landmarks)


@contextmanager
def _memory_limit(extra: int) -> Iterator[None]:
    """Let this process take at most ``extra`` bytes more than it has; elsewhere than on Linux: no limit."""
    if sys.platform != "linux":
        yield
        return
    import resource  # noqa: PLC0415  (Unix only)

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    wanted = pages * resource.getpagesize() + extra
    if before[1] != resource.RLIM_INFINITY:
        wanted = min(wanted, before[1])
    resource.setrlimit(resource.RLIMIT_AS, (wanted, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


#: Compiles, or loads from the cache, everything that a task will run.
PROGRAM = Program(
    (field_builder.warm_up, finding.warm_up, worker_questions.warm_up, worker_places.warm_up),
    {"build": build, "parse": parse, **worker_questions.TASKS, **worker_places.PLACE_TASKS},
)
