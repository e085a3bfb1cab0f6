"""A cheaper way from pose to pose: curves that leave poses out, and poses moved while the cost falls."""

from __future__ import annotations

import math
import time

import numpy as np

from maps.arrays import FloatArray, IntArray
from planner.clock import flag_at
from planner.kernels import pose_chain as kernel
from planner.kernels.steering import TURNING
from planner.steering import PoseCurve, PoseSpace

# Poses that a curve may leave out.
_WINDOW = 32
_MAX_NODES = 160
_SMALLEST_NODE_M = 0.25
_SPACINGS_M = (3.0, 1.5, 0.75)
#: A part more must gain this much, m: the robot has to steer anew at each.
PART_M = 0.02
_MAX_SWEEPS = 30
_GAIN = 1e-9


def shorten_poses(
    curve: PoseCurve,
    space: PoseSpace,
    *,
    deadline_at: float = math.inf,
    free_start: bool = False,
    free_goal: bool = False,
) -> tuple[PoseCurve, float]:
    """A way of lower cost around a given one.

    Poses along the way are joined by shortest curves that leave out others where that is cheaper (dynamic
    programming); then the poses that are left, and some between, are moved and turned while the cost falls.

    Parameters
    ----------
    curve
        A valid way; its ends stay.
    space
        What is allowed, and at which cost.
    deadline_at
        ``time.monotonic()`` after which the best so far is returned, s.
    free_start, free_goal
        Whether a robot that turns in place may begin or end with another heading.

    Returns
    -------
    curve, cost
        Never dearer than the way given.
    """
    best, cost = curve, space.cost(curve)
    if not math.isfinite(cost) or len(curve.parts) == 0:
        return best, cost

    given = cost

    def consider(found: PoseCurve) -> None:
        nonlocal best, cost
        value = space.cost(found)
        parts = PART_M * (len(found.parts) - len(best.parts))
        if value <= given and value + parts < cost * (1.0 - _GAIN):
            best, cost = found, value

    free = free_start, free_goal
    consider(pulled(best, space, free=free))
    with flag_at(deadline_at) as stop:
        for spacing in _SPACINGS_M:
            if time.monotonic() >= deadline_at:
                break
            poses = _nodes(best, spacing, space, free)
            if len(poses) > 2:
                args = _chain_args(space)
                turn = 0.25 * spacing / max(space.steering.min_turn_radius, spacing)
                smallest = space.cost_space.frame.resolution / 16.0
                kernel.relax_chain(
                    *args[:2], poses, 0.25 * spacing, turn, smallest, _MAX_SWEEPS, stop, *args[2:]
                )
                consider(chain(poses, space))
            if time.monotonic() < deadline_at:
                consider(pulled(best, space, free=free))
    return best, cost


def chain(poses: FloatArray, space: PoseSpace) -> PoseCurve:
    """Shortest curves through poses (N, 3) one after the other.

    For robots that turn in place the inner headings do not count, nor those at the ends where they are NaN.
    """
    steering = space.steering
    pieces = []
    parts = np.empty((5, 3))
    heading = float(poses[0, 2])
    start = heading
    for k in range(len(poses) - 1):
        n, _, first, heading = kernel.link(
            steering.kind,
            steering.min_turn_radius,
            poses[k],
            poses[k + 1],
            heading,
            k + 2 == len(poses),
            parts,
        )
        start = first if k == 0 else start
        pieces.append(parts[:n].copy())
    begin = np.array([poses[0, 0], poses[0, 1], start])
    return PoseCurve(begin, np.concatenate(pieces) if pieces else np.empty((0, 3))).merged()


def pulled(curve: PoseCurve, space: PoseSpace, *, free: tuple[bool, bool] = (False, False)) -> PoseCurve:
    """The cheapest way over poses of a curve, some left out; pieces of the curve itself may stay.

    The curve itself where no way over its poses is valid: an outline may not turn everywhere on it.
    """
    steering = space.steering
    step = max(_SMALLEST_NODE_M, curve.length / _MAX_NODES)
    pieces = cut(curve, step)
    poses = np.array([curve.start, *(p.joints()[-1] for p in pieces)])
    if steering.kind == TURNING:
        poses[0, 2] = math.nan if free[0] else poses[0, 2]
        poses[-1, 2] = math.nan if free[1] else poses[-1, 2]
    own = np.array([space.cost(p) for p in pieces])
    if steering.kind == TURNING:
        own[:] = np.inf  # its turns in place depend on how it came
    gears = np.array([np.sign(p.parts[0, 0]) for p in pieces], dtype=np.int64)
    chosen: IntArray = np.empty(len(poses), dtype=np.int64)
    args = _chain_args(space)
    least = float(space.rates.min())
    found = kernel.pull_chain(*args[:2], poses, own, gears, _WINDOW, least, PART_M, chosen, *args[2:])
    if not math.isfinite(found):
        return curve
    ways = []
    at = len(poses) - 1
    while at > 0:
        before = int(chosen[at])
        ways.append((before, at))
        at = before if before >= 0 else -1 - before
    parts = []
    heading = float(poses[0, 2])
    start = curve.start.copy()
    for k, (before, after) in enumerate(reversed(ways)):
        if before < 0:
            parts.append(pieces[-1 - before].parts)
            heading = float(poses[after, 2])
            continue
        out = np.empty((5, 3))
        n, _, first, heading = kernel.link(
            steering.kind,
            steering.min_turn_radius,
            poses[before],
            poses[after],
            heading,
            after == len(poses) - 1,
            out,
        )
        if k == 0:
            start[2] = first
        parts.append(out[:n])
    return PoseCurve(start, np.concatenate(parts)).merged()


def _chain_args(space: PoseSpace) -> tuple[object, ...]:
    s = space.steering
    return (s.kind, s.min_turn_radius, s.turn_price, s.gear_price, *space.kernel_args)


def cut(curve: PoseCurve, step: float) -> list[PoseCurve]:
    """Pieces of single parts of a curve, at most ``step`` m long."""
    pieces = []
    pose = curve.start
    for part in curve.parts:
        n = max(1, math.ceil(abs(part[0]) / step - 1e-9))
        for _ in range(n):
            piece = PoseCurve(pose, np.array([[part[0] / n, part[1], part[2] / n]]))
            pieces.append(piece)
            pose = piece.joints()[-1]
    return pieces


def _nodes(curve: PoseCurve, spacing: float, space: PoseSpace, free: tuple[bool, bool]) -> FloatArray:
    """Poses along a curve to move: corners of a robot that turns in place, ends of curves, some between."""
    found = curve.sample(spacing)
    keep = np.concatenate([[True], np.diff(found.part) != 0])
    keep |= np.concatenate([[True], np.diff(found.s) > 0.3 * spacing])
    keep[-1] = True
    poses: FloatArray = np.array(found.poses[keep])
    if space.steering.kind == TURNING:
        apart = np.concatenate([[True], np.hypot(*np.diff(poses[:, :2], axis=0).T) > 1e-9])
        last = poses[-1].copy()
        poses = poses[apart]
        poses[-1] = last
        poses[0, 2] = math.nan if free[0] else poses[0, 2]
        poses[-1, 2] = math.nan if free[1] else poses[-1, 2]
    return poses
