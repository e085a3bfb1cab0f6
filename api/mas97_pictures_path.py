"""Fig. 7 of MAS97: ellipses of both strategies along the path, and their areas over its length."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api import mas97_pictures_parts as parts
from api.canvas import Color
from localization.madsen_1997_path import PathStudy
from localization.triplets import TripletChoice
from maps.arrays import BoolArray, FloatArray, IntArray
from maps.world import World

_FORWARD_BEST: Color = (22, 128, 84)
_STEP_M = 1.5
_SIGHTS_M = 3.0
_LIMITS = (0.01, 100.0)


def figure_7(room: World, path: PathStudy) -> bytes:
    """Path with ellipses and sight lines on the left, profile of the area on the right."""
    side, top = 700, 44
    image, draw = parts.blank(2 * side + 150, side + top + 142)
    view = parts.big_view(room.bounds, side)
    parts.place_panel(image, _map(room, path, view), view, parts.AXIS_LEFT, top)
    _profile(image, path, (side + 120, top, side, side))
    title = "Fig. 7: best triplet with free pan against an arbitrary one in a camera forced forward"
    canvas.write(draw, (parts.AXIS_LEFT, 22), title, size=16)
    drive = path.typical_drive(kept=True)
    mean, low = float(path.means(kept=True)[drive]), path.mean_best
    marks: list[list[parts.Mark]] = [
        [
            ("line", parts.POOR, f"arbitrary triplet kept while in view, one drive: mean {mean:.2f} m²"),
            ("line", parts.BEST, f"best triplet, free pan: mean {low:.2f} m²"),
        ],
        [
            ("area", parts.POOR, "middle 90 % of the arbitrary triplets in view"),
            (
                "line",
                _FORWARD_BEST,
                f"best triplet in the camera forced forward: mean {path.mean_best_forward:.2f} m²",
            ),
        ],
    ]
    for k, row in enumerate(marks):
        parts.paint_key(draw, parts.AXIS_LEFT, top + side + 50 + 24 * k, row)
    note = f"95 % ellipses to scale, every {_STEP_M:g} m; lines of sight every {_SIGHTS_M:g} m; "
    note += "means over the places where both have a fix; black: path"
    canvas.write(draw, (parts.AXIS_LEFT, top + side + 108), note, size=13, fill=parts.GREY)
    return canvas.encode_png(image)


def _map(room: World, path: PathStudy, view: canvas.View) -> Image.Image:
    panel = parts.floor_panel(room, view)
    draw = ImageDraw.Draw(panel, "RGBA")
    kept = path.kept[path.typical_drive(kept=True)]
    arbitrary = [c[i] if i >= 0 else None for c, i in zip(path.forward, kept.tolist(), strict=True)]
    stops, sights = (_every(path.s, step) for step in (_STEP_M, _SIGHTS_M))
    kinds: tuple[tuple[list[TripletChoice | None], Color], ...] = (
        (arbitrary, parts.POOR),
        (list(path.best), parts.BEST),
    )
    for choices, color in kinds:
        for i in sights:
            choice = choices[i]
            if choice is not None:
                landmarks = room.landmarks.positions[list(choice.triplet)]
                parts.paint_sight(draw, view, path.points[i], landmarks, color, opacity=90, width=2)
    for choices, color in kinds:
        for i in stops:
            choice = choices[i]
            if choice is not None:
                parts.paint_ellipse(draw, view, path.points[i], choice.covariance, color, width=3)
    draw.line(parts.pixels(view, path.points), fill=(*layers.INK, 255), width=4)
    for x, y in parts.pixels(view, path.points[stops]):
        draw.ellipse([x - 6, y - 6, x + 6, y + 6], fill=(*layers.INK, 255), outline=(*parts.WHITE, 255))
    return panel


def _every(s: FloatArray, step: float) -> list[int]:
    wanted = np.arange(0.0, float(s[-1]) + 1e-9, step)
    return [int(i) for i in np.minimum(np.searchsorted(s, wanted - 1e-9), len(s) - 1)]


def _profile(image: Image.Image, path: PathStudy, box: tuple[int, int, int, int]) -> None:
    """Areas over the length of the path, on a log scale."""
    left, top, width, height = box
    scale = parts.OVERSAMPLING
    panel = Image.new("RGB", (width * scale, height * scale), parts.WHITE)
    pen = ImageDraw.Draw(panel, "RGBA")
    length = float(path.s[-1])
    low, high = (math.log10(v) for v in _LIMITS)

    def at(s: FloatArray, areas: FloatArray) -> list[tuple[float, float]]:
        x = s / length * width * scale
        y = (high - np.log10(areas)) / (high - low) * height * scale
        return [(float(u), float(v)) for u, v in zip(x, y, strict=True)]

    for value in layers.ticks(*_LIMITS, "log"):
        pen.line(at(np.array([0.0, length]), np.full(2, value)), fill=(225, 228, 232), width=2)
    areas = path.forward_areas
    seen = np.isfinite(areas[:, 0])
    for run in _runs(~seen):
        (x0, _), (x1, _) = at(path.s[[run[0], run[-1]]], np.ones(2))
        pen.rectangle([x0, 0, x1, height * scale], fill=(238, 238, 236))
    for run in _runs(seen):
        s = path.s[run]
        bounds = [at(s, np.nanpercentile(areas[run], q, axis=1)) for q in (5, 95)]
        pen.polygon([*bounds[0], *reversed(bounds[1])], fill=(*parts.POOR, 60))
    kept = path.kept[path.typical_drive(kept=True)]
    drive = np.where(kept >= 0, areas[np.arange(len(kept)), kept], np.nan)
    for values, color in (
        (areas[:, 0], _FORWARD_BEST),
        (drive, parts.POOR),
        (path.best_areas, parts.BEST),
    ):
        for run in _runs(np.isfinite(values)):
            pen.line(at(path.s[run], values[run]), fill=(*color, 255), width=5, joint="curve")
    image.paste(panel.resize((width, height), Image.Resampling.LANCZOS), (left, top))
    draw = ImageDraw.Draw(image)
    draw.rectangle([left, top, left + width - 1, top + height - 1], outline=layers.INK)
    for value in layers.ticks(*_LIMITS, "log"):
        y = top + (high - math.log10(value)) / (high - low) * height
        text = f"{value:g}"
        draw.line([(left - 5, y), (left, y)], fill=layers.INK)
        canvas.write(draw, (left - 9 - draw.textlength(text, font=canvas.font(12)), y), text, size=12)
    for metres in parts.round_numbers(0.0, length, 2.0):
        x = left + metres / length * width
        draw.line([(x, top + height), (x, top + height + 5)], fill=layers.INK)
        parts.centred(draw, x, top + height + 14, f"{metres:g}", size=12)
    parts.centred(draw, left + width / 2, top + height + 32, "length from the start, m", size=13)
    canvas.write(draw, (left - 40, top - 14), "area of the 95 % ellipse, m²", size=13)
    if (~seen).any():
        middle = left + float(path.s[~seen].mean()) / length * width
        parts.centred(draw, middle, top + 22, "forward: fewer than three", size=13, fill=parts.GREY)
        parts.centred(draw, middle, top + 40, "landmarks in one view", size=13, fill=parts.GREY)


def _runs(flags: BoolArray) -> list[IntArray]:
    """Stretches of consecutive indices where a flag is set."""
    on = np.flatnonzero(flags).astype(np.int64)
    return [r for r in np.split(on, np.flatnonzero(np.diff(on) > 1) + 1) if len(r)]
