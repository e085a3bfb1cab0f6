"""Monte Carlo of fixes: what becomes of noisy measurements of one triplet, or of all landmarks, at a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from localization.all_landmarks import fixes_of_all, landmarks_in_view, pose_covariance
from localization.camera import Camera
from localization.covariance import CHI2_95
from localization.errors import DegenerateGeometry, LocalizationError
from localization.fixes import Fixes, FixStatus, carried_to_robot
from localization.kernels.fix import triplet_fix
from localization.method import ESTIMATORS, Estimator
from localization.numbers import as_heading, as_place, is_number
from localization.ranking import LandmarkStatus, checked_triplet, landmark_statuses
from localization.sensors import CENTRE, OmnidirectionalSensor, Sensor, kernel_args
from localization.triangulation import triangulate, triangulate_columns
from localization.triplets import best_triplet
from maps.arrays import BoolArray, FloatArray, frozen
from maps.se2 import wrap
from maps.world import World

MAX_FIXES = 10_000_000
DEFAULT_FIXES = 10_000
#: Least squares take longer than a closed form.
DEFAULT_FIXES_OF_ALL = 2_000


@dataclass(frozen=True, slots=True, eq=False)
class FixCloud:
    """Simulated fixes of one triplet, or of all landmarks in view, at one pose.

    Attributes
    ----------
    pose
        Shape (3,): true x, y (m) and heading (rad) in W.
    triplet
        Indices into ``world.landmarks``: three, or all M in view.
    landmarks
        Shape (3, 2) or (M, 2): where the map says that they stand, W, m.
    pan
        Optical axis relative to the heading, rad; NaN without a pan head.
    fixes
        The n simulated fixes; those that failed have a status other than ``OK``.
    predicted
        Shape (3, 3): first-order covariance at the true pose, m² and rad².
    """

    pose: FloatArray
    triplet: tuple[int, ...]
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
    estimator: Estimator = "best_triplet",
    n: int | None = None,
    rng: np.random.Generator,
) -> FixCloud:
    """Measure landmarks n times with the sensor's noise and compute the fix of each measurement.

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
        Three landmarks that are visible from there; None for the best. Not with ``all_visible``.
    estimator
        ``best_triplet``: three landmarks, triangulated exactly; ``all_visible``: every landmark in view, by
        least squares.
    n
        Number of measurements, 1 to 10,000,000; by default 10,000 of triplets, 2,000 of all landmarks.
    rng
        Source of the noise; the same state gives the same cloud.

    Returns
    -------
    cloud
        Fixes, prediction and how they compare.

    Raises
    ------
    LocalizationError
        If the point, n, the estimator or the indices make no sense.
    DegenerateGeometry
        If there is no fix to first order: triplet not visible, not within the view, or on the danger circle.
    """
    if estimator not in ESTIMATORS:
        raise LocalizationError(f"Unknown estimator {estimator!r}; use one of {', '.join(ESTIMATORS)}.")
    if n is None:
        n = DEFAULT_FIXES if estimator == "best_triplet" else DEFAULT_FIXES_OF_ALL
    if not is_number(n) or not 1 <= n <= MAX_FIXES:
        raise LocalizationError(f"Number of fixes is {n}; it must be from 1 to {MAX_FIXES}.")
    place, heading = as_place(point), as_heading(heading)
    pose = np.array([place[0], place[1], float(wrap(heading))])
    # The sensor's own pose; the robot's follows from it.
    at = np.append(place + sensor.mount.offset(heading), wrap(pose[2] + sensor.mount.theta))
    if estimator == "all_visible":
        return _all_visible(world, sensor, pose, at, triplet, n=int(n), rng=rng)
    chosen = _chosen(world, sensor, pose, triplet)
    positions, survey = world.landmarks.positions, world.landmarks.sigma
    fix = triplet_fix(at[0], at[1], *chosen, positions, survey**2, kernel_args(sensor, pose[2]))
    if math.isnan(fix[0]):
        names = ", ".join(world.landmarks.ids[i] for i in chosen)
        raise DegenerateGeometry(
            f"Landmarks {names} give no fix at ({pose[0]:g}, {pose[1]:g}) m: they lie on a circle with it, "
            "or do not fit into the view. Choose others, or leave the choice open."
        )
    three, sigma = positions[list(chosen)], survey[list(chosen)]
    pan = 0.0 if math.isnan(fix[4]) else fix[4]
    found = _measured(sensor, three, sigma, at, pan, n=int(n), rng=rng)
    if found.columns is not None and sensor.bearing_floor == 0:
        fixes = triangulate_columns(found.columns, three, found.camera, pan=pan)
    else:
        fixes = triangulate(found.bearings, three)
    predicted = triangulate(found.true, three, sigma=found.sigma)
    if predicted.covariance is None or not predicted.ok[0]:
        raise DegenerateGeometry(f"The triplet is too close to degenerate at ({pose[0]:g}, {pose[1]:g}) m.")
    covariance = predicted.covariance[0]
    if sensor.mount != CENTRE:
        fixes = fixes.of_robot(sensor.mount)
        _, moved = carried_to_robot(at, covariance, sensor.mount)
        assert moved is not None
        covariance = moved
    return FixCloud(pose, chosen, three, fix[4], fixes, covariance)


def _all_visible(
    world: World,
    sensor: Sensor,
    pose: FloatArray,
    at: FloatArray,
    triplet: tuple[int, int, int] | None,
    *,
    n: int,
    rng: np.random.Generator,
) -> FixCloud:
    """The cloud of all landmarks in view, the sensor being at ``at`` (3,)."""
    if triplet is not None:
        raise LocalizationError("All landmarks in view are asked for; leave the triplet out.")
    view = landmarks_in_view(world, sensor, pose[:2], heading=float(pose[2]))
    if view is None:
        raise DegenerateGeometry(f"The landmarks in view of ({pose[0]:g}, {pose[1]:g}) m give no fix.")
    marks, sigma = world.landmarks.positions[view.indices], world.landmarks.sigma[view.indices]
    pan = 0.0 if math.isnan(view.pan) else view.pan
    found = _measured(sensor, marks, sigma, at, pan, n=n, rng=rng)
    fixes = fixes_of_all(found.bearings, marks, found.sigma, at)
    covariance = pose_covariance(at, marks, found.sigma)
    if sensor.mount != CENTRE:
        fixes = fixes.of_robot(sensor.mount)
        _, moved = carried_to_robot(at, covariance, sensor.mount)
        assert moved is not None
        covariance = moved
    return FixCloud(pose, tuple(view.indices.tolist()), marks, view.pan, fixes, covariance)


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Bearings (n, M) from the sensor's zero, perhaps from columns (n, M); true bearings and sigmas (M,)."""

    bearings: FloatArray
    columns: FloatArray | None
    camera: Camera
    true: FloatArray
    sigma: FloatArray


def _measured(
    sensor: Sensor,
    marks: FloatArray,
    sigma: FloatArray,
    at: FloatArray,
    pan: float,
    *,
    n: int,
    rng: np.random.Generator,
) -> _Measured:
    """Measurements of landmarks (M, 2) with survey sigmas (M,) by a sensor at a pose (3,)."""
    m = len(marks)
    stand = marks
    if sigma.any():
        stand = marks + rng.normal(size=(n, m, 2)) * sigma[:, None]
    true, psi = _off_axis(marks, at, at[2] + pan), _off_axis(stand, at, at[2] + pan)
    share = np.hypot(sigma / np.hypot(*(marks - at[:2]).T), sensor.bearing_floor)
    blur = rng.normal(0.0, sensor.bearing_floor, (n, m)) if sensor.bearing_floor > 0 else 0.0
    if isinstance(sensor, OmnidirectionalSensor):
        bearings = psi + rng.normal(0.0, sensor.bearing_sigma, (n, m)) + blur
        return _Measured(bearings, None, Camera(1.0), true + pan, np.hypot(sensor.bearing_sigma, share))
    camera = Camera(sensor.focal_px)
    # A landmark close by may, by the survey's error, stand behind the camera: nothing is measured then.
    behind = np.cos(psi) <= 1e-12
    columns = camera.columns(np.where(behind, 0.0, psi))
    columns = np.where(behind, np.nan, columns) + rng.normal(0.0, sensor.column_sigma_px, (n, m))
    bearings = np.arctan((camera.principal_px - columns) / camera.focal_px) + blur + pan
    spread = np.hypot(camera.bearing_sigma(camera.columns(true), sensor.column_sigma_px), share)
    return _Measured(bearings, columns, camera, true + pan, spread)


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
