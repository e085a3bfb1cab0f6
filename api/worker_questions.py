"""Questions on a field, inside a worker process: it is loaded once, and asked many times."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from api.codec_plan import FieldLabel, plan_to_json
from api.finding import find
from api.questions import More
from api.store_files import read_field
from api.worker_main import Channel
from api.worker_orders import Loaded
from planner.context import PlanningContext
from planner.problem import MIN_DEADLINE_S, PlanningProblem

_FIELDS = "fields"
_ENCODING_S = 0.15
#: What a context takes for each cell before anything is planned on it, bytes.
_CONTEXT_BYTES_PER_CELL = 100
#: Graphs, and as much again for costs to go, that plans leave in a context: some dozens on a small field.
_CACHE_BYTES_PER_CELL = 200
_CACHE_BYTES = (32 * 2**20, 256 * 2**20)


@dataclass(frozen=True, slots=True)
class _Ready:
    context: PlanningContext
    label: FieldLabel

    size: int


def load(channel: Channel, path: Path, keep_bytes: int) -> Loaded:
    """Make a field ready for planning, and forget those that were not used for longest.

    Raises
    ------
    FieldFormatError
        If there is no readable field.
    """
    kept: dict[str, _Ready] = channel.memory.setdefault(_FIELDS, {})
    ready = kept.pop(path.name, None)
    if ready is None:
        field = read_field(path)
        cells = field.free.size
        cache = min(max(_CACHE_BYTES[0], cells * _CACHE_BYTES_PER_CELL), _CACHE_BYTES[1])
        size = cells * _CONTEXT_BYTES_PER_CELL + 2 * cache
        ready = _Ready(PlanningContext(field, cache_bytes=cache), FieldLabel.of(field), size)
    kept[path.name] = ready  # the newest is last
    while len(kept) > 1 and sum(r.size for r in kept.values()) > keep_bytes:
        del kept[next(iter(kept))]
    return Loaded(ready.label, frozenset(kept))


def plan(
    channel: Channel,
    path: Path,
    problem: PlanningProblem,
    more: More,
    ends_at: float,
    client_ref: str | None,
    warnings: tuple[str, ...],
) -> dict[str, Any]:
    """Plan on a field that was loaded before; the answer of ``POST /v1/plans``.

    Reports each result that is better than the one before.

    Raises
    ------
    PlannerError
        If the question is wrong.
    """
    ready: _Ready = channel.memory[_FIELDS][path.name]
    # The request in the answer stays as it was asked.
    hurried = replace(problem, deadline=min(problem.deadline, _left(ends_at)))
    found = find(hurried, ready.context, more, report=channel.report)
    return plan_to_json(
        found, ready.label, problem=problem, more=more, client_ref=client_ref, warnings=warnings
    )


def _left(ends_at: float) -> float:
    """Seconds for a question: what waiting and loading took is gone, and encoding takes its share."""
    left = ends_at - time.monotonic()
    return max(MIN_DEADLINE_S, left - min(_ENCODING_S, 0.1 * left))


TASKS: dict[str, Callable[..., Any]] = {"load": load, "plan": plan}
