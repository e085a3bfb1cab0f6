"""Shortest curves against OMPL's distances, plain search and each other; their cost against dense sums."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ompl import base as ob

from maps.se2 import wrap
from planner.errors import InvalidProblem
from planner.steering import PoseCurve, PoseSpace, Steering, shortest_curve
from tests import oracles
from tests.paths import space_of
from tests.worlds import world_from_ascii

CARS = {"dubins": ob.DubinsStateSpace, "reeds_shepp": ob.ReedsSheppStateSpace}
ROOM = world_from_ascii(
    """
    ####################
    #..................#
    #..................#
    #........##........#
    #........##........#
    #..................#
    #..................#
    ####################
    """
)


def ompl_distance(kinematics, radius, a, b):
    space = CARS[kinematics](radius)
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-1000.0)
    bounds.setHigh(1000.0)
    space.setBounds(bounds)
    states = []
    for x, y, theta in (a, b):
        state = space.allocState()
        state.setX(float(x))
        state.setY(float(y))
        state.setYaw(float(theta))
        states.append(state)
    return space.distance(*states)


def random_poses(rng, n, scale):
    return np.column_stack([rng.normal(size=(n, 2)) * scale, rng.uniform(-math.pi, math.pi, n)])


@pytest.mark.parametrize("kinematics", ["dubins", "reeds_shepp"])
@pytest.mark.parametrize("scale", [0.02, 0.5, 2.0, 40.0])
def test_lengths_are_those_of_ompl_and_curves_end_at_the_goal(kinematics, scale, rng):
    radius = 0.8
    for a, b in zip(random_poses(rng, 150, scale), random_poses(rng, 150, scale), strict=True):
        curve = shortest_curve(a, b, Steering(kinematics, radius))
        assert curve.length == pytest.approx(ompl_distance(kinematics, radius, a, b), abs=1e-9)
        end = oracles.pose_along(a, curve.parts)
        np.testing.assert_allclose(end[:2], b[:2], atol=1e-8)
        assert abs(math.remainder(end[2] - b[2], 2 * math.pi)) < 1e-8
        assert curve.max_curvature <= 1 / radius + 1e-12
        assert kinematics == "reeds_shepp" or (curve.parts[:, 0] > 0).all()


def test_special_poses_are_those_of_ompl_too():
    turns = [0, math.pi / 2, math.pi, -math.pi / 2, 1e-9, math.pi - 1e-9]
    places = [(0, 0), (1, 0), (2, 0), (4, 0), (0, 2), (0, -4), (-1, 0), (1e-9, 0)]
    for kinematics in CARS:
        for x, y in places:
            for theta in turns:
                curve = shortest_curve((0, 0, 0), (x, y, theta), Steering(kinematics, 1.0))
                theirs = ompl_distance(kinematics, 1.0, (0, 0, 0), (x, y, theta))
                # OMPL takes what is nearly a full circle for none.
                assert curve.length == pytest.approx(theirs, abs=1e-6), (kinematics, x, y, theta)


def test_reeds_shepp_is_symmetric_and_never_longer_than_dubins(rng):
    for a, b in zip(random_poses(rng, 100, 2.0), random_poses(rng, 100, 2.0), strict=True):
        there, back = (shortest_curve(p, q, Steering("reeds_shepp", 1.0)).length for p, q in ((a, b), (b, a)))
        assert there == pytest.approx(back, abs=1e-9)
        assert there <= shortest_curve(a, b, Steering("dubins", 1.0)).length + 1e-9
        assert there >= math.hypot(*(a - b)[:2]) - 1e-9


def test_turn_drive_turn():
    curve = shortest_curve((1, 1, 0), (1, 4, math.pi), Steering("differential"))
    np.testing.assert_allclose(curve.parts, [[0, 0, math.pi / 2], [3, 0, 0], [0, 0, math.pi / 2]])
    assert shortest_curve((1, 1, 0), (1, 1, 0), Steering("differential")).parts.shape == (0, 3)
    pure = shortest_curve((1, 1, 0), (1, 1, -1.0), Steering("differential"))
    np.testing.assert_allclose(pure.parts, [[0, 0, -1.0]])


@pytest.mark.parametrize("kinematics", ["differential", "dubins", "reeds_shepp"])
def test_samples_follow_the_curve(kinematics, rng):
    for a, b in zip(random_poses(rng, 20, 2.0), random_poses(rng, 20, 2.0), strict=True):
        curve = shortest_curve(a, b, Steering(kinematics, 0.7))
        found = curve.sample(0.03)
        np.testing.assert_allclose(found.poses[[0, -1]], np.array([a, b]), atol=1e-8)
        gaps = np.hypot(*np.diff(found.poses[:, :2], axis=0).T)
        assert gaps.max() <= 0.03 + 1e-9
        turns = np.abs(wrap(np.diff(found.poses[:, 2])))
        assert turns.max() <= 0.1 + 1e-9
        np.testing.assert_allclose(
            np.diff(found.s)[found.gear[1:] != 0], gaps[found.gear[1:] != 0], rtol=2e-4
        )
        assert found.s[-1] == pytest.approx(curve.length)
        # Heading along the motion, against it in reverse.
        moved = found.gear[1:] != 0
        chord = np.arctan2(*np.diff(found.poses[:, :2], axis=0)[moved].T[::-1])
        middle = found.poses[:-1, 2][moved] + 0.5 * wrap(np.diff(found.poses[:, 2]))[moved]
        off = wrap(chord - middle + np.where(found.gear[1:][moved] < 0, math.pi, 0.0))
        assert np.abs(off).max() < 1e-6


def test_merged_is_the_same_curve():
    parts = [
        [1, 0, 0],
        [2, 0, 0],
        [0, 0, 1],
        [0, 0, 0.5],
        [-1, 0, 0],
        [-1, 0.5, 0],
        [-1e-12, 0, 0],
        [-1, 0.5, 0],
    ]
    curve = PoseCurve(np.zeros(3), np.array(parts))
    merged = curve.merged()
    np.testing.assert_allclose(merged.parts, [[3, 0, 0], [0, 0, 1.5], [-1, 0, 0], [-2, 0.5, 0]])
    np.testing.assert_allclose(merged.joints()[-1], curve.joints()[-1], atol=1e-9)
    assert curve.gear_changes == 1
    assert curve.turned == 1.5


@pytest.fixture(scope="module")
def room():
    return space_of(ROOM, lambda x, y: 0.2 + 0.1 * np.sin(2 * x) * np.cos(y), resolution=0.1, radius=0.3)


def rates_of(space, n):
    wave = 1.0 + 0.5 * np.cos(np.arange(n) * 2 * math.pi / n)[:, None, None]
    return space.rate * wave


@pytest.mark.parametrize("n_headings", [1, 8])
@pytest.mark.parametrize("kinematics", ["differential", "dubins", "reeds_shepp"])
def test_cost_is_the_dense_sum_and_validity_the_dense_clearance(room, kinematics, n_headings, rng):
    steering = Steering(kinematics, 0.5, turn_price=0.3, gear_price=0.7)
    space = PoseSpace(room, rates_of(room, n_headings) if n_headings > 1 else room.rate[None], steering)
    seen = {True: 0, False: 0}
    for _ in range(90):
        a, b = (np.array([*rng.uniform((0.5, 0.5), (9.5, 3.5)), rng.uniform(-3, 3)]) for _ in range(2))
        curve = shortest_curve(a, b, steering)
        cost = space.cost(curve)
        dense, kept = oracles.curve_cost(curve, space, 4e-3)
        if math.isfinite(cost):
            # Chords of at most 0.05 m have one heading, and lie 0.5 mm beside the arc.
            assert cost == pytest.approx(dense, rel=5e-3, abs=0.02 * min(n_headings, 6))
            assert kept >= room.need - 1e-9
        elif kept > room.need + 1e-3:
            assert dense == math.inf
        seen[math.isfinite(cost)] += 1
        table = space.steer_costs(a, b)
        assert table[0, 0] == pytest.approx(cost, rel=1e-12)
        assert math.isinf(space.steer_costs(a, b, max_length=0.99 * curve.length)[0, 0])
    assert min(seen.values()) >= 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"kinematics": "dubins"}, "positive"),
        ({"kinematics": "reeds_shepp", "min_turn_radius": math.nan}, "finite"),
        ({"kinematics": "tank"}, "use one of"),
        ({"kinematics": "differential", "turn_price": -1.0}, "negative"),
        ({"kinematics": "dubins", "min_turn_radius": 1.0, "gear_price": math.inf}, "finite"),
    ],
)
def test_impossible_robots(options, said):
    with pytest.raises(InvalidProblem, match=said):
        Steering(**options)


def test_impossible_poses_and_rates(room):
    with pytest.raises(InvalidProblem, match="finite"):
        shortest_curve((0, 0, math.nan), (1, 1, 0), Steering("dubins", 1.0))
    for rates in (room.rate, np.full((2, *room.frame.shape), np.nan), np.zeros((1, *room.frame.shape))):
        with pytest.raises(InvalidProblem, match="rate"):
            PoseSpace(room, rates, Steering("differential"))
