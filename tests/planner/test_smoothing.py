"""Smooth trajectories: verified again here, by other means, on rooms, gaps, zigzags and random worlds."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from maps.grid import GridFrame, OccupancyGrid
from maps.landmarks import LandmarkSet
from maps.world import World
from planner.errors import InvalidProblem
from planner.smoothing import CLOSE_SLACK, COST_SLACK, _solve_box, smooth, warm_up
from planner.timing import time_polyline
from tests.oracles import least_in_box
from tests.paths import grid_path, pulled, random_pairs, space_of
from tests.planner.test_timing import check_motion
from tests.worlds import world_from_ascii

HALL = world_from_ascii(
    """
    ################################
    #..............................#
    #..............................#
    #.........######.......####....#
    #.........######.......####....#
    #.........######..##...........#
    #.................##...........#
    #.....####........##...####....#
    #.....####.............####....#
    #..............................#
    ################################
    """
)


def flat(x, y):
    return 0.1 + 0.0 * x


def wavy(x, y):
    return 0.12 + 0.06 * np.sin(1.3 * x) * np.cos(1.7 * y)


def assert_good(result, path, space, max_speed=1.2, max_accel=0.8):
    """Everything that the contract says, from the trajectory alone."""
    trajectory = result.trajectory
    check_motion(trajectory, max_speed, max_accel)
    np.testing.assert_array_equal(trajectory.points[[0, -1]], np.asarray(path, dtype=float)[[0, -1]])
    cost = space.line_cost(trajectory.points)
    assert cost <= space.line_cost(path) * (1 + COST_SLACK) + 1e-9
    # Exact clearance of the samples' polyline, and of a cubic through places and velocities between them.
    p, v, t = trajectory.points, trajectory.velocity, trajectory.t
    legs = space.clearance.segment_distance(p[:-1], p[1:])
    assert legs.min() >= space.radius - 1e-6
    dt = np.diff(t)[:, None]
    for h in (0.25, 0.5, 0.75):
        h00, h10, h01, h11 = (2 * h**3 - 3 * h**2 + 1, h**3 - 2 * h**2 + h, 3 * h**2 - 2 * h**3, h**3 - h**2)
        between = h00 * p[:-1] + h10 * dt * v[:-1] + h01 * p[1:] + h11 * dt * v[1:]
        assert space.clearance.distance(between).min() >= space.radius - 1e-5


def test_box_programmes_match_coordinate_descent(rng):
    for n in (4, 9, 17):
        band = np.zeros((n, 4))
        root = rng.normal(size=(n, 2))
        for i in range(n):
            for k in range(2):
                for j in range(2):
                    if i + max(k, j) < n and j >= k:
                        band[i + k, j - k] += root[i, k] * root[i, j]
        band[:, 0] += 0.3
        slope, low, high = rng.normal(size=n), -rng.uniform(0, 1, n), rng.uniform(0, 1, n)
        low[0] = high[0] = 0.0
        fast = _solve_box(band, slope, low, high)
        np.testing.assert_allclose(fast, least_in_box(band, slope, low, high), atol=1e-5)
        assert fast[0] == 0


def test_an_l_is_rounded_and_much_faster_than_stopping():
    space = space_of(HALL, flat)
    path = np.array([[1.0, 1.0], [2.2, 4.6], [14.0, 4.65]])
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert result.ok, result.reason
    assert_good(result, path, space)
    assert result.trajectory.duration < 0.9 * time_polyline(path, max_speed=1.2, max_accel=0.8).duration
    assert result.stats["cost"] <= result.stats["cost_limit"]


@pytest.mark.parametrize("r95", [flat, wavy])
@pytest.mark.parametrize(("radius", "weight"), [(0.3, 4.0), (0.05, 1.0), (0.45, 10.0)])
def test_random_pairs_in_the_hall(rng, r95, radius, weight):
    space = space_of(HALL, r95, radius=radius, weight=weight)
    gained, close = [], []
    for path in random_pairs(space, rng, 8):
        result = smooth(path, space, max_speed=1.2, max_accel=0.8)
        assert_good(result, path, space)
        slow = time_polyline(path, max_speed=1.2, max_accel=0.8)
        assert result.trajectory.duration <= slow.duration + 1e-9
        gained.append(result.ok)
        close.append(space.line_cost(result.trajectory.points) <= (1 + CLOSE_SLACK) * space.line_cost(path))
    assert all(gained)
    assert np.mean(close) >= 0.85


def test_a_path_that_winds_through_speckles_is_smoothed_at_the_least_cost(rng):
    speckles = rng.random((60, 170)) < 0.1

    def r95(x, y):
        return np.where(speckles[(y / 0.1).astype(int), (x / 0.1).astype(int)], 0.3, 0.05)

    space = space_of(HALL, r95, radius=0.2)
    good = []
    for path in random_pairs(space, rng, 6):
        result = smooth(path, space, max_speed=1.2, max_accel=0.8)
        assert_good(result, path, space)
        good.append(result.ok)
        if result.ok and result.stats["cost"] > (1 + CLOSE_SLACK) * space.line_cost(path):
            tight = smooth(path, space, max_speed=1.2, max_accel=0.8, cost_limit=0.999 * result.stats["cost"])
            assert not tight.ok or tight.stats["cost"] <= 0.999 * result.stats["cost"]
    assert sum(good) >= 5


def test_random_worlds_of_blocks(rng):
    good = total = 0
    for _ in range(4):
        mask = np.ones((40, 60), dtype=bool)
        for _ in range(14):
            r, c = rng.integers(0, 36), rng.integers(0, 54)
            mask[r : r + rng.integers(1, 6), c : c + rng.integers(1, 6)] = False
        mask = np.pad(mask, 1)
        frame = GridFrame(3.0, -7.0, float(rng.uniform(-1, 1)), 0.25, *mask.shape)
        world = World("w", OccupancyGrid(frame, mask, ~mask), LandmarkSet((), np.empty((0, 2))))
        space = space_of(world, wavy, radius=0.3)
        for path in random_pairs(space, rng, 6):
            result = smooth(path, space, max_speed=1.0, max_accel=0.6)
            assert_good(result, path, space, 1.0, 0.6)
            good += result.ok
            total += 1
    assert total == 24
    assert good >= 22


def test_forbidden_cells_are_avoided(rng):
    def r95(x, y):
        return np.where((np.abs(x - 5.5) < 1.6) & (np.abs(y - 2.2) < 0.9), 0.9, 0.1)

    space = space_of(HALL, r95, radius=0.2, max_r95=0.5)
    assert not np.isfinite(space.rate).all()
    good = []
    for path in random_pairs(space, rng, 10):
        result = smooth(path, space, max_speed=1.2, max_accel=0.8)
        assert_good(result, path, space)
        good.append(result.ok)
    assert np.mean(good) >= 0.8


def test_a_gap_hardly_wider_than_the_robot():
    world = world_from_ascii(
        """
        ####################
        #........#.........#
        #........#.........#
        #..................#
        #........#.........#
        #........#.........#
        ####################
        """
    )
    space = space_of(world, flat, radius=0.245, resolution=0.05)
    path = [[1.0, 1.0], [4.4, 1.75], [5.6, 1.75], [8.5, 2.7]]
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert_good(result, path, space)
    assert result.ok, result.reason


def test_a_passage_without_width_is_crossed_straight_and_the_rest_is_smooth():
    def corner(x, y):
        # Two forbidden quarters that meet at (8, 3): the way between them is a point.
        return np.where((x > 8.0) == (y > 3.0), 0.1, 0.9)

    world = world_from_ascii("\n".join(["#" * 34, *["#" + "." * 32 + "#"] * 12, "#" * 34]))
    space = space_of(world, corner, radius=0.2, max_r95=0.5)
    path = [[1.0, 0.9], [3.0, 2.6], [7.0, 2.0], [9.0, 4.0], [12.0, 3.5], [15.0, 5.5]]
    assert math.isfinite(space.line_cost(path))
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert result.ok, result.reason
    assert result.stats["cuts"] >= 1
    assert "smooth path" in result.reason
    assert_good(result, path, space)
    slow = time_polyline(path, max_speed=1.2, max_accel=0.8)
    assert result.trajectory.duration < slow.duration


def test_a_goal_that_is_just_far_enough_from_the_wall():
    space = space_of(HALL, flat)
    path = [[1.0, 1.0], [2.2, 4.6], [14.0, 4.7]]
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert result.ok, result.reason
    assert_good(result, path, space)


def test_a_robot_exactly_as_wide_as_the_corridor_drives_straight():
    world = world_from_ascii("############\n#..........#\n############", 0.5)
    space = space_of(world, flat, radius=0.25, resolution=0.1)
    path = [[0.8, 0.75], [3.0, 0.75], [5.0, 0.75]]
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert result.ok
    assert_good(result, path, space)


def test_zigzag():
    space = space_of(HALL, flat, radius=0.2)
    x = np.arange(1.0, 15.0, 0.5)
    path = np.column_stack([x, 4.6 + 0.15 * (-1.0) ** np.arange(len(x))])
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert result.ok
    assert_good(result, path, space)
    assert result.trajectory.duration < 14 / 1.2 + 2.0


def test_a_single_segment_is_already_the_fastest():
    space = space_of(HALL, flat)
    path = [[1.0, 1.0], [4.0, 4.6]]
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert result.ok
    assert_good(result, path, space)
    assert result.trajectory.duration == time_polyline(path, max_speed=1.2, max_accel=0.8).duration


@pytest.mark.parametrize("path", [[[1.0, 1.0]], [[1.0, 1.0], [1.0, 1.0]]])
def test_start_is_goal(path):
    result = smooth(path, space_of(HALL, flat), max_speed=1.2, max_accel=0.8)
    assert result.ok
    assert result.trajectory.duration == 0


def test_very_short_paths(rng):
    space = space_of(HALL, flat)
    for size in (1e-3, 0.01, 0.1, 0.4):
        path = np.array([[2.0, 4.0], [2.0 + size, 4.0], [2.0 + size, 4.0 + 0.3 * size]])
        result = smooth(path, space, max_speed=1.2, max_accel=0.8)
        assert_good(result, path, space)


def test_two_hundred_metres_in_a_fraction_of_a_second():
    rows = ["#" * 402]
    for k in range(20):
        wall = "#" * 20
        rows.append("#" + ("." * 20 + wall if k < 8 else wall + "." * 20 if k > 11 else "." * 40) * 10 + "#")
    world = world_from_ascii("\n".join([*rows, "#" * 402]), 0.5)
    space = space_of(world, wavy, resolution=0.5, radius=0.4)
    path = pulled(space, grid_path(space, (2.0, 9.0), (199.0, 2.0)))
    smooth(path, space, max_speed=1.2, max_accel=0.8)
    began = time.perf_counter()
    result = smooth(path, space, max_speed=1.2, max_accel=0.8)
    assert time.perf_counter() - began < 1.0
    assert result.ok, result.reason
    assert_good(result, path, space)


def test_a_cost_limit_below_every_smooth_path_falls_back_with_a_reason():
    space = space_of(HALL, flat)
    path = [[1.0, 1.0], [2.2, 4.6], [14.0, 4.65]]
    result = smooth(path, space, max_speed=1.2, max_accel=0.8, cost_limit=0.5 * space.line_cost(path))
    assert not result.ok
    assert "allowed is" in result.reason
    slow = time_polyline(path, max_speed=1.2, max_accel=0.8)
    np.testing.assert_array_equal(result.trajectory.points, slow.points)
    straight = smooth(path[:2], space, max_speed=1.2, max_accel=0.8, cost_limit=0.1)
    assert not straight.ok


def test_a_cost_limit_is_kept():
    space = space_of(HALL, wavy)
    path = pulled(space, grid_path(space, (1.0, 1.0), (14.6, 4.6)))
    free = smooth(path, space, max_speed=1.2, max_accel=0.8)
    limit = 0.5 * (space.line_cost(path) + min(free.stats["cost"], space.line_cost(path)))
    result = smooth(path, space, max_speed=1.2, max_accel=0.8, cost_limit=limit)
    if result.ok:
        assert space.line_cost(result.trajectory.points) <= limit


def test_a_path_that_is_not_allowed_is_not_smoothed():
    space = space_of(HALL, flat)
    result = smooth([[1.0, 1.0], [6.0, 3.5], [14.0, 4.0]], space, max_speed=1.2, max_accel=0.8)
    assert not result.ok
    assert "not allowed" in result.reason


def test_a_deadline_that_is_over_falls_back():
    space = space_of(HALL, flat)
    path = [[1.0, 1.0], [2.2, 4.6], [14.0, 4.65]]
    result = smooth(path, space, max_speed=1.2, max_accel=0.8, deadline_at=time.monotonic() - 1.0)
    assert not result.ok
    assert "deadline" in result.reason
    assert_good(result, path, space)


def test_the_same_question_has_the_same_answer():
    space = space_of(HALL, wavy)
    path = pulled(space, grid_path(space, (1.0, 1.0), (14.6, 4.6)))
    first, second = (smooth(path, space, max_speed=1.2, max_accel=0.8).trajectory for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)
    np.testing.assert_array_equal(first.t, second.t)


def test_higher_limits_are_never_slower():
    space = space_of(HALL, wavy)
    path = pulled(space, grid_path(space, (1.0, 1.0), (14.6, 4.6)))
    times = [
        smooth(path, space, max_speed=v, max_accel=a).trajectory.duration
        for v, a in ((0.5, 0.3), (1.0, 0.5), (2.0, 1.0), (4.0, 4.0))
    ]
    assert times == sorted(times, reverse=True)
    assert times[-1] > 14 / 4.0


def test_impossible_numbers():
    space = space_of(HALL, flat)
    with pytest.raises(InvalidProblem):
        smooth([[0, math.nan]], space, max_speed=1.0, max_accel=1.0)
    with pytest.raises(InvalidProblem):
        smooth([[1, 1], [2, 2]], space, max_speed=-1.0, max_accel=1.0)


def test_warm_up_leaves_little_to_compile():
    warm_up()
    began = time.perf_counter()
    warm_up()
    assert time.perf_counter() - began < 0.5
