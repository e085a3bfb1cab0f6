"""The field file: a zarr v3 group that xarray opens and that carries its world and sensor."""

from __future__ import annotations

import math
import os
import shutil
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import zarr
import zarr.errors

from localization.errors import FieldFormatError, LocalizationError
from localization.heading_field import HeadingField
from localization.method import FieldMethod
from localization.sensors import sensor_from_dict, sensor_to_dict
from localization.uncertainty_field import FIELD_FORMAT, LAYERS, UncertaintyField
from maps.arrays import FloatArray, frozen
from maps.errors import MapError
from maps.grid import GridFrame
from maps.io.bundle import pack_world, unpack_world

CHUNK = 256
_MARK = "surepath_field"

#: name -> (dimensions, fill value, unit, description); over headings, `theta` comes third
_VARIABLES: dict[str, tuple[tuple[str, ...], float | int | bool, str, str]] = {
    "area95": (("y", "x"), math.nan, "m2", "area of the 95 % position ellipse of the best landmark triplet"),
    "covariance": (("y", "x", "component"), math.nan, "m2", "position covariance: xx, xy, yy"),
    "sigma_theta": (("y", "x"), math.nan, "rad", "standard deviation of the heading"),
    "triplet": (("y", "x", "corner"), -1, "1", "indices into `landmark`, ascending; -1: no fix"),
    "pan": (("y", "x"), math.nan, "rad", "optical axis relative to the pan head's zero"),
    "n_visible": (("y", "x"), 0, "1", "landmarks that the sensor can measure"),
    "validity": (("y", "x"), math.nan, "1", "predicted share of fixes inside the 95 % ellipse"),
    "free": (("y", "x"), False, "1", "whether the cell's centre lies in free space"),
}


@contextmanager
def _quiet() -> Iterator[None]:
    # zarr warns that strings and consolidated metadata are newer than its v3 specification;
    # xarray reads both.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def save_field(field: UncertaintyField | HeadingField, path: str | Path) -> None:
    """Write a field; the path holds either the whole new field or what was there before.

    Parameters
    ----------
    field
        What to write, with its world and sensor; at one heading or over headings.
    path
        Folder to create, usually named ``….zarr``. A field that is already there is replaced.

    Raises
    ------
    FieldFormatError
        If something that is not a field stands at the path, or its parent folder is missing.
    """
    target = Path(path)
    check_target(target)
    temporary = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    try:
        with _quiet():
            _write(field, temporary)
        _sync(temporary)
        if target.exists():
            old = target.with_name(f".{target.name}.{uuid.uuid4().hex}.old")
            target.rename(old)
            temporary.rename(target)
            shutil.rmtree(old)
        else:
            temporary.rename(target)
        _sync_folder(target.absolute().parent)
    except OSError as error:
        raise FieldFormatError(f"Could not write '{target}': {error.strerror or error}.") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_target(path: str | Path) -> None:
    """Raise :class:`~localization.errors.FieldFormatError` unless a field may be written at the path.

    Ask before a long computation, not after it.
    """
    target = Path(path)
    if target.exists() and not is_field(target):
        raise FieldFormatError(f"'{target}' exists and is not a field; choose another path or remove it.")
    if not target.absolute().parent.is_dir():
        raise FieldFormatError(f"The folder '{target.parent}' does not exist; create it first.")


def _write(field: UncertaintyField | HeadingField, folder: Path) -> None:
    slices = field.slices if isinstance(field, HeadingField) else (field,)
    headings = [f.heading for f in slices]
    over_headings = isinstance(field, HeadingField)
    meta, arrays = pack_world(field.world)
    frame = field.frame
    group = zarr.open_group(folder, mode="w-", zarr_format=3)
    group.attrs.update(
        {
            _MARK: FIELD_FORMAT,
            "content_hash": field.content_hash(),
            "world": meta,
            "sensor": sensor_to_dict(field.sensor),
            "estimator": field.method.estimator,
            "criterion": field.method.criterion,
            "heading_rad": headings if over_headings else headings[0],
            "reduction": "" if isinstance(field, HeadingField) else field.reduction,
            "grid": dict(zip(_GRID_KEYS, frame.as_tuple(), strict=True)),
            "source": "sensory uncertainty field after Takeda, Facchinetti, Latombe (1994)",
        }
    )
    for name, (dims, fill, unit, text) in _VARIABLES.items():
        attributes = {"units": unit, "long_name": text}
        if name == "free" or not over_headings:
            data = np.ascontiguousarray(getattr(slices[0], name))
            chunks = tuple(min(CHUNK, n) for n in data.shape[:2]) + data.shape[2:]
            group.create_array(
                name, data=data, chunks=chunks, fill_value=fill, dimension_names=dims, attributes=attributes
            )
            continue
        one = getattr(slices[0], name)
        stored = group.create_array(
            name,
            shape=(*one.shape[:2], len(slices), *one.shape[2:]),
            dtype=one.dtype,
            chunks=(*(min(CHUNK, n) for n in one.shape[:2]), 1, *one.shape[2:]),
            fill_value=fill,
            dimension_names=(*dims[:2], "theta", *dims[2:]),
            attributes=attributes,
        )
        for k, part in enumerate(slices):
            stored[:, :, k] = getattr(part, name)
    x, y = _axes(frame)
    where = "cell centres" if frame.yaw == 0 else "cell centres before the grid's yaw about its origin"
    axes = [("x", x, "m", f"x of {where}"), ("y", y, "m", f"y of {where}")]
    if over_headings:
        axes.append(("theta", np.array(headings), "rad", "heading of the robot"))
    for name, values, unit, text in axes:
        group.create_array(
            name,
            data=values,
            dimension_names=(name,),
            attributes={"units": unit, "long_name": text},
        )
    ids = np.array(field.world.landmarks.ids, dtype=np.dtypes.StringDType())
    group.create_array(
        "landmark", data=ids, dimension_names=("landmark",), attributes={"long_name": "landmark id"}
    )
    group.create_array(
        "landmark_position",
        data=np.ascontiguousarray(field.world.landmarks.positions),
        dimension_names=("landmark", "xy"),
        attributes={"units": "m", "long_name": "position of each landmark"},
    )
    world = group.create_group("world")
    for name, values in arrays.items():
        world.create_array(name, data=np.ascontiguousarray(values))
    zarr.consolidate_metadata(folder)


def _axes(frame: GridFrame) -> tuple[FloatArray, FloatArray]:
    x = frame.origin_x + (np.arange(frame.n_cols) + 0.5) * frame.resolution
    y = frame.origin_y + (np.arange(frame.n_rows) + 0.5) * frame.resolution
    return x.astype(np.float64), y.astype(np.float64)


def _sync(folder: Path) -> None:
    for root, _, names in os.walk(folder):
        for name in names:
            with (Path(root) / name).open("rb") as handle:
                os.fsync(handle.fileno())
        _sync_folder(Path(root))


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def is_field(path: str | Path) -> bool:
    """Whether a field of any version stands at the path."""
    try:
        with _quiet():
            return _MARK in zarr.open_group(path, mode="r").attrs
    except (OSError, ValueError, KeyError, zarr.errors.BaseZarrError):
        return False


def load_field(path: str | Path) -> UncertaintyField | HeadingField:
    """Read a field written by :func:`save_field`.

    Returns
    -------
    field
        Over headings if it was written so.

    Raises
    ------
    FieldFormatError
        If there is no field at the path, it is of another version, damaged, or does not belong to the
        world it carries.
    """
    if not Path(path).exists():
        raise FieldFormatError(f"There is no field at '{path}'; make one with 'surepath field'.")
    if not is_field(path):
        raise FieldFormatError(f"'{path}' is not a surepath field (a zarr group made by 'surepath field').")
    with _quiet():
        group = zarr.open_group(path, mode="r")
        attrs: dict[str, Any] = dict(group.attrs)
        if attrs[_MARK] != FIELD_FORMAT:
            raise FieldFormatError(
                f"'{path}' is a field of format {attrs[_MARK]}, not {FIELD_FORMAT}; build it again."
            )
        try:
            field = _read(group, attrs)
        except (KeyError, TypeError, ValueError, OSError, RuntimeError, MapError, LocalizationError) as error:
            raise FieldFormatError(f"The field '{path}' is damaged: {error}.") from error
    if field.content_hash() != attrs["content_hash"]:
        raise FieldFormatError(f"The field '{path}' does not belong to the world it carries; build it again.")
    return field


def _read(group: zarr.Group, attrs: dict[str, Any]) -> UncertaintyField | HeadingField:
    arrays = {name: np.asarray(group[f"world/{name}"][...]) for name in group["world"].array_keys()}
    world, sensor = unpack_world(attrs["world"], arrays), sensor_from_dict(attrs["sensor"])
    frame = GridFrame(*(attrs["grid"][key] for key in _GRID_KEYS))
    method = FieldMethod(attrs["estimator"], attrs["criterion"])
    free = frozen(group["free"][...], np.bool_)
    headings = attrs["heading_rad"]
    if not isinstance(headings, list):
        values: dict[str, Any] = {name: np.asarray(group[name][...]) for name in LAYERS}
        return UncertaintyField(
            world,
            sensor,
            frame,
            float(headings),
            free,
            **values,
            method=method,
            reduction=str(attrs["reduction"]),
        )
    slices = []
    for k, heading in enumerate(headings):
        values = {name: np.asarray(group[name][:, :, k]) for name in LAYERS}
        slices.append(UncertaintyField(world, sensor, frame, float(heading), free, **values, method=method))
    return HeadingField(tuple(slices))


_GRID_KEYS = ("origin_x_m", "origin_y_m", "yaw_rad", "resolution_m", "n_rows", "n_cols")
