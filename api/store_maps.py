"""Maps in the store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects.sqlite import insert as upsert

from api import store_schema as db
from api.store_base import StoreBase, now, plain
from api.store_files import read_world, remove, remove_all_but, world_bytes, write_whole
from api.store_records import FieldStatus, InUse, MapRecord, NotFound, VersionChanged
from maps.grid import OccupancyGrid
from maps.world import World

MAX_NAME = 200


class MapShelf(StoreBase):
    """Map versions by content, and the names that stand for them."""

    def map_path(self, map_id: str) -> Path:
        """File of a map, for a worker that reads it with :func:`api.store_files.read_world`."""
        return self._maps_dir / f"{map_id}.npz"

    def add_map(
        self,
        world: World,
        *,
        name: str | None = None,
        parent: str | None = None,
        only_if: str | None = None,
    ) -> tuple[MapRecord, bool]:
        """Keep a map, and let a name (default: the world's own) stand for it from now on.

        Parameters
        ----------
        world
            What to keep.
        name
            Its label.
        parent
            Id of the version that it was made from.
        only_if
            Id of the version that the name must stand for until now.

        Returns
        -------
        record
            What is stored.
        created
            False if the same content was there before.

        Raises
        ------
        VersionChanged
            If the name stands for another version; nothing changes then.
        StorageFull, StoreUnavailable
            If it cannot be kept; nothing changes then.
        """
        label = (name or world.name or "map")[:MAX_NAME]
        map_id = "m_" + world.content_hash()
        data = world_bytes(world.renamed(label))
        with self._lock:
            with self._read() as connection:
                if only_if is not None:
                    _require_newest(connection, label, only_if)
                known = connection.execute(sa.select(db.maps.c.id).where(db.maps.c.id == map_id)).scalar()
                if known is None:
                    self._require_room(connection, len(data), f"map '{label}'")
            if known is None:
                write_whole(data, self.map_path(map_id))
            with self._write() as connection:
                if known is None:
                    row = _row(world, map_id, label, len(data), parent)
                    connection.execute(sa.insert(db.maps).values(row))
                else:
                    renamed = sa.update(db.maps).where(db.maps.c.id == map_id).values(name=label)
                    connection.execute(renamed)
                statement = upsert(db.names).values(name=label, map_id=map_id)
                connection.execute(
                    statement.on_conflict_do_update([db.names.c.name], set_={"map_id": map_id})
                )
        return self.map(map_id), known is None

    def maps(self) -> list[MapRecord]:
        """Every map, oldest first."""
        with self._read() as connection:
            rows = connection.execute(sa.select(db.maps).order_by(db.maps.c.created, db.maps.c.id)).all()
        return [_record(row) for row in rows]

    def map(self, id_or_name: str) -> MapRecord:
        """A map by its id or by a name that stands for it.

        Raises
        ------
        NotFound
            If there is none.
        """
        named = sa.select(db.names.c.map_id).where(db.names.c.name == id_or_name).scalar_subquery()
        with self._read() as connection:
            for wanted in (id_or_name, named):
                row = connection.execute(sa.select(db.maps).where(db.maps.c.id == wanted)).first()
                if row is not None:
                    return _record(row)
        raise NotFound(f"There is no map '{id_or_name[:100]}'; GET /v1/maps lists them.")

    def world(self, map_id: str) -> World:
        """The world of a map, from memory if it was read lately.

        Raises
        ------
        NotFound
            If there is no such map.
        StoreUnavailable
            If its file cannot be read.
        """
        record = self.map(map_id)
        return self._worlds.get(record.id, lambda: read_world(self.map_path(record.id)))

    def delete_map(self, map_id: str) -> None:
        """Remove a map and its names; fields that failed go with it.

        Raises
        ------
        NotFound
            If there is no such map.
        InUse
            If a field of it is ready or being computed.
        """
        with self._lock:
            record = self.map(map_id)
            mine = db.fields.c.map_id == record.id
            with self._write() as connection:
                alive = sa.select(db.fields.c.id).where(mine, db.fields.c.status != FieldStatus.FAILED.value)
                if users := connection.execute(alive).scalars().all():
                    raise InUse(
                        f"Map '{record.name}' has {len(users)} fields: {', '.join(users[:5])}"
                        f"{' …' if len(users) > 5 else ''}. Delete them first."
                    )
                connection.execute(sa.delete(db.fields).where(mine))
                connection.execute(sa.delete(db.maps).where(db.maps.c.id == record.id))
            self._worlds.drop(record.id)
            remove(self.map_path(record.id))

    def _clean_maps(self) -> None:
        """Remove files that no row knows: uploads that were never acknowledged."""
        remove_all_but(self._maps_dir, {self.map_path(record.id).name for record in self.maps()})


def _require_newest(connection: sa.Connection, name: str, map_id: str) -> None:
    newest = connection.execute(sa.select(db.names.c.map_id).where(db.names.c.name == name)).scalar()
    if newest != map_id:
        raise VersionChanged(
            f"'{name}' stands for another version of the map by now; change that one, or give the new one "
            "another name.",
            newest=newest,
        )


def _row(world: World, map_id: str, name: str, size: int, parent: str | None) -> dict[str, Any]:
    floor = world.floor
    grid = floor if isinstance(floor, OccupancyGrid) else None
    return {
        "id": map_id,
        "name": name,
        "kind": "polygons" if grid is None else "grid",
        "bounds": list(world.bounds),
        "resolution": None if grid is None else grid.frame.resolution,
        "shape": None if grid is None else list(grid.frame.shape),
        "n_landmarks": len(world.landmarks),
        "free_area": floor.free_area_m2,
        "size": size,
        "parent": parent,
        "created": now(),
    }


def _record(row: Any) -> MapRecord:
    values = plain(row)
    for name in ("bounds", "shape"):  # JSON knows no tuples
        values[name] = None if values[name] is None else tuple(values[name])
    return MapRecord(**values)
