"""Plans through via points: joined motions, merged answers, repeated places, mistakes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from planner.context import PlanningContext
from planner.errors import StartOccupied, ViaOccupied, ViaOutsideMap
from planner.plan import plan
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from planner.via import plan_via
from tests.fields import synthetic_field
from tests.planner.test_plan import RING, G, S, ask, ring
from tests.worlds import world_from_ascii

TOP = (5.5, 4.0)
K = math.sqrt(-2 * math.log(0.05))


def at_rest_at(route, place):
    """Whether the robot stands at a place at some time."""
    t = route.trajectory
    there = np.hypot(*(t.points - place).T) < 1e-9
    return bool(there.any() and (np.hypot(*t.velocity[there].T) < 1e-6).any())


def test_a_via_point_is_passed_and_the_robot_stops_there():
    seen = []
    result = ask(ring(), weight=0.0, via=(TOP,), report=seen.append)
    route = result.route
    assert result.status is PlanStatus.EXACT
    assert seen == [result]
    assert at_rest_at(route, TOP)
    assert (np.hypot(*(route.path.points - TOP).T) == 0).any()
    assert (np.diff(route.trajectory.t) > 0).all()
    assert (np.diff(route.path.s) > 0).all()
    one, two = ask(ring(), S, TOP, weight=0.0), ask(ring(), TOP, G, weight=0.0)
    for name in ("length", "duration", "cost"):
        parts = [getattr(r.route.summary, name) for r in (one, two)]
        assert getattr(route.summary, name) == pytest.approx(sum(parts))
    assert result.grid_cost == pytest.approx(one.grid_cost + two.grid_cost)
    assert at_rest_at(result.shortest, TOP)


@pytest.mark.parametrize("kinematics", ["dubins", "differential"])
def test_headings_go_on_through_a_via_point(kinematics):
    asked = {"kinematics": kinematics, "min_turn_radius": 0.3, "goal_heading": 0.0, "max_turn_accel": 2.0}
    problem = PlanningProblem(S, G, 0.2, via=(TOP, S), deadline=20.0, **asked)
    route = plan(problem, ring()).route
    t = route.trajectory
    step = np.abs(np.diff(np.unwrap(t.heading)))
    assert (step <= 1.01 * np.diff(t.t) + 1e-6).all()  # at the turn rate of 1 rad/s
    assert t.heading[-1] == pytest.approx(0.0, abs=1e-6)
    assert len(route.path.heading) == len(route.path.s)
    assert route.path.s[-1] == pytest.approx(route.summary.length, abs=1e-6)
    if kinematics == "dubins":
        ahead = np.column_stack([np.cos(t.heading), np.sin(t.heading)])
        assert (np.einsum("ij,ij->i", ahead, t.velocity) >= -1e-9).all()


def test_figures_are_of_the_whole():
    context = ring(low=0.05, high=0.1)
    result = ask(context, weight=0.0, via=(TOP, S, (5.5, 1.0)))
    figures = result.route.summary
    assert figures.max_r95 == pytest.approx(0.1 * K)
    legs = [ask(context, a, b, weight=0.0).route.summary for a, b in ((S, TOP), (TOP, S))]
    legs += [ask(context, a, b, weight=0.0).route.summary for a, b in ((S, (5.5, 1.0)), ((5.5, 1.0), G))]
    mean = sum(leg.mean_r95 * leg.length for leg in legs) / sum(leg.length for leg in legs)
    assert figures.mean_r95 == pytest.approx(mean)
    assert figures.min_clearance == pytest.approx(min(leg.min_clearance for leg in legs))


def test_places_that_follow_themselves_are_one():
    context = ring()
    alone = ask(context, weight=0.0)
    for via in ((S,), (G,), (S, S, G, G), (S, G)):
        result = ask(context, weight=0.0, via=via)
        np.testing.assert_array_equal(result.route.trajectory.points, alone.route.trajectory.points)
    twice = ask(context, weight=0.0, via=(TOP, TOP))
    once = ask(context, weight=0.0, via=(TOP,))
    assert twice.route.summary.length == once.route.summary.length
    still = ask(context, S, S, via=(S, S))
    assert still.route.summary.length == 0.0


def test_round_trips_turn_back_exactly_at_the_via_point():
    result = ask(ring(), S, S, weight=0.0, via=(TOP,))
    assert result.route.summary.length > 6.0
    assert at_rest_at(result.route, TOP)
    there = ask(ring(), (6.0, 1.0), (4.0, 1.0), weight=0.0, via=((8.03, 1.0),))
    assert there.route.path.points[:, 0].max() == pytest.approx(8.03)
    assert there.route.summary.length == pytest.approx(2.03 + 4.03)


def test_unmet_bounds_name_the_worst_leg():
    context = ring(low=0.2, high=0.1)
    result = ask(context, max_r95=0.2, via=(TOP,))
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert unmet.message.startswith("Leg ")
    assert unmet.smallest_possible == pytest.approx(0.1 * K)
    below = ask(context, max_r95=0.2, via=(TOP, (5.5, 1.0)))
    (unmet,) = below.unmet
    assert unmet.smallest_possible == pytest.approx(0.2 * K)
    assert unmet.message.startswith("Leg 2 of 3: ")


def test_metres_without_a_fix_are_added():
    def sigma(x, y):
        return np.where((x > 4) & (x < 5), np.nan, 0.02)

    context = PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, sigma))
    result = ask(context, via=(TOP, S))
    (unmet,) = result.unmet
    assert unmet.bound == "blind"
    assert unmet.value == pytest.approx(result.route.summary.blind)
    assert result.route.summary.blind >= 3.0


def test_beliefs_begin_anew_and_a_warning_says_where_that_matters():
    def sigma(x, y):
        return np.where((x > 5) & (x < 6), np.nan, 0.02)

    context = PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, sigma))
    asked = []

    def leg(problem, context):
        asked.append(problem)
        return plan(
            replace(problem, max_blind_distance=None, covariance="fix", start_covariance=None), context
        )

    start = (0.01, 0.0, 0.0, 0.01, 0.0, 0.01)
    problem = PlanningProblem(S, G, 0.3, via=(TOP,), blind_r95=0.1, max_blind_distance=2.0, refine=0)
    result = plan_via(replace(problem, deadline=10.0), context, leg)
    assert "Via point 1 has no fix; metres without one and the belief are counted anew from there." in (
        result.warnings
    )
    plan_via(replace(problem, covariance="fused", start_covariance=start, deadline=10.0), context, leg)
    assert [p.start_covariance is None for p in asked[-2:]] == [False, True]


def test_minimax_is_of_the_whole():
    # The hardest leg needs the upper way's 0.1 m; the second leg may use the short way's 0.05 m.
    context = ring(low=0.05, high=0.1)
    result = ask(context, objective="minimax", via=(TOP,))
    assert result.status is PlanStatus.EXACT
    assert result.route.summary.max_r95 == pytest.approx(0.1 * K)
    free = ask(context, objective="shortest", via=(TOP,))
    assert result.route.summary.length == pytest.approx(free.route.summary.length)
    unmet = ask(context, objective="minimax", max_r95=0.15, via=(TOP,))
    assert unmet.status is PlanStatus.RISK_UNMET


def test_a_leg_without_a_way_says_which():
    context = PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, lambda x, y: 0.02 + 0 * x))
    wall = shapely.box(3.0, 0.0, 3.4, 3.0).union(shapely.box(0.0, 2.6, 3.4, 3.0))
    result = plan(PlanningProblem(S, G, 0.3, via=(TOP,), avoid=(wall,), deadline=10.0), context)
    assert result.status is PlanStatus.NO_PATH
    assert result.route is None
    assert any(w.startswith("Leg 1 of 2, from the start to via point 1: ") for w in result.warnings)


def test_when_the_time_is_over():
    result = plan(PlanningProblem(S, G, 0.3, via=(TOP, S) * 20, deadline=0.05), ring(resolution=0.05))
    assert result.status in {PlanStatus.TIMEOUT, PlanStatus.EXACT}
    assert result.stats["total_s"] < 2.0


def test_mistakes():
    context = ring()
    with pytest.raises(ViaOutsideMap, match=r"Via point 2 \(-5, 1\) m is outside"):
        ask(context, via=(TOP, (-5.0, 1.0)))
    with pytest.raises(ViaOccupied, match="Via point 1") as caught:
        ask(context, via=((5.5, 2.0),))
    assert caught.value.nearest_free is not None
    with pytest.raises(StartOccupied):
        ask(context, (5.5, 2.0), via=(TOP,))
