"""The pool of worker processes: fields, plans and uploads are computed there, never in the service.

One worker is always kept for plans and uploads, so that computing fields never blocks them. A worker that
dies, or hangs, is replaced.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from api.codec_plan import FieldLabel, plan_to_json
from api.place_orders import PLACE_TASK_OF, PlaceOrder
from api.questions import NOTHING_MORE, Found, More
from api.settings import Settings
from api.worker_crew import Overloaded, Turn, WorkerCrew
from api.worker_orders import TASK_OF, FieldOrder, Loaded, Order, UploadLimits
from api.worker_process import DeadlineExceeded, TaskCrashed, TimedOut, WorkerDied, WorkerError
from maps.errors import MapTooLarge, SurepathError
from maps.world import World
from planner.problem import PlanningProblem
from planner.result import PlanResult, PlanStatus

if TYPE_CHECKING:
    from api.uploads import Upload

__all__ = ["FieldOrder", "Overloaded", "TaskCrashed", "WorkerDied", "WorkerError", "WorkerPool"]

PROGRAM = "api.worker_tasks:PROGRAM"
#: So long after the deadline of a plan its last report becomes the answer, s.
HARD_AFTER_S = 0.25
#: Reading a field goes on for so long after the request that wanted it is gone, s.
LOAD_PATIENCE_S = 120.0


class WorkerPool:
    """Computes fields, plans and uploads in worker processes.

    Parameters
    ----------
    settings
        Number of workers, length of the queue, limits of uploads.
    program
        What the workers run, as ``module:NAME`` of a :class:`api.worker_main.Program`.
    """

    def __init__(self, settings: Settings, *, program: str = PROGRAM) -> None:
        self._settings = settings
        self._crew = WorkerCrew(settings.workers, settings.max_queue, program)

    @property
    def build_slots(self) -> int:
        """How many fields may be computed at a time."""
        return self._crew.build_slots

    @property
    def ready(self) -> bool:
        """Whether all workers were warm once, and one is there now."""
        return self._crew.ready

    def start(self) -> None:
        """Start two workers; the others follow when the kernels are compiled. Returns at once."""
        self._crew.start()

    def wait_ready(self, timeout: float) -> bool:
        """Wait until :attr:`ready`; False if it takes longer than ``timeout`` s."""
        return self._crew.wait_ready(timeout)

    def close(self) -> None:
        """End every worker at once; calls that wait for one raise WorkerDied."""
        self._crew.close()

    def plan(
        self,
        field_path: Path,
        problem: PlanningProblem,
        *,
        more: More = NOTHING_MORE,
        client_ref: str | None = None,
        warnings: Sequence[str] = (),
    ) -> dict[str, Any]:
        """Answer of ``POST /v1/plans``, at most 0.5 s after the problem's deadline.

        Waiting for a worker and reading the field count. When a worker is 0.25 s late, its last report is
        the answer, with a warning; if it does not end by itself soon, it is killed.

        Parameters
        ----------
        field_path
            Folder of a ready field.
        problem, more
            The question, and what is asked for beside one route.
        client_ref, warnings
            As of :func:`api.codec.plan_to_json`.

        Raises
        ------
        PlannerError
            If the question is wrong.
        FieldFormatError
            If the field cannot be read.
        Overloaded
            If no worker got free, or the field could not be read, before the deadline.
        WorkerDied
            If the worker died before it had an answer.
        """
        ends_at = time.monotonic() + problem.deadline
        with self._crew.turn(ends_at, prefer=field_path.name) as turn:
            label = self._load(turn, field_path, ends_at)
            reports: list[Found] = []
            arguments = {
                "path": field_path,
                "problem": problem,
                "more": more,
                "ends_at": ends_at,
                "client_ref": client_ref,
                "warnings": tuple(warnings),
            }
            try:
                answer: dict[str, Any] = turn.worker.ask(
                    "plan", arguments, ends_at=ends_at + HARD_AFTER_S, on_report=reports.append
                )
            except TimedOut:
                # It may be about to end by itself: cheaper than a new process.
                turn.detached = True
                said = "The planner was stopped after the deadline."
                nothing = PlanResult(PlanStatus.TIMEOUT, None, None, None, "none")
                last = reports[-1] if reports else Found.of(nothing)
            except WorkerDied:
                turn.spoilt = True
                if not reports or not reports[-1].routes:
                    raise
                said = "The planner ended unexpectedly."
                last = reports[-1]
            else:
                return answer
        result = dataclasses.replace(last.result, warnings=(*last.result.warnings, said))
        last = dataclasses.replace(last, result=result)
        return plan_to_json(last, label, problem=problem, more=more, client_ref=client_ref, warnings=warnings)

    def ask(self, field_path: Path, order: Order) -> dict[str, Any]:
        """Answer of a question about many places, or of a simulation, at most 0.5 s after its deadline.

        Waiting for a worker and reading the field count. The worker answers by the deadline with what it has
        then; one that is 0.25 s late is left alone, or killed if it does not end by itself soon.

        Parameters
        ----------
        field_path
            Folder of a ready field.
        order
            The question.

        Raises
        ------
        PlannerError, LocalizationError
            If the question is wrong.
        FieldFormatError
            If the field cannot be read.
        Overloaded
            If no worker got free, or the field could not be read, before the deadline.
        DeadlineExceeded
            If there was nothing to answer by the deadline.
        WorkerDied
            If the worker died before it had an answer.
        """
        ends_at = time.monotonic() + order.deadline
        with self._crew.turn(ends_at, prefer=field_path.name) as turn:
            self._load(turn, field_path, ends_at)
            arguments = {"path": field_path, "order": order, "ends_at": ends_at}
            try:
                answer: dict[str, Any] = turn.worker.ask(
                    TASK_OF[type(order)], arguments, ends_at=ends_at + HARD_AFTER_S
                )
            except TimedOut:
                turn.detached = True
                raise DeadlineExceeded(
                    f"Nothing was ready within {order.deadline:g} s; ask for less, or give more time."
                ) from None
            return answer

    def ask_map(self, map_path: Path, order: PlaceOrder) -> dict[str, Any]:
        """Answer of a question about one place of a map, for which no field is needed.

        Parameters
        ----------
        map_path
            File of a map.
        order
            The question. A worker that is 0.25 s past its deadline is left alone, or killed if it does not
            end by itself soon.

        Raises
        ------
        LocalizationError
            If the question is wrong.
        StoreUnavailable
            If the map cannot be read.
        Overloaded
            If no worker got free before the deadline.
        DeadlineExceeded
            If there was no answer by the deadline.
        WorkerDied
            If the worker died before it had an answer.
        """
        ends_at = time.monotonic() + order.deadline
        with self._crew.turn(ends_at, prefer=map_path.name) as turn:
            arguments = {"path": map_path, "order": order}
            try:
                answer: dict[str, Any] = turn.worker.ask(
                    PLACE_TASK_OF[type(order)], arguments, ends_at=ends_at + HARD_AFTER_S
                )
            except TimedOut:
                turn.detached = True
                raise DeadlineExceeded(
                    f"Nothing was ready within {order.deadline:g} s; ask for less, or give more time."
                ) from None
            turn.worker.loaded |= {map_path.name}
            return answer

    def _load(self, turn: Turn, path: Path, ends_at: float) -> FieldLabel:
        arguments = {"path": path, "keep_bytes": self._settings.cache_bytes}
        try:
            loaded: Loaded = turn.worker.ask("load", arguments, ends_at=ends_at)
        except TimedOut:
            # Reading goes on, so that the next plan finds the field there.
            turn.detached = True
            turn.patience = LOAD_PATIENCE_S
            raise Overloaded(
                "The field is still being read by the planner; try again, or with a longer deadline."
            ) from None
        turn.worker.loaded = loaded.kept
        return loaded.label

    def prefetch(self, field_path: Path) -> None:
        """Have an idle worker, if there is one, make a field ready for plans to come. Returns at once."""
        now = time.monotonic()
        with suppress(SurepathError), self._crew.turn(now, prefer=field_path.name) as turn:
            self._load(turn, field_path, now)

    def parse(self, upload: Upload) -> World:
        """Decode an upload, in a worker and under a limit of memory.

        Raises
        ------
        DocumentError, MapError, LimitExceeded
            If it is not a map, or too large.
        MapTooLarge
            Also if decoding takes too long or kills the worker.
        Overloaded
            If no worker got free.
        """
        limits = UploadLimits(
            pixels=self._settings.max_image_pixels,
            landmarks=self._settings.max_landmarks,
            memory=self._settings.max_parse_bytes,
        )
        parts = {f.name: getattr(upload, f.name) for f in dataclasses.fields(upload)}
        ends_at = time.monotonic() + self._settings.max_parse_s
        with self._crew.turn(ends_at) as turn:
            try:
                world: World = turn.worker.ask("parse", {"parts": parts, "limits": limits}, ends_at=ends_at)
            except (TimedOut, WorkerDied) as error:
                turn.spoilt = True
                if self._crew.closed:
                    raise
                raise MapTooLarge(
                    f"The map could not be decoded within {self._settings.max_parse_s:g} s "
                    "(SUREPATH_MAX_PARSE_S) and the memory allowed; send a smaller one."
                ) from error
            return world

    def build(
        self,
        order: FieldOrder,
        *,
        on_progress: Callable[[int, int], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> tuple[int, str]:
        """Compute a field into a folder; returns its bytes and checksum.

        Waits for a free worker as long as it takes.

        Raises
        ------
        Cancelled
            If ``cancelled()`` said so before it was done.
        WorkerDied
            If the worker died, or had to be killed because it did not stop.
        SurepathError
            Whatever :func:`localization.field_builder.build_field` raises.
        """
        with self._crew.turn(None, build=True, cancelled=cancelled) as turn:
            result: tuple[int, str] = turn.worker.ask(
                "build", {"order": order}, on_progress=on_progress, cancelled=cancelled
            )
            return result
