"""Fronts of finished routes: several ways through a hall, one way only, unmet bounds, mistakes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.context import PlanningContext
from planner.errors import InvalidProblem, StartOccupied
from planner.pareto import pareto_front, warm_up
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from tests.fields import synthetic_field
from tests.planner.test_plan import RING, G, S, ring
from tests.worlds import place_in_ascii, world_from_ascii

HALL = "\n".join(["#" * 40, *["#" + "." * 38 + "#"] * 5, "#s" + "." * 36 + "g#", "#" * 40])
K = math.sqrt(-2 * math.log(0.05))


@pytest.fixture(scope="module", autouse=True)
def _warm():
    warm_up()


def hall():
    """Less certain the further down, in the middle of the hall."""

    def sigma(x, y):
        return np.where((x > 4) & (x < 16), 0.02 + 0.05 * np.round(4.0 - y, 1).clip(0.0), 0.01)

    return PlanningContext(synthetic_field(world_from_ascii(HALL), 0.25, sigma))


def question(context=None, **values):
    ends = place_in_ascii(HALL, "s"), place_in_ascii(HALL, "g")
    return PlanningProblem(*ends, 0.2, deadline=20.0, **values)


@pytest.mark.parametrize("against", ["worst", "mean"])
def test_at_least_five_routes_of_which_none_is_dominated(against):
    context, problem = hall(), question()
    front = pareto_front(problem, context, against=against)
    assert front.status is PlanStatus.EXACT
    assert len(front.points) >= 5
    pairs = [(p.length, p.r95) for p in front.points]
    assert pairs == sorted(pairs)
    assert [r for _, r in pairs] == sorted((r for _, r in pairs), reverse=True)
    assert len({p for p, _ in pairs}) == len(pairs)
    for point in front.points:
        figures = point.route.summary
        assert point.length == figures.length
        assert point.r95 == pytest.approx(figures.max_r95 if against == "worst" else figures.mean_r95)
        if against == "worst":
            assert point.r95 <= (point.setting or math.inf)
            assert point.length <= point.grid_length * (1 + 1e-9)
        np.testing.assert_array_equal(point.route.path.points[[0, -1]], [problem.start, problem.goal])
        assert point.route.summary.min_clearance >= -2e-9
    assert front.points[0].length == pytest.approx(18.5)


def test_two_ways_are_two_points():
    context = ring(low=0.2, high=0.05)
    front = pareto_front(PlanningProblem(S, G, 0.3, deadline=20.0), context)
    assert [p.r95 for p in front.points] == pytest.approx([0.2 * K, 0.05 * K])
    assert front.points[0].setting is None
    capped = pareto_front(PlanningProblem(S, G, 0.3, deadline=20.0, max_r95=0.3), context)
    assert [p.r95 for p in capped.points] == pytest.approx([0.05 * K])


def test_one_way_is_one_point():
    for against in ("worst", "mean"):
        front = pareto_front(
            PlanningProblem(S, G, 0.3, deadline=20.0), ring(low=0.01, high=0.2), against=against
        )
        assert len(front.points) == 1
        assert front.status is PlanStatus.EXACT
    still = pareto_front(PlanningProblem(S, S, 0.3), ring())
    assert [p.length for p in still.points] == [0.0]


def test_places_without_a_fix_count_as_they_are_said_to():
    def sigma(x, y):
        return np.where((x > 4) & (x < 7) & (y < 2), np.nan, 0.02)

    context = PlanningContext(synthetic_field(world_from_ascii(RING), 0.25, sigma))
    forbidden = pareto_front(PlanningProblem(S, G, 0.3, deadline=20.0), context)
    assert len(forbidden.points) == 1
    front = pareto_front(PlanningProblem(S, G, 0.3, deadline=20.0, blind_r95=0.5), context)
    assert [p.r95 for p in front.points] == pytest.approx([0.5, 0.02 * K])
    assert front.points[0].route.summary.blind > 2.0
    mean = pareto_front(PlanningProblem(S, G, 0.3, deadline=20.0, blind_r95=0.5), context, against="mean")
    assert len(mean.points) == 2
    assert 0.02 * K < mean.points[0].r95 < 0.5


def test_bounds_that_cannot_be_kept():
    front = pareto_front(PlanningProblem(S, G, 0.3, deadline=20.0, max_r95=0.001), ring())
    assert front.status is PlanStatus.RISK_UNMET
    (point,) = front.points
    assert point.r95 == pytest.approx(0.01 * K)
    assert "best effort" in front.warnings[0]
    (missed,) = front.unmet
    assert (missed.bound, missed.limit, missed.value) == ("max_r95_m", 0.001, pytest.approx(0.01 * K))


def test_no_way_and_no_time():
    context = PlanningContext(
        synthetic_field(world_from_ascii("#####\n#.#.#\n#.#.#\n#####"), 0.25, lambda x, y: 0.02 + 0 * x)
    )
    front = pareto_front(PlanningProblem((0.75, 0.75), (1.75, 0.75), 0.1), context)
    assert front.status is PlanStatus.NO_PATH
    assert front.points == ()
    ends = place_in_ascii(HALL, "s"), place_in_ascii(HALL, "g")
    short = pareto_front(PlanningProblem(*ends, 0.2, deadline=0.05), hall())
    assert short.stats["total_s"] < 1.0
    assert short.status in {PlanStatus.APPROXIMATE, PlanStatus.TIMEOUT, PlanStatus.EXACT}


def test_mistakes():
    for options, words in (({"against": "best"}, "'worst' or 'mean'"), ({"count": 1}, "1 points")):
        with pytest.raises(InvalidProblem, match=words):
            pareto_front(question(), hall(), **options)
    with pytest.raises(InvalidProblem, match="via"):
        pareto_front(question(via=((5.0, 2.0),)), hall())
    for values in ({"covariance": "fused"}, {"max_blind_distance": 3.0}):
        with pytest.raises(InvalidProblem, match="single fixes"):
            pareto_front(question(**values), hall())
    for values in ({"goal_heading": 1.0}, {"kinematics": "differential"}):
        with pytest.raises(InvalidProblem, match="leave out kinematics"):
            pareto_front(question(**values), hall())
    with pytest.raises(StartOccupied):
        pareto_front(PlanningProblem((0.3, 0.3), G, 0.3), ring())


def test_the_front_so_far_is_told():
    told = []
    front = pareto_front(question(), hall(), count=4, report=told.append)
    assert len(told) >= 4
    assert len(told[0].points) == 1
    assert [p.length for p in told[-1].points] == [p.length for p in front.points]
