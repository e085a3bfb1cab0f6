"""Plans by the filter's belief and with bounds on the way without a fix."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from localization.field_builder import build_field
from localization.motion import OdometryModel
from localization.sensors import OmnidirectionalSensor
from planner.belief_plan import plan_by_belief
from planner.belief_work import BeliefWork
from planner.blind_plan import BlindWork
from planner.clock import Clock
from planner.context import PlanningContext
from planner.errors import InvalidProblem
from planner.fused_plan import FusedWork
from planner.label_search import line_stretches, without_path
from planner.plan import plan, warm_up
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from planner.unmet import round_up
from tests.compiled import signatures
from tests.fields import synthetic_field
from tests.planner.test_plan import RING, G, S
from tests.worlds import world_from_ascii

# Landmarks in the upper corridor only; below, the robot drives blind.
HALL = """
    ##########################
    #A....B....C....D....E...#
    #........................#
    #........................#
    #F.......................#
    ######................####
    #....#................#..#
    #....##################..#
    #........................#
    #........................#
    ##########################
"""
SENSOR = OmnidirectionalSensor(0.004, max_range=8.0)


COMPILED = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="of compiled kernels")


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm_up()


def ask(context, start=S, goal=G, radius=0.3, **values):
    problem = PlanningProblem(start, goal, radius, deadline=20.0, **values)
    return plan_by_belief(problem, context, Clock(problem.deadline), baseline=lambda: None)


@pytest.fixture(scope="module")
def ring():
    """Blind for 3 m below the block, a fix everywhere above it."""
    return PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, _blind_below))


def _blind_below(x, y):
    return np.where((x > 4.0) & (x < 7.0) & (y < 2.0), np.nan, 0.02 + 0 * x)


def test_short_blind_stretches_are_crossed_and_long_ones_not(ring):
    low = ask(ring, max_blind_distance=3.5, weight=0.0)
    assert low.status is PlanStatus.EXACT
    assert low.route.path.points[:, 1].max() < 2.0
    assert 2.9 <= low.route.summary.blind <= 3.5
    high = ask(ring, max_blind_distance=2.0, weight=0.0)
    assert high.status is PlanStatus.EXACT
    assert high.route.path.points[:, 1].max() > 3.0
    assert high.route.summary.blind <= 2.0
    assert "casadi" in high.planner


def test_blind_stretches_are_told_by_dead_reckoning(ring):
    result = ask(ring, max_blind_distance=3.5, weight=0.0, odometry=OdometryModel(0.05, 0.05, 0.05))
    path, summary = result.route.path, result.route.summary
    blind = np.flatnonzero(~path.has_fix)
    assert len(blind) > 5
    assert np.isfinite(path.r95).all()
    assert (np.diff(path.r95[blind]) > 0).all()
    assert path.kind == "fix"
    assert summary.longest_blind == pytest.approx(summary.blind)
    assert result.grid_cost is not None
    # 8 directions on cells of 0.25 m: at most 8.3 % longer than straight lines.
    assert -0.08 < result.gap <= 0.03


def test_the_search_of_the_filter_is_the_reference(hall):
    result = ask(hall, (2.0, 4.0), (11.0, 4.0), covariance="fused", weight=4.0)
    assert result.gap == pytest.approx(result.route.summary.cost / result.grid_cost - 1)
    assert -0.1 < result.gap <= 0.03


def test_a_stretch_that_cannot_be_shorter_is_said():
    def sigma(x, y):
        return np.where((x > 4.0) & (x < 6.0), np.nan, 0.02 + 0 * x)

    context = PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, sigma))
    result = ask(context, max_blind_distance=1.0)
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert unmet.bound == "max_blind_distance_m"
    assert 1.9 < unmet.smallest_possible < 2.3
    assert "Place landmarks there" in unmet.message
    assert ask(context, max_blind_distance=unmet.smallest_possible + 0.05).status is PlanStatus.EXACT


@pytest.fixture(scope="module")
def hall():
    return PlanningContext(build_field(world_from_ascii(HALL), SENSOR, resolution=0.25))


def test_the_filter_tells_the_route(hall):
    result = ask(hall, (2.0, 4.0), (11.0, 4.0), covariance="fused", weight=4.0)
    assert result.status is PlanStatus.EXACT
    path = result.route.path
    assert path.kind == "fused"
    assert np.isfinite(path.r95).all()
    assert result.route.summary.max_r95 >= path.r95.max() - 1e-9
    # Many fixes know more than one.
    single = hall.field.r95[tuple(hall.field.frame.cell_at(path.points[len(path.points) // 2]))]
    assert path.r95[len(path.points) // 2] < single
    assert result.route.summary.cost >= result.route.summary.length
    assert (path.collision_probability <= path.collision_bound + 1e-15).all()


def test_dead_reckoning_grows_until_the_bound_forbids_it(hall):
    start, goal = (1.5, 1.0), (10.5, 1.0)
    odometry = OdometryModel(0.05, 0.05, 0.05)
    known = (1e-4, 0.0, 1e-4, 0.0, 0.0, 1e-4)
    loose = ask(hall, start, goal, covariance="fused", start_covariance=known, odometry=odometry, weight=0.0)
    assert loose.status is PlanStatus.EXACT
    assert loose.route.path.points[:, 1].max() < 1.6
    worst = loose.route.summary.max_r95
    tight = ask(
        hall, start, goal, covariance="fused", start_covariance=known, odometry=odometry, max_r95=0.6 * worst
    )
    assert tight.status is PlanStatus.RISK_UNMET
    assert tight.unmet[0].bound == "max_r95_m"
    assert "filter" in tight.unmet[0].message


# Landmarks are seen in the upper half only, the floor is open: what is smoothed or drawn straight loses them.
FLOOR = """
    ############################
    #..A...B...C...D...E...F...#
    #..........................#
    #..........................#
    #..........................#
    #..........................#
    #..........................#
    #..........................#
    #..........................#
    #..........................#
    ############################
"""
LOW = (1.5, 1.0), (12.5, 1.0)
KNOWN = (1e-4, 0.0, 1e-4, 0.0, 0.0, 1e-4)


@pytest.fixture(scope="module")
def floor():
    sensor = OmnidirectionalSensor(0.004, max_range=3.6)
    return PlanningContext(build_field(world_from_ascii(FLOOR), sensor, resolution=0.25))


@pytest.mark.parametrize("covariance", ["fix", "fused"])
def test_a_smooth_way_that_loses_its_fixes_is_not_taken(floor, covariance, monkeypatch):
    start, goal = LOW
    asked = {
        "max_blind_distance": 3.0,
        "covariance": covariance,
        "objective": "shortest",
        "start_covariance": KNOWN,
    }
    calls = []

    def straight(work, points, space):
        calls.append(points)
        return work.timed([start, goal])

    monkeypatch.setattr(BeliefWork, "smoothed", straight)
    result = ask(floor, start, goal, **asked)
    assert calls
    assert result.status is PlanStatus.EXACT
    assert "casadi" not in result.planner
    frame = floor.field.frame
    assert line_stretches(frame, floor.field.has_fix, result.route.trajectory.points).longest <= 3.0
    # What is said of a route is said of its own stretches, not of those of the search.
    kind = FusedWork if covariance == "fused" else BlindWork
    problem = PlanningProblem(start, goal, 0.3, deadline=20.0, **asked)
    work = kind(problem, floor, Clock(20.0))
    work.search(np.zeros(1, dtype=np.uint8))
    (unmet,) = work.unmet(work.of_plain(np.array([start, goal])))
    assert unmet.bound == "max_blind_distance_m"
    assert unmet.value == pytest.approx(11.0, abs=0.01)


def test_the_surest_way_stays_so_when_it_is_smoothed(floor, monkeypatch):
    start, goal = LOW
    known = {"covariance": "fused", "start_covariance": KNOWN}
    surest = ask(floor, start, goal, objective="minimax", **known)
    assert surest.status is PlanStatus.EXACT
    worst = surest.route.summary.max_r95
    direct = ask(floor, start, goal, objective="shortest", **known)
    assert direct.route.summary.max_r95 > 2.0 * worst
    monkeypatch.setattr(BeliefWork, "smoothed", lambda work, points, space: work.timed([start, goal]))
    other = ask(floor, start, goal, objective="minimax", **known)
    assert other.route.summary.max_r95 <= 1.01 * worst
    # No shorter path has a smaller one.
    bounded = ask(floor, start, goal, objective="shortest", max_r95=0.98 * worst, **known)
    assert bounded.route.summary.max_r95 >= 0.98 * worst


@pytest.mark.parametrize("objective", ["shortest", "weighted", "minimax"])
def test_no_route_is_worse_than_the_shortest_one_beside_it(hall, objective):
    # A search that ends on the zigzags of the grid.
    start, goal = (1.5, 4.0), (11.3, 3.4)
    problem = PlanningProblem(start, goal, 0.3, covariance="fused", objective=objective, deadline=20.0)
    result = plan(problem, hall)
    route, shortest = result.route.summary, result.shortest.summary
    if objective == "minimax":
        assert route.max_r95 <= shortest.max_r95 * (1 + 1e-6)
    else:
        assert route.cost <= shortest.cost * (1 + 1e-9)
    # By the same formula.
    weight = problem.effective_weight
    assert shortest.cost == pytest.approx(shortest.length * (1 + weight * shortest.mean_r95), rel=1e-6)


def test_the_shortest_route_is_taken_where_it_is_better(hall):
    """A search's path that is worse than the baseline by all that counts."""
    start, goal = (1.5, 4.0), (11.3, 3.4)
    problem = PlanningProblem(start, goal, 0.3, covariance="fused", objective="shortest", deadline=20.0)
    work = FusedWork(problem, hall, Clock(20.0))
    work.search(np.zeros(1, dtype=np.uint8))
    direct, detour = (work.of_plain(np.array(p)) for p in ([start, goal], [start, (6.0, 3.3), goal]))
    assert work.prefers(direct, detour)
    assert not work.prefers(detour, direct)


def test_what_the_start_breaks_is_said_and_does_not_loosen_the_rest(floor):
    start, goal = (4.0, 4.0), LOW[1]
    lost = (0.04, 0.0, 0.04, 0.0, 0.0, 1e-4)
    result = ask(
        floor,
        start,
        goal,
        covariance="fused",
        objective="shortest",
        start_covariance=lost,
        max_r95=0.1,
        max_blind_distance=3.0,
    )
    assert result.status is PlanStatus.RISK_UNMET
    (unmet,) = result.unmet
    assert unmet.bound == "max_r95_m"
    assert unmet.limit == 0.1
    assert unmet.place == pytest.approx(start)
    assert unmet.smallest_possible >= math.sqrt(0.04 * -2 * math.log(0.05)) * (1 - 1e-9)
    assert result.route.summary.longest_blind <= 3.0


@pytest.mark.parametrize(("at_goal", "words"), [(True, "at the goal itself"), (False, "after ")])
def test_where_a_bound_fails_and_what_is_possible(floor, at_goal, words):
    start, goal = LOW
    ends = (start, goal) if at_goal else (start, (12.5, 4.5))
    asked = {"covariance": "fused", "start_covariance": KNOWN, "odometry": OdometryModel(0.1, 0.1, 0.1)}
    result = ask(floor, *ends, max_r95=0.05, **asked)
    (unmet,) = result.unmet
    assert words in unmet.message
    assert f"Raise max_r95_m to {round_up(unmet.value)}" in unmet.message
    assert unmet.smallest_possible == unmet.value == result.route.summary.max_r95
    # What is said to be possible is.
    again = ask(floor, *ends, max_r95=float(round_up(unmet.value)), **asked)
    assert again.status is PlanStatus.EXACT


def test_several_bounds_are_widened_together(floor):
    start, goal = LOW
    result = ask(
        floor, start, goal, covariance="fused", start_covariance=KNOWN, max_r95=0.05, max_blind_distance=0.5
    )
    assert {u.bound for u in result.unmet} == {"max_r95_m", "max_blind_distance_m"}
    assert all("one factor" in u.message for u in result.unmet)
    (blind,) = (u for u in result.unmet if u.bound == "max_blind_distance_m")
    assert "m without a fix, from (" in blind.message


def test_a_start_without_a_fix_needs_a_belief(hall):
    with pytest.raises(InvalidProblem, match=r"no fix at \(1\.50, 1\.00\)"):
        ask(hall, (1.5, 1.0), (10.5, 1.0), covariance="fused")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"covariance": "best"}, "'fused'"),
        ({"max_blind_distance": -1.0}, "max_blind_distance is -1"),
        ({"fix_rate": 0.0}, "fix_rate"),
        ({"turn_rate": math.nan}, "turn_rate"),
        ({"start_covariance": (1.0, 2.0)}, "six finite"),
        ({"start_covariance": (1.0, 2.0, 1.0, 0.0, 0.0, 1.0)}, "negative axis"),
    ],
)
def test_impossible_beliefs(values, words):
    with pytest.raises(InvalidProblem, match=words):
        PlanningProblem(S, G, 0.3, **values)


def stopped_search(monkeypatch, *, ready=True):
    """The search ends without a path, as when the deadline comes first."""

    for kind in (FusedWork, BlindWork):
        inner = kind.search
        monkeypatch.setattr(kind, "search", lambda work, stop, inner=inner: _late(inner, work, stop, ready))


def _late(inner, work, stop, ready):
    if not ready:
        return without_path(is_complete=False)
    inner(work, stop)
    work.found = without_path(is_complete=False)
    return work.found


@pytest.mark.parametrize("covariance", ["fix", "fused"])
def test_without_a_path_in_time_the_shortest_one_is_told_with_what_it_breaks(floor, covariance, monkeypatch):
    stopped_search(monkeypatch)
    start, goal = LOW
    asked = {"max_blind_distance": 3.0, "covariance": covariance, "start_covariance": KNOWN}
    result = ask(floor, start, goal, **asked)
    assert result.status is PlanStatus.TIMEOUT
    assert result.route.summary.length == pytest.approx(11.0)
    assert result.shortest is result.route
    assert result.route.path.kind == covariance
    (unmet,) = result.unmet
    assert unmet.bound == "max_blind_distance_m"
    assert unmet.value == pytest.approx(11.0)
    assert unmet.smallest_possible is None
    (said,) = result.warnings
    assert "It breaks max_blind_distance_m (11 m instead of 3)" in said
    loose = ask(floor, start, goal, **{**asked, "max_blind_distance": 20.0})
    assert loose.unmet == ()
    assert "keeps all bounds" in loose.warnings[0]


def test_without_time_for_the_filter_that_is_said(floor, monkeypatch):
    stopped_search(monkeypatch, ready=False)
    start, goal = LOW
    result = ask(floor, start, goal, covariance="fused", start_covariance=KNOWN, max_r95=0.1)
    assert result.status is PlanStatus.TIMEOUT
    assert result.route.path.kind == "fix"
    assert "not checked" in result.warnings[0]


@COMPILED
def test_deadlines_leave_time_for_what_follows_the_search(monkeypatch):
    world = world_from_ascii(FLOOR)
    sensor = OmnidirectionalSensor(0.004, max_range=3.6)
    context = PlanningContext(build_field(world, sensor, resolution=0.02))
    start, goal = LOW
    asked = {"covariance": "fused", "start_covariance": KNOWN, "objective": "minimax", "radius": 0.3}
    plan(PlanningProblem(start, goal, deadline=0.05, **asked), PlanningContext(context.field))
    for deadline in (0.3, 0.6):
        began = time.monotonic()
        result = plan(PlanningProblem(start, goal, deadline=deadline, **asked), context)
        # The search alone takes many seconds.
        assert time.monotonic() - began < deadline + 0.8
        assert result.status in {PlanStatus.TIMEOUT, PlanStatus.APPROXIMATE}
        assert result.route is not None


def kernels_compiled_after_warming_up():
    """Names of kernels that plans by belief compile although everything was warmed up."""
    warm_up()
    sensor = OmnidirectionalSensor(0.004, max_range=3.6)
    contexts = [PlanningContext(build_field(world_from_ascii(FLOOR), sensor, resolution=0.25))]
    contexts.append(PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, _blind_below)))
    before = signatures()
    known = {"covariance": "fused", "start_covariance": KNOWN}
    bounds = {"max_r95": 0.1, "max_ellipse95": 0.1, "max_collision_probability": 1e-3}
    asked = [
        *((0, LOW, known | {"objective": kind}) for kind in ("shortest", "weighted", "minimax")),
        (0, LOW, known | bounds),
        (0, LOW, known | {"max_blind_distance": 2.0}),
        (0, ((4.0, 4.0), LOW[1]), {"max_blind_distance": 9.0}),
        *((1, (S, G), {"max_blind_distance": limit}) for limit in (1.0, 2.0, 3.5)),
    ]
    for which, (start, goal), values in asked:
        plan(PlanningProblem(start, goal, 0.3, deadline=20.0, **values), contexts[which])
    return before, [name for name, count in signatures().items() if count > before.get(name, 0)]


@COMPILED
def test_after_warming_up_nothing_is_compiled():
    """Kernels are compiled for kinds of arguments: a plan must not bring new ones (other tests may have)."""
    code = (
        "from tests.planner.test_belief_plan import kernels_compiled_after_warming_up as f\n"
        "known, late = f(); print(len(known), late)"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    count, late = done.stdout.strip().split(" ", 1)
    assert int(count) > 50
    assert late == "[]"
