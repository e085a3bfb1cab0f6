"""Simulated fixes as a picture: cloud, predicted 95 % ellipse, landmarks, danger circle and horopters."""

from __future__ import annotations

import itertools
import math

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api.canvas import BBox, Color, InvalidPicture, View
from localization.covariance import area95, ellipse95
from localization.simulation import FixCloud
from maps.arrays import FloatArray
from maps.world import World

_INSIDE: Color = (0, 92, 230)
_OUTSIDE: Color = (214, 79, 12)
_ELLIPSE: Color = (12, 24, 60)
_DANGER: Color = (200, 16, 46)
_HOROPTER: Color = (122, 62, 178)
_SIGHT: Color = (120, 128, 138)
_HEADER = 34
_FOOTER = 96
_GAP = 12
_OVERSAMPLING = 2
_MARGIN_M = 1.5
_MAX_DOTS = 10_000
_MIN_WIDTH = 200
# Beyond this many windows a circle's radius is drawn as a straight line.
_STRAIGHT = 1e5


def fix_png(world: World, cloud: FixCloud, *, width: int = 1500, title: str = "") -> bytes:
    """Picture of a cloud of fixes: on the left where robot and landmarks are, on the right the cloud.

    Parameters
    ----------
    world
        The world that the cloud was simulated in.
    cloud
        Simulated fixes of one triplet at one pose; the first 10,000 are drawn.
    width
        Width of the picture, px; the height follows.
    title
        Text above the picture.

    Raises
    ------
    InvalidPicture
        If the width makes no sense.
    """
    if width < _MIN_WIDTH:
        raise InvalidPicture(f"Width is {width} px; two panels need at least {_MIN_WIDTH} px.")
    left, right = _overview(world, cloud), _close_up(cloud)
    aspect = (left[2] - left[0]) / (left[3] - left[1])
    side = max(16, int((width - 3 * _GAP) / (aspect + 1)))
    height = side + _HEADER + _FOOTER
    canvas.check_size(width * _OVERSAMPLING, height * _OVERSAMPLING)
    image = Image.new("RGB", (width, height), (255, 255, 255))
    x = _GAP
    for window, columns in ((left, max(16, round(side * aspect))), (right, side)):
        view = canvas.fit_view(window, columns * _OVERSAMPLING, side * _OVERSAMPLING)
        panel = fix_panel(world, cloud, view)
        small = (view.width // _OVERSAMPLING, view.height // _OVERSAMPLING)
        image.paste(panel.resize(small, Image.Resampling.LANCZOS), (x, _HEADER))
        x += columns + _GAP
    draw = ImageDraw.Draw(image)
    canvas.write(draw, (_GAP, 18), title or _default_title(world, cloud), size=15)
    _paint_key(draw, height - _FOOTER + 14, cloud)
    return canvas.encode_png(image)


def circle_through(points: FloatArray, window: BBox) -> FloatArray:
    """The part near a window of the circle (or line) through three points (3, 2): a polyline (K, 2), m."""
    a, b, c = points
    size = math.hypot(window[2] - window[0], window[3] - window[1])
    middle = np.array([window[0] + window[2], window[1] + window[3]]) / 2
    u, v = b - a, c - a
    cross = u[0] * v[1] - u[1] * v[0]
    uu, vv = float(u @ u), float(v @ v)
    # |centre - a| = offset / |2 cross|, compared before it is divided: in line there is no centre.
    offset = np.array([v[1] * uu - u[1] * vv, u[0] * vv - v[0] * uu])
    if np.hypot(*offset) >= _STRAIGHT * size * abs(2 * cross):
        longest = max((u, v, c - b), key=lambda w: float(w @ w))
        along = longest / max(float(np.hypot(*longest)), 1e-300)
        nearest = a + along * float((middle - a) @ along)
        return np.stack([nearest - size * along, nearest + size * along])
    centre = a + offset / (2 * cross)
    radius = float(np.hypot(*(a - centre)))
    if radius <= size:
        t = np.linspace(0.0, 2 * math.pi, 361)
    else:
        towards = math.atan2(*(middle - centre)[::-1])
        half = min(math.pi, 1.5 * size / radius)
        t = towards + np.linspace(-half, half, 361)
    return np.asarray(centre + radius * np.stack([np.cos(t), np.sin(t)], axis=1))


def _overview(world: World, cloud: FixCloud) -> BBox:
    """Robot, triplet and most of the cloud with a margin, within the map."""
    x0, y0, x1, y1 = world.bounds
    places = np.vstack([cloud.landmarks, cloud.pose[None, :2]])
    if len(cloud.errors):
        places = np.vstack([places, cloud.pose[:2] + np.quantile(cloud.errors[:, :2], [0.01, 0.99], axis=0)])
    low = np.maximum(places.min(axis=0) - _MARGIN_M, (x0, y0))
    high = np.minimum(places.max(axis=0) + _MARGIN_M, (x1, y1))
    # Not narrower than half its height, nor lower than half its width, as far as the map goes.
    middle, side = (low + high) / 2, np.maximum(high - low, 0.7 * np.max(high - low))
    low = np.minimum(low, np.maximum(middle - side / 2, (x0, y0)))
    high = np.maximum(high, np.minimum(middle + side / 2, (x1, y1)))
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _close_up(cloud: FixCloud) -> BBox:
    """A square about the true place that holds the ellipse and most of the cloud."""
    extent = float(ellipse95(_position_covariance(cloud.predicted))[0])
    if len(cloud.errors):
        extent = max(extent, float(np.quantile(np.abs(cloud.errors[:, :2]).max(axis=1), 0.98)))
    half = 1.15 * max(extent, 1e-6)
    x, y = (float(v) for v in cloud.pose[:2])
    return (x - half, y - half, x + half, y + half)


def _position_covariance(covariance: FloatArray) -> FloatArray:
    return np.asarray(covariance[[0, 0, 1], [0, 1, 1]])


def fix_panel(world: World, cloud: FixCloud, view: View) -> Image.Image:
    """A window of the world with robot, triplet, circles, cloud and ellipse, of the size of the view."""
    image = Image.new("RGB", (view.width, view.height), (255, 255, 255))
    # A view without offset: each panel is a picture of its own.
    view = View(view.bbox, 0, 0, view.width, view.height)
    layers.paint_floor(image, view, world)
    layers.paint_obstacles(image, view, world)
    draw = ImageDraw.Draw(image, "RGBA")
    _paint_scale(draw, view)
    layers.paint_landmarks(image, view, world, radius=5.0)
    place = cloud.pose[:2]
    for landmark in cloud.landmarks:
        draw.line(_pixels(view, np.stack([place, landmark])), fill=(*_SIGHT, 150), width=2)
    for pair in itertools.combinations(range(3), 2):
        points = np.vstack([cloud.landmarks[list(pair)], place[None]])
        draw.line(_pixels(view, circle_through(points, view.bbox)), fill=(*_HOROPTER, 150), width=2)
    _paint_dashed(draw, _pixels(view, circle_through(cloud.landmarks, view.bbox)), _DANGER)
    _paint_cloud(draw, cloud, view)
    _paint_ellipse(draw, cloud, view)
    for x, y in _pixels(view, cloud.landmarks):
        draw.ellipse([x - 11, y - 11, x + 11, y + 11], outline=(*_DANGER, 255), width=3)
    x, y = _pixels(view, place[None])[0]
    for dx, dy in ((14, 0), (0, 14)):
        draw.line([(x - dx, y - dy), (x + dx, y + dy)], fill=(255, 255, 255, 255), width=7)
        draw.line([(x - dx, y - dy), (x + dx, y + dy)], fill=(*layers.INK, 255), width=3)
    draw.rectangle([0, 0, view.width - 1, view.height - 1], outline=layers.INK, width=2)
    return image


def _paint_cloud(draw: ImageDraw.ImageDraw, cloud: FixCloud, view: View) -> None:
    drawn = np.flatnonzero(cloud.fixes.ok)[:_MAX_DOTS]
    pixels = view.to_pixel(cloud.fixes.pose[drawn, :2])
    on = ((pixels >= 0) & (pixels <= (view.width, view.height))).all(axis=1)
    for (x, y), inside in zip(pixels[on].tolist(), cloud.inside[drawn][on].tolist(), strict=True):
        color = _INSIDE if inside else _OUTSIDE
        draw.ellipse([x - 3, y - 3, x + 3, y + 3], fill=(*color, 90))


def _paint_ellipse(draw: ImageDraw.ImageDraw, cloud: FixCloud, view: View) -> None:
    a, b, azimuth = (float(v) for v in ellipse95(_position_covariance(cloud.predicted)))
    t = np.linspace(0.0, 2 * math.pi, 181)
    u, v = a * np.cos(t), b * np.sin(t)
    c, s = math.cos(azimuth), math.sin(azimuth)
    outline = _pixels(view, cloud.pose[:2] + np.stack([c * u - s * v, s * u + c * v], axis=1))
    draw.line(outline, fill=(255, 255, 255, 220), width=8, joint="curve")
    draw.line(outline, fill=(*_ELLIPSE, 255), width=4, joint="curve")


def _paint_dashed(draw: ImageDraw.ImageDraw, line: list[tuple[float, float]], color: Color) -> None:
    """Dashes of equal length along a polyline, px."""
    points = np.array(line)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    dash = max(18.0, float(s[-1]) / 2000)
    for start in np.arange(0.0, float(s[-1]), 1.7 * dash):
        at = np.array([start, start + dash / 2, start + dash])
        ends = np.stack([np.interp(at, s, points[:, 0]), np.interp(at, s, points[:, 1])], axis=1)
        draw.line([(float(x), float(y)) for x, y in ends], fill=(*color, 230), width=4)


def _paint_scale(draw: ImageDraw.ImageDraw, view: View) -> None:
    """A bar of a round length at the lower left."""
    wanted = 0.2 * view.width / view.scale
    base = 10.0 ** math.floor(math.log10(wanted))
    length = max(m * base for m in (1, 2, 5) if m * base <= wanted)
    x, y = 20, view.height - 22
    end = x + length * view.scale
    draw.rectangle([x - 10, y - 40, end + 10, y + 12], fill=(255, 255, 255, 215))
    draw.line([(x, y), (end, y)], fill=(*layers.INK, 255), width=5)
    canvas.write(draw, (x, y - 22), f"{length:g} m", size=24)


def _default_title(world: World, cloud: FixCloud) -> str:
    names = ", ".join(world.landmarks.ids[i] for i in cloud.triplet)
    x, y = cloud.pose[:2]
    return f"{world.name}: fixes of {names} from ({x:.2f}, {y:.2f}) m"


def _paint_key(draw: ImageDraw.ImageDraw, top: int, cloud: FixCloud) -> None:
    predicted = float(area95(_position_covariance(cloud.predicted)))
    sample = float(area95(_position_covariance(cloud.sample_covariance)))
    n = len(cloud.fixes)
    text = f"{n} measurements, {cloud.failures} without a fix; "
    text += f"{100 * cloud.share_inside:.1f} % in the predicted 95 % ellipse"
    text += f"; its area {predicted:.3g} m²"
    if math.isfinite(sample):
        text += f", by the sample's covariance {sample:.3g} m²"
    canvas.write(draw, (_GAP, top), text, size=14)
    x = float(_GAP)
    marks = (
        ("predicted 95 % ellipse", _ELLIPSE),
        ("fix inside", _INSIDE),
        ("fix outside", _OUTSIDE),
        ("danger circle", _DANGER),
        ("horopters", _HOROPTER),
    )
    for name, color in marks:
        if name.startswith("fix"):
            draw.ellipse([x + 8, top + 23, x + 18, top + 33], fill=color)
        elif color == _DANGER:
            for start in (x, x + 15):
                draw.line([(start, top + 28), (start + 11, top + 28)], fill=color, width=3)
        else:
            draw.line([(x, top + 28), (x + 26, top + 28)], fill=color, width=3)
        canvas.write(draw, (x + 32, top + 28), name, size=13)
        x += 32 + draw.textlength(name, font=canvas.font(13)) + 22
    note = "cross: true place; horopter: circle through robot and two landmarks, with their angle unchanged"
    canvas.write(draw, (_GAP, top + 56), note, size=12, fill=(90, 96, 104))


def _pixels(view: View, points: FloatArray) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in view.to_pixel(points)]
