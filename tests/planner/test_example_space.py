"""The room that kernels are compiled on."""

from planner.example_space import example_space


def test_the_middle_is_free_and_costs_something():
    space = example_space()
    assert space.passable[6, 6]
    assert 2 < space.line_cost([[0.5, 1.5], [2.5, 1.5]]) < 2.3
