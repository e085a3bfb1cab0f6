"""The field as a value."""

from __future__ import annotations

import math
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

from localization.errors import LocalizationError
from localization.sensors import LASER, MAS97_CAMERA
from localization.uncertainty_field import METRICS, UncertaintyField, field_hash
from tests.fields import synthetic_field
from tests.worlds import world_from_ascii

DRAWING = """
    A....B
    ......
    ..##..
    C.....
"""


@pytest.fixture
def field():
    world = world_from_ascii(DRAWING)
    return synthetic_field(world, sigma=lambda x, y: np.where(x > 2.5, np.nan, 0.1 + 0.01 * y))


def parts(field):
    return {f.name: getattr(field, f.name) for f in fields(field)}


def test_cells_without_a_fix_are_explicit(field):
    assert not field.has_fix[:, 5].any()
    assert np.isnan(field.r95[:, 5]).all()
    assert np.isnan(field.area95[1, 2:4]).all()
    assert field.has_fix[0, 0]
    assert field.r95[0, 0] == pytest.approx(0.1025 * np.sqrt(5.991464547))


def test_arrays_are_read_only_also_after_pickling(field):
    for value in (field, pickle.loads(pickle.dumps(field))):
        for name in ("free", "covariance", "sigma_theta", "triplet", "pan", "n_visible"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(value, name)[0, 0] = 1
        assert value.content_hash() == field.content_hash()


def test_read_only_arrays_are_taken_without_a_copy(field):
    again = UncertaintyField(**parts(field))
    assert again.covariance is field.covariance


@pytest.mark.parametrize("name", ["free", "covariance", "sigma_theta", "triplet", "pan", "n_visible"])
def test_wrong_shapes_are_refused(field, name):
    values = parts(field)
    values[name] = values[name][:-1]
    with pytest.raises(LocalizationError, match=name):
        UncertaintyField(**values)


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_at_cells_is_that_of_the_whole(field, name):
    whole = field.metric(name)
    assert whole.shape == field.frame.shape
    assert whole.dtype == np.float64
    assert np.isnan(whole[1, 2])  # in the wall
    rows, cols = np.array([0, 1, 3]), np.array([0, 2, 5])
    np.testing.assert_array_equal(field.metric(name, (rows, cols)), whole[rows, cols])


def test_metrics_of_an_isotropic_cell(field):
    at = (np.array([0]), np.array([0]))
    sigma = 0.1025
    assert field.metric("sigma_max_m", at) == pytest.approx(sigma)
    assert field.metric("sigma_rms_m", at) == pytest.approx(sigma)
    assert field.metric("r95_m", at) == pytest.approx(field.metric("ellipse95_m", at))
    assert field.metric("area95_m2", at) == pytest.approx(np.pi * field.metric("r95_m", at) ** 2)
    assert field.metric("n_visible", at) == 3


def test_unknown_metric_lists_the_known(field):
    with pytest.raises(LocalizationError, match="area95_m2"):
        field.metric("quality")


def test_hash_follows_all_inputs(field):
    frame = field.frame
    other = field.world.with_landmarks(field.world.landmarks.subset([0, 1]))
    hashes = {
        field.content_hash(),
        field_hash(other, LASER, frame),
        field_hash(field.world, MAS97_CAMERA, frame),
        field_hash(field.world, LASER, replace(frame, resolution=0.4)),
        field_hash(field.world, LASER, frame, 0.1),
    }
    assert len(hashes) == 5
    assert field_hash(field.world.renamed("other"), LASER, frame) == field.content_hash()


def test_what_planning_trusts():
    shares = np.array([[0.95, 0.9421, 0.93, 0.86, 0.84, 0.1, np.nan, 0.97]], dtype=np.float32)
    world = world_from_ascii("########\n########\n.A.B.C..\n########", resolution=1.0)
    whole = synthetic_field(world, 1.0, sigma=lambda x, y: 0.1 + 0.0 * x)
    validity = np.tile(shares, (4, 1))
    field = replace(whole, validity=np.where(whole.has_fix, validity, np.nan).astype(np.float32))
    row = 1
    assert field.is_valid[row].tolist() == [True, True, False, False, False, False, True, False]
    trusted = field.trusted()
    growth = trusted.r95[row] / field.r95[row]
    want = [
        1.0,
        1.0,
        math.log(0.05) / math.log(0.07),
        math.log(0.05) / math.log(0.14),
        np.nan,
        np.nan,
        1.0,
        1.0,
    ]
    np.testing.assert_allclose(growth, want, rtol=1e-6)
    np.testing.assert_array_equal(trusted.has_fix[row], np.isfinite(want))
    np.testing.assert_array_equal(trusted.triplet[row, :, 0] >= 0, np.isfinite(want))
    assert trusted.trusted() is trusted
    assert whole.trusted() is whole
    assert trusted.content_hash() == field.content_hash()
    assert (trusted.free == field.free).all()
