from __future__ import annotations

import json
import math
import pickle
import warnings

import numpy as np
import pytest
import xarray
import zarr
from shapely.geometry import box

from localization.covariance import area95
from localization.errors import FieldFormatError
from localization.io.field_file import check_target, is_field, load_field, save_field
from localization.sensors import LASER, MAS97_CAMERA
from maps.floor_plan import FloorPlan
from maps.landmarks import LandmarkSet
from maps.world import World
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

DRAWING = """
########
#A....B#
#......#
#..C...#
########
"""


def grid_field(sensor=LASER):
    return synthetic_field(
        world_from_ascii(DRAWING, 1.0), 0.5, lambda x, y: np.where(x > 5, np.nan, 0.01 * (1 + y)), sensor
    )


def vector_field():
    landmarks = LandmarkSet(
        ("a", "b", "ç 3"), np.array([[0, 0], [9, 0], [4, 7]]), facing=np.array([0.5, np.nan, -1.0])
    )
    floor = FloorPlan((box(0, 0, 10, 8),), (box(3, 3, 4, 5), box(6, 1, 7, 2)), (True, False))
    return synthetic_field(World("hall", floor, landmarks), 0.5)


@pytest.mark.parametrize("field", [grid_field(), grid_field(MAS97_CAMERA), vector_field()])
def test_what_is_read_is_what_was_written(field, tmp_path):
    save_field(field, tmp_path / "f.zarr")
    got = load_field(tmp_path / "f.zarr")
    assert got.content_hash() == field.content_hash()
    assert got.world.name == field.world.name
    assert got.world.landmarks.ids == field.world.landmarks.ids
    assert got.sensor == field.sensor
    for name in ("free", "covariance", "sigma_theta", "triplet", "pan", "n_visible"):
        a, b = getattr(field, name), getattr(got, name)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_xarray_opens_it_with_units_and_coordinates(tmp_path):
    field = grid_field()
    save_field(field, tmp_path / "f.zarr")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = xarray.open_zarr(tmp_path / "f.zarr")
    centres = field.frame.centres()
    np.testing.assert_allclose(data.x.values, centres[0, :, 0])
    np.testing.assert_allclose(data.y.values, centres[:, 0, 1])
    assert data.area95.dims == ("y", "x")
    assert data.area95.attrs["units"] == "m2"
    np.testing.assert_allclose(data.area95.values, area95(field.covariance))
    assert data.covariance.attrs["units"] == "m2"
    assert data.sigma_theta.attrs["units"] == data.pan.attrs["units"] == "rad"
    assert data.x.attrs["units"] == "m"
    assert [str(i) for i in data.landmark.values] == list(field.world.landmarks.ids)
    at = data.sel(x=2.0, y=2.0, method="nearest")
    assert int(at.n_visible) == 3
    assert [str(data.landmark.values[i]) for i in at.triplet.values] == ["A", "B", "C"]


def test_a_field_replaces_a_field_and_nothing_else(tmp_path):
    path = tmp_path / "f.zarr"
    save_field(grid_field(), path)
    save_field(vector_field(), path)
    assert load_field(path).world.name == "hall"
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter").write_text("precious")
    with pytest.raises(FieldFormatError, match="is not a field"):
        save_field(grid_field(), tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter").read_text() == "precious"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["f.zarr", "thesis"]


def test_a_failed_write_leaves_the_old_field_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "f.zarr"
    save_field(grid_field(), path)

    def full_disk(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("localization.io.field_file._sync", full_disk)
    with pytest.raises(FieldFormatError, match="No space left"):
        save_field(vector_field(), path)
    assert load_field(path).world.name == "ascii"
    assert [p.name for p in tmp_path.iterdir()] == ["f.zarr"]


def test_the_folder_must_exist(tmp_path):
    with pytest.raises(FieldFormatError, match="does not exist; create it first"):
        check_target(tmp_path / "nowhere" / "f.zarr")


def test_not_a_field(tmp_path):
    with pytest.raises(FieldFormatError, match="There is no"):
        load_field(tmp_path / "f.zarr")
    (tmp_path / "file").write_text("hello")
    assert not is_field(tmp_path / "file")
    with pytest.raises(FieldFormatError):
        load_field(tmp_path / "file")
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    assert not is_field(tmp_path / "other.zarr")
    with pytest.raises(FieldFormatError, match="not a"):
        load_field(tmp_path / "other.zarr")


def damage(path, change):
    meta = json.loads((path / "zarr.json").read_text())
    change(meta["attributes"])
    (path / "zarr.json").write_text(json.dumps(meta))


def test_another_version_is_refused(tmp_path):
    save_field(grid_field(), tmp_path / "f.zarr")
    damage(tmp_path / "f.zarr", lambda a: a.update(surepath_field=99))
    with pytest.raises(FieldFormatError, match="format 99"):
        load_field(tmp_path / "f.zarr")


@pytest.mark.parametrize(
    "change",
    [
        lambda a: a.pop("grid"),
        lambda a: a.update(sensor={"kind": "sonar"}),
        lambda a: a.update(heading_rad="north"),
        lambda a: a["grid"].update(n_rows=3),
        lambda a: a["grid"].update(resolution_m=-1),
    ],
)
def test_a_damaged_field_is_refused_by_name(change, tmp_path):
    save_field(grid_field(), tmp_path / "f.zarr")
    damage(tmp_path / "f.zarr", change)
    with pytest.raises(FieldFormatError, match=r"f\.zarr"):
        load_field(tmp_path / "f.zarr")


def test_numbers_of_another_sensor_are_noticed(tmp_path):
    save_field(grid_field(), tmp_path / "f.zarr")
    damage(tmp_path / "f.zarr", lambda a: a["sensor"].update(bearing_sigma=math.radians(3)))
    with pytest.raises(FieldFormatError, match="does not belong"):
        load_field(tmp_path / "f.zarr")


def test_a_field_survives_pickling_read_only():
    got = pickle.loads(pickle.dumps(vector_field()))
    assert not got.covariance.flags.writeable
    assert got.content_hash() == vector_field().content_hash()
