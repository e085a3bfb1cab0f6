"""What pictures are painted of: floor, field, landmarks, colour bar."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw

from api.canvas import Color, InvalidPicture, View, write
from api.colormaps import COLORMAPS, ByteArray
from localization.uncertainty_field import UncertaintyField, is_off
from maps.arrays import BoolArray, FloatArray, IntArray
from maps.floor_plan import FloorPlan
from maps.grid import OccupancyGrid
from maps.world import World

OUTSIDE: Color = (226, 229, 233)
INK: Color = (32, 36, 42)
_FLOOR: Color = (250, 250, 248)
_WALL: Color = (48, 56, 66)
_CLEAR_OBSTACLE: Color = (150, 158, 168)
_UNKNOWN: Color = (205, 209, 214)
_NO_FIX: tuple[Color, Color] = ((244, 244, 242), (176, 180, 186))
_DOUBTFUL: Color = (25, 25, 30)
_LANDMARK: Color = (214, 39, 40)


def paint_floor(image: Image.Image, view: View, world: World) -> None:
    """Floor, walls and unknown areas."""
    floor = world.floor
    if isinstance(floor, OccupancyGrid):
        image.paste(Image.fromarray(_grid_colors(floor, view)), (view.left, view.top))
        return
    draw = ImageDraw.Draw(image)
    draw.rectangle(_box(view), fill=OUTSIDE)
    _paint_polygons(draw, view, shapely.get_parts(floor.floor_area()), _FLOOR, holes=OUTSIDE)
    paint_obstacles(image, view, world)


def _box(view: View) -> tuple[int, int, int, int]:
    return (view.left, view.top, view.left + view.width - 1, view.top + view.height - 1)


def _grid_colors(floor: OccupancyGrid, view: View) -> ByteArray:
    colors = np.full((view.height, view.width, 3), OUTSIDE, dtype=np.uint8)
    rows, cols, on = cells_on(floor.frame.cell_at(view.pixel_centres()), floor.frame.shape)
    sample = np.full((*on.shape, 3), _CLEAR_OBSTACLE, dtype=np.uint8)
    sample[floor.unknown[rows, cols]] = _UNKNOWN
    sample[floor.opaque[rows, cols]] = _WALL
    sample[floor.free[rows, cols]] = _FLOOR
    colors[on] = sample[on]
    return colors


def cells_on(cells: IntArray, shape: tuple[int, int]) -> tuple[IntArray, IntArray, BoolArray]:
    """Rows, columns and whether they lie on a grid of this shape (index 0 stands for those that do not)."""
    rows, cols = cells[..., 0], cells[..., 1]
    on = (rows >= 0) & (cols >= 0) & (rows < shape[0]) & (cols < shape[1])
    return np.where(on, rows, 0), np.where(on, cols, 0), on


def paint_obstacles(image: Image.Image, view: View, world: World) -> None:
    """Obstacles of a polygon floor, crisp over whatever was painted below."""
    if not isinstance(world.floor, FloorPlan):
        return
    draw = ImageDraw.Draw(image)
    for polygon, opaque in zip(world.floor.obstacles, world.floor.opaque, strict=True):
        _paint_polygons(draw, view, [polygon], _WALL if opaque else _CLEAR_OBSTACLE, holes=_FLOOR)


def _paint_polygons(
    draw: ImageDraw.ImageDraw,
    view: View,
    polygons: npt.ArrayLike,
    fill: Color,
    *,
    holes: Color,
) -> None:
    for polygon in np.asarray(polygons, dtype=object):
        draw.polygon(_pixels(view, np.asarray(polygon.exterior.coords)[:, :2]), fill=fill)
        for ring in polygon.interiors:
            draw.polygon(_pixels(view, np.asarray(ring.coords)[:, :2]), fill=holes)


def _pixels(view: View, points: npt.ArrayLike) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in view.to_pixel(points)]


def color_range(
    values: FloatArray, vmin: float | None, vmax: float | None, scale: str
) -> tuple[float, float]:
    """Limits of the colours: given ones, else the 1st and 99th percentile of the finite values."""
    if scale not in {"linear", "log"}:
        raise InvalidPicture(f"The scale is '{scale}'; use 'linear' or 'log'.")
    good = values[np.isfinite(values)]
    if scale == "log":
        good = good[good > 0]
    lo, hi = (float(v) for v in np.percentile(good, [1, 99])) if len(good) else (0.01, 1.0)
    lo = lo if vmin is None else float(vmin)
    hi = hi if vmax is None else float(vmax)
    if vmin is not None and vmax is not None and not vmin < vmax:
        raise InvalidPicture(f"The colour range {vmin} … {vmax} is empty; the first must be smaller.")
    if scale == "log" and lo <= 0:
        raise InvalidPicture(f"The colour range starts at {lo}; a log scale needs a positive start.")
    if not (math.isfinite(lo) and math.isfinite(hi)):
        raise InvalidPicture(f"The colour range {lo} … {hi} is not finite.")
    if hi <= lo:
        hi = lo * 2 if lo > 0 else lo + 1.0
    return lo, hi


def _unit_interval(values: FloatArray, lo: float, hi: float, scale: str) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        if scale == "log":
            t = (np.log(values) - math.log(lo)) / (math.log(hi) - math.log(lo))
        else:
            t = (values - lo) / (hi - lo)
    return np.asarray(np.clip(t, 0.0, 1.0))


def position(value: float, limits: tuple[float, float], scale: str) -> float:
    """Where a value stands on a scale: 0 and below at its start, 1 and above at its end."""
    return float(_unit_interval(np.asarray(value, dtype=np.float64), *limits, scale))


def paint_field(
    image: Image.Image,
    view: View,
    field: UncertaintyField,
    *,
    metric: str,
    colormap: str,
    limits: tuple[float, float],
    scale: str,
    opacity: float = 1.0,
) -> None:
    """Colour the free cells by a metric; cells without a fix are hatched, doubtful ones have fine stripes."""
    colors, free = field_colors(
        field, view.pixel_centres(), metric=metric, colormap=colormap, limits=limits, scale=scale
    )
    box = _box(view)
    below = np.asarray(image.crop((box[0], box[1], box[2] + 1, box[3] + 1)))
    mixed = np.where(free[..., None], colors * opacity + below * (1.0 - opacity), below)
    image.paste(Image.fromarray(mixed.astype(np.uint8)), (view.left, view.top))


def field_colors(
    field: UncertaintyField,
    places: FloatArray,
    *,
    metric: str,
    colormap: str,
    limits: tuple[float, float],
    scale: str,
    corner: tuple[int, int] = (0, 0),
) -> tuple[ByteArray, BoolArray]:
    """Colours of a metric at places, hatching and stripes included, and where there is free floor.

    Parameters
    ----------
    places
        Shape (height, width, 2): of pixels, W, m.
    corner
        Row and column of the first pixel in a larger picture: patterns go on from tile to tile.

    Returns
    -------
    colors
        Shape (height, width, 3).
    free
        Shape (height, width): elsewhere the colours mean nothing.
    """
    rows, cols, on = cells_on(field.frame.cell_at(places), field.frame.shape)
    values = field.metric(metric, (rows, cols))
    free = on & field.free[rows, cols]
    t = _unit_interval(np.nan_to_num(values, nan=limits[0]), *limits, scale)
    colors = COLORMAPS[colormap][(t * 255.0 + 0.5).astype(np.uint8)]
    down, right = (np.arange(n) + first for n, first in zip(on.shape, corner, strict=True))
    stripe = (np.add.outer(down, right) % 8) < 2
    hatch = np.where(
        stripe[..., None], np.array(_NO_FIX[1], dtype=np.uint8), np.array(_NO_FIX[0], dtype=np.uint8)
    )
    fine = (np.subtract.outer(down, right) % 6) < 1
    doubtful = fine & is_doubtful(field, (rows, cols))
    colors = np.where(doubtful[..., None], np.array(_DOUBTFUL, dtype=np.uint8), colors)
    return np.where(np.isfinite(values)[..., None], colors, hatch), free


def is_doubtful(field: UncertaintyField, at: tuple[IntArray, IntArray]) -> BoolArray:
    """Whether cells have a fix whose ellipse cannot be believed."""
    return is_off(field.validity[at])


def paint_landmarks(image: Image.Image, view: View, world: World, *, radius: float = 3.0) -> None:
    """Landmarks as dots, with a tick along the facing normal."""
    draw = ImageDraw.Draw(image)
    pixels = view.to_pixel(world.landmarks.positions) if len(world.landmarks) else np.empty((0, 2))
    for (x, y), facing in zip(pixels, world.landmarks.facing, strict=True):
        if not (view.left <= x <= view.left + view.width and view.top <= y <= view.top + view.height):
            continue
        if not math.isnan(facing):
            tip = (x + 2.6 * radius * math.cos(facing), y - 2.6 * radius * math.sin(facing))
            draw.line([(x, y), tip], fill=_LANDMARK, width=max(1, round(radius / 2)))
        draw.ellipse(
            [x - radius, y - radius, x + radius, y + radius], fill=_LANDMARK, outline=(255, 255, 255)
        )


def paint_color_bar(
    image: Image.Image,
    left: int,
    *,
    colormap: str,
    limits: tuple[float, float],
    scale: str,
    title: str,
    doubtful: bool = False,
) -> None:
    """Colour bar with ticks and unit at the right of a picture, and the meaning of hatching and stripes."""
    draw = ImageDraw.Draw(image)
    top, bottom = 44, image.height - (84 if doubtful else 62)
    write(draw, (left, 22), title, size=13)
    ramp = COLORMAPS[colormap][np.linspace(255, 0, max(2, bottom - top)).astype(np.uint8)]
    image.paste(Image.fromarray(np.repeat(ramp[:, None, :], 18, axis=1)), (left, top))
    draw.rectangle([left, top, left + 18, bottom], outline=INK)
    for value in ticks(*limits, scale):
        t = float(_unit_interval(np.asarray(value), *limits, scale))
        y = bottom - t * (bottom - top)
        draw.line([(left + 18, y), (left + 23, y)], fill=INK)
        write(draw, (left + 27, y), f"{value:g}", size=12)
    for k in range(18):
        for j in range(14):
            hatched = (k + j) % 8 < 2
            image.putpixel((left + k, bottom + 22 + j), _NO_FIX[1] if hatched else _NO_FIX[0])
    draw.rectangle([left, bottom + 22, left + 18, bottom + 36], outline=INK)
    write(draw, (left + 27, bottom + 29), "no fix", size=12)
    if doubtful:
        for k in range(18):
            for j in range(14):
                fine = (j - k) % 6 < 1
                image.putpixel(
                    (left + k, bottom + 44 + j), _DOUBTFUL if fine else tuple(ramp[len(ramp) // 2])
                )
        draw.rectangle([left, bottom + 44, left + 18, bottom + 58], outline=INK)
        write(draw, (left + 27, bottom + 51), "not valid", size=12)


def ticks(lo: float, hi: float, scale: str) -> list[float]:
    """Round numbers within limits for a colour bar: 1-2-5 steps, at most about eight."""
    if scale == "log":
        decades = range(math.floor(math.log10(lo)), math.ceil(math.log10(hi)) + 1)
        for mantissas in ((1, 2, 5), (1, 3), (1,)):
            found = [m * 10.0**d for d in decades for m in mantissas if lo <= m * 10.0**d <= hi * (1 + 1e-9)]
            if len(found) <= 9:
                return found or [lo, hi]
        return found[:: math.ceil(len(found) / 9)]
    raw = (hi - lo) / 6
    base = 10.0 ** math.floor(math.log10(raw))
    step = min((m * base for m in (1, 2, 5, 10)), key=lambda s: abs(s - raw))
    first = math.ceil(lo / step - 1e-9)
    return [round(k * step, 12) for k in range(first, math.floor(hi / step + 1e-9) + 1)]
