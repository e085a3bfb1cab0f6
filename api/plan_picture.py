"""A plan as a picture: map, field, all routes with a table, 95 % ellipses along them, landmarks used."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers, plan_marks
from api.canvas import Color
from api.sheet import BAR, Sheet
from localization.covariance import ellipse95
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray

_CHOSEN: Color = (0, 92, 230)
_SHORTEST: Color = (214, 79, 12)
#: Of alternatives after the first; a front goes from the colour of the shortest to that of the chosen one.
_OTHERS: tuple[Color, ...] = (
    (190, 0, 110),
    (0, 125, 70),
    (120, 50, 190),
    (135, 85, 20),
    (0, 140, 165),
    (80, 80, 90),
)
_FOOTER = 84
_ROW = 20
_GREY: Color = (90, 96, 104)
_MARGIN_M = 2.0
_ENLARGEMENTS = (1, 2, 5, 10, 20, 50, 100, 200)
# Ellipses that reach further than this part of the picture's width are left out: they would hide the rest.
_LARGEST = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    name: str
    color: Color
    is_main: bool
    has_ellipses: bool
    figures: dict[str, Any]
    points: FloatArray
    s: FloatArray
    covariance: FloatArray
    triplets: list[list[str] | None]


def plan_png(field: UncertaintyField, answer: dict[str, Any], *, width: int = 1500, title: str = "") -> bytes:
    """Picture of a plan over its field.

    Parameters
    ----------
    field
        The field that the plan was made on; the picture shows it around its landmarks and the routes.
    answer
        The answer of ``POST /v1/plans``; without a route only the field is drawn and the status said.
    width
        Width of the picture, px; the height follows from the map.
    title
        Text above the map.

    Raises
    ------
    InvalidPicture
        If the width makes no sense.
    """
    routes = _routes(answer)
    bounds = _window(field, routes)
    is_list = len(answer["routes"]) > 1
    footer = 44 + _ROW * (len(routes) + 1) if is_list else _FOOTER
    sheet = Sheet.of(bounds, width, beside=BAR, below=footer)
    view = sheet.view
    enlargement = _enlargement(routes, view.scale)
    big = _map_with_routes(field, sheet, routes, enlargement, answer)
    image, draw = sheet.with_map(big, title or f"{field.world.name}: {answer['status']}")
    sheet.paint_bar(image, field)
    paint = _paint_table if is_list else _paint_key
    largest = _LARGEST * view.width / (view.scale * enlargement)
    paint(draw, sheet.height - footer + 10, routes, enlargement, largest)
    return canvas.encode_png(image)


def _map_with_routes(
    field: UncertaintyField,
    sheet: Sheet,
    routes: list[_Drawn],
    enlargement: int,
    answer: dict[str, Any],
) -> Image.Image:
    view, image = sheet.view, sheet.floor(field, opacity=0.62)
    plan_marks.paint_areas(image, view, answer["request"])
    layers.paint_landmarks(image, view, field.world, radius=5.0)
    positions = dict(zip(field.world.landmarks.ids, field.world.landmarks.positions, strict=True))
    for route in routes:
        _paint_route(image, view, route, positions, enlargement)
    numbered = [route for route in reversed(routes) if route.name.isdigit()]
    for k, route in enumerate(numbered, 1):
        at = int(np.searchsorted(route.s, float(route.s[-1]) * k / (len(numbered) + 1)))
        _paint_mark(image, view, route.points[at], route.name, color=route.color, radius=13)
    plan_marks.paint_places(image, view, answer)
    if routes:
        for point, letter in ((routes[-1].points[0], "S"), (routes[-1].points[-1], "G")):
            _paint_mark(image, view, point, letter, color=layers.INK, radius=15)
    return image


def _paint_mark(
    image: Image.Image, view: canvas.View, point: FloatArray, text: str, *, color: Color, radius: int
) -> None:
    """A disc with a letter or a number."""
    draw = ImageDraw.Draw(image)
    x, y = (float(v) for v in view.to_pixel(point))
    box = [x - radius, y - radius, x + radius, y + radius]
    draw.ellipse(box, fill=color, outline=(255, 255, 255), width=3)
    draw.text((x, y), text, fill=(255, 255, 255), font=canvas.font(20), anchor="mm")


def _window(field: UncertaintyField, routes: list[_Drawn]) -> canvas.BBox:
    """What is worth showing: routes and landmarks with a margin, not the empty part of a map."""
    x0, y0, x1, y1 = field.frame.bounds()
    places = np.concatenate([field.world.landmarks.positions, *(r.points for r in routes)])
    low = np.maximum(places.min(axis=0) - _MARGIN_M, (x0, y0))
    high = np.minimum(places.max(axis=0) + _MARGIN_M, (x1, y1))
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _routes(answer: dict[str, Any]) -> list[_Drawn]:
    """In the order in which they are drawn: the first of the answer is the last."""
    found = answer["routes"]
    out = []
    is_shortest = len(found) == 1 and answer.get("shortest_baseline") and _is_same(answer)
    if answer.get("shortest_baseline") and not is_shortest:
        # Beside several routes its large ellipses would hide them.
        alone = len(found) < 2
        out.append(_drawn("shortest", _SHORTEST, answer["shortest_baseline"], has_ellipses=alone))
    only = "shortest" if is_shortest else "this plan"
    names = [only] if len(found) == 1 else [str(k + 1) for k in range(len(found))]
    listed = [
        _drawn(name, color, route, is_main=k == 0, has_ellipses=k == 0 or route.get("front") is not None)
        for k, (name, color, route) in enumerate(zip(names, _colors(found), found, strict=True))
    ]
    return out + listed[::-1]


def _is_same(answer: dict[str, Any]) -> bool:
    """Whether the route is the shortest one itself."""
    route, shortest = answer["routes"][0], answer["shortest_baseline"]
    ways = [[(p["x_m"], p["y_m"]) for p in one["path"]] for one in (route, shortest)]
    return ways[0] == ways[1]


def _colors(found: list[dict[str, Any]]) -> list[Color]:
    if len(found) > 1 and found[0].get("front"):
        shares = [k / (len(found) - 1) for k in range(len(found))]
        return [_between(_SHORTEST, _CHOSEN, share) for share in shares]
    return [_CHOSEN, *(_OTHERS[k % len(_OTHERS)] for k in range(len(found) - 1))][: len(found)]


def _between(a: Color, b: Color, share: float) -> Color:
    """A colour of a front: over magenta, which no part of the heatmap has."""
    middle = (200, 0, 140)
    first, second, t = (a, middle, 2 * share) if share < 0.5 else (middle, b, 2 * share - 1)
    red, green, blue = (round(u + (v - u) * t) for u, v in zip(first, second, strict=True))
    return red, green, blue


def _drawn(
    name: str, color: Color, route: dict[str, Any], *, is_main: bool = False, has_ellipses: bool = True
) -> _Drawn:
    path = route["path"]
    blind = [None, None, None]
    return _Drawn(
        name=name,
        color=color,
        is_main=is_main,
        has_ellipses=has_ellipses,
        figures=route,
        points=np.array([[p["x_m"], p["y_m"]] for p in path], dtype=np.float64),
        s=np.array([p["s_m"] for p in path], dtype=np.float64),
        covariance=np.array([p["covariance"] or blind for p in path], dtype=np.float64),
        triplets=[p["triplet"] for p in path],
    )


def _enlargement(routes: list[_Drawn], scale: float) -> int:
    """Factor that makes a typical ellipse about 18 px (oversampled) and a bad one not fill the picture."""
    axes = [ellipse95(r.covariance)[..., 0] for r in routes if r.has_ellipses]
    good = np.concatenate([a[np.isfinite(a)] for a in axes]) if axes else np.empty(0)
    if not len(good):
        return 1
    typical, bad = (max(float(v) * scale, 1e-9) for v in np.percentile(good, [50, 85]))
    wanted = min(18.0 / typical, 220.0 / bad)
    return min(_ENLARGEMENTS, key=lambda f: abs(math.log(f / wanted)))


def _paint_route(
    image: Image.Image, view: canvas.View, route: _Drawn, positions: dict[str, FloatArray], enlargement: int
) -> None:
    draw = ImageDraw.Draw(image, "RGBA")
    step = max(1.5, float(route.s[-1]) / 40)
    stops = np.searchsorted(route.s, np.arange(0.0, float(route.s[-1]) + 1e-9, step))
    for i in np.unique(np.minimum(stops, len(route.s) - 1)):
        for name in (route.triplets[i] or []) if route.is_main else []:
            (x0, y0), (x1, y1) = view.to_pixel(np.stack([route.points[i], positions[name]])).tolist()
            draw.line([(x0, y0), (x1, y1)], fill=(*route.color, 44), width=1)
        if route.has_ellipses:
            _paint_ellipse(draw, view, route.points[i], route.covariance[i], route.color, enlargement)
    line = [(float(x), float(y)) for x, y in view.to_pixel(route.points)]
    draw.line(line, fill=(255, 255, 255, 210), width=9, joint="curve")
    draw.line(line, fill=(*route.color, 255), width=5, joint="curve")
    if route.is_main:
        for name in sorted({n for t in route.triplets if t for n in t}):
            x, y = (float(v) for v in view.to_pixel(positions[name]))
            draw.ellipse([x - 8, y - 8, x + 8, y + 8], outline=(*route.color, 255), width=3)


def _paint_ellipse(
    draw: ImageDraw.ImageDraw,
    view: canvas.View,
    point: FloatArray,
    covariance: FloatArray,
    color: Color,
    enlargement: int,
) -> None:
    a, b, azimuth = (float(v) for v in ellipse95(covariance))
    if not enlargement * a * view.scale <= _LARGEST * view.width:
        return
    t = np.linspace(0.0, 2 * math.pi, 49)
    u, v = enlargement * a * np.cos(t), enlargement * b * np.sin(t)
    c, s = math.cos(azimuth), math.sin(azimuth)
    outline = view.to_pixel(point + np.stack([c * u - s * v, s * u + c * v], axis=1))
    polygon = [(float(x), float(y)) for x, y in outline]
    draw.polygon(polygon, fill=(*color, 60))
    draw.line(polygon, fill=(*color, 220), width=2)


def _paint_key(
    draw: ImageDraw.ImageDraw, top: int, routes: list[_Drawn], enlargement: int, largest: float
) -> None:
    for k, route in enumerate(reversed(routes)):
        y = top + 8 + 22 * k
        draw.line([(14, y), (52, y)], fill=route.color, width=4)
        text = f"{route.name}: {_figures(route.figures)}"
        canvas.write(draw, (62, y), text, size=14)
    canvas.write(draw, (14, top + 60), _note(routes, enlargement, largest, "blue"), size=12, fill=_GREY)


def _paint_table(
    draw: ImageDraw.ImageDraw, top: int, routes: list[_Drawn], enlargement: int, largest: float
) -> None:
    """One line for each route."""
    of_front = any(route.figures.get("front") for route in routes)
    columns = [62, 160, 260, 370, 490, 620, 720]
    heads = ("route", "length", "duration", "mean r95", "worst r95", "no fix")
    for x, head in zip(columns, (*heads, "" if of_front else "shared"), strict=True):
        canvas.write(draw, (x, top + 8), head, size=13, fill=_GREY)
    for k, route in enumerate(reversed(routes), 1):
        y = top + 8 + _ROW * k
        draw.line([(14, y), (52, y)], fill=route.color, width=4)
        for x, text in zip(columns, _cells(route), strict=True):
            canvas.write(draw, (x, y), text, size=14)
    y = top + 14 + _ROW * (len(routes) + 1)
    canvas.write(draw, (14, y), _note(routes, enlargement, largest, "first"), size=12, fill=_GREY)


def _cells(route: _Drawn) -> list[str]:
    figures = route.figures
    u, share = figures["uncertainty"], figures.get("share")
    return [
        route.name,
        f"{figures['length_m']:.2f} m",
        f"{figures['duration_s']:.1f} s",
        "–" if u["mean_r95_m"] is None else f"{u['mean_r95_m']:.4f} m",
        "–" if u["max_r95_m"] is None else f"{u['max_r95_m']:.4f} m",
        f"{u['blind_m']:.1f} m",
        "" if share is None or route.is_main else f"{100 * share:.0f} %",
    ]


def _note(routes: list[_Drawn], enlargement: int, largest: float, which: str) -> str:
    note = (
        f"95 % ellipses drawn {enlargement} times as large" if enlargement > 1 else "95 % ellipses to scale"
    )
    axes = [ellipse95(r.covariance)[..., 0] for r in routes if r.has_ellipses]
    if any((a > largest).any() for a in axes):
        note += f", those of more than {largest:.2g} m left out"
    if any(t for route in routes for t in route.triplets):
        note += f"; thin lines: the triplet used there; ringed dots: landmarks used on the {which} route"
    return note


def _figures(route: dict[str, Any]) -> str:
    u = route["uncertainty"]
    text = f"{route['length_m']:.1f} m, {route['duration_s']:.1f} s"
    if u["max_r95_m"] is not None:
        text += f", r95 mean {u['mean_r95_m']:.3f} m, worst {u['max_r95_m']:.3f} m"
        text += f", worst ellipse {u['max_area95_m2']:.3g} m²"
    return text + (f", blind {u['blind_m']:.1f} m" if u["blind_m"] > 0 else "")
