"""Array types and the one way to freeze them."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def frozen(values: npt.ArrayLike, dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    """Return a C-contiguous, read-only array that nobody else can write to.

    An array that owns its memory and is already read-only is passed through.
    """
    if isinstance(values, np.ndarray) and values.dtype == dtype and values.flags.c_contiguous:
        if not values.flags.writeable and values.base is None:
            return values
        out = values.copy()
    else:
        out = np.array(values, dtype=dtype, order="C")
    out.flags.writeable = False
    return out


def digest(*parts: bytes | str | npt.NDArray[Any] | float | None) -> str:
    """SHA-256 (hex) of a sequence of values, each with its type, shape and length.

    Two sequences that differ in anything but float formatting differ in the digest.
    """
    h = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            head = f"a{part.dtype.str}{part.shape}".encode()
            body = np.ascontiguousarray(part).tobytes()
        elif isinstance(part, bytes):
            head, body = b"b", part
        elif isinstance(part, str):
            head, body = b"s", part.encode()
        elif part is None:
            head, body = b"n", b""
        else:
            head, body = b"f", float(part).hex().encode()
        h.update(head + b":" + str(len(body)).encode() + b":" + body)
    return h.hexdigest()
