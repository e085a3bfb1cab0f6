"""Time of a plan."""

from __future__ import annotations

import time

from planner.clock import Clock


def test_shares_and_stages():
    clock = Clock(10.0)
    assert clock.at(0.5) == clock.began + 5.0
    assert not clock.is_over()
    assert clock.is_over(0.0)
    for _ in range(2):
        with clock.stage("a"):
            time.sleep(0.002)
    assert 0.004 <= clock.seconds["a"] <= clock.elapsed


def test_the_flag_is_set_at_the_deadline():
    clock = Clock(0.02)
    with clock.stop_flag() as flag:
        assert flag[0] == 0
        until = time.monotonic() + 5.0
        while flag[0] == 0 and time.monotonic() < until:
            time.sleep(0.001)
        assert flag[0] == 1
    with clock.stop_flag() as flag:
        assert flag[0] == 1
