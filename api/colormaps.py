"""Colour maps as tables of 256 colours.

Anchors of viridis and magma (Smith and van der Walt 2015) and cividis (Nuñez, Anderton, Renslow 2018),
perceptually ordered and readable with colour vision deficiencies; between anchors linear in sRGB.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

ByteArray = npt.NDArray[np.uint8]

_ANCHORS = {
    "viridis": "440154 482878 3e4989 31688e 26828e 1f9e89 35b779 6ece58 b5de2b fde725",
    "cividis": "00224e 123570 3b496c 575d6d 707173 8a8678 a59c74 c3b369 e1cc55 fee838",
    "magma": "000004 180f3d 440f76 721f81 9e2f7f cd4071 f1605d fd9668 feca8d fcfdbf",
    "gray": "000000 ffffff",
}
DEFAULT_COLORMAP = "viridis"


def hex_color(text: str) -> tuple[int, int, int]:
    """``'fde725'`` as (253, 231, 37)."""
    return (int(text[0:2], 16), int(text[2:4], 16), int(text[4:6], 16))


def _table(anchors: str) -> ByteArray:
    rgb = np.array([hex_color(h) for h in anchors.split()], dtype=np.float64)
    at = np.linspace(0.0, len(rgb) - 1.0, 256)
    table = np.stack([np.interp(at, np.arange(len(rgb)), rgb[:, k]) for k in range(3)], axis=1)
    return np.rint(table).astype(np.uint8)


#: Name -> (256, 3) uint8; ``…_r`` is the reverse.
COLORMAPS: dict[str, ByteArray] = {
    name + suffix: (table if not suffix else np.ascontiguousarray(table[::-1]))
    for name, table in ((n, _table(a)) for n, a in _ANCHORS.items())
    for suffix in ("", "_r")
}
