"""Stretches: rows of looks that are made up, so that every number is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.stretches import Candidates, stretches_of


def candidates(r95, pan, *, rate=1.0, t=None, is_endless=False):
    """Stations 1 m apart, a second each."""
    r95, pan = np.array(r95, dtype=float), np.array(pan, dtype=float)
    s = np.arange(len(r95), dtype=float)
    triplets = np.arange(3 * r95.shape[1]).reshape(-1, 3)
    return Candidates(
        s, s if t is None else np.array(t), triplets, r95, np.nanmin(r95, axis=1), pan, rate, is_endless
    )


def kinds(rows):
    return [(row.kind, row.t_start, row.t_end) for row in rows]


NAN = math.nan


def test_a_turn_takes_the_same_share_of_both_half_cells():
    two = candidates([[0.1, 0.3], [0.2, 0.3], [0.1, 0.5], [0.1, 0.4]], [[0.0, 0.6]] * 4)
    rows = stretches_of(two, [(0, 0), (1, 0), (2, 1), (3, 1)])
    assert [kind for kind, *_ in kinds(rows)] == ["fix", "turning", "fix"]
    first, turn, second = rows
    assert (first.t_end, turn.t_start) == pytest.approx((1.2, 1.2))
    assert (turn.t_end, second.t_start) == pytest.approx((1.8, 1.8))
    assert (turn.pan_start, turn.pan_end) == (0.0, 0.6)
    assert second.turn_from == pytest.approx(1.2)
    assert first.turn_from is None
    # Half a metre of the first cell, 0.7 m of the second.
    assert first.mean_r95 == pytest.approx((0.5 * 0.1 + 0.7 * 0.2) / 1.2)
    assert first.max_r95 == 0.2
    assert second.pan == ((pytest.approx(1.8), 0.6), (2.0, 0.6), (3.0, 0.6), (3.0, 0.6))
    assert first.usable_after == pytest.approx(1.8)
    # A second longer on the first triplet is no loss: r95 of the cells from 1.2 to 2.2 m.
    assert first.late_r95 == pytest.approx(0.2)
    # But the turn then begins at 2.2 s and ends at 2.8 s, as long as before.
    assert first.late_blind == pytest.approx(0.0)
    assert second.late_r95 is None
    assert second.late_blind is None


def test_what_it_costs_to_be_late():
    # The first triplet is lost at station 2; the second is 2 rad away, for which there are 3 s.
    r95 = [[0.1, NAN], [0.1, NAN], [NAN, NAN], [NAN, NAN], [NAN, 0.2], [NAN, 0.2], [NAN, 0.2]]
    pan = [[0.0, NAN], [0.0, NAN], [NAN, NAN], [NAN, NAN], [NAN, 2.0], [NAN, 2.0], [NAN, 2.0]]
    with np.errstate(all="ignore"):
        seen = [np.array(x) for x in (r95, pan)]
    s = np.arange(7.0)
    two = Candidates(s, s, np.arange(6).reshape(2, 3), seen[0], np.full(7, 0.1), seen[1], 0.8, False)
    looks = [(0, 0), (1, 0), (4, 1), (5, 1), (6, 1)]
    first, turn, second = stretches_of(two, looks)
    # 2.5 s of turning, 2 s without anything to see: a quarter of a second from each side.
    assert (first.t_end, turn.t_end, second.t_start) == pytest.approx((1.25, 3.75, 3.75))
    assert second.turn_from == pytest.approx(1.25)
    assert first.usable_after == 0.0
    # A second more: a quarter of it with a fix, the rest without; then the whole turn. It ends at 4.75 s.
    assert first.late_r95 is None
    assert first.late_blind == pytest.approx(0.75 + 2.5 - 2.5)
    quick = Candidates(s, s, np.arange(6).reshape(2, 3), seen[0], np.full(7, 0.1), seen[1], 4.0, False)
    rows = stretches_of(quick, looks)
    assert kinds(rows)[1:3] == [("turning", 1.5, 2.0), ("blind", 2.0, 3.5)]
    assert rows[2].pan_start == rows[2].pan_end == 2.0
    assert rows[3].turn_from == pytest.approx(3.0)
    # It has a second and a half to spare.
    assert rows[0].late_blind == 0.0


def test_what_is_never_looked_at_is_not_listed():
    # A second to turn to the second triplet, and a second to turn on: there is no time to look at it.
    three = candidates([[0.1, 0.1, 0.1]] * 5, [[0.0, 1.0, 2.0]] * 5)
    rows = stretches_of(three, [(0, 0), (1, 0), (2, 1), (3, 2), (4, 2)])
    assert kinds(rows) == [("fix", 0.0, 1.0), ("turning", 1.0, 3.0), ("fix", 3.0, 4.0)]
    assert rows[-1].triplet == (6, 7, 8)


def test_nothing_to_look_at():
    nothing = Candidates(
        np.arange(3.0),
        np.arange(3.0),
        np.empty((0, 3)),
        np.empty((3, 0)),
        np.full(3, NAN),
        np.empty((3, 0)),
        1.0,
        True,
    )
    [row] = stretches_of(nothing, [])
    assert (row.kind, row.start, row.end, row.pan) == ("blind", 0.0, 2.0, ())


def test_a_regained_triplet_is_no_switch_and_a_quick_one_no_turn():
    r95 = [[0.1], [0.1], [NAN], [0.1], [0.1]]
    s = np.arange(5.0)
    for rate in (1.0, math.inf):
        one = Candidates(
            s,
            s,
            np.arange(3).reshape(1, 3),
            np.array(r95),
            np.full(5, 0.1),
            np.array([[0.0], [0.0], [NAN], [3.1], [-3.1]]),
            rate,
            True,
        )
        rows = stretches_of(one, [(0, 0), (1, 0), (3, 0), (4, 0)])
        found = [row.kind for row in rows]
        assert found == (["fix", "turning", "fix"] if rate == 1.0 else ["fix", "blind", "fix"])
        assert rows[-1].pan_end == pytest.approx(-3.1)
