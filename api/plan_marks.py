"""What a question names on the map: areas, places to pass, and where a bound cannot be kept."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api.canvas import Color, View
from maps.arrays import FloatArray

_AVOID: Color = (190, 20, 40)
_DEAR: Color = (190, 90, 0)
_CHEAP: Color = (0, 125, 70)
_STRIPE = 16
_UNMET: Color = (190, 20, 40)


def paint_areas(image: Image.Image, view: View, request: dict[str, Any]) -> None:
    """Areas to avoid, striped, and areas with factors, tinted and with their factor written on them."""
    for polygon in request.get("avoid") or ():
        _paint_polygon(image, view, polygon, _AVOID, striped=True)
    for area in request.get("areas") or ():
        factor = float(area["factor"])
        color = _DEAR if factor > 1 else _CHEAP
        _paint_polygon(image, view, area["polygon"], color, striped=False)
        corners = view.to_pixel(np.array(area["polygon"]["coordinates"][0], dtype=np.float64))
        x, y = (float(v) for v in 0.5 * (corners.min(axis=0) + corners.max(axis=0)))
        draw = ImageDraw.Draw(image)
        text = f"factor {factor:g}"
        draw.text(
            (x, y), text, fill=color, font=canvas.font(34), anchor="mm", stroke_width=3, stroke_fill="white"
        )


def paint_places(image: Image.Image, view: View, answer: dict[str, Any]) -> None:
    """Via points by number, and a ring where a bound is not kept."""
    draw = ImageDraw.Draw(image)
    for number, place in enumerate(answer["request"].get("via") or (), 1):
        x, y = (float(v) for v in view.to_pixel((place["x_m"], place["y_m"])))
        draw.rectangle([x - 13, y - 13, x + 13, y + 13], fill=layers.INK, outline=(255, 255, 255), width=3)
        draw.text((x, y), str(number), fill=(255, 255, 255), font=canvas.font(20), anchor="mm")
    for item in answer.get("unmet") or ():
        x, y = (float(v) for v in view.to_pixel((item["place"]["x_m"], item["place"]["y_m"])))
        for radius, color, width in ((32, (255, 255, 255), 10), (30, _UNMET, 5)):
            box = [x - radius, y - radius, x + radius, y + radius]
            draw.ellipse(box, outline=color, width=width)


def _paint_polygon(
    image: Image.Image, view: View, polygon: dict[str, Any], color: Color, *, striped: bool
) -> None:
    rings = [view.to_pixel(np.array(ring, dtype=np.float64)) for ring in polygon["coordinates"]]
    mask = Image.new("L", image.size, 0)
    draw = ImageDraw.Draw(mask)
    for k, ring in enumerate(rings):
        draw.polygon(_pixels(ring), fill=0 if k else (150 if striped else 80))
    if striped:
        rows, cols = np.indices((image.height, image.width), sparse=True)
        on = (rows + cols) % _STRIPE < _STRIPE // 3
        mask = Image.fromarray(np.where(on, np.asarray(mask), 0).astype(np.uint8))
    image.paste(Image.new("RGB", image.size, color), (0, 0), mask)
    outline = ImageDraw.Draw(image)
    for ring in rings:
        outline.line([*_pixels(ring), _pixels(ring)[0]], fill=color, width=4)


def _pixels(points: FloatArray) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in points]
