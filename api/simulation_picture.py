"""Simulated runs as a picture: the path with a bundle of true tracks above, errors along it below."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api import mas97_pictures_parts as parts
from api.canvas import BBox, Color, View
from localization.covariance import ellipse95
from maps.arrays import FloatArray
from maps.world import World
from planner.simulation_report import SimulationReport

_PREDICTED: Color = (0, 92, 230)
_ACTUAL: Color = (214, 79, 12)
_DEVIATION: Color = (22, 128, 84)
_TRACK: Color = (22, 128, 84)
_COLLISION: Color = (200, 16, 46)
_HEADER = 34
_MARGIN_M = 2.0
_PROFILE = 230
_ELLIPSES = 24
_TRACKS = 40
_ENLARGEMENTS = (1, 2, 5, 10, 20, 50, 100)
_MAX_MAP = 900


def simulation_png(world: World, report: SimulationReport, *, width: int = 1400, title: str = "") -> bytes:
    """Picture of a simulation.

    Parameters
    ----------
    world
        Where it took place; the picture shows it around the path.
    report
        What came of it.
    width
        Width of the picture, px; the height follows.
    title
        Text above the map.

    Raises
    ------
    InvalidPicture
        If the width makes no sense.
    """
    window = _window(world, report)
    inner = max(64, width - 2 * parts.AXIS_LEFT - 20)
    tall = (window[3] - window[1]) / (window[2] - window[0])
    side = min(inner, round(_MAX_MAP / tall))
    view = parts.big_view(window, side)
    map_height = view.height // parts.OVERSAMPLING
    below = _HEADER + map_height + parts.AXIS_BOTTOM + 40
    height = below + _PROFILE + 124
    canvas.check_size(width * parts.OVERSAMPLING, height * parts.OVERSAMPLING)
    image, draw = parts.blank(width, height)
    enlargement = _enlargement(report, view.scale)
    left = parts.AXIS_LEFT + (inner - side) // 2
    parts.place_panel(image, _map(world, report, view, enlargement), view, left, _HEADER)
    _profile(image, report, (parts.AXIS_LEFT + 24, below, inner - 24, _PROFILE))
    canvas.write(draw, (parts.AXIS_LEFT, 17), title or _title(world, report), size=16)
    _key(draw, report, below + _PROFILE + 52, enlargement)
    return canvas.encode_png(image)


def _window(world: World, report: SimulationReport) -> BBox:
    """Path, most of the tracks and collisions, with a margin within the map."""
    x0, y0, x1, y1 = world.bounds
    places = np.concatenate([report.reference.poses[:, :2], report.collision_places])
    low = np.maximum(places.min(axis=0) - _MARGIN_M, (x0, y0))
    high = np.minimum(places.max(axis=0) + _MARGIN_M, (x1, y1))
    # Not flatter than a fifth of its width, as far as the map goes.
    middle, side = 0.5 * (low + high), np.maximum(high - low, 0.2 * np.max(high - low))
    low = np.minimum(low, np.maximum(middle - 0.5 * side, (x0, y0)))
    high = np.maximum(high, np.minimum(middle + 0.5 * side, (x1, y1)))
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _enlargement(report: SimulationReport, scale: float) -> int:
    """Factor that makes a typical ellipse about 40 px (oversampled) and the largest not fill the picture."""
    axes = ellipse95(report.stations.predicted)[:, 0] * scale
    wanted = min(40.0 / max(float(np.median(axes)), 1e-9), 160.0 / max(float(axes.max()), 1e-9))
    return min(_ENLARGEMENTS, key=lambda f: abs(math.log(f / wanted)))


def _map(world: World, report: SimulationReport, view: View, enlargement: int) -> Image.Image:
    panel = parts.floor_panel(world, view)
    draw = ImageDraw.Draw(panel, "RGBA")
    path = report.reference.poses[:, :2]
    for track in report.tracks[:_TRACKS]:
        true = track[:, :2]
        known = np.isfinite(true[:, 0])
        if known.sum() > 1:
            drawn = path[known] + enlargement * (true[known] - path[known])
            draw.line(parts.pixels(view, drawn), fill=(*_TRACK, 70), width=2)
    draw.line(parts.pixels(view, path), fill=(*layers.INK, 255), width=3)
    at = report.stations
    for i in np.unique(np.linspace(0, len(at.s) - 1, _ELLIPSES).astype(int)):
        covariance = at.predicted[i] * float(enlargement) ** 2
        parts.paint_ellipse(draw, view, at.poses[i, :2], covariance, _PREDICTED, width=3)
    for x, y in parts.pixels(view, report.collision_places):
        for dx, dy in ((9, 9), (9, -9)):
            draw.line([(x - dx, y - dy), (x + dx, y + dy)], fill=(*_COLLISION, 235), width=4)
    for point, letter in ((path[0], "S"), (path[-1], "G")):
        ((x, y),) = parts.pixels(view, point[None])
        draw.ellipse([x - 15, y - 15, x + 15, y + 15], fill=layers.INK, outline=parts.WHITE, width=3)
        draw.text((x, y), letter, fill=parts.WHITE, font=canvas.font(20), anchor="mm")
    return panel


def _profile(image: Image.Image, report: SimulationReport, box: tuple[int, int, int, int]) -> None:
    """Predicted and actual errors and deviations over the way, with where runs collided."""
    left, top, width, height = box
    at = report.stations
    curves: tuple[tuple[FloatArray, Color, int], ...] = (
        (at.deviation[:, 1], _DEVIATION, 3),
        (at.sample_r95, _ACTUAL, 6),
        (at.predicted_r95, _PREDICTED, 3),
    )
    values = np.concatenate([c for c, _, _ in curves])
    values = values[np.isfinite(values) & (values > 0)]
    largest = 1.08 * float(values.max(initial=1e-6))
    smallest = float(values.min(initial=largest)) / 1.3
    scale = "log" if largest > 20 * float(np.median(values)) else "linear"
    length = max(float(at.s[-1]), 1e-9)
    low, high = (math.log10(smallest), math.log10(largest)) if scale == "log" else (0.0, largest)
    over = parts.OVERSAMPLING
    panel = Image.new("RGB", (width * over, height * over), parts.WHITE)
    pen = ImageDraw.Draw(panel, "RGBA")

    def level(v: FloatArray) -> FloatArray:
        y = np.log10(np.maximum(v, smallest)) if scale == "log" else v
        return np.asarray((high - y) / (high - low))

    marks = layers.ticks(smallest if scale == "log" else 0.0, largest, scale)
    for y in level(np.array(marks)).tolist():
        pen.line([(0, y * height * over), (width * over, y * height * over)], fill=(225, 228, 232), width=2)
    for x in (report.collision_s / length * width * over).tolist():
        pen.line([(x, (height - 16) * over), (x, height * over)], fill=(*_COLLISION, 130), width=3)
    for curve, color, thick in curves:
        known = np.isfinite(curve)
        xs, ys = at.s[known] / length * width * over, level(curve[known]) * height * over
        if len(xs) > 1:
            pen.line(list(zip(xs.tolist(), ys.tolist(), strict=True)), fill=(*color, 255), width=thick)
    image.paste(panel.resize((width, height), Image.Resampling.LANCZOS), (left, top))
    draw = ImageDraw.Draw(image)
    draw.rectangle([left, top, left + width - 1, top + height - 1], outline=layers.INK)
    for value, y in zip(marks, (top + level(np.array(marks)) * height).tolist(), strict=True):
        text = f"{value:g}"
        draw.line([(left - 5, y), (left, y)], fill=layers.INK)
        canvas.write(draw, (left - 9 - draw.textlength(text, font=canvas.font(12)), y), text, size=12)
    for metres in parts.round_numbers(0.0, length, parts.axis_step(length, width)):
        x = left + metres / length * width
        draw.line([(x, top + height), (x, top + height + 5)], fill=layers.INK)
        parts.centred(draw, x, top + height + 14, f"{metres:g}", size=12)
    parts.centred(draw, left + width / 2, top + height + 31, "length from the start, m", size=13)
    canvas.write(draw, (left - 40, top - 14), "r95 and distance, m", size=13)


def _key(draw: ImageDraw.ImageDraw, report: SimulationReport, y: float, enlargement: int) -> None:
    left = parts.AXIS_LEFT
    times = f", {enlargement} times as large" if enlargement > 1 else ""
    tracks = f"true tracks (deviation{times}); below: 95 % of distances from the path"
    rows: list[list[parts.Mark]] = [
        [
            ("line", _PREDICTED, f"predicted 95 % ellipse{times}; below: its r95"),
            ("line", _ACTUAL, "r95 of the errors"),
            ("line", layers.INK, "planned path"),
        ],
        [("line", _DEVIATION, tracks), ("line", _COLLISION, "collision")],
    ]
    for k, row in enumerate(rows):
        parts.paint_key(draw, left, y + 24 * k, row)
    nees = report.nees
    note = f"inside the ellipse claimed {100 * report.coverage.share:.1f} %, "
    note += f"predicted {100 * report.predicted_coverage.share:.1f} %; "
    note += f"NEES {nees.value:.2f} (3 if consistent); due fixes missed {100 * report.blind_share:.1f} %; "
    note += f"tracks of the first {min(_TRACKS, len(report.tracks))} runs"
    canvas.write(draw, (left, y + 56), note, size=13, fill=parts.GREY)


def _title(world: World, report: SimulationReport) -> str:
    c = report.collision
    return (
        f"{world.name}: {report.runs} runs, {report.collisions} collisions "
        f"({100 * c.share:.2g} %, 95 % bounds {100 * c.low:.2g} to {100 * c.high:.2g} %)"
    )
