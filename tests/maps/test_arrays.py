from __future__ import annotations

import numpy as np
import pytest

from maps.arrays import digest, frozen


def test_frozen_arrays_belong_to_nobody_else():
    source = np.arange(6.0).reshape(2, 3)
    out = frozen(source)
    source[0, 0] = 9
    assert out[0, 0] == 0
    assert out.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        out[0, 0] = 1


def test_frozen_arrays_pass_through_and_views_are_copied():
    out = frozen([1, 2, 3])
    assert frozen(out) is out
    view = out[1:]
    assert frozen(view) is not view
    assert frozen(view).base is None
    assert frozen(out, np.int64).dtype == np.int64
    read_only_view = np.arange(4.0)[:]
    read_only_view.flags.writeable = False
    assert frozen(read_only_view) is not read_only_view
    assert frozen(np.asfortranarray(np.ones((2, 3)))).flags.c_contiguous


def test_digests_tell_values_types_shapes_and_borders_apart():
    parts = [
        ("ab", "c"),
        ("a", "bc"),
        ("abc",),
        (b"abc",),
        (None,),
        ("",),
        (b"",),
        (1.0,),
        ("1.0",),
        (0.0,),
        (-0.0,),
        (np.zeros(2),),
        (np.zeros((2, 1)),),
        (np.zeros(2, dtype=np.float32),),
        (np.zeros(16, dtype=np.uint8),),
    ]
    assert len({digest(*p) for p in parts}) == len(parts)
    assert digest(1) == digest(1.0)
    strided = np.arange(8.0)[::2]
    assert digest(strided) == digest(strided.copy())
