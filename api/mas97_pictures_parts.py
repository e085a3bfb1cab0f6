"""What the pictures of MAS97 are made of: panels with axes in metres, ellipses, sight lines, keys."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api.canvas import BBox, Color, View
from localization.covariance import ellipse95
from maps.arrays import FloatArray
from maps.world import World

POOR: Color = (214, 79, 12)
BEST: Color = (0, 92, 230)
GREY: Color = (90, 96, 104)
WHITE: Color = (255, 255, 255)
OVERSAMPLING = 2
#: Room beside a panel for the numbers of its axes, px.
AXIS_LEFT = 34
AXIS_BOTTOM = 26

Mark = tuple[str, Color, str]  # line, area, dot or ring; colour; what it means


def blank(width: int, height: int) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    """A white picture and its pen."""
    canvas.check_size(width, height)
    image = Image.new("RGB", (width, height), WHITE)
    return image, ImageDraw.Draw(image, "RGBA")


def big_view(window: BBox, width: int) -> View:
    """View of a window on an oversampled panel that will be ``width`` px wide."""
    height = round(width * (window[3] - window[1]) / (window[2] - window[0]))
    return View(window, 0, 0, width * OVERSAMPLING, height * OVERSAMPLING)


def floor_panel(world: World, view: View) -> Image.Image:
    """Floor, obstacles and landmarks of a world, of the size of the view."""
    panel = Image.new("RGB", (view.width, view.height), WHITE)
    layers.paint_floor(panel, view, world)
    layers.paint_landmarks(panel, view, world, radius=5.0)
    return panel


def place_panel(image: Image.Image, panel: Image.Image, view: View, left: int, top: int) -> View:
    """Put an oversampled panel into a picture, with its axes; returns where it went."""
    width, height = view.width // OVERSAMPLING, view.height // OVERSAMPLING
    image.paste(panel.resize((width, height), Image.Resampling.LANCZOS), (left, top))
    draw = ImageDraw.Draw(image)
    placed = View(view.bbox, left, top, width, height)
    draw.rectangle([left, top, left + width - 1, top + height - 1], outline=layers.INK)
    x0, y0, x1, y1 = view.bbox
    step = axis_step(x1 - x0, width)
    for x in round_numbers(x0, x1, step):
        px = float(placed.to_pixel((x, y0))[0])
        draw.line([(px, top + height), (px, top + height + 5)], fill=layers.INK)
        centred(draw, px, top + height + 14, f"{x:g}", size=12)
    for y in round_numbers(y0, y1, step):
        py = float(placed.to_pixel((x0, y))[1])
        draw.line([(left - 5, py), (left, py)], fill=layers.INK)
        text = f"{y:g}"
        canvas.write(draw, (left - 9 - draw.textlength(text, font=canvas.font(12)), py), text, size=12)
    canvas.write(draw, (left + width - 12, top + height + 26), "m", size=12, fill=GREY)
    return placed


def axis_step(length: float, pixels: float) -> float:
    """A round step of 1, 2 or 5 that leaves about 60 px between ticks."""
    wanted = 60.0 * length / pixels
    base = 10.0 ** math.floor(math.log10(wanted))
    return min((m * base for m in (1, 2, 5, 10)), key=lambda s: abs(math.log(s / wanted)))


def round_numbers(low: float, high: float, step: float) -> list[float]:
    """Multiples of a step within limits."""
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(k * step, 9) for k in range(first, last + 1)]


def centred(
    draw: ImageDraw.ImageDraw,
    x: float,
    y: float,
    text: str,
    *,
    size: int,
    fill: Color = layers.INK,
) -> None:
    """Text about a vertical line."""
    canvas.write(draw, (x - draw.textlength(text, font=canvas.font(size)) / 2, y), text, size=size, fill=fill)


def paint_ellipse(
    draw: ImageDraw.ImageDraw,
    view: View,
    point: FloatArray,
    covariance: FloatArray,
    color: Color,
    *,
    width: int = 4,
    opacity: int = 40,
) -> None:
    """The 95 % ellipse, to scale, of a covariance xx, xy, yy (m²) about a point."""
    a, b, azimuth = (float(v) for v in ellipse95(covariance))
    t = np.linspace(0.0, 2 * math.pi, 121)
    u, v = a * np.cos(t), b * np.sin(t)
    c, s = math.cos(azimuth), math.sin(azimuth)
    outline = pixels(view, point + np.stack([c * u - s * v, s * u + c * v], axis=1))
    draw.polygon(outline, fill=(*color, opacity))
    draw.line(outline, fill=(*color, 255), width=width, joint="curve")


def paint_sight(
    draw: ImageDraw.ImageDraw,
    view: View,
    point: FloatArray,
    landmarks: FloatArray,
    color: Color,
    *,
    opacity: int = 200,
    width: int = 3,
    radius: int = 11,
) -> None:
    """Lines from a place to landmarks (M, 2), and rings about these."""
    for landmark in landmarks:
        draw.line(pixels(view, np.stack([point, landmark])), fill=(*color, opacity), width=width)
    for x, y in pixels(view, landmarks):
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], outline=(*color, 255), width=3)


def paint_cross(draw: ImageDraw.ImageDraw, view: View, point: FloatArray) -> None:
    """The true place."""
    x, y = pixels(view, point[None])[0]
    for dx, dy in ((14, 0), (0, 14)):
        draw.line([(x - dx, y - dy), (x + dx, y + dy)], fill=(*WHITE, 255), width=7)
        draw.line([(x - dx, y - dy), (x + dx, y + dy)], fill=(*layers.INK, 255), width=3)


def paint_dots(
    draw: ImageDraw.ImageDraw, view: View, points: FloatArray, color: Color, *, radius: int = 3
) -> None:
    """A cloud."""
    for x, y in pixels(view, points):
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=(*color, 110))


def paint_key(draw: ImageDraw.ImageDraw, left: float, y: float, marks: Sequence[Mark]) -> None:
    """Marks with their meaning, in one row."""
    x = left
    for kind, color, text in marks:
        if kind == "line":
            draw.line([(x, y), (x + 26, y)], fill=color, width=3)
        elif kind == "thin":
            draw.line([(x, y), (x + 26, y)], fill=color, width=1)
        elif kind == "area":
            draw.rectangle([x, y - 7, x + 26, y + 7], fill=(*color, 60))
        elif kind == "dash":
            for start in (x, x + 15):
                draw.line([(start, y), (start + 11, y)], fill=color, width=3)
        elif kind == "ring":
            draw.ellipse([x + 7, y - 6, x + 19, y + 6], outline=color, width=2)
        else:
            draw.ellipse([x + 8, y - 5, x + 18, y + 5], fill=color)
        canvas.write(draw, (x + 34, y), text, size=13)
        plain = text.replace("²", "2")
        x += 34 + draw.textlength(plain, font=canvas.font(13)) + 24


def pixels(view: View, points: FloatArray) -> list[tuple[float, float]]:
    """World points (M, 2) as Pillow takes them."""
    return [(float(x), float(y)) for x, y in view.to_pixel(points)]
