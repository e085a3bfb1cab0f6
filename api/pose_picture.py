"""A plan of a robot with a heading as a picture: its outline along the way, both gears told apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import ImageDraw

from api import canvas, layers, plan_marks
from api.canvas import Color, View
from api.sheet import BAR, Sheet
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray
from maps.world import World
from planner.problem import PlanningProblem

_FORWARDS: Color = (0, 92, 230)
_BACKWARDS: Color = (190, 0, 110)
_TURNING: Color = (80, 80, 90)
_SHORTEST: Color = (214, 79, 12)
_GREY: Color = (90, 96, 104)
_FOOTER = 84
_MARGIN_M = 1.5
_LEAST_M = 8.0
_DISC_CORNERS = 48
# Slower than this it does not drive, m/s.
_REST = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """A motion as poses.

    Attributes
    ----------
    poses
        Shape (K, 3): x, y (m), heading (rad), W.
    gear
        Shape (K,): 1 forwards, -1 backwards, 0 at rest or turning in place.
    """

    poses: FloatArray
    gear: FloatArray


def pose_png(
    field: UncertaintyField,
    answer: dict[str, Any],
    problem: PlanningProblem,
    *,
    width: int = 1100,
    title: str = "",
) -> bytes:
    """Picture of a plan around its routes, with the robot's outline along the first one.

    Parameters
    ----------
    field
        What is shown below; of a field over headings a view of it.
    answer
        The answer of ``POST /v1/plans``, with headings in its trajectory.
    problem
        The question: outline or radius, and the headings at the ends.
    width
        Width of the picture, px; the height follows.
    title
        Text above the map.

    Raises
    ------
    InvalidPicture
        If the width makes no sense.
    """
    motion = poses_of(answer["routes"][0]) if answer["routes"] else None
    shortest = answer.get("shortest_baseline")
    other = None if shortest is None else np.array([[p["x_m"], p["y_m"]] for p in shortest["path"]])
    window = _window(field.world, problem, motion, other)
    sheet = Sheet.of(window, width, beside=BAR, below=_FOOTER)
    view, big = sheet.view, sheet.floor(field, opacity=0.45)
    plan_marks.paint_areas(big, view, answer["request"])
    layers.paint_landmarks(big, view, field.world, radius=6.0)
    draw = ImageDraw.Draw(big, "RGBA")
    if other is not None:
        _line(draw, view, other, _SHORTEST, 4)
    if motion is not None:
        _paint_sights(draw, view, answer["routes"][0]["path"], field.world)
        _paint_motion(draw, view, motion, outline_of(problem))
    plan_marks.paint_places(big, view, answer)
    _paint_ends(draw, view, problem)
    image, key = sheet.with_map(big, title or f"{field.world.name}: {answer['status']}")
    sheet.paint_bar(image, field)
    _paint_key(key, sheet.height - _FOOTER + 10, answer, motion)
    return canvas.encode_png(image)


def poses_of(route: dict[str, Any]) -> Poses:
    """Poses and gears of a route's trajectory; without headings the robot faces the way that it drives."""
    rows = route["trajectory"]
    at = np.array([[p["x_m"], p["y_m"]] for p in rows])
    velocity = np.array([[p["vx_m_s"], p["vy_m_s"]] for p in rows])
    if all(p.get("theta_rad") is not None for p in rows):
        heading = np.array([p["theta_rad"] for p in rows])
    else:
        heading = _directions(at)
    ahead = velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)
    gear = np.where(np.abs(ahead) < _REST, 0.0, np.sign(ahead))
    return Poses(np.column_stack([at, heading]), gear)


def outline_of(problem: PlanningProblem) -> FloatArray:
    """Corners (K, 2) of the robot's outline in its own frame, m; of a disc without a footprint."""
    if problem.footprint is not None:
        return np.array(problem.footprint, dtype=np.float64)
    angle = np.linspace(0.0, 2 * math.pi, _DISC_CORNERS, endpoint=False)
    return problem.radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _directions(at: FloatArray) -> FloatArray:
    """Direction of travel (K,), rad; at rest the one before."""
    step = np.gradient(at, axis=0) if len(at) > 1 else np.zeros_like(at)
    moving = np.hypot(*step.T) > 0
    last = np.maximum.accumulate(np.where(moving, np.arange(len(at)), int(np.argmax(moving))))
    return np.asarray(np.arctan2(step[last, 1], step[last, 0]))


def _window(
    world: World, problem: PlanningProblem, motion: Poses | None, other: FloatArray | None
) -> canvas.BBox:
    """Around the routes, at least 8 m wide, within the map."""
    places = [np.array([problem.start, problem.goal])]
    if motion is not None:
        places.append(motion.poses[:, :2])
    if other is not None:
        places.append(other)
    reach = float(np.hypot(*outline_of(problem).T).max()) + _MARGIN_M
    every = np.concatenate(places)
    low, high = every.min(axis=0) - reach, every.max(axis=0) + reach
    side = np.maximum(high - low, _LEAST_M)
    side = np.maximum(side, np.array([1.0, 0.4]) * side.max())
    x0, y0, x1, y1 = world.bounds
    side = np.minimum(side, (x1 - x0, y1 - y0))
    low = np.clip(0.5 * (low + high - side), (x0, y0), np.array([x1, y1]) - side)
    return (float(low[0]), float(low[1]), float(low[0] + side[0]), float(low[1] + side[1]))


def _line(draw: ImageDraw.ImageDraw, view: View, points: FloatArray, color: Color, width: int) -> None:
    line = [(float(x), float(y)) for x, y in view.to_pixel(points)]
    if len(line) < 2:
        return
    draw.line(line, fill=(255, 255, 255, 210), width=width + 4, joint="curve")
    draw.line(line, fill=(*color, 255), width=width, joint="curve")


def _paint_sights(draw: ImageDraw.ImageDraw, view: View, path: list[dict[str, Any]], world: World) -> None:
    """Thin lines to the landmarks used, about every metre."""
    positions = dict(zip(world.landmarks.ids, world.landmarks.positions, strict=True))
    next_at = 0.0
    for point in path:
        if point["s_m"] < next_at:
            continue
        next_at = point["s_m"] + 1.0
        for name in point["triplet"] or ():
            ends = view.to_pixel(np.stack([(point["x_m"], point["y_m"]), positions[name]]))
            draw.line([(float(x), float(y)) for x, y in ends], fill=(*_FORWARDS, 90), width=2)


def _paint_motion(draw: ImageDraw.ImageDraw, view: View, motion: Poses, outline: FloatArray) -> None:
    for k in _shown(motion, outline):
        color = _color(motion.gear[k])
        _paint_outline(draw, view, motion.poses[k], outline, color)
    at, gear = motion.poses[:, :2], motion.gear
    begin = 0
    for k in range(1, len(at) + 1):
        if k < len(at) and gear[k] == gear[begin]:
            continue
        if gear[begin] != 0:
            part = at[max(begin - 1, 0) : min(k + 1, len(at))]
            _line(draw, view, part, _color(gear[begin]), 5)
        begin = k


def _shown(motion: Poses, outline: FloatArray) -> list[int]:
    """Poses at which the outline is drawn: the ends, and where it has moved on by most of itself."""
    size = float(np.ptp(outline[:, 0]))
    reach = float(np.hypot(*outline.T).max())
    steps = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T)
    turns = np.abs((np.diff(motion.poses[:, 2]) + math.pi) % (2 * math.pi) - math.pi)
    moved = np.concatenate([[0.0], np.cumsum(steps / (0.9 * size) + turns * reach / (1.6 * size))])
    stations = np.arange(0.0, moved[-1] + 1e-9, 1.0)
    kept = set(np.minimum(np.searchsorted(moved, stations), len(moved) - 1).tolist())
    return sorted(kept | {len(moved) - 1})


def _color(gear: float) -> Color:
    return _FORWARDS if gear > 0 else _BACKWARDS if gear < 0 else _TURNING


def _paint_outline(
    draw: ImageDraw.ImageDraw, view: View, pose: FloatArray, outline: FloatArray, color: Color
) -> None:
    x, y, theta = (float(v) for v in pose)
    c, s = math.cos(theta), math.sin(theta)
    turn = np.array([[c, s], [-s, c]])
    body = [(float(u), float(v)) for u, v in view.to_pixel(outline @ turn + (x, y))]
    draw.polygon(body, fill=(*color, 46))
    draw.line([*body, body[0]], fill=(*color, 230), width=3, joint="curve")
    nose = np.array([[0.0, 0.0], [float(outline[:, 0].max()), 0.0]]) @ turn + (x, y)
    draw.line([(float(u), float(v)) for u, v in view.to_pixel(nose)], fill=(*color, 230), width=3)


def _paint_ends(draw: ImageDraw.ImageDraw, view: View, problem: PlanningProblem) -> None:
    ends = (
        (problem.start, problem.start_heading, "S"),
        (problem.goal, problem.goal_heading, "G"),
    )
    for place, heading, letter in ends:
        x, y = (float(v) for v in view.to_pixel(place))
        if heading is not None:
            _paint_arrow(draw, (x, y), heading, 58.0)
        draw.ellipse([x - 15, y - 15, x + 15, y + 15], fill=layers.INK, outline=(255, 255, 255), width=3)
        draw.text((x, y), letter, fill=(255, 255, 255), font=canvas.font(20), anchor="mm")


def _paint_arrow(draw: ImageDraw.ImageDraw, at: tuple[float, float], heading: float, length: float) -> None:
    """An arrow from a place in the picture; headings turn the other way there."""
    x, y = at
    c, s = math.cos(heading), -math.sin(heading)
    tip = (x + length * c, y + length * s)
    back, side = length - 22.0, 12.0
    wings = [(x + back * c + k * side * s, y + back * s - k * side * c) for k in (-1, 1)]
    for grow, color in ((4, (255, 255, 255)), (0, layers.INK)):
        draw.line([(x, y), (x + back * c, y + back * s)], fill=color, width=6 + 2 * grow)
        if not grow:
            draw.polygon([tip, *wings], fill=color)


def _paint_key(draw: ImageDraw.ImageDraw, top: int, answer: dict[str, Any], motion: Poses | None) -> None:
    if motion is None:
        return
    y = top + 8
    used = [(1.0, "forwards"), (-1.0, "backwards"), (0.0, "turning in place")]
    x = 14.0
    shown = [(gear, name) for gear, name in used if _does(motion, gear)]
    for gear, name in shown:
        draw.line([(x, y), (x + 38, y)], fill=_color(gear), width=4)
        canvas.write(draw, (x + 46, y), name, size=14)
        x += 60 + draw.textlength(name, font=canvas.font(14))
    canvas.write(draw, (x + 8, y), _figures(answer["routes"][0]), size=14)
    shortest = answer.get("shortest_baseline")
    if shortest is not None:
        draw.line([(14, y + 22), (52, y + 22)], fill=_SHORTEST, width=4)
        text = f"shortest for a disc that needs no heading: {_figures(shortest)}"
        canvas.write(draw, (60, y + 22), text, size=14)
    note = "outlines of the robot along its way, a line towards its front; thin lines: the triplet used there"
    if any(answer["request"][end].get("theta_rad") is not None for end in ("start", "goal")):
        note += "; arrows: headings asked for"
    canvas.write(draw, (14, y + 52), note, size=12, fill=_GREY)


def _does(motion: Poses, gear: float) -> bool:
    if gear != 0:
        return bool((motion.gear == gear).any())
    resting = motion.gear == 0
    turns = np.abs((np.diff(motion.poses[:, 2]) + math.pi) % (2 * math.pi) - math.pi)
    return bool(turns[resting[1:] & resting[:-1]].sum() > 0.05)


def _figures(route: dict[str, Any]) -> str:
    u = route["uncertainty"]
    text = f"{route['length_m']:.2f} m, {route['duration_s']:.1f} s"
    if u["max_r95_m"] is not None:
        text += f", worst r95 {u['max_r95_m']:.3f} m"
    if u["blind_m"] > 0:
        text += f", no fix {u['blind_m']:.1f} m"
    return text
