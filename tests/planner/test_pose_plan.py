"""Ways from pose to pose: never dearer than the lattice's, exact at the ends, in words where there is none."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from localization.field_builder import build_heading_field
from localization.sensors import FORWARD_CAMERA
from planner import pose_plan
from planner.errors import InvalidProblem
from planner.lattice import Outcome
from planner.pose_plan import plan_poses, warm_up
from planner.pose_shorten import chain, shorten_poses
from planner.steering import PoseCurve, PoseSpace, Steering, shortest_curve
from tests.paths import space_of
from tests.worlds import place_in_ascii, world_from_ascii

HALL = """
    ################################
    #..............................#
    #..............................#
    #.........######...............#
    #.........######......#####....#
    #.....................#####....#
    #.....................#####....#
    ################################
    """
DEAD_END = """
    ##########################
    #........................#
    #........................#
    #.....................g..#
    #........................#
    ############...###########
    ############...###########
    ############.s.###########
    ############...###########
    ##########################
    """
ROBOTS = {
    "differential": Steering("differential", turn_price=0.4),
    "dubins": Steering("dubins", 0.7),
    "reeds_shepp": Steering("reeds_shepp", 0.7, gear_price=0.5),
}
ENDS = ((1.2, 1.1, 1.0), (14.6, 1.2, -1.5))


@pytest.fixture(scope="module")
def hall():
    return space_of(
        world_from_ascii(HALL), lambda x, y: 0.15 + 0.1 * np.sin(x) * np.sin(1.5 * y), radius=0.3, weight=10.0
    )


def check(path, space, start, goal):
    assert path.outcome is Outcome.FOUND
    assert path.is_exact
    assert path.reason == ""
    assert path.cost <= path.lattice_cost
    assert space.cost(path.curve) == path.cost
    poses = path.poses
    for pose, end in ((poses[0], start), (poses[-1], goal)):
        np.testing.assert_allclose(pose[:2], end[:2], atol=1e-6)
        if end[2] is not None:
            assert abs(math.remainder(pose[2] - end[2], 2 * math.pi)) < 1e-6
    assert len(path.gears) == len(poses)
    kept = space.cost_space.clearance.distance(poses[:, :2])
    assert kept.min() >= space.cost_space.need - 1e-6


@pytest.mark.parametrize("refine", [0, 150])
@pytest.mark.parametrize("name", ROBOTS)
def test_never_dearer_than_the_lattice_and_exact_at_the_ends(hall, name, refine):
    path = plan_poses(hall, *ENDS, steering=ROBOTS[name], refine=refine, seed=3)
    space = PoseSpace(hall, hall.rate[None], ROBOTS[name])
    check(path, space, *ENDS)
    assert path.cost < 0.999 * path.lattice_cost
    assert "shorten" in path.planner
    if ROBOTS[name].is_car:
        assert path.curve.max_curvature <= 1 / 0.7 + 1e-9
        assert path.stats.get("samples", 0) == refine
    # Straight ahead is a lower bound.
    assert path.length >= math.hypot(13.4, 0.1)
    assert path.to_go is not None


@pytest.mark.parametrize("name", ROBOTS)
def test_on_many_cells_a_quick_way_stands_where_the_time_ends(hall, name, monkeypatch):
    exact = plan_poses(hall, *ENDS, steering=ROBOTS[name])
    monkeypatch.setattr(pose_plan, "_MANY_CELLS", 1)
    both = plan_poses(hall, *ENDS, steering=ROBOTS[name], deadline_at=time.monotonic() + 60)
    assert both.is_exact
    assert both.cost == pytest.approx(exact.cost, rel=1e-9)
    monkeypatch.setattr(pose_plan, "_PROOF_SHARE", 0.0)
    quick = plan_poses(hall, *ENDS, steering=ROBOTS[name], deadline_at=time.monotonic() + 60)
    assert not quick.is_exact
    assert exact.lattice_cost * (1 - 1e-9) <= quick.lattice_cost <= 1.1 * exact.lattice_cost
    assert PoseSpace(hall, hall.rate[None], ROBOTS[name]).cost(quick.curve) == quick.cost


@pytest.mark.parametrize("name", ["dubins", "reeds_shepp"])
def test_same_seed_same_way(hall, name):
    ways = [plan_poses(hall, *ENDS, steering=ROBOTS[name], refine=150, seed=s).curve.parts for s in (1, 1)]
    np.testing.assert_array_equal(*ways)


@pytest.mark.parametrize("name", ROBOTS)
def test_free_headings(hall, name):
    fixed = plan_poses(hall, *ENDS, steering=ROBOTS[name])
    start, goal = ((x, y, None) for x, y, _ in ENDS)
    free = plan_poses(hall, start, goal, steering=ROBOTS[name])
    check(free, PoseSpace(hall, hall.rate[None], ROBOTS[name]), start, goal)
    assert free.lattice_cost < fixed.lattice_cost


def test_a_robot_that_turns_in_place_turns_first_and_last(hall):
    path = plan_poses(hall, *ENDS, steering=ROBOTS["differential"])
    assert path.gears[1] == 0
    assert path.gears[-1] == 0
    assert path.curve.parts[0, 2] != 0


def test_there_already(hall):
    for steering in ROBOTS.values():
        path = plan_poses(hall, ENDS[0], ENDS[0], steering=steering)
        assert path.cost == 0
        assert path.length == 0
        assert len(path.poses) == 1
    turned = plan_poses(hall, ENDS[0], (*ENDS[0][:2], -1.0), steering=ROBOTS["differential"])
    assert turned.length < 1e-9
    assert turned.cost == pytest.approx(0.4 * 2.0)


def test_words_where_a_car_has_no_way():
    space = space_of(world_from_ascii(DEAD_END), lambda x, y: 0.1 + 0.0 * x, resolution=0.1, radius=0.4)
    start = (*place_in_ascii(DEAD_END, "s"), -math.pi / 2)
    goal = (*place_in_ascii(DEAD_END, "g"), math.pi)
    forwards = plan_poses(space, start, goal, steering=Steering("dubins", 1.2))
    assert forwards.outcome is Outcome.NO_WAY
    assert forwards.curve is None
    assert math.isinf(forwards.cost)
    assert len(forwards.poses) == 0
    assert "1.2 m" in forwards.reason
    assert "reverse gear" in forwards.reason
    out = plan_poses(space, start, goal, steering=Steering("reeds_shepp", 1.2, gear_price=0.5))
    assert out.gears[1] == -1
    # Arcs that do not fit the hall at all; a part as large they do.
    facing = (*start[:2], math.pi / 2)
    wide = plan_poses(space, facing, goal, steering=Steering("dubins", 3.5))
    assert wide.outcome is Outcome.NO_WAY
    assert "aisle" in wide.reason
    assert "there is one" in wide.reason


def test_words_where_nothing_leads():
    drawing = """
        ###########
        #....#....#
        #....#....#
        ###########
        """
    space = space_of(world_from_ascii(drawing), lambda x, y: 0.1 + 0.0 * x, radius=0.2)
    for steering in ROBOTS.values():
        path = plan_poses(space, (1.0, 1.0, 0.0), (4.5, 1.0, 0.0), steering=steering)
        assert path.outcome is Outcome.NO_WAY
        assert "not connected" in path.reason


def test_ends_at_the_deadline(hall):
    plan_poses(hall, *ENDS, steering=ROBOTS["dubins"], refine=10)
    late = plan_poses(hall, *ENDS, steering=ROBOTS["dubins"], deadline_at=time.monotonic() - 1.0)
    assert late.outcome is Outcome.STOPPED
    assert late.curve is None or not late.is_exact
    began = time.monotonic()
    path = plan_poses(
        hall, *ENDS, steering=ROBOTS["reeds_shepp"], refine=10**6, deadline_at=began + 1.5, seed=1
    )
    assert time.monotonic() - began < 1.5 + 0.4
    assert path.cost <= path.lattice_cost


@pytest.mark.parametrize("name", ROBOTS)
def test_shortening_keeps_the_ends(hall, name):
    space = PoseSpace(hall, hall.rate[None], ROBOTS[name])
    stops = np.array([(1.2, 1.1, 0.0), (3.0, 2.9, 0.5), (8.0, 3.0, 0.0), (14.6, 2.9, 0.0)])
    detour = chain(stops, space)
    assert math.isfinite(space.cost(detour))
    found, cost = shorten_poses(detour, space)
    assert cost < space.cost(detour)
    np.testing.assert_allclose(found.joints()[[0, -1]], detour.joints()[[0, -1]], atol=1e-6)


def test_shortening_leaves_the_best_alone(hall):
    even = PoseSpace(
        hall, np.ones_like(hall.rate)[None] * np.where(np.isfinite(hall.rate), 1, np.inf), ROBOTS["dubins"]
    )
    curve = shortest_curve((2.0, 1.0, 0.3), (9.0, 1.2, 0.0), ROBOTS["dubins"])
    _, cost = shorten_poses(curve, even)
    assert cost == pytest.approx(even.cost(curve), rel=1e-6)
    nowhere = PoseCurve(np.array([1.0, 1.0, 0.0]), np.array([[40.0, 0, 0]]))
    assert shorten_poses(nowhere, even)[1] == math.inf


def test_a_camera_that_looks_ahead_prefers_to_face_landmarks():
    # Landmarks in the south only: going there the camera sees them, going back it does not.
    drawing = """
        ####################
        #..................#
        #..................#
        #..................#
        #..................#
        #..................#
        #..................#
        #..................#
        #A.B..C..D..E..F..G#
        ####################
        """
    world = world_from_ascii(drawing)
    camera = replace(FORWARD_CAMERA, field_of_view=1.6)
    field = build_heading_field(world, camera, resolution=0.5, headings=8)
    weight = 4.0
    r95 = np.array([one.r95 for one in field.trusted().slices])
    rates = 1.0 + weight * np.where(np.isnan(r95), 0.5, r95)
    rates[:, ~field.free] = np.inf
    space = space_of(world, lambda x, y: 0.1 + 0.0 * x, resolution=0.5, radius=0.2)
    south = plan_poses(
        space, (1.5, 4.0, None), (8.5, 1.5, None), steering=Steering("holonomic"), heading_rates=rates
    )
    north = plan_poses(
        space, (8.5, 1.5, None), (1.5, 4.0, None), steering=Steering("holonomic"), heading_rates=rates
    )
    assert south.cost < north.cost
    seen = PoseSpace(space, rates, Steering("holonomic"))
    straight = math.atan2(1.5 - 4.0, 8.5 - 1.5)
    ahead = shortest_curve((1.5, 4.0, straight), (8.5, 1.5, straight), Steering("holonomic"))
    assert south.cost < 0.75 * seen.cost(ahead)
    assert south.length < 1.1 * ahead.length
    # Facing the landmarks is worth turning towards them: it drives south where it can.
    headings = south.poses[1:, 2]
    assert np.sin(headings).mean() < 0


@pytest.mark.parametrize(
    ("start", "goal"), [((math.nan, 1.0, 0.0), (2.0, 1.0, 0.0)), ((1.0, 1.0, 0.0), (2.0, 1.0, math.inf))]
)
def test_impossible_poses(hall, start, goal):
    with pytest.raises(InvalidProblem, match="finite"):
        plan_poses(hall, start, goal, steering=ROBOTS["dubins"])


def test_warm_up_is_quick_the_second_time():
    warm_up()
    began = time.perf_counter()
    warm_up()
    assert time.perf_counter() - began < 3.0
