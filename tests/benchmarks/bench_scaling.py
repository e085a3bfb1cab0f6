"""Cost against the number of landmarks and of cells, in the open hall; two charts for the documents."""

from __future__ import annotations

import os
import time

import numpy as np

from localization.field_builder import build_field, warm_up
from localization.sensors import LASER, MAS97_CAMERA
from maps.visibility import compute_visibility
from tests.benchmarks import floors
from tests.benchmarks.bench_visibility import paint
from tests.benchmarks.chart import log_chart

TITLE = "Scaling: hall of 100 m × 100 m, range of visibility and laser 30 m (processor time)"
LANDMARKS, RESOLUTIONS_M = (10, 30, 100, 300, 1000), (1.0, 0.5, 0.2, 0.1, 0.05)
MOST, FINE_M = 200, 0.1
WHAT = ("visibility, all masks", "field, laser", "field, mas97 camera")


def run():
    warm_up()
    rows = [_row("landmarks", floors.hall(2000, n), FINE_M) for n in LANDMARKS]
    world = floors.hall(2000, MOST)
    return rows + [_row("cells", world, resolution) for resolution in RESOLUTIONS_M]


def draw(rows, folder):
    """Write both charts; returns their names and captions."""
    charts = []
    for varied, title in (
        ("landmarks", "Cost against landmarks: hall of 1,000,000 cells"),
        ("cells", f"Cost against cells: hall with {MOST} landmarks"),
    ):
        some = [row for row in rows if row["varied"] == varied]
        x = [float(str(row[varied]).replace(",", "")) for row in some]
        series = {name: (x, [float(row[f"{name} [s]"]) for row in some]) for name in WHAT}
        path = folder / f"bench_{varied}.png"
        log_chart(
            path,
            title,
            f"number of {varied}",
            "processor time [s]",
            series,
        )
        charts.append((path.name, title))
    return charts


def _row(varied, world, resolution):
    frame = world.grid_frame(resolution)
    return {
        "varied": varied,
        "landmarks": len(world.landmarks),
        "cells": f"{frame.n_rows * frame.n_cols:,}",
        **{
            f"{name} [s]": f"{_seconds(job):.4f}"
            for name, job in zip(
                WHAT,
                (
                    lambda: paint(
                        compute_visibility(world, frame, max_range=LASER.max_range), os.cpu_count() or 1
                    ),
                    lambda: build_field(world, LASER, resolution=resolution),
                    lambda: build_field(world, MAS97_CAMERA, resolution=resolution),
                ),
                strict=True,
            )
        },
    }


def _seconds(job, budget=2.0):
    """Least of some repetitions, once at least."""
    times = []
    while not times or (sum(times) < budget and len(times) < 5):
        began = time.process_time()
        job()
        times.append(time.process_time() - began)
    return float(np.min(times))
