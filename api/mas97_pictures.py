"""Figs. 3, 4, 6, 7 and 8 of MAS97 as pictures of what :mod:`localization.madsen_1997` computes."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from api import canvas, layers
from api import mas97_pictures_parts as parts
from api.canvas import BBox
from api.fix_picture import fix_panel, fix_png
from api.mas97_pictures_path import figure_7
from localization.covariance import CHI2_95, ellipse95
from localization.madsen_1997 import Reproduction, area, full_axes
from localization.madsen_1997_scenes import TOPOLOGY_PLACE, Topology, position_covariance
from localization.simulation import FixCloud
from maps.world import World

_COLORS = "viridis"
_LIMITS = (0.01, 100.0)


def pictures(r: Reproduction) -> dict[int, bytes]:
    """PNG of every figure, by its number in the paper."""
    return {
        3: figure_3(r),
        4: figure_4(r),
        6: figure_6(r.topologies),
        7: figure_7(r.room, r.path),
        8: figure_8(r),
    }


def figure_3(r: Reproduction) -> bytes:
    """Fixes of a poor triplet and their predicted ellipse."""
    x, y = (float(v) for v in r.poor.pose[:2])
    length, width = full_axes(r.poor.predicted)
    title = f"Fig. 3: fixes of a poor triplet, {_names(r.room, r.poor)}, from ({x:g}, {y:g}) m; "
    title += f"predicted 95 % ellipse {length:.2f} m by {width:.2f} m"
    return fix_png(r.room, r.poor, title=title)


def figure_4(r: Reproduction) -> bytes:
    """Poor and best triplet of one place: sight lines on the left, clouds and ellipses on the right."""
    side, top = 700, 44
    image, draw = parts.blank(2 * side + 3 * parts.AXIS_LEFT, side + top + 112)
    place = r.poor.pose[:2]
    kinds = ((r.poor, parts.POOR), (r.better, parts.BEST))
    half = 1.5 * float(ellipse95(position_covariance(r.poor.predicted))[0])
    near = (place[0] - half, place[1] - half, place[0] + half, place[1] + half)
    x0, y0, x1, y1 = r.room.bounds
    for window, left in (((x0, y0, x1, y1), parts.AXIS_LEFT), (near, 2 * parts.AXIS_LEFT + side + 12)):
        view = parts.big_view(window, side)
        panel = parts.floor_panel(r.room, view)
        pen = ImageDraw.Draw(panel, "RGBA")
        # Both may use the same landmark: the best triplet's lines lie, thinner, on the poor one's.
        for (cloud, color), width, opacity in zip(kinds, (9, 3), (110, 255), strict=True):
            parts.paint_sight(
                pen, view, place, cloud.landmarks, color, opacity=opacity, width=width, radius=8 + width
            )
        for cloud, color in kinds:
            if window == near:
                parts.paint_dots(pen, view, cloud.fixes.pose[cloud.fixes.ok, :2], color)
        for cloud, color in kinds:
            covariance = position_covariance(cloud.predicted)
            parts.paint_ellipse(pen, view, place, covariance, color, width=5)
        parts.paint_cross(pen, view, place)
        if window != near:
            _paint_window(pen, view, near)
        parts.place_panel(image, panel, view, left, top)
    title = f"Fig. 4: two triplets from ({place[0]:g}, {place[1]:g}) m, 95 % ellipses to scale"
    canvas.write(draw, (parts.AXIS_LEFT, 22), title, size=16)
    y = top + side + 50
    for (cloud, color), what in zip(kinds, ("poor", "best"), strict=True):
        text = f"{what}: {_names(r.room, cloud)}, {area(cloud.predicted):.2f} m² predicted, "
        text += f"{area(cloud.sample_covariance):.2f} m² by {len(cloud.fixes)} simulated fixes, "
        text += f"{100 * cloud.share_inside:.1f} % of them inside"
        parts.paint_key(draw, parts.AXIS_LEFT, y, [("line", color, text)])
        y += 24
    return canvas.encode_png(image)


def figure_6(topologies: tuple[Topology, ...]) -> bytes:
    """Area of the ellipse over an empty room, three layouts in one scale of colours."""
    side, top, gap = 430, 66, 46
    width = 3 * (side + gap) + 130
    image, draw = parts.blank(width, side + top + 86)
    for k, t in enumerate(topologies):
        world = t.field.world
        view = parts.big_view(world.bounds, side)
        # Hatching and stripes are made for one pixel of the picture: painted small, then enlarged.
        small = canvas.fit_view(world.bounds, side, side)
        panel = Image.new("RGB", (side, side), parts.WHITE)
        layers.paint_floor(panel, small, world)
        layers.paint_field(
            panel, small, t.field, metric="area95_m2", colormap=_COLORS, limits=_LIMITS, scale="log"
        )
        panel = panel.resize((view.width, view.height), Image.Resampling.NEAREST)
        pen = ImageDraw.Draw(panel, "RGBA")
        for x, y in parts.pixels(view, world.landmarks.positions):
            pen.ellipse([x - 8, y - 8, x + 8, y + 8], fill=(214, 39, 40), outline=parts.WHITE, width=2)
        parts.paint_cross(pen, view, np.array(TOPOLOGY_PLACE))
        left = parts.AXIS_LEFT + k * (side + gap)
        parts.place_panel(image, panel, view, left, top)
        canvas.write(draw, (left, 50), f"{t.name}; {t.area:.2f} m² at the cross", size=14)
    canvas.write(
        draw, (parts.AXIS_LEFT, 20), "Fig. 6: area of the 95 % ellipse, three layouts of one triplet", size=16
    )
    layers.paint_color_bar(
        image,
        width - 112,
        colormap=_COLORS,
        limits=_LIMITS,
        scale="log",
        title="area95 [m²]",
        doubtful=True,
    )
    x, y = TOPOLOGY_PLACE
    note = (
        f"cross: ({x:g}, {y:g}) m, the place of the printed areas; red dots: landmarks; no fix: the triplet "
    )
    note += "does not fit the field of view, or the place is in line with it; not valid: first order fails"
    canvas.write(draw, (parts.AXIS_LEFT, side + top + 58), note, size=13, fill=parts.GREY)
    return canvas.encode_png(image)


def figure_8(r: Reproduction) -> bytes:
    """Clouds of the worst triplets, at one scale."""
    side, top = 700, 66
    window = _around(r.room, r.worst)
    height = parts.big_view(window, side).height // parts.OVERSAMPLING
    image, draw = parts.blank(2 * side + 3 * parts.AXIS_LEFT, height + top + 112)
    for k, (cloud, bend) in enumerate(zip(r.worst, r.bends, strict=True)):
        x, y = (float(v) for v in cloud.pose[:2])
        view = parts.big_view(window, side)
        left = parts.AXIS_LEFT + k * (side + parts.AXIS_LEFT + 12)
        parts.place_panel(image, fix_panel(r.room, cloud, view), view, left, top)
        text = f"{_names(r.room, cloud)} from ({x:g}, {y:g}) m: {area(cloud.predicted):.1f} m², "
        text += f"{100 * cloud.share_inside:.0f} % of {len(cloud.fixes)} fixes inside"
        canvas.write(draw, (left, 50), text, size=14)
        pair = " and ".join(r.room.landmarks.ids[i] for i in bend.pair)
        text = f"rms distance of the fixes: {bend.rms_horopter:.2f} m from the horopter of {pair}, "
        text += f"{bend.rms_axis:.2f} m from the ellipse's axis"
        canvas.write(draw, (left, top + height + 46), text, size=13)
    canvas.write(draw, (parts.AXIS_LEFT, 20), "Fig. 8: worst triplets, fixes lie on a curve", size=16)
    marks: list[parts.Mark] = [
        ("line", (12, 24, 60), "predicted 95 % ellipse"),
        ("dot", (0, 92, 230), "fix inside"),
        ("dot", (214, 79, 12), "fix outside"),
        ("dash", (200, 16, 46), "danger circle of the triplet"),
        ("thin", (122, 62, 178), "horopters: circles through robot and two landmarks"),
    ]
    parts.paint_key(draw, parts.AXIS_LEFT, top + height + 80, marks)
    return canvas.encode_png(image)


def _names(room: World, cloud: FixCloud) -> str:
    return ", ".join(room.landmarks.ids[i] for i in cloud.triplet)


def _around(room: World, clouds: tuple[FixCloud, ...]) -> BBox:
    """The room, the ellipses and nearly all of the clouds, with a margin."""
    places = [np.array(room.bounds).reshape(2, 2)]
    for cloud in clouds:
        xx, _, yy = position_covariance(cloud.predicted)
        reach = np.sqrt(CHI2_95 * np.array([xx, yy]))
        places += [cloud.pose[:2] - reach, cloud.pose[:2] + reach]
        places.append(cloud.pose[:2] + np.quantile(cloud.errors[:, :2], [0.005, 0.995], axis=0))
    all_of_them = np.vstack(places)
    (x0, y0), (x1, y1) = all_of_them.min(axis=0) - 1.0, all_of_them.max(axis=0) + 1.0
    return (float(x0), float(y0), float(x1), float(y1))


def _paint_window(draw: ImageDraw.ImageDraw, view: canvas.View, window: BBox) -> None:
    """Where the panel beside is."""
    x0, y0, x1, y1 = window
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
    draw.line(parts.pixels(view, corners), fill=(*parts.GREY, 255), width=2)
