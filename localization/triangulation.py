"""Robot poses from bearings: three in closed form, one fix or a million; more by least squares."""

from __future__ import annotations

import itertools
import math

import numpy as np
import numpy.typing as npt

from localization.camera import Camera
from localization.errors import DegenerateGeometry, InvalidMeasurement
from localization.fixes import Fixes, FixStatus, PoseFix
from localization.kernels import least_squares
from localization.kernels import triangulation as kernel
from localization.kernels.trigonometry import MAX_ANGLE
from localization.numbers import as_numbers, is_number
from localization.sensors import CENTRE, Mount
from maps.arrays import FloatArray

__all__ = [
    "MIN_RELIABILITY",
    "FixStatus",
    "Fixes",
    "PoseFix",
    "locate",
    "locate_columns",
    "triangulate",
    "triangulate_columns",
]

#: Below it a fix counts as lying on the danger circle: rounding would decide the result.
MIN_RELIABILITY = 1e-9
#: Starts of a least-squares fix come from the triplets among this many bearings, spread over the directions.
START_BEARINGS = 20
MAX_STEPS = 60
#: Larger sigmas (rad, px) say nothing, and their squares would leave the range of numbers.
MAX_SIGMA = 1e12
_STARTS_TRIED = 4
_NO_CAMERA = np.empty(0)
_NO_PAN = np.zeros(1)


def triangulate(
    bearings: npt.ArrayLike,
    landmarks: npt.ArrayLike,
    *,
    sigma: npt.ArrayLike | None = None,
    min_reliability: float = MIN_RELIABILITY,
    mount: Mount = CENTRE,
) -> Fixes:
    """Poses from three bearings each, in closed form, for landmarks in any order and place.

    Parameters
    ----------
    bearings
        Shape (N, 3) or (3,): counter-clockwise from the robot's front, rad, any number of turns.
    landmarks
        Shape (3, 2), the same for all fixes, or (N, 3, 2): in W, m, in the order of the bearings.
    sigma
        Standard deviations of the bearings, rad: one, (3,) or (N, 3); None for no covariance.
    min_reliability
        Fixes at or below it are ``DEGENERATE``, in [1e-9, 1).
    mount
        Where the sensor sits on the robot; bearings count from its zero direction.

    Returns
    -------
    fixes
        One per row of bearings: pose of the robot's centre.

    Raises
    ------
    InvalidMeasurement
        If a shape or a sigma is impossible.
    DegenerateGeometry
        If landmarks shared by all fixes coincide. (One fix among many with landmarks of its own is flagged.)

    Notes
    -----
    Inverted about the second landmark, the circles through pairs of landmarks and the robot are lines; see
    ``localization.kernels.triangulation``. The reliability plays the part of the denominator of Pierlot and
    Van Droogenbroeck, A New Three Object Triangulation Algorithm for Mobile Robot Positioning, T-RO 2014.

    Examples
    --------
    >>> quarter = 1.5707963267948966
    >>> fix = triangulate([0.0, quarter, -quarter], [[3, 1], [1, 2], [1, 0]], sigma=0.01)
    >>> fix.pose.round(6).tolist()
    [[1.0, 1.0, 0.0]]
    """
    b = _measured(bearings, "bearings")
    fixes = _fixes(b, landmarks, sigma, 1.0, _NO_PAN, _NO_CAMERA, min_reliability)
    return fixes if mount == CENTRE else fixes.of_robot(mount)


def triangulate_columns(
    columns: npt.ArrayLike,
    landmarks: npt.ArrayLike,
    camera: Camera,
    *,
    pan: npt.ArrayLike = 0.0,
    sigma_px: npt.ArrayLike | None = None,
    min_reliability: float = MIN_RELIABILITY,
    mount: Mount = CENTRE,
) -> Fixes:
    """Poses from three image columns each; sine and cosine are not needed.

    Parameters
    ----------
    columns
        Shape (N, 3) or (3,), px; outside the camera's image a fix is ``OUTSIDE_IMAGE``.
    landmarks, min_reliability, mount
        As for :func:`triangulate`.
    camera
        Which bearings the columns stand for.
    pan
        Optical axis counter-clockwise from the mount's direction, by default the robot's front, rad: one, or
        (N,).
    sigma_px
        Standard deviations of the columns, px: one, (3,) or (N, 3); a bearing has ``σ cos²ψ / f``.

    Returns
    -------
    fixes
        Pose and covariance of the robot, not of the axis.

    Raises
    ------
    InvalidMeasurement, DegenerateGeometry
        As for :func:`triangulate`; also when ``pan`` has another length.
    """
    u = _measured(columns, "columns")
    axis = np.atleast_1d(as_numbers(pan, "pan"))
    if axis.shape not in {(1,), (len(u),)}:
        raise InvalidMeasurement(
            f"pan has shape {axis.shape} for {len(u)} fixes; give one angle or one per fix."
        )
    width = math.inf if camera.width_px is None else camera.width_px
    args = np.array([camera.focal_px, camera.principal_px, width])
    fixes = _fixes(u, landmarks, sigma_px, 1.0 / camera.focal_px, axis, args, min_reliability)
    return fixes if mount == CENTRE else fixes.of_robot(mount)


def locate(
    bearings: npt.ArrayLike, landmarks: npt.ArrayLike, sigma: npt.ArrayLike, *, mount: Mount = CENTRE
) -> PoseFix:
    """Pose from three or more bearings: weighted least squares, started from the best triplet's closed form.

    Parameters
    ----------
    bearings
        Shape (M,), rad, M ≥ 3; a landmark may be measured more than once.
    landmarks
        Shape (M, 2): in W, m, at three places at least.
    sigma
        Standard deviations of the bearings, rad: one, or (M,); from 1e-12 to 1e12.
    mount
        Where the sensor sits on the robot; bearings count from its zero direction.

    Returns
    -------
    fix
        Of the robot's centre; whether the bearings agree with it, its ``p_value`` says. The start is the
        triplet's pose with the smallest weighted sum of squared residuals over all bearings;
        should the steps from it fail, the next ones are tried.

    Raises
    ------
    InvalidMeasurement
        If a shape or number is impossible.
    DegenerateGeometry
        If the landmarks stand at fewer than three places.
    """
    b = np.ascontiguousarray(as_numbers(bearings, "bearings"))
    m = np.ascontiguousarray(as_numbers(landmarks, "landmarks"))
    if b.ndim != 1 or len(b) < 3 or m.shape != (len(b), 2):
        raise InvalidMeasurement(
            f"Bearings have shape {b.shape} and landmarks {m.shape}; give (M,) and (M, 2) with M ≥ 3."
        )
    if not (np.abs(b) <= MAX_ANGLE).all() or not (np.abs(m) <= kernel.MAX_COORDINATE).all():
        raise InvalidMeasurement("Bearings and landmarks must be finite, up to 1e5 rad and 1e12 m.")
    s = as_numbers(sigma, "sigma")
    if s.shape not in {(), (len(b),)} or not ((s >= 1e-12) & (s <= MAX_SIGMA)).all():
        raise InvalidMeasurement(
            f"sigma is {s.tolist()}; give one or {len(b)} numbers from 1e-12 to {MAX_SIGMA:g} rad."
        )
    if len(np.unique(m, axis=0)) < 3:
        raise DegenerateGeometry("The landmarks stand at fewer than three places; a fix needs three.")
    weights = np.ascontiguousarray(np.broadcast_to(s**-2.0, b.shape))
    b, m, weights = _read_only(b), _read_only(m), _read_only(weights)
    starts, otherwise = _starts(b, m, weights)
    failure = PoseFix(np.full(3, np.nan), np.full((3, 3), np.nan), otherwise, math.nan, 0, len(b) - 3)
    for start in starts:
        pose, covariance = start.copy(), np.empty((3, 3))
        outcome, steps, chi2 = least_squares.refine(b, m, weights, MAX_STEPS, pose, covariance)
        if outcome == least_squares.CONVERGED:
            fix = PoseFix(pose, covariance, FixStatus.OK, chi2, steps, len(b) - 3)
            return fix if mount == CENTRE else fix.of_robot(mount)
        if failure.steps == 0:
            singular = outcome == least_squares.SINGULAR
            status = FixStatus.SINGULAR if singular else FixStatus.NO_CONVERGENCE
            failure = PoseFix(failure.pose, failure.covariance, status, chi2, steps, len(b) - 3)
    return failure


def locate_columns(
    columns: npt.ArrayLike,
    landmarks: npt.ArrayLike,
    camera: Camera,
    sigma_px: float,
    *,
    pan: float = 0.0,
    bearing_floor: float = 0.0,
    mount: Mount = CENTRE,
) -> PoseFix:
    """Pose from three or more image columns, as :func:`locate`.

    Parameters
    ----------
    columns
        Shape (M,), px, M ≥ 3.
    landmarks
        Shape (M, 2): in W, m, at three places at least.
    camera
        Which bearings the columns stand for.
    sigma_px
        Standard deviation of a column, px; a bearing has ``σ cos²ψ / f``.
    pan
        Optical axis counter-clockwise from the mount's direction, rad.
    bearing_floor
        Constant part of the bearings' standard deviation, rad; the variances add.
    mount
        Where the camera sits on the robot.

    Returns
    -------
    fix
        Of the robot's centre.

    Raises
    ------
    InvalidMeasurement, DegenerateGeometry
        As for :func:`locate`; also when the pan or the floor is no such number.
    ColumnOutsideImage
        If a column is not in the image.
    InvalidSensor
        If the sigma of the columns is negative or not finite.

    Examples
    --------
    >>> camera = Camera(500.0, 320.0, 640.0)
    >>> fix = locate_columns([70.0, 320.0, 570.0], [[4, 2], [3, 0], [4, -2]], camera, 1.0)
    >>> abs(fix.pose.round(6)).tolist()
    [0.0, 0.0, 0.0]
    """
    u = as_numbers(columns, "columns")
    if not (is_number(pan) and abs(pan) <= MAX_ANGLE):
        raise InvalidMeasurement(f"pan is {pan!r}; give one angle, rad.")
    if not (is_number(bearing_floor) and 0 <= bearing_floor < math.inf):
        raise InvalidMeasurement(f"bearing_floor is {bearing_floor!r}; it must be ≥ 0 rad and finite.")
    sigma = np.hypot(camera.bearing_sigma(u, sigma_px), bearing_floor)
    return locate(camera.bearings(u) + pan, landmarks, sigma, mount=mount)


def _starts(bearings: FloatArray, landmarks: FloatArray, weights: FloatArray) -> tuple[FloatArray, FixStatus]:
    """Poses (k, 3) of triplets, best first, and the status should there be none."""
    order = np.argsort(bearings % (2 * math.pi), kind="stable")
    picked = np.unique(np.linspace(0, len(order) - 1, min(len(order), START_BEARINGS)).astype(np.int64))
    triplets = np.array(list(itertools.combinations(order[picked].tolist(), 3)), dtype=np.int64)
    fixes = _fixes(bearings[triplets], landmarks[triplets], None, 1.0, _NO_PAN, _NO_CAMERA, MIN_RELIABILITY)
    if not fixes.ok.any():
        flat = fixes.count(FixStatus.DEGENERATE) == len(fixes)
        return np.empty((0, 3)), FixStatus.DEGENERATE if flat else FixStatus.NO_POSE
    poses = fixes.pose[fixes.ok]
    cost = [least_squares.chi_square(bearings, landmarks, weights, *pose) for pose in poses.tolist()]
    return poses[np.argsort(cost, kind="stable")[:_STARTS_TRIED]], FixStatus.OK


def _measured(values: npt.ArrayLike, name: str) -> FloatArray:
    out = np.atleast_2d(np.ascontiguousarray(as_numbers(values, name)))
    if out.ndim != 2 or out.shape[1] != 3:
        raise InvalidMeasurement(f"The {name} have shape {np.shape(values)}; give (N, 3) or (3,).")
    return out


def _fixes(
    measured: FloatArray,
    landmarks: npt.ArrayLike,
    sigma: npt.ArrayLike | None,
    unit: float,
    pan: FloatArray,
    camera: FloatArray,
    min_reliability: float,
) -> Fixes:
    """Call the kernel; ``unit`` turns sigma into radians on the optical axis."""
    n = len(measured)
    if not is_number(min_reliability) or not MIN_RELIABILITY <= min_reliability < 1:
        raise InvalidMeasurement(
            f"min_reliability is {min_reliability}; it must be from {MIN_RELIABILITY:g} to below 1."
        )
    places = _triplets(landmarks, n)
    variances = np.zeros((1, 3)) if sigma is None else _variances(sigma, n) * unit**2
    pose, status, reliability = np.empty((n, 3)), np.empty(n, dtype=np.uint8), np.empty(n)
    covariance = np.empty((0 if sigma is None else n, 3, 3))
    given = (_read_only(a) for a in (measured, places, variances, pan, camera))
    kernel.fixes(*given, min_reliability, pose, covariance, status, reliability)
    for array in (pose, covariance, status, reliability):
        array.flags.writeable = False
    return Fixes(pose, None if sigma is None else covariance, status, reliability)


def _read_only(array: FloatArray) -> FloatArray:
    """A view that nobody writes to: kernels are compiled for one kind of input only."""
    view = array.view()
    view.flags.writeable = False
    return view


def _triplets(landmarks: npt.ArrayLike, n: int) -> FloatArray:
    m = np.ascontiguousarray(as_numbers(landmarks, "landmarks"))
    if m.shape == (n, 3, 2):
        return m
    if m.shape != (3, 2):
        raise InvalidMeasurement(f"Landmarks have shape {m.shape}; give (3, 2), or ({n}, 3, 2).")
    if not (np.abs(m) <= kernel.MAX_COORDINATE).all():
        raise InvalidMeasurement("Landmarks must be finite and within 1e12 m.")
    size = np.ptp(m, axis=0).max()
    for i, j in itertools.combinations(range(3), 2):
        if math.dist(m[i], m[j]) <= kernel.COINCIDENT * size:
            raise DegenerateGeometry(
                f"Landmarks {i} and {j} both stand at ({m[i, 0]:g}, {m[i, 1]:g}) m; a fix needs three places."
            )
    return m[None]


def _variances(sigma: npt.ArrayLike, n: int) -> FloatArray:
    s = as_numbers(sigma, "sigma")
    if s.shape not in {(), (3,), (n, 3)}:
        raise InvalidMeasurement(f"sigma has shape {s.shape}; give one number, (3,) or ({n}, 3).")
    if not ((s >= 0) & (s <= MAX_SIGMA)).all():
        raise InvalidMeasurement(
            f"sigma must be ≥ 0 and at most {MAX_SIGMA:g}; it goes from {np.min(s)} to {np.max(s)}."
        )
    return np.ascontiguousarray(np.broadcast_to(s, (1, 3)) if s.ndim < 2 else s) ** 2
