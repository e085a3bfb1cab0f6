"""Building a field: seconds and cells per second on the warehouse and the plant at 0.1 m."""

from __future__ import annotations

import time

import numpy as np

from localization.field_builder import build_field
from localization.sensors import LASER, MAS97_CAMERA
from maps.io.load import load_world
from maps.io.site import bundled_site
from maps.visibility import compute_visibility
from tests.conftest import SHARED

TITLE = "Field (0.1 m, all cores)"


def run():
    worlds = [("warehouse", bundled_site("warehouse"))]
    plant = SHARED / "landmark_maps" / "cob" / "ipa-production-plant"
    if plant.is_dir():
        worlds.append(("plant", load_world(plant)))
    rows = []
    for name, world in worlds:
        for label, sensor in (("laser", LASER), ("mas97", MAS97_CAMERA)):
            build_field(world, sensor, resolution=1.0)  # compiled before it is timed
            began = time.perf_counter()
            compute_visibility(world, world.grid_frame(0.1), max_range=sensor.max_range)
            seen = time.perf_counter()
            field = build_field(world, sensor, resolution=0.1)
            done = time.perf_counter()
            seconds = done - seen
            free = int(np.count_nonzero(field.free))
            rows.append(
                {
                    "site": name,
                    "sensor": label,
                    "landmarks": len(world.landmarks),
                    "free cells": free,
                    "visible, mean": f"{field.n_visible[field.free].mean():.1f}",
                    "with a fix": f"{100 * np.count_nonzero(field.has_fix) / free:.1f} %",
                    "visibility alone [s]": f"{seen - began:.2f}",
                    "whole field [s]": f"{seconds:.2f}",
                    "free cells per s": f"{free / seconds:,.0f}",
                }
            )
    return rows
