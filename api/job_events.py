"""The life of a job as events: what happened since the one that a client saw last."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from api.store_records import JobRecord, JobStatus

_ID = re.compile(r"(\d{1,6})-(\d{1,9})-(accepted|running|successful|failed|dismissed)\Z")


@dataclass(frozen=True, slots=True)
class Event:
    """One event; ``data`` is what goes out as JSON."""

    id: str
    kind: str
    data: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Seen:
    """How far somebody followed a job: a place in its life, and the id of the event there.

    Examples
    --------
    >>> Seen.of_id("1-37-running")
    Seen(attempt=1, done=37, status='running')
    >>> Seen.of_id("yesterday") is None
    True
    """

    attempt: int
    done: int
    status: str

    @classmethod
    def of_id(cls, text: str) -> Seen | None:
        """The place that an event's id names; None: it is none of ours."""
        match = _ID.match(text)
        return None if match is None else cls(int(match[1]), int(match[2]), match[3])

    @property
    def id(self) -> str:
        """The id of its event."""
        return f"{self.attempt}-{self.done}-{self.status}"

    @property
    def ended(self) -> bool:
        """Whether nothing will follow."""
        return JobStatus(self.status).ended


def place_of(job: JobRecord) -> Seen:
    """Where a job is in its life."""
    return Seen(job.attempts, job.done, job.status.value)


def events_since(seen: Seen | None, job: JobRecord, body: dict[str, Any]) -> Iterator[Event]:
    """What happened between a place in a job's life and now, without a gap.

    Parameters
    ----------
    seen
        The last place that was told; None: nothing was, and only the state now is.
    job, body
        The job now, and its JSON.

    Returns
    -------
    events
        ``tile`` for each one done meanwhile, then ``progress``, or ``done`` when it has ended. A job that
        began anew, after its worker died, is told from its first tile.
    """
    now = place_of(job)
    if seen == now:
        return
    if seen is not None:
        anew = seen.attempt != now.attempt or seen.done > now.done
        for number in range(1 if anew else seen.done + 1, now.done + 1):
            # Tiles are told while the job runs, whatever it is by now.
            place = Seen(now.attempt, number, JobStatus.RUNNING.value)
            yield Event(place.id, "tile", {"done": number, "total": job.total})
    yield Event(now.id, "done" if now.ended else "progress", body)
