"""Heatmap PNG of 1000 × 800 from a built field, over HTTP on the loopback interface."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from api.demo import SENSOR, running_service
from maps.io.site import bundled_site_text

TITLE = "Heatmap PNG 1000 × 800 over HTTP (warehouse at 0.1 m)"


def run(n: int = 200):
    import json

    with tempfile.TemporaryDirectory() as folder, running_service(Path(folder)) as client:
        site = client.json("POST", "/v1/maps", json.loads(bundled_site_text("warehouse")))
        job = client.json("POST", "/v1/fields", {"map": site["map"], "resolution_m": 0.1, "sensor": SENSOR})
        while job.get("job") and client.json("GET", f"/v1/jobs/{job['job']}")["status"] != "successful":
            time.sleep(0.1)
        rows = []
        for label, vary in (("each different (nothing cached)", True), ("the same again", False)):
            times = []
            for k in range(n):
                top = 1.0 + (k * 1e-3 if vary else 0.0)
                path = f"/v1/fields/{job['field']}/heatmap.png?width=1000&height=800&rescale=0.001,{top:.4f}"
                began = time.perf_counter()
                png = client.call("GET", path, accept="image/png")
                times.append(1000 * (time.perf_counter() - began))
            p50, p99 = np.percentile(times, [50, 99])
            rows.append(
                {
                    "request": label,
                    "n": n,
                    "p50 [ms]": f"{p50:.1f}",
                    "p99 [ms]": f"{p99:.1f}",
                    "kB": f"{len(png) / 1000:.0f}",
                }
            )
    return rows
