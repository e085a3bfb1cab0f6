"""A region within reach as a picture: map, field, the region's outline, the place."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api.canvas import Color
from api.sheet import BAR, Sheet
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray
from planner.reachability import Region

_REGION: Color = (0, 92, 230)
_FOOTER = 30
_UNITS = {"cost": "m of cost", "length": "m", "time": "s"}


def reach_png(field: UncertaintyField, region: Region, *, width: int = 1500, title: str = "") -> bytes:
    """Picture of a region over the field in which it was found.

    Parameters
    ----------
    field
        The field.
    region
        What is within reach.
    width
        Width of the picture, px; the height follows from the map.
    title
        Text above the map.

    Raises
    ------
    InvalidPicture
        If the width makes no sense.
    """
    sheet = Sheet.of(field.frame.bounds(), width, beside=BAR, below=_FOOTER)
    view, image = sheet.view, sheet.floor(field, opacity=0.62)
    image = _shaded(image, view, region)
    layers.paint_landmarks(image, view, field.world, radius=5.0)
    _mark(image, view, region)
    whole, draw = sheet.with_map(image, title or field.world.name)
    sheet.paint_bar(whole, field)
    canvas.write(draw, (14, sheet.height - _FOOTER / 2), _words(region), size=14)
    return canvas.encode_png(whole)


def _words(region: Region) -> str:
    within = f"within {region.limit:g} {_UNITS[region.measure]}" if np.isfinite(region.limit) else "connected"
    x, y = region.place
    return f"blue: reached from ({x:g}, {y:g}) m and back, {within}: {region.area:.1f} m²"


def _shaded(image: Image.Image, view: canvas.View, region: Region) -> Image.Image:
    """What is out of reach, paler."""
    mask = Image.new("L", image.size, 0)
    draw = ImageDraw.Draw(mask)
    for polygon in region.polygons:
        draw.polygon(_pixels(view, np.asarray(polygon.exterior.coords)), fill=255)
        for ring in polygon.interiors:
            draw.polygon(_pixels(view, np.asarray(ring.coords)), fill=0)
    pale = Image.blend(image, Image.new("RGB", image.size, (255, 255, 255)), 0.55)
    out = Image.composite(image, pale, mask)
    draw = ImageDraw.Draw(out)
    for polygon in region.polygons:
        for ring in (polygon.exterior, *polygon.interiors):
            draw.line(_pixels(view, np.asarray(ring.coords)), fill=_REGION, width=4)
    return out


def _mark(image: Image.Image, view: canvas.View, region: Region) -> None:
    x, y = (float(v) for v in view.to_pixel(region.place))
    draw = ImageDraw.Draw(image)
    draw.ellipse([x - 12, y - 12, x + 12, y + 12], fill=layers.INK, outline=(255, 255, 255), width=3)


def _pixels(view: canvas.View, points: FloatArray) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in view.to_pixel(points)]
