"""A schedule of landmarks as a picture: the stretches of a route by triplet, and r95 along it."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api.canvas import Color, View
from api.sheet import Sheet
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray

_COLORS: tuple[Color, ...] = (
    (0, 92, 230),
    (214, 79, 12),
    (0, 125, 70),
    (190, 0, 110),
    (120, 50, 190),
    (0, 140, 165),
    (135, 85, 20),
)
_NONE: Color = (70, 70, 80)
_TURNING: Color = (176, 180, 188)
_GREY: Color = (90, 96, 104)
_STRIP = 176
_LEFT = 64
_MARGIN_M = 1.5
# Less is nothing, m.
_SEEN_M = 0.05


def schedule_png(
    field: UncertaintyField, answer: dict[str, Any], *, width: int = 1100, title: str = ""
) -> bytes:
    """Picture of the first route's schedule.

    Parameters
    ----------
    field
        Of the plan: its map is shown around the route and the landmarks that are looked at.
    answer
        The answer of ``POST /v1/plans`` with a schedule.
    width
        Width of the picture, px; the height follows.
    title
        Text above the map.

    Raises
    ------
    InvalidPicture
        If the width makes no sense, or the answer has no schedule.
    """
    route = answer["routes"][0] if answer["routes"] else {}
    if not route.get("schedule"):
        raise canvas.InvalidPicture("The plan has no schedule of landmarks; ask for one.")
    marks = dict(zip(field.world.landmarks.ids, field.world.landmarks.positions, strict=True))
    colors = _colors(route["schedule"])
    window = _window(field, route, marks)
    sheet = Sheet.of(window, width, beside=24, below=_STRIP)
    view, big = sheet.view, sheet.floor(field)
    layers.paint_landmarks(big, view, field.world, radius=6.0)
    _paint_stretches(big, view, route, marks, colors)
    said = title or f"{field.world.name}: which three landmarks to look at, by stretch"
    image, draw = sheet.with_map(big, said)
    _paint_profile(draw, route, colors, (_LEFT, sheet.height - _STRIP + 22, width - 24, sheet.height - 54))
    return canvas.encode_png(image)


def looks(schedule: list[dict[str, Any]]) -> list[int | None]:
    """Number of each stretch among those with a fix, from 1; None without."""
    count = 0
    out: list[int | None] = []
    for stretch in schedule:
        count += stretch["kind"] == "fix"
        out.append(count if stretch["kind"] == "fix" else None)
    return out


def _colors(schedule: list[dict[str, Any]]) -> list[Color]:
    """One for each stretch; the same triplet has the same as before."""
    known: dict[tuple[str, ...], Color] = {}
    out = []
    for stretch in schedule:
        if stretch["triplet"] is None:
            out.append(_TURNING if stretch["kind"] == "turning" else _NONE)
            continue
        key = tuple(sorted(stretch["triplet"]))
        out.append(known.setdefault(key, _COLORS[len(known) % len(_COLORS)]))
    return out


def _window(field: UncertaintyField, route: dict[str, Any], marks: dict[str, FloatArray]) -> canvas.BBox:
    places = [(p["x_m"], p["y_m"]) for p in route["path"]]
    used = {name for stretch in route["schedule"] for name in stretch["triplet"] or ()}
    every = np.concatenate([np.array(places), *(marks[name][None] for name in sorted(used))])
    x0, y0, x1, y1 = field.world.bounds
    low = np.maximum(every.min(axis=0) - _MARGIN_M, (x0, y0))
    high = np.minimum(every.max(axis=0) + _MARGIN_M, (x1, y1))
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _paint_stretches(
    image: Image.Image,
    view: View,
    route: dict[str, Any],
    marks: dict[str, FloatArray],
    colors: list[Color],
) -> None:
    draw = ImageDraw.Draw(image, "RGBA")
    points = np.array([[p["x_m"], p["y_m"]] for p in route["path"]])
    s = np.array([p["s_m"] for p in route["path"]])

    def at(arc: float) -> FloatArray:
        return np.array([np.interp(arc, s, points[:, 0]), np.interp(arc, s, points[:, 1])])

    middles = []
    for stretch, color in zip(route["schedule"], colors, strict=True):
        begin, end = stretch["s_start_m"], stretch["s_end_m"]
        inside = (s > begin) & (s < end)
        part = np.concatenate([at(begin)[None], points[inside], at(end)[None]])
        middle = at(0.5 * (begin + end))
        middles.append(middle)
        for name in stretch["triplet"] or ():
            ends = _pixels(view, np.stack([middle, marks[name]]))
            draw.line(ends, fill=(*color, 190), width=3)
            x, y = ends[1]
            draw.ellipse([x - 10, y - 10, x + 10, y + 10], outline=(*color, 255), width=4)
        line = _pixels(view, part)
        draw.line(line, fill=(255, 255, 255, 255), width=13, joint="curve")
        draw.line(line, fill=(*color, 255), width=9, joint="curve")
    for number, middle, color in zip(looks(route["schedule"]), middles, colors, strict=True):
        if number is not None:
            _disc(draw, _pixels(view, middle[None])[0], str(number), color)
    for place, letter in ((points[0], "S"), (points[-1], "G")):
        _disc(draw, _pixels(view, place[None])[0], letter, layers.INK)


def _disc(draw: ImageDraw.ImageDraw, at: tuple[float, float], text: str, color: Color) -> None:
    x, y = at
    draw.ellipse([x - 15, y - 15, x + 15, y + 15], fill=color, outline=(255, 255, 255), width=3)
    draw.text((x, y), text, fill=(255, 255, 255), font=canvas.font(20), anchor="mm")


def _paint_profile(
    draw: ImageDraw.ImageDraw,
    route: dict[str, Any],
    colors: list[Color],
    box: tuple[int, int, int, int],
) -> None:
    """Worst r95 of every stretch over the way driven, and what it costs to leave it a second late."""
    left, top, right, bottom = box
    stretches = route["schedule"]
    length: float = max(stretches[-1]["s_end_m"], 1e-9)
    values: list[float] = [
        v for part in stretches for v in (part["max_r95_m"], part["late_r95_m"]) if v is not None
    ]
    limit = max(values, default=1.0) * 1.1

    def x_of(arc: float) -> float:
        return left + (right - left) * arc / length

    def y_of(r95: float) -> float:
        return bottom - (bottom - top) * r95 / limit

    for number, stretch, color in zip(looks(stretches), stretches, colors, strict=True):
        a, b = x_of(stretch["s_start_m"]), x_of(stretch["s_end_m"])
        worst = stretch["max_r95_m"]
        if worst is None:
            draw.rectangle([a, top, max(b, a + 1), bottom], fill=color)
            continue
        draw.rectangle([a, y_of(worst), b, bottom], fill=color)
        if b - a > 14:
            at = (0.5 * (a + b), bottom - 9)
            draw.text(at, str(number), fill="white", font=canvas.font(12), anchor="mm")
    for stretch in stretches:
        x, worst, late = x_of(stretch["s_end_m"]), stretch["max_r95_m"], stretch["late_r95_m"]
        if (stretch["late_blind_m"] or 0.0) >= _SEEN_M:
            y = y_of(worst)
            draw.line([(x - 4, y - 4), (x + 4, y + 4)], fill=layers.INK, width=2)
            draw.line([(x - 4, y + 4), (x + 4, y - 4)], fill=layers.INK, width=2)
        elif late is not None:
            y = y_of(late)
            draw.ellipse([x - 4, y - 4, x + 4, y + 4], fill=layers.INK)
    draw.line([(left, top), (left, bottom), (right, bottom)], fill=layers.INK)
    for value in layers.ticks(0.0, limit, "linear"):
        draw.text((left - 6, y_of(value)), f"{value:g}", fill=layers.INK, font=canvas.font(11), anchor="rm")
    for value in layers.ticks(0.0, length, "linear"):
        x = x_of(min(value, length))
        draw.text((x, bottom + 4), f"{value:g}", fill=layers.INK, font=canvas.font(11), anchor="ma")
    words = (
        "worst r95 [m] of each stretch over the way driven [m]; light grey: the pan head turns, without a "
        "fix; dark: no fix in reach"
    )
    canvas.write(draw, (left, bottom + 25), words, size=12, fill=_GREY)
    words = "left a second late: dots have r95 meanwhile; at crosses more of the way is without a fix"
    canvas.write(draw, (left, bottom + 42), words, size=12, fill=_GREY)


def _pixels(view: View, points: FloatArray) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in view.to_pixel(points)]
