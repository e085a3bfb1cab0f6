"""Whole plans in small worlds with obvious answers."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from planner import plan as plan_module
from planner.context import PlanningContext
from planner.errors import GoalOccupied, GoalOutsideMap, StartOccupied, StartOutsideMap
from planner.plan import plan, warm_up
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from tests.fields import synthetic_field
from tests.planner.test_cost_to_go import random_world
from tests.worlds import place_in_ascii, world_from_ascii

# Two ways from s to g: the short one below, the long one above.
RING = """
######################
#....................#
#....................#
#....................#
#....############....#
#....############....#
#....############....#
#.s................g.#
#....................#
######################
"""
S, G = place_in_ascii(RING, "s"), place_in_ascii(RING, "g")


@pytest.fixture(scope="module", autouse=True)
def _warm():
    warm_up()


def ring(low=0.01, high=0.01, resolution=0.25):
    """Sigma ``low`` on the short way, ``high`` on the long one, 0.01 m at both ends."""

    def sigma(x, y):
        middle = (x > 3.0) & (x < 8.0)
        return np.where(middle, np.where(y < 2.0, low, high), 0.01 + 0 * x)

    return PlanningContext(synthetic_field(world_from_ascii(RING), resolution, sigma))


def ask(context, start=S, goal=G, radius=0.3, deadline=20.0, refine=200, report=None, **values):
    problem = PlanningProblem(start, goal, radius, deadline=deadline, refine=refine, **values)
    return check(plan(problem, context, report=report), problem, context)


def check(result, problem, context):
    """What holds for every answer."""
    for route in (result.route, result.shortest):
        if route is None:
            continue
        np.testing.assert_array_equal(route.path.points[[0, -1]], [problem.start, problem.goal])
        np.testing.assert_array_equal(route.trajectory.points[[0, -1]], [problem.start, problem.goal])
        p = route.trajectory.points
        kept = context.clearance.segment_distance(p[:-1], p[1:]) if len(p) > 1 else math.inf
        assert np.min(kept) >= problem.radius - 2e-9
        assert route.summary.min_clearance >= -2e-9
        speed = np.hypot(*route.trajectory.velocity.T).max()
        assert speed <= problem.max_speed * 1.001
        assert np.hypot(*route.trajectory.acceleration.T).max() <= problem.max_accel * 1.01
        assert route.path.s[-1] == pytest.approx(route.summary.length, abs=1e-9)
    if result.status in {PlanStatus.EXACT, PlanStatus.APPROXIMATE}:
        figures = result.route.summary
        assert result.unmet == ()
        if problem.max_r95 is not None and figures.max_r95 is not None:
            assert figures.max_r95 <= problem.max_r95
            assert np.nanmax(result.route.path.r95) <= problem.max_r95
        if problem.blind_r95 is None:
            assert figures.blind == 0.0
        if result.grid_cost is not None:
            assert figures.cost <= result.grid_cost * (1 + 1e-9)
    if result.route is not None and result.shortest is not None:
        assert result.shortest.summary.length <= result.route.summary.length * 1.0001
    return result


def height(route):
    """Highest y of a route, m."""
    return route.trajectory.points[:, 1].max()


def test_the_short_way_when_both_are_as_good():
    result = ask(ring())
    assert result.status is PlanStatus.EXACT
    assert height(result.route) < 2.0
    assert result.route.summary.length == pytest.approx(8.5, abs=0.01)
    assert result.planner.startswith("grid_search+any_angle")
    assert result.warnings == ()


def test_the_way_round_when_it_is_worth_it_and_the_short_one_beside_it():
    result = ask(ring(low=0.8), weight=4.0)
    assert height(result.route) > 3.0
    assert height(result.shortest) < 2.0
    assert result.route.summary.max_r95 < result.shortest.summary.max_r95
    assert result.route.summary.cost < result.shortest.summary.cost
    assert height(ask(ring(low=0.8), weight=0.1).route) < 2.0
    assert height(ask(ring(low=0.8), objective="shortest").route) < 2.0


def test_a_bound_that_holds_on_the_long_way_only():
    for objective in ("weighted", "shortest"):
        result = ask(ring(low=0.2), weight=0.0, max_r95=0.3, objective=objective)
        assert result.status is PlanStatus.EXACT
        assert height(result.route) > 3.0
        assert result.route.summary.max_r95 < 0.3


def test_a_bound_that_cannot_be_kept_gives_the_smallest_that_can():
    context = ring(low=0.2, high=0.1)
    result = ask(context, max_r95=0.05)
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert unmet.bound == "max_r95_m"
    assert unmet.limit == 0.05
    assert unmet.smallest_possible == pytest.approx(0.1 * math.sqrt(-2 * math.log(0.05)))
    assert unmet.value == pytest.approx(unmet.smallest_possible)
    assert height(result.route) > 3.0
    assert 3.0 <= unmet.place[0] <= 8.0
    assert "0.245 m" in unmet.message
    assert "max_r95_m" in unmet.message
    assert ask(context, max_r95=unmet.smallest_possible).status is PlanStatus.EXACT
    assert ask(context, max_r95=0.245).status is PlanStatus.EXACT
    assert ask(context, max_r95=0.244).status is PlanStatus.RISK_UNMET


def test_a_start_that_breaks_the_bound_counts_as_unmet():
    context = PlanningContext(
        synthetic_field(world_from_ascii(RING), 0.25, lambda x, y: np.where(x < 1.5, 0.5, 0.01))
    )
    result = ask(context, max_r95=0.1)
    assert result.status is PlanStatus.RISK_UNMET
    assert result.unmet[0].smallest_possible == pytest.approx(0.5 * math.sqrt(-2 * math.log(0.05)))
    assert result.unmet[0].place[0] < 1.6


def test_blind_cells_are_avoided_crossed_at_a_price_or_as_little_as_possible():
    context = ring(low=math.nan)
    assert height(ask(context).route) > 3.0
    crossed = ask(context, blind_r95=0.05)
    assert crossed.status is PlanStatus.EXACT
    assert height(crossed.route) < 2.0
    assert crossed.route.summary.blind == pytest.approx(5.0, abs=0.3)
    assert height(ask(context, blind_r95=2.0).route) > 3.0

    def stripes(x, y):
        return np.where((x > 4) & (x < np.where(y < 2, 6.0, 5.0)), np.nan, 0.01)

    context = PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, stripes))
    result = ask(context)
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert unmet.bound == "blind"
    assert unmet.value == result.route.summary.blind == pytest.approx(1.0, abs=0.01)
    assert height(result.route) > 3.0
    assert "without a fix" in unmet.message
    assert result.route.summary.cost == math.inf


def test_both_bounds_unmet():
    def sigma(x, y):
        return np.where((x > 4) & (x < 5), np.nan, np.where((x > 6) & (x < 7), 0.3, 0.01))

    context = PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, sigma))
    result = ask(context, max_r95=0.1)
    assert [u.bound for u in result.unmet] == ["max_r95_m", "blind"]
    assert ask(context, max_r95=0.1, blind_r95=0.2).unmet[0].bound == "max_r95_m"
    assert [u.bound for u in ask(context, max_r95=1.0).unmet] == ["blind"]


def test_no_path_is_said_when_there_is_none():
    closed = RING.replace("#....................#", "#.........##.........#").replace(
        "#.s................g.#", "#.s.......##.......g.#"
    )
    context = PlanningContext(synthetic_field(world_from_ascii(closed), 0.25))
    result = ask(context)
    assert result.status is PlanStatus.NO_PATH
    assert result.route is result.shortest is result.grid_cost is None
    assert "not connected" in result.warnings[0]
    wide = ask(ring(), radius=0.78, start=(1.3, 1.3), goal=(9.5, 1.3))
    assert wide.status is PlanStatus.NO_PATH


def test_a_passage_that_the_grid_is_too_coarse_for_is_found_on_a_finer_one():
    # 1.5 m wide for a robot of 1.4 m: no row of cells of 0.25 m has its centres near the middle.
    context = ring()
    ends = {"start": (1.3, 1.3), "goal": (9.5, 1.3)}
    graph = context.graph(radius=0.7, weight=4.0)
    assert graph.costs_to(ends["goal"]).path_from(ends["start"])[1] is None
    result = ask(context, radius=0.7, **ends)
    assert result.status is PlanStatus.EXACT
    assert height(result.route) > 3.7
    again = ask(context, radius=0.7, **ends)
    np.testing.assert_array_equal(again.route.path.points, result.route.path.points)


def test_ends_that_cannot_be_are_refused_with_a_place_that_can():
    context = ring()
    with pytest.raises(StartOutsideMap, match="outside the map"):
        ask(context, start=(-1.0, 1.0))
    with pytest.raises(GoalOutsideMap):
        ask(context, goal=(1.0, 99.0))
    with pytest.raises(StartOccupied, match="not in free space") as caught:
        ask(context, start=(5.0, 2.5))
    assert context.clearance.distance([caught.value.nearest_free])[0] >= 0.3
    with pytest.raises(GoalOccupied) as caught:
        ask(context, goal=(9.0, 0.62))
    assert str(caught.value).startswith(
        "Goal (9, 0.62) m is 0.12 m from the nearest obstacle; a robot of radius 0.3 m needs 0.3 m."
    )
    assert caught.value.nearest_free == pytest.approx((9.0, 0.81), abs=0.13)
    with pytest.raises(StartOccupied, match="fits nowhere"):
        ask(context, radius=3.0)


def test_start_and_goal_the_same_and_nearly_so():
    result = ask(ring(), goal=S)
    assert result.status is PlanStatus.EXACT
    assert result.route.summary.length == result.route.summary.duration == 0.0
    assert result.shortest.summary.length == 0.0
    near = ask(ring(), goal=(S[0] + 0.01, S[1]))
    assert near.route.summary.length == pytest.approx(0.01)


def test_same_seed_same_answer_and_a_warm_context_changes_nothing():
    context = ring(low=0.3, high=0.05)
    first = ask(context, seed=3, refine=500)
    again = ask(context, seed=3, refine=500)
    fresh = ask(ring(low=0.3, high=0.05), seed=3, refine=500)
    for other in (again, fresh):
        np.testing.assert_array_equal(first.route.trajectory.points, other.route.trajectory.points)
        np.testing.assert_array_equal(first.route.trajectory.t, other.route.trajectory.t)
        assert first.route.summary == other.route.summary
        assert first.shortest.summary == other.shortest.summary
        assert first.planner == other.planner


def test_reports_come_with_the_first_path_and_get_better():
    told = []
    result = ask(ring(low=0.3, high=0.05), report=told.append)
    assert len(told) >= 2
    costs = [r.route.summary.cost for r in told]
    assert costs == sorted(costs, reverse=True)
    assert costs[0] == pytest.approx(result.grid_cost)
    assert told[0].planner == "grid_search"
    assert told[0].shortest is None


def test_a_tiny_deadline_returns_what_there_is():
    context = ring(resolution=0.05)
    result = ask(context, deadline=0.05, refine=1_000_000)
    assert result.status in {PlanStatus.EXACT, PlanStatus.TIMEOUT, PlanStatus.APPROXIMATE}
    # It was cut short and says so, or was quick enough.
    assert any("deadline" in w for w in result.warnings) or result.stats["total_s"] <= 0.05
    assert result.stats["total_s"] < 1.0


def test_no_time_for_any_path_is_a_timeout(monkeypatch):
    context = ring()
    monkeypatch.setattr("planner.clock.time.monotonic", time_that_jumps())
    result = plan(PlanningProblem(S, G, 0.3, deadline=0.05), context)
    assert result.status is PlanStatus.TIMEOUT
    assert result.route is None
    assert "deadline of 0.05 s" in result.warnings[0]


def time_that_jumps():
    """A clock that gains a second with every look."""
    real, looks = time.monotonic, iter(range(10**9))
    return lambda: real() + next(looks)


def test_random_worlds_keep_every_promise(rng):
    for k in range(6):
        world = random_world(rng, shape=(24, 30), share=0.94)
        field = synthetic_field(
            world,
            0.25,
            lambda x, y: np.where(np.sin(x) * np.cos(y) < -0.6, np.nan, 0.05 + 0.04 * np.sin(2 * x)),
        )
        context = PlanningContext(field)
        graph = context.graph(radius=0.3, weight=4.0)
        rows, cols = np.nonzero(graph.cost_space.passable)
        ends = rng.integers(len(rows), size=2)
        start, goal = (tuple(p) for p in graph.cost_space.centre(rows[ends], cols[ends]))
        bound = (None, 0.2)[k % 2]
        blind = (None, 0.5, 0.0)[k % 3]
        result = ask(context, start, goal, max_r95=bound, blind_r95=blind)
        assert result.status in {PlanStatus.EXACT, PlanStatus.RISK_UNMET, PlanStatus.NO_PATH}


def test_where_a_smooth_path_is_too_risky_the_robot_stops_at_corners(monkeypatch):
    asked = []

    def smooth_ones_are_too_risky(route, _limit):
        speed = np.hypot(*np.asarray(route.trajectory.velocity).T)
        asked.append(bool((speed[1:-1] > 0).all()))
        return not asked[-1]

    monkeypatch.setattr(plan_module, "keeps_risk", smooth_ones_are_too_risky)
    monkeypatch.setattr(plan_module, "_RISK_SHARES", ())
    result = plan(PlanningProblem(S, (8.0, 4.0), 0.2, max_collision_probability=0.2, deadline=20.0), ring())
    assert asked[0]
    assert not asked[-1]
    assert any("stops at its corners" in w for w in result.warnings)
    stops = np.hypot(*np.asarray(result.route.trajectory.velocity).T) == 0
    assert stops[1:-1].any()
