"""Information of the fixes of a field's cells against the gradients of three bearings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.field_builder import build_field
from localization.sensors import MAS97_CAMERA, Mount, OmnidirectionalSensor, PinholeFixedSensor
from planner.fused_belief import FusedField, as_matrices
from tests.oracles import fix_information_of
from tests.worlds import world_from_ascii

ROOM = """
############
#A........B#
#..........#
#.....C....#
#D.........#
############
"""
SENSORS = {
    "around": OmnidirectionalSensor(0.01, bearing_floor=0.002, mount=Mount(0.3, -0.1, 0.4)),
    "pan": MAS97_CAMERA,
    "fixed": PinholeFixedSensor(2.6, 512.0, 5.0, bearing_floor=0.003, mount=Mount(0.3, -0.2, 0.5)),
}


@pytest.mark.parametrize("name", list(SENSORS))
def test_every_cell_is_that_of_the_oracle(name):
    sensor = SENSORS[name]
    world = world_from_ascii(ROOM, resolution=1.0, sigma=np.full(4, 0.02))
    heading = 0.7 if name == "fixed" else 0.0
    field = build_field(world, sensor, resolution=0.5, heading=heading).trusted()
    fused = FusedField.from_field(field)
    arm = np.array(sensor.mount.offset(field.heading))
    centres = field.frame.centres()
    known = np.argwhere(field.has_fix)
    assert len(known) > 20
    widened = 0
    for row, col in known:
        xx, xy, yy = field.covariance[row, col]
        triplet, pan = field.triplet[row, col], field.pan[row, col]
        around = name == "around"
        J, wider = fix_information_of(
            centres[row, col],
            None if triplet[0] < 0 else world.landmarks.positions[triplet],
            np.full(3, 0.02),
            arm=arm,
            axis=field.heading + sensor.mount.theta + (0.0 if math.isnan(pan) else pan),
            on_axis=sensor.bearing_sigma if around else sensor.column_sigma_px / sensor.focal_px,
            floor=sensor.bearing_floor,
            pinhole=not around,
            covariance=np.array([[xx, xy], [xy, yy]]),
            sigma_theta=field.sigma_theta[row, col],
        )
        assert np.allclose(as_matrices(fused.information[row, col]), J, rtol=1e-7, atol=1e-9)
        assert fused.widening[row, col] == pytest.approx(wider, rel=1e-7, nan_ok=True)
        widened += wider > 1.01
    assert not fused.information[~field.has_fix].any()
    assert not fused.padded.reshape(field.frame.n_rows + 2, -1, 6)[[0, -1]].any()
    assert np.array_equal(fused.has_fix, field.has_fix)
    assert widened or name != "pan"


def test_it_ends_early():
    field = build_field(world_from_ascii(ROOM, resolution=1.0), SENSORS["around"], resolution=0.5)
    assert FusedField.unless_stopped(field, np.ones(1, dtype=np.uint8)) is None
