"""Fields and worlds as pictures. Top row is the highest y; every length in a picture is stated."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw, ImageFont

from api.colormaps import COLORMAPS, DEFAULT_COLORMAP, ByteArray
from localization.uncertainty_field import METRICS, UncertaintyField
from maps.arrays import FloatArray
from maps.errors import SurepathError
from maps.floor_plan import FloorPlan
from maps.grid import OccupancyGrid
from maps.world import World

MAX_PIXELS = 16_000_000
_OUTSIDE = (226, 229, 233)
_FLOOR = (250, 250, 248)
_WALL = (48, 56, 66)
_CLEAR_OBSTACLE = (150, 158, 168)
_UNKNOWN = (205, 209, 214)
_NO_FIX = ((244, 244, 242), (176, 180, 186))
_INK = (32, 36, 42)
_LANDMARK = (214, 39, 40)
_MARGIN = 12
_BAR_WIDTH = 118

BBox = tuple[float, float, float, float]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont


class InvalidPicture(SurepathError):
    """A picture cannot be made as asked: size, window, colours or metric."""


@dataclass(frozen=True, slots=True)
class View:
    """A window of the world on a rectangle of pixels: same scale on both axes, centred.

    Attributes
    ----------
    bbox
        ``(x_min, y_min, x_max, y_max)`` shown, W, m.
    left, top, width, height
        Rectangle of the picture that the window fills, px.
    """

    bbox: BBox
    left: int
    top: int
    width: int
    height: int

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self.width / (self.bbox[2] - self.bbox[0])

    def to_pixel(self, points: npt.ArrayLike) -> FloatArray:
        """World points (..., 2) to picture coordinates (x right, y down), px."""
        p = np.asarray(points, dtype=np.float64)
        x = self.left + (p[..., 0] - self.bbox[0]) * self.scale
        y = self.top + (self.bbox[3] - p[..., 1]) * self.scale
        return np.stack([x, y], axis=-1)

    def pixel_centres(self) -> FloatArray:
        """World position of every pixel of the rectangle; shape (height, width, 2), m."""
        x = self.bbox[0] + (np.arange(self.width) + 0.5) / self.scale
        y = self.bbox[3] - (np.arange(self.height) + 0.5) / self.scale
        gx, gy = np.meshgrid(x, y)
        return np.stack([gx, gy], axis=-1)


def fit_view(bbox: BBox, width: int, height: int, *, left: int = 0, top: int = 0) -> View:
    """The largest view of a window that fits a rectangle."""
    scale = min(width / (bbox[2] - bbox[0]), height / (bbox[3] - bbox[1]))
    w = max(1, min(width, round((bbox[2] - bbox[0]) * scale)))
    h = max(1, min(height, round((bbox[3] - bbox[1]) * scale)))
    return View(bbox, left + (width - w) // 2, top + (height - h) // 2, w, h)


def font(size: int) -> Font:
    """The font that Pillow carries."""
    return ImageFont.load_default(size)


def check_size(width: int, height: int) -> None:
    """Raise :class:`InvalidPicture` unless a picture of this size may be made."""
    if width < 16 or height < 16 or width * height > MAX_PIXELS:
        raise InvalidPicture(
            f"A picture of {width} × {height} px is not possible; sides start at 16 px and "
            f"the limit is {MAX_PIXELS} px in all."
        )


def check_bbox(bbox: BBox | None, bounds: BBox) -> BBox:
    """The window to show: ``bbox`` or, without one, the whole map; refused when empty or beside the map."""
    if bbox is None:
        return bounds
    x0, y0, x1, y1 = bbox
    if not all(math.isfinite(v) for v in bbox) or not (x0 < x1 and y0 < y1):
        raise InvalidPicture(f"The window {bbox} is empty; give x_min,y_min,x_max,y_max in m with min < max.")
    if x1 <= bounds[0] or y1 <= bounds[1] or x0 >= bounds[2] or y0 >= bounds[3]:
        raise InvalidPicture(f"The window {bbox} lies outside the map, which spans {bounds}.")
    return bbox


def paint_floor(image: Image.Image, view: View, world: World) -> None:
    """Floor, walls and unknown areas."""
    floor = world.floor
    if isinstance(floor, OccupancyGrid):
        image.paste(Image.fromarray(_grid_colors(floor, view)), (view.left, view.top))
        return
    draw = ImageDraw.Draw(image)
    draw.rectangle(_box(view), fill=_OUTSIDE)
    _paint_polygons(draw, view, shapely.get_parts(floor.floor_area()), _FLOOR, holes=_OUTSIDE)
    paint_obstacles(image, view, world)


def _box(view: View) -> tuple[int, int, int, int]:
    return (view.left, view.top, view.left + view.width - 1, view.top + view.height - 1)


def _grid_colors(floor: OccupancyGrid, view: View) -> ByteArray:
    colors = np.full((view.height, view.width, 3), _OUTSIDE, dtype=np.uint8)
    rows, cols, on = _cells(floor.frame.cell_at(view.pixel_centres()), floor.frame.shape)
    sample = np.full((*on.shape, 3), _CLEAR_OBSTACLE, dtype=np.uint8)
    sample[floor.unknown[rows, cols]] = _UNKNOWN
    sample[floor.opaque[rows, cols]] = _WALL
    sample[floor.free[rows, cols]] = _FLOOR
    colors[on] = sample[on]
    return colors


def _cells(
    cells: npt.NDArray[np.int64], shape: tuple[int, int]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
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
    fill: tuple[int, int, int],
    *,
    holes: tuple[int, int, int],
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
    """Colour the free cells by a metric; cells without a fix are hatched."""
    rows, cols, on = _cells(field.frame.cell_at(view.pixel_centres()), field.frame.shape)
    values = field.metric(metric, (rows, cols))
    free = on & field.free[rows, cols]
    t = _unit_interval(np.nan_to_num(values, nan=limits[0]), *limits, scale)
    colors = COLORMAPS[colormap][(t * 255.0 + 0.5).astype(np.uint8)]
    stripe = (np.add.outer(np.arange(view.height), np.arange(view.width)) % 8) < 2
    hatch = np.where(
        stripe[..., None], np.array(_NO_FIX[1], dtype=np.uint8), np.array(_NO_FIX[0], dtype=np.uint8)
    )
    colors = np.where(np.isfinite(values)[..., None], colors, hatch)
    box = _box(view)
    below = np.asarray(image.crop((box[0], box[1], box[2] + 1, box[3] + 1)))
    mixed = np.where(free[..., None], colors * opacity + below * (1.0 - opacity), below)
    image.paste(Image.fromarray(mixed.astype(np.uint8)), (view.left, view.top))


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
) -> None:
    """Colour bar with ticks and unit at the right of a picture, and the meaning of the hatching."""
    draw = ImageDraw.Draw(image)
    small = font(12)
    top, bottom = 44, image.height - 62
    draw.text((left, 14), title, fill=_INK, font=font(13))
    ramp = COLORMAPS[colormap][np.linspace(255, 0, max(2, bottom - top)).astype(np.uint8)]
    image.paste(Image.fromarray(np.repeat(ramp[:, None, :], 18, axis=1)), (left, top))
    draw.rectangle([left, top, left + 18, bottom], outline=_INK)
    for value in ticks(*limits, scale):
        t = float(_unit_interval(np.asarray(value), *limits, scale))
        y = bottom - t * (bottom - top)
        draw.line([(left + 18, y), (left + 23, y)], fill=_INK)
        draw.text((left + 27, y), f"{value:g}", fill=_INK, font=small, anchor="lm")
    for k in range(18):
        for j in range(14):
            hatched = (k + j) % 8 < 2
            image.putpixel((left + k, bottom + 22 + j), _NO_FIX[1] if hatched else _NO_FIX[0])
    draw.rectangle([left, bottom + 22, left + 18, bottom + 36], outline=_INK)
    draw.text((left + 27, bottom + 29), "no fix", fill=_INK, font=small, anchor="lm")


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


def encode_png(image: Image.Image) -> bytes:
    """PNG bytes, quick rather than smallest."""
    out = io.BytesIO()
    image.save(out, format="PNG", compress_level=2)
    return out.getvalue()


def picture_size(
    bbox: BBox, width: int | None, height: int | None, extra: int, max_size: int
) -> tuple[int, int]:
    """Size of a picture of a window; a missing side follows from the other by the window's shape."""
    aspect = (bbox[3] - bbox[1]) / (bbox[2] - bbox[0])
    if width is None and height is None:
        width = max_size if aspect <= 1 else max(64 + extra, round(max_size / aspect) + extra)
    if width is None:
        width = max(64, round((height or max_size) / aspect)) + extra
    if height is None:
        height = max(64, round((width - extra) * aspect))
    check_size(width, height)
    return width, height


def heatmap_png(
    field: UncertaintyField,
    *,
    metric: str = "area95_m2",
    width: int | None = None,
    height: int | None = None,
    max_size: int = 1200,
    bbox: BBox | None = None,
    colormap: str = DEFAULT_COLORMAP,
    vmin: float | None = None,
    vmax: float | None = None,
    scale: str = "log",
    legend: bool = True,
    landmarks: bool = True,
) -> bytes:
    """Heatmap of one metric over the floor, as PNG.

    Parameters
    ----------
    field
        What to draw.
    metric
        Key of :data:`localization.uncertainty_field.METRICS`.
    width, height
        Size of the picture, px, colour bar included; one or both may be missing, then the longer side
        follows ``max_size`` and the shape of the window.
    bbox
        Window ``(x_min, y_min, x_max, y_max)`` in W, m; None: the whole map.
    colormap
        Key of :data:`api.colormaps.COLORMAPS`.
    vmin, vmax
        Ends of the colours; default the 1st and 99th percentile of the window.
    scale
        ``log`` or ``linear``.
    legend
        Whether a colour bar stands at the right.
    landmarks
        Whether landmarks are drawn.

    Raises
    ------
    InvalidPicture
        If size, window, range, scale or colour map make no sense.
    """
    if metric not in METRICS:
        raise InvalidPicture(f"Unknown metric '{metric}'; use one of {', '.join(METRICS)}.")
    if colormap not in COLORMAPS:
        raise InvalidPicture(f"Unknown colour map '{colormap}'; use one of {', '.join(COLORMAPS)}.")
    window = check_bbox(bbox, field.frame.bounds())
    extra = _BAR_WIDTH if legend else 0
    width, height = picture_size(window, width, height, extra, max_size)
    image = Image.new("RGB", (width, height), (255, 255, 255))
    margin = _MARGIN if legend else 0
    view = fit_view(
        window, max(8, width - extra - 2 * margin), max(8, height - 2 * margin), left=margin, top=margin
    )
    sample = view.pixel_centres()[:: max(1, view.height // 256), :: max(1, view.width // 256)]
    rows, cols, on = _cells(field.frame.cell_at(sample), field.frame.shape)
    limits = color_range(field.metric(metric, (rows, cols))[on], vmin, vmax, scale)
    paint_floor(image, view, field.world)
    paint_field(image, view, field, metric=metric, colormap=colormap, limits=limits, scale=scale)
    paint_obstacles(image, view, field.world)
    if landmarks:
        paint_landmarks(image, view, field.world, radius=max(1.5, min(4.0, view.scale * 0.15)))
    if legend:
        unit = METRICS[metric][0]
        title = metric.rsplit("_", 1)[0] if unit else metric
        paint_color_bar(
            image,
            width - extra + 12,
            colormap=colormap,
            limits=limits,
            scale=scale,
            title=f"{title} [{unit}]" if unit else title,
        )
    return encode_png(image)


def map_png(world: World, *, max_size: int = 1200) -> bytes:
    """Floor and landmarks as PNG."""
    width, height = picture_size(world.bounds, None, None, 0, max_size)
    image = Image.new("RGB", (width, height), _OUTSIDE)
    view = fit_view(world.bounds, width, height)
    paint_floor(image, view, world)
    paint_landmarks(image, view, world, radius=max(1.5, min(4.0, view.scale * 0.15)))
    return encode_png(image)
