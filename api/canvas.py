"""Pictures before anything is drawn: sizes, windows, and where the world lies in them."""

from __future__ import annotations

import io
import math
import unicodedata
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from maps.arrays import FloatArray
from maps.errors import SurepathError

MAX_PIXELS = 16_000_000

BBox = tuple[float, float, float, float]
Color = tuple[int, int, int]
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


# What stands for signs that the font lacks; of the rest letters lose their accents.
_INSTEAD = str.maketrans(
    {"–": "-", "—": "-", "−": "-", "×": "x", "→": "->", "µ": "u", "ß": "ss", "ø": "o", "æ": "ae", "’": "'"}
)


def has_glyph(sign: str) -> bool:
    """Whether the font has a sign; for others it draws an empty box."""
    face = font(20)
    box, mask = face.getmask("\uffff"), face.getmask(sign)
    return (mask.size, bytes(mask)) != (box.size, bytes(box))


def plain(text: str) -> str:
    """The text in signs that the font has: names are whatever people write."""
    if text.isascii():
        return text
    out = []
    for sign in text.translate(_INSTEAD):
        if has_glyph(sign):
            out.append(sign)
            continue
        bare = "".join(c for c in unicodedata.normalize("NFKD", sign) if not unicodedata.combining(c))
        out.append(bare if bare and all(map(has_glyph, bare)) else "?")
    return "".join(out)


def write(
    draw: ImageDraw.ImageDraw, at: tuple[float, float], text: str, *, size: int, fill: Color = (32, 36, 42)
) -> None:
    """Text from ``at`` (left, vertical middle), :func:`plain`; a superscript two is drawn small."""
    x, y = at
    for k, part in enumerate(map(plain, text.split("²"))):
        if k:
            draw.text(
                (x, y - 0.33 * size), "2", fill=fill, font=font(max(7, round(0.65 * size))), anchor="lm"
            )
            x += draw.textlength("2", font=font(max(7, round(0.65 * size)))) + 1
        draw.text((x, y), part, fill=fill, font=font(size), anchor="lm")
        x += draw.textlength(part, font=font(size))


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


def encode_png(image: Image.Image) -> bytes:
    """PNG bytes, quick rather than smallest."""
    out = io.BytesIO()
    image.save(out, format="PNG", compress_level=2)
    return out.getvalue()
