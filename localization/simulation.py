"""Monte Carlo of fixes: what becomes of noisy measurements of one triplet at one pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from localization.camera import Camera
from localization.covariance import CHI2_95
from localization.errors import DegenerateGeometry, LocalizationError
from localization.fixes import Fixes, FixStatus, carried_to_robot
from localization.kernels.fix import triplet_fix
from localization.numbers import as_heading, as_place, is_number
from localization.ranking import LandmarkStatus, checked_triplet, landmark_statuses
from localization.sensors import CENTRE, OmnidirectionalSensor, Sensor, kernel_args
from localization.triangulation import triangulate, triangulate_columns
from localization.triplets import best_triplet
from maps.arrays import BoolArray, FloatArray, frozen
from maps.se2 import wrap
from maps.world import World

MAX_FIXES = 10_000_000


@dataclass(frozen=True, slots=True, eq=False)
class FixCloud:
    """Simulated fixes of one triplet at one pose.

    Attributes
    ----------
    pose
        Shape (3,): true x, y (m) and heading (rad) in W.
    triplet
        Indices into ``world.landmarks``.
    landmarks
        Shape (3, 2): where the map says that they stand, W, m.
    pan
        Optical axis relative to the heading, rad; NaN without a pan head.
    fixes
        The n simulated fixes; those that failed have a status other than ``OK``.
    predicted
        Shape (3, 3): first-order covariance at the true pose, m² and rad².
    """

    pose: FloatArray
    triplet: tuple[int, int, int]
    landmarks: FloatArray
    pan: float
    fixes: Fixes
    predicted: FloatArray

    def __post_init__(self) -> None:
        for name in ("pose", "landmarks", "predicted"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def failures(self) -> int:
        """How many simulated measurements gave no fix."""
        return len(self.fixes) - self.fixes.count(FixStatus.OK)

    @property
    def errors(self) -> FloatArray:
        """Shape (n - failures, 3): fix minus truth, m and rad (wrapped)."""
        out = np.asarray(self.fixes.pose[self.fixes.ok] - self.pose)
        out[:, 2] = wrap(out[:, 2])
        return out

    @property
    def inside(self) -> BoolArray:
        """Shape (n,): whether a fix lies in the predicted 95 % ellipse about the truth; failures do not."""
        out = np.zeros(len(self.fixes), dtype=np.bool_)
        e = self.errors[:, :2]
        (xx, xy), (_, yy) = self.predicted[:2, :2]
        distance2 = (yy * e[:, 0] ** 2 - 2 * xy * e[:, 0] * e[:, 1] + xx * e[:, 1] ** 2) / (xx * yy - xy**2)
        out[self.fixes.ok] = distance2 <= CHI2_95
        return out

    @property
    def share_inside(self) -> float:
        """Share of all n in the predicted 95 % ellipse; 0.95 where first order holds."""
        return float(self.inside.mean())

    @property
    def sample_covariance(self) -> FloatArray:
        """Shape (3, 3): covariance of the errors about their mean; NaN with fewer than two fixes."""
        if len(self.errors) < 2:
            return np.full((3, 3), np.nan)
        return np.asarray(np.cov(self.errors.T))

    @property
    def bias(self) -> FloatArray:
        """Shape (3,): mean error, m and rad; NaN without a fix. Zero to first order."""
        return np.asarray(self.errors.mean(axis=0)) if len(self.errors) else np.full(3, np.nan)


def simulate_fixes(
    world: World,
    sensor: Sensor,
    point: npt.ArrayLike,
    *,
    heading: float = 0.0,
    triplet: tuple[int, int, int] | None = None,
    n: int = 10_000,
    rng: np.random.Generator,
) -> FixCloud:
    """Measure a triplet n times with the sensor's noise and triangulate each measurement exactly.

    Noise is Gaussian: on bearings for an omnidirectional sensor, on image columns for a camera, whose axis
    stands where the field puts it; a floor of the bearing's sigma is noise on the bearing for all of them.
    Landmarks with a survey sigma stand beside their mapped place, anew for each measurement. The fix of a
    sensor off the robot's centre is carried over to the centre. Noise may carry a column past the edge of the
    image; such a measurement counts like any other, otherwise triplets that fill the view would look better
    than they are.

    Parameters
    ----------
    world, sensor
        What is where, and what measures it.
    point
        Shape (2,): where the robot is, W, m.
    heading
        Of the robot, rad.
    triplet
        Three landmarks that are visible from there; None for the best.
    n
        Number of measurements, 1 to 10,000,000.
    rng
        Source of the noise; the same state gives the same cloud.

    Returns
    -------
    cloud
        Fixes, prediction and how they compare.

    Raises
    ------
    LocalizationError
        If the point, n or the indices make no sense.
    DegenerateGeometry
        If there is no fix to first order: triplet not visible, not within the view, or on the danger circle.
    """
    if not is_number(n) or not 1 <= n <= MAX_FIXES:
        raise LocalizationError(f"Number of fixes is {n}; it must be from 1 to {MAX_FIXES}.")
    place, heading = as_place(point), as_heading(heading)
    pose = np.array([place[0], place[1], float(wrap(heading))])
    chosen = _chosen(world, sensor, pose, triplet)
    positions, survey = world.landmarks.positions, world.landmarks.sigma
    # The sensor's own pose; the robot's follows from it.
    at = np.append(place + sensor.mount.offset(heading), wrap(pose[2] + sensor.mount.theta))
    fix = triplet_fix(at[0], at[1], *chosen, positions, survey**2, kernel_args(sensor, pose[2]))
    if math.isnan(fix[0]):
        names = ", ".join(world.landmarks.ids[i] for i in chosen)
        raise DegenerateGeometry(
            f"Landmarks {names} give no fix at ({pose[0]:g}, {pose[1]:g}) m: they lie on a circle with it, "
            "or do not fit into the view. Choose others, or leave the choice open."
        )
    three, sigma = positions[list(chosen)], survey[list(chosen)]
    stand = three
    if sigma.any():
        stand = three + rng.normal(size=(n, 3, 2)) * sigma[:, None]
    pan = 0.0 if math.isnan(fix[4]) else fix[4]
    true = _off_axis(three, at, at[2] + pan)
    psi = _off_axis(stand, at, at[2] + pan)
    share = np.hypot(sigma / np.hypot(*(three - at[:2]).T), sensor.bearing_floor)
    blur = rng.normal(0.0, sensor.bearing_floor, (n, 3)) if sensor.bearing_floor > 0 else 0.0
    if isinstance(sensor, OmnidirectionalSensor):
        fixes = triangulate(psi + rng.normal(0.0, sensor.bearing_sigma, (n, 3)) + blur, three)
        spread = np.hypot(sensor.bearing_sigma, share)
    else:
        camera = Camera(sensor.focal_px)
        # A landmark close by may, by the survey's error, stand behind the camera: nothing is measured then.
        behind = np.cos(psi) <= 1e-12
        columns = camera.columns(np.where(behind, 0.0, psi))
        columns = np.where(behind, np.nan, columns) + rng.normal(0.0, sensor.column_sigma_px, (n, 3))
        if sensor.bearing_floor > 0:
            fixes = triangulate(
                np.arctan((camera.principal_px - columns) / camera.focal_px) + blur + pan, three
            )
        else:
            fixes = triangulate_columns(columns, three, camera, pan=pan)
        spread = np.hypot(camera.bearing_sigma(camera.columns(true), sensor.column_sigma_px), share)
    predicted = triangulate(true + pan, three, sigma=spread)
    if predicted.covariance is None or not predicted.ok[0]:
        raise DegenerateGeometry(f"The triplet is too close to degenerate at ({pose[0]:g}, {pose[1]:g}) m.")
    covariance = predicted.covariance[0]
    if sensor.mount != CENTRE:
        fixes = fixes.of_robot(sensor.mount)
        _, moved = carried_to_robot(at, covariance, sensor.mount)
        assert moved is not None
        covariance = moved
    return FixCloud(pose, chosen, three, fix[4], fixes, covariance)


def _off_axis(landmarks: FloatArray, pose: FloatArray, axis: float) -> FloatArray:
    """Bearings (..., 3) of landmarks (..., 3, 2) off an axis at azimuth ``axis``, rad."""
    d = landmarks - pose[:2]
    return wrap(np.arctan2(d[..., 1], d[..., 0]) - axis)


def _chosen(
    world: World, sensor: Sensor, pose: FloatArray, triplet: tuple[int, int, int] | None
) -> tuple[int, int, int]:
    """The triplet, after a check that it is there and visible."""
    place = pose[:2]
    where = f"({place[0]:g}, {place[1]:g}) m"
    if triplet is None:
        best = best_triplet(world, sensor, place, heading=float(pose[2]))
        if best is None:
            raise DegenerateGeometry(f"No triplet gives a fix at {where}.")
        return best.triplet
    i, j, k = checked_triplet(world, triplet)
    at = place + sensor.mount.offset(float(pose[2]))
    statuses = landmark_statuses(world, sensor, at, float(pose[2]))
    out = [t for t in (i, j, k) if statuses[t] is not LandmarkStatus.MEASURABLE]
    if out:
        names = ", ".join(f"{world.landmarks.ids[t]} ({statuses[t].value.replace('_', ' ')})" for t in out)
        raise DegenerateGeometry(f"Landmarks cannot be seen from {where}: {names}.")
    return i, j, k
