"""Results are values that nobody can change."""

from __future__ import annotations

import numpy as np
import pytest

from planner.result import Path, PlanResult, PlanStatus, Trajectory


def test_arrays_are_copied_and_read_only():
    points = np.zeros((2, 2))
    n = np.zeros(2)
    path = Path(points, n, n, np.zeros((2, 3)), n, np.zeros((2, 3), dtype=int), n, n, n, n)
    points[0, 0] = 7.0
    assert path.points[0, 0] == 0.0
    assert path.triplet.dtype == np.int16
    for name in set(Path.__dataclass_fields__) - {"kind"}:
        with pytest.raises(ValueError, match="read-only"):
            getattr(path, name)[0] = 1
    moving = Trajectory([0.0, 1.5], points, points, points)
    assert moving.duration == 1.5
    with pytest.raises(ValueError, match="read-only"):
        moving.points[0] = 1


def test_statuses_are_words_and_a_result_may_be_empty():
    assert {s.value for s in PlanStatus} == {"exact", "approximate", "risk_unmet", "timeout", "no_path"}
    result = PlanResult(PlanStatus.NO_PATH, None, None, None, "grid_search")
    assert result.unmet == ()
    assert result.warnings == ()
    assert result.stats == {}
