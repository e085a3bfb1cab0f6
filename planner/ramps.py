"""Gradual changes of curvature (clothoids) in place of jumps, so that a robot need not stop to steer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from maps.arrays import FloatArray
from maps.se2 import wrap
from planner.kernels.pose_timing import stations
from planner.steering import PoseCurve, PoseSpace

# Curvatures nearer than this are one, 1/m.
_SAME = 1e-9
# Ramps take at most this share of the parts that they join, and are halved so often before giving up.
_SHARE = 0.9
_HALVINGS = 5
_NEWTON_STEPS = 12
_CLOSED = 1e-10
_DELTA_M = 1e-6
# A ramped way may cost this share more.
_DEARER = 0.01
_STEP_M = 0.05
_FINE_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """A stretch from rest to rest: a drive in one gear, or a turn in place.

    Attributes
    ----------
    start
        Shape (3,): pose.
    rows
        Shape (N, 3): signed way, m, curvature at its begin and at its end, 1/m; empty for a turn.
    turn
        In place, rad.
    """

    start: FloatArray
    rows: FloatArray
    turn: float = 0.0


def plain_rows(curve: PoseCurve) -> FloatArray:
    """The parts of a curve as rows (N, 4): signed way, curvature at begin and end, turn in place."""
    p = curve.parts
    return np.column_stack([p[:, 0], p[:, 1], p[:, 1], p[:, 2]])


def rows_of(curve: PoseCurve, ramps: FloatArray | None, *, stop_at_jumps: bool) -> list[Rows]:
    """Stretches from rest to rest of a curve.

    Parameters
    ----------
    curve
        The way.
    ramps
        Shape (N, 4): rows in place of its parts; None: the parts.
    stop_at_jumps
        Whether the robot stops where the curvature jumps.
    """
    rows = plain_rows(curve) if ramps is None else np.asarray(ramps)
    runs: list[Rows] = []
    pose = np.array(curve.start)
    held: list[FloatArray] = []

    def close() -> None:
        nonlocal pose
        if held:
            run = np.array(held)
            runs.append(Rows(pose, run))
            pose = _end(pose, run)
            held.clear()

    for row in rows:
        if row[0] == 0.0:
            close()
            runs.append(Rows(pose, np.empty((0, 3)), float(row[3])))
            pose = pose + np.array([0.0, 0.0, row[3]])
            continue
        if held:
            jumps = stop_at_jumps and abs(held[-1][2] - row[1]) > _SAME
            if jumps or held[-1][0] * row[0] < 0:
                close()
        held.append(row[:3])
    close()
    return runs


def with_ramps(
    curve: PoseCurve, space: PoseSpace, *, speed: float, max_turn_accel: float
) -> FloatArray | None:
    """A way whose curvature changes gradually where that of a curve jumps.

    At every jump between two parts in one gear the curvature changes linearly over
    ``|Δκ| speed² / max_turn_accel``, as far as the parts are long enough; their lengths are adapted (Newton,
    least change) so that every stretch in one gear ends in the same pose. The curvature is nowhere larger
    than before.

    Parameters
    ----------
    curve
        A valid way.
    space
        What is allowed; the ramped way is valid and at most a percent dearer.
    speed
        At which the ramps are meant to be driven, m/s.
    max_turn_accel
        rad/s².

    Returns
    -------
    rows
        Shape (N, 4): signed way, m, curvature at its begin and end, 1/m, turn in place, rad. Stretches for
        which nothing was found keep their jumps; None when that is so for all.
    """
    if not math.isfinite(max_turn_accel):
        return None
    limit = space.cost(curve) * (1.0 + _DEARER)
    runs = rows_of(curve, None, stop_at_jumps=False)
    chosen = [_as_rows(r) for r in runs]
    found = False
    for k, run in enumerate(runs):
        if len(run.rows) < 2:
            continue
        widths = _widths(run.rows, speed, max_turn_accel)
        for _ in range(_HALVINGS):
            ramped = _ramped(run, widths)
            if ramped is not None:
                trial = [*chosen[:k], np.column_stack([ramped, np.zeros(len(ramped))]), *chosen[k + 1 :]]
                if space.cost(fine_curve(curve.start, np.concatenate(trial))) <= limit:
                    chosen, found = trial, True
                    break
            widths = 0.5 * widths
    return np.concatenate(chosen) if found else None


def fine_curve(start: FloatArray, rows: FloatArray) -> PoseCurve:
    """Short arcs in place of rows (N, 4); they leave them by hundredths of a millimetre."""
    parts: list[FloatArray] = []
    for way, k0, k1, turn in rows:
        if k0 == k1:
            parts.append(np.array([[way, k0, turn]]))
            continue
        n = math.ceil(abs(way) / _FINE_M)
        middle = k0 + (k1 - k0) * (np.arange(n) + 0.5) / n
        parts.append(np.column_stack([np.full(n, way / n), middle, np.zeros(n)]))
    return PoseCurve(start, np.concatenate(parts) if parts else np.empty((0, 3)))


def _as_rows(run: Rows) -> FloatArray:
    if run.turn != 0.0 or len(run.rows) == 0:
        return np.array([[0.0, 0.0, 0.0, run.turn]])
    return np.column_stack([run.rows, np.zeros(len(run.rows))])


def _end(start: FloatArray, rows: FloatArray) -> FloatArray:
    counts = np.maximum(np.ceil(np.abs(rows[:, 0]) / _STEP_M), 1).astype(np.int64)
    table = np.empty((int(counts.sum()) + 1, 6))
    stations(start, np.ascontiguousarray(rows), counts, table)
    return table[-1, :3]


def _widths(rows: FloatArray, speed: float, max_turn_accel: float) -> FloatArray:
    ways = np.abs(rows[:, 0])
    jumps = np.abs(rows[1:, 1] - rows[:-1, 2])
    wanted = jumps * speed**2 / max_turn_accel
    return np.minimum(wanted, _SHARE * np.minimum(ways[:-1], ways[1:]))


def _ramped(run: Rows, widths: FloatArray) -> FloatArray | None:
    # Rows (M, 3) with ramps of such widths that end where the run does; None where lengths would be negative.
    target = _end(run.start, run.rows)
    gear = math.copysign(1.0, run.rows[0, 0])
    ways = np.abs(run.rows[:, 0])
    taken = 0.5 * (np.append(widths, 0.0) + np.concatenate([[0.0], widths]))

    def built(lengths: FloatArray) -> FloatArray:
        rows = []
        for i, kappa in enumerate(run.rows[:, 1]):
            rows.append((gear * (lengths[i] - taken[i]), kappa, kappa))
            if i < len(widths):
                rows.append((gear * widths[i], kappa, run.rows[i + 1, 1]))
        return np.array([r for r in rows if r[0] != 0.0])

    def miss(lengths: FloatArray) -> FloatArray:
        gap = _end(run.start, built(lengths)) - target
        gap[2] = wrap(gap[2])
        return gap

    lengths = ways.copy()
    for _ in range(_NEWTON_STEPS):
        gap = miss(lengths)
        if np.abs(gap).max() < _CLOSED:
            return built(lengths)
        slope = np.empty((3, len(lengths)))
        for i in range(len(lengths)):
            moved = lengths.copy()
            moved[i] += _DELTA_M
            slope[:, i] = (miss(moved) - gap) / _DELTA_M
        lengths = lengths - np.linalg.lstsq(slope, gap, rcond=1e-6)[0]
        if (lengths <= taken).any():
            return None
    return None
