from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from maps.errors import DuplicateLandmark, InvalidLandmark
from maps.landmarks import MAX_LANDMARKS, LandmarkSet

XY = [[0, 0], [1, 0], [0, 2]]
IDS = ("a", "b", "c")


def test_defaults():
    marks = LandmarkSet(IDS, XY, facing=[math.nan, 0.5, -1.0])
    np.testing.assert_allclose(marks.half_angle, [math.pi, math.pi / 2, math.pi / 2])
    np.testing.assert_array_equal(marks.sigma, [0, 0, 0])
    np.testing.assert_array_equal(marks.has_facing, [False, True, True])
    assert len(marks) == 3
    assert len(LandmarkSet.empty()) == 0
    assert LandmarkSet.empty().positions.shape == (0, 2)


def test_angles_are_made_canonical():
    marks = LandmarkSet(IDS, XY, facing=[math.pi, 7.0, math.nan], half_angle=[math.nan, 1.0, 1.0])
    np.testing.assert_allclose(marks.facing, [-math.pi, 7 - 2 * math.pi, math.nan])
    np.testing.assert_allclose(marks.half_angle, [math.pi / 2, 1.0, math.pi])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"positions": [[0, 0], [1, math.nan], [0, 2]]}, r"'b' stands at \(1.0, nan\)"),
        ({"positions": [[0, 0], [1, 2]]}, "3 landmark ids but 2 positions"),
        ({"positions": [0, 0, 1, 0, 0, 2]}, r"shape \(6,\)"),
        ({"positions": [[0, 0, 0]] * 3}, r"shape \(3, 3\)"),
        ({"facing": [0, 0]}, "3 landmark ids but 2 facing"),
        ({"facing": [0, math.inf, 0]}, "'b' has facing inf"),
        ({"half_angle": [0, 1, 1]}, "'a' has half angle 0.0"),
        ({"facing": [0, 0, 0], "half_angle": [1, 1, 3.2]}, "'c' has half angle 3.2"),
        ({"facing": [0, 0, 0], "half_angle": [1, 1, math.inf]}, "'c' has half angle inf"),
        ({"sigma": [0, 0, -1e-9]}, "'c' has survey sigma -1e-09"),
        ({"sigma": [0, 0, math.nan]}, "'c' has survey sigma nan"),
        ({"sigma": [0, math.inf, 0]}, "'b' has survey sigma inf"),
        ({"ids": ("a", "", "c")}, "number 1 has the id ''"),
        ({"ids": ("a", "b\n", "c")}, "number 1 has the id"),
        ({"ids": ("a", "b", "x" * 201)}, "number 2 has the id"),
    ],
)
def test_impossible_values_are_named(change, says):
    with pytest.raises(InvalidLandmark, match=says):
        LandmarkSet(**{"ids": IDS, "positions": XY} | change)


def test_duplicates_are_named():
    with pytest.raises(DuplicateLandmark, match=r"'a' is used twice \(numbers 0 and 2\)"):
        LandmarkSet(("a", "b", "a"), XY)
    with pytest.raises(DuplicateLandmark, match="'a' and 'c' both stand at"):
        LandmarkSet(IDS, [[0, 0], [1, 0], [5e-7, -5e-7]])
    LandmarkSet(IDS, [[0, 0], [1, 0], [2e-6, 0]])


def test_coincidence_is_found_among_many(rng):
    n = 3000
    xy = rng.integers(0, 100_000, (n, 2)) * 0.01
    xy = np.unique(xy, axis=0)
    ids = tuple(f"L{i}" for i in range(len(xy)))
    LandmarkSet(ids, xy)
    xy[17] = xy[-5] + 1e-7
    with pytest.raises(DuplicateLandmark):
        LandmarkSet(ids, xy)
    # A wall of landmarks in one column is not slow and not a duplicate.
    LandmarkSet(ids, np.stack([np.zeros(len(xy)), np.arange(len(xy))], axis=1))


def test_too_many_are_refused():
    n = MAX_LANDMARKS + 1
    with pytest.raises(InvalidLandmark, match=f"{n} landmarks, the limit is {MAX_LANDMARKS}"):
        LandmarkSet(tuple(map(str, range(n))), np.zeros((n, 2)))


def test_sets_are_values():
    source = np.array(XY, dtype=float)
    marks = LandmarkSet(IDS, source, [0, math.nan, 1], [1, 1, 1], [0.1, 0, 0])
    source[:] = 7
    np.testing.assert_array_equal(marks.positions, XY)
    with pytest.raises(ValueError, match="read-only"):
        marks.sigma[0] = 1
    assert pickle.loads(pickle.dumps(marks)).content_hash() == marks.content_hash()
    part = marks.subset([2, 0])
    assert part.ids == ("c", "a")
    np.testing.assert_array_equal(part.positions, [[0, 2], [0, 0]])
    np.testing.assert_array_equal(part.sigma, [0, 0.1])
    np.testing.assert_array_equal(part.facing, [1, 0])


def test_the_hash_sees_everything():
    base = {"ids": IDS, "positions": XY, "facing": [0, 1, 2], "half_angle": [1, 1, 1], "sigma": [0, 0, 0]}
    changes = [
        {},
        {"ids": ("a", "b", "d")},
        {"positions": [[0, 0], [1, 0], [0, 2.0000001]]},
        {"facing": [0, 1, math.nan]},
        {"facing": [0, 1, 2.1]},
        {"half_angle": [1, 1, 1.1]},
        {"sigma": [0, 0, 0.1]},
    ]
    assert len({LandmarkSet(**base | c).content_hash() for c in changes}) == len(changes)
    assert LandmarkSet(**base).subset([1, 0, 2]).content_hash() != LandmarkSet(**base).content_hash()
