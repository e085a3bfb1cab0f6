"""Figures of a schedule, from stretches that are made up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.landmark_plan import LandmarkPlan, Stretch

A, B = (0, 1, 2), (3, 4, 5)


def test_figures():
    rows = (
        Stretch("blind", 0.0, 0.5, 0.0, 1.0),
        Stretch("fix", 0.5, 2.0, 1.0, 2.0, A, mean_r95=0.1, max_r95=0.2),
        Stretch("turning", 2.0, 2.5, 2.0, 3.0),
        Stretch("blind", 2.5, 3.0, 3.0, 3.5),
        Stretch("fix", 3.0, 3.5, 3.5, 4.0, A, mean_r95=0.3, max_r95=0.3),
        Stretch("fix", 3.5, 4.0, 4.0, 5.0, B, mean_r95=0.4, max_r95=0.5),
    )
    s = np.arange(5.0)
    plan = LandmarkPlan(rows, s, s, np.full(5, 0.1), np.array([math.nan, 0.1, 0.1, 0.1, math.nan]), 1.0)
    assert plan.n_switches == 1, "A is looked at again"
    assert [(g.start, g.end, g.t_start, g.t_end) for g in plan.gaps] == [(0, 0.5, 0, 1), (2, 3, 2, 3.5)]
    assert (plan.blind, plan.blind_seconds) == (1.5, 2.5)
    assert (plan.turning, plan.turning_seconds) == (0.5, 1.0)
    assert plan.unavoidable == 1.0
    assert plan.mean_r95 == pytest.approx((1.5 * 0.1 + 0.5 * 0.3 + 0.5 * 0.4) / 2.5)
    assert plan.max_r95 == 0.5


def test_figures_of_nothing():
    s = np.arange(3.0)
    plan = LandmarkPlan(
        (Stretch("blind", 0.0, 2.0, 0.0, 2.0),), s, s, np.full(3, math.nan), np.full(3, math.nan)
    )
    assert (plan.mean_r95, plan.max_r95, plan.n_switches) == (None, None, 0)
    assert plan.blind == plan.unavoidable == 2.0
