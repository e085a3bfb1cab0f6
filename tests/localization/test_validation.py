"""The study of a log finds what a simulated log was made with; the document is what the command makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from localization.io.real_logs import read_real_logs
from localization.logs import Sighting
from localization.validation import LogCase, study, study_fixes
from localization.validation_report import validation_report
from tests.localization.logs_made import driven_log, standing_log

DOCUMENT = Path(__file__).parents[2] / "docs" / "validation.md"


def test_a_log_of_the_model_keeps_its_word():
    rng = np.random.default_rng(1)
    fixes = study_fixes(standing_log(rng, n=600, sigma=0.005, bias=0.02), rng=rng, per_landmark=False)
    for view in (fixes.raw, fixes.common, fixes.own, fixes.gated, fixes.scatter):
        assert view.share == pytest.approx(0.95, abs=0.025)
        assert view.actual_median == pytest.approx(view.predicted_median, rel=0.1)
    # A common bias turns fixes and does not move them; outliers that are none take a few scans away.
    assert fixes.common.actual_median == pytest.approx(fixes.raw.actual_median, rel=1e-6)
    assert fixes.own_share == pytest.approx(1.0, abs=0.06)
    assert fixes.every.actual_median < fixes.best.actual_median < fixes.random.actual_median
    assert fixes.distinct_scans == 600


def test_biases_and_outliers_show_and_are_removed():
    rng = np.random.default_rng(2)
    own = np.array([0.03, -0.03, 0.02, 0.0, -0.02, 0.03, 0.0])
    log = standing_log(rng, n=600, sigma=0.005, landmark_bias=own, outliers=0.03)
    fixes = study_fixes(log, rng=rng, per_landmark=True)
    assert fixes.raw.share < 0.7
    assert fixes.own.actual_median < 0.5 * fixes.raw.actual_median
    assert fixes.own.share < fixes.gated.share
    assert fixes.gated.share == pytest.approx(0.95, abs=0.03)


def test_the_filter_of_a_driven_log_is_judged():
    log = driven_log(np.random.default_rng(3), n=20_000, sigma=0.02, lag=0.04, noise=(0.05, 0.05, 0.03, 0.01))
    found = study(LogCase(log, "simulated", filtered=True))
    assert found.lag == pytest.approx(0.04, abs=0.02)
    assert found.counts[Sighting.USABLE] == len(log.time)
    assert [name for name, _ in found.filters] == ["first half", "second half"]
    for _, views in found.filters:
        by_name = {v.view: v for v in views}
        assert by_name["odometry alone"].actual_median > 3 * by_name["gated, earlier stamps"].actual_median
        assert by_name["gated, earlier stamps"].nees.value < 5
        assert by_name["gated, earlier stamps"].share > 0.88


def test_the_report_has_a_row_per_log_and_no_gaps():
    rng = np.random.default_rng(4)
    cases = [LogCase(standing_log(rng, n=100), "simulated")]
    seen = []
    text = validation_report(cases, progress=lambda k, n: seen.append((k, n)))
    assert seen == [(1, 1)]
    assert "| standing | simulated | 700 | 700 | 0 | 0 | 0 |" in text
    assert "nan" not in text
    for block in text.split("\n\n"):
        if block.startswith("|"):
            assert len({line.count("|") for line in block.splitlines()}) == 1


def test_the_document_is_what_the_command_makes(shared_data):
    made = validation_report(read_real_logs(shared_data / "bearing"))
    assert made == DOCUMENT.read_text(), "docs/validation.md is old: run surepath validate again"
