"""Search over poses against plain Dijkstra over the same moves, and in worlds where kinematics decide."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from planner.errors import InvalidProblem
from planner.lattice import End, Outcome, lattice_for, search_lattice
from planner.primitives import HEADING_COUNTS, lattice_vectors, primitives_for
from planner.steering import PoseCurve, PoseSpace, Steering
from tests import oracles
from tests.paths import space_of
from tests.worlds import place_in_ascii, world_from_ascii

TINY = world_from_ascii(
    """
    ###########
    #.........#
    #.........#
    #....#....#
    #....#....#
    #.........#
    ###########
    """
)
ROBOTS = {
    "holonomic": Steering("holonomic"),
    "differential": Steering("differential", turn_price=0.4),
    "dubins": Steering("dubins", 0.25),
    "reeds_shepp": Steering("reeds_shepp", 0.4, gear_price=0.5),
}


def space_over(world, steering, *, n_bins=1, resolution=0.2, radius=0.2, yaw=0.0):
    space = space_of(
        world, lambda x, y: 0.1 + 0.05 * np.sin(x) + 0.0 * y, resolution=resolution, radius=radius
    )
    wave = (
        1.0 + 0.8 * np.sin(np.arange(n_bins) * 2 * math.pi / n_bins + 0.3)[:, None, None]
        if n_bins > 1
        else 1.0
    )
    return PoseSpace(space, space.rate[None] * wave, steering)


@pytest.mark.parametrize("count", HEADING_COUNTS)
def test_headings_are_those_of_their_vectors(count):
    vectors = lattice_vectors(count)
    assert len(vectors) == count
    angles = np.arctan2(vectors[:, 1], vectors[:, 0]) % (2 * math.pi)
    assert (np.diff(angles) > 0).all()
    assert np.diff(angles).max() < 1.35 * 2 * math.pi / count
    # A turn by a quarter and a mirror lead to the same set.
    as_set = set(map(tuple, vectors.tolist()))
    assert as_set == {(-y, x) for x, y in as_set} == {(x, -y) for x, y in as_set}


@pytest.mark.parametrize("count", HEADING_COUNTS)
@pytest.mark.parametrize("name", ROBOTS)
def test_moves_lead_from_pose_to_pose(count, name):
    steering = ROBOTS[name]
    made = primitives_for(steering, 0.1, 0.3, count, 1)
    first, heads, extra, starts, _, pieces, *_ = made.arrays
    for p in range(made.n_moves):
        i, j, rows, cols, gear = heads[p]
        assert first[i] <= p < first[i + 1]
        x, y, theta = oracles.pose_along((0.0, 0.0, made.headings[i]), made.parts[p])
        assert (x, y) == pytest.approx((0.1 * cols, 0.1 * rows), abs=1e-9)
        assert abs(math.remainder(theta - made.headings[j], 2 * math.pi)) < 1e-9
        length = np.abs(made.parts[p][:, 0]).sum()
        assert pieces[starts[p] : starts[p + 1], 0].sum() == pytest.approx(length)
        assert extra[p] == pytest.approx(steering.turn_price * np.abs(made.parts[p][:, 2]).sum())
        assert set(np.sign(made.parts[p][:, 0])) <= {0, gear}
        if steering.is_car:
            assert np.abs(made.parts[p][:, 1]).max() <= 1 / steering.min_turn_radius + 1e-9
    if steering.is_car:
        turns = {(int(i), int(j)) for i, j, *_ in heads if i != j}
        assert len(turns) == 4 * count


@pytest.mark.parametrize("n_bins", [1, 8])
@pytest.mark.parametrize("name", ROBOTS)
def test_cost_is_that_of_plain_dijkstra(name, n_bins, rng):
    space = space_over(TINY, ROBOTS[name], n_bins=n_bins)
    lattice = lattice_for(space, n_headings=8)
    found = 0
    for _ in range(4):
        ends = [End(*rng.uniform((0.8, 0.8), (4.7, 2.7)), rng.uniform(-3, 3)) for _ in range(2)]
        way = search_lattice(lattice, *ends)
        expected = oracles.lattice_dijkstra(lattice, *ends)
        assert way.cost == pytest.approx(expected, rel=1e-9)
        assert (way.outcome is Outcome.FOUND) == math.isfinite(expected)
        if way.curve is not None:
            found += 1
            # Arcs that follow each other are made one and cut into chords anew.
            assert space.cost(way.curve) == pytest.approx(way.cost, rel=1e-5 if n_bins == 1 else 0.03)
            end = way.curve.joints()[-1]
            assert (end[0], end[1]) == pytest.approx((ends[1].x, ends[1].y), abs=1e-7)
            assert abs(math.remainder(end[2] - ends[1].heading, 2 * math.pi)) < 1e-6
            np.testing.assert_allclose(way.curve.start, [ends[0].x, ends[0].y, ends[0].heading])
    assert found >= 2


@pytest.mark.parametrize("name", ROBOTS)
def test_heuristic_is_the_cost_without_headings(name):
    space = space_over(TINY, ROBOTS[name], n_bins=8)
    lattice = lattice_for(space, n_headings=8)
    goal = End(4.5, 2.5, 1.0)
    way = search_lattice(lattice, End(1.0, 1.0, 0.0), goal)
    expected = oracles.lattice_without_headings(lattice, goal)
    assert (way.to_go <= expected + 1e-9).all()
    assert (way.to_go > expected - 1e-9).sum() > 30
    # Consistent: no move gains more than it costs.
    for p, (_, _, rows, cols, _) in enumerate(lattice.primitives.arrays[1].tolist()):
        for r, c in np.argwhere(space.cost_space.centre_clearance >= 0.2):
            step = oracles.lattice_move(lattice, p, r, c)
            if math.isfinite(step):
                assert way.to_go[r, c] <= step + way.to_go[r + rows, c + cols] + 1e-9


DEAD_END = """
    ##########################
    #........................#
    #........................#
    #........................#
    #........................#
    #........................#
    ############...###########
    ############...###########
    ############...###########
    ############.s.###########
    ############...###########
    ##########################
    """


def test_a_car_cannot_turn_in_a_dead_end_but_reverses_out_of_it():
    world = world_from_ascii(DEAD_END)
    start = End(*place_in_ascii(DEAD_END, "s"), -math.pi / 2)
    goal = End(3.0, 4.5, math.pi)
    forwards = search_lattice(
        lattice_for(space_over(world, Steering("dubins", 1.0), radius=0.3)), start, goal
    )
    assert forwards.outcome is Outcome.NO_WAY
    assert forwards.curve is None
    out = search_lattice(
        lattice_for(space_over(world, Steering("reeds_shepp", 1.0, gear_price=0.5), radius=0.3)), start, goal
    )
    assert out.outcome is Outcome.FOUND
    assert out.curve.parts[0, 0] < 0
    assert 1 <= out.curve.gear_changes <= 3
    # Facing outwards, it leaves forwards.
    facing = replace(start, heading=math.pi / 2)
    ahead = search_lattice(lattice_for(space_over(world, Steering("dubins", 1.0), radius=0.3)), facing, goal)
    assert ahead.outcome is Outcome.FOUND
    # One that turns in place does not care.
    turning = search_lattice(
        lattice_for(space_over(world, Steering("differential"), radius=0.3)), start, goal
    )
    assert turning.outcome is Outcome.FOUND
    assert turning.curve.turned >= math.pi / 2


def test_turns_in_place_are_weighed_against_the_way():
    world = world_from_ascii(DEAD_END)
    ends = End(1.5, 3.5), End(11.0, 5.0)
    costs = []
    turned = []
    for price in (0.0, 0.5, 5.0):
        space = space_over(world, Steering("differential", turn_price=price), radius=0.3)
        way = search_lattice(lattice_for(space), *ends)
        costs.append(way.cost)
        turned.append(way.curve.turned)
    assert costs == sorted(costs)
    assert turned == sorted(turned, reverse=True)


def test_a_gear_change_costs_its_price():
    world = world_from_ascii(DEAD_END)
    start, goal = End(3.0, 4.0, 0.0), End(3.0, 4.6, math.pi)
    few = search_lattice(
        lattice_for(space_over(world, Steering("reeds_shepp", 0.8, gear_price=9.0), radius=0.3)), start, goal
    )
    many = search_lattice(
        lattice_for(space_over(world, Steering("reeds_shepp", 0.8, gear_price=0.0), radius=0.3)), start, goal
    )
    assert few.curve.gear_changes < many.curve.gear_changes
    assert few.curve.length > many.curve.length


@pytest.mark.parametrize("name", ROBOTS)
def test_a_free_heading_is_never_dearer(name):
    space = space_over(TINY, ROBOTS[name])
    lattice = lattice_for(space)
    place, goal = (1.03, 1.01), (4.41, 2.57)
    free = search_lattice(lattice, End(*place), End(*goal)).cost
    for heading in lattice.primitives.headings[::3]:
        fixed = search_lattice(lattice, End(*place, float(heading)), End(*goal, 0.0)).cost
        assert free <= fixed + 1e-9


def test_the_way_prefers_headings_with_a_small_rate():
    # Driving east is dear, west is cheap, the rest in between: there and back take different ways.
    world = world_from_ascii(DEAD_END)
    plain = space_over(world, Steering("holonomic"), radius=0.3)
    facing = 1.0 - 0.9 * np.cos(np.arange(16) * 2 * math.pi / 16)
    space = PoseSpace(
        plain.cost_space,
        np.stack(
            [np.where(np.isfinite(plain.cost_space.rate), 1.05 - f * 0.5, np.inf) + 0.5 for f in facing]
        ),
        plain.steering,
    )
    lattice = lattice_for(space)
    east = search_lattice(lattice, End(1.5, 4.0), End(11.5, 4.0))
    west = search_lattice(lattice, End(11.5, 4.0), End(1.5, 4.0))
    assert west.cost < 0.75 * east.cost


def test_stops_when_told():
    space = space_over(world_from_ascii(DEAD_END), ROBOTS["reeds_shepp"], resolution=0.1)
    lattice = lattice_for(space)
    began = time.perf_counter()
    way = search_lattice(lattice, End(1.5, 4.0, 0.0), End(11.0, 4.0, 3.0), stop=np.ones(1, dtype=np.uint8))
    assert way.outcome is Outcome.STOPPED
    assert time.perf_counter() - began < 2.0


def test_impossible_lattices():
    space = space_over(TINY, ROBOTS["dubins"])
    with pytest.raises(InvalidProblem, match="headings"):
        lattice_for(space, n_headings=12)
    with pytest.raises(InvalidProblem, match="finite"):
        End(math.nan, 0.0)
    with pytest.raises(InvalidProblem, match="finite"):
        End(0.0, 0.0, math.inf)


def test_moves_of_a_turned_grid_are_turned_too(rng):
    space = space_over(TINY, ROBOTS["dubins"])
    made = primitives_for(ROBOTS["dubins"], 0.2, 0.0, 16, 1)
    centre = space.cost_space.centre(8, 12)
    for p in rng.choice(made.n_moves, 20):
        curve = PoseCurve(np.array([*centre, made.headings[made.arrays[1][p, 0]]]), made.parts[p])
        assert oracles.lattice_move(lattice_for(space), p, 8, 12) == pytest.approx(
            space.cost(curve), rel=1e-12
        )
