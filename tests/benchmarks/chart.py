"""Line charts on logarithmic axes, drawn with Pillow."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw

from api.canvas import font

WIDTH, HEIGHT = 760, 520
LEFT, RIGHT, TOP, BOTTOM = 78, 24, 64, 62
INK, FAINT, GRID = (32, 36, 42), (104, 110, 120), (226, 229, 233)
COLOURS = ((0, 92, 168), (200, 80, 20), (40, 130, 70), (130, 60, 150))
_FINE = 3  # drawn larger and scaled down


class _Axis:
    """A logarithmic axis: ends at 1, 2 or 5 times a power of ten around the values."""

    def __init__(self, values, start, stop):
        ticks = sorted(m * 10.0**e for e in range(-9, 10) for m in (1, 2, 5))
        low = max(t for t in ticks if t <= min(values) * 1.0001)
        high = min(t for t in ticks if t >= max(values) * 0.9999)
        self.ticks = [t for t in ticks if low * 0.999 <= t <= high * 1.001]
        if len(self.ticks) > 8:
            self.ticks = [t for t in self.ticks if abs(math.log10(t) - round(math.log10(t))) < 1e-9]
        self._low, self._high = math.log10(low), math.log10(high)
        self._start, self._stop = start, stop

    def at(self, value):
        """Pixel of a value."""
        share = (math.log10(value) - self._low) / (self._high - self._low)
        return self._start + share * (self._stop - self._start)


def number(value):
    """1, 20, 1k, 4M; small ones as they are."""
    for unit, name in ((1e6, "M"), (1e3, "k")):
        if value >= unit:
            return f"{value / unit:g}{name}"
    return f"{value:g}"


def log_chart(path, title, x_label, y_label, series):
    """Write a PNG; ``series`` maps names to (x, y), all positive."""
    everything = [np.concatenate([np.asarray(s[k], dtype=float) for s in series.values()]) for k in (0, 1)]
    x_axis = _Axis(everything[0], LEFT, WIDTH - RIGHT)
    y_axis = _Axis(everything[1], HEIGHT - BOTTOM, TOP)
    image = Image.new("RGB", (WIDTH * _FINE, HEIGHT * _FINE), "white")
    draw = ImageDraw.Draw(image)

    def line(points, fill, width):
        draw.line(
            [(x * _FINE, y * _FINE) for x, y in points], fill=fill, width=round(width * _FINE), joint="curve"
        )

    def text(x, y, words, size, anchor, fill=INK):
        draw.text((x * _FINE, y * _FINE), words, fill=fill, font=font(size * _FINE), anchor=anchor)

    for tick in x_axis.ticks:
        x = x_axis.at(tick)
        line([(x, TOP), (x, HEIGHT - BOTTOM)], GRID, 1)
        text(x, HEIGHT - BOTTOM + 8, number(tick), 13, "mt", FAINT)
    for tick in y_axis.ticks:
        y = y_axis.at(tick)
        line([(LEFT, y), (WIDTH - RIGHT, y)], GRID, 1)
        text(LEFT - 8, y, number(tick), 13, "rm", FAINT)
    line([(LEFT, TOP), (LEFT, HEIGHT - BOTTOM), (WIDTH - RIGHT, HEIGHT - BOTTOM)], FAINT, 1)
    text(LEFT, 12, title, 16, "lt")
    text(LEFT, 38, y_label, 13, "lt", FAINT)
    text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 14, x_label, 13, "mb", FAINT)
    names = []
    for colour, (name, (xs, ys)) in zip(COLOURS, series.items(), strict=False):
        points = [(x_axis.at(x), y_axis.at(y)) for x, y in zip(xs, ys, strict=True)]
        line(points, colour, 2)
        for x, y in points:
            box = [(x - 3.5) * _FINE, (y - 3.5) * _FINE, (x + 3.5) * _FINE, (y + 3.5) * _FINE]
            draw.ellipse(box, fill=colour)
        names.append((name, colour))
    for k, (name, colour) in enumerate(names):
        y = TOP + 16 + 20 * k
        line([(LEFT + 14, y), (LEFT + 38, y)], colour, 2)
        text(LEFT + 46, y, name, 13, "lm")
    image = image.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
    image.quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)
