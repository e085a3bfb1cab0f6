"""Files of the store: whole or not there, never half; also what a worker reads and writes."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from api.store_records import StorageFull, StoreUnavailable
from localization.heading_field import HeadingField
from localization.io.field_file import load_field, save_field
from localization.uncertainty_field import UncertaintyField
from maps.errors import MapError
from maps.io.bundle import pack_world, unpack_world
from maps.world import World

_META = "meta_json"


@contextmanager
def disk(action: str) -> Iterator[None]:
    """Turn errors of the operating system into the store's.

    Raises
    ------
    StorageFull
        If the disk or a quota is full.
    StoreUnavailable
        For any other error.
    """
    try:
        yield
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT}:
            raise StorageFull(f"The disk is full: could not {action}. Free some space.") from error
        raise StoreUnavailable(f"Could not {action}: {error.strerror or error}.") from error


def write_world(world: World, path: Path) -> int:
    """Write a world to one file, on the disk before it is visible; returns its bytes.

    Raises
    ------
    StorageFull, StoreUnavailable
        If the disk refuses; nothing is left behind.
    """
    data = world_bytes(world)
    write_whole(data, path)
    return len(data)


def world_bytes(world: World) -> bytes:
    """A world as a compressed numpy archive."""
    meta, arrays = pack_world(world)
    buffer = io.BytesIO()
    parts: dict[str, Any] = {_META: np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8), **arrays}
    np.savez_compressed(buffer, **parts)
    return buffer.getvalue()


def write_whole(data: bytes, path: Path) -> None:
    """Write bytes so that the path holds all of them or what was there before, even after a power cut.

    Raises
    ------
    StorageFull, StoreUnavailable
        If the disk refuses; nothing is left behind.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    with disk(f"write '{path}'"):
        try:
            with temporary.open("xb") as handle:
                handle.write(data)
                handle.flush()
                os.fsync(handle.fileno())
            temporary.replace(path)
            sync_folder(path.parent)
        finally:
            temporary.unlink(missing_ok=True)


def read_world(path: Path) -> World:
    """Read what :func:`write_world` wrote.

    Raises
    ------
    StoreUnavailable
        If the file is missing or damaged.
    """
    try:
        with disk(f"read '{path}'"):
            data = path.read_bytes()
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        meta = json.loads(arrays.pop(_META).tobytes())
        return unpack_world(meta, arrays)
    except (KeyError, ValueError, BadZipFile, EOFError, MapError) as error:
        raise StoreUnavailable(f"The stored map '{path}' is damaged: {error}. Upload it again.") from error


def write_field(field: UncertaintyField | HeadingField, path: Path) -> tuple[int, str]:
    """Write a field as a zarr group, on the disk before it is visible.

    Returns
    -------
    size
        Bytes.
    checksum
        SHA-256 over names and contents of its files.
    """
    save_field(field, path)
    return measure(path)


def read_field(path: Path) -> UncertaintyField | HeadingField:
    """Read what :func:`write_field` wrote; errors as :func:`localization.io.field_file.load_field`."""
    return load_field(path)


def measure(folder: Path) -> tuple[int, str]:
    """Bytes of a folder and SHA-256 (hex) over the names and contents of its files.

    Raises
    ------
    StoreUnavailable
        If a file cannot be read.
    """
    size, total = 0, hashlib.sha256()
    with disk(f"read '{folder}'"):
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            data = path.read_bytes()
            size += len(data)
            total.update(path.relative_to(folder).as_posix().encode() + b"\0")
            total.update(hashlib.sha256(data).digest())
    return size, total.hexdigest()


def move(source: Path, target: Path) -> None:
    """Rename within one file system, durably; a folder that stands at the target goes.

    Raises
    ------
    StorageFull, StoreUnavailable
        If the disk refuses.
    """
    with disk(f"move '{source}' to '{target}'"):
        if target.is_dir():
            shutil.rmtree(target)
        source.rename(target)
        sync_folder(target.parent)
        sync_folder(source.parent)


def remove(path: Path) -> None:
    """Remove a file or folder; what is not there is fine.

    Raises
    ------
    StoreUnavailable
        If the disk refuses.
    """
    with disk(f"remove '{path}'"):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def remove_all_but(folder: Path, keep: set[str]) -> None:
    """Remove everything in a folder whose name is not to be kept: what a crash left behind."""
    with disk(f"clean '{folder}'"):
        for path in folder.iterdir():
            if path.name not in keep:
                remove(path)


def sync_folder(folder: Path) -> None:
    """Bring renames within a folder to the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
