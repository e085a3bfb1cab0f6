"""The demonstration itself, as ``make demo`` runs it."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from PIL import Image


@pytest.mark.timeout(600)
def test_the_demonstration_shows_the_main_job_and_ends(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "api.cli", "demo", "-o", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        timeout=540,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    for word in ("worst r95", "mean r95", "duration", "length", "worst ellipse area"):
        assert word in done.stdout
    answer = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert answer["status"] in {"exact", "approximate"}
    chosen, shortest = answer["routes"][0], answer["shortest_baseline"]
    assert chosen["uncertainty"]["max_r95_m"] < shortest["uncertainty"]["max_r95_m"]
    assert chosen["uncertainty"]["mean_r95_m"] < shortest["uncertainty"]["mean_r95_m"]
    # The shortest way passes places without a fix that counts: it has no cost where these are forbidden.
    assert shortest["cost"] is None or chosen["cost"] < shortest["cost"]
    assert shortest["length_m"] <= chosen["length_m"]
    assert chosen["min_clearance_m"] >= -1e-6
    for name in ("heatmap.png", "plan.png"):
        with Image.open(tmp_path / "out" / name) as image:
            assert image.width > 1000
