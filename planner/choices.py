"""Which landmarks a simulated robot looks at, and the covariance that a plan would predict of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from localization import covariance as cov
from localization.belief import require_covariance
from localization.heading_field import HeadingField
from localization.kernels.ekf import bearing_row, predict
from localization.kernels.field import in_view, ranked_at
from localization.motion import OdometryModel
from localization.propagation import propagate
from localization.schedule import Drive, LandmarkSchedule, best_triplet_schedule, schedule_of_triplets
from localization.sensors import OmnidirectionalSensor, PinholePanSensor, Sensor, kernel_args
from localization.triplets import MAX_RANKED
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray, IntArray
from maps.visibility import visible_landmarks
from maps.world import World
from planner.errors import InvalidProblem
from planner.reference import Reference, Steering

#: How a robot chooses: the triplet with the smallest ellipse, any that gives a fix (drawn anew at every
#: fix), and both with a camera that is forced to look ahead.
Policy = Literal["best_triplet", "arbitrary", "forced_forward", "arbitrary_forward"]
POLICIES: tuple[str, ...] = ("best_triplet", "arbitrary", "forced_forward", "arbitrary_forward")
_BY_STEP = np.zeros(8)
_NO_OFFSETS = np.empty(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Choices:
    """Where the robot looks up what to measure.

    Attributes
    ----------
    sensor
        What measures; ahead only for ``forced_forward``.
    table
        Shape (8,): grid of cells for ``planner.kernels.simulation``; zeros: one row per step.
    offsets
        Shape (R + 1,): where the candidates of a row begin; empty: one per row.
    triplets
        Shape (C, 3), int16: candidates; -1 for none.
    planned
        Shape (K, 3): what a robot exactly on the reference would choose at each step that has a fix (the
        middle one by area of several candidates); -1 for none.
    """

    sensor: Sensor
    table: FloatArray
    offsets: IntArray
    triplets: IntArray
    planned: IntArray


def choices_of(
    world: World,
    sensor: Sensor,
    *,
    reference: Reference,
    is_fix: BoolArray,
    policy: Policy,
    view_margin: float = 0.0,
    field: UncertaintyField | HeadingField | None = None,
) -> Choices:
    """Candidates for each fix along a reference.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    reference
        K poses.
    is_fix
        Shape (K,): the steps at which the robot measures.
    policy
        See :data:`Policy`.
    view_margin
        Triplets have to keep this far from both edges of a camera's view, rad: the robot looks by what it
        believes, and one that fills the view is lost by the smallest error. Without a field only.
    field
        For ``best_triplet``: the robot looks up the cell that it believes to be in, as far as fixes there can
        be trusted. None: the best triplet of the reference's pose at that time.

    Raises
    ------
    InvalidProblem
        If the policy is unknown or needs a camera, the margin leaves no view, or the field is of another
        world or sensor, holds no triplets, or depends on the heading without having headings.
    """
    if policy not in POLICIES:
        raise InvalidProblem(f"The policy is '{policy}'; use one of {', '.join(POLICIES)}.")
    if policy in {"forced_forward", "arbitrary_forward"}:
        sensor = _ahead(sensor)
    narrow = _narrowed(sensor, view_margin)
    at = np.flatnonzero(is_fix)
    if policy in {"arbitrary", "arbitrary_forward"}:
        lists = [_ranked(world, narrow, pose) for pose in reference.poses[at]]
        counts = np.zeros(len(reference), dtype=np.int64)
        counts[at] = [len(rows) for rows in lists]
        offsets = np.concatenate([[0], np.cumsum(counts)])
        triplets = np.concatenate([np.empty((0, 3), dtype=np.int16), *lists])
        planned = np.full((len(reference), 3), -1, dtype=np.int64)
        for k, rows in zip(at, lists, strict=True):
            if len(rows):
                planned[k] = rows[len(rows) // 2]
        return Choices(sensor, _BY_STEP.copy(), offsets, triplets, planned)
    if policy == "best_triplet" and field is not None:
        return _of_field(world, sensor, reference, is_fix, field)
    planned = np.full((len(reference), 3), -1, dtype=np.int64)
    if len(at):
        stops = Drive(reference.poses[at], reference.times[at])
        planned[at] = best_triplet_schedule(world, narrow, stops).landmarks
    return Choices(sensor, _BY_STEP.copy(), _NO_OFFSETS.copy(), planned.astype(np.int16), planned)


def planned_schedule(world: World, choices: Choices, reference: Reference) -> LandmarkSchedule:
    """What a robot exactly on the reference would measure, step by step."""
    return schedule_of_triplets(reference.drive, choices.planned, world.landmarks, choices.sensor)


def predicted_covariances(
    schedule: LandmarkSchedule,
    reference: Reference,
    start: FloatArray,
    *,
    odometry: OdometryModel,
    steering: Steering,
    single_fixes: bool,
) -> FloatArray:
    """Covariances (K, 3, 3) along the reference, before anything is driven.

    Parameters
    ----------
    schedule
        What is measured at each step.
    reference
        K poses.
    start
        Shape (3, 3): at the first of them.
    odometry
        Noise of the motion.
    steering
        How the robot moves between them.
    single_fixes
        False: of the filtered belief. True: of the last fix alone, carried on by odometry.
    """
    if steering == "differential" and not single_fixes:
        return propagate(reference.drive, schedule, start, odometry=odometry).covariance
    distances, turns = reference.increments(steering)
    poses, noise = reference.poses, odometry.kernel_args
    way = np.diff(poses[:, :2], axis=0)
    out = np.empty((len(poses), 3, 3))
    P = start.copy()
    for k in range(len(poses)):
        if k > 0:
            mean = poses[k - 1].copy()
            if steering == "holonomic":
                mean[2] = math.atan2(way[k - 1, 1], way[k - 1, 0])
            predict(mean, P, distances[k - 1], turns[k - 1], noise)
        information = _information(schedule, poses[k], k)
        if information is not None:
            P = np.array(
                np.linalg.inv(information if single_fixes else information + np.linalg.inv(P)), float
            )
        out[k] = P
    return out


def start_covariance(world: World, sensor: Sensor, pose: FloatArray) -> FloatArray:
    """Covariance (3, 3) of the best fix at a pose (3,).

    Raises
    ------
    InvalidProblem
        If there is no fix.
    """
    schedule = best_triplet_schedule(world, sensor, Drive(pose[None], np.zeros(1)))
    information = _information(schedule, pose, 0)
    if information is None:
        raise InvalidProblem(
            f"There is no fix at the start ({pose[0]:g}, {pose[1]:g}) m; "
            "give the covariance of the robot's place there."
        )
    return np.asarray(np.linalg.inv(information))


def checked_start(covariance: object) -> FloatArray:
    """A covariance (3, 3) of the start, positive definite."""
    P = require_covariance(covariance, 3, "the start")  # type: ignore[arg-type]
    if not (np.diag(P) > 0).all():
        raise InvalidProblem("The covariance of the start has a variance of zero; give small ones instead.")
    return P


def r95(covariances: FloatArray) -> FloatArray:
    """r95, m, of the places of covariances (K, 3, 3)."""
    return cov.r95(np.stack([covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]], axis=-1))


def _ahead(sensor: Sensor) -> Sensor:
    if isinstance(sensor, OmnidirectionalSensor):
        raise InvalidProblem("An omnidirectional sensor has no direction to force ahead; give a camera.")
    if isinstance(sensor, PinholePanSensor):
        return replace(sensor, pan_min=0.0, pan_max=0.0)
    return sensor


def _narrowed(sensor: Sensor, margin: float) -> Sensor:
    if isinstance(sensor, OmnidirectionalSensor) or margin == 0:
        return sensor
    view = sensor.field_of_view - 2 * margin
    if not (margin > 0 and view > 0):
        raise InvalidProblem(
            f"The view_margin is {margin} rad; it must be ≥ 0 and below half the field of view, "
            f"{sensor.field_of_view / 2:.3f} rad."
        )
    return replace(sensor, field_of_view=view)


def _ranked(world: World, sensor: Sensor, pose: FloatArray) -> IntArray:
    """Triplets (C, 3) that give a fix at a pose (3,), smallest ellipse first."""
    x, y = (float(v) for v in pose[:2] + sensor.mount.offset(float(pose[2])))
    args = kernel_args(sensor, float(pose[2]))
    ranges = {"min_range": sensor.min_range, "max_range": sensor.max_range}
    seen = np.flatnonzero(visible_landmarks(world, [[x, y]], **ranges)[0])
    positions, survey = world.landmarks.positions, world.landmarks.sigma**2
    seen = seen[: in_view(x, y, len(seen), seen, positions, args)]
    if len(seen) < 3:
        return np.empty((0, 3), dtype=np.int16)
    values = np.empty(min(MAX_RANKED, math.comb(len(seen), 3)))
    triplets = np.empty((len(values), 3), dtype=np.int64)
    found = ranked_at(x, y, seen, positions, survey, args, values, triplets)
    return triplets[:found].astype(np.int16)


def _of_field(
    world: World,
    sensor: Sensor,
    reference: Reference,
    is_fix: BoolArray,
    field: UncertaintyField | HeadingField,
) -> Choices:
    if field.sensor != sensor or field.world.content_hash() != world.content_hash():
        raise InvalidProblem("The field was made for another world or sensor; leave it out, or give its own.")
    if field.method.estimator != "best_triplet":
        raise InvalidProblem("The field holds no triplets; make one of best triplets, or leave it out.")
    single = isinstance(field, UncertaintyField)
    if single and sensor.depends_on_heading:
        raise InvalidProblem(
            "What the sensor sees depends on the heading, but the field has only one; "
            "give a field over headings, or leave it out."
        )
    slices = (field,) if isinstance(field, UncertaintyField) else field.slices
    frame, n = field.frame, len(slices)
    table = [frame.origin_x, frame.origin_y, math.cos(frame.yaw), math.sin(frame.yaw)]
    table += [frame.resolution, *frame.shape, n]
    triplets = np.concatenate([s.trusted().triplet.reshape(-1, 3) for s in slices])
    cells = frame.cell_at(reference.poses[:, :2])
    inside = is_fix & ((cells >= 0) & (cells < frame.shape)).all(axis=1)
    bins = np.rint(reference.poses[:, 2] / (2 * math.pi) * n).astype(np.int64) % n
    planned = np.full((len(reference), 3), -1, dtype=np.int64)
    rows, cols = cells[inside].T
    planned[inside] = triplets[(bins[inside] * frame.n_rows + rows) * frame.n_cols + cols]
    return Choices(sensor, np.array(table, dtype=np.float64), _NO_OFFSETS.copy(), triplets, planned)


def _information(schedule: LandmarkSchedule, pose: FloatArray, k: int) -> FloatArray | None:
    """Information (3, 3) of the bearings scheduled at step k, measured at ``pose`` (3,); None without."""
    variances = schedule.variances[k]
    if not (variances > 0).all():
        return None
    rows = np.zeros((len(variances), 3))
    at, mount = pose.copy(), schedule.mount.as_array()
    for row, (x, y) in zip(rows, schedule.places[k].tolist(), strict=True):
        bearing_row(at, mount, x, y, row)
    return np.asarray(rows.T @ (rows / variances[:, None]))
