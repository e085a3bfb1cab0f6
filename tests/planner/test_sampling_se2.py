"""RRT* over curves: never worse than the warm way, the same for the same seed, ends in time, says nothing."""

from __future__ import annotations

import math
import subprocess
import sys
import time

import numpy as np
import pytest

from planner.pose_shorten import chain
from planner.sampling_se2 import refine_poses_with_ompl, warm_up
from planner.steering import PoseCurve, PoseSpace, Steering
from tests.paths import cost_from, space_of
from tests.worlds import world_from_ascii

HALL = world_from_ascii(
    """
    ################################
    #..............................#
    #..............................#
    #.........######...............#
    #.........######......#####....#
    #.....................#####....#
    #.....................#####....#
    ################################
    """
)
STOPS = np.array([(1.2, 1.1, 0.0), (3.0, 2.9, 0.5), (8.0, 3.0, 0.0), (14.6, 2.9, 0.0)])


@pytest.fixture(scope="module", params=["dubins", "reeds_shepp"])
def problem(request):
    plain = space_of(HALL, lambda x, y: 0.15 + 0.1 * np.sin(x) * np.sin(1.5 * y), radius=0.3, weight=10.0)
    space = PoseSpace(plain, plain.rate[None], Steering(request.param, 0.7, gear_price=0.5))
    # 8-connected costs are a little too high for a bound, which is good enough to draw from.
    return space, chain(STOPS, space), 0.9 * cost_from(plain, STOPS[-1, :2])[0]


def refine(problem, *, samples=200, seed=0, seconds=60.0):
    space, warm, to_go = problem
    deadline = time.monotonic() + seconds
    return refine_poses_with_ompl(
        space, warm, cost_to_go=to_go, samples=samples, deadline_at=deadline, seed=seed
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_detour_gets_cheaper_and_nothing_gets_worse(problem, seed):
    space, warm, _ = problem
    found, stats = refine(problem, seed=seed)
    assert stats["warm_cost"] == space.cost(warm)
    assert stats["cost"] == space.cost(found)
    assert stats["cost"] < 0.97 * stats["warm_cost"]
    assert stats["samples"] == 200
    assert found.max_curvature <= 1 / 0.7 + 1e-9
    np.testing.assert_allclose(found.joints()[[0, -1]], warm.joints()[[0, -1]], atol=1e-6)


def test_same_seed_same_way(problem):
    ways = [refine(problem, seed=s, samples=100)[0].parts for s in (3, 3)]
    np.testing.assert_array_equal(*ways)


def test_ends_at_the_deadline(problem):
    refine(problem, samples=10)
    began = time.monotonic()
    found, stats = refine(problem, samples=10_000_000, seconds=0.4)
    assert time.monotonic() - began < 0.4 + 0.3
    assert 0 < stats["samples"] < 10_000_000
    assert problem[0].cost(found) <= problem[0].cost(problem[1])


def test_nothing_to_do_returns_the_warm_way(problem):
    space, warm, to_go = problem
    for options in ({"samples": 0}, {"seconds": -1.0}):
        found, stats = refine(problem, **options)
        assert found is warm
        assert stats["samples"] == 0
    nowhere = (space, warm, np.full_like(to_go, np.inf))
    assert refine(nowhere)[0] is warm
    blocked = PoseCurve(STOPS[0], np.array([[100.0, 0, 0]]))
    assert refine((space, blocked, to_go))[0] is blocked
    turning = PoseSpace(space.cost_space, space.rates, Steering("differential"))
    assert refine((turning, chain(STOPS, turning), to_go))[1]["samples"] == 0


def test_the_answer_does_not_depend_on_ompls_own_seed():
    code = (
        "import sys; from ompl import util; util.RNG.setSeed(int(sys.argv[1]));"
        "import hashlib, math, numpy as np; from planner.example_space import example_space as e;"
        "from planner.sampling_se2 import refine_poses_with_ompl as r; from planner.pose_shorten import chain;"
        "from planner.steering import PoseSpace, Steering; p = e();"
        "s = PoseSpace(p, p.rate[None], Steering('dubins', 0.3));"
        "w = chain(np.array([(.5, .5, 0), (2.3, .6, 1.5), (2.4, 2.3, 1.5)]), s);"
        "c, _ = r(s, w, cost_to_go=np.full((12, 12), 0.5), samples=200, deadline_at=math.inf, seed=5);"
        "print(hashlib.sha256(c.parts.tobytes()).hexdigest(), len(c.parts))"
    )
    runs = [
        subprocess.run([sys.executable, "-c", code, seed], capture_output=True, text=True, check=True)
        for seed in ("1", "77")
    ]
    assert runs[0].stdout == runs[1].stdout
    assert len(runs[0].stdout.splitlines()) == 1
    assert not runs[0].stderr


def test_warm_up_is_quick_the_second_time():
    warm_up()
    began = time.perf_counter()
    warm_up()
    assert time.perf_counter() - began < 1.0
    assert math.isfinite(began)
