"""Kernels of poses: words, curves, chains, the lattice and its moves; small enough to run uncompiled too."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from planner.example_space import example_space
from planner.kernels import pose_chain, steering
from planner.kernels.reeds_shepp import N_FAMILIES, reeds_shepp_word
from planner.lattice import End, lattice_for, search_lattice
from planner.pose_shorten import shorten_poses
from planner.steering import PoseSpace, Steering
from tests import oracles


def test_reeds_shepp_words_of_every_family_lead_there(rng):
    seen = set()
    for _ in range(300):
        x, y = rng.normal(size=2) * rng.choice([0.3, 2.0, 8.0])
        phi = rng.uniform(-math.pi, math.pi)
        word = np.zeros((5, 2))
        n, total = reeds_shepp_word(x, y, phi, word)
        end = oracles.pose_along((0.0, 0.0, 0.0), [(length, turn, 0.0) for length, turn in word[:n]])
        assert end[:2] == pytest.approx((x, y), abs=1e-9)
        assert abs(math.remainder(end[2] - phi, 2 * math.pi)) < 1e-9
        assert np.abs(word[:n, 0]).sum() == pytest.approx(total, abs=1e-9)
        seen.add(tuple(word[:n, 1]))
    assert len(seen) > N_FAMILIES


@pytest.mark.parametrize("kind", [steering.TURNING, steering.DUBINS, steering.REEDS_SHEPP])
def test_curves_lead_there(kind, rng):
    for _ in range(60):
        a, b = (np.array([*rng.normal(size=2), rng.uniform(-3, 3)]) for _ in range(2))
        parts = np.zeros((5, 3))
        n, length = steering.steer(kind, a, b, 0.5, parts)
        assert np.abs(parts[:n, 0]).sum() == pytest.approx(length, abs=1e-8)
        end = oracles.pose_along(a, parts[:n])
        assert end[:2] == pytest.approx(tuple(b[:2]), abs=1e-8)
        assert abs(math.remainder(end[2] - b[2], 2 * math.pi)) < 1e-7


def test_small_steps():
    assert steering.wrapped(math.pi) == -math.pi
    assert steering.wrapped(-7.0) == pytest.approx(-7.0 + 2 * math.pi)
    assert [steering.heading_bin(t, 4) for t in (0.0, 0.8, -0.8, 3.1, -3.1)] == [0, 1, 3, 2, 2]
    x, y, theta = steering.advance(1.0, 2.0, 0.3, 1e-6, 0.5)
    assert (x, y, theta) == pytest.approx(oracles.pose_along((1.0, 2.0, 0.3), [(1e-6, 0.5, 0.0)]), abs=1e-15)
    assert steering.chords_of(1.0, 0.0) == 1
    assert steering.chords_of(1.0, 2.0) >= 1.0 / math.sqrt(8 * 5e-4 / 2.0)


@pytest.mark.parametrize("kinematics", ["differential", "dubins", "reeds_shepp"])
def test_a_small_search_is_that_of_plain_dijkstra(kinematics):
    plain = example_space()
    space = PoseSpace(plain, plain.rate[None], Steering(kinematics, 0.4, turn_price=0.2, gear_price=0.3))
    lattice = lattice_for(space, n_headings=8)
    start, goal = End(0.6, 0.7, 1.0), End(2.3, 1.9, -2.0)
    way = search_lattice(lattice, start, goal)
    assert way.cost == pytest.approx(oracles.lattice_dijkstra(lattice, start, goal), rel=1e-9)
    found, cost = shorten_poses(way.curve, space)
    assert cost <= space.cost(way.curve)
    # A chain through the ends of the parts costs what its curves do.
    poses = np.array(found.joints())
    if kinematics != "differential":
        total = pose_chain.chain_cost(
            space.steering.kind, 0.4, poses, 0, len(poses) - 1, 0.2, 0.3, *space.kernel_args
        )
        assert total == pytest.approx(cost, rel=1e-3)
        links = [
            pose_chain.pose_link_cost(*a, *b, space.steering.kind, 0.4, 0.2, 0.3, *space.kernel_args)
            for a, b in itertools.pairwise(poses)
        ]
        assert sum(links) + 0.3 * found.gear_changes == pytest.approx(total, rel=1e-6)
