"""One job on a large floor in a process of its own: ``python -m tests.benchmarks.large_floor hall 2000 200 field laser``.

Prints seconds, processor time and the peak of memory, MiB, beyond what the imports took.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time

from localization.field_builder import build_field, warm_up
from localization.sensors import LASER, MAS97_CAMERA
from maps.visibility import compute_visibility
from tests.benchmarks import floors
from tests.benchmarks.bench_visibility import paint

SENSORS = {"laser": LASER, "mas97": MAS97_CAMERA}


def peak_mib():
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def main(floor, side, n_landmarks, job, option):
    before = peak_mib()
    warm_up()
    world = floors.available()[0][floor](int(side), int(n_landmarks))
    frame = world.floor.frame
    began, cpu = time.perf_counter(), time.process_time()
    found = {}
    if job == "visibility":
        visibility = compute_visibility(world, frame, max_range=float(option))
        paint(visibility, os.cpu_count() or 1)
    else:
        sensor = SENSORS[option]
        field = build_field(world, sensor, resolution=frame.resolution, max_cells=frame.n_rows * frame.n_cols)
        found = {
            "free": int(field.free.sum()),
            "with_fix": int(field.has_fix.sum()),
            "visible": float(field.n_visible[field.free].mean()),
        }
    found |= {"seconds": time.perf_counter() - began, "processor": time.process_time() - cpu}
    print(json.dumps({"peak_mib": peak_mib() - before, **found}))


if __name__ == "__main__":
    main(*sys.argv[1:])
