"""Fields as a pyramid of square tiles, for maps that are too large for one picture.

The one tile of zoom 0 shows the whole map; each zoom halves the side of a tile. At the largest one a pixel is
a cell. Tiles are numbered from the upper left corner: x to the right, y down.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np
from PIL import Image

from api import layers
from api.canvas import encode_png
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray
from maps.grid import GridFrame

TILE_PX = 256
#: The colours of a whole field are judged by at most so many cells a side.
_SAMPLED = 512


@dataclass(frozen=True, slots=True)
class Pyramid:
    """Where the tiles of a field lie.

    Attributes
    ----------
    left, top
        The upper left corner of all tiles, W, m.
    resolution
        Side of a pixel at the largest zoom, m: that of a cell.
    max_zoom
        The largest zoom.

    Examples
    --------
    >>> pyramid = Pyramid.of(GridFrame(0.0, 0.0, 0.0, 0.1, 400, 600))
    >>> pyramid.max_zoom, pyramid.side(0), pyramid.top
    (2, 102.4, 40.0)
    >>> pyramid.window(2, 0, 1)
    (0.0, -11.2, 25.6, 14.4)
    """

    left: float
    top: float
    resolution: float
    max_zoom: int

    @classmethod
    def of(cls, frame: GridFrame) -> Pyramid:
        """The pyramid over a field's cells."""
        x0, y0, x1, y1 = frame.bounds()
        pixels = max(x1 - x0, y1 - y0) / frame.resolution
        zoom = max(0, math.ceil(math.log2(max(pixels - 1e-6, 1.0) / TILE_PX)))
        return cls(x0, y1, frame.resolution, zoom)

    def side(self, z: int) -> float:
        """Side of a tile, m."""
        return TILE_PX * self.pixel(z)

    def pixel(self, z: int) -> float:
        """Side of a pixel, m."""
        return self.resolution * 2.0 ** (self.max_zoom - z)

    def has(self, z: int, x: int, y: int) -> bool:
        """Whether there is such a tile."""
        return 0 <= z <= self.max_zoom and 0 <= x < 2**z and 0 <= y < 2**z

    def window(self, z: int, x: int, y: int) -> tuple[float, float, float, float]:
        """``(x_min, y_min, x_max, y_max)`` of a tile, m, to a micrometre."""
        side = self.side(z)
        left, top = self.left + x * side, self.top - y * side
        return (round(left, 6), round(top - side, 6), round(left + side, 6), round(top, 6))

    def places(self, z: int, x: int, y: int) -> FloatArray:
        """Middles of a tile's pixels, top row first; shape (256, 256, 2), m."""
        pixel = self.pixel(z)
        right = self.left + (x * TILE_PX + np.arange(TILE_PX) + 0.5) * pixel
        down = self.top - (y * TILE_PX + np.arange(TILE_PX) + 0.5) * pixel
        gx, gy = np.meshgrid(right, down)
        return np.stack([gx, gy], axis=-1)


def whole_range(
    field: UncertaintyField, metric: str, limits: tuple[float, float] | None, scale: str
) -> tuple[float, float]:
    """Ends of the colours that all tiles and the legend share: given ones, else percentiles of all cells.

    Raises
    ------
    InvalidPicture
        If given ones make no scale.
    """
    low, high = (None, None) if limits is None else limits
    if low is not None and high is not None:
        return layers.color_range(np.empty(0), low, high, scale)
    at = np.mgrid[tuple(slice(0, n, max(1, n // _SAMPLED)) for n in field.frame.shape)]
    return layers.color_range(field.metric(metric, (at[0], at[1])), low, high, scale)


def tile_png(
    field: UncertaintyField,
    tile: tuple[int, int, int],
    *,
    metric: str,
    colormap: str,
    limits: tuple[float, float],
    scale: str,
) -> bytes:
    """A tile ``(z, x, y)`` as PNG, clear where no free floor is. A pixel shows the cell at its middle."""
    z, x, y = tile
    colors, free = layers.field_colors(
        field,
        Pyramid.of(field.frame).places(z, x, y),
        metric=metric,
        colormap=colormap,
        limits=limits,
        scale=scale,
        corner=(y * TILE_PX, x * TILE_PX),
    )
    alpha = np.where(free, 255, 0).astype(np.uint8)
    return encode_png(Image.fromarray(np.dstack([np.where(free[..., None], colors, 0), alpha]), "RGBA"))


def tile_npy(field: UncertaintyField, tile: tuple[int, int, int], metric: str) -> bytes:
    """A tile as a numpy file: (256, 256) float32, row 0 the lowest y, NaN without a value."""
    places = Pyramid.of(field.frame).places(*tile)[::-1]
    rows, cols, on = layers.cells_on(field.frame.cell_at(places), field.frame.shape)
    values = np.where(on, field.metric(metric, (rows, cols)), np.nan).astype(np.float32)
    out = io.BytesIO()
    np.save(out, values, allow_pickle=False)
    return out.getvalue()
