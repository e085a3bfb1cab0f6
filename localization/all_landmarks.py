"""All landmarks in view of a place together: which they are, what fix they give, and simulated ones."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from localization.errors import DegenerateGeometry
from localization.fixes import Fixes, FixStatus
from localization.kernels import least_squares
from localization.kernels.fix import FIT_TOLERANCE
from localization.method import FieldMethod
from localization.numbers import as_heading, as_place
from localization.ranking import LandmarkStatus, landmark_statuses
from localization.sensors import Criterion, PinholePanSensor, Sensor
from localization.tiles import compute_tile
from localization.triangulation import MAX_STEPS, START_BEARINGS, locate, triangulate
from localization.triplets import pack_masks
from maps.arrays import FloatArray, IntArray, frozen
from maps.se2 import wrap
from maps.world import World

# A fix that its bearings disagree with so much may have ended beside the best pose.
_DOUBTFUL = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LandmarksInView:
    """The landmarks that a field of all landmarks in view uses at a place.

    Attributes
    ----------
    indices
        Shape (M,), M ≥ 3: into ``world.landmarks``, ascending.
    pan
        Optical axis relative to the heading, rad; NaN without a pan head.
    covariance
        Shape (3,): xx, xy, yy of the robot's position, m², as in the field.
    """

    indices: IntArray
    pan: float
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "indices", frozen(self.indices, dtype=np.int64))
        object.__setattr__(self, "covariance", frozen(self.covariance))


def landmarks_in_view(
    world: World, sensor: Sensor, point: npt.ArrayLike, *, heading: float = 0.0, criterion: Criterion = "area"
) -> LandmarksInView | None:
    """All landmarks in view of a place, as in a field's cell there; None where they give no fix.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    point
        Shape (2,): the robot's centre, W, m.
    heading
        Of the robot, rad.
    criterion
        What a pan head makes smallest.

    Raises
    ------
    LocalizationError
        If the point or heading is not finite.
    """
    place, turned = as_place(point), float(wrap(as_heading(heading)))
    at = place + sensor.mount.offset(turned)
    statuses = landmark_statuses(world, sensor, at, turned)
    seen = np.array([s is LandmarkStatus.MEASURABLE for s in statuses])
    free = np.array([[bool(world.floor.free_at(place))]])
    masks = pack_masks(seen[None, :])[None, :, :]
    method = FieldMethod("all_visible", criterion)
    tile = compute_tile(world, sensor, place.reshape(1, 1, 2), free, masks, heading=turned, method=method)
    if math.isnan(tile.covariance[0, 0, 0]):
        return None
    pan = float(tile.pan[0, 0])
    if isinstance(sensor, PinholePanSensor):
        d = world.landmarks.positions - at
        off = wrap(np.arctan2(d[:, 1], d[:, 0]) - turned - sensor.mount.theta - pan)
        seen &= np.abs(off) <= 0.5 * sensor.field_of_view + FIT_TOLERANCE
    return LandmarksInView(np.flatnonzero(seen), pan, tile.covariance[0, 0])


def pose_covariance(pose: FloatArray, landmarks: FloatArray, sigma: FloatArray) -> FloatArray:
    """Covariance (3, 3) of a sensor's pose (3,) from bearings of landmarks (M, 2) with sigma (M,), rad.

    Raises
    ------
    DegenerateGeometry
        If the information has no inverse.
    """
    d = landmarks - pose[:2]
    r2 = np.sum(d * d, axis=1)
    rows = np.stack([d[:, 1] / r2, -d[:, 0] / r2, -np.ones(len(d))], axis=-1) / sigma[:, None]
    information = rows.T @ rows
    scale = 1.0 / np.sqrt(np.diag(information))
    unit = information * scale[:, None] * scale[None, :]
    if np.linalg.eigvalsh(unit)[0] <= least_squares.SINGULAR_PIVOT:
        raise DegenerateGeometry(f"The landmarks give no fix at ({pose[0]:g}, {pose[1]:g}) m.")
    return np.asarray(np.linalg.inv(unit) * scale[:, None] * scale[None, :])


def fixes_of_all(bearings: FloatArray, landmarks: FloatArray, sigma: FloatArray, pose: FloatArray) -> Fixes:
    """Least-squares fixes of many measurements of the same landmarks.

    Each starts from the closed form of one triplet, the best at a nominal pose; where that fails, or the
    bearings disagree with what it leads to, from the triplets that ``locate`` tries.

    Parameters
    ----------
    bearings
        Shape (n, M): rad, from the sensor's zero; NaN where nothing was measured.
    landmarks
        Shape (M, 2): W, m.
    sigma
        Shape (M,): standard deviations that weigh the bearings, rad.
    pose
        Shape (3,): nominal pose of the sensor.

    Returns
    -------
    fixes
        Of the sensor, without covariance; the reliability is NaN.
    """
    n, m = bearings.shape
    start = _best_start(pose, landmarks, sigma)
    first = triangulate(bearings[:, start], landmarks[start])
    poses = first.pose.copy()
    complete = np.isfinite(bearings).all(axis=1)
    status = np.where(complete, FixStatus.NO_CONVERGENCE, FixStatus.NOT_FINITE).astype(np.uint8)
    outcome, cost = np.empty(n, dtype=np.int64), np.empty(n)
    least_squares.refine_many(
        np.ascontiguousarray(bearings),
        landmarks,
        sigma**-2.0,
        MAX_STEPS,
        first.ok & complete,
        poses,
        outcome,
        cost,
    )
    good = outcome == least_squares.CONVERGED
    if m > 3:
        good &= chi2.sf(np.where(good, cost, 0.0), m - 3) > _DOUBTFUL
    status[good] = FixStatus.OK
    for k in np.flatnonzero(complete & ~good):
        fix = locate(bearings[k], landmarks, sigma)
        # The better of two ends, if there are two.
        if fix.converged and (outcome[k] != least_squares.CONVERGED or fix.chi2 < cost[k]):
            poses[k] = fix.pose
            status[k] = FixStatus.OK
        elif outcome[k] == least_squares.CONVERGED:
            status[k] = FixStatus.OK
        else:
            status[k] = fix.status
    poses[status != FixStatus.OK] = np.nan
    return Fixes(poses, None, status, np.full(n, np.nan))


def _best_start(pose: FloatArray, landmarks: FloatArray, sigma: FloatArray) -> IntArray:
    """The triplet (3,) with the smallest ellipse at a pose, among landmarks spread over the directions."""
    d = landmarks - pose[:2]
    order = np.argsort(np.arctan2(d[:, 1], d[:, 0]), kind="stable")
    picked = np.unique(np.linspace(0, len(order) - 1, min(len(order), START_BEARINGS)).astype(np.int64))
    triplets = np.array(list(itertools.combinations(order[picked].tolist(), 3)), dtype=np.int64)
    g = d / np.sum(d * d, axis=1)[:, None]
    e, f = g[triplets[:, 1]] - g[triplets[:, 0]], g[triplets[:, 2]] - g[triplets[:, 0]]
    v = sigma[triplets] ** 2
    size = v[:, 0] * v[:, 1] + v[:, 0] * v[:, 2] + v[:, 1] * v[:, 2]
    return np.asarray(triplets[np.argmax((e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]) ** 2 / size)])
