"""A matrix as a picture: the places on the map, and beside them the figures of every pair, coloured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api.colormaps import COLORMAPS
from api.sheet import HEADER, Sheet
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray
from planner.matrix import CostMatrix

#: More places than these do not fit in a table.
MAX_DRAWN = 12
_CELL = 58
_ROW = 26
_NAMES = 110


def matrix_png(
    field: UncertaintyField,
    matrix: CostMatrix,
    sources: Sequence[str],
    targets: Sequence[str],
    *,
    width: int = 1300,
) -> bytes:
    """Picture of a matrix.

    Parameters
    ----------
    field
        The field in which it was found.
    matrix
        N × M pairs; the first ``MAX_DRAWN`` of each side are drawn.
    sources, targets
        N and M names.
    width
        Width of the picture, px; the height follows.

    Raises
    ------
    InvalidPicture
        If the width makes no sense.
    """
    n, m = min(len(sources), MAX_DRAWN), min(len(targets), MAX_DRAWN)
    side = _NAMES + m * _CELL + 24
    tables = 2 * (_ROW * (n + 2) + 20)
    sheet = Sheet.of(field.frame.bounds(), width, beside=side + 24, below=12, least=tables)
    view, big = sheet.view, sheet.floor(field, opacity=0.4)
    for names, places in ((targets[:m], matrix.targets[:m]), (sources[:n], matrix.sources[:n])):
        _mark(big, view, names, places)
    image, draw = sheet.with_map(big, field.world.name)
    left = width - side + 12
    titles = (("length [m]", matrix.length, 1), ("worst r95 [m]", matrix.worst_r95, 3))
    for k, (title, values, digits) in enumerate(titles):
        top = HEADER + k * (_ROW * (n + 2) + 20)
        _table(draw, (left, top), title, values[:n, :m], digits, (sources[:n], targets[:m]))
    return canvas.encode_png(image)


def _mark(image: Image.Image, view: canvas.View, names: Sequence[str], places: FloatArray) -> None:
    draw = ImageDraw.Draw(image)
    for name, place in zip(names, places, strict=True):
        x, y = (float(v) for v in view.to_pixel(place))
        if not (0 <= x < view.width and 0 <= y < view.height):
            continue
        draw.ellipse([x - 11, y - 11, x + 11, y + 11], fill=layers.INK, outline=(255, 255, 255), width=3)
        draw.text(
            (x, y - 16),
            canvas.plain(name),
            fill=layers.INK,
            font=canvas.font(24),
            anchor="mb",
            stroke_width=4,
            stroke_fill="white",
        )


def _table(
    draw: ImageDraw.ImageDraw,
    at: tuple[int, int],
    title: str,
    values: FloatArray,
    digits: int,
    names: tuple[Sequence[str], Sequence[str]],
) -> None:
    """One row per source; the darker, the more."""
    left, top = at
    canvas.write(draw, (left, top + _ROW / 2), title, size=14)
    known = values[np.isfinite(values)]
    most = float(known.max()) if len(known) and known.max() > 0 else 1.0
    for j, name in enumerate(names[1]):
        x = left + _NAMES + (j + 0.5) * _CELL
        draw.text(
            (x, top + 1.5 * _ROW), canvas.plain(name[:7]), fill=layers.INK, font=canvas.font(12), anchor="mm"
        )
    for i, name in enumerate(names[0]):
        y = top + (i + 2) * _ROW
        draw.text(
            (left, y + _ROW / 2), canvas.plain(name[:14]), fill=layers.INK, font=canvas.font(12), anchor="lm"
        )
        for j, value in enumerate(values[i]):
            x = left + _NAMES + j * _CELL
            share = 0.0 if not np.isfinite(value) else float(value) / most
            color = tuple(int(v) for v in COLORMAPS["viridis"][255 - round(200 * share)])
            fill = color if np.isfinite(value) else layers.OUTSIDE
            ink = (255, 255, 255) if np.isfinite(value) and share > 0.55 else layers.INK
            draw.rectangle([x + 1, y + 1, x + _CELL - 2, y + _ROW - 2], fill=fill)
            text = f"{value:.{digits}f}" if np.isfinite(value) else "-"
            middle = (x + _CELL / 2, y + _ROW / 2)
            draw.text(middle, text, fill=ink, font=canvas.font(12), anchor="mm")
