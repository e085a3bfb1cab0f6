"""Fields over headings: bins, reductions, agreement with single fields, files."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.errors import FieldTooLarge, LocalizationError
from localization.field_builder import build_field, build_heading_field
from localization.heading_field import HeadingField, heading_bins
from localization.io.field_file import load_field, save_field
from localization.method import FieldMethod
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA, Mount
from localization.triplets import best_triplet
from localization.uncertainty_field import LAYERS
from tests.worlds import world_from_ascii

HALL = """
    #####################
    #A.....B........C...#
    #...................#
    #...................#
    #D..................#
    #...................E
    #...................#
    #F......G.......H...#
    #####################
"""
WIDE = replace(FORWARD_CAMERA, field_of_view=1.6)
SENSORS = {
    "fixed": WIDE,
    "mounted": replace(WIDE, mount=Mount(0.3, -0.1, 0.4)),
    "muted laser": replace(LASER, muted=((2.0, -2.0),)),
    "limited pan": replace(MAS97_CAMERA, pan_min=-1.0, pan_max=1.0),
}


@pytest.fixture(params=SENSORS)
def built(request):
    world = world_from_ascii(HALL, resolution=0.5)
    return build_heading_field(world, SENSORS[request.param], resolution=0.5, headings=8)


def test_bins_go_round_once():
    np.testing.assert_allclose(heading_bins(4), [0.0, math.pi / 2, -math.pi, -math.pi / 2])
    for count in (0, 721):
        with pytest.raises(LocalizationError, match=f"is {count}; it must be from 1 to 720"):
            heading_bins(count)


def test_every_slice_is_the_field_at_its_heading(built):
    assert len(built) == 8
    for k, heading in enumerate(built.headings):
        want = build_field(built.world, built.sensor, resolution=0.5, heading=heading)
        for name in LAYERS:
            np.testing.assert_array_equal(getattr(built.slices[k], name), getattr(want, name))
        assert built.at(heading + 0.3) is built.slices[k]
        assert built.at(heading - 0.3 + 4 * math.pi) is built.slices[k]
    assert built.slices[0].free is built.slices[5].free


def test_a_cell_is_the_best_triplet_at_its_pose(built):
    found = 0
    for row, col in ((2, 3), (4, 10), (6, 16)):
        place = built.frame.centres()[row, col]
        for field in built.slices:
            choice = best_triplet(built.world, built.sensor, place, heading=field.heading)
            if choice is None:
                assert not field.has_fix[row, col]
                continue
            found += 1
            np.testing.assert_allclose(field.covariance[row, col], choice.covariance, rtol=1e-9)
            assert tuple(field.triplet[row, col]) == choice.triplet
    assert found > 3


def test_reductions(built):
    areas = np.stack([np.where(f.has_fix, f.area95, np.inf) for f in built.slices])
    for which, pick in (("best", areas.min(axis=0)), ("worst", areas.max(axis=0))):
        field = built.reduced(which)
        np.testing.assert_array_equal(field.has_fix, np.isfinite(pick))
        np.testing.assert_array_equal(field.area95[field.has_fix], pick[np.isfinite(pick)])
        assert field.content_hash() not in {built.content_hash(), built.slices[0].content_hash()}
    some = np.isfinite(areas.min(axis=0))
    assert some.any()
    np.testing.assert_array_equal(built.best_heading() >= 0, some)
    np.testing.assert_allclose(built.share_with_fix(), np.isfinite(areas).mean(axis=0))
    mean = built.mean("area95_m2")
    finite = np.where(np.isfinite(areas), areas, np.nan)
    np.testing.assert_allclose(mean[some], np.nanmean(finite[:, some], axis=0))
    assert np.isnan(mean[~some]).all()
    with pytest.raises(LocalizationError, match="'median'"):
        built.reduced("median")


def test_survives_a_file(built, tmp_path):
    save_field(built, tmp_path / "f.zarr")
    again = load_field(tmp_path / "f.zarr")
    assert isinstance(again, HeadingField)
    assert again.content_hash() == built.content_hash()
    for a, b in zip(again.slices, built.slices, strict=True):
        for name in ("free", *LAYERS):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    reduced = built.reduced("worst")
    save_field(reduced, tmp_path / "w.zarr")
    assert load_field(tmp_path / "w.zarr").content_hash() == reduced.content_hash()


def test_methods_are_kept(tmp_path):
    world = world_from_ascii(HALL, resolution=0.5)
    plain = build_field(world, LASER, resolution=0.5)
    hashes = {plain.content_hash()}
    for method in (
        FieldMethod("all_visible"),
        FieldMethod(criterion="trace"),
        FieldMethod(criterion="max_axis"),
    ):
        field = build_field(world, LASER, resolution=0.5, method=method)
        save_field(field, tmp_path / "f.zarr")
        assert load_field(tmp_path / "f.zarr").method == method
        hashes.add(field.content_hash())
        at = plain.has_fix
        if method.estimator == "all_visible":
            assert (field.area95[at] <= plain.area95[at] * (1 + 1e-9)).all()
            assert (field.triplet == -1).all()
        else:
            assert (field.area95[at] >= plain.area95[at] * (1 - 1e-9)).all()
            name = {"trace": "sigma_rms_m", "max_axis": "sigma_max_m"}[method.criterion]
            assert (field.metric(name)[at] <= plain.metric(name)[at] * (1 + 1e-9)).all()
    assert len(hashes) == 4
    for names in (("mean", "area"), ("best_triplet", "size")):
        with pytest.raises(LocalizationError, match="use one of"):
            FieldMethod(*names)


def test_a_laser_needs_no_headings():
    world = world_from_ascii(HALL, resolution=0.5)
    with pytest.raises(LocalizationError, match="same at every heading"):
        build_heading_field(world, LASER, resolution=0.5)
    with pytest.raises(FieldTooLarge):
        build_heading_field(world, WIDE, resolution=0.5, headings=36, max_cells=5_000)


def test_progress_rises_and_cancel_stops():
    world = world_from_ascii(HALL, resolution=0.5)
    calls = []
    sensor = SENSORS["mounted"]
    build_heading_field(world, sensor, resolution=0.25, headings=3, progress=lambda *c: calls.append(c))
    done = [d for d, _ in calls]
    assert done == sorted(set(done))
    assert calls[-1][0] == calls[-1][1]
    with pytest.raises(LocalizationError, match="cancelled"):
        build_heading_field(world, sensor, resolution=0.25, headings=3, cancelled=lambda: len(calls) > 0)


def test_slices_must_belong_together(built):
    with pytest.raises(LocalizationError, match="each of the bins"):
        HeadingField(built.slices[:3])
    with pytest.raises(LocalizationError, match="each of the bins"):
        HeadingField(())
