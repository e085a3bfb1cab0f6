"""Large floors: seconds and peak memory, each row in a fresh process."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from localization.field_builder import warm_up
from tests.benchmarks import floors

TITLE = "Large floors at 0.05 m (all cores; memory beyond that of the imports, world included)"
# Floor, cells a side, landmarks, job, sensor or largest range in m.
JOBS = [
    *(
        (floor, 2000, 200, "field", sensor)
        for floor in ("plant", "mosaic", "hall")
        for sensor in ("laser", "mas97")
    ),
    ("plant", 4000, 1000, "visibility", "inf"),
    ("hall", 4000, 1000, "visibility", "30"),
    ("hall", 4000, 1000, "visibility", "inf"),
    ("plant", 4000, 1000, "field", "laser"),
    ("plant", 4000, 1000, "field", "mas97"),
]


def run():
    warm_up()  # compiled, and kept for the processes that follow
    makers, _ = floors.available()
    rows = []
    for floor, side, n_landmarks, job, option in JOBS:
        if floor not in makers:
            continue
        command = [
            sys.executable,
            "-m",
            "tests.benchmarks.large_floor",
            floor,
            side,
            n_landmarks,
            job,
            option,
        ]
        done = subprocess.run(
            [str(word) for word in command],
            check=True,
            capture_output=True,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        found = json.loads(done.stdout)
        what = f"field, {option}" if job == "field" else f"visibility, all masks, range {option} m"
        rows.append(
            {
                "floor": floor,
                "cells": f"{side * side:,}",
                "landmarks": n_landmarks,
                "job": what.replace("range inf m", "any range"),
                "free cells": f"{found['free']:,}" if "free" in found else "",
                "visible, mean": f"{found['visible']:.1f}" if "visible" in found else "",
                "seconds": f"{found['seconds']:.1f}",
                "processor [s]": f"{found['processor']:.1f}",
                "peak memory [MiB]": f"{found['peak_mib']:.0f}",
            }
        )
    return rows
