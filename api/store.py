"""The store: maps, fields, jobs and plans of one data folder. The only door to files and SQL.

What was acknowledged survives ``kill -9`` and a power cut: files are written aside, brought to the disk
and renamed, and only then does a row name them; what no row names is removed at the next start.
"""

from __future__ import annotations

import zlib
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects.sqlite import insert as upsert

from api import store_schema as db
from api.codec import to_json_bytes
from api.settings import Settings
from api.store_base import DAY_S, PLANS_KEPT_S, now
from api.store_fields import FieldShelf
from api.store_records import (
    FieldNotReady,
    FieldRecord,
    FieldStatus,
    InUse,
    JobRecord,
    JobStatus,
    MapRecord,
    NotFound,
    PlanRecord,
    StorageFull,
    StoreError,
    StoreUnavailable,
    VersionChanged,
)

__all__ = [
    "FieldNotReady",
    "FieldRecord",
    "FieldStatus",
    "InUse",
    "JobRecord",
    "JobStatus",
    "MapRecord",
    "NotFound",
    "PlanRecord",
    "StorageFull",
    "Store",
    "StoreError",
    "StoreUnavailable",
    "VersionChanged",
]


class Store(FieldShelf):
    """An opened data folder; see :class:`api.store_base.StoreBase` for its parameter and errors.

    Safe among threads; one process at a time.
    """

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        try:
            self._clean_maps()
            self._recover_fields()
        except BaseException:
            self.close()
            raise

    def add_plan(self, answer: dict[str, Any]) -> PlanRecord:
        """Keep an answer for a week, or until too many newer ones came.

        Parameters
        ----------
        answer
            Of :func:`api.codec.plan_to_json`; its id is a hash of the rest, so that a stored plan never
            changes.

        Raises
        ------
        StorageFull, StoreUnavailable
            If it cannot be kept.
        """
        plan_id, field_id, created = answer["plan"], answer["field"], now()
        body = to_json_bytes(answer)
        blob = zlib.compress(body, 1)
        row = {"id": plan_id, "field_id": field_id, "answer": blob, "size": len(blob), "created": created}
        with self._write() as connection:
            self._drop_plans(connection)
            self._require_room(connection, len(blob), "a plan")
            statement = upsert(db.plans).values(row)
            connection.execute(statement.on_conflict_do_update([db.plans.c.id], set_={"created": created}))
        return PlanRecord(plan_id, field_id, body, created)

    def _drop_plans(self, connection: sa.Connection) -> None:
        plans = db.plans.c
        connection.execute(sa.delete(db.plans).where(plans.created < now() - PLANS_KEPT_S))
        # The newest stay, one place is left for the plan to come.
        newest = (
            sa.select(plans.id).order_by(plans.created.desc()).limit(-1).offset(self._settings.max_plans - 1)
        )
        connection.execute(sa.delete(db.plans).where(plans.id.in_(newest)))

    def plan(self, plan_id: str) -> PlanRecord:
        """A stored answer.

        Raises
        ------
        NotFound
            If there is none (any more).
        """
        query = sa.select(db.plans).where(
            db.plans.c.id == plan_id, db.plans.c.created >= now() - PLANS_KEPT_S
        )
        with self._read() as connection:
            row = connection.execute(query).first()
        if row is None:
            days = PLANS_KEPT_S / DAY_S
            raise NotFound(f"There is no plan '{plan_id[:100]}'; plans are kept for {days:g} days.")
        return PlanRecord(row.id, row.field_id, zlib.decompress(row.answer), row.created)
