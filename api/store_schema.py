"""Tables of the store, and the engine that opens them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event

from api.store_records import StoreUnavailable

#: Raised when a table changes; a newer database is refused rather than misread.
SCHEMA_VERSION = 3
BUSY_TIMEOUT_S = 5

#: Version -> what leads to the next one. Version 1 knew field format 1 and the best triplet only, version 2
#: fields of one heading.
_STEPS: dict[int, tuple[str, ...]] = {
    1: (
        "ALTER TABLE fields ADD COLUMN estimator VARCHAR NOT NULL DEFAULT 'best_triplet'",
        "ALTER TABLE fields ADD COLUMN criterion VARCHAR NOT NULL DEFAULT 'area'",
        "ALTER TABLE fields ADD COLUMN field_format INTEGER NOT NULL DEFAULT 1",
    ),
    2: ("ALTER TABLE fields ADD COLUMN headings INTEGER NOT NULL DEFAULT 1",),
}

metadata = sa.MetaData()

info = sa.Table("info", metadata, sa.Column("schema_version", sa.Integer, primary_key=True))

maps = sa.Table(
    "maps",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("name", sa.String, nullable=False),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("bounds", sa.JSON, nullable=False),
    sa.Column("resolution", sa.Float),
    sa.Column("shape", sa.JSON),
    sa.Column("n_landmarks", sa.Integer, nullable=False),
    sa.Column("free_area", sa.Float, nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("parent", sa.String),
    sa.Column("created", sa.Float, nullable=False),
)

#: Labels; each stands for the map that was stored under it last.
names = sa.Table(
    "names",
    metadata,
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("map_id", sa.String, sa.ForeignKey("maps.id", ondelete="CASCADE"), nullable=False),
)

fields = sa.Table(
    "fields",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("map_id", sa.String, sa.ForeignKey("maps.id"), nullable=False, index=True),
    sa.Column("sensor_values", sa.JSON, nullable=False),
    sa.Column("frame", sa.JSON, nullable=False),
    sa.Column("heading", sa.Float, nullable=False),
    sa.Column("headings", sa.Integer, nullable=False),
    sa.Column("estimator", sa.String, nullable=False),
    sa.Column("criterion", sa.String, nullable=False),
    sa.Column("field_format", sa.Integer, nullable=False),
    sa.Column("status", sa.String, nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("checksum", sa.String),
    sa.Column("job", sa.String),
    sa.Column("error", sa.String),
    sa.Column("created", sa.Float, nullable=False),
    sa.Column("ended", sa.Float),
)

#: Jobs outlive their field: no foreign key.
jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("field_id", sa.String, nullable=False, index=True),
    sa.Column("status", sa.String, nullable=False, index=True),
    sa.Column("done", sa.Integer, nullable=False),
    sa.Column("total", sa.Integer, nullable=False),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("error", sa.String),
    sa.Column("created", sa.Float, nullable=False),
    sa.Column("started", sa.Float),
    sa.Column("ended", sa.Float),
)

plans = sa.Table(
    "plans",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("field_id", sa.String, nullable=False),
    sa.Column("answer", sa.LargeBinary, nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("created", sa.Float, nullable=False, index=True),
)


def open_engine(path: Path) -> sa.Engine:
    """Engine on a SQLite file, with every table there; one of an earlier version is brought to this one.

    WAL lets readers go on while one writes; ``synchronous=FULL`` keeps a commit through a power cut.

    Raises
    ------
    StoreUnavailable
        If the database was written by a newer version.
    """
    engine = sa.create_engine(
        sa.URL.create("sqlite", database=str(path)),
        connect_args={"timeout": BUSY_TIMEOUT_S},
        pool_size=8,
        max_overflow=56,
        pool_timeout=BUSY_TIMEOUT_S,
    )

    @event.listens_for(engine, "connect")
    def _connect(connection: Any, _record: Any) -> None:
        connection.isolation_level = None  # the driver's own BEGIN comes too late for IMMEDIATE
        for pragma in (
            "journal_mode=WAL",
            "synchronous=FULL",
            f"busy_timeout={BUSY_TIMEOUT_S * 1000}",
            "foreign_keys=ON",
        ):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def _begin(connection: sa.Connection) -> None:
        write = connection.get_execution_options().get("write", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if write else "BEGIN")

    with engine.execution_options(write=True).begin() as connection:
        metadata.create_all(connection)
        found = connection.execute(sa.select(info.c.schema_version)).scalar()
        if found is None:
            connection.execute(sa.insert(info).values(schema_version=SCHEMA_VERSION))
        elif found > SCHEMA_VERSION:
            raise StoreUnavailable(
                f"The data folder was written by a newer version (schema {found}, this program knows "
                f"{SCHEMA_VERSION}); install that version or use another folder."
            )
        else:
            for version in range(found, SCHEMA_VERSION):
                for statement in _STEPS[version]:
                    connection.exec_driver_sql(statement)
            connection.execute(sa.update(info).values(schema_version=SCHEMA_VERSION))
    return engine
